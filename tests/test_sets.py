"""Several causes at once, on small recordings with a fixed seed."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from mtpipe.crosschecking.check import check_bead
from mtpipe.crosschecking.prepared_bead import prepare
from mtpipe.diagnosis.explanation import Explanation
from mtpipe.diagnosis.forces_to_quote import diagnosed_forces
from mtpipe.diagnosis.mismatch import bead_content
from mtpipe.diagnosis.sets import several_causes
from mtpipe.drift import subtract_drift
from mtpipe.effects.catalogue import OWN
from tests.small_case import generator, raw

pytestmark = pytest.mark.slow

# FORMATS section 4
TERM = {
    "form", "axes", "plateaus", "sentence", "parameters", "delta_bic", "heldout_gain_nats",
    "p_before", "p_after",
}  # fmt: skip
NAMES = ("z_crosstalk", "lateral_scale", "viscosity", "axial_scale")


def changed(matrix):
    """A recording whose bead is seen through a matrix, about its mean in x and y."""
    recording = subtract_drift(raw(3))
    xyz = recording.positions_nm["b1"].copy()
    for plateau in recording.plateaus:
        rows = slice(plateau.start, plateau.stop)
        centre = np.array([*xyz[rows, :2].mean(axis=0), 0.0])
        xyz[rows] = (xyz[rows] - centre) @ np.asarray(matrix).T + centre
    return replace(recording, positions_nm=recording.positions_nm | {"b1": xyz})


def found(recording, names):
    effects = [effect for effect in OWN if effect.name in names]
    check = check_bead(prepare(recording, "b1"), generator(5), rounds=(24,))
    named = several_causes(check, check, effects, generator(6), lambda step: None)
    return check, named


@pytest.fixture(scope="module")
def seen():
    return changed([[1.0, 0.0, 0.0], [0.0, 1.25, 0.0], [0.3, 0.2, 1.0]])


def test_two_causes_are_named_together_with_their_sizes(seen):
    check, named = found(seen, NAMES)
    assert check.p_value < 1e-3
    assert {one.name for one in named} == {"z_crosstalk", "lateral_scale"}
    fit = named[-1].after.case.fit
    experiment = fit.model.described(fit.theta)
    sizes = {
        name: value for one in named for name, value, _ in one.found.effect.strengths(experiment)
    }
    # standard errors are some 0.005 for slopes and 2 % for the scale
    assert sizes["slope_x"] == pytest.approx(0.3, abs=0.03)
    assert sizes["factor_y"] == pytest.approx(1.25, rel=0.08)
    assert named[0].before is check
    assert all(a.after is b.before for a, b in itertools.pairwise(named))
    assert named[-1].after.p_value > 0.01
    assert all(one.heldout_gain > 0 for one in named)
    # nothing was fitted in their place yet, which makes no name certain
    assert all(one.probability < 0.99 for one in named)


def test_a_cause_without_a_name_is_described_by_its_form(seen):
    check, named = found(seen, ("lateral_scale", "viscosity", "axial_scale"))
    assert check.p_value < 1e-3
    assert [one.name for one in named if not one.form] == ["lateral_scale"]
    assert {one.name for one in named if one.form} == {"mixing_x_in_z", "mixing_y_in_z"}
    fit = named[-1].after.case.fit
    experiment = fit.model.described(fit.theta)
    shares = {
        one.name: {name: value for name, value, _ in one.found.effect.strengths(experiment)}
        for one in named
    }
    assert shares["mixing_x_in_z"]["share"] == pytest.approx(0.3, abs=0.03)
    told = Explanation(check, named[-1].after, tuple(named), "described", None)
    forces = diagnosed_forces(seen, {"b1": told}, seed=0)
    assert {one.source for one in forces["b1"].recommended.values()} == {"named"}
    content = bead_content(told, forces["b1"], 0.03)
    assert [one["effect"] for one in content["effects"]] == ["lateral_scale"]
    assert {one["form"] for one in content["terms"]} == {"mixing"}
    for term in content["terms"]:
        assert set(term) == TERM
        assert term["axes"][0] == "z"
        assert set(term["parameters"]) == {"share", "exponent"}
    # of y as recorded, which is 1.25 times as large
    assert shares["mixing_y_in_z"]["share"] * 1.25 == pytest.approx(0.2, abs=0.03)


def test_nothing_is_found_where_nothing_is_concealed():
    _, named = found(subtract_drift(raw(3)), NAMES)
    assert named == []
