"""Force that changes within plateaus (PHYSICS E23): in all of them alike, or in each its own way.

The form of its course is read from the height over time beforehand (`Evidence.courses`); its size
is fitted, from where it is seen there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import partial

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, Read, plain
from mtpipe.experiment.changed import changed
from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import Experiment, ForceCourse
from mtpipe.experiment.parameter import Change, Parameter
from mtpipe.ground.written_numbers import with_minus

NAME = "relative change of the force"
LARGEST, STEP = 1.0, 2e-3
# Number of kinds of course: ramp, settling and step in one plateau; no step common to all.
KINDS, COMMON_KINDS = 3, 2


def _change_all(experiment: Experiment, relative: float) -> Experiment:
    courses = [changed(c, relative_change=relative) for c in experiment.magnets.courses]
    return with_magnets(experiment, courses=tuple(courses))


def _change_one(plateau: int, experiment: Experiment, relative: float) -> Experiment:
    courses = list(experiment.magnets.courses)
    courses[plateau] = changed(courses[plateau], relative_change=relative)
    return with_magnets(experiment, courses=tuple(courses))


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if experiment.magnets.courses:
        return []
    found = []
    common = evidence.common_course
    if common.relative_change != 0:
        everywhere = with_magnets(experiment, courses=(common,) * len(experiment.rests))
        parameter = _change_of(NAME, common, _change_all)
        found.append(Hypothesis(everywhere, (parameter,), _read([common]), COMMON_KINDS))
    courses = evidence.courses
    changing = [i for i, course in enumerate(courses) if course.relative_change != 0]
    if changing:
        parameters = tuple(
            _change_of(f"{NAME}, plateau {i}", courses[i], partial(_change_one, i))
            for i in changing
        )
        there = with_magnets(experiment, courses=courses)
        # which plateaus change, and how each
        forms = math.comb(len(courses), len(changing)) * KINDS ** len(changing)
        found.append(Hypothesis(there, parameters, _read(courses[i] for i in changing), forms))
    return found


def _read(courses: Iterable[ForceCourse]) -> int:
    """How many of the courses have a time that was read from the heights."""
    return sum(course.kind != "ramp" for course in courses)


def _change_of(name: str, course: ForceCourse, change: Change) -> Parameter:
    return plain(name, "", course.relative_change, (-LARGEST, LARGEST), STEP, change)


def _alike(experiment: Experiment) -> bool:
    return len(set(experiment.magnets.courses)) == 1


def _cause(experiment: Experiment) -> str:
    courses = experiment.magnets.courses
    if _alike(experiment):
        return (
            f"the force changes by {_percent(courses[0])} during each plateau "
            f"({_words(courses[0])})"
        )
    each = ", ".join(
        f"{_percent(course)} at {rest.magnet_mm:g} mm ({_words(course)})"
        for course, rest in zip(courses, experiment.rests, strict=True)
        if course.relative_change != 0
    )
    return f"the force changes during plateaus, by {each}"


def _words(course: ForceCourse) -> str:
    if course.kind == "ramp":
        return "steadily"
    kind = "settling with a time constant of" if course.kind == "settling" else "in a step at"
    return f"{kind} {100 * course.at:.0f} % of the plateau"


def _percent(course: ForceCourse) -> str:
    return with_minus(f"{100 * course.relative_change:+.1f} %")


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    courses = experiment.magnets.courses
    if _alike(experiment):
        return [("relative_change", courses[0].relative_change, "")]
    return [
        (f"relative_change at {rest.magnet_mm:g} mm", course.relative_change, "")
        for course, rest in zip(courses, experiment.rests, strict=True)
        if course.relative_change != 0
    ]


def _by(evidence: Evidence, relative_change: float) -> Evidence:
    """The same change in all plateaus."""
    return replace(evidence, courses=(), common_course=ForceCourse(relative_change))


_REMEDY = (
    "check whether the magnets moved or settled within the plateau; record it again or cut it."
)
_READ = Read("relative_change", _by, fitted=True)
EFFECT = Effect("force_drift", _hypotheses, _cause, _strengths, remedy=_REMEDY, read=_READ)
