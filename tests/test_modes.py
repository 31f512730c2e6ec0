"""Modes of a rotating bead against the full linear system they stand for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mtpipe.physics.modes import SINGLE_MODE, Modes, rotating_bead


@given(
    extension=st.floats(100, 10_000),
    radius=st.floats(200, 2000),
    ratio=st.floats(0.3, 3.0),
)
def test_modes_are_those_of_the_two_by_two_system(extension, radius, ratio):
    """Normal modes of Γ dX = −K X dt + noise in (y, φ), by eigen-decomposition (PHYSICS 2)."""
    force, gamma = 3.0, 2e-5
    gamma_phi = ratio * 4 / 3 * radius**2 * gamma
    stiffness = (
        force / extension * np.array([[1, -radius], [-radius, radius**2 + radius * extension]])
    )
    root = np.diag([gamma, gamma_phi]) ** 0.5
    root = np.diag(1 / np.diag(root))
    rates, vectors = np.linalg.eigh(root @ stiffness @ root)
    shares = (root[0, 0] * vectors[0]) ** 2 / rates
    k = force / (extension + radius)
    modes = rotating_bead(extension, radius, gamma_phi / gamma)
    assert modes.rates == pytest.approx(rates * gamma / k, rel=1e-6)
    assert modes.shares == pytest.approx(shares * k, rel=1e-5)
    # both sum rules: equipartition and free diffusion at short times
    assert np.dot(modes.shares, modes.rates) == pytest.approx(1, rel=1e-9)


def test_slow_rotation_leaves_one_mode_of_the_lever_l():
    """A bead that cannot turn relaxes like one held at its centre: k = F/L, not F/(L + R)."""
    modes = rotating_bead(1000.0, 500.0, 1e12)
    assert modes.rates[1] == pytest.approx(1.5, rel=1e-3)
    assert modes.shares[1] == pytest.approx(1 / 1.5, rel=1e-3)


def test_impossible_geometry_and_shares_are_refused():
    with pytest.raises(ValueError, match="positive"):
        rotating_bead(-1.0, 500.0, 1e5)
    with pytest.raises(ValueError, match="sum to 1"):
        Modes((0.5, 0.4), (1.0, 2.0))
    assert SINGLE_MODE.shares == (1.0,)
