"""Force that changes within plateaus (PHYSICS E23): in all of them alike, or in each its own way.

Spectra and mean heights, which are what is fitted, tell little more than that there is a change.
Its direction and course are read from the height over time beforehand (`Evidence.courses`), and
its size, far better known from there, enters as prior knowledge.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, SeenCourse, plain
from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import Experiment, ForceCourse
from mtpipe.experiment.parameter import Parameter

NAME = "relative change of the force"
START, LARGEST, STEP = 0.15, 1.0, 2e-3
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
    seen = evidence.courses
    rising = sum(one.course.relative_change for one in seen) >= 0
    found = []
    for course in (ForceCourse(), ForceCourse(kind="settling", at=SETTLING_SHARE)):
        everywhere = with_magnets(experiment, courses=(course,) * len(experiment.rests))
        size = (START, (0.0, LARGEST)) if rising else (-START, (-LARGEST, 0.0))
        found.append(Hypothesis(everywhere, (plain(NAME, "", *size, STEP, _change_all),)))
    changing = [i for i, one in enumerate(seen) if one.course.relative_change != 0]
    if changing:
        courses = tuple(one.course for one in seen)
        parameters = tuple(_of_plateau(i, seen[i]) for i in changing)
        found.append(Hypothesis(with_magnets(experiment, courses=courses), parameters))
    return found


def _of_plateau(plateau: int, seen: SeenCourse) -> Parameter:
    size = seen.course.relative_change
    return Parameter(
        f"{NAME}, plateau {plateau}", "", size, -LARGEST, LARGEST, STEP, (size, seen.stderr),
        partial(_change_one, plateau),
    )  # fmt: skip


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
