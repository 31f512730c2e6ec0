"""Beads recorded together share camera, optics and buffer, and what one says binds the others."""

from __future__ import annotations

import functools
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

import mtpipe
from mtpipe.calibration.bead_results import BeadResult
from mtpipe.crosschecking.beads import bead_generator, check_of
from mtpipe.crosschecking.prepared_bead import FORMULAS
from mtpipe.diagnosis.beads_together import beads_together
from mtpipe.diagnosis.explain import explain
from mtpipe.diagnosis.forces_to_quote import bead_forces
from mtpipe.diagnosis.mismatch import Mismatch
from mtpipe.diagnosis.pooled import (
    ANOTHER,
    ASKED,
    EXCLUDED,
    UNKNOWN,
    Ballot,
    Curve,
    Outcome,
    also_in,
    common,
    pooled_penalty,
    weighed,
)
from mtpipe.diagnosis.sentence import sentence
from mtpipe.effects.catalogue import OWN
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.ground.processes import executor
from mtpipe.ground.steps import finished
from mtpipe.setup.setup import parse_setup
from mtpipe.simulation.simulate import simulate_experiment
from tests.simulated import RADIUS_NM, VISCOSITY_MPA_S, setup_content

pytestmark = pytest.mark.slow

PENALTY = 5.0
SHARED = {"exposure", "dropped_frames", "viscosity", "lateral_scale", "field_rotation"}


def curve(value, stderr=0.01, nats=PENALTY):
    """Of a bead that names the effect by itself; `nats` of 0: of one that needs it not."""
    return Curve(value, stderr, nats, PENALTY)


def naming(value, stderr=0.01, **alternatives):
    """A bead that names viscosity, and what it cannot tell from it, with their nats."""
    return Ballot({"viscosity": curve(value, stderr)}, ({"viscosity": 0.0, **alternatives},))


def without(value, stderr=0.01):
    """A bead that names nothing, with the viscosity it would have."""
    return Ballot({"viscosity": curve(value, stderr, nats=0.0)}, ())


def verdict(beads, bead="b1"):
    ballots = {f"b{i + 1}": ballot for i, ballot in enumerate(beads)}
    return weighed(ballots, bead, ballots[bead].slots[0])


def test_the_common_size_is_the_weighted_mean_and_costs_one_number():
    found = common({"b1": curve(0.10, 0.01), "b2": curve(0.13, 0.02)}, 6.0)
    assert found.beads == ("b1", "b2")
    assert found.value == pytest.approx((0.10 * 4 + 0.13) / 5)
    assert found.stderr == pytest.approx(0.01 / math.sqrt(1.25))
    # two parabolas 0.03 apart meet at ½ 0.03²/(0.01² + 0.02²)
    assert found.nats == pytest.approx(2 * PENALTY - 0.9 - 6.0)


def test_a_size_hidden_in_one_bead_costs_that_bead_a_number():
    curves = {"b1": curve(0.10), "b2": curve(0.10), "b3": curve(0.30)}
    found = common(curves, 6.0)
    assert found.beads == ("b1", "b2")
    assert found.value == pytest.approx(0.10)
    assert found.nats == pytest.approx(2 * PENALTY + (PENALTY - PENALTY) - 6.0)
    agreed = common(curves, 6.0, all_of=list(curves))
    assert agreed.value == pytest.approx(0.5 / 3)
    assert agreed.nats == pytest.approx(
        3 * PENALTY - 6.0 - 0.5 * 1e4 * (2 * (0.2 / 3) ** 2 + (0.4 / 3) ** 2)
    )


def test_a_pooled_number_costs_half_the_logarithm_of_all_ordinates():
    assert pooled_penalty([PENALTY]) == pytest.approx(PENALTY)
    each = [0.5 * math.log(n) for n in (1000, 3000)]
    assert pooled_penalty(each) == pytest.approx(0.5 * math.log(4000))


def test_what_several_beads_have_alike_is_shared():
    beads = [naming(0.10, bead_radius=1.0), naming(0.11, bead_radius=0.5), naming(0.09)]
    found = verdict(beads)
    assert found.left == ("viscosity",)
    assert found.others.beads == ("b2", "b3")
    assert found.others.value == pytest.approx(0.10)
    assert found.others.stderr == pytest.approx(0.01 / math.sqrt(2))
    # also in a bead that named the other by itself
    private = Ballot({"viscosity": curve(0.1, nats=PENALTY - 2)},
                     ({"bead_radius": 0.0, "viscosity": -2.0},))  # fmt: skip
    assert verdict([private, *beads]).left == ("viscosity",)


def test_what_one_bead_has_alone_is_its_own():
    beads = [naming(0.10, bead_radius=-2.0), without(0.0), without(0.0)]
    assert verdict(beads) == Outcome(("bead_radius",))


def test_beads_that_cannot_tell_change_nothing():
    found = verdict([naming(0.10, bead_radius=-1.0), without(0.0, 1.0), without(0.2, 1.0)])
    assert set(found.left) == {"viscosity", "bead_radius"}
    assert found.others is None


@pytest.mark.parametrize(("margin", "left"), [(-0.1, ("viscosity",)), (0.1, ())])
def test_a_bead_that_has_it_not_excludes_it_by_a_penalty_and_three_nats(margin, left):
    """½ ln 2 less, for the number is fitted to two beads."""
    distance = PENALTY + 3 - 0.5 * math.log(2) + margin
    value = math.sqrt(2 * distance * 2 * 0.01**2)
    assert verdict([naming(value), without(0.0)]).left == left


def test_two_beads_that_contradict_each_other_are_both_unexplained():
    beads = [naming(0.10), naming(0.30)]
    assert verdict(beads, "b1").left == verdict(beads, "b2").left == ()


def test_a_bead_that_differs_from_what_the_others_share_has_a_cause_of_its_own_beside():
    beads = [naming(0.10), naming(0.10), naming(0.10), naming(0.30)]
    odd, usual = verdict(beads, "b4"), verdict(beads, "b1")
    assert (odd.left, odd.beside) == (("viscosity",), True)
    assert odd.others.value == pytest.approx(0.10)
    assert odd.others.beads == ("b1", "b2", "b3")
    assert (usual.left, usual.beside, usual.others.beads) == (("viscosity",), False, ("b2", "b3"))


def test_what_others_share_is_also_in_a_bead_that_did_without_unless_that_hides_it():
    ballots = {"b1": naming(0.10), "b2": naming(0.12), "b3": without(0.09), "b4": without(0.0)}
    found = also_in(ballots, "b3", "viscosity")
    assert (found.left, found.beside, found.others.beads) == (("viscosity",), True, ("b1", "b2"))
    assert found.others.value == pytest.approx(0.11)
    # ten standard errors away; and one that has said so by itself
    assert also_in(ballots, "b4", "viscosity") is None
    assert also_in(ballots, "b1", "viscosity") is None


def test_two_shared_effects_that_all_beads_have_alike_stay_alike():
    slot = {"exposure": 0.0, "dropped_frames": -1.0, "tracking_noise": 0.5}
    one = Ballot({"exposure": curve(0.2), "dropped_frames": curve(0.1, nats=PENALTY - 1)}, (slot,))
    assert verdict([one, one]).left == ("exposure", "dropped_frames")


def test_what_a_bead_says_of_a_size():
    clear = curve(0.10)
    assert clear.says(0.11) == ASKED
    assert clear.says(0.30) == ANOTHER
    assert clear.says(-0.3) == ANOTHER
    assert curve(0.0).says(0.10) == EXCLUDED
    assert curve(0.0, stderr=0.1).says(0.10) == UNKNOWN


# Recordings: a buffer thicker than stated, in which b3 is a larger bead as well; and one larger
# bead in the right buffer.
FORCES_PN, FRAMES = (0.8, 3.0, 10.0), 3072
SETUP = parse_setup(
    setup_content(model={"effects": ["wall_drag", "rotation_coupling", "tracking_noise"]})
)
MORE = 1.12
BUFFER = {"b1": (MORE, 1.0), "b2": (MORE, 1.0), "b3": (MORE, MORE)}
BEAD = {"b1": (1.0, MORE), "b2": (1.0, 1.0)}


@functools.cache
def recording(kind):
    changes, seed = {"buffer": (BUFFER, 4), "bead": (BEAD, 3)}[kind]
    experiment, _ = experiment_of(SETUP, FORCES_PN, FRAMES, formula=FORMULAS[0], beads=len(changes))
    positions = {}
    for bead, (thicker, larger) in changes.items():
        fluid = replace(experiment.fluid, viscosity_mPa_s=thicker * VISCOSITY_MPA_S)
        size = replace(experiment.bead, radius_nm=larger * RADIUS_NM)
        # one seed: stage and reference are the same, the bead is this one
        made = simulate_experiment(replace(experiment, fluid=fluid, bead=size), SETUP, seed)
        positions |= {name: made.positions_nm[name] for name in (bead, "ref1")}
    return mtpipe.subtract_drift(replace(made, positions_nm=positions))


@functools.cache
def alone(kind, bead):
    """A bead as it is explained by itself."""
    random = bead_generator(0, bead)
    return explain(check_of(recording(kind), bead, random), random)


def together(found):
    with executor(1) as pool:
        return finished(beads_together(found, pool, seed=0))


@functools.cache
def thick_buffer():
    return together({bead: alone("buffer", bead) for bead in BUFFER})


def names(found):
    return [one.name for one in found.named]


def test_effects_say_whether_they_are_shared():
    assert {effect.name for effect in OWN if effect.shared} == SHARED


def test_beads_that_cannot_tell_buffer_from_bead_can_do_so_together():
    (by_itself,) = alone("buffer", "b1").named
    assert {by_itself.name, *by_itself.equivalent} == {"viscosity", "bead_radius"}
    for bead in ("b1", "b2"):
        found = thick_buffer()[bead]
        assert (found.verdict, names(found)) == ("explained", ["viscosity"])
        (named,) = found.named
        assert named.equivalent == ()
        assert named.others == (
            "All beads share this: of 2 other beads 1 has it too, 1 has another size."
        )
        assert named.others in sentence(found, named)
        assert named.after is found.after
        assert found.before is alone("buffer", bead).before
        assert found.after.p_value > 0.004


def strength(bead, effect, name):
    found = {bead: thick_buffer()[bead]}
    forces = {bead: bead_forces(BeadResult(bead, (), 0.0, None, False), found[bead])}
    row = Mismatch("r", found, forces, 0.03, {}).as_dict()["beads"][bead]
    (found,) = (one["parameters"][name] for one in row["effects"] if one["effect"] == effect)
    return found["value"], found["stderr"]


def test_sizes_and_forces_profit_from_what_the_other_beads_know():
    for bead in ("b1", "b2"):
        value, stderr = strength(bead, "viscosity", "viscosity_mPa_s")
        assert abs(value - MORE * VISCOSITY_MPA_S) < 3 * stderr
        by_itself, found = alone("buffer", bead), thick_buffer()[bead]
        known = np.sqrt(by_itself.fit.covariance[-1, -1]) * VISCOSITY_MPA_S * MORE
        assert stderr < 0.8 * known
        assert all(found.fit.force_stderr_pN < by_itself.fit.force_stderr_pN)
        for force, error, truth in zip(
            found.fit.force_pN, found.force_stderr_pN, FORCES_PN, strict=True
        ):
            assert abs(force - truth) < 4 * error


def test_a_bead_that_is_larger_in_the_same_buffer_has_both():
    """By itself it says that the buffer is all there is, and thicker than for the others."""
    by_itself = alone("buffer", "b3")
    assert names(by_itself) == ["viscosity"]
    assert by_itself.verdict == "explained"
    found = thick_buffer()["b3"]
    assert (found.verdict, names(found)) == ("explained", ["viscosity", "bead_radius"])
    assert found.named[0].others == (
        "All beads share this; its size is taken from the others; this bead has a further cause "
        "of its own."
    )
    value, stderr = strength("b3", "viscosity", "viscosity_mPa_s")
    assert abs(value - MORE * VISCOSITY_MPA_S) < 3 * stderr
    value, stderr = strength("b3", "bead_radius", "radius_nm")
    assert abs(value - MORE * RADIUS_NM) < 3 * stderr < 0.1 * RADIUS_NM
    assert by_itself.fit.theta[-1] > math.log(MORE) + 0.05


def test_a_bead_that_is_larger_alone_is_not_in_a_thicker_buffer():
    both = {bead: alone("bead", bead) for bead in ("b1", "b2")}
    assert names(both["b1"]) == ["bead_radius"]
    assert both["b1"].named[0].equivalent == ("viscosity",)
    found = together(both)
    assert names(found["b1"]) == ["bead_radius"]
    (named,) = found["b1"].named
    assert named.equivalent == ()
    assert named.others.startswith("It is not viscosity, which all beads would share: of 1 other")
    assert found["b1"].after is both["b1"].after
    assert found["b2"] is both["b2"]


def as_named(kind, bead, *, with_alternative):
    """The bead as if it had named viscosity, its radius an alternative or none."""
    found = alone(kind, bead)
    (named,) = found.named
    (other,) = named.alternatives
    back = (replace(other, found=named.found, nats=-other.nats),) if with_alternative else ()
    after = replace(found.after, case=replace(found.after.case, fit=other.found.fit))
    swapped = replace(named, found=other.found, alternatives=back, after=after)
    return replace(found, named=(swapped,), after=after)


def test_what_the_other_beads_exclude_gives_way_to_the_alternative():
    swapped = as_named("bead", "b1", with_alternative=True)
    found = together({"b1": swapped, "b2": alone("bead", "b2")})["b1"]
    assert (found.verdict, names(found)) == ("explained", ["bead_radius"])
    assert found.named[0].heldout_gain > 0
    assert found.after.p_value > 0.004
    assert found.after is not swapped.after
    assert all(abs(found.fit.force_pN / alone("bead", "b1").fit.force_pN - 1) < 1e-3)


def test_what_the_other_beads_exclude_is_unexplained_without_an_alternative():
    swapped = as_named("bead", "b1", with_alternative=False)
    found = together({"b1": swapped, "b2": alone("bead", "b2")})["b1"]
    assert (found.verdict, found.named) == ("unexplained", ())
    assert found.after is found.before
    assert found.nearest.tried.effect.name == "viscosity"
    assert "but all beads would share it: of 1 other bead 1 excludes it" in found.nearest.reason
    assert "Nearest, but not named, is viscosity: it gains" in found.unexplained.sentence


def test_a_bead_that_is_unexplained_has_no_say_and_stays():
    odd = replace(alone("bead", "b2"), verdict="unexplained")
    both = {"b1": alone("bead", "b1"), "b2": odd}
    assert together(both) == both


def test_one_bead_alone_stays_as_it_is():
    both = {"b1": alone("buffer", "b1")}
    assert together(both) == both


def test_explanations_can_be_sent_to_other_processes():
    found = alone("buffer", "b1")
    sent = pickle.loads(pickle.dumps(found))
    assert names(sent) == names(found)
    assert sent.named[0].found.effect == found.named[0].found.effect
    assert all(sent.fit.force_pN == found.fit.force_pN)
