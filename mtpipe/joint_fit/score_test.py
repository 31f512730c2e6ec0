"""What one more number promises to gain, from one look at a fit (score test)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.description import Experiment
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.height_course import CourseSlopes
from mtpipe.joint_fit.information import gradient_of, information_of
from mtpipe.joint_fit.slopes import Slopes, slopes

Hypotheses = Callable[[Experiment, Evidence], Sequence[Hypothesis]]


def most_promising(
    fit: ConfiguredFit, effects: Sequence[Effect], evidence: Evidence, most: int
) -> list[Effect]:
    """Those few effects whose size promises most, each with its best hypothesis only, of effects
    that are none where their first parameter is 0.
    """
    found: list[tuple[float, Effect]] = []
    for effect in effects:
        each = [
            promised_gain(fit, one) for one in effect.hypotheses(fit.model.experiment, evidence)
        ]
        if each and max(each) > 0:
            best = int(np.argmax(each))
            only = replace(effect, hypotheses=partial(_only, effect.hypotheses, best))
            found.append((each[best], only))
    found.sort(key=lambda pair: -pair[0])
    return [effect for _, effect in found[:most]]


def _only(
    hypotheses: Hypotheses, which: int, experiment: Experiment, evidence: Evidence
) -> Sequence[Hypothesis]:
    return hypotheses(experiment, evidence)[which : which + 1]


def promised_gain(fit: ConfiguredFit, hypothesis: Hypothesis) -> float:
    """ln likelihood that the first parameter of a hypothesis would gain, were what it changes
    small, whatever else is fitted following; the others stay where they begin.

    Rao 1948 (Proc. Camb. Phil. Soc. 44, 50): half the square of the slope at none, over the
    information that is left of it.
    """
    model, size = fit.model, hypothesis.parameters[0]
    taken = {parameter.name for parameter in model.parameters}
    if taken & {parameter.name for parameter in hypothesis.parameters}:
        return 0.0
    larger = replace(model, experiment=hypothesis.experiment, parameters=(*model.parameters, size))
    alone = replace(
        larger, experiment=larger.described(np.append(fit.theta, 0.0)), parameters=(size,)
    )
    forces = fit.theta[: model.plateaus]
    try:
        added = slopes(alone, np.append(forces, 0.0), fit.expected)
    except FitError:
        return 0.0
    row = len(fit.theta)
    both = [_with_last(one, other, row) for one, other in zip(fit.slopes, added, strict=True)]
    theta = np.append(fit.theta, 0.0)
    gradient = gradient_of(larger, model.data, theta, fit.expected, both)[-1]
    if size.lower >= 0 and gradient <= 0:
        return 0.0
    information = information_of(larger, theta, fit.expected, both)
    known = information[-1, :-1]
    left = information[-1, -1] - known @ fit.covariance @ known
    # what all else can do as well has next to no information left
    least = 1e-6 * information[-1, -1]
    return 0.0 if left <= least else float(0.5 * gradient**2 / left)


def _with_last(mine: Slopes, other: Slopes, row: int) -> Slopes:
    """The slopes with the last of others behind them, of coordinate `row`."""
    course = mine.course
    if course is not None:
        last = np.zeros(course.weights.shape[1])
        if other.course is not None:
            last = other.course.weights[-1]
        course = CourseSlopes(course.shape, np.vstack([course.weights, last]))
    return Slopes(
        [*mine.rows, row],
        np.concatenate([mine.power, other.power[-1:]]),
        np.append(mine.extension_nm, other.extension_nm[-1]),
        mine.inverse,
        np.concatenate([mine.whitened, other.whitened[-1:]]),
        np.concatenate([mine.walked, other.walked[-1:]]),
        course,
    )
