"""Friction and buffer against exact solutions, tabulated and summed here."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mtpipe.ground.errors import FitError
from mtpipe.physics.buffer import (
    thermal_energy_pN_nm,
    viscosity_pN_s_per_nm2,
    water_viscosity_mPa_s,
)
from mtpipe.physics.friction import (
    parallel_wall_factor,
    perpendicular_wall_factor,
    rotation_wall_factor,
    rotational_stokes_pN_nm_s,
    stokes_pN_s_per_nm,
)

FACTORS = (parallel_wall_factor, perpendicular_wall_factor, rotation_wall_factor)


def brenner(height_over_radius: float) -> float:
    """Exact factor perpendicular to a wall: Brenner 1961, eq 2.19, summed until it converges."""
    a = np.arccosh(height_over_radius)
    n = np.arange(1, int(300 / a))
    bracket = (2 * np.sinh((2 * n + 1) * a) + (2 * n + 1) * np.sinh(2 * a)) / (
        4 * np.sinh((n + 0.5) * a) ** 2 - (2 * n + 1) ** 2 * np.sinh(a) ** 2
    ) - 1
    return float(4 / 3 * np.sinh(a) * np.sum(n * (n + 1) / ((2 * n - 1) * (2 * n + 3)) * bracket))


@pytest.mark.parametrize(
    ("height_over_radius", "tolerance"),
    [(1.01, 3.5e-3), (1.02, 3.5e-3), (1.05, 3.5e-3), (1.1, 1e-3), (1.2, 1e-3), (1.5, 1e-3),
     (2.0, 1e-3), (3.0, 1e-4), (10.0, 1e-5)],
)  # fmt: skip
def test_perpendicular_factor_follows_brenner(height_over_radius, tolerance):
    factor = perpendicular_wall_factor(height_over_radius, 1.0)
    assert factor == pytest.approx(brenner(height_over_radius), rel=tolerance)


@pytest.mark.parametrize(
    ("height_over_radius", "exact", "error", "tolerance"),
    [(10.0677, 1.0591, 0.0, 1e-4), (3.7622, 1.1738, 0.0, 1e-4), (2.3524, 1.3079, 0.001, 5e-4),
     (1.5431, 1.5675, 0.010, 1e-3), (1.1276, 2.1514, 0.044, 1e-3), (1.0453, 2.6475, 0.01, 1e-3),
     (1.005004, 3.7863, -0.20, 5e-3)],
)  # fmt: skip
def test_parallel_factor_errs_as_its_docstring_says(height_over_radius, exact, error, tolerance):
    # exact: Goldman, Cox & Brenner 1967, table 2 (from O'Neill's solution in bispherical
    # coordinates).
    factor = parallel_wall_factor(height_over_radius, 1.0)
    assert factor / exact - 1 == pytest.approx(error, abs=tolerance)


def test_parallel_factor_at_the_heights_of_the_reference_configuration():
    # R = 1400 nm, contour 2700 nm: friction over bulk at 0.05, 1 and 10 pN.
    extension = np.array([1040.0, 2315.0, 2575.0])
    factor = parallel_wall_factor(extension + 1400, 1400)
    np.testing.assert_allclose(factor, [1.48, 1.265, 1.245], atol=0.02)
    assert parallel_wall_factor(2315.0, 1400) == pytest.approx(1.52, abs=0.01)  # u = R/L: wrong


def test_rotation_factor():
    assert rotation_wall_factor(2.0, 1.0) == pytest.approx(1 + 5 / 128)


@pytest.mark.parametrize("factor", FACTORS)
def test_far_from_the_wall_friction_is_that_of_the_bulk(factor):
    assert factor(1e6, 1.0) == pytest.approx(1.0, abs=2e-6)


@pytest.mark.parametrize("factor", FACTORS)
@given(height=st.floats(1.001, 50), step=st.floats(0.001, 1))
def test_friction_falls_with_height(factor, height, step):
    near, far = factor(np.array([height, height + step]), 1.0)
    assert near > far > 1


@pytest.mark.parametrize("factor", FACTORS)
def test_factors_broadcast(factor):
    heights, radii = np.array([[3000.0], [2000.0]]), np.array([500.0, 1000.0, 1400.0])
    assert factor(heights, radii).shape == (2, 3)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("height", [1400.0, 0.0, -200.0, np.nan])
def test_a_bead_inside_the_surface_is_refused(factor, height):
    with pytest.raises(FitError, match=r"1400 nm.*z = 0"):
        factor(np.array([2000.0, height]), 1400.0)


def test_stokes_in_bulk():
    # 6 pi · 1.0016e-3 Pa s · 1 µm = 1.888e-8 N s/m = 1.888e-5 pN s/nm
    assert stokes_pN_s_per_nm(1000.0, 1.0016) == pytest.approx(1.888e-5, rel=1e-3)
    ratio = rotational_stokes_pN_nm_s(1400.0, 0.9) / stokes_pN_s_per_nm(1400.0, 0.9)
    assert ratio == pytest.approx(4 / 3 * 1400**2)


def test_thermal_energy():
    np.testing.assert_allclose(thermal_energy_pN_nm([293.15, 298.15]), [4.0474, 4.1164], atol=1e-4)


def test_viscosity_units():
    assert viscosity_pN_s_per_nm2(1.0) == 1e-9


def test_viscosity_of_water():
    # IAPWS R12-08, simplified equation at 0.1 MPa, itself within 1 %.
    temperature = np.linspace(274, 373, 100)
    power = np.array([-1.9, -7.7, -19.6, -40.0])
    coefficient = np.array([280.68, 511.45, 61.131, 0.45903])
    iapws = 1e-3 * (coefficient * (temperature[:, None] / 300) ** power).sum(axis=1)
    error = np.abs(water_viscosity_mPa_s(temperature) / iapws - 1)
    assert error[(temperature > 288) & (temperature < 310)].max() < 2e-3
    assert error[(temperature > 285) & (temperature < 320)].max() < 4e-3
    assert error.max() < 2e-2
    np.testing.assert_allclose(water_viscosity_mPa_s([293.15, 298.15]), [1.0017, 0.8904], atol=1e-4)


def test_water_is_liquid():
    with pytest.raises(ValueError, match="20: water is liquid"):
        water_viscosity_mPa_s([300.0, 20.0])
