"""The worm-like chain: published numbers, limits, inversion, brute-force derivative and average."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import quad

from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.tether import (
    VALIDITY,
    Chain,
    extension_nm,
    force_pN,
    mean_extension_nm,
    moments,
    stiffness_pN_per_nm,
)

MARKO_SIGGIA = Chain(2700.0, 50.0, 293.15, "marko-siggia")
BOUCHIAT = Chain(2700.0, 50.0, 293.15, "bouchiat")
EXTENSIBLE = Chain(2700.0, 50.0, 293.15, "extensible", stretch_modulus_pN=1000.0)
EXTENSIBLE_MARKO_SIGGIA = Chain(
    2700.0, 50.0, 293.15, "extensible-marko-siggia", stretch_modulus_pN=1000.0
)
EVERY = (MARKO_SIGGIA, BOUCHIAT, EXTENSIBLE, EXTENSIBLE_MARKO_SIGGIA)
CHAINS = pytest.mark.parametrize("chain", EVERY)
KT = float(thermal_energy_pN_nm(293.15))


def test_every_formula_is_tested():
    assert {c.formula for c in EVERY} == set(VALIDITY)


@CHAINS
@given(log_force=st.floats(-8, 2.2))
def test_extension_inverts_force(chain, log_force):
    force = 10.0**log_force
    assert force_pN(chain, extension_nm(chain, force)) == pytest.approx(force, rel=1e-10)


@CHAINS
@given(
    fraction=st.floats(1e-9, 0.9999),
    contour=st.floats(10, 1e5),
    persistence=st.floats(0.3, 1e3),
    modulus=st.floats(10, 1e5),
)
def test_inversion_for_any_chain(chain, fraction, contour, persistence, modulus):
    modulus = modulus if chain.formula.startswith("extensible") else None
    any_chain = Chain(contour, persistence, 300.0, chain.formula, modulus)
    extension = fraction * contour
    assert extension_nm(any_chain, force_pN(any_chain, extension)) == pytest.approx(
        extension, rel=1e-10
    )


@CHAINS
@given(first=st.floats(0, 100), second=st.floats(0, 100))
def test_extension_rises_with_force(chain, first, second):
    assume(abs(first - second) > 1e-9)
    short, long = extension_nm(chain, sorted((first, second)))
    assert short < long


@CHAINS
def test_curves_are_odd_and_pass_through_zero(chain):
    force = np.array([0.01, 1.0, 20.0])
    np.testing.assert_array_equal(extension_nm(chain, -force), -extension_nm(chain, force))
    length = np.array([1.0, 900.0, 2600.0])
    np.testing.assert_array_equal(force_pN(chain, -length), -force_pN(chain, length))
    assert force_pN(chain, 0.0) == 0
    assert extension_nm(chain, 0.0) == 0


@CHAINS
def test_entropic_spring_at_small_force(chain):
    force = 1e-6
    stretch = 0.0 if chain.stretch_modulus_pN is None else 2700 * force / chain.stretch_modulus_pN
    assert extension_nm(chain, force) == pytest.approx(
        2 * 50 * 2700 * force / (3 * KT) + stretch, rel=1e-5
    )


def test_strong_stretching_follows_odijk():
    # Odijk 1995: L0 (1 - sqrt(kT/(F Lp))/2 + F/K0); what differs is of order kT/(F Lp).
    force = np.array([10.0, 20.0, 40.0])
    odijk = 2700 * (1 - 0.5 * np.sqrt(KT / (force * 50)) + force / 1000)
    np.testing.assert_allclose(extension_nm(EXTENSIBLE, force), odijk, atol=0.2)


def test_marko_siggia_falls_short_of_bouchiat_as_known():
    ratio = extension_nm(MARKO_SIGGIA, [0.1, 0.5, 1.0, 5.0]) / extension_nm(
        BOUCHIAT, [0.1, 0.5, 1.0, 5.0]
    )
    np.testing.assert_allclose(ratio - 1, [-0.071, -0.011, -0.004, -0.0004], atol=6e-4)


def test_stiffness_of_bouchiat_over_marko_siggia_as_known():
    ratio = [
        float(
            stiffness_pN_per_nm(BOUCHIAT, extension_nm(BOUCHIAT, f))
            / stiffness_pN_per_nm(MARKO_SIGGIA, extension_nm(MARKO_SIGGIA, f))
        )
        for f in (0.5, 1.0, 10.0)
    ]
    np.testing.assert_allclose(ratio, [1.11, 1.066, 1.008], atol=2e-3)


def test_stretching_as_known():
    force = np.array([2.0, 5.0, 10.0, 20.0])
    longer = extension_nm(EXTENSIBLE, force) / extension_nm(BOUCHIAT, force) - 1
    np.testing.assert_allclose(longer[1:3], [0.0053, 0.0105], atol=1e-4)
    softer = stiffness_pN_per_nm(EXTENSIBLE, extension_nm(EXTENSIBLE, force)) / stiffness_pN_per_nm(
        BOUCHIAT, extension_nm(BOUCHIAT, force)
    )
    np.testing.assert_allclose(softer, [0.96, 0.86, 0.69, 0.44], atol=6e-3)


@CHAINS
def test_stiffness_is_the_derivative_of_the_force(chain):
    length = extension_nm(chain, [0.003, 0.1, 1.0, 10.0, 40.0])
    step = 1e-4
    slope = (force_pN(chain, length + step) - force_pN(chain, length - step)) / (2 * step)
    np.testing.assert_allclose(stiffness_pN_per_nm(chain, length), slope, rtol=1e-6)


def test_marko_siggia_stiffness_in_closed_form():
    length = np.array([100.0, 1500.0, 2500.0])
    closed = KT / (2 * 50 * 2700) * (2 + (1 - length / 2700) ** -3)
    np.testing.assert_allclose(stiffness_pN_per_nm(MARKO_SIGGIA, length), closed, rtol=1e-12)


def test_at_and_beyond_the_contour_length():
    assert np.all(np.isinf(force_pN(BOUCHIAT, [2700.0, 3000.0])))
    assert np.all(np.isinf(stiffness_pN_per_nm(BOUCHIAT, [2700.0, 3000.0])))
    assert np.all(np.isfinite(force_pN(EXTENSIBLE, [2700.0, 3000.0])))


def test_two_equal_tethers_are_one_of_half_the_persistence_length():
    half = Chain(2700.0, 25.0, 293.15)
    np.testing.assert_allclose(
        force_pN(half, [500.0, 2000.0]), 2 * force_pN(BOUCHIAT, [500.0, 2000.0]), rtol=1e-12
    )


def brute_force_mean(chain: Chain, force: float) -> float:
    """The mean of z over r and the polar angle by adaptive quadrature of the force's integral."""
    top = 0.999 * chain.contour_length_nm if chain.formula != "extensible" else 2900.0
    grid = np.linspace(0, top, 40001)
    curve = force_pN(chain, grid)
    work = np.concatenate([[0], np.cumsum((curve[1:] + curve[:-1]) / 2 * np.diff(grid))]) / KT
    best = np.max(force * grid / KT - work)

    def polar(r: float, power: int) -> float:
        pull = force * r / KT
        value, _ = quad(lambda c: c**power * np.exp(pull * (c - 1)), 0, 1, points=[1 - 5 / pull])
        return value

    nodes = np.linspace(1.0, top, 3001)
    height = force * nodes / KT - np.interp(nodes, grid, work) - best
    keep = height > -45
    weight = np.exp(height[keep]) * nodes[keep] ** 2
    moments = np.array([[polar(r, 0), polar(r, 1)] for r in nodes[keep]])
    return float(np.sum(weight * nodes[keep] * moments[:, 1]) / np.sum(weight * moments[:, 0]))


@pytest.mark.parametrize(
    ("chain", "force"), [(MARKO_SIGGIA, 0.1), (BOUCHIAT, 0.4), (BOUCHIAT, 1.0), (EXTENSIBLE, 6.0)]
)
def test_mean_extension_against_brute_force(chain, force):
    assert mean_extension_nm(chain, force) == pytest.approx(
        brute_force_mean(chain, force), abs=0.02
    )


def test_mean_extension_lies_below_the_curve_by_seven_quarters_of_the_thermal_length():
    for contour in (600.0, 2700.0, 7000.0):
        chain = Chain(contour, 50.0, 293.15, "marko-siggia")
        below = extension_nm(chain, [1.0, 13.0, 40.0]) - mean_extension_nm(chain, [1.0, 13.0, 40.0])
        thermal_length = KT / np.array([1.0, 13.0, 40.0])
        np.testing.assert_allclose(below / thermal_length, 1.75, atol=0.08)


def test_one_pass_over_the_chain_says_what_each_by_itself_does():
    force = np.array([[0.0, 0.1, 1.0], [6.0, 20.0, 60.0]])
    for chain in (MARKO_SIGGIA, BOUCHIAT, EXTENSIBLE):
        found = moments(chain, force)
        np.testing.assert_allclose(found.extension_nm, extension_nm(chain, force), rtol=1e-9)
        np.testing.assert_array_equal(found.height_nm, mean_extension_nm(chain, force))


def test_the_distance_varies_a_little_more_than_the_slope_of_the_curve_says():
    for contour, percent in ((2700.0, 1.3), (1200.0, 2.9)):
        chain = Chain(contour, 50.0, 293.15, "marko-siggia")
        found = moments(chain, 1.0)
        by_slope = KT / float(stiffness_pN_per_nm(chain, found.extension_nm))
        assert 100 * (found.variance_nm2 / by_slope - 1) == pytest.approx(percent, abs=0.05)


def test_chain_left_to_itself_stands_off_the_surface():
    # A Gaussian of variance 2 Lp L0/3 per axis, folded at z = 0, has mean sqrt(2/pi) sigma.
    chain = Chain(20000.0, 20.0, 293.15)
    sigma = np.sqrt(2 * 20 * 20000 / 3)
    assert mean_extension_nm(chain, 0.0) == pytest.approx(np.sqrt(2 / np.pi) * sigma, rel=0.01)


def test_mean_extension_keeps_shape_and_refuses_a_push():
    assert mean_extension_nm(BOUCHIAT, np.full((2, 3), 1.0)).shape == (2, 3)
    with pytest.raises(ValueError, match="-1"):
        mean_extension_nm(BOUCHIAT, [1.0, -1.0])


@pytest.mark.parametrize(
    "values",
    [(0.0, 50.0, 293.0), (2700.0, -1.0, 293.0), (2700.0, 50.0, np.nan),
     (2700.0, 50.0, 293.0, "freely-jointed"), (2700.0, 50.0, 293.0, "extensible"),
     (2700.0, 50.0, 293.0, "bouchiat", 1000.0), (2700.0, 50.0, 293.0, "extensible", -5.0)],
)  # fmt: skip
def test_impossible_chains_are_refused(values):
    with pytest.raises(ValueError, match=r"positive|needed|modulus"):
        Chain(*values)
