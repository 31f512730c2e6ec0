"""Gain that further parameters promise, predicted from a fit without them (score test)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.parameter import already_free
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.expectation import Expectation
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.height_course import CourseSlopes
from mtpipe.joint_fit.information import gradient_of, information_of
from mtpipe.joint_fit.model import ConfiguredModel
from mtpipe.joint_fit.slopes import Slopes, slopes

# Share of its information below which a size counts as unseen: other parameters do the same.
LEAST_LEFT = 1e-6
# Hypotheses of one effect are fitted if they promise this share of its best gain: large gains
# differ from what they promise.
NEARLY_AS_MUCH = 0.3
# Number of these that are fitted: the best ones, and others spread over the rest. A recording of 38
# plateaus has 37 in which something may begin, and fits of neighbours end in one place.
BEST_BEGINNINGS, OTHER_BEGINNINGS = 3, 3
# Number of terms that are fitted, those that promise most, whatever place they are for.
MOST_FORMS = 3
# Relative difference below which two expectations are the same but for rounding.
SAME = 1e-9


def most_promising(
    fit: ConfiguredFit, effects: Sequence[Effect], evidence: Evidence, most: int
) -> dict[str, tuple[int, ...]]:
    """Indices of the hypotheses worth fitting, by the effect's name: the best of the few effects
    with the largest predicted gains, and of every effect those whose gain cannot be predicted.
    """
    promising: dict[str, tuple[float, tuple[int, ...]]] = {}
    untold: dict[str, tuple[int, ...]] = {}
    for effect in effects:
        hypotheses = effect.hypotheses(fit.model.experiment, evidence)
        gains = _promised(fit, hypotheses)
        best = max((gain for gain in gains if gain is not None), default=0.0)
        if best > 0:
            promising[effect.name] = best, _worth_beginning(gains, NEARLY_AS_MUCH * best)
        rest = tuple(i for i, gain in enumerate(gains) if gain is None)
        if rest:
            untold[effect.name] = rest
    first = sorted(promising, key=lambda name: -promising[name][0])[:most]
    chosen = {name: promising[name][1] for name in first}
    return {name: chosen.get(name, ()) + untold.get(name, ()) for name in {**chosen, **untold}}


def _promised(fit: ConfiguredFit, hypotheses: Sequence[Hypothesis]) -> list[float | None]:
    """What each promises; other beginnings promise nothing where those before promise something."""
    gains: list[float | None] = []
    for one in hypotheses:
        needless = one.otherwise and any(gains)
        gains.append(0.0 if needless else promised_gain(fit, one))
    return gains


def _worth_beginning(gains: Sequence[float | None], enough: float) -> tuple[int, ...]:
    """Indices of the hypotheses of one effect that promise enough: the best, and others spread
    evenly over the rest, as one that begins elsewhere may end elsewhere.
    """
    able = {i: gain for i, gain in enumerate(gains) if gain is not None and gain >= enough}
    best = sorted(able, key=lambda i: -able[i])[:BEST_BEGINNINGS]
    rest = [i for i in able if i not in best]
    spread = np.linspace(0, len(rest) - 1, min(OTHER_BEGINNINGS, len(rest))).round().astype(int)
    return tuple(sorted(best + [rest[k] for k in spread]))


def promised_gain(fit: ConfiguredFit, hypothesis: Hypothesis) -> float | None:
    """Gain in ln likelihood predicted for a hypothesis, to second order in its sizes, everything
    else re-fitted. None where it cannot be predicted: its sizes cannot be 0, or the expectation
    does not change with them to first order.

    Rao 1948 (Proc. Camb. Phil. Soc. 44, 50): half of gᵀ I⁻¹ g with the slope g at none and the
    information I that is left of it.
    """
    if already_free(fit.model.parameters, hypothesis.parameters):
        return 0.0
    alone = replace(
        fit.model,
        experiment=replace(fit.model, experiment=hypothesis.experiment).described(fit.theta),
        parameters=hypothesis.parameters,
    )
    none = _none(fit, alone)
    if none is None:
        return None
    model, before, size = fit.model, len(fit.theta), len(none)
    try:
        added = slopes(alone, np.append(fit.theta[: model.plateaus], none), fit.expected)
    except FitError:
        return None
    larger = replace(
        model,
        experiment=hypothesis.experiment,
        parameters=(*model.parameters, *hypothesis.parameters),
    )
    both = [
        _with_last(one, other, before, size) for one, other in zip(fit.slopes, added, strict=True)
    ]
    theta = np.append(fit.theta, none)
    gradient = gradient_of(larger, model.data, theta, fit.expected, both)[before:]
    information = information_of(larger, theta, fit.expected, both)
    whole = np.diag(information)[before:]
    if not np.any(whole > 0):
        return None
    with_others = information[before:, :before]
    left = information[before:, before:] - with_others @ fit.covariance @ with_others.T
    # what all else can do as well has next to no information left
    seen = (whole > 0) & (np.diag(left) > LEAST_LEFT * whole)
    one_sided = np.array([parameter.lower == 0 for parameter in hypothesis.parameters])
    return _highest(gradient, left, seen & ~(one_sided & (gradient <= 0)), one_sided)


def _none(fit: ConfiguredFit, alone: ConfiguredModel) -> FloatArray | None:
    """Sizes at which a hypothesis changes nothing, its other parameters where they begin, or those
    too at nought; None where there are none.
    """
    starts = [
        [0.0 if p.lower == 0 or p.start == 0 else p.start for p in alone.parameters],
        [0.0 if p.lower <= 0 <= p.upper else p.start for p in alone.parameters],
    ]
    for none in starts if alone.parameters else []:
        try:
            expected = alone.all_expected(np.append(fit.theta[: fit.model.plateaus], none))
        except FitError:
            continue
        if all(_same(one, other) for one, other in zip(expected, fit.expected, strict=True)):
            return np.array(none)
    return None


def _same(one: Expectation, other: Expectation) -> bool:
    return bool(
        np.allclose(one.random_power, other.random_power, rtol=SAME, atol=0.0)
        and np.allclose(one.extension_nm, other.extension_nm, rtol=SAME, atol=0.0)
    )


def _highest(
    gradient: FloatArray,
    information: FloatArray,
    free: NDArray[np.bool_],
    one_sided: NDArray[np.bool_],
) -> float:
    """The highest point of a parabola, in nats, along coordinates that are free; those of one side
    that would leave it are not.
    """
    while free.any():
        index = np.flatnonzero(free)
        scale = np.sqrt(np.diag(information)[index])
        inner = information[np.ix_(index, index)] / np.outer(scale, scale)
        step = np.linalg.lstsq(inner, gradient[index] / scale, rcond=1e-9)[0] / scale
        outside = one_sided[index] & (step < 0)
        if not outside.any():
            return float(0.5 * gradient[index] @ step)
        free = free.copy()
        free[index[outside]] = False
    return 0.0


def _with_last(mine: Slopes, other: Slopes, row: int, last: int) -> Slopes:
    """The slopes with the last few of others behind them, of coordinates from `row` on."""
    courses = [one.course for one in (mine, other) if one.course is not None]
    course = None
    if courses:
        nothing = np.zeros((len(mine.rows), courses[0].weights.shape[1]))
        held = nothing if mine.course is None else mine.course.weights
        added = nothing[:1].repeat(last, axis=0)
        if other.course is not None:
            added = other.course.weights[-last:]
        course = CourseSlopes(courses[0].shape, np.vstack([held, added]))
    return Slopes(
        [*mine.rows, *range(row, row + last)],
        np.concatenate([mine.power, other.power[-last:]]),
        np.concatenate([mine.extension_nm, other.extension_nm[-last:]]),
        mine.inverse,
        np.concatenate([mine.whitened, other.whitened[-last:]]),
        np.concatenate([mine.walked, other.walked[-last:]]),
        course,
    )
