"""How positions are distributed where no effect explains it, and what that leaves open about the
force.

Of the fitted experiment positions are normal about their mean, as those of its simulated
counterparts are; the recorded density over the normal one of the same width is drawn smooth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from mtpipe.crosschecking.battery.observed import Observed
from mtpipe.crosschecking.battery.statistic import Statistic
from mtpipe.crosschecking.check import BeadCheck, recorded_of
from mtpipe.diagnosis.left_in_time import clearest_plateau
from mtpipe.diagnosis.smooth_correction import WORTH_NATS
from mtpipe.diagnosis.smooth_curve import SmoothCurve, smooth_curve
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import AXES

STATISTICS = ("skewness", "kurtosis")
# Bins of the positions over their standard deviation; what is beyond is in the outermost.
EDGES = np.linspace(-4.0, 4.0, 33)
# Distance between the quartiles of a normal distribution in standard deviations, and the share of a
# sample whose variance determines the width as well (van der Vaart 1998, Asymptotic Statistics, ch.
# 21).
QUARTILES, EFFICIENCY = 1.349, 0.37


@dataclass(frozen=True, eq=False)
class LeftInDistribution:
    """How positions are distributed in a plateau.

    Attributes
    ----------
    axis, plateau : indices.
    values, stderr : (bins,) ln of the recorded density over the normal one's.
    curve : smooth, over the position in standard deviations about the mean.
    ln_force_shift, ln_force_stderr : of ln F, were the width that of the positions' middle half;
        nan where that has none, as of positions stored in coarse steps.
    """

    axis: int
    plateau: int
    values: FloatArray
    stderr: FloatArray
    curve: SmoothCurve
    ln_force_shift: float
    ln_force_stderr: float
    kind: Literal["distribution"] = "distribution"

    @property
    def words(self) -> str:
        """A sentence, without the plateau's number."""
        worst = int(np.argmax(np.abs(self.curve.mean) / self.curve.stderr))
        factor = float(np.exp(self.curve.mean[worst]))
        error = factor * float(self.curve.stderr[worst])
        told = (
            f"positions {self.curve.at[worst]:+.1f} standard deviations from the mean are "
            f"{factor:.2g} ± {error:.1g} times as frequent as in a normal distribution"
        )
        if AXES[self.axis] == "z" or math.isnan(self.ln_force_shift):
            return told
        shift = 100 * float(np.expm1(self.ln_force_shift))
        error = 100 * float(np.exp(self.ln_force_shift)) * self.ln_force_stderr
        return (
            f"{told}; taken from the width of the middle half of the positions, the force would "
            f"change by {shift:+.1f} ± {error:.1f} %"
        )


def left_in_distribution(check: BeadCheck, statistic: Statistic) -> LeftInDistribution | None:
    """The distribution that a statistic judges, in the plateau where it is clearest; None if it is
    about none, or the distribution is not worth a curve.
    """
    if statistic.kind not in STATISTICS:
        return None
    axis, plateau = AXES.index(statistic.axis), clearest_plateau(check, statistic)
    one = recorded_of(check.case)[plateau]
    x = one.position_nm[:, axis]
    x = x[np.isfinite(x)]
    u = (x - x.mean()) / x.std()
    independent = independent_positions(one, axis)
    edges = np.concatenate([[-np.inf], EDGES[1:-1], [np.inf]])
    counts = np.histogram(u, edges)[0] * independent / len(u)
    normal = independent * np.diff(stats.norm.cdf(edges))
    values = np.log((counts + 0.5) / (normal + 0.5))
    stderr = 1 / np.sqrt(np.maximum(counts, normal) + 0.5)
    curve = smooth_curve((EDGES[1:] + EDGES[:-1]) / 2, values, stderr)
    if curve.gain_nats < WORTH_NATS:
        return None
    middle = float(np.diff(np.quantile(u, [0.25, 0.75]))[0]) / QUARTILES
    shift, error = math.nan, math.nan
    if middle > 0:
        shift, error = -2 * math.log(middle), 2 / math.sqrt(2 * EFFICIENCY * independent)
    return LeftInDistribution(axis, plateau, values, stderr, curve, shift, error)


def independent_positions(one: Observed, axis: int) -> float:
    """Number of independent positions that know the variance as well as all frames do.

    A variance is the sum of a spectrum's ordinates, each as uncertain as it is large.
    """
    power, n = one.level[axis], one.data.spectrum.ordinates
    known = 2 * float(np.sum(n * power)) ** 2 / float(np.sum(n * power**2))
    return min(known, float(np.isfinite(one.position_nm[:, axis]).sum()))
