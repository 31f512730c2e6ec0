"""Hydrodynamic memory: decays beside the closed form and a bead that drags masses of fluid."""

import math

import numpy as np
import pytest
from scipy import linalg

from mtpipe.effects.effect import Evidence
from mtpipe.effects.hydrodynamic_memory import EFFECT
from mtpipe.experiment.description import Bead, Experiment, Fluid, Magnets, Stage, Tracker
from mtpipe.experiment.recorded_modes import recorded_modes
from mtpipe.experiment.state import bead_state
from mtpipe.physics.camera import Camera, power_spectrum
from mtpipe.physics.memory import memory_time_s, power_with_memory, remembering
from mtpipe.physics.tether import Chain
from mtpipe.simulation.linear import simulate_motion

RATIOS = (0.002, 0.01, 0.03, 0.1, 0.2)
PLAIN = Magnets()


def experiment(rate_hz, radius_nm, share, *, turns=True, magnets=PLAIN, contour_nm=2700.0):
    return Experiment(
        chain=Chain(contour_nm, 50.0, 298.15, "marko-siggia"),
        bead=Bead(radius_nm, turns=turns),
        fluid=Fluid(298.15, 0.9, memory=share),
        along=0,
        camera=Camera(1 / rate_hz, 0.5 / rate_hz),
        stage=Stage(),
        tracker=Tracker(),
        rests=(),
        magnets=magnets,
    )


def power(omega, tau_s, variance):
    return (4 * tau_s / (1 + (omega[:, None] * tau_s) ** 2)) @ variance


@pytest.mark.parametrize("ratio", RATIOS)
def test_decays_have_the_power_of_the_closed_form(ratio):
    """4 t Re G/|1 − iωt G|² with G = 1 + √(−iωτ) for a motion of one relaxation time t."""
    tau_s, variance = remembering(np.ones(1), np.ones(1), ratio**2)
    omega = np.geomspace(1e-4, 5e3, 3000)
    slowed = 1 + np.sqrt(-1j * omega) * ratio
    exact = 4 * slowed.real / np.abs(1 - 1j * omega * slowed) ** 2
    np.testing.assert_allclose(
        power_with_memory(omega, np.ones(1), np.ones(1), ratio**2), exact, rtol=1e-9
    )
    np.testing.assert_allclose(power(omega, tau_s, variance), exact, rtol=0.05 * ratio)
    assert variance.sum() == pytest.approx(1, abs=1e-6)
    assert variance @ tau_s == pytest.approx(1, abs=1e-6)


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
    tau_s, variance = remembering(np.ones(1), np.ones(1), ratio**2)
    times = np.array([0.03, 0.1, 0.3, 1.0, 3.0])
    # equilibrium: ⟨x²⟩ = 1, and x knows nothing of the velocities
    covariance = np.array([linalg.expm(drift * time)[0, 0] for time in times])
    found = np.exp(-np.outer(times, 1 / tau_s)) @ variance
    np.testing.assert_allclose(found, covariance, atol=0.03 * ratio)
    assert np.abs(np.exp(-times) - covariance).max() > 0.2 * ratio


@pytest.mark.parametrize("radius_nm", [500.0, 1400.0])
@pytest.mark.parametrize("magnets", [PLAIN, Magnets(alignment_pN_nm=1e4)])
def test_a_bead_that_turns_remembers_as_its_translation_does(radius_nm, magnets):
    """x and y beside (K + sΓ + s√(sτ)Γ_t)⁻¹, Γ_t without the angles: these leave no memory of
    this order (Landau & Lifshitz, Fluid Mechanics, section 24).
    """
    here = experiment(4000.0, radius_nm, 0.8, magnets=magnets, contour_nm=1000.0)
    state, energy = bead_state(here, 10.0), here.fluid.thermal_energy_pN_nm
    friction, stiffness = state.motion.friction, state.motion.stiffness
    translation = np.diag(np.where(np.arange(len(friction)) < 3, np.diag(friction), 0.0))
    modes = recorded_modes(state)
    omega = 2 * np.pi * np.array([3.0, 30.0, 300.0, 1000.0, 3000.0])
    for axis in (0, 1):
        readout = state.motion.readout[axis]
        exact = []
        for one in omega:
            s = -1j * one
            dynamic = stiffness + s * friction + s * np.sqrt(s * state.memory_s) * translation
            exact.append(4 * energy / one * (readout @ np.linalg.solve(dynamic, readout)).imag)
        found = power(omega, modes.tau_s, modes.covariance_nm2[:, axis, axis])
        np.testing.assert_allclose(found, exact, rtol=3e-3)


def test_recorded_spectra_are_as_expected():
    """Of 40 recordings, in bands; x, y and z within 2 % beyond 4 standard errors."""
    here = experiment(4000.0, 1400.0, 1.0)
    state, random, frames = bead_state(here, 8.0), np.random.default_rng(2), 8192
    frequency = np.fft.rfftfreq(frames, here.camera.frame_s)[1:]
    seen = np.zeros((len(frequency), 3))
    for _ in range(40):
        motion = simulate_motion([(state, frames)], here.camera, random)
        content = np.fft.rfft(motion - motion.mean(axis=0), axis=0)[1:]
        seen += 2 * here.camera.frame_s / frames * np.abs(content) ** 2 / 40
    modes = recorded_modes(state)
    for axis in range(3):
        variance = modes.covariance_nm2[:, axis, axis]
        parts = power_spectrum(frequency[:, None], variance, modes.tau_s, here.camera)
        ratio = seen[:, axis] / parts.sum(axis=1)
        for band in np.array_split(np.arange(20, len(frequency)), 4):
            stderr = 1 / math.sqrt(40 * len(band))
            assert abs(ratio[band].mean() - 1) < 4 * stderr + 0.02


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
