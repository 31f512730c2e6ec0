"""Joint fits of a bead's series: limits that are exact, information, coverage, what is chosen."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import stats

import mtpipe
from mtpipe.calibration import series_choice
from mtpipe.calibration.calibration import calibrate
from mtpipe.calibration.friction_prior import viscosity_from_others
from mtpipe.calibration.series_choice import as_series_trace, choose_series
from mtpipe.fit.model import TraceModel
from mtpipe.fit.series import fit_series
from mtpipe.fit.series_model import BeadPrior, SeriesModel, SeriesTrace
from mtpipe.fit.series_posterior import sample_series
from mtpipe.fit.trace import fit_model
from mtpipe.ground.estimate import Estimate
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera
from mtpipe.physics.langevin import simulate_axis
from mtpipe.physics.modes import SINGLE_MODE, Modes
from mtpipe.physics.tether import mean_extension_nm
from mtpipe.physics.tethered_bead import friction_pN_s_per_nm, turning_modes
from mtpipe.setup.conditions import conditions_of
from mtpipe.setup.setup import parse_setup
from mtpipe.spectra.spectrum import periodogram
from tests.simulated import (
    CHAIN,
    RADIUS_NM,
    RATE_HZ,
    TEMPERATURE_K,
    VISCOSITY_MPA_S,
    bead_nm,
    recording,
    setup_content,
)

pytestmark = pytest.mark.slow

KT = float(thermal_energy_pN_nm(TEMPERATURE_K))
FRAME_S = 1 / RATE_HZ
ISSUE_FORCES = tuple(np.geomspace(0.3, 20.0, 8).tolist())
EXACT = BeadPrior((RADIUS_NM, 0.0), VISCOSITY_MPA_S, math.inf, (None, None), 0, True, False)
USUAL = replace(EXACT, radius_nm=(RADIUS_NM, 0.03 * RADIUS_NM), friction_ln_stderr=0.03)


@dataclass(frozen=True)
class World:
    """Truth of a series; along the field is x."""

    forces: tuple[float, ...] = ISSUE_FORCES
    frames: int = 8192
    noise_nm: float = 3.0
    friction: float = 1.0
    across: float = 1.0
    rotation: bool = False

    def motion(self, plateau, axis, random):
        """(frames,) positions along (0) or across (1) the field."""
        length = extension(self.forces[plateau])
        stiffness = self.forces[plateau] / (length + axis * RADIUS_NM)
        stiffness *= self.across if axis else 1.0
        friction = self.friction * nominal_friction(length)
        modes = SINGLE_MODE
        if axis == 1 and self.rotation:
            modes = single(turning_modes(length, RADIUS_NM, wall=True))
        camera = Camera(FRAME_S, FRAME_S)
        x = simulate_axis(stiffness, friction, KT, camera, self.frames, random, modes=modes)
        return x + self.noise_nm * random.normal(size=self.frames)

    def traces(self, seed, change=lambda plateau, axis, x, random: x):
        random = np.random.default_rng(seed)
        return tuple(
            trace(i, axis, extension(force), change(i, axis, self.motion(i, axis, random), random))
            for i, force in enumerate(self.forces)
            for axis in (0, 1)
        )

    def truth(self, model):
        """Coordinates of a model that shares the force."""
        known = {"ln_radius": math.log(RADIUS_NM), "ln_friction_scale": math.log(self.friction)}
        known |= {f"ln_force_{i}": math.log(force) for i, force in enumerate(self.forces)}
        return np.array([known.get(name, self.noise_nm**2) for name in model.names])


def extension(force_pN):
    return float(mean_extension_nm(CHAIN, force_pN))


def nominal_friction(length_nm):
    return float(friction_pN_s_per_nm(length_nm, RADIUS_NM, VISCOSITY_MPA_S, wall=True))


def single(modes):
    """Modes of one bead as plain numbers."""
    return Modes(
        tuple(float(np.squeeze(s)) for s in modes.shares),
        tuple(float(np.squeeze(r)) for r in modes.rates),
    )


def trace(plateau, axis, length_nm, x):
    model = TraceModel(periodogram(x, FRAME_S), FRAME_S, KT, noise_variance_nm2=None)
    return SeriesTrace(plateau, axis, length_nm, model)


def sigmas(fit):
    return np.sqrt(np.diag(fit.covariance))


# exact limits


def test_a_series_of_one_trace_is_the_fit_of_that_trace():
    (one, _) = World(forces=(1.0,)).traces(1)
    series = fit_series(SeriesModel((one,), EXACT, force_shared=True))
    alone = fit_model(one.model)
    told = series.trace_fit(one)
    sigma = np.sqrt(np.diag(alone.covariance))
    assert series.converged
    assert told.deviance == pytest.approx(alone.deviance, abs=1e-4)
    assert np.all(np.abs(told.theta - alone.theta) < 0.01 * sigma)
    assert told.stiffness.stderr == pytest.approx(alone.stiffness.stderr, rel=0.1)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_series_of_one_trace_with_known_friction_is_the_fit_with_its_prior(axis):
    """The priors differ in second order: Gaussian in the logarithm here, in the friction there."""
    one = World(forces=(6.0,)).traces(2)[axis]
    bead = replace(EXACT, friction_ln_stderr=0.01)
    for shared in (True, False):
        told = fit_series(SeriesModel((one,), bead, shared)).trace_fit(one)
        expected = nominal_friction(one.extension_nm)
        alone = fit_model(replace(one.model, friction=(expected, 0.01 * expected)))
        sigma = np.sqrt(np.diag(alone.covariance))
        assert np.all(np.abs(told.theta - alone.theta) < 0.03 * sigma)


def test_a_shared_force_is_the_weighted_mean_of_x_and_y():
    """Where nothing else is shared, and errors are Gaussian: far below Nyquist, friction exact."""
    world = World(forces=(0.1,), frames=65536)
    traces = world.traces(3)
    bead = replace(EXACT, friction_ln_stderr=1e-6)
    together = fit_series(SeriesModel(traces, bead, force_shared=True))
    ln_force, weight = [], []
    for one in traces:
        alone = fit_series(SeriesModel((one,), bead, force_shared=True))
        ln_force.append(alone.theta[0])
        weight.append(1 / alone.covariance[0, 0])
    assert abs(ln_force[0] - ln_force[1]) > 0.5 * sigmas(together)[0]
    mean = np.average(ln_force, weights=weight)
    assert together.theta[0] == pytest.approx(mean, abs=0.05 * sigmas(together)[0])
    assert together.covariance[0, 0] == pytest.approx(1 / sum(weight), rel=0.02)


@pytest.mark.parametrize(("direction", "rotation"), [("x", False), ("x", True), ("y", True)])
def test_stiffness_friction_and_modes_are_those_of_the_conditions(direction, rotation):
    effects = ["wall_drag", *["rotation_coupling"] * rotation]
    setup = setup_content(field={"direction": direction}, model={"effects": effects})
    conditions, _ = conditions_of(parse_setup(setup))
    bead = replace(USUAL, along=conditions.along, rotation=rotation)
    world = World(forces=(0.5, 4.0), frames=256)
    model = SeriesModel(world.traces(4), bead, force_shared=True)
    theta = np.tile(world.truth(model), (2, 1))
    theta[1, model.friction_scale] = math.log(1.2)
    for one in model.traces:
        lever = conditions.lever_nm(one.axis, one.extension_nm)
        friction = conditions.friction_pN_s_per_nm(one.axis, one.extension_nm)
        force = world.forces[one.plateau]
        expected = [[force / lever, friction, 9.0], [force / lever, 1.2 * friction, 9.0]]
        found = model.coordinates(theta, one)
        found[:, :2] = np.exp(found[:, :2])
        np.testing.assert_allclose(found, expected, rtol=1e-12)
        np.testing.assert_allclose(model.lever_nm(theta, one), lever, rtol=1e-12)
        modes = single(model.modes(theta[:1], one))
        other = single(conditions.modes(one.axis, one.extension_nm))
        np.testing.assert_allclose(modes.rates, other.rates, rtol=1e-12)
        np.testing.assert_allclose(modes.shares, other.shares, rtol=1e-12)
        assert len(modes.rates) == (2 if rotation and one.axis != conditions.along else 1)


# information, errors, intervals


def test_information_is_the_covariance_of_the_score():
    """Of 1500 periodograms drawn from their law; 5 sigma of every element."""
    world = World(forces=(1.0, 8.0), frames=1024, rotation=True)
    model = SeriesModel(world.traces(5), replace(USUAL, rotation=True), force_shared=True)
    truth, random = world.truth(model), np.random.default_rng(6)
    expected = [model.expected(truth[None], one)[0] for one in model.traces]
    step = 1e-3 * model.units
    shifted = np.vstack([truth + np.diag(step), truth - np.diag(step)])
    draws = 1500
    powers = [
        mean * random.gamma(one.model.ordinates, size=(draws, len(mean))) / one.model.ordinates
        for mean, one in zip(expected, model.traces, strict=True)
    ]
    score = np.zeros((draws, len(truth)))
    for power, one in zip(powers, model.traces, strict=True):
        around = model.expected(shifted, one)
        n = one.model.ordinates
        value = -(np.log(around) @ n) - (power * n) @ (1 / around).T
        score += (value[:, : len(truth)] - value[:, len(truth) :]) / (2 * step)
    prior = np.zeros((len(truth), len(truth)))
    i, j = model.names.index("ln_radius"), model.friction_scale
    prior[i, i], prior[j, j] = 0.03**-2, 0.03**-2
    root = np.linalg.cholesky(np.linalg.inv(model.information(truth) - prior))
    whitened = root.T @ np.cov(score.T) @ root
    assert np.abs(whitened - np.eye(len(truth))).max() < 5 * math.sqrt(2 / draws)


def test_errors_are_as_stated():
    """Squared errors of 40 series in units of the covariance: χ², two-sided p above 10⁻³."""
    world = World(forces=(0.6, 2.5, 8.0), frames=2048, noise_nm=8.0)
    random, distances = np.random.default_rng(7), []
    for seed in range(40):
        radius = RADIUS_NM * (1 + 0.03 * random.normal())
        own = replace(world, friction=math.exp(0.03 * random.normal()))
        bead = replace(USUAL, radius_nm=(radius, 0.03 * RADIUS_NM))
        fit = fit_series(SeriesModel(own.traces([7, seed]), bead, force_shared=True))
        assert fit.converged
        error = fit.theta - own.truth(fit.model)
        distances.append(error @ np.linalg.solve(fit.covariance, error))
    below = stats.chi2.cdf(np.sum(distances), 40 * len(fit.theta))
    assert 5e-4 < below < 1 - 5e-4


def test_posterior_covers_converges_and_is_reproducible():
    """Where truths drawn from the prior lie in 10 posteriors: χ² of 40, fails 2 times in 10³.

    The rank of a truth among the draws of its posterior is uniform, whatever the posterior's shape;
    as normal quantiles, ranks of one series are correlated as their coordinates are.
    """
    world, random = World(forces=(0.8, 5.0), frames=2048), np.random.default_rng(8)
    distances = []
    for seed in range(10):
        radius = RADIUS_NM * (1 + 0.03 * random.normal())
        own = replace(world, friction=math.exp(0.03 * random.normal()))
        bead = replace(USUAL, radius_nm=(radius, 0.03 * RADIUS_NM))
        fit = fit_series(SeriesModel(own.traces([8, seed]), bead, force_shared=True))
        posterior = sample_series(fit, seed=seed)
        assert posterior.chain.converged
        drawn, truth = posterior.chain.theta[:, :4], own.truth(fit.model)[:4]
        assert fit.model.noise(0) == 4
        rank = (np.sum(drawn < truth, axis=0) + 0.5) / (len(drawn) + 1)
        z = stats.norm.ppf(rank)
        distances.append(z @ np.linalg.solve(np.corrcoef(drawn.T), z))
        force, ln_force = posterior.force_pN(fit.model.traces[0]), drawn[:, 0]
        np.testing.assert_allclose(force, np.exp(ln_force), rtol=1e-12)
    assert 1e-3 < stats.chi2.cdf(np.sum(distances), 4 * len(distances)) < 1 - 1e-3
    again = sample_series(fit, seed=seed)
    np.testing.assert_array_equal(again.chain.theta, posterior.chain.theta)


def test_a_series_without_noise_is_sampled():
    """With noise fitted as zero, half of all proposals about the maximum would be negative."""
    world = World(forces=(1.0,), frames=1024)
    fit = fit_series(SeriesModel(world.traces(19), USUAL, force_shared=True))
    theta = fit.theta.copy()
    theta[[fit.model.noise(axis) for axis in (0, 1)]] = 0.0
    posterior = sample_series(replace(fit, theta=theta), seed=1)
    assert posterior.chain.converged
    assert posterior.chain.theta[:, -2:].min() >= 0


def test_a_force_at_four_times_nyquist_is_found():
    """Lost to a fit of its own trace; known to 5 % from the series, and right within 3 sigma."""
    world = World()
    traces = world.traces(9)
    fit = fit_series(SeriesModel(traces, USUAL, force_shared=True))
    sigma, error = sigmas(fit)[7], fit.theta[7] - math.log(20.0)
    top = fit.trace_fit(traces[-2])
    assert top.nyquist_ratio > 3.5
    assert sigma < 0.05
    assert abs(error) < 3 * sigma
    alone = fit_model(traces[-2].model)
    assert math.sqrt(alone.covariance[0, 0]) > 4 * sigma


@pytest.mark.parametrize(("friction_ln_stderr", "known_within"), [(0.03, 0.04), (math.inf, 0.2)])
def test_an_unknown_radius_is_found(friction_ln_stderr, known_within):
    """From the friction and the lever, or with unknown viscosity from the lever and the wall."""
    bead = replace(USUAL, radius_nm=(650.0, math.inf), friction_ln_stderr=friction_ln_stderr)
    fit = fit_series(SeriesModel(World().traces(10), bead, force_shared=True))
    assert fit.converged
    assert fit.radius.stderr / fit.radius.value < known_within
    assert abs(fit.radius.value - RADIUS_NM) < 3 * fit.radius.stderr


def test_a_radius_that_nothing_tells_is_not_fitted():
    bead = replace(USUAL, radius_nm=(RADIUS_NM, math.inf))
    model = SeriesModel(World(forces=(1.0,), frames=256).traces(11), bead, force_shared=False)
    assert "ln_radius" not in model.names
    assert fit_series(model).radius.status == "fixed"


# the most informed fit the data support


def choice_of(traces, bead=USUAL, *, friction_contradicted=False):
    free = [
        as_series_trace(one.plateau, one.axis, one.extension_nm, fit_model(one.model))
        for one in traces
    ]
    return choose_series(free, bead, friction_contradicted=friction_contradicted)


def told(choice):
    left_out = {(one.plateau, one.axis) for one in choice.left_out}
    return choice.fit.model.force_shared, choice.friction_expected, left_out


def test_a_true_series_is_fitted_with_all_that_is_known():
    assert told(choice_of(World().traces(12))) == (True, True, set())


def test_a_fit_that_found_no_maximum_is_not_chosen(monkeypatch):
    """Where lmfit gives up on a shared force x and y stay apart; on everything, there is no fit."""
    traces = World(forces=(0.6, 2.5), frames=2048).traces(20)

    def lost(given_up):
        def fit(model):
            found = fit_series(model)
            return replace(found, converged=found.converged and not given_up(model))

        monkeypatch.setattr(series_choice, "fit_series", fit)

    assert told(choice_of(traces)) == (True, True, set())
    lost(lambda model: model.force_shared)
    assert told(choice_of(traces)) == (False, True, set())
    lost(lambda model: math.isfinite(model.bead.friction_ln_stderr))
    assert told(choice_of(traces)) == (True, False, set())
    lost(lambda model: True)
    assert choice_of(traces) is None


def test_friction_that_the_free_fits_contradict_is_measured():
    choice = choice_of(World(friction=1.3).traces(13), friction_contradicted=True)
    scale = choice.fit.friction_scale
    assert told(choice) == (True, False, set())
    assert abs(scale.value - 1.3) < 4 * scale.stderr
    pulls = (choice.fit.theta[:8] - np.log(ISSUE_FORCES)) / sigmas(choice.fit)[:8]
    assert np.abs(pulls).max() < 4


def test_a_stiffness_across_that_does_not_fit_leaves_x_and_y_apart():
    shared, expected, left_out = told(choice_of(World(across=0.8).traces(14)))
    assert (shared, expected, left_out) == (False, True, set())


@pytest.mark.parametrize("axis", [0, 1])
def test_a_noisy_trace_is_left_out(axis):
    def noisy(plateau, its_axis, x, random):
        return x + 14.7 * random.normal(size=len(x)) * ((plateau, its_axis) == (4, axis))

    shared, expected, left_out = told(choice_of(World().traces(15, noisy)))
    assert (shared, expected, left_out) == (True, True, {(4, axis)})


def test_a_drifting_trace_is_left_out():
    def drifting(plateau, axis, x, random):
        return x + 2.0 * np.arange(len(x)) * FRAME_S * ((plateau, axis) == (6, 0))

    shared, expected, left_out = told(choice_of(World().traces(16, drifting)))
    assert (shared, expected, left_out) == (True, True, {(6, 0)})


def test_a_radius_off_by_a_tenth_leaves_forces_within_their_errors():
    """It hides in the friction's scale: no fault for the choice to find, and none in the force."""
    bead = replace(USUAL, radius_nm=(1.1 * RADIUS_NM, 0.03 * RADIUS_NM))
    choice = choice_of(World().traces(17), bead)
    pulls = (choice.fit.theta[:8] - np.log(ISSUE_FORCES)) / sigmas(choice.fit)[:8]
    assert np.abs(pulls).max() < 4


# beads recorded together


def ratio(value, stderr):
    return Estimate(value, stderr, (value - stderr, value + stderr), "", "made up")


def test_viscosity_from_other_beads_is_the_gaussian_posterior():
    """Against the joint Gaussian of viscosity and all beads' own factors, conditioned directly."""
    prior, apart = 0.1, 0.05
    values, errors = np.array([1.05, 0.98, 1.12]), np.array([0.02, 0.04, 0.01])
    others = [ratio(v, v * e) for v, e in zip(values, errors, strict=True)]
    covariance = prior**2 * np.ones((3, 3)) + np.diag(apart**2 + errors**2)
    gain = prior**2 * np.ones(3) @ np.linalg.inv(covariance)
    mean, variance = gain @ np.log(values), prior**2 - gain @ (prior**2 * np.ones(3))
    value, stderr = viscosity_from_others((0.9, 0.09), others, apart)
    assert value == pytest.approx(0.9 * math.exp(mean), rel=1e-12)
    assert stderr / value == pytest.approx(math.sqrt(variance), rel=1e-12)


def test_beads_that_contradict_the_viscosity_are_not_asked():
    others = [ratio(1.02, 0.01), ratio(2.5, 0.01)]
    stated = (0.9, 0.045)
    assert viscosity_from_others(stated, others, 0.03) == viscosity_from_others(
        stated, others[:1], 0.03
    )
    assert viscosity_from_others(stated, [], 0.03) == pytest.approx(stated)
    assert viscosity_from_others((0.9, 0.0), others, 0.03) == (0.9, 0.0)


def test_beads_recorded_together_narrow_an_uncertain_viscosity():
    forces, frames, random = (12.0,), 4096, np.random.default_rng(18)
    beads = {
        f"b{i}": np.vstack([bead_nm(force, frames, random) for force in forces]) for i in range(4)
    }
    buffer = {
        "temperature_K": TEMPERATURE_K,
        "viscosity_mPa_s": VISCOSITY_MPA_S,
        "viscosity_mPa_s_stderr": 0.2 * VISCOSITY_MPA_S,
    }
    setup = parse_setup(setup_content(buffer=buffer))
    answers = {
        n: calibrate(
            mtpipe.subtract_drift(
                recording(
                    forces,
                    frames,
                    18,
                    setup=setup,
                    beads={name: beads[name] for name in list(beads)[:n]},
                )
            )
        ).beads[0]
        for n in (1, 4)
    }
    for plateau, true in enumerate(forces):
        alone, together = (answers[n].plateaus[plateau].axes[0].force for n in (1, 4))
        assert together.stderr < 0.8 * alone.stderr
        assert abs(together.value - true) < 4 * together.stderr
