"""Correlation of successive frames: what prewhitening and the search for sticking begin with."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.signal import lfilter

from mtpipe.joint_fit.data import whitening
from mtpipe.spectra.correlation import lag_one_correlation

FRAME_S = 1 / 350


def slow_trace(seed, tau_s=0.5, frames=4096, lost_share=0.02):
    """A trace of 23 relaxation times, of which some frames are lost."""
    random = np.random.default_rng(seed)
    kept = math.exp(-FRAME_S / tau_s)
    kicks = math.sqrt(1 - kept**2) * random.normal(size=frames)
    kicks[0] = random.normal()
    x = lfilter([300.0], [1.0, -kept], kicks)
    x[random.random(frames) < lost_share] = np.nan
    return x


@given(arrays(float, st.integers(2, 50), elements=st.floats(-1e3, 1e3) | st.just(np.nan)))
def test_it_is_a_correlation_whatever_is_lost(x):
    assert -1 - 1e-9 <= lag_one_correlation(x) <= 1 + 1e-9


def test_it_is_that_of_a_long_trace():
    """One standard error is √((1 − q²)/n), 0.0005."""
    x = slow_trace(0, tau_s=10 * FRAME_S, frames=400_000)
    assert lag_one_correlation(x - np.nanmean(x)) == pytest.approx(math.exp(-0.1), abs=0.003)


def test_slow_traces_with_lost_frames_are_all_prewhitened():
    """Of one in forty, the products over the pairs that are there, divided by the variance of all
    frames, exceed 1. Without prewhitening the trace leaks into all frequencies: the diagnosis named
    a drift, and the force was ten standard errors off.
    """
    above = 0
    for seed in range(200):
        x = slow_trace(seed)
        deviation = x - np.nanmean(x)
        above += np.nanmean(deviation[1:] * deviation[:-1]) > np.nanmean(deviation**2)
        (phi,) = whitening(x[:, None], FRAME_S)
        assert 0.97 < phi < 1
    assert above > 2
