"""A look-up table's answer to height that is a curve of its own (PHYSICS E28)."""

import dataclasses

import numpy as np
import pytest

import mtpipe
from mtpipe.effects.catalogue import OWN
from mtpipe.effects.effect import Evidence
from mtpipe.effects.z_response import smooth_curves
from mtpipe.simulation.setup_experiment import stated_experiment
from tests.test_states import SETUP, simulated

pytestmark = pytest.mark.slow

(EFFECT,) = [one for one in OWN if one.name == "z_response"]
FORCES_PN = (0.5, 1.0, 2.0, 4.0, 8.0, 3.0)


def answer(z_nm, size_nm, length_nm, phase):
    """What a table adds to a height: a smooth curve."""
    return size_nm * np.sin(z_nm / length_nm + phase)


def test_slopes_of_smooth_curves_are_their_derivatives():
    heights, step = np.array([700.0, 900.0, 950.0]), 1e-2
    near = np.concatenate([heights, heights + step])
    both = smooth_curves(near, (0,) * 6, 200.0)
    offsets, slopes = both[0::2][:, 0::2], both[0::2][:, 1::2]
    differences = (offsets[:3, 3:] - offsets[:3, :3]) / step
    np.testing.assert_allclose(slopes[:3, :3], differences, atol=2e-3)
    curvature = (offsets[3:, 3:] - offsets[3:, :3] - offsets[:3, 3:] + offsets[:3, :3]) / step**2
    np.testing.assert_allclose(both[1::2][:, 1::2][:3, :3], curvature, atol=2e-4)


def test_positions_of_the_focus_have_nothing_in_common():
    both = smooth_curves(np.array([800.0, 800.0]), (0, 1), 200.0)
    assert not both[:2, 2:].any()
    assert np.all(np.linalg.eigvalsh(both) > -1e-9)


def test_it_is_named_where_the_focus_moves_and_forces_are_those_of_x_and_y():
    truth = simulated(FORCES_PN, beads=1, seed=5, dwells_s=(30.0,) * 6)
    positions = {bead: xyz.copy() for bead, xyz in truth.positions_nm.items()}
    at = truth.plateaus[3].start - 60
    (bead,) = truth.tethered
    own = positions[bead][:, 2]
    own[:at] += answer(own[:at], 30.0, 150.0, 0.5)
    own[at:] += answer(own[at:], 40.0, 200.0, 2.0) - 90.0
    for xyz in positions.values():
        xyz[at:, 2] -= 600.0
    recording = mtpipe.subtract_drift(dataclasses.replace(truth, positions_nm=positions))
    found = mtpipe.diagnose(recording).beads[bead]
    assert [one.name for one in found.named] == ["z_response"]
    assert found.verdict == "explained"
    np.testing.assert_allclose(found.after.case.fit.force_pN, FORCES_PN, rtol=0.15)


def test_where_the_focus_stays_it_is_not_tried():
    evidence = Evidence((), FORCES_PN, focus=(0,) * 6, heights_nm=(900.0,) * 6)
    experiment, _ = stated_experiment(SETUP, FORCES_PN, 100, noise_nm=(1.0, 1.0, 2.0))
    assert not EFFECT.hypotheses(experiment, evidence)
