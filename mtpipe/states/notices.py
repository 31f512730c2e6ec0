"""What is said of plateaus that are not one state, or not where the log has them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mtpipe.ground.notice import Notice
from mtpipe.recording.recording import Plateau, Recording
from mtpipe.states.change import Change
from mtpipe.states.lag import Lag
from mtpipe.states.motion import Motion
from mtpipe.states.single_bead import Alone
from mtpipe.states.size import force_change, heights_contradicted, heights_go_both_ways
from mtpipe.states.trend import MOST_BIAS, Trend

LAG, HIDDEN, LEFT_OUT = "magnet_log_lag", "hidden_step", "plateau_left_out"
HEIGHT, ALONE, LONE, TREND = "height_step", "bead_changes", "lone_change", "force_trend"
ALONE_REASON = "the bead changes within the plateau while the others do not"
LONE_REASON = (
    "the bead changes within the plateau, and no other bead shows whether the force changes"
)
TREND_REASON = "the force drifts so far within the plateau that no single force describes it"
Rows = tuple[int, int]


def lag_notices(
    recording: Recording, motion: Motion, lag: Lag, moved: Sequence[Plateau | None]
) -> list[Notice]:
    """Size and error of the lag, how many plateaus it concerned, and what it did to forces."""
    seen = sum(one.seen for one in lag.edges)
    said = []
    common = bool(np.any(np.delete(lag.shift, _places(recording, lag)) != 0))
    if common and lag.per_row == 0:
        said.append(
            f"the magnets' log is {_late(lag.common)} by {abs(motion.rows_s(lag.common)):.2f} ± "
            f"{motion.rows_s(lag.common_error):.2f} s, judged by how the beads move at {seen} moves"
        )
    elif common:
        first, last = motion.rows_s(lag.shift[0]), motion.rows_s(lag.shift[-1])
        said.append(
            f"the magnets' log runs on another clock: the beads change {_offset(first)} at the "
            f"first move and {_offset(last)} at the last"
        )
    for place in _places(recording, lag):
        shift, error = motion.rows_s(lag.shift[place]), motion.rows_s(lag.error[place])
        at = float(recording.time_s[recording.plateaus[place].stop - 1])
        said.append(
            f"at the move at {at:.1f} s the beads change {_offset(shift)} (± {error:.2f} s)"
        )
    text = "; ".join(said)
    message = f"{text[0].upper()}{text[1:]}. Plateaus are cut where the beads change"
    effects = [
        percent
        for before, after in zip(recording.plateaus, moved, strict=True)
        if after is not None and (after.start, after.stop) != (before.start, before.stop)
        if (percent := mixed_percent(motion, before, after)) is not None
    ]
    if effects:
        low, high = min(effects), max(effects)
        message += (
            f" ({len(effects)} plateaus); cut by the log, their forces would be off by {low:+.0f} "
            f"to {high:+.0f} %"
        )
    notices = [Notice(LAG, "caution", message + ".")]
    gone = [before for before, after in zip(recording.plateaus, moved, strict=True) if not after]
    return notices + [
        _left_out(
            motion,
            one.start,
            one.stop,
            "the beads change while the log says that the magnets stand still",
        )
        for one in gone
    ]


def part_notices(
    motion: Motion,
    plateau: Plateau,
    changes: Sequence[Change],
    parts: Sequence[Rows],
    kept: Sequence[Rows],
    number: int,
) -> list[Notice]:
    """Changes of the force that the log does not show, and what is left out for them.

    Parameters
    ----------
    parts, kept : rows of what the changes leave of the plateau, and of those that are long enough.
    number : of the first that is kept.
    """
    said: list[Notice] = []
    position = "" if plateau.magnet_mm is None else f" at {plateau.magnet_mm:.4g} mm"
    for change, before, after in zip(changes, parts[:-1], parts[1:], strict=True):
        if before not in kept or after not in kept:
            continue
        sides = motion, slice(*before), slice(*after)
        ratio, error = force_change(*sides)
        sideways = f"{100 * math.expm1(ratio):+.0f} ± {100 * error * math.exp(ratio):.0f} %"
        at = f"{motion.time_s[change.row]:.2f} s"
        both_ways = heights_go_both_ways(*sides)
        if both_ways or heights_contradicted(*sides):
            told = _no_force(at, sideways, both_ways) + (
                f" The plateau{position} is cut there; forces of both parts rest on their own "
                "heights."
            )
            said.append(Notice(HEIGHT, "caution", told, plateau=number))
            continue
        told = (
            f"All beads change together at {at}, where the magnets' log shows no move; by their "
            f"sideways motion the force changes by {sideways}. The plateau{position} is cut "
            "there, and its magnet position is not trusted."
        )
        said.append(Notice(HIDDEN, "caution", told, plateau=number))
    for start, stop in parts:
        if (start, stop) not in kept:
            said.append(_left_out(motion, start, stop, "all beads change together before or after"))
    return said


def _no_force(at: str, sideways: str, both_ways: bool) -> str:
    if both_ways:
        return (
            f"The heights of beads change at {at}, up for some and down for others, which no force "
            f"does (sideways {sideways}): focus, references or the beads themselves moved."
        )
    return (
        f"The heights of all beads change together at {at}, but their sideways motion does not "
        f"change as a force would make it ({sideways}): focus or reference moved."
    )


def _left_out(motion: Motion, start: int, stop: int, why: str) -> Notice:
    told = (
        f"{motion.rows_s(max(stop - start, 0)):.2f} s from {motion.time_s[start]:.2f} s on are "
        f"not used: {why}, and this piece is too short ([plateaus] minimum_s)."
    )
    return Notice(LEFT_OUT, "info", told)


def alone_notice(motion: Motion, one: Alone) -> Notice:
    """A bead that changes for good within a plateau, alone."""
    at = motion.time_s[one.change.row]
    left = motion.rows_s(one.left_out[1] - one.left_out[0])
    done = (
        "Too little is left of the plateau for a force of this bead."
        if one.whole
        else f"The shorter part of the plateau, {left:.3g} s, is left out."
    )
    told = (
        f"It changes for good at {at:.2f} s while the other beads do not: it lets go, sticks or is "
        f"shortened. {done}"
    )
    return Notice(ALONE, "caution", told, bead=one.bead, plateau=one.plateau.number)


def lone_notice(motion: Motion, bead: str, plateau: int, changes: Sequence[Change]) -> Notice:
    """The only bead of a recording changes within a plateau."""
    times = " and ".join(f"{motion.time_s[change.row]:.2f} s" for change in changes)
    told = (
        f"The bead changes at {times}, and no other bead shows whether the force changes. Do not "
        "use its force in this plateau unless the cross-check names what changes."
    )
    return Notice(LONE, "caution", told, bead=bead, plateau=plateau)


def trend_notice(trend: Trend) -> Notice:
    """A force that drifts within a plateau."""
    told = (
        f"The force drifts by {100 * math.expm1(trend.log_change):+.0f} ± "
        f"{100 * trend.stderr:.0f} % during the plateau, by the beads' sideways motion."
    )
    if trend.bias > MOST_BIAS:
        told += " Its force is not to be used unless the cross-check says what changes."
    return Notice(TREND, "caution", told, plateau=trend.plateau.number)


def mixed_percent(motion: Motion, before: Plateau, after: Plateau) -> float | None:
    """By how much the force of a plateau as the log has it is off, in percent."""
    logs = _logs(motion, slice(before.start, before.stop), slice(after.start, after.stop))
    return 100 * math.expm1(-float(np.median(logs))) if logs else None


def _logs(motion: Motion, before: slice, after: slice) -> list[float]:
    logs = []
    for xyz in motion.position_nm.values():
        for axis in (0, 1):
            one, other = xyz[before, axis], xyz[after, axis]
            if min(np.isfinite(one).sum(), np.isfinite(other).sum()) > 2:
                variances = float(np.nanvar(one)), float(np.nanvar(other))
                if min(variances) > 0:
                    logs.append(math.log(variances[0] / variances[1]))
    return logs


def _places(recording: Recording, lag: Lag) -> list[int]:
    """Where among the edges those with a lag of their own are."""
    return [i for i, one in enumerate(recording.plateaus[:-1]) if one.number in lag.own]


def _late(rows: float) -> str:
    return "early" if rows > 0 else "late"


def _offset(seconds: float) -> str:
    return f"{abs(seconds):.2f} s {'after' if seconds > 0 else 'before'} the log"
