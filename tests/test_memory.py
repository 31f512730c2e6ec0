"""Hydrodynamic memory: decays beside the closed form and a bead that drags masses of fluid."""

import math

import numpy as np
import pytest
from scipy import linalg

from mtpipe.effects.effect import Evidence
from mtpipe.effects.hydrodynamic_memory import EFFECT
from mtpipe.experiment.description import Bead, Experiment, Fluid, Stage, Tracker
from mtpipe.experiment.state import bead_state, recorded_modes
from mtpipe.physics.camera import Camera
from mtpipe.physics.memory import decays, memory_time_s, power_with_memory
from mtpipe.physics.tether import Chain

RATIOS = (0.002, 0.01, 0.03, 0.1, 0.2)


def experiment(rate_hz, radius_nm, share):
    return Experiment(
        chain=Chain(2700.0, 50.0, 298.15, "marko-siggia"),
        bead=Bead(radius_nm, turns=False),
        fluid=Fluid(298.15, 0.9, wall=False, memory=share),
        along=0,
        camera=Camera(1 / rate_hz, 0.0),
        stage=Stage(),
        tracker=Tracker(),
        rests=(),
    )


@pytest.mark.parametrize("ratio", RATIOS)
def test_decays_have_the_power_of_the_closed_form(ratio):
    rate, share = decays(ratio)
    frequency = np.geomspace(1e-4, 5e3, 3000)
    power = (rate / (rate**2 + frequency[:, None] ** 2)) @ share
    np.testing.assert_allclose(power, power_with_memory(frequency, ratio), rtol=0.05 * ratio)
    assert share.sum() == pytest.approx(1, abs=1e-6)
    assert (share / rate).sum() == pytest.approx(1, abs=1e-6)


def test_without_memory_there_is_one_decay():
    rate, share = decays(0.0)
    np.testing.assert_allclose(share, rate == 1, atol=1e-7)


@pytest.mark.parametrize("ratio", [0.03, 0.2])
def test_decays_are_the_covariance_of_a_bead_that_drags_masses_of_fluid(ratio):
    """√s as (2/π) ∫ s/(s + q²) dq: each share of it a mass that a dashpot ties to the bead.

    Position and velocities of the masses are a linear system of first order, whose covariance over
    time is a matrix exponential. Units: kT = k = γ = 1.
    """
    q = np.geomspace(1e-3, 1e4, 300)
    dashpot = ratio * 2 / math.pi * np.gradient(q)
    mass = dashpot / q**2
    friction = 1 + dashpot.sum()
    # the bead's velocity is (−x + Σ dashpot w)/friction; of each mass m w' = dashpot (v − w)
    pull = np.append(-1.0, dashpot) / friction
    drift = np.zeros((len(q) + 1, len(q) + 1))
    drift[0] = pull
    drift[1:] = (dashpot / mass)[:, None] * pull
    drift[1:, 1:] -= np.diag(dashpot / mass)
    # in units of its thermal size each coordinate is as large as any other
    size = np.append(1.0, np.sqrt(1 / mass))
    drift = drift * size / size[:, None]
    rate, share = decays(ratio)
    times = np.array([0.03, 0.1, 0.3, 1.0, 3.0])
    # equilibrium: ⟨x²⟩ = 1, and x knows nothing of the velocities
    covariance = np.array([linalg.expm(drift * time)[0, 0] for time in times])
    found = np.exp(-np.outer(times, rate)) @ share
    np.testing.assert_allclose(found, covariance, atol=0.03 * ratio)
    assert np.abs(np.exp(-times) - covariance).max() > 0.2 * ratio


def test_time_of_memory():
    """Corner of memory η/(πR²ρ) = 162 kHz for 1.4 µm in water of 1 mPa s (PHYSICS E22)."""
    assert 1 / (math.pi * memory_time_s(1400.0, 1.0)) == pytest.approx(162.4e3, rel=1e-3)


def test_equilibrium_and_slow_power_are_as_without():
    with_it, without = (bead_state(experiment(4000.0, 500.0, s), 5.0) for s in (1.0, 0.0))
    both = [recorded_modes(state) for state in (with_it, without)]
    variances, slow = zip(
        *[
            (one.covariance_nm2.sum(axis=0), np.einsum("mab,m->ab", one.covariance_nm2, one.tau_s))
            for one in both
        ],
        strict=True,
    )
    np.testing.assert_allclose(*variances, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(*slow, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize(
    ("rate_hz", "radius_nm", "tried"),
    [(120.0, 1400.0, False), (400.0, 1400.0, False), (1000.0, 1400.0, True),
     (1000.0, 500.0, False), (10_000.0, 500.0, True)],
)  # fmt: skip
def test_it_is_tried_where_the_camera_is_fast_enough(rate_hz, radius_nm, tried):
    evidence = Evidence((), (1.0, 10.0))
    silent = experiment(rate_hz, radius_nm, 0.0)
    assert bool(EFFECT.hypotheses(silent, evidence)) == tried
    assert not EFFECT.hypotheses(experiment(rate_hz, radius_nm, 0.5), evidence)
