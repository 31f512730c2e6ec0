"""A narrow mechanical or mains line, at its own or an aliased frequency (PHYSICS E9)."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, variance
from mtpipe.experiment.changes import with_stage
from mtpipe.experiment.description import Experiment, Line
from mtpipe.experiment.parameter import Parameter

LARGEST_NM = 500.0
START_NM = 1.0


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    found = []
    for frequency in evidence.lines_hz:
        number = len(experiment.stage.lines)
        lines = (*experiment.stage.lines, Line(frequency, (START_NM, START_NM, START_NM)))
        sizes = tuple(_along(number, i, name) for i, name in enumerate("xyz"))
        found.append(Hypothesis(with_stage(experiment, lines=lines), sizes, read=1))
    return found


def _along(number: int, axis: int, name: str) -> Parameter:
    change = partial(_change, number, axis)
    return variance(f"amplitude along {name}", "nm", START_NM, LARGEST_NM, change)


def _change(number: int, axis: int, experiment: Experiment, square: float) -> Experiment:
    lines = list(experiment.stage.lines)
    size = list(lines[number].amplitude_nm)
    size[axis] = math.sqrt(max(square, 0.0))
    lines[number] = replace(lines[number], amplitude_nm=(size[0], size[1], size[2]))
    return with_stage(experiment, lines=tuple(lines))


def _cause(experiment: Experiment) -> str:
    line = experiment.stage.lines[-1]
    x, y, z = line.amplitude_nm
    return (
        f"something vibrates at {line.frequency_hz:.2f} Hz (or at a frequency that is recorded "
        f"there), {x:.1f}, {y:.1f} and {z:.1f} nm in x, y and z"
    )


EFFECT = Effect(
    "vibration",
    _hypotheses,
    _cause,
    lambda experiment: (
        [("line_hz", experiment.stage.lines[-1].frequency_hz, "Hz")]
        + [
            (f"amplitude_{a}_nm", v, "nm")
            for a, v in zip("xyz", experiment.stage.lines[-1].amplitude_nm, strict=True)
        ]
    ),
)
