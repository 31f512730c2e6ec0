"""The most informed joint fit that a bead's data support.

What a series of traces shares is worth more than any refinement of a single fit, but only if they
share it. The least informed joint fit, in which x and y have forces of their own and friction any
size, has to describe the traces as well as free fits of each do; where it does not, the traces that
contradict the others are left out, up to a quarter of them. Then what more is known is added as
long as the data bear it: the friction the setup expects, and one force for x and y. Each step is a
test of nested models by their deviances, priors included (Wilks 1938); a fit that found no maximum
supports nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from mtpipe.fit.series import SeriesFit, fit_series
from mtpipe.fit.series_model import BeadPrior, SeriesModel, SeriesTrace
from mtpipe.fit.trace import TraceFit
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray

# p-value below which a simpler fit is rejected: at each step a true one is, in 1 of 1000 beads.
CONTRADICTION_P = 1e-3
LEFT_OUT_SHARE = 0.25
AS_BAD = 0.25
FREE_PARAMETERS = 3


@dataclass(frozen=True)
class FreeTrace:
    """A trace of the series and the free fit of it by itself."""

    trace: SeriesTrace
    fit: TraceFit


@dataclass(frozen=True)
class SeriesChoice:
    """A joint fit the data support, and the traces that were left out of it."""

    fit: SeriesFit
    friction_expected: bool
    left_out: tuple[SeriesTrace, ...]

    @property
    def words(self) -> str:
        """What was shared."""
        force = "x and y share the force" if self.fit.model.force_shared else "x and y apart"
        source = "expected from the setup" if self.friction_expected else "measured on this bead"
        return f"series of spectra: {force}, friction {source}"


def choose_series(
    traces: Sequence[FreeTrace], bead: BeadPrior, *, friction_contradicted: bool
) -> SeriesChoice | None:
    """The most informed joint fit that the traces support; None where there is none.

    Parameters
    ----------
    friction_contradicted : the free fits contradict the friction the setup expects.
    """
    kept = list(traces)
    left_out: list[SeriesTrace] = []
    most = int(LEFT_OUT_SHARE * len(traces))
    try:
        while kept:
            members = tuple(free.trace for free in kept)
            base = fit_series(SeriesModel(members, _of_any_size(bead), force_shared=False))
            excess = base.deviances - np.array([free.fit.deviance for free in kept])
            # a radius with a prior costs no freedom
            fitted = len(base.theta) - base.model.radius_free
            if _supported(base, float(excess.sum()), FREE_PARAMETERS * len(kept) - fitted):
                return _most_informed(base, bead, friction_contradicted, left_out)
            # the worst, and what is nearly as bad; what is less so may owe it to the worst
            odd = np.flatnonzero(excess >= AS_BAD * np.max(excess)).tolist()
            ranked = sorted(odd, key=lambda i: -excess[i])[: max(most - len(left_out), 0)]
            if not ranked:
                return None
            left_out += [kept[i].trace for i in ranked]
            kept = [free for i, free in enumerate(kept) if i not in ranked]
    except FitError:
        return None
    return None


def _most_informed(
    base: SeriesFit,
    bead: BeadPrior,
    friction_contradicted: bool,
    left_out: list[SeriesTrace],
) -> SeriesChoice:
    """What is known, added to the least informed fit as long as the data bear it."""
    if math.isinf(bead.radius_nm[1]):
        # of x and y apart only the product of radius and viscosity is known; shared, the lever
        # determines the radius, with the friction expected
        prior = _of_any_size(bead) if friction_contradicted else bead
        shared, odd_ones = _with_one_force(base, prior)
        together = shared.model.force_shared
        expected = together and not friction_contradicted
        return SeriesChoice(shared, expected, (*left_out, *odd_ones))
    best, expected = _with_friction(base, bead, friction_contradicted)
    shared, odd_ones = _with_one_force(best, best.model.bead)
    return SeriesChoice(shared, expected, (*left_out, *odd_ones))


def _with_friction(
    base: SeriesFit, bead: BeadPrior, friction_contradicted: bool
) -> tuple[SeriesFit, bool]:
    """The fit with the friction that the setup expects, if data bear it, and whether they do."""
    if friction_contradicted or not math.isfinite(bead.friction_ln_stderr):
        return base, False
    known = fit_series(replace(base.model, bead=bead))
    bears = _supported(known, known.total_deviance - base.total_deviance, 1)
    return (known, True) if bears else (base, False)


def _with_one_force(best: SeriesFit, bead: BeadPrior) -> tuple[SeriesFit, list[SeriesTrace]]:
    """The fit in which x and y share the force, and the few traces that had to be left out for it.

    Where those that contradict hold much of what is known about F_y/F_x, or the others agree on
    another ratio than 1, it is no accident of a plateau, and x and y stay apart.
    """
    ratios = _force_ratios(best)
    kept = list(range(len(best.model.traces)))
    left_out: list[SeriesTrace] = []
    while ratios.information(left_out) <= LEFT_OUT_SHARE:
        members = tuple(best.model.traces[i] for i in kept)
        model = SeriesModel(members, bead, force_shared=True)
        if len(members) == len(model.drives):
            break
        shared = fit_series(model)
        without = [i for i in range(len(best.model.traces)) if i not in kept]
        freer = best.total_deviance - float(best.deviances[without].sum())
        saved = len(members) - len(model.drives) - (model.radius_free - best.model.radius_free)
        if _supported(shared, shared.total_deviance - freer, saved):
            agree = _by_chance(ratios.excess_of_common_ratio(left_out), 1)
            return (shared, left_out) if agree else (best, [])
        worst = int(np.argmax(shared.deviances - best.deviances[kept]))
        left_out.append(members[worst])
        kept.pop(worst)
    return best, []


@dataclass(frozen=True)
class _ForceRatios:
    """ln F_y/F_x of each plateau that has both, from a fit of x and y apart."""

    plateaus: tuple[int, ...]
    ln_ratio: FloatArray
    covariance: FloatArray

    def information(self, left_out: Sequence[SeriesTrace]) -> float:
        """Share of what all plateaus know that those of some traces hold; 0 where there is none."""
        if not self.plateaus:
            return 0.0
        own = 1 / np.diag(self.covariance)
        gone = [self.plateaus.index(t.plateau) for t in left_out if t.plateau in self.plateaus]
        return float(own[gone].sum() / own.sum())

    def excess_of_common_ratio(self, left_out: Sequence[SeriesTrace]) -> float:
        """χ² (1 degree of freedom) by which one ratio for the other plateaus differs from 1."""
        gone = {t.plateau for t in left_out}
        kept = [i for i, plateau in enumerate(self.plateaus) if plateau not in gone]
        if not kept:
            return 0.0
        weight = np.linalg.inv(self.covariance[np.ix_(kept, kept)])
        return float((weight @ self.ln_ratio[kept]).sum() ** 2 / weight.sum())


def _force_ratios(fit: SeriesFit) -> _ForceRatios:
    model = fit.model
    here: dict[int, dict[int, SeriesTrace]] = {}
    for trace in model.traces:
        here.setdefault(trace.plateau, {})[trace.axis] = trace
    both = {plateau: pair for plateau, pair in here.items() if len(pair) == 2}
    ln_ratio, slopes = np.zeros(len(both)), np.zeros((len(both), len(fit.theta)))
    for i, pair in enumerate(both.values()):
        for sign, trace in zip((-1.0, 1.0), (pair[0], pair[1]), strict=True):
            lever = float(model.lever_nm(fit.theta[None], trace)[0])
            ln_ratio[i] += sign * (fit.theta[model.drive(trace)] + math.log(lever))
            slopes[i, model.drive(trace)] += sign
            if model.radius_free:
                slopes[i, model.ln_radius] += sign * (1 - trace.extension_nm / lever)
    return _ForceRatios(tuple(both), ln_ratio, slopes @ fit.covariance @ slopes.T)


def _of_any_size(bead: BeadPrior) -> BeadPrior:
    return replace(bead, friction_ln_stderr=math.inf)


def _supported(fit: SeriesFit, excess: float, saved: int) -> bool:
    """Whether a fit found its maximum, and its deviance is what fewer parameters cost by chance.

    `excess` : beyond the deviance of a fit with `saved` parameters more.
    """
    return fit.converged and _by_chance(excess, saved)


def _by_chance(excess: float, saved: int) -> bool:
    """Whether χ² exceeds this once in a thousand times or more often."""
    return saved <= 0 or bool(stats.chi2.sf(excess, saved) > CONTRADICTION_P)


def as_series_trace(plateau: int, axis: int, extension_nm: float, free: TraceFit) -> FreeTrace:
    """A free fit as a member of a series."""
    return FreeTrace(SeriesTrace(plateau, axis, extension_nm, free.model), free)
