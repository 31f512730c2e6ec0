"""A bend of z's scale: expected as simulated, found where it is, and preferred only there."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mtpipe.crosschecking.check import ENOUGH
from mtpipe.diagnosis import explain
from mtpipe.diagnosis.bent_scale import BentScale, Instead, bend_beside, bend_instead
from mtpipe.diagnosis.location import LEAST_P, bent_heights
from mtpipe.experiment.changes import with_optics, with_step
from mtpipe.experiment.description import Optics
from mtpipe.joint_fit.data import whitening
from mtpipe.joint_fit.fit import fit_configured
from mtpipe.joint_fit.hypotheses import best_of
from mtpipe.joint_fit.model import ConfiguredModel
from tests.test_effects import (
    BASE,
    EVIDENCE,
    RATE_HZ,
    fitted,
    model_of,
    of_name,
    reduced,
    subtraction_of,
    traces,
    worst_disagreement,
)

pytestmark = pytest.mark.slow

MORE, FROM_NM = -0.12, 1080.0
# Heights of the four plateaus are 858, 1034, 1108 and 1142 nm, the lowest within 50 nm.
NEAR_NM = 1034.0
ANOTHER = replace(BASE, optics=Optics(axial_scale=0.97))


def bent(from_nm=FROM_NM, more=MORE):
    return with_step(BASE, BentScale(more, from_nm))


@pytest.mark.parametrize("from_nm", [FROM_NM, NEAR_NM])
def test_a_bend_is_simulated_as_expected_with_it_and_not_without(from_nm):
    """Also where it is in the middle of a plateau's motion."""
    random = np.random.default_rng(5)
    model, phi = model_of(bent(from_nm), random)
    with_it, without = worst_disagreement(model, phi, (bent(from_nm), BASE), random)
    assert with_it < 1
    assert without > 1


def test_a_bend_below_or_above_all_heights_is_a_scale_or_nothing():
    random = np.random.default_rng(6)
    model, _ = model_of(BASE, random)
    for i, force in enumerate((0.5, 2.0, 6.0, 15.0)):
        nothing = model.expected(bent(5000.0), i, force)
        same = model.expected(BASE, i, force)
        assert nothing.extension_nm == same.extension_nm
        np.testing.assert_array_equal(nothing.power, same.power)
        below = model.expected(bent(-5000.0), i, force)
        scaled = model.expected(with_optics(BASE, axial_scale=1 + MORE), i, force)
        np.testing.assert_allclose(below.power, scaled.power, rtol=1e-12)
        assert below.extension_nm == pytest.approx(scaled.extension_nm + 5000 * MORE, rel=1e-12)


@pytest.mark.parametrize("more", [MORE, 0.08])
def test_a_bend_is_found_with_its_size_and_place(more):
    """Both within 4 standard errors: one of four is not once in 4000."""
    found = bend_beside(fitted(bent(more=more), np.random.default_rng(7)))
    relative, stderr = found.bend.relative
    place = math.sqrt(found.bend.fit.covariance[-1, -1])
    assert abs(relative - more) < 4 * stderr
    assert stderr < 0.3 * abs(more)
    assert abs(found.bend.from_nm - FROM_NM) < 4 * place
    assert found.explains_most
    assert found.bend.above == (2, 3)
    assert found.p_value < 1e-10
    side = "larger" if more > 0 else "smaller"
    assert f" % {side} above {found.bend.from_nm:.0f} nm" in found.bend.words


def test_where_there_is_no_bend_none_earns_its_numbers():
    """Gains are χ²/2 of 2 numbers, from the best of 3 places: beyond 9 nats once in 2000."""
    gains = [bend_beside(fitted(BASE, np.random.default_rng(seed))) for seed in range(4)]
    assert all(one.gain < one.penalty for one in gains)
    assert not any(one.explains_most for one in gains)


@pytest.mark.parametrize(("truth", "bends"), [(bent(), True), (ANOTHER, False)])
def test_a_bend_is_likelier_where_there_is_one_and_nowhere_else(truth, bends):
    silent = fitted(truth, np.random.default_rng(8))
    named = best_of(silent, of_name("axial_scale"), EVIDENCE)
    assert named.net > 10
    found = bend_instead(silent, [named], named.fit)
    assert found.replaced == (named,)
    assert found.lead > 5 if bends else found.lead < -5


def test_of_two_effects_that_stand_in_for_a_bend_either_or_both_may_go():
    random = np.random.default_rng(9)
    positions = traces(bent(), random)
    data = reduced(positions, tuple(whitening(x, 1 / RATE_HZ) for x in positions))
    silent = fit_configured(ConfiguredModel(data, BASE, (), subtraction_of(BASE)))
    first = best_of(silent, of_name("axial_scale"), EVIDENCE)
    second = best_of(first.fit, of_name("viscosity"), EVIDENCE)
    found = bend_instead(silent, [first, second], second.fit)
    assert first in found.replaced
    assert found.lead > 5


@pytest.mark.parametrize(
    ("lead", "p_named", "p_bend", "preferred"),
    [
        (9.0, 0.15, None, True),  # beyond doubt: nothing is simulated
        (-9.0, 0.05, None, False),
        (1.0, 0.5, None, True),
        (-1.0, 0.5, None, False),  # the battery has nothing to say
        (-1.0, 0.02, 0.9, True),
        (-1.0, 0.15, 0.9, False),
        (1.0, 0.15, 0.001, False),
    ],
)
def test_likelihood_and_battery_together_speak_for_a_bend(
    monkeypatch, lead, p_named, p_bend, preferred
):
    rival = Instead(SimpleNamespace(fit=None), (), lead)
    monkeypatch.setattr(explain, "bend_instead", lambda without, named, fit: rival)
    monkeypatch.setattr(explain, "replace", lambda case, fit: case)
    simulated = np.zeros((ENOUGH, 1))
    monkeypatch.setattr(
        explain,
        "check_bead",
        lambda case, random: SimpleNamespace(p_value=case.p_bend, simulated=simulated),
    )
    case = SimpleNamespace(fit=None, p_bend=p_bend)
    check = SimpleNamespace(p_value=p_named, simulated=simulated, case=case)
    found = explain.preferred_bend(None, [], check, None)
    assert found is (rival if preferred else None)


def test_the_place_of_a_bend_is_the_heights_above_it():
    found = bend_beside(fitted(bent(), np.random.default_rng(7)))
    numbers = [SimpleNamespace(number=10 + i) for i in range(4)]
    check = SimpleNamespace(case=SimpleNamespace(plateaus=numbers))
    place = bent_heights(check, found)
    assert (place["axis"], place["plateaus"], place["statistic"]) == ("z", [12, 13], "extension")
    assert LEAST_P <= place["p_value"] == found.p_value
