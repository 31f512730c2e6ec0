"""Where z = 0 is for each bead, as the setup's `z_zero` says.

A value is subtracted as it stands. A stretch in which the bead touches the surface gives the edge
of its distribution there (`edge`), after stage drift is taken out with the reference beads, as
the stretch and the plateaus lie at different times.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.collect import RowChoice
from mtpipe.ingest.edge import lower_edge_nm
from mtpipe.recording.recording import Recording
from mtpipe.setup.source_signals import ZZero
from mtpipe.setup.source_table import Source

START_S = 1.0
# What separates the edge of a distribution from the surface beyond statistics: the estimate of the
# edge is off by 3 to 4 nm on simulated touches (workflows/sample_data), and stages drift.
EDGE_ALLOWANCE_NM = 5.0


def put_surface_at_zero(recording: Recording) -> Recording:
    """Shift z of every bead so that the surface is at 0, as the setup's `z_zero` says.

    Reading does so with drift taken out for the purpose; after `subtract_drift` it may be done
    again, which corrects for what the two took as the drift's beginning (some nm). Canonical
    recordings, whose z is the extension already, come back unchanged.

    Raises
    ------
    RecordingError : the stretch of touching is outside the recording or holds too few values.
    """
    surface = find_surface(recording)
    positions = dict(recording.positions_nm)
    for bead, height in surface.height_nm.items():
        positions[bead] = positions[bead] - np.array([0.0, 0.0, height])
    new = tuple(n for n in surface.notices if n not in recording.notices)
    return dataclasses.replace(
        recording,
        positions_nm=positions,
        notices=recording.notices + new,
        z_zero_stderr_nm=surface.stderr_nm,
    )


@dataclasses.dataclass(frozen=True)
class Surface:
    """Where the surface is for each bead.

    `height_nm` is the z at which a recording has it, for the beads that need a shift; `stderr_nm`
    its standard error, infinite where it is unknown.
    """

    height_nm: dict[str, float]
    stderr_nm: dict[str, float]
    notices: tuple[Notice, ...]


def find_surface(recording: Recording) -> Surface:
    """Where z = 0 is for each bead; nothing to say about a canonical recording.

    A recording that mtpipe tracked has heights in a look-up table, and is not canonical in that.
    """
    source = recording.setup.source
    in_table = recording.tracked.table_height if recording.tracked is not None else frozenset()
    if (source is None or not source.beads) and not in_table:
        return Surface({}, {}, ())
    source = source if source is not None else Source()
    heights: dict[str, float] = {}
    errors: dict[str, float] = {}
    notices: list[Notice] = []
    unknown: list[str] = []
    drift = _stage_nm(recording) if recording.drift is None else np.zeros(1)
    for bead in recording.tethered:
        if not source.beads and bead not in in_table:
            continue
        z = recording.positions_nm[bead][:, 2]
        if not np.isfinite(z).any():
            continue
        choice = source.z_zero_of.get(bead, source.z_zero)
        if choice is None or choice.unknown:
            unknown.append(bead)
            errors[bead] = math.inf
        elif choice.value_nm is not None:
            if recording.drift is None:  # a fixed value is subtracted once, on reading
                heights[bead] = choice.value_nm
        else:
            rows = _stretch(recording, source, choice)
            try:
                edge, stderr = lower_edge_nm((z - drift)[rows])
            except ValueError as error:
                raise RecordingError(
                    f"where bead {bead} touches the surface: {error}",
                    mend="Choose another stretch in [source.z_zero], or unknown = true.",
                ) from None
            heights[bead] = edge
            stderr = errors[bead] = math.hypot(stderr, EDGE_ALLOWANCE_NM)
            if recording.drift is None:
                said = f"z = 0 from the edge of its distribution, to {stderr:.2g} nm."
                notices.append(Notice("z_zero_from_touch", "info", said, bead=bead))
    if unknown:
        beads = f"bead {unknown[0]}" if len(unknown) == 1 else f"{len(unknown)} beads"
        said = (
            f"Where z = 0 is for {beads} is unknown ([source.z_zero]): z is left as it stands in "
            "the file, and there is neither an extension nor a force."
        )
        only = unknown[0] if len(unknown) == 1 else None
        notices.append(Notice("z_zero_unknown", "warning", said, bead=only))
    return Surface(heights, errors, tuple(notices))


def off_the_surface(recording: Recording) -> tuple[Recording, tuple[Notice, ...]]:
    """A recording without the plateaus in which its beads lie on the surface to tell z = 0.

    A bead that touches the surface is not on its tether alone, and has no force to measure. What
    lies there by more than half is left out if the setup says so, unless nothing else is there.
    """
    source = recording.setup.source or Source()
    choice = source.z_zero
    if choice is None or not choice.no_plateau or choice.unknown or choice.value_nm is not None:
        return recording, ()
    down = _stretch(recording, source, choice)
    left = [
        one
        for one in recording.plateaus
        if 2 * (min(one.stop, down.stop) - max(one.start, down.start)) <= one.stop - one.start
    ]
    gone = len(recording.plateaus) - len(left)
    if not left or not gone:
        return recording, ()
    plateaus = tuple(dataclasses.replace(one, number=k) for k, one in enumerate(left))
    said = (
        f"{gone} of {len(recording.plateaus)} rests of the magnets lie in the stretch in which "
        "the beads touch the surface ([source.z_zero]), and are no plateaus."
    )
    told = Notice("touching_left_out", "info", said)
    return dataclasses.replace(recording, plateaus=plateaus), (told,)


def z_zero_time_s(recording: Recording, bead: str) -> float:
    """When z = 0 is at the surface: while a bead touches it, else at the recording's beginning."""
    source = recording.setup.source or Source()
    choice = source.z_zero_of.get(bead, source.z_zero)
    if choice is None or choice.unknown or choice.value_nm is not None:
        return float(recording.time_s[0])
    return float(np.mean(recording.time_s[_stretch(recording, source, choice)]))


def _stage_nm(recording: Recording) -> FloatArray:
    """Motion of the reference beads in z since the recording's first second; 0 without any."""
    n = len(recording.time_s)
    begin = int(np.searchsorted(recording.time_s, recording.time_s[0] + START_S, side="right"))
    total, count = np.zeros(n), 0
    for bead in recording.references:
        z = recording.positions_nm[bead][:, 2]
        known = np.flatnonzero(np.isfinite(z))
        if len(known):
            first = int(known[0])
            total += z - np.nanmedian(z[first : first + max(begin, 1)])
            count += 1
    return total / max(count, 1)


def _stretch(recording: Recording, source: Source, choice: ZZero) -> slice:
    if choice.touch_rows is not None:
        rows = RowChoice(source.keep_rows, source.skip_rows)
        first, last = choice.touch_rows
        found = slice(rows.position(first), rows.position(last + 1))
        told = f"rows {first} to {last}"
    else:
        assert choice.touch_time_s is not None
        begin, end = choice.touch_time_s
        at = np.searchsorted(recording.time_s, [begin, end])
        found = slice(int(at[0]), int(at[1]))
        told = f"{begin:g} to {end:g} s"
    if found.start >= min(found.stop, len(recording.time_s)):
        raise RecordingError(
            f"the stretch of touching ({told}) is not in the recording", mend="Correct z_zero."
        )
    return found
