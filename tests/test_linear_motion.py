"""Normal modes of linear motion against sum rules, closed forms and the frequency domain."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mtpipe.physics.camera import Camera, frame_variance, lag_one_covariance, power_spectrum
from mtpipe.physics.linear import LinearMotion, normal_modes, pair_modes
from mtpipe.physics.modes import rotating_bead

KT = 4.1
# So short a frame that the camera sees a motion of these rates as it is.
FAST = Camera(1e-4, 0.0)
seeds = st.integers(0, 2**32 - 1)


def random_motion(seed, size=3):
    """Full stiffness and friction matrices with relaxation times of 10 ms to seconds."""
    random = np.random.default_rng(seed)

    def positive(scale):
        a = random.normal(size=(size, size))
        return scale * (a @ a.T + size * np.eye(size))

    return LinearMotion(positive(1e-3), positive(1e-4), random.normal(size=(2, size)))


@given(seeds)
def test_the_spectrum_is_that_of_the_response_in_the_frequency_domain(seed):
    """Of readouts r: S = 2 r (K + iωΓ)⁻¹ 2kT Γ (K + iωΓ)⁻ᴴ rᵀ, one-sided, cross-spectrum too."""
    motion = random_motion(seed)
    modes = normal_modes(motion, KT)
    for frequency in (0.0, 0.3, 3.0):
        response = np.linalg.inv(motion.stiffness + 2j * np.pi * frequency * motion.friction)
        whole = response @ (4 * KT * motion.friction) @ response.conj().T
        expected = motion.readout @ whole @ motion.readout.T
        scale = np.abs(expected).max()
        for first, second in ((0, 0), (0, 1), (1, 1)):
            variance = modes.amplitude_nm[first] * modes.amplitude_nm[second]
            found = power_spectrum(frequency, variance, modes.tau_s, FAST).sum()
            # aliases of the sampled motion are above by (πfD)²/3 and by what lies beyond Nyquist
            assert found == pytest.approx(expected[first, second].real, abs=1e-3 * scale)
        assert np.abs(expected.imag).max() < 1e-9 * scale


@given(seeds)
def test_sum_rules_of_equipartition_and_free_diffusion(seed):
    motion = random_motion(seed)
    modes = normal_modes(motion, KT)
    r = motion.readout
    covariance = KT * r @ np.linalg.inv(motion.stiffness) @ r.T
    np.testing.assert_allclose(modes.covariance_nm2(), covariance, rtol=1e-9, atol=1e-9)
    diffusion = KT * r @ np.linalg.inv(motion.friction) @ r.T
    rates = modes.amplitude_nm / modes.tau_s @ modes.amplitude_nm.T
    np.testing.assert_allclose(rates, diffusion, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(modes.amplitude_nm, r @ modes.shape, rtol=1e-12)
    assert np.all(np.diff(modes.tau_s) <= 0)


@given(
    force=st.floats(0.05, 50),
    extension=st.floats(100, 10_000),
    radius=st.floats(200, 2000),
    ratio=st.floats(0.3, 3.0),
)
def test_a_bead_that_turns_has_the_modes_of_daldrop(force, extension, radius, ratio):
    gamma = 2e-5
    turning = ratio * 4 / 3 * radius**2 * gamma
    k = force / extension * np.array([[1, -radius], [-radius, radius**2 + radius * extension]])
    motion = LinearMotion(k, np.diag([gamma, turning]), np.array([[1.0, 0.0]]))
    modes = normal_modes(motion, KT)
    closed = rotating_bead(extension, radius, turning / gamma)
    lever = extension + radius
    corner = force / lever / gamma
    np.testing.assert_allclose(1 / modes.tau_s, corner * np.array(closed.rates), rtol=1e-6)
    variance = KT * lever / force
    np.testing.assert_allclose(
        modes.amplitude_nm[0] ** 2, variance * np.array(closed.shares), rtol=1e-5
    )


@given(seeds, st.floats(0, 1), st.sampled_from([0.001, 0.05, 1.0]))
def test_the_spectrum_of_a_quadratic_form_integrates_to_its_variance(seed, exposure, frame_s):
    """Instantaneous: ½ tr(C A C A) (Isserlis); with a camera its blur, pair by pair."""
    motion, camera = random_motion(seed), Camera(frame_s, exposure * frame_s)
    modes = normal_modes(motion, KT)
    a = np.random.default_rng(seed + 1).normal(size=(3, 3))
    form = a + a.T
    frames = 4096
    frequency = np.arange(frames) / frames / frame_s
    # the spectrum repeats at 1/D: the plain sum over a whole period is exact but for wrap-around
    tau_s, variance = pair_modes(form, modes)
    folded = np.minimum(frequency, 1 / frame_s - frequency)[:, None]
    power = power_spectrum(folded, variance, tau_s, camera).sum(axis=1)
    found = np.fft.irfft(power[: frames // 2 + 1], frames)[:2] / 2 / frame_s
    q = modes.quadratic(form)
    tau = 1 / (1 / modes.tau_s[:, None] + 1 / modes.tau_s)
    expected = [np.sum(c(q**2 / 2, tau, camera)) for c in (frame_variance, lag_one_covariance)]
    covariance = KT * np.linalg.inv(motion.stiffness)
    assert np.sum(q**2 / 2) == pytest.approx(np.trace(form @ covariance @ form @ covariance) / 2)
    wrapped = np.exp(-frames * frame_s / tau.max()) * np.sum(q**2)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=3 * wrapped + 1e-9 * expected[0])


def test_a_sign_that_a_library_may_choose_is_fixed():
    motion = random_motion(1)
    flipped = LinearMotion(motion.stiffness[::-1, ::-1], motion.friction[::-1, ::-1], np.eye(3))
    shape = normal_modes(LinearMotion(motion.stiffness, motion.friction, np.eye(3)), KT).shape
    np.testing.assert_allclose(normal_modes(flipped, KT).shape[::-1], shape, rtol=1e-9)


@pytest.mark.parametrize("which", ["stiffness", "friction"])
def test_what_nothing_holds_is_refused(which):
    held = {"stiffness": np.eye(2), "friction": np.eye(2)} | {which: np.diag([1.0, 0.0])}
    with pytest.raises(ValueError, match=f"the {which} matrix is not positive definite"):
        normal_modes(LinearMotion(held["stiffness"], held["friction"], np.eye(2)), KT)
