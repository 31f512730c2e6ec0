"""Relaxation modes of a tethered bead along one axis.

A linear overdamped system read out along one coordinate is a sum of independent relaxation modes
(PHYSICS section 2). Written relative to a stiffness k and friction γ of that coordinate, mode i has
the share φ_i of the variance kT/k and relaxes at κ_i times the rate k/γ. Exact sum rules hold for
any coupling: Σ φ_i = 1 (equipartition) and Σ φ_i κ_i = 1 (free diffusion at short times).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Modes:
    """Shares of the variance and relative rates of the modes along one axis.

    Each is a number, or an array (n,) where many beads are described at once.
    """

    shares: tuple[Any, ...]
    rates: tuple[Any, ...]

    def __post_init__(self) -> None:
        if not np.all(np.abs(sum(self.shares) - 1) < 1e-9):
            raise ValueError(f"the shares must sum to 1, got {self.shares}")

    def of(self, which: Any) -> Modes:
        """Those of some of the beads that are described at once, by an index of numpy's."""
        if np.ndim(self.rates[0]) == 0:
            return self
        return Modes(tuple(s[which] for s in self.shares), tuple(r[which] for r in self.rates))


SINGLE_MODE = Modes((1.0,), (1.0,))


def rotating_bead(
    extension_nm: ArrayLike, radius_nm: ArrayLike, friction_ratio_nm2: ArrayLike
) -> Modes:
    """Modes across the field, where the bead's rotation couples to its translation.

    Parameters
    ----------
    extension_nm : tether extension L.
    radius_nm : lever R between attachment and bead centre.
    friction_ratio_nm2 : rotational over translational friction γ_φ/γ_y (bulk: 4R²/3).
        All three are numbers or arrays that broadcast.

    Returns
    -------
    Modes relative to k = F/(L + R) and γ_y.

    Source: Daldrop et al. 2015, Eq 16: λ± = (F/2L)[T ± √(T² − 4LR/(γ_y γ_φ))] with
    T = 1/γ_y + (L + R)R/γ_φ; the shares follow from the two sum rules.
    """
    length, lever, ratio = (
        np.asarray(value, dtype=float) for value in (extension_nm, radius_nm, friction_ratio_nm2)
    )
    if not np.all((length > 0) & (lever > 0) & (ratio > 0)):
        raise ValueError("extension, radius and friction ratio must be positive")
    trace = 1 + (length + lever) * lever / ratio
    root = np.sqrt(trace**2 - 4 * length * lever / ratio)
    scale = (length + lever) / (2 * length)
    fast = scale * (trace + root)
    # the product of both rates is exact; the difference trace − root would cancel
    slow = scale**2 * (4 * length * lever / ratio) / fast
    share = (fast - 1) / (fast - slow)
    return Modes((share, 1 - share), (slow, fast))
