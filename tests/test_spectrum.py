"""Periodograms: expectation for gaps, short traces and bins against averages over simulations."""

import itertools

import numpy as np
import pytest

from mtpipe.errors import FitError
from mtpipe.physics.camera import Camera, frame_variance, lag_one_covariance, power_spectrum
from mtpipe.physics.langevin import simulate_mode
from mtpipe.spectrum import periodogram

CAMERA = Camera(1 / 100, 0.6 / 100)


def masks(frames):
    random = np.random.default_rng(5)
    contiguous = np.ones(frames, dtype=bool)
    contiguous[frames // 3 : frames // 2] = False
    return {
        "none": np.ones(frames, dtype=bool),
        "scattered": random.random(frames) > 0.1,
        "contiguous": contiguous,
    }


def direct_expectation(mask, covariance, edges):
    """(2D/n) E|Σ m (x − x̄) e^(−iθt)|² from the full covariance matrix; n² and slow."""
    frames, n = len(mask), mask.sum()
    lag = np.abs(np.subtract.outer(np.arange(frames), np.arange(frames)))
    matrix = covariance[lag]
    centre = np.eye(frames) - np.outer(np.ones(frames), mask / n)
    weighted = np.diag(mask) @ centre
    matrix = weighted @ matrix @ weighted.T
    phase = np.exp(-2j * np.pi * np.outer(np.arange(frames // 2 + 1), np.arange(frames)) / frames)
    power = np.real(np.einsum("ft,ts,fs->f", phase, matrix, phase.conj())) / n
    return np.array([power[a:b].mean() for a, b in itertools.pairwise(edges)])


@pytest.mark.parametrize("gaps", ["none", "scattered", "contiguous"])
@pytest.mark.parametrize("tau_s", [1e-3, 0.009, 0.011, 0.3, 5.0])
def test_window_is_the_exact_expectation(gaps, tau_s):
    frames = 300
    mask = masks(frames)[gaps]
    x = np.where(mask, np.random.default_rng(0).normal(size=frames), np.nan)
    spectrum = periodogram(x, CAMERA.frame_s)
    centres = spectrum.frequency_hz * frames * CAMERA.frame_s
    counts = np.round(spectrum.ordinates * frames / mask.sum()).astype(int)
    edges = np.append(np.round(centres - (counts - 1) / 2), 0).astype(int)
    edges[-1] = edges[-2] + counts[-1]
    lag = np.arange(frames)
    q = np.exp(-CAMERA.frame_s / tau_s)
    covariance = lag_one_covariance(4.0, tau_s, CAMERA) * q ** (lag - 1.0)
    covariance[0] = frame_variance(4.0, tau_s, CAMERA)
    direct = 2 * CAMERA.frame_s * direct_expectation(mask.astype(float), covariance, edges)
    ours = spectrum.window.expected(np.array([4.0]), np.array([tau_s]), CAMERA.exposure_s)[0]
    assert ours == pytest.approx(direct, rel=3e-5)


@pytest.mark.parametrize("gaps", ["scattered", "contiguous"])
def test_gaps_do_not_bias_the_periodogram(gaps):
    """Mean over simulations, against the window's expectation and against the bare spectrum."""
    frames, tau_s, repeats = 512, 0.08, 400
    mask = masks(frames)[gaps]
    random = np.random.default_rng(11)
    powers = []
    for _ in range(repeats):
        x = simulate_mode(1.0, tau_s, CAMERA, frames, random)
        spectrum = periodogram(np.where(mask, x, np.nan), CAMERA.frame_s)
        powers.append(spectrum.power)
    ratio = np.mean(powers, axis=0)
    expected = spectrum.window.expected(np.ones(1), np.array([tau_s]), CAMERA.exposure_s)[0]
    pull = (ratio / expected - 1) * np.sqrt(repeats * np.maximum(spectrum.ordinates, 1))
    # neighbouring bins correlate under gaps; 5 is far out for the mean of 400 periodograms
    assert np.max(np.abs(pull)) < 5
    # negative control: without the window the high frequencies are wrong by far more
    bare = power_spectrum(spectrum.frequency_hz, 1.0, tau_s, CAMERA)
    high = slice(len(bare) // 2, None)
    n = spectrum.ordinates[high]
    assert abs(n @ (ratio / bare - 1)[high] / n.sum()) * np.sqrt(repeats * n.sum()) > 8


def test_low_frequencies_and_short_traces_are_refused_in_words():
    with pytest.raises(FitError, match="only 10 frames"):
        periodogram(np.arange(10.0), 0.01)
    with pytest.raises(FitError, match="never changes"):
        periodogram(np.ones(100), 0.01)
    with pytest.raises(FitError, match="too short"):
        periodogram(np.random.default_rng(0).normal(size=100), 0.01, lowest_hz=49.0)
    lost = np.full(1000, np.nan)
    with pytest.raises(FitError, match="only 0 frames"):
        periodogram(lost, 0.01)


def test_high_pass_leaves_out_the_bins_it_emptied():
    x = np.random.default_rng(0).normal(size=2000)
    spectrum = periodogram(x, 0.01, lowest_hz=2.0)
    assert spectrum.frequency_hz[0] >= 2.0
    assert periodogram(x, 0.01).frequency_hz[0] == pytest.approx(0.05)
