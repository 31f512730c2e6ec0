"""Precision estimated from the images against the scatter of positions of a bead at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mtpipe.simulation.images import Sensor
from mtpipe.tracking.measured import METHODS
from mtpipe.tracking.positions import locate
from mtpipe.tracking.precision import pixel_noise, precision_nm
from tests import rendered

# From a signal-to-noise ratio of a pixel of 10 to one of 140, and a noisy sensor.
SENSORS = {
    "faint": Sensor(background_e=100.0, electrons_per_level=0.9),
    "common": Sensor(),
    "bright": Sensor(background_e=20_000.0, electrons_per_level=0.5, bits=16),
    "noisy": Sensor(read_noise_e=200.0, flicker=0.02),
    "coarse": Sensor(electrons_per_level=140.0),
}


def scatter_nm(stack, **how):
    found = locate(stack, **how)
    assert not found.lost.any()
    scale = np.array([rendered.PIXEL_NM, rendered.PIXEL_NM, 1.0])
    return scale * np.std([found.x_px, found.y_px, found.z_nm], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", SENSORS)
def test_precision_is_the_scatter_of_a_bead_at_rest(name):
    stack = rendered.images([[31.3, 31.8, 820.0]] * 600, sensor=SENSORS[name], seed=1)
    stated = precision_nm(stack, rendered.PIXEL_NM, table=rendered.table())
    # the scatter itself is known to 3 %, the estimate to 4 %
    np.testing.assert_allclose(stated, scatter_nm(stack, table=rendered.table()), rtol=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_precision_is_that_of_the_method(method):
    table = rendered.table(method=method)
    stack = rendered.images([[31.3, 31.8, 820.0]] * 600, sensor=SENSORS["faint"], seed=2)
    stated = precision_nm(stack, rendered.PIXEL_NM, method, table)
    np.testing.assert_allclose(stated, scatter_nm(stack, method=method, table=table), rtol=0.15)


def test_motion_and_flicker_are_not_taken_for_noise():
    sensor = replace(Sensor(), flicker=0.03)
    moving = rendered.images(rendered.anywhere(300, seed=3, low_nm=780, high_nm=860), sensor)
    still = rendered.images([[31.3, 31.8, 820.0]] * 300)
    stated, expected = (
        precision_nm(stack, rendered.PIXEL_NM, table=rendered.table()) for stack in (moving, still)
    )
    np.testing.assert_allclose(stated, expected, rtol=0.15)


@pytest.mark.parametrize(("gain", "read_e"), [(0.5, 8.0), (2.0, 60.0)])
def test_photon_and_read_noise_are_told_apart(gain, read_e):
    sensor = Sensor(
        background_e=3000.0, read_noise_e=read_e, electrons_per_level=gain, bits=16, offset=0.0
    )
    stack = rendered.images(rendered.anywhere(48, seed=4), sensor, seed=5)
    noise = pixel_noise(stack)
    assert noise.per_level == pytest.approx(1 / gain, rel=0.1)
    for electrons in (1500.0, 3000.0, 4500.0):
        variance = float(noise.variance(np.array(electrons / gain)))
        assert variance == pytest.approx((electrons + read_e**2) / gain**2, rel=0.1)


def test_without_a_table_there_is_no_height():
    stated = precision_nm(rendered.images([[31.3, 31.8, 820.0]] * 20), rendered.PIXEL_NM)
    assert np.isfinite(stated).tolist() == [True, True, False]
    np.testing.assert_allclose(
        precision_nm(rendered.images([[31.3, 31.8, 820.0]] * 20), 50.0)[:2], stated[:2] / 2
    )


@pytest.mark.slow
def test_one_image_is_enough_and_none_with_a_bead_is_not():
    stack = rendered.images([[31.3, 31.8, 820.0]])
    one = precision_nm(stack, rendered.PIXEL_NM, table=rendered.table())
    many = precision_nm(np.repeat(stack, 30, axis=0), rendered.PIXEL_NM, table=rendered.table())
    np.testing.assert_allclose(one, many, rtol=0.3)
    empty = np.random.default_rng(0).poisson(100, (20, 64, 64))
    assert np.isnan(precision_nm(empty, rendered.PIXEL_NM)).all()
