"""Beads that are unlike the others: their factor, their slope or their scatter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mtpipe.curves.magnet_curve.fit import FormFit
from mtpipe.curves.magnet_curve.measured import Forces
from mtpipe.ground.types import FloatArray

# Chance that any sound bead of a day is left out; beads and their three tests share it.
FALSE_ALARM = 0.01
TESTS = ("factor", "slope", "scatter")
# Standard deviation of a normal distribution over its median absolute deviation; and the number of
# standard deviations from the middle at which a bead is left out of the first curve.
MAD_TO_SD, FAR = 1.4826, 3.5
# Median p-value of the beads' scatter below which stated errors are taken as too small.
UNLIKELY = 0.05
FEWEST_TO_JUDGE_ERRORS = 5


@dataclass(frozen=True)
class Beads:
    """Each bead against a curve; NaN where it has too few forces. All (beads,).

    Attributes
    ----------
    factor, factor_variance : ln of the bead's own factor, by its forces' errors alone.
    slope, slope_variance : how much steeper its ln F is than the curve's, as a share.
    scatter, freedom : χ² about its own factor and slope, and the degrees of freedom.
    curve_at_factor, curve_at_slope : what the curve's own variance makes of both variances.
    """

    factor: FloatArray
    factor_variance: FloatArray
    slope: FloatArray
    slope_variance: FloatArray
    scatter: FloatArray
    freedom: FloatArray
    curve_at_factor: FloatArray
    curve_at_slope: FloatArray


def against(fit: FormFit, forces: Forces) -> Beads:
    """What each bead's forces say beside the curve."""
    weight = 1 / forces.variance
    curve = fit.log_force(forces.position_mm)
    jacobian = fit.jacobian(forces.position_mm)
    residuals = forces.log_force - curve
    total = forces.sums(weight)
    factor = forces.sums(weight * residuals) / total
    at_factor = forces.sums(weight[:, None] * jacobian) / total[:, None]
    centred = curve - (forces.sums(weight * curve) / total)[forces.bead]
    lever = forces.sums(weight * centred**2)
    lever = np.where(lever > 1e-9 * total, lever, np.nan)
    slope = forces.sums(weight * centred * residuals) / lever
    at_slope = forces.sums((weight * centred)[:, None] * jacobian) / lever[:, None]
    straight = factor[forces.bead] + np.nan_to_num(slope)[forces.bead] * centred
    freedom = forces.sums(np.ones_like(weight)) - 1 - np.isfinite(slope)
    scatter = forces.sums(weight * (residuals - straight) ** 2)

    def of_curve(rows: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("ij,jk,ik->i", rows, fit.covariance, rows))

    return Beads(
        factor, 1 / total, slope, 1 / lever, np.where(freedom > 0, scatter, np.nan),
        np.where(freedom > 0, freedom, np.nan), of_curve(at_factor), of_curve(at_slope),
    )  # fmt: skip


def far_off(beads: Beads) -> NDArray[np.bool_]:
    """Beads that are far from the middle of the others, by medians: a first guess."""

    def far(values: FloatArray, least: float) -> NDArray[np.bool_]:
        away = np.abs(values - np.nanmedian(values)) if np.isfinite(values).any() else values
        wide = max(MAD_TO_SD * float(np.nanmedian(away)), least) if len(away) else least
        return np.nan_to_num(away) > FAR * wide

    nu = beads.freedom
    # Wilson and Hilferty's cube root, which makes χ² nearly normal
    cube = (np.cbrt(beads.scatter / nu) - (1 - 2 / (9 * nu))) / np.sqrt(2 / (9 * nu))
    return np.asarray(
        far(beads.factor, float(np.sqrt(np.median(beads.factor_variance))))
        | far(beads.slope / np.sqrt(beads.slope_variance), 1.0)
        | far(np.where(np.isfinite(cube), cube, 0.0), 1.0)
    )


def p_values(fit: FormFit, beads: Beads, kept: NDArray[np.bool_]) -> FloatArray:
    """Chance of as much or more of each bead's three tests, (beads, 3); 1 where there is none.

    A bead that entered the curve has pulled it, one that did not has not: the curve's own variance
    counts down for the first and up for the second.
    """
    side = np.where(kept, -1.0, 1.0)
    known = max(int(kept.sum()) - 1, 1)
    wide = fit.spread**2 + beads.factor_variance
    factor = beads.factor / np.sqrt(np.maximum(wide + side * beads.curve_at_factor, 0.1 * wide))
    steep = beads.slope_variance
    slope = beads.slope / np.sqrt(np.maximum(steep + side * beads.curve_at_slope, 0.1 * steep))
    p = np.column_stack([
        2 * stats.t.sf(np.abs(factor), known),
        2 * stats.norm.sf(np.abs(slope)),
        stats.chi2.sf(beads.scatter, beads.freedom),
    ])  # fmt: skip
    return np.where(np.isfinite(p), p, 1.0)


def error_factor(beads: Beads) -> float:
    """By how much forces scatter more than their errors say, in the middle of all beads; else 1."""
    there = np.isfinite(beads.scatter)
    p = np.asarray(stats.chi2.sf(beads.scatter[there], beads.freedom[there]))
    if len(p) < FEWEST_TO_JUDGE_ERRORS or np.median(p) > UNLIKELY:
        return 1.0
    return float(np.sqrt(np.median(beads.scatter[there] / stats.chi2.median(beads.freedom[there]))))
