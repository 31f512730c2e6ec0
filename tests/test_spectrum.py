"""Periodograms: expectation for gaps, short traces and bins against averages over simulations."""

import itertools

import numpy as np
import pytest

from mtpipe.ground.errors import FitError
from mtpipe.physics.camera import Camera, frame_variance, lag_one_covariance, power_spectrum
from mtpipe.physics.langevin import simulate_mode
from mtpipe.spectra.spectrum import periodogram, prewhitening
from mtpipe.spectra.window import bin_edges, expected_matrices, seen_modes, window_of

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


@pytest.mark.parametrize("phi", [0.0, 0.9])
@pytest.mark.parametrize("gaps", ["none", "scattered", "contiguous"])
@pytest.mark.parametrize("tau_s", [1e-3, 0.009, 0.011, 0.3, 5.0])
def test_window_is_the_exact_expectation(phi, gaps, tau_s):
    frames = 300
    mask = masks(frames)[gaps]
    x = np.where(mask, np.random.default_rng(0).normal(size=frames), np.nan)
    spectrum = periodogram(x, CAMERA.frame_s, phi=phi)
    lag = np.arange(frames + 1)
    q = np.exp(-CAMERA.frame_s / tau_s)
    covariance = lag_one_covariance(4.0, tau_s, CAMERA) * q ** (lag - 1.0)
    covariance[0] = frame_variance(4.0, tau_s, CAMERA)
    if phi > 0:
        mask = mask[1:] & mask[:-1]
        before = covariance[np.abs(lag - 1)][:-1]
        covariance = (1 + phi**2) * covariance[:-1] - phi * (before + covariance[1:])
    edges = bin_edges(len(mask), 1)
    direct = 2 * CAMERA.frame_s * direct_expectation(mask.astype(float), covariance, edges)
    ours = spectrum.window.expected(np.array([4.0]), np.array([tau_s]), CAMERA.exposure_s)[0]
    assert ours == pytest.approx(direct, rel=1e-4 if phi > 0 else 3e-5)


@pytest.mark.parametrize("segments", [1, 3])
def test_what_is_slower_than_a_segment_is_seen_as_a_random_walk(segments):
    """Of variance σ² D a frame, less the segment's mean: a bridge and a line, alike in power."""
    length, square = 300, 7.0
    window = window_of(np.ones((segments, length), dtype=bool), bin_edges(length, 1), 0.01, 0.0)
    for tau_s in (80.0, 300.0, 1e5):
        variance = np.array([square * tau_s / 2])
        found = window.expected(variance, np.array([tau_s]), 0.0)[0]
        half = np.pi * np.arange(1, 9) / length
        exact = 2 * 0.01 * 2 * square * 0.01 / (4 * np.sin(half) ** 2)
        assert found[:8] == pytest.approx(exact, rel=0.015)


@pytest.mark.parametrize("gaps", ["none", "scattered", "contiguous"])
def test_independent_ordinates_are_those_of_white_noise(gaps):
    """Scatter of bins and of their sum over 3000 simulations; 5 sigma of a variance's error."""
    frames, repeats = 400, 3000
    mask = masks(frames)[gaps]
    random = np.random.default_rng(2)
    spectra = [
        periodogram(np.where(mask, random.normal(size=frames), np.nan), CAMERA.frame_s)
        for _ in range(repeats)
    ]
    power = np.array([one.power for one in spectra])
    n = spectra[0].ordinates
    # the lowest bins are also correlated with their own mirror image, which is not counted
    relative = power.std(axis=0)[8:] / power.mean(axis=0)[8:] * np.sqrt(n[8:])
    assert relative == pytest.approx(1.0, abs=0.13)
    together = power @ n / n.sum()
    scatter = together.std() / together.mean()
    expected = (spectra[0].share * n.sum()) ** -0.5
    assert scatter == pytest.approx(expected, rel=0.1)


def test_prewhitening_makes_the_ordinates_of_a_short_trace_independent():
    """Off the ends of a trace of five relaxation times leaks what all high frequencies share."""
    frames, tau_s, repeats = 400, 0.8, 400
    random = np.random.default_rng(3)

    def correlation(phi):
        levels = []
        for _ in range(repeats):
            x = simulate_mode(1.0, tau_s, CAMERA, frames, random)
            power = periodogram(x, CAMERA.frame_s, phi=phi).power
            levels.append(np.log([power[20:40].mean(), power[40:].mean()]))
        return np.corrcoef(np.array(levels).T)[0, 1]

    assert abs(correlation(prewhitening(tau_s, CAMERA.frame_s))) < 0.2
    assert correlation(0.0) > 0.5


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


def test_modes_that_move_several_axes_are_the_sum_of_their_covariances():
    """Fast and slow modes; what two axes have in common is of the mean of their windows."""
    random = np.random.default_rng(3)
    x = np.cumsum(random.normal(size=(1024, 3)), axis=0)
    windows = [
        periodogram(x[:, axis], CAMERA.frame_s, phi=phi).window
        for axis, phi in enumerate((0.0, 0.5, 0.9))
    ]
    tau_s = CAMERA.frame_s * np.array([0.05, 0.7, 1.0, 8.0, 1e9])
    amplitude = random.normal(size=(len(tau_s), 3))
    amplitude[1, 2] = amplitude[3, 0] = 0.0
    covariance = amplitude[:, :, None] * amplitude[:, None, :]
    modes = seen_modes(tau_s, windows[0].longest_s, CAMERA)
    found = expected_matrices(windows, modes, covariance, np.array([0, 2, 5]))
    unit = np.array([one.expected(np.ones(5), tau_s, CAMERA.exposure_s) for one in windows])
    each = np.einsum("mab,amf,bmf->mfab", covariance, np.sqrt(unit), np.sqrt(unit))
    expected = np.array([each[:2].sum(axis=0), each[2:].sum(axis=0)])
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-12 * np.abs(expected).max())


def test_low_frequencies_and_short_traces_are_refused_in_words():
    with pytest.raises(FitError, match="only 10 frames"):
        periodogram(np.arange(10.0), 0.01)
    with pytest.raises(FitError, match="never changes"):
        periodogram(np.ones(100), 0.01)
    with pytest.raises(FitError, match="flips"):
        periodogram(np.tile([1.0, -1.0], 500), 0.01)
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


@pytest.mark.parametrize("lost", [0, 1])
def test_all_segments_of_a_long_trace_count(lost):
    """Cut in two, a trace of 2^17 frames has as many independent ordinates as half its frames."""
    x = np.random.default_rng(4).normal(size=2**17)
    x[:lost] = np.nan
    spectrum = periodogram(x, 0.01)
    assert spectrum.ordinates.sum() * spectrum.share == pytest.approx(2**16, rel=1e-3)
    relative = spectrum.power / 0.02 - 1
    assert np.sum(spectrum.ordinates * relative**2) / len(relative) == pytest.approx(1, abs=0.4)
