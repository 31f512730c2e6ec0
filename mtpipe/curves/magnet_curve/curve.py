"""The curve of a magnet, fitted without outlying beads, and what it says of others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mtpipe.curves.magnet_curve.fit import FormFit, best_fit
from mtpipe.curves.magnet_curve.measured import Forces
from mtpipe.curves.magnet_curve.outliers import (
    FALSE_ALARM,
    TESTS,
    Beads,
    against,
    error_factor,
    far_off,
    p_values,
)
from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.types import FloatArray

# With fewer beads their spread is not known, with fewer positions no shape.
FEWEST_BEADS, FEWEST_POSITIONS = 3, 3
# Most rounds in which the curve is fitted and outliers are left out in turn.
ROUNDS = 10
ONE_SIGMA = float(stats.norm.cdf(1.0))


@dataclass(frozen=True)
class Interval:
    """Forces at positions, (n,) each, in pN: standard error and central 68 % interval."""

    force_pN: FloatArray
    stderr_pN: FloatArray
    low_pN: FloatArray
    high_pN: FloatArray


@dataclass(frozen=True)
class MagnetCurve:
    """Force against position of the magnets, and how beads differ from it.

    Attributes
    ----------
    forces : all that was given, with errors as they were used.
    error_factor : by which the errors were made larger, as the beads' scatter asks.
    fit : the form that was chosen. bic : the least of each form.
    kept : (beads,) whether a bead entered the curve. p_values : (beads, 3), as `outliers.TESTS`.
    beads : each beside the curve.
    """

    forces: Forces
    error_factor: float
    fit: FormFit
    bic: Mapping[str, float]
    kept: NDArray[np.bool_]
    p_values: FloatArray
    beads: Beads

    def curve(self, position_mm: FloatArray) -> Interval:
        """Interval of the curve itself, the force on the middle bead."""
        return self._interval(self.fit.log_force(position_mm), self.fit.variance(position_mm))

    def new_bead(self, position_mm: FloatArray) -> Interval:
        """Interval of an unknown bead: by the curve's variance and the beads' spread."""
        variance = self.fit.variance(position_mm) + self.fit.spread**2
        return self._interval(self.fit.log_force(position_mm), variance)

    def factors(self) -> tuple[FloatArray, FloatArray]:
        """ln of each bead's factor, drawn towards 0 as far as its forces leave it open; its error.

        That of a bead that was left out is not drawn anywhere.
        """
        pull = self._pull()
        rest = pull * self.beads.factor_variance + pull**2 * self.beads.curve_at_factor
        return pull * self.beads.factor, np.sqrt(rest)

    def of_bead(self, number: int, position_mm: FloatArray) -> Interval:
        """Interval of one bead: the curve times its factor, at measured and at other positions."""
        pull, mine = self._pull()[number], self.forces.bead == number
        weight = 1 / self.forces.variance[mine]
        jacobian = self.fit.jacobian(self.forces.position_mm[mine])
        middle = weight @ jacobian / weight.sum()
        rows = self.fit.jacobian(position_mm) - pull * middle
        variance = np.einsum("ij,jk,ik->i", rows, self.fit.covariance, rows)
        variance = variance + pull * self.beads.factor_variance[number]
        shift = pull * self.beads.factor[number]
        return self._interval(self.fit.log_force(position_mm) + shift, variance)

    def reason(self, number: int) -> str:
        """Why a bead was left out; empty where it was not."""
        if self.kept[number]:
            return ""
        test = int(np.argmin(self.p_values[number]))
        p = f"p = {self.p_values[number, test]:.1g}"
        if TESTS[test] == "factor":
            ratio = float(np.exp(self.beads.factor[number]))
            return f"Its forces are {ratio:.3g} times those of the curve ({p})."
        if TESTS[test] == "slope":
            share = float(self.beads.slope[number])
            more = "more" if share > 0 else "less"
            return f"Its force changes {abs(share):.1%} {more} steeply than the curve ({p})."
        return f"Its forces scatter about the curve by more than their errors ({p})."

    def _pull(self) -> FloatArray:
        spread = self.fit.spread**2
        return np.where(self.kept, spread / (spread + self.beads.factor_variance), 1.0)

    def _interval(self, log_force: FloatArray, variance: FloatArray) -> Interval:
        force, stderr = np.exp(log_force), np.sqrt(variance)
        # Student's law: the spread is estimated from the kept beads
        wide = stderr * float(stats.t.ppf(ONE_SIGMA, int(self.kept.sum()) - 1))
        return Interval(force, force * stderr, force * np.exp(-wide), force * np.exp(wide))


def magnet_curve(forces: Forces) -> MagnetCurve:
    """Fit the curve to the forces of many beads, without those that are unlike the others.

    The first curve is of the beads near the middle of all; then beads are tested against the curve
    and it is fitted again to those that pass, until they stay the same.

    Raises
    ------
    MtpipeError : there are too few beads or positions, or too few beads that agree.
    """
    _check(forces, np.ones(len(forces.beads), dtype=bool))
    first, _ = best_fit(forces)
    kept = ~far_off(against(first, forces))
    _check(forces, kept)
    first, _ = best_fit(forces.only(kept))
    factor = error_factor(against(first, forces))
    forces = forces.with_errors_times(factor)
    for _ in range(ROUNDS):
        fit, bic = best_fit(forces.only(kept))
        beads = against(fit, forces)
        p = p_values(fit, beads, kept)
        before, kept = kept, p.min(axis=1) > FALSE_ALARM / p.size
        _check(forces, kept)
        if np.array_equal(before, kept):
            break
    else:
        kept = before
    return MagnetCurve(forces, factor, fit, bic, kept, p, beads)


def _check(forces: Forces, kept: NDArray[np.bool_]) -> None:
    some = forces.only(kept)
    if len(some.beads) < FEWEST_BEADS:
        agree = "" if kept.all() else " that agree"
        raise MtpipeError(
            f"a magnet's curve needs {FEWEST_BEADS} beads{agree} with forces to use at known "
            f"positions, and there are {len(some.beads)}"
        )
    if len(some.positions_mm) < FEWEST_POSITIONS:
        raise MtpipeError(
            f"a magnet's curve needs forces at {FEWEST_POSITIONS} positions of the magnets, and "
            f"there are {len(some.positions_mm)}"
        )
    if not (np.bincount(some.bead) > 1).any():
        raise MtpipeError(
            "a magnet's curve needs a bead with forces at two positions, and there is none"
        )
