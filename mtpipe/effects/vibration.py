"""A narrow mechanical or mains line, at its own or an aliased frequency (PHYSICS E9)."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, Read, logarithm, variance
from mtpipe.experiment.changed import changed, with_root
from mtpipe.experiment.changes import with_stage
from mtpipe.experiment.description import Experiment, Line
from mtpipe.experiment.parameter import Parameter

LARGEST_NM = 500.0
START_NM = 1.0
# Coherence time of a line whose phase diffuses: start of the fit (s), and its least value, 1 s or
# three periods. What loses its phase faster is noise and no line (its peak is wider than a tenth of
# its frequency). From a thousand times the least value on the phase is as good as steady.
START_S, LEAST_S, FEWEST_COHERENT, LONGEST = 5.0, 1.0, 3.0, 1e3
# Least periods of a line in the longest plateau for lines to be fitted together: a few slow ones
# imitate slow motion of any kind.
FEWEST_PERIODS = 100


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    """Hypotheses of each line alone and of the strongest together, phases steady or diffusing."""
    if experiment.stage.lines:
        return []
    longest_s = experiment.camera.frame_s * max(
        (rest.frames for rest in experiment.rests), default=0
    )
    narrow = tuple(hz for hz in evidence.lines_hz if hz * longest_s > FEWEST_PERIODS)
    together = [narrow[:number] for number in range(2, len(narrow) + 1)]
    return [
        _of_lines(experiment, lines_hz, coherence_s)
        for lines_hz in [*((line_hz,) for line_hz in evidence.lines_hz), *together]
        for coherence_s in (math.inf, START_S)
    ]


def _of_lines(
    experiment: Experiment, lines_hz: tuple[float, ...], coherence_s: float
) -> Hypothesis:
    lines, parameters = [], list[Parameter]()
    for number, hz in enumerate(lines_hz):
        parameters += [_along(number, axis) for axis in range(3)]
        least_s = max(LEAST_S, FEWEST_COHERENT / hz)
        begun_s = max(coherence_s, 2 * least_s)
        lines.append(Line(hz, (START_NM, START_NM, START_NM), begun_s))
        if math.isfinite(coherence_s):
            parameters.append(_coherence(number, begun_s, least_s))
    changed = with_stage(experiment, lines=tuple(lines))
    return Hypothesis(changed, tuple(parameters), read=len(lines))


def _along(number: int, axis: int) -> Parameter:
    name = f"amplitude{_of_line(number)} along {'xyz'[axis]}"
    return variance(name, "nm", START_NM, LARGEST_NM, partial(_change, number, axis))


def _coherence(number: int, begun_s: float, least_s: float) -> Parameter:
    change, bounds = partial(_with_coherence, number), (least_s, LONGEST * least_s)
    return logarithm(f"coherence{_of_line(number)}", "s", begun_s, bounds, change)


def _of_line(number: int) -> str:
    return f" of line {number + 1}" if number else ""


def _change(number: int, axis: int, experiment: Experiment, square: float) -> Experiment:
    size = with_root(experiment.stage.lines[number].amplitude_nm, axis, square)
    return _with(experiment, number, amplitude_nm=size)


def _with_coherence(number: int, experiment: Experiment, coherence_s: float) -> Experiment:
    return _with(experiment, number, coherence_s=coherence_s)


def _with(experiment: Experiment, number: int, **changes: Any) -> Experiment:
    lines = list(experiment.stage.lines)
    lines[number] = changed(lines[number], **changes)
    return with_stage(experiment, lines=tuple(lines))


def _cause(experiment: Experiment) -> str:
    first, *others = (_of_one(line) for line in experiment.stage.lines)
    also = "".join(f", and at {other}" for other in others)
    return f"something vibrates at {first}{also} (as recorded; it may be an alias)"


def _of_one(line: Line) -> str:
    x, y, z = line.amplitude_nm
    steady = "" if math.isinf(line.coherence_s) else f", steady for {line.coherence_s:.2g} s"
    return f"{line.frequency_hz:.2f} Hz{steady}, by {x:.1f}, {y:.1f} and {z:.1f} nm in x, y and z"


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    found: list[tuple[str, float, str]] = []
    for number, line in enumerate(experiment.stage.lines):
        of_line = f"_{number + 1}" if number else ""
        found.append((f"line{of_line}_hz", line.frequency_hz, "Hz"))
        for axis, size_nm in zip("xyz", line.amplitude_nm, strict=True):
            found.append((f"amplitude{of_line}_{axis}_nm", size_nm, "nm"))
        if math.isfinite(line.coherence_s):
            found.append((f"coherence{of_line}_s", line.coherence_s, "s"))
    return found


def _at(evidence: Evidence, line_hz: float) -> Evidence:
    return replace(evidence, lines_hz=(line_hz,))


_REMEDY = "look for a pump, fan or mains line of this frequency near the microscope."
_READ = Read("line_hz", _at)
EFFECT = Effect("vibration", _hypotheses, _cause, _strengths, remedy=_REMEDY, read=_READ)
