"""Causes looked for in some of a bead's plateaus, and tried in all of them."""

from dataclasses import replace

import numpy as np
import pytest

from mtpipe.crosschecking.check import check_bead
from mtpipe.crosschecking.prepared_bead import prepare
from mtpipe.diagnosis import excerpt
from mtpipe.diagnosis.mismatch import diagnose
from mtpipe.drift import subtract_drift
from mtpipe.simulation.setup_experiment import stated_experiment
from mtpipe.simulation.simulate import simulate_experiment
from tests.curved_table import stepped, with_table
from tests.small_case import NOISE_NM, generator, setup

FORCES_PN = (5.0, 4.8, 5.2, 1.5, 0.5)
FRAMES = 2048


def scaled(factors):
    """A recording with y as many times too large in each plateau."""
    experiment, _ = stated_experiment(setup(), FORCES_PN, FRAMES, noise_nm=NOISE_NM)
    recording = subtract_drift(simulate_experiment(experiment, setup(), 3))
    xyz = recording.positions_nm["b1"].copy()
    for plateau, factor in zip(recording.plateaus, factors, strict=True):
        rows = slice(plateau.start, plateau.stop)
        centre = xyz[rows, 1].mean()
        xyz[rows, 1] = (xyz[rows, 1] - centre) * factor + centre
    return replace(recording, positions_nm=recording.positions_nm | {"b1": xyz})


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(excerpt, "MOST_PLATEAUS", 3)


def test_an_excerpt_spans_the_forces(few):
    recording = scaled([1.0] * 5)
    check = check_bead(prepare(recording, "b1"), generator(5), rounds=(8,))
    looked_at = prepare(excerpt.excerpt(recording, check), "b1").plateaus
    forces = np.asarray(FORCES_PN)[[one.number for one in looked_at]]
    assert len(forces) == 3
    assert forces[0] > 4
    assert list(forces[1:]) == [1.5, 0.5]


def test_few_plateaus_are_all_looked_at():
    recording = scaled([1.0] * 5)
    check = check_bead(prepare(recording, "b1"), generator(5), rounds=(8,))
    assert excerpt.excerpt(recording, check) is None


@pytest.mark.slow
def test_a_cause_found_in_some_plateaus_is_fitted_to_all(few):
    found = diagnose(scaled([1.25] * 5)).beads["b1"]
    assert found.verdict == "explained"
    assert [one.name for one in found.named] == ["lateral_scale"]
    assert len(found.fit.force_pN) == 5
    np.testing.assert_allclose(found.fit.force_pN, FORCES_PN, rtol=0.15)
    (named,) = found.named
    assert named.probability > 0.5
    assert len(found.force_stderr_pN) == 5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "names"), [(1.25, {"z_response", "lateral_scale"}), (1.0, {"z_response"})]
)
def test_a_curve_seen_beside_the_causes_of_an_excerpt_is_undone_in_all_plateaus(few, factor, names):
    found = diagnose(with_table(scaled([factor] * 5), 4, stepped, 1.5)).beads["b1"]
    assert {one.name for one in found.named} == names
    assert found.verdict == "explained"
    assert len(found.fit.force_pN) == 5


@pytest.mark.slow
def test_what_is_not_so_in_all_plateaus_is_not_named(few):
    found = diagnose(scaled([1.0, 1.25, 1.0, 1.25, 1.25])).beads["b1"]
    assert found.verdict == "unexplained"
    assert found.named == ()
    assert len(found.fit.force_pN) == 5
    assert found.unexplained.sentence
