"""What is compiled for spectra is what numpy and `physics.camera` say."""

import numpy as np
import pytest

from mtpipe.physics.camera import Camera, recorded_parts
from mtpipe.spectra.elementary import exponentials, logarithms
from mtpipe.spectra.window import seen_modes


def test_exponentials_and_logarithms_are_those_of_numpy():
    x = np.random.default_rng(0).uniform(-600, 600, 10_000)
    found = x.copy()
    exponentials(found)
    np.testing.assert_allclose(found, np.exp(x), rtol=1e-15)
    ln = np.empty_like(found)
    logarithms(found, ln)
    np.testing.assert_allclose(ln, np.log(found), rtol=1e-15, atol=1e-15)


@pytest.mark.parametrize("exposure_s", [0.0, 1e-6, 0.003, 0.01])
def test_recorded_modes_are_those_of_the_camera(exposure_s):
    """For relaxation times from far below the frame to far above, both formulas and series."""
    camera = Camera(0.01, exposure_s)
    tau_s = np.geomspace(1e-6, 1e3, 500)
    tau, white, correlated = seen_modes(tau_s, 1e4, camera)
    np.testing.assert_allclose(tau, tau_s / camera.frame_s, rtol=1e-15)
    expected = recorded_parts(tau_s, camera)
    np.testing.assert_allclose(white, expected[0], rtol=1e-13, atol=1e-300)
    np.testing.assert_allclose(correlated, expected[1], rtol=1e-13, atol=1e-300)


def test_what_outlasts_a_segment_is_seen_by_its_slope():
    """Of a mode twice as slow as a window can tell, half the variance."""
    camera = Camera(0.01, 0.005)
    (at, slower) = (seen_modes(np.array([tau_s]), 5.0, camera) for tau_s in (5.0, 10.0))
    assert slower[0] == at[0]
    assert slower[2] == pytest.approx(at[2] / 2, rel=1e-14)
