"""Beads at low force: equilibrium, spectra and simulation through the whole potential."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, special

from mtpipe.effects.anharmonic_tether import EFFECT
from mtpipe.effects.effect import Evidence
from mtpipe.experiment.description import (
    Allowance,
    Bead,
    Experiment,
    Fluid,
    Magnets,
    Stage,
    Tracker,
)
from mtpipe.experiment.recorded_modes import followed_modes, recorded_modes
from mtpipe.experiment.state import LOW_TILT, bead_state, expected_spectrum
from mtpipe.experiment.tethers import tethers_at
from mtpipe.experiment.whole_motion import whole_motion
from mtpipe.ground.errors import FitError
from mtpipe.physics.camera import Camera, power_spectrum
from mtpipe.physics.relaxation import modes_of_first, relaxation_matrices
from mtpipe.physics.tether import Chain, log_distance_density, mean_extension_nm
from mtpipe.simulation.bead import brownian_bead
from mtpipe.simulation.linear import _stretch, simulate_motion
from mtpipe.simulation.stepped import _from_steps, _to_steps

CAMERA = Camera(1 / 60, 1 / 120)


def experiment(contour_nm, radius_nm, **changes):
    plain = Experiment(
        chain=Chain(contour_nm, 50.0, 298.15, "marko-siggia"),
        bead=Bead(radius_nm),
        fluid=Fluid(298.15, 0.9),
        along=0,
        camera=CAMERA,
        stage=Stage(),
        tracker=Tracker(),
        rests=(),
        anharmonic=True,
    )
    return replace(plain, **changes)


def variances(state):
    return recorded_modes(state).covariance_nm2.sum(axis=0).diagonal()


def slow_power(state):
    modes = recorded_modes(state)
    return np.einsum("maa,m->a", modes.covariance_nm2, modes.tau_s)


def relaxation_modes(*of):
    covariance, rates = relaxation_matrices(*of)
    return modes_of_first(covariance, rates.sum(axis=0))


def test_a_harmonic_motion_relaxes_at_its_own_rate():
    x = special.ndtri((np.arange(4000) + 0.5) / 4000)
    weight = np.full(len(x), 1 / len(x))
    tau_s, variance = relaxation_modes(
        weight, x[None], [([0], np.ones((1, len(x))))], np.full((1, len(x)), 5.0)
    )
    assert tau_s == pytest.approx(float(weight @ x**2) / 5.0)
    assert variance == pytest.approx(float(weight @ x**2))


def test_diffusion_between_two_walls_relaxes_no_slower_than_it_does():
    """D π² for a box of width 1 (e.g. Risken 1989, section 5.4); the rest of x in faster modes."""
    x = (np.arange(4000) + 0.5) / 4000 - 0.5
    powers = (1, 3, 5)
    functions = np.array([x**n for n in powers])
    slopes = np.array([n * x ** (n - 1) for n in powers])
    weight = np.full(len(x), 1 / len(x))
    diffusivity = np.full((1, len(x)), 2.0)
    tau_s, variance = relaxation_modes(weight, functions, [([0, 1, 2], slopes)], diffusivity)
    assert 1 / tau_s[0] == pytest.approx(2 * math.pi**2, rel=1e-4)
    assert 1 / tau_s[0] > 2 * math.pi**2 * (1 - 1e-6)
    assert variance[0] == pytest.approx(8 / math.pi**4, rel=1e-3)
    assert variance.sum() == pytest.approx(1 / 12, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("contour_nm", "radius_nm", "force"),
    [(300.0, 500.0, 0.1), (1200.0, 500.0, 0.05), (2700.0, 1400.0, 0.02), (2700.0, 1400.0, 0.3)],
)
def test_equilibrium_is_that_of_a_direct_integral(contour_nm, radius_nm, force):
    """Over distance, direction and angle, the surface as a wall (PHYSICS E20)."""
    here = experiment(contour_nm, radius_nm)
    energy = here.fluid.thermal_energy_pN_nm
    r = np.linspace(0.001, 0.999, 400)[:, None, None] * contour_nm
    nodes, shares = np.polynomial.legendre.leggauss(300)
    cosine = (nodes[None, :, None] + 1) / 2
    angle = np.linspace(0.0, math.pi, 401)[None, None, :]
    log_density = log_distance_density(here.chain, 0.0, r)
    swing = force * radius_nm / energy
    log_weight = log_density + force * r * cosine / energy + swing * (np.cos(angle) - 1)
    height = r * cosine + radius_nm * (np.cos(angle) - 1)
    weight = np.where(height > 0, np.exp(log_weight - log_weight.max()), 0.0)
    weight *= shares[None, :, None]
    weight[..., [0, -1]] /= 2
    weight /= weight.sum()
    sideways = (weight * r**2 * (1 - cosine**2)).sum() / 2
    across = sideways + radius_nm**2 * float((weight * np.sin(angle) ** 2).sum())
    mean = (weight * height).sum()
    upward = (weight * (height - mean) ** 2).sum()
    state = bead_state(here, force)
    spread = math.sqrt(upward)
    assert state.extension_nm == pytest.approx(mean, abs=0.02 * spread)
    np.testing.assert_allclose(variances(state), [sideways, across, upward], rtol=0.01)


def bands(series, edges_hz):
    """Mean power in bands, one-sided, and the share it is uncertain by."""
    n = len(series)
    power = 2 * np.abs(np.fft.rfft(series - series.mean())) ** 2 * CAMERA.frame_s / n
    frequency = np.fft.rfftfreq(n, CAMERA.frame_s)
    inside = [(frequency >= low) & (frequency < high) for low, high in edges_hz]
    means = np.array([power[one].mean() for one in inside])
    return means, 1 / np.sqrt([one.sum() for one in inside]), [frequency[one] for one in inside]


TILTED = Magnets(alignment_pN_nm=400.0, sideways_per_nm=3e-4)


@pytest.mark.parametrize(
    ("here", "force"),
    [
        (experiment(600.0, 500.0), 0.08),
        (experiment(2700.0, 1400.0), 0.1),
        (experiment(1200.0, 500.0, fluid=Fluid(298.15, 0.9, wall=False)), 0.15),
        (experiment(1200.0, 500.0, bead=Bead(500.0, offset_nm=250.0)), 0.1),
        (experiment(1200.0, 500.0, magnets=TILTED), 0.15),
        (experiment(1200.0, 500.0, along=1), 0.1),
        (experiment(1200.0, 500.0, allowance=Allowance(1.2, 1.3)), 0.2),
    ],
    ids=["short", "long", "far", "beside", "tilted", "along y", "allowed"],
)
def test_spectra_are_those_of_small_steps(here, force):
    """Bands from a tenth of Hz on within 2 % beyond chance, of 84 looks 4 standard errors."""
    frames, edges = 60_000, [(0.02, 0.2), (0.2, 1.0), (1.0, 5.0), (5.0, 29.0)]
    state = bead_state(here, force)
    assert state.stepped is not None
    motion = simulate_motion([(state, frames)], CAMERA, np.random.default_rng(3))
    for axis in range(3):
        seen, share, frequencies = bands(motion[:, axis], edges)
        expected = [float(expected_spectrum(f, state, here, axis).mean()) for f in frequencies]
        off = np.log(seen / np.array(expected))
        assert np.all(np.abs(off) < 4 * share + 0.02), (axis, off, share)
    modes = recorded_modes(state)
    slow_s = float(modes.tau_s[modes.covariance_nm2[:, 2, 2] > 0].max())
    stderr = math.sqrt(2 * slow_s / (frames * CAMERA.frame_s) * variances(state)[2])
    assert abs(motion[:, 2].mean() - state.extension_nm) < 4 * stderr + 1


def test_expansions_would_not_do():
    """What the whole motion is for: at 0.1 pN z is slower and smaller than by expansion."""
    here = experiment(1200.0, 500.0)
    whole, expanded = (bead_state(e, 0.1) for e in (here, replace(here, anharmonic=False)))
    assert slow_power(expanded)[2] < 0.7 * slow_power(whole)[2]


@pytest.mark.parametrize("radius_nm", [500.0, 1400.0])
@pytest.mark.parametrize("contour_nm", [300.0, 1200.0, 7000.0])
def test_at_higher_forces_the_closed_form_is_the_whole_motion(contour_nm, radius_nm):
    """z's mean, variance (the sampling of the whole potential is good to 0.5 %) and slow power; and
    the spectrum as it is recorded, in nats of 8192 frames: 2.5 where all is faster than the camera.
    """
    here = experiment(contour_nm, radius_nm, camera=Camera(1 / 120, 1 / 240))
    frequency = np.arange(1, 4096) * 120 / 8192
    for tilt in (0.001, 0.005, 0.01, LOW_TILT[0]):
        force = force_at(here, tilt)
        state = bead_state(replace(here, anharmonic=False), force)
        assert state.stepped is None
        (tether,) = tethers_at(here.chain, [force])
        mean, tau_s, covariance = whole_motion(here, force, tether)
        of_z = covariance[:, 2, 2]
        assert state.extension_nm == pytest.approx(mean, abs=0.02 * math.sqrt(of_z.sum()))
        assert variances(state)[2] == pytest.approx(of_z.sum(), rel=0.006)
        assert slow_power(state)[2] == pytest.approx(of_z @ tau_s, rel=0.04)
        whole = power_spectrum(frequency[:, None], of_z, tau_s, here.camera).sum(axis=1)
        ratio = whole / expected_spectrum(frequency, state, here, 2)
        assert np.sum(ratio - 1 - np.log(ratio)) < (0.4 if contour_nm > 1000 else 2.5)


@pytest.mark.parametrize(("force", "missing"), [(0.4, 0.12), (2.0, 0.05)])
def test_a_simulation_is_given_what_swinging_and_length_do_to_each_other(force, missing):
    """By expansion, as it is followed, z's slow power is too small; its variance is not."""
    here = experiment(1200.0, 1400.0)
    state = bead_state(here, force)
    modes = followed_modes(state)
    of_z = modes.covariance_nm2[:, 2, 2]
    assert of_z.sum() == pytest.approx(variances(state)[2], rel=1e-3)
    assert 1 - of_z @ modes.tau_s / slow_power(state)[2] == pytest.approx(missing, abs=0.005)
    given = simulate_motion([(state, 60_000)], CAMERA, np.random.default_rng(3))
    followed, _ = _stretch(state, CAMERA, 60_000, np.random.default_rng(3), None)
    np.testing.assert_array_equal(given[:, :2], followed[:, :2])
    (more,), _, (frequency,) = bands(given[:, 2], [(0.02, 0.5)])
    (before,), _, _ = bands(followed[:, 2], [(0.02, 0.5)])
    expected = expected_spectrum(frequency, state, here, 2).mean()
    there = of_z > 0
    by_expansion = power_spectrum(frequency[:, None], of_z[there], modes.tau_s[there], CAMERA)
    assert more / before == pytest.approx(expected / by_expansion.sum(axis=1).mean(), rel=2e-3)
    assert more / before > 1.03


def force_at(here, tilt):
    energy = here.fluid.thermal_energy_pN_nm
    return optimize.brentq(
        lambda force: energy / (force * mean_extension_nm(here.chain, force)) - tilt, 0.005, 50.0
    )


@pytest.mark.slow
@pytest.mark.parametrize(("contour_nm", "radius_nm"), [(300.0, 500.0), (2700.0, 1400.0)])
def test_at_a_low_force_the_whole_motion_takes_over(contour_nm, radius_nm):
    """Smoothly, as what a force is fitted by: slow power falls with the force all the way."""
    here = experiment(contour_nm, radius_nm)
    tilt = np.geomspace(1.3 * LOW_TILT[1], LOW_TILT[0] / 1.3, 100)
    forces = np.array([force_at(here, one) for one in tilt])
    states = [bead_state(here, float(force)) for force in forces]
    assert [state.stepped is None for state in states] == (tilt <= LOW_TILT[0]).tolist()
    steps = np.diff(np.log([slow_power(state) for state in states]), axis=0)
    steps /= np.diff(np.log(forces))[:, None]
    assert np.all(steps < -1)
    assert np.all(np.abs(np.diff(steps, axis=0)) < 0.3)


@pytest.mark.parametrize("magnets", [Magnets(), TILTED])
def test_coordinates_are_the_same_in_steps_and_in_modes(magnets):
    here = experiment(1200.0, 500.0, magnets=magnets, bead=Bead(500.0, offset_nm=100.0))
    bead = brownian_bead(here, 0.1)
    position = np.array([30.0, -40.0, 500.0, 0.2, -0.1])[: 4 + (magnets is TILTED)]
    steps = _to_steps(position, bead)
    np.testing.assert_allclose(_from_steps(steps, bead, len(position)), position)
    # the tether's end is at y − aφ
    assert steps[1] + bead.radius_nm * steps[4] == pytest.approx(-40.0 - 500.0 * math.sin(0.2))


def test_a_bead_goes_on_where_it_was_when_steps_begin_and_end():
    """Positions without exposure, 0.2 ms apart, over two changes of the force."""
    here = experiment(1200.0, 500.0, camera=Camera(2e-4, 0.0))
    low, high = bead_state(here, 0.15), bead_state(here, 0.3)
    assert (low.stepped is None, high.stepped is None) == (False, True)
    random = np.random.default_rng(1)
    stretches = [(high, 50), (low, 50), (high, 50)]
    jumps, steps = [], []
    for _ in range(40):
        moved = np.diff(simulate_motion(stretches, here.camera, random), axis=0)
        jumps.append(moved[[49, 99]])
        steps.append(np.delete(moved, [49, 99], axis=0))
    allowed = 1.6 * np.concatenate(steps).std(axis=0)
    # by its swinging, which is not handed over, a bead is lower by some kT/F
    allowed[2] += here.fluid.thermal_energy_pN_nm / low.force_pN
    assert np.all(np.concatenate(jumps).std(axis=0) < allowed)


def test_the_same_seed_gives_the_same_motion():
    here = experiment(1200.0, 500.0)
    stretches = [(bead_state(here, 0.1), 200), (bead_state(here, 5.0), 200)]
    one, other = (simulate_motion(stretches, CAMERA, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_a_force_that_does_not_hold_a_harmonic_bead_up_leaves_it_on_the_surface():
    here = experiment(300.0, 500.0)
    with pytest.raises(FitError):
        bead_state(replace(here, anharmonic=False), 0.02)
    lowest, low = (bead_state(here, force) for force in (0.005, 0.02))
    assert 20 < lowest.extension_nm < low.extension_nm < 100


def test_a_bead_that_is_always_in_the_surface_has_no_state():
    """Attached far up its side, on a tether that is too short."""
    with pytest.raises(FitError, match="does not hold the bead off"):
        bead_state(experiment(300.0, 1400.0, bead=Bead(1400.0, offset_nm=1300.0)), 0.05)


def test_a_bead_that_leans_stays_what_it_is():
    leaning = experiment(1200.0, 500.0, magnets=TILTED, bead=Bead(500.0, offset_nm=100.0))
    assert bead_state(leaning, 0.1).stepped is None


def test_a_bead_that_does_not_turn_stays_what_it_is():
    """Across the field it hangs stiffly on its tether, as one that turns does at most forces."""
    stiff = experiment(1200.0, 500.0, bead=Bead(500.0, turns=False))
    assert bead_state(stiff, 0.1).stepped is None
    assert not EFFECT.hypotheses(replace(stiff, anharmonic=False), Evidence((), (0.1, 5.0)))


@pytest.mark.parametrize(
    ("contour_nm", "lowest_pN", "tried"),
    [
        (300.0, 0.84, True),
        (300.0, 0.85, False),
        (1200.0, 0.25, True),
        (1200.0, 0.26, False),
        (7000.0, 0.072, True),
        (7000.0, 0.074, False),
    ],
)
def test_it_is_tried_where_the_tether_tilts_enough(contour_nm, lowest_pN, tried):
    here = experiment(contour_nm, 500.0)
    evidence = Evidence((), (8.0, lowest_pN))
    assert bool(EFFECT.hypotheses(replace(here, anharmonic=False), evidence)) == tried
    assert not EFFECT.hypotheses(here, evidence)


def test_an_allowed_friction_of_z_slows_z_by_itself():
    """How fast the correlation of z, or x, begins to fall is exact."""
    here = experiment(1200.0, 1400.0)
    (tether,) = tethers_at(here.chain, [0.3])
    begins = []
    for allowance in (Allowance(), Allowance(upward_friction=1.25), Allowance(upward_variance=2.0)):
        _, tau_s, covariance = whole_motion(replace(here, allowance=allowance), 0.3, tether)
        begins.append(np.einsum("maa,m->a", covariance, 1 / tau_s))
    np.testing.assert_allclose(begins[1] / begins[0], [1, 1, 1 / 1.25], rtol=1e-9)
    np.testing.assert_array_equal(begins[2], begins[0])
