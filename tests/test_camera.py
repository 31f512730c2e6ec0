"""The camera model against explicit sums, limits and the independent time-domain simulation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mtpipe.physics import camera as cam
from mtpipe.physics.camera import Camera
from mtpipe.physics.langevin import simulate_mode

FRAME_S = 1 / 120


def explicit_alias_sum(frequency_hz, tau_s, camera, orders=20_000):
    """Blurred Lorentzian summed over its aliases: blur first, then alias (Eqs 16-18 of 2010)."""
    n = np.arange(-orders, orders + 1)[:, None]
    f = frequency_hz + n / camera.frame_s
    lorentzian = 4 * tau_s / (1 + (2 * np.pi * f * tau_s) ** 2)
    return np.sum(lorentzian * np.sinc(f * camera.exposure_s) ** 2, axis=0)


@pytest.mark.parametrize("tau_s", [1e-4, 1e-3, 0.99 * FRAME_S, 1.01 * FRAME_S, 0.1, 10.0])
@pytest.mark.parametrize("share", [1.0, 0.5, 0.05])
def test_spectrum_is_the_sum_of_all_aliases(tau_s, share):
    camera = Camera(FRAME_S, share * FRAME_S)
    f = np.linspace(0.1, 59.9, 60)
    assert cam.power_spectrum(f, 1.0, tau_s, camera) == pytest.approx(
        explicit_alias_sum(f, tau_s, camera), rel=1e-10
    )


@given(
    ln_tau=st.floats(-9, 9),
    share=st.floats(1e-3, 1.0),
)
def test_spectrum_integrates_to_the_recorded_variance(ln_tau, share):
    camera, tau_s = Camera(1.0, share), float(np.exp(ln_tau))
    # Fourier frequencies of a periodic record: the sum is the zero-lag covariance up to q^n
    n = 4096
    f = np.arange(n) / n
    folded = np.minimum(f, 1 - f)
    mean = np.mean(cam.power_spectrum(folded, 1.0, tau_s, camera)) / 2
    q = np.exp(-1 / tau_s)
    wrapped = 2 * cam.lag_one_covariance(1.0, tau_s, camera) * q ** (n - 1) / (1 - q**n)
    expected = cam.frame_variance(1.0, tau_s, camera) + wrapped
    assert mean == pytest.approx(expected, rel=1e-9)


@given(ln_tau=st.floats(-9, 12), share=st.floats(0, 1), frames=st.integers(1, 400))
def test_variance_of_a_mean_is_the_sum_of_all_covariances(ln_tau, share, frames):
    camera, tau_s = Camera(1.0, share), float(np.exp(ln_tau))
    apart = np.abs(np.subtract.outer(np.arange(frames), np.arange(frames)))
    later = np.exp(np.minimum(1.0 - apart, 0.0) / tau_s)
    later *= cam.lag_one_covariance(3.0, tau_s, camera)
    covariance = np.where(apart == 0, cam.frame_variance(3.0, tau_s, camera), later)
    found = cam.mean_variance(3.0, tau_s, camera, frames)
    assert found == pytest.approx(covariance.mean(), rel=1e-9)


def test_variance_of_a_long_mean_is_the_spectrum_at_zero_frequency():
    camera = Camera(0.01, 0.004)
    for tau_s in (1e-4, 0.02, 0.5):
        at_zero = cam.power_spectrum(0.0, 1.0, tau_s, camera) / (2 * 10**7 * camera.frame_s)
        assert cam.mean_variance(1.0, tau_s, camera, 10**7) == pytest.approx(at_zero, rel=1e-5)


def test_full_frame_exposure_is_lansdorp_and_saleh():
    # Lansdorp & Saleh 2012, Eq 7, two-sided, in their symbols: alpha = friction, kappa = stiffness
    kT, kappa, alpha, rate = 4.1, 2e-4, 1.2e-5, 120.0
    f = np.linspace(0.2, 59.0, 40)
    tau = alpha / kappa
    ratio = np.exp(-1 / (tau * rate))
    theirs = (
        2 * kT * alpha / kappa**3 * (
            kappa + 2 * alpha * rate * np.sin(np.pi * f / rate) ** 2 * (ratio**2 - 1)
            / (1 - 2 * ratio * np.cos(2 * np.pi * f / rate) + ratio**2)
        )
    )  # fmt: skip
    ours = cam.power_spectrum(f, kT / kappa, tau, Camera(1 / rate, 1 / rate))
    assert ours == pytest.approx(2 * theirs, rel=1e-9)


def test_instantaneous_sampling_is_the_aliased_lorentzian():
    f, tau = np.linspace(0.5, 59, 30), 0.004
    q = np.exp(-FRAME_S / tau)
    exact = 2 * FRAME_S * (1 - q**2) / (1 + q**2 - 2 * q * np.cos(2 * np.pi * f * FRAME_S))
    assert cam.power_spectrum(f, 1.0, tau, Camera(FRAME_S, 0.0)) == pytest.approx(exact, rel=1e-12)


@given(alpha=st.floats(1e-9, 1e3))
def test_blur_factor_falls_from_one_and_is_smooth_where_the_series_takes_over(alpha):
    value = float(cam.blur_factor(alpha))
    assert 0 < value <= 1
    exact = 2 * (alpha + np.expm1(-alpha)) / alpha**2
    if alpha > 1e-3:
        assert value == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("alpha", [1e45, 1e200, np.inf])
def test_nothing_is_left_of_what_relaxes_at_once_and_no_warning_says_so(alpha):
    with np.errstate(all="raise"):
        assert 0 < float(cam.blur_factor(alpha)) < 1e-20


@pytest.mark.parametrize("tau_s", [0.0011, 0.02, 0.5])
@pytest.mark.parametrize("share", [1.0, 0.4])
def test_covariances_agree_with_the_simulation(tau_s, share):
    camera = Camera(FRAME_S, share * FRAME_S)
    x = simulate_mode(1.0, tau_s, camera, 400_000, np.random.default_rng(7))
    c0 = cam.frame_variance(1.0, tau_s, camera)
    c1 = cam.lag_one_covariance(1.0, tau_s, camera)
    independent = len(x) * np.tanh(FRAME_S / tau_s)
    sigma = 5 * c0 * np.sqrt(2 / independent)  # five standard errors: fails once in 10^6
    assert np.mean(x * x) == pytest.approx(c0, abs=sigma)
    assert np.mean(x[1:] * x[:-1]) == pytest.approx(c1, abs=sigma)
    # negative control: the variance without blur is not what the camera records
    if tau_s < 0.1:
        assert abs(np.mean(x * x) - 1.0) > sigma


@pytest.mark.slow
def test_simulation_agrees_with_brute_force():
    """The exact step against an Euler path of small steps averaged over each exposure."""
    random = np.random.default_rng(3)
    tau, camera, steps = 0.01, Camera(FRAME_S, 0.6 * FRAME_S), 200
    decay = np.exp(-FRAME_S / steps / tau)
    frames = 20_000
    x, recorded = random.normal(), np.empty(frames)
    kicks = np.sqrt(1 - decay**2) * random.normal(size=(frames, steps))
    open_steps = int(0.6 * steps)
    for i in range(frames):
        path = np.empty(steps)
        for j in range(steps):
            x = decay * x + kicks[i, j]
            path[j] = x
        recorded[i] = path[:open_steps].mean()
    exact = simulate_mode(1.0, tau, camera, frames, random)
    sigma = np.sqrt(2 / (frames * np.tanh(FRAME_S / tau)))
    assert recorded.var() == pytest.approx(exact.var(), abs=7 * sigma)
    assert recorded.var() == pytest.approx(cam.frame_variance(1.0, tau, camera), abs=5 * sigma)


def test_camera_refuses_an_exposure_longer_than_a_frame():
    with pytest.raises(ValueError, match="exposure"):
        Camera(0.01, 0.02)
    Camera(0.01, 0.010005)  # rounding to 0.1 % is forgiven


@pytest.mark.parametrize("exposure", [0.0, 0.3, 1.0])
def test_how_frames_follow_each_other_tells_the_relaxation_time(exposure):
    camera = cam.Camera(0.01, 0.01 * exposure)
    tau_s = 0.01 * np.geomspace(0.03, 300, 40)
    follows = cam.following(tau_s, camera)
    assert (np.diff(follows) > 0).all()
    c0 = cam.frame_variance(1.0, tau_s, camera)
    c1 = cam.lag_one_covariance(1.0, tau_s, camera)
    c2 = c1 * np.exp(-0.01 / tau_s)
    np.testing.assert_allclose(follows, (c0 - c2) / (c0 - c1) - 1, rtol=1e-3, atol=1e-12)
    if exposure == 0:
        np.testing.assert_allclose(follows, np.exp(-0.01 / tau_s), rtol=1e-9)
