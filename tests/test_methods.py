"""The methods by name: exact expectations, exact covariances, the paper's biases, recovery."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import linalg, optimize

import mtpipe
from mtpipe.ground.errors import FitError
from mtpipe.methods import METHODS, MethodFit, fit_by_method
from mtpipe.methods.integrated_spectrum import Correction, fit_spectrum
from mtpipe.methods.motion import SeenMotion
from mtpipe.methods.quadratic import Stencil, statistics_of
from mtpipe.methods.variances import allan_statistics, equipartition_statistics, hadamard_statistics
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera, blur_factor, power_spectrum
from mtpipe.physics.langevin import simulate_axis, simulate_mode

RATE, TEMPERATURE, FRICTION = 120.0, 298.15, 2.3e-5
FRAME = 1 / RATE
KT = float(thermal_energy_pN_nm(TEMPERATURE))
BY_VARIANCE = ("equipartition", "allan", "hadamard")


def stiffness_at(nyquist_ratio):
    return 2 * math.pi * nyquist_ratio * RATE / 2 * FRICTION


def simulate(nyquist_ratio, random, *, share=1.0, frames=4096, noise_nm=0.0):
    camera = Camera(FRAME, share * FRAME)
    x = simulate_axis(stiffness_at(nyquist_ratio), FRICTION, KT, camera, frames, random)
    return x + noise_nm * random.normal(size=frames)


def fit(method, x, share=1.0, **options):
    return fit_by_method(
        method, x, frame_rate_hz=RATE, exposure_s=share / RATE, temperature_K=TEMPERATURE, **options
    )


def motions():
    for tau in (0.01, 0.3, 2.0, 40.0):
        for share in (0.0, 0.5, 1.0):
            for noise in (0.0, 3.0):
                yield SeenMotion(50.0, tau * FRAME, Camera(FRAME, share * FRAME), noise)


def covariance_matrix(motion, frames):
    return linalg.toeplitz(motion.lag_covariance(np.arange(frames)))


# --- expectations ---------------------------------------------------------------------------------


def test_variance_of_means_is_the_average_of_all_covariances():
    for motion in motions():
        for m in (1, 2, 3, 7, 60):
            brute = covariance_matrix(motion, m).mean()
            assert motion.mean_variance(m) == pytest.approx(brute, rel=1e-12)


def test_whole_frame_exposure_is_lansdorp_and_saleh_2012_equation_17():
    for tau in (1e-3, 0.1, 5.0):  # their form cancels where the relaxation is slow, as (τ/t)³
        t = FRAME * np.array([1.0, 2, 8, 64, 1024])
        ratio = tau / t
        printed = (
            2
            * 50.0
            * ratio
            * (1 + 2 * ratio * np.exp(-1 / ratio) - ratio / 2 * np.exp(-2 / ratio) - 1.5 * ratio)
        )
        allan = SeenMotion(50.0, tau, Camera(FRAME, FRAME)).allan_variance(t / FRAME)
        assert allan == pytest.approx(printed, rel=1e-6)


def test_slow_and_fast_limits_of_the_allan_variance():
    """Free diffusion, 2 kT t/(3γ), long before the relaxation; 2 kT γ/(k² t) long after it."""
    variance, slow, fast = 50.0, 1e4, 1e-4
    t = 8 * FRAME
    free = SeenMotion(variance, slow, Camera(FRAME, FRAME)).allan_variance(8)
    assert free == pytest.approx(2 * variance / slow * t / 3, rel=1e-4)
    settled = SeenMotion(variance, fast, Camera(FRAME, FRAME)).allan_variance(8)
    assert settled == pytest.approx(2 * variance * fast / t, rel=5e-3)


def test_white_noise_is_divided_by_the_frames():
    still = SeenMotion(1e-12, 1.0, Camera(FRAME, FRAME), 9.0)
    m = np.array([1.0, 4, 64])
    assert still.allan_variance(m) == pytest.approx(9 / m)
    assert still.hadamard_variance(m) == pytest.approx(9 / m)


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize(
    "statistics",
    [allan_statistics, hadamard_statistics, lambda x: equipartition_statistics(x, (1, 2, 4))],
    ids=["allan", "hadamard", "equipartition"],
)
def test_expectation_and_covariance_are_those_of_the_quadratic_forms(statistics, gaps):
    """Against dense matrices: E x'Bx = tr BC and cov = 2 tr B C B' C, which no code here forms."""
    frames, random = 96, np.random.default_rng(5)
    x = random.normal(size=frames)
    if gaps:
        x[random.random(frames) < 0.15] = np.nan
        x[60:68] = np.nan
    measured = statistics(x)
    forms = dense_forms(measured, x)
    for motion in motions():
        C = covariance_matrix(motion, frames)
        products = [form @ C for form in forms]
        expected = [np.trace(product) for product in products]
        assert measured.expected(motion) == pytest.approx(expected, rel=1e-8)
        exact = np.array([[2 * np.sum(a * b.T) for b in products] for a in products])
        # the largest means have few degrees of freedom, and nothing depends on their weights
        found, exact = measured.covariance(motion)[:4, :4], exact[:4, :4]
        size = np.sqrt(np.diag(exact))
        error = np.max(np.abs(found - exact) / np.outer(size, size))
        # lags are summed in steps; with gaps 8 probes scatter
        tolerance = 0.7 if gaps else 0.02
        assert error < tolerance


def dense_forms(measured, x):
    """B of each statistic: its polarisation on unit vectors, (frames, frames)."""
    present = np.isfinite(x)
    if measured.gaps is not None:
        columns = np.eye(len(x))
        return [
            np.array([measured.gaps.applied(t, column) for column in columns])
            for t in measured.gaps.transfer
        ]
    centre = np.eye(len(x)) - np.outer(present, present) / present.sum()
    forms = []
    for stencil in measured.stencils:
        series = np.vstack([np.zeros(len(x)), np.cumsum(centre, axis=0)])
        rows = stencil.applied(series if measured.on_sums else centre)
        forms.append(rows.T @ rows / len(rows))
    return forms


def test_gap_rule_without_gaps_is_the_structure_function_of_all_pairs():
    """A lost frame at the end changes nothing but the end: both rules agree there."""
    x = np.cumsum(np.random.default_rng(3).normal(size=400))
    stencil = (Stencil((0, 3), (-1.0, 1.0)),)
    complete = statistics_of(x, stencil, lambda motion: np.zeros(1), on_sums=False)
    with_gap = statistics_of(
        np.append(x, np.nan), stencil, lambda motion: np.zeros(1), on_sums=False
    )
    assert with_gap.values == pytest.approx(complete.values, rel=1e-10)


def test_expectation_agrees_with_simulated_averages():
    """Simulator and closed forms share no formula; 4 standard errors: fails once in 10³ runs."""
    camera, random = Camera(FRAME, 0.6 * FRAME), np.random.default_rng(17)
    motion = SeenMotion(50.0, 3 * FRAME, camera)
    traces = [simulate_mode(50.0, 3 * FRAME, camera, 512, random) for _ in range(300)]
    for statistics in (allan_statistics, hadamard_statistics):
        values = np.array([statistics(x).values for x in traces])
        error = np.sqrt(np.diag(statistics(traces[0]).covariance(motion)))
        pull = (values.mean(axis=0) - statistics(traces[0]).expected(motion)) / error
        assert np.max(np.abs(pull)) * math.sqrt(300) < 4
        # scatter of 300 variances of skewed estimates: within a quarter
        assert values.std(axis=0) == pytest.approx(error, rel=0.25)


# --- recovery -------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", BY_VARIANCE)
@pytest.mark.parametrize(
    ("ratio", "share", "noise_nm", "options"),
    [
        (0.05, 1.0, 0.0, {}),
        (0.4, 0.5, 0.0, {}),
        (1.0, 1.0, 4.0, {"tracking_noise_nm": 4.0}),
        (0.2, 0.3, 15.0, {"tracking_noise_nm": "fit"}),
    ],
)
def test_pulls_are_standard_normal(method, ratio, share, noise_nm, options):
    """Bias below 3.5 of its error, scatter within half; of 24 repeats once in 10³ more."""
    random = np.random.default_rng([int(100 * ratio), int(10 * share)])
    pulls = []
    for _ in range(24):
        x = simulate(ratio, random, share=share, noise_nm=noise_nm, frames=2048)
        result = fit(method, x, share, **options)
        assert result.converged
        pulls.append(
            [
                math.log(estimate.value / truth) * estimate.value / estimate.stderr
                for estimate, truth in (
                    (result.stiffness, stiffness_at(ratio)),
                    (result.friction, FRICTION),
                )
            ]
        )
    assert np.all(np.abs(np.mean(pulls, axis=0)) * math.sqrt(24) < 3.5)
    assert np.all(np.abs(np.std(pulls, axis=0) - 1) < 0.5)


def test_equipartition_with_given_friction_solves_the_blur_equation():
    x = simulate(0.7, np.random.default_rng(23), frames=16_384)
    result = fit("equipartition", x, friction=(FRICTION, 0.03 * FRICTION))

    def excess(ln_k):
        tau = FRICTION / math.exp(ln_k)
        mean = KT / math.exp(ln_k) * 2 * tau / (len(x) * FRAME)  # τ ≪ T: 2 s² τ/T
        return KT / math.exp(ln_k) * blur_factor(FRAME / tau) - mean - x.var()

    k = math.exp(optimize.brentq(excess, math.log(1e-6), math.log(1.0)))
    assert result.stiffness.value == pytest.approx(k, rel=1e-5)
    assert result.friction.status == "fixed"
    without = fit("equipartition", x, friction=(FRICTION, 1e-6 * FRICTION))
    assert result.stiffness.stderr > without.stiffness.stderr


@pytest.mark.parametrize("method", BY_VARIANCE)
def test_wrong_exposure_is_wrong(method):
    """Negative control: a half-frame exposure taken for a whole one is 28 % low (PHYSICS 3.B)."""
    x = simulate(0.4, np.random.default_rng(1), share=0.5, frames=30_000)
    truth = stiffness_at(0.4)
    assert fit(method, x, 0.5).stiffness.value == pytest.approx(truth, rel=0.03)
    assert fit(method, x, 1.0).stiffness.value / truth == pytest.approx(0.72, abs=0.04)


def test_hadamard_does_not_see_a_linear_drift_and_allan_does():
    x = simulate(0.2, np.random.default_rng(2))
    ramp = 0.05 * np.arange(len(x))
    still, drifting = hadamard_statistics(x), hadamard_statistics(x + ramp)
    assert drifting.values == pytest.approx(still.values, rel=1e-8)
    clean, drifted = fit("hadamard", x), fit("hadamard", x + ramp)
    # the weights of the last round depend a little on where the first began
    assert drifted.stiffness.value == pytest.approx(clean.stiffness.value, rel=1e-4)
    assert fit("allan", x + ramp).stiffness.value < 0.9 * fit("allan", x).stiffness.value


@pytest.mark.slow
@pytest.mark.parametrize("method", BY_VARIANCE)
def test_lost_frames_do_not_bias(method):
    """10 % of the frames and one long gap; 12 pulls, bias below 3.5 of its error."""
    random = np.random.default_rng(9)
    pulls = []
    for _ in range(12):
        x = simulate(0.1, random, frames=3072)
        x[random.random(len(x)) < 0.1] = np.nan
        x[1500:1900] = np.nan
        result = fit(method, x)
        k = result.stiffness
        pulls.append(math.log(k.value / stiffness_at(0.1)) * k.value / k.stderr)
    assert abs(np.mean(pulls)) * math.sqrt(12) < 3.5
    assert 0.5 < np.std(pulls) < 1.6
    assert "lost frames" in result.notes[0]


def test_white_noise_alone_identifies_nothing():
    x = np.random.default_rng(4).normal(size=4096) * 3
    for method in BY_VARIANCE:
        result = fit(method, x, tracking_noise_nm="fit", friction=(FRICTION, 0.03 * FRICTION))
        assert result.stiffness.status == "not_identified"
        assert math.isnan(result.stiffness.value)


# --- the scheme of 2010 ---------------------------------------------------------------------------

BOTH, ONE, BLUR, NONE = (-1, 1), (-1,), (), None


@pytest.mark.parametrize(
    ("ratio", "aliases", "percent", "within"),
    [
        (0.4, BOTH, -0.16, 0.02),
        (0.8, BOTH, -0.65, 0.02),
        (1.0, BOTH, -1.1, 0.05),
        (1.5, BOTH, -3.0, 0.1),
        (2.0, BOTH, -6.4, 0.1),
        (0.53, BLUR, -9.0, 0.2),
        (0.53, NONE, 20.0, 0.2),
    ],
)
def test_arctangent_keeps_the_biases_of_the_paper(ratio, aliases, percent, within):
    """On the exact expected spectrum, W = D (PHYSICS section 0)."""
    result = fit_expected(ratio, 1.0, Correction(aliases is not None, aliases or ()))
    assert result.converged
    # kT/s² against a variance of 1
    assert 100 * math.expm1(-result.fit[0]) == pytest.approx(percent, abs=within)


def fit_expected(ratio, share, correction, frames=16_384):
    frequency = np.arange(1, frames // 2) / (frames * FRAME)
    tau = 1 / (math.pi * ratio * RATE)
    power = power_spectrum(frequency, 1.0, tau, Camera(FRAME, share * FRAME))
    return fit_spectrum(frequency, power, FRAME, share * FRAME, correction)


def test_more_alias_orders_are_better_at_any_exposure():
    for share in (0.3, 0.5, 1.0):
        errors = [
            abs(fit_expected(0.5, share, Correction(True, aliases)).fit[0])
            for aliases in (BLUR, ONE, BOTH)
        ]
        assert errors == sorted(errors, reverse=True)


def test_diverging_correction_is_told():
    """At three times Nyquist the alias correction runs away."""
    assert not fit_expected(3.0, 1.0, Correction(True, BOTH)).converged
    x = simulate(3.0, np.random.default_rng(3))
    print(x.sum(), np.geterr())
    result = fit("arctangent", x)
    assert not result.converged
    assert result.stiffness.status == "not_converged"
    assert "did not converge" in result.notes[-1]


def test_arctangent_errors_are_its_scatter():
    """40 repeats at 0.2 fN: scatter within 35 % of the stated errors."""
    random = np.random.default_rng(14)
    results = [fit("arctangent", simulate(0.2, random)) for _ in range(40)]
    for name in ("stiffness", "friction"):
        values = np.array([getattr(r, name).value for r in results])
        stated = np.mean([getattr(r, name).stderr for r in results])
        assert values.std() == pytest.approx(stated, rel=0.35)


def test_arctangent_bridges_single_frames_and_refuses_many():
    x = simulate(0.2, np.random.default_rng(15))
    few, many = x.copy(), x.copy()
    few[[100, 2000]] = np.nan
    many[::20] = np.nan
    bridged = fit("arctangent", few)
    assert bridged.stiffness.value == pytest.approx(fit("arctangent", x).stiffness.value, rel=0.02)
    assert "2 lost frames were bridged" in bridged.notes[0]
    with pytest.raises(FitError, match="complete trace"):
        fit("arctangent", many)


def test_too_much_noise_leaves_no_power():
    x = simulate(0.2, np.random.default_rng(16))
    result = fit("arctangent", x, tracking_noise_nm=10 * float(x.std()))
    assert result.stiffness.status == "not_identified"


# --- every method ---------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_every_method_takes_every_argument(method):
    x = simulate(0.1, np.random.default_rng(20), frames=2048)
    for share in (0.0, 0.5, 1.0):
        for options in ({}, {"tracking_noise_nm": "fit", "friction": (FRICTION, 0.1 * FRICTION)}):
            result = fit(method, x, share, **options)
            assert isinstance(result, MethodFit)
            assert result.method == method
            for estimate in (result.stiffness, result.friction, result.corner_frequency):
                assert estimate.value > 0
                assert estimate.interval[0] < estimate.value < estimate.interval[1]
                assert estimate.method == method


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["blue", "step", "ramp"])
def test_traces_that_no_motion_explains_give_no_negative_stiffness(method, kind):
    random = np.random.default_rng(21)
    x = {
        "blue": np.diff(random.normal(size=513)),
        "step": np.repeat([0.0, 50.0], 256) + random.normal(size=512),
        "ramp": np.arange(512.0),
    }[kind]
    result = fit(method, x, tracking_noise_nm="fit")
    for field in dataclasses.fields(result)[1:5]:
        value = getattr(result, field.name).value
        assert math.isnan(value) or value >= 0


def test_every_method_is_described_to_the_caller():
    assert all(f'"{name}"' in fit_by_method.__doc__ for name in METHODS)


def test_unknown_method_names_the_known_ones():
    with pytest.raises(ValueError, match=r"'fourier'.*equipartition.*hadamard"):
        fit("fourier", np.zeros(100))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frame_rate_hz": -1.0}, "frame_rate_hz"),
        ({"exposure_s": 0.1}, "exposure"),
        ({"temperature_K": 25.0}, "temperature_K"),
        ({"tracking_noise_nm": "free"}, "tracking_noise_nm"),
        ({"friction": (1e-5, 0.0)}, "friction"),
    ],
)
def test_impossible_numbers_are_named(options, message):
    good = {"frame_rate_hz": RATE, "exposure_s": FRAME, "temperature_K": TEMPERATURE}
    x = np.random.default_rng(0).normal(size=200)
    with pytest.raises(ValueError, match=message):
        fit_by_method("allan", x, **(good | options))


def test_traces_without_motion_or_frames_are_refused():
    with pytest.raises(FitError, match="never changes"):
        fit("allan", np.full(500, 3.0))
    with pytest.raises(FitError, match="at least 64"):
        fit("allan", np.arange(20.0))
    with pytest.raises(ValueError, match="one trace"):
        fit("allan", np.zeros((500, 3)))


def test_methods_are_public():
    assert mtpipe.METHODS == METHODS
    assert mtpipe.fit_by_method is fit_by_method
