"""The most informed joint fit that a bead's data support.

What a series of traces shares is worth more than any refinement of a single fit, but only if they
share it. So the joint fits are tried from the most informed down: x and y share the force, or not;
friction as the setup expects it within its error, or of any size. A joint fit is taken when it
describes the traces as well as free fits of each do, by their deviances (Wilks 1938); where none
does, the trace that contradicts the others most is left out, up to a quarter of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from mtpipe.errors import FitError
from mtpipe.fit.model import TraceModel
from mtpipe.fit.series import SeriesFit, fit_series
from mtpipe.fit.series_model import BeadPrior, SeriesModel, SeriesTrace
from mtpipe.fit.trace import TraceFit

# One bead in a thousand is denied a joint fit that is true.
CONTRADICTION_P = 1e-3
LEFT_OUT_SHARE = 0.25
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
    for _ in range(1 + int(LEFT_OUT_SHARE * len(traces))):
        if not kept:
            return None
        worst = None
        for model, expected in _ladder(kept, bead, friction_contradicted):
            try:
                fit = fit_series(model)
            except FitError:
                continue
            excess = fit.deviances - np.array([free.fit.deviance for free in kept])
            if _supported(excess, len(model.names)):
                return SeriesChoice(fit, expected, tuple(left_out))
            worst = int(np.argmax(excess))
        # the last is the least informed fit: what contradicts even that, contradicts the others
        if worst is None:
            return None
        left_out.append(kept.pop(worst).trace)
    return None


def _ladder(
    traces: Sequence[FreeTrace], bead: BeadPrior, friction_contradicted: bool
) -> Iterator[tuple[SeriesModel, bool]]:
    """Models from the most informed down, and whether their friction is the expected one."""
    of_any_size = replace(bead, friction_ln_stderr=math.inf)
    members = tuple(free.trace for free in traces)
    both = len({trace.axis for trace in members}) > 1
    for shared in (True, False) if both else (False,):
        if not friction_contradicted:
            yield SeriesModel(members, bead, shared), True
        yield SeriesModel(members, of_any_size, shared), False


def _supported(excess: np.ndarray, fitted: int) -> bool:
    """Whether deviances beyond those of the free fits are what sharing costs by chance."""
    saved = FREE_PARAMETERS * len(excess) - fitted
    return saved <= 0 or bool(stats.chi2.sf(float(np.sum(excess)), saved) > CONTRADICTION_P)


def as_series_trace(plateau: int, axis: int, extension_nm: float, free: TraceFit) -> FreeTrace:
    """A free fit as a member of a series."""
    model: TraceModel = free.model
    return FreeTrace(SeriesTrace(plateau, axis, extension_nm, model), free)
