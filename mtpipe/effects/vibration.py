"""A narrow mechanical or mains line, at its own or an aliased frequency (PHYSICS E9)."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, logarithm, variance
from mtpipe.experiment.changes import with_stage
from mtpipe.experiment.description import Experiment, Line
from mtpipe.experiment.parameter import Parameter

LARGEST_NM = 500.0
START_NM = 1.0
# How long a phase lasts that is seen to diffuse; what keeps it for less is no narrow line.
START_S, COHERENCES_S = 5.0, (1.0, 1e3)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    """Of each line a wave with a steady phase, and one whose phase diffuses."""
    found = []
    number = len(experiment.stage.lines)
    for frequency in evidence.lines_hz:
        sizes = tuple(_along(number, i, name) for i, name in enumerate("xyz"))
        for coherence_s in (math.inf, START_S):
            line = Line(frequency, (START_NM, START_NM, START_NM), coherence_s)
            changed = with_stage(experiment, lines=(*experiment.stage.lines, line))
            diffusing = () if math.isinf(coherence_s) else (_coherence(number),)
            found.append(Hypothesis(changed, (*sizes, *diffusing), read=1))
    return found


def _along(number: int, axis: int, name: str) -> Parameter:
    change = partial(_change, number, axis)
    return variance(f"amplitude along {name}", "nm", START_NM, LARGEST_NM, change)


def _coherence(number: int) -> Parameter:
    change = partial(_with_coherence, number)
    return logarithm("coherence of the line", "s", START_S, COHERENCES_S, change)


def _change(number: int, axis: int, experiment: Experiment, square: float) -> Experiment:
    size = list(experiment.stage.lines[number].amplitude_nm)
    size[axis] = math.sqrt(max(square, 0.0))
    return _with(experiment, number, amplitude_nm=(size[0], size[1], size[2]))


def _with_coherence(number: int, experiment: Experiment, coherence_s: float) -> Experiment:
    return _with(experiment, number, coherence_s=coherence_s)


def _with(experiment: Experiment, number: int, **changes: Any) -> Experiment:
    lines = list(experiment.stage.lines)
    lines[number] = replace(lines[number], **changes)
    return with_stage(experiment, lines=tuple(lines))


def _cause(experiment: Experiment) -> str:
    line = experiment.stage.lines[-1]
    x, y, z = line.amplitude_nm
    steady = "" if math.isinf(line.coherence_s) else f", steady for {line.coherence_s:.2g} s"
    return (
        f"something vibrates at {line.frequency_hz:.2f} Hz (or at a frequency that is recorded "
        f"there){steady}, {x:.1f}, {y:.1f} and {z:.1f} nm in x, y and z"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    line = experiment.stage.lines[-1]
    sizes = [(f"amplitude_{a}_nm", v, "nm") for a, v in zip("xyz", line.amplitude_nm, strict=True)]
    lasting = [("coherence_s", line.coherence_s, "s")] if math.isfinite(line.coherence_s) else []
    return [("line_hz", line.frequency_hz, "Hz"), *sizes, *lasting]


EFFECT = Effect("vibration", _hypotheses, _cause, _strengths)
