"""The fit of one trace: recovery, uncertainty, what it refuses and what it calls not identified."""

import math

import numpy as np
import pytest
from scipy import stats

from mtpipe.fit.model import TraceModel
from mtpipe.fit.trace import fit_trace
from mtpipe.ground.errors import FitError
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera
from mtpipe.physics.langevin import simulate_axis
from mtpipe.physics.modes import rotating_bead
from mtpipe.spectra.spectrum import periodogram

pytestmark = pytest.mark.slow

RATE, TEMPERATURE, FRICTION = 120.0, 298.15, 2.3e-5
KT = float(thermal_energy_pN_nm(TEMPERATURE))


def stiffness_at(nyquist_ratio):
    return 2 * math.pi * nyquist_ratio * RATE / 2 * FRICTION


def simulate(nyquist_ratio, random, *, share=1.0, frames=4096, noise_nm=0.0):
    camera = Camera(1 / RATE, share / RATE)
    x = simulate_axis(stiffness_at(nyquist_ratio), FRICTION, KT, camera, frames, random)
    return x + noise_nm * random.normal(size=frames)


def fit(x, share=1.0, **options):
    return fit_trace(
        x, frame_rate_hz=RATE, exposure_s=share / RATE, temperature_K=TEMPERATURE, **options
    )


@pytest.mark.parametrize(
    ("ratio", "share", "options", "noise_nm"),
    [
        (0.05, 1.0, {}, 0.0),
        (0.4, 0.5, {}, 0.0),
        (1.0, 1.0, {}, 0.0),
        (0.3, 0.3, {"tracking_noise_nm": "fit"}, 15.0),
        (0.4, 1.0, {"tracking_noise_nm": 4.0}, 4.0),
    ],
)
def test_pulls_are_standard_normal(ratio, share, options, noise_nm):
    """Bias below 3 and scatter within 30 % of the stated errors; 60 repeats fail once in 10³."""
    random = np.random.default_rng([int(100 * ratio), int(10 * share)])
    pulls = []
    for _ in range(60):
        result = fit(simulate(ratio, random, share=share, noise_nm=noise_nm), share, **options)
        truth = np.log([stiffness_at(ratio), FRICTION])
        pulls.append((result.theta[:2] - truth) / np.sqrt(np.diag(result.covariance)[:2]))
    pulls = np.array(pulls)
    assert np.all(np.abs(pulls.mean(axis=0)) * math.sqrt(60) < 3.3)
    assert np.all((pulls.std(axis=0) > 0.7) & (pulls.std(axis=0) < 1.3))


def test_wrong_exposure_is_wrong():
    """Negative control: a half-frame exposure fitted as a whole one is 28 % low (PHYSICS 3.B)."""
    x = simulate(0.4, np.random.default_rng(1), share=0.5, frames=60_000)
    right, wrong = fit(x, 0.5), fit(x, 1.0)
    truth = stiffness_at(0.4)
    assert right.stiffness.value == pytest.approx(truth, rel=0.03)
    assert wrong.stiffness.value / truth == pytest.approx(0.72, abs=0.03)
    assert right.p_value > 1e-3


def test_goodness_of_fit_is_uniform():
    random = np.random.default_rng(8)
    p = np.sort([fit(simulate(0.3, random, frames=2048)).p_value for _ in range(80)])
    # Kolmogorov–Smirnov distance; 0.18 is exceeded once in 100 sets of 80
    distance = np.max(np.abs(p - (np.arange(80) + 0.5) / 80))
    assert distance < 0.18


def test_prior_friction_narrows_stiffness_beyond_nyquist():
    x = simulate(1.5, np.random.default_rng(2), noise_nm=5.0, frames=16_384)
    free = fit(x, tracking_noise_nm="fit")
    informed = fit(x, tracking_noise_nm="fit", friction=(FRICTION, 0.03 * FRICTION))
    assert informed.stiffness.status == "ok"
    assert informed.stiffness.value == pytest.approx(stiffness_at(1.5), rel=0.12)
    if free.stiffness.status == "ok":
        assert free.stiffness.stderr > 2 * informed.stiffness.stderr
    else:
        assert free.stiffness.status == "not_identified"


def test_white_noise_alone_identifies_nothing():
    x = np.random.default_rng(4).normal(size=8192) * 3
    result = fit(x, tracking_noise_nm="fit", friction=(FRICTION, 0.03 * FRICTION))
    assert result.stiffness.status == "not_identified"
    assert math.isnan(result.stiffness.value)


def test_no_noise_is_told_as_at_bound_or_small():
    random = np.random.default_rng(6)
    results = [fit(simulate(0.3, random), tracking_noise_nm="fit") for _ in range(12)]
    assert {r.noise.status for r in results} == {"ok", "at_bound"}
    for result in results:
        assert result.noise.interval[0] >= 0
        assert result.noise.value <= result.noise.interval[1]


def test_lost_frames_do_not_bias():
    random = np.random.default_rng(9)
    logs = []
    for _ in range(40):
        x = simulate(0.1, random, frames=8192)
        x[random.random(len(x)) < 0.1] = np.nan
        x[3000:3900] = np.nan
        logs.append(fit(x).theta[0])
    mean_error = np.mean(logs) - math.log(stiffness_at(0.1))
    assert abs(mean_error) < 3.3 * np.std(logs) / math.sqrt(40)
    assert abs(mean_error) < 0.03


def test_rotation_modes_recover_the_force_across_the_field():
    """The two-mode spectrum fitted with its modes is unbiased, with one mode it is not."""
    random = np.random.default_rng(12)
    modes = rotating_bead(1200.0, 1400.0, 4 / 3 * 1400.0**2)
    k = stiffness_at(0.3)
    camera = Camera(1 / RATE, 1 / RATE)
    ratios = []
    for _ in range(10):
        x = simulate_axis(k, FRICTION, KT, camera, 16_384, random, modes=modes)
        ratios.append((fit(x, modes=modes).friction.value, fit(x).friction.value))
    both, single = np.mean(ratios, axis=0) / FRICTION
    assert both == pytest.approx(1, abs=0.025)
    assert single > 1.05  # PHYSICS E2: the single mode returns 1.03 to 1.18 times the friction


def test_start_is_near_whatever_the_relaxation_time():
    random = np.random.default_rng(13)
    for ratio in np.geomspace(0.003, 3, 13):
        spectrum = periodogram(simulate(ratio, random, frames=8192), 1 / RATE)
        start = TraceModel(spectrum, 1 / RATE, KT).start
        assert np.all(np.isfinite(start))
        assert abs(start[0] - math.log(stiffness_at(ratio))) < 1.5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frame_rate_hz": -1.0}, "frame_rate_hz"),
        ({"exposure_s": 0.1}, "exposure"),
        ({"temperature_K": float("nan")}, "temperature_K"),
        ({"temperature_K": 25.0}, "temperature_K"),
        ({"tracking_noise_nm": -1.0}, "tracking_noise_nm"),
        ({"tracking_noise_nm": "free"}, "tracking_noise_nm"),
        ({"friction": (1e-5, 0.0)}, "friction"),
    ],
)
def test_impossible_numbers_are_named(options, message):
    good = {"frame_rate_hz": RATE, "exposure_s": 1 / RATE, "temperature_K": TEMPERATURE}
    with pytest.raises(ValueError, match=message):
        fit_trace(np.random.default_rng(0).normal(size=200), **(good | options))


def test_several_traces_at_once_are_refused():
    with pytest.raises(ValueError, match="one trace"):
        fit(np.zeros((500, 3)))


def test_constant_trace_is_refused():
    with pytest.raises(FitError, match="never changes"):
        fit(np.full(500, 3.0))


def test_errors_and_p_values_hold_where_frames_are_lost():
    """40 pulls of k and γ; p-values pass Kolmogorov–Smirnov at 1e-3."""
    random = np.random.default_rng(31)
    pulls, p_values = [], []
    for _ in range(40):
        x = simulate(0.02, random, frames=4096)
        x[random.random(len(x)) < 0.1] = np.nan
        result = fit(x)
        truth = np.log([stiffness_at(0.02), FRICTION])
        pulls.append((result.theta[:2] - truth) / np.sqrt(np.diag(result.covariance)[:2]))
        p_values.append(result.p_value)
    # without prewhitening leakage fills all high frequencies with the same few strong ordinates,
    # and the stiffness scatters by three times its stated error
    assert np.all((np.std(pulls, axis=0) > 0.65) & (np.std(pulls, axis=0) < 1.4))
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_short_traces_cover_and_are_unbiased():
    """20 relaxation times, 100 traces: 68 % ± 14 % (3 sigma) cover, bias below σ/3 + 3 errors."""
    random = np.random.default_rng(32)
    ratio = 20 / (math.pi * 1024)
    truth = np.array([stiffness_at(ratio), FRICTION])
    inside, relative = [], []
    for _ in range(100):
        result = fit(simulate(ratio, random, frames=1024))
        estimates = (result.stiffness, result.friction)
        inside.append(
            [one.interval[0] < t < one.interval[1] for one, t in zip(estimates, truth, strict=True)]
        )
        relative.append(result.stiffness.value / truth[0] - 1)
    assert np.all(np.abs(np.mean(inside, axis=0) - 0.68) < 0.14)
    relative = np.array(relative)[np.isfinite(relative)]
    assert len(relative) > 80
    assert abs(relative.mean()) < relative.std() * (1 / 3 + 3 / math.sqrt(len(relative)))


def test_what_cannot_be_told_apart_is_named():
    """Stiffness, friction and noise at twice the Nyquist frequency: one level, three unknowns."""
    result = fit(simulate(2.0, np.random.default_rng(33), noise_nm=5.0), tracking_noise_nm="fit")
    assert result.stiffness.status == "not_identified"
    assert math.isnan(result.stiffness.value)
    assert {"stiffness", "friction"} <= set(result.stiffness.tied_to)
    # known friction and noise determine it
    told = fit(
        simulate(2.0, np.random.default_rng(33), noise_nm=5.0),
        tracking_noise_nm=5.0,
        friction=(FRICTION, 0.03 * FRICTION),
    )
    assert told.stiffness.status == "ok"
    assert told.stiffness.tied_to == ()


def test_shift_per_exposure_is_what_another_exposure_does():
    random = np.random.default_rng(34)
    x = simulate(0.7, random, frames=8192)
    known = {"friction": (FRICTION, 0.03 * FRICTION)}
    here, shorter = fit(x, **known), fit(x, share=0.998, **known)
    difference = (here.theta - shorter.theta)[:2] / (0.002 / RATE)
    assert here.shift_per_exposure[:2] == pytest.approx(difference, rel=0.05)
