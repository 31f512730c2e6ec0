"""Forces known beforehand ([[magnet]]): what the cross-check makes of them."""

import math
from dataclasses import replace

import numpy as np
import pytest

import mtpipe
from mtpipe.crosschecking.check import check_bead
from mtpipe.crosschecking.prepared_bead import support
from mtpipe.diagnosis.location import located
from mtpipe.experiment.known_force import KnownForce, known_force, known_force_notices
from mtpipe.joint_fit.known_forces import MOST_NATS, known_force_nats
from mtpipe.report import crosscheck_words
from mtpipe.setup.tables import Magnet
from tests.small_case import FORCES_PN, case, generator, raw, setup

pytestmark = pytest.mark.slow

ROUNDS = (26,)


@pytest.fixture(scope="module")
def recorded():
    return raw(11)


def knowing(setup, *forces):
    """The setup with forces known beforehand: each a position, a force and perhaps its error."""
    names = "position_mm", "force_pN", "force_pN_stderr"
    magnet = tuple(Magnet(**dict(zip(names, one, strict=False))) for one in forces)
    return setup.model_copy(update={"magnet": magnet})


def stating(recording, factor=1.0, relative_stderr=0.0):
    """The recording with its true forces, or a multiple of them, known beforehand."""
    stated = [factor * force for force in FORCES_PN]
    known = [
        (plateau.magnet_mm, force, force * relative_stderr)
        for plateau, force in zip(recording.plateaus, stated, strict=True)
    ]
    return replace(recording, setup=knowing(recording.setup, *known))


def looks_of(recording):
    check = check_bead(case(recording), generator(1), rounds=ROUNDS)
    mine = [i for i, look in enumerate(check.statistics) if look.kind == "known_force"]
    return check, mine


def test_without_known_forces_nothing_is_compared(recorded):
    check, mine = looks_of(recorded)
    assert not mine
    assert known_force_nats(check.case.fit) == 0
    assert support(check.case.fit) == check.case.fit.log_likelihood


def test_true_forces_agree_and_are_looked_at_one_by_one_and_together(recorded):
    check, mine = looks_of(stating(recorded))
    assert [(check.statistics[i].plateaus, check.statistics[i].pooled) for i in mine] == [
        ((0,), False), ((1,), False), ((2,), False), ((0, 1, 2), True),
    ]  # fmt: skip
    assert check.p_values[mine].min() > 0.01
    assert check.p_value > 0.01
    # the spread of the simulated values is what the fit says of its forces
    fit = check.case.fit
    spread = check.simulated[:, mine[:3]].std(axis=0)
    np.testing.assert_allclose(spread, fit.force_stderr_pN / fit.force_pN, rtol=0.5)


def test_forces_that_differ_by_a_tenth_are_the_oddest_thing(recorded):
    check, mine = looks_of(stating(recorded, 1.1))
    assert check.p_value < 1e-4
    assert int(np.argmin(check.p_values)) in mine
    assert check.observed[mine] == pytest.approx([-math.log(1.1)] * 4, abs=0.04)
    places = [one for one in located(check) if one["statistic"] == "known_force"]
    assert [one["axis"] for one in places] == ["x", "y", "z"]
    row = {"statistic": "known_force", "axis": "", "plateau": 1, "band_low_hz": math.nan}
    row |= {"time_low_s": math.nan, "value": -0.1, "simulated_median": 0.0, "p_value": 1e-6}
    row |= {"simulated_low": -0.01, "simulated_high": 0.01, "extrapolated": False}
    assert "fitted force compared with the one that [[magnet]]" in crosscheck_words.comparison(row)


def test_their_stated_error_is_allowed_for(recorded):
    check, mine = looks_of(stating(recorded, 1.1, 0.1))
    assert check.p_values[mine].min() > 0.05
    spread = check.simulated[:, mine].std(axis=0)
    np.testing.assert_allclose(spread, 0.1, rtol=0.4)  # of 26 values


def test_they_are_compared_at_their_position_only():
    known = knowing(setup(), (3.0, 4.0, 0.2), (3.04, 4.4), (5.0, "unknown"))
    assert known_force(known, 3.0) == KnownForce(4.0, 0.2)
    assert known_force(known, 3.0 + 5e-7) == KnownForce(4.0, 0.2)
    for position in (3.02, 5.0, None):
        assert known_force(known, position) is None
    near = known.plateaus.model_copy(update={"tolerance_mm": 0.05})
    assert known_force(known.model_copy(update={"plateaus": near}), 3.03) == KnownForce(4.4, 0.0)


def test_what_is_exact_and_what_is_not_used_is_said():
    known = knowing(setup(), (3.0, 4.0, 0.2), (3.5, 3.0), (9.0, 0.1), ("unknown", 0.1))
    exact, unused = known_force_notices(known, [3.0, 3.5, None])
    assert (exact.code, unused.code) == ("known_force_exact", "known_force_unused")
    assert "3.5 mm" in exact.message
    assert "force_pN_stderr" in exact.message
    assert "9 mm" in unused.message
    assert "tolerance_mm" in unused.message
    assert not known_force_notices(setup(), [3.0])


def test_they_speak_for_the_nearer_formula_and_are_silent_when_all_is_far(recorded):
    fit = case(stating(recorded)).fit
    assert known_force_nats(fit) > -0.5 * 16.3  # chi-square of three, one in a thousand
    off = replace(fit, theta=fit.theta + np.r_[[0.3] * 3, np.zeros(len(fit.theta) - 3)])
    assert known_force_nats(off) == -MOST_NATS


def test_simulations_scatter_as_much_as_stated_values_leave_open(recorded):
    """A simulation has the temperature right, which a laboratory knows to 2 %, and forces with it:
    what that error does to a force is added, and makes it err as the fit says (26 values)."""
    warm = setup(buffer={"temperature_K_stderr": 6.0, "viscosity_mPa_s_stderr": 0.05})
    check, mine = looks_of(stating(replace(recorded, setup=warm)))
    fit, exact = check.case.fit, case(recorded).fit
    stated = fit.force_stderr_pN / fit.force_pN
    assert np.all(stated > 2 * exact.force_stderr_pN / exact.force_pN)
    np.testing.assert_allclose(check.simulated[:, mine[:3]].std(axis=0), stated, rtol=0.45)


def test_where_known_forces_alone_disagree_no_effect_is_named(recorded):
    found = mtpipe.diagnose(mtpipe.subtract_drift(stating(recorded, 1.08)), seed=1).beads["b1"]
    assert (found.verdict, found.named) == ("unexplained", ())
    assert "Fitted force compared with the one that [[magnet]] states" in found.unexplained.sentence


def test_a_wrong_contour_length_is_named_and_its_forces_agree_with_known_ones(recorded):
    wrong = replace(recorded, setup=setup(tether={"contour_length_nm": 1.06 * 2700}))
    found = mtpipe.diagnose(mtpipe.subtract_drift(stating(wrong)), seed=1).beads["b1"]
    assert found.verdict == "explained"
    assert [one.name for one in found.named] == ["contour_length"]
    mine = [look.kind == "known_force" for look in found.after.statistics]
    assert found.before.p_values[mine].min() < 1e-6 < 0.01 < found.after.p_values[mine].min()
