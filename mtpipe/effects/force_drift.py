"""Force that changes within plateaus (PHYSICS E23): in all of them alike, or in each its own way.

Spectra and mean heights, which are what is fitted, tell how large a change is. Its direction and
its course are read from the height over time beforehand (`Evidence.courses`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import Experiment, ForceCourse
from mtpipe.experiment.parameter import Change, Parameter

START, LARGEST = 0.15, 1.0
# Of the time constant with which a force settles where the heights do not tell.
SETTLING_SHARE = 1 / 6


def _change_all(experiment: Experiment, relative: float) -> Experiment:
    courses = [replace(c, relative_change=relative) for c in experiment.magnets.courses]
    return with_magnets(experiment, courses=tuple(courses))


def _change_one(plateau: int, experiment: Experiment, relative: float) -> Experiment:
    courses = list(experiment.magnets.courses)
    courses[plateau] = replace(courses[plateau], relative_change=relative)
    return with_magnets(experiment, courses=tuple(courses))


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if experiment.magnets.courses:
        return []
    rising = sum(course.relative_change for course in evidence.courses) >= 0
    found = []
    for course in (ForceCourse(), ForceCourse(kind="settling", at=SETTLING_SHARE)):
        everywhere = with_magnets(experiment, courses=(course,) * len(experiment.rests))
        found.append(Hypothesis(everywhere, (_parameter("", rising, START, _change_all),)))
    changing = [i for i, course in enumerate(evidence.courses) if course.relative_change != 0]
    if changing:
        parameters = tuple(
            _parameter(
                f", plateau {i}",
                evidence.courses[i].relative_change > 0,
                abs(evidence.courses[i].relative_change),
                partial(_change_one, i),
            )
            for i in changing
        )
        found.append(Hypothesis(with_magnets(experiment, courses=evidence.courses), parameters))
    return found


def _parameter(where: str, rising: bool, start: float, change: Change) -> Parameter:
    sign = 1.0 if rising else -1.0
    bounds = (0.0, LARGEST) if rising else (-LARGEST, 0.0)
    name = f"relative change of the force{where}"
    return plain(name, "", sign * min(start, LARGEST), bounds, 2e-3, change)


def _alike(experiment: Experiment) -> bool:
    return len(set(experiment.magnets.courses)) == 1


def _cause(experiment: Experiment) -> str:
    courses = experiment.magnets.courses
    if _alike(experiment):
        return (
            f"the force changes by {courses[0].relative_change:+.1%} during each plateau "
            f"({_words(courses[0])})"
        )
    each = ", ".join(
        f"{course.relative_change:+.1%} at {rest.magnet_mm:g} mm ({_words(course)})"
        for course, rest in zip(courses, experiment.rests, strict=True)
        if course.relative_change != 0
    )
    return f"the force changes during plateaus, by {each}"


def _words(course: ForceCourse) -> str:
    if course.kind == "ramp":
        return "steadily"
    kind = "settling with a time constant of" if course.kind == "settling" else "in a step at"
    return f"{kind} {course.at:.0%} of the plateau"


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    courses = experiment.magnets.courses
    if _alike(experiment):
        return [("relative_change", courses[0].relative_change, "")]
    return [
        (f"relative_change at {rest.magnet_mm:g} mm", course.relative_change, "")
        for course, rest in zip(courses, experiment.rests, strict=True)
        if course.relative_change != 0
    ]


EFFECT = Effect("force_drift", _hypotheses, _cause, _strengths)
