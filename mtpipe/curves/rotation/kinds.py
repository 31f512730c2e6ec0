"""What each kind of tether shows when it is turned, given what is known of it beforehand.

Every free number is a standard normal one, so that what a kind may look like is said by its prior
alone, and kinds with more numbers are weighed fairly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import ndtr

from mtpipe.ground.types import FloatArray
from mtpipe.physics.turned_tethers import (
    Supercoiling,
    shortened_by_braiding_nm,
    shortened_by_coiling_nm,
    supercoiling,
)

Kind = Literal["nicked", "supercoilable", "several tethers"]
KINDS: tuple[Kind, ...] = ("nicked", "supercoilable", "several tethers")
# Prior spread, in ln, of a molecule's buckling and slope about theory (salt, sequence, theory).
BUCKLING_SPREAD, SLOPE_SPREAD = 0.25, 0.3
# The same of the length that two molecules lose as they wind: they need not be alike.
BRAID_SPREAD = 0.7
# A braid buckles too, as its helix becomes steep: from about one turn per 44 nm of its length on it
# loses about 50 nm a turn (Charvin et al. 2005, fig. 6). The third is the spread of both, in ln.
BRAID_NM_PER_TURN, BRAID_SLOPE_NM, BRAID_BUCKLING_SPREAD = 44.0, 50.0, 0.5
# Prior spread of the relaxed place about the log's zero: 2 turns and a tenth of those made.
RELAXED_TURNS, RELAXED_SHARE = 2.0, 0.1
# Share of its length that a tether loses before its bead may meet the surface.
FREE_SHARE = 0.5
# Ends of two tethers under one bead are apart by less than this share of their length.
WIDEST_SPACING = 0.8
# Above this force turns that wind DNA up change its form instead of shortening it (Allemand et al.,
# PNAS 95, 14152, 1998), within this share.
FORM_CHANGES_PN, FORM_CHANGES_SPREAD = 3.0, 0.15


@dataclass(frozen=True)
class Known:
    """What is known of a bead before it is turned; errors as shares.

    Attributes
    ----------
    force_pN, contour_nm, persistence_nm, kT_pN_nm : of the tether. radius_nm : of the bead.
    """

    force_pN: float
    force_error: float
    contour_nm: float
    contour_error: float
    persistence_nm: float
    kT_pN_nm: float
    radius_nm: float

    @property
    def falls(self) -> float:
        """Probability that turns beyond buckling shorten a molecule at this force."""
        spread = np.hypot(self.force_error, FORM_CHANGES_SPREAD)
        return float(ndtr(np.log(FORM_CHANGES_PN / self.force_pN) / spread))

    def coiling(self, force: float, contour: float) -> Supercoiling:
        """Coiling of a molecule whose force and length are off by these numbers of errors."""
        return supercoiling(
            self.force_pN * np.exp(self.force_error * force),
            self.contour_nm * np.exp(self.contour_error * contour),
            self.persistence_nm,
            self.kT_pN_nm,
        )


Shape = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Shapes:
    """Heights at the points of a curve, of each kind, as functions of standard normal numbers.

    Attributes
    ----------
    turns : (n,). top_nm, depth_nm : of the highest point, and from there to the lowest.
    """

    known: Known
    turns: FloatArray
    top_nm: float
    depth_nm: float

    def of(self, kind: Kind) -> tuple[Shape, int]:
        """The function, and how many numbers it takes: first the height, then where it is relaxed.

        A nicked molecule has only the height.
        """
        return {
            "nicked": (self._flat, 1),
            "supercoilable": (self._coiled, 7),
            "several tethers": (self._braided, 7),
        }[kind]

    def relaxed(self, x: float) -> float:
        """Turns at which a tether is relaxed: near the log's 0, if that was passed."""
        low, high = float(self.turns.min()), float(self.turns.max())
        middle = 0.0 if low - 0.5 <= 0 <= high + 0.5 else (low + high) / 2
        return middle + x * (RELAXED_TURNS + RELAXED_SHARE * (high - low))

    def coiling(self, x: FloatArray) -> Supercoiling:
        """The molecule that numbers of the supercoilable kind mean."""
        found = self.known.coiling(x[5], x[6])
        return replace(
            found,
            buckling_turns=found.buckling_turns * float(np.exp(BUCKLING_SPREAD * x[2])),
            slope_nm=found.slope_nm * float(np.exp(SLOPE_SPREAD * x[3])),
        )

    def _flat(self, x: FloatArray) -> FloatArray:
        return np.full_like(self.turns, self._height(x[0]))

    def _coiled(self, x: FloatArray) -> FloatArray:
        turns = self._from_relaxed(x[1])
        lost = shortened_by_coiling_nm(turns, self.coiling(x))
        # unwound molecules melt at higher forces, and then do not fall
        return self._height(x[0]) - self._no_deeper(np.where(turns < 0, ndtr(x[4]), 1.0) * lost)

    def _braided(self, x: FloatArray) -> FloatArray:
        known, top_nm = self.known, max(self.top_nm, 0.3 * self.known.contour_nm)
        widest = min(2 * known.radius_nm, WIDEST_SPACING * top_nm)
        lost = shortened_by_braiding_nm(
            self._from_relaxed(x[1]),
            known.force_pN * float(np.exp(known.force_error * x[4])),
            top_nm,
            float(widest * ndtr(x[2])),
            known.persistence_nm,
            known.kT_pN_nm,
        )
        lost = np.exp(BRAID_SPREAD * x[3]) * lost
        buckling = top_nm / BRAID_NM_PER_TURN * np.exp(BRAID_BUCKLING_SPREAD * x[5])
        slope_nm = BRAID_SLOPE_NM * np.exp(BRAID_BUCKLING_SPREAD * x[6])
        lost += slope_nm * np.maximum(np.abs(self._from_relaxed(x[1])) - buckling, 0)
        return self._height(x[0]) - self._no_deeper(lost)

    def _height(self, x: float) -> float:
        return self.top_nm + 0.2 * self.known.contour_nm * x

    def _from_relaxed(self, x: float) -> FloatArray:
        return np.asarray(self.turns - self.relaxed(x))

    def _no_deeper(self, lost: FloatArray) -> FloatArray:
        """A bead on the surface falls no deeper."""
        return np.minimum(lost, max(self.depth_nm, FREE_SHARE * self.known.contour_nm))
