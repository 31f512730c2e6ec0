"""Every plateau of a recording tested for being one state, and cut where it is not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mtpipe.ground.notice import Notice
from mtpipe.ground.processes import in_one_thread
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import Plateau, Recording, States
from mtpipe.states.change import Change, strongest_change
from mtpipe.states.edges import edges_of
from mtpipe.states.focus import cut_at_focus_moves
from mtpipe.states.lag import Lag, find_lag
from mtpipe.states.motion import Motion, motion_of
from mtpipe.states.moved import moved_plateaus
from mtpipe.states.notices import (
    ALONE_REASON,
    HIDDEN,
    LONE_REASON,
    TREND_REASON,
    alone_notice,
    lag_notices,
    lone_notice,
    part_notices,
    trend_notice,
)
from mtpipe.states.single_bead import Alone, changes_alone
from mtpipe.states.trend import MOST_BIAS, force_trend

# Chance per recording, all places tried, of a false change.
CHANCE_PER_RECORDING = 1e-3
# Of one bead without another, up to two changes in a plateau may be changes of the force; more are
# its own: it hops or sticks.
MOST_ALONE = 2


def with_states(recording: Recording) -> Recording:
    """The recording with plateaus that are each one state.

    Parameters
    ----------
    recording : drift already subtracted, if it is to be.

    Returns
    -------
    The same where it was tested before. Else with `states`, with notices of what was found, and,
    only where something was, with plateaus cut and numbered anew.
    """
    if recording.states is not None:
        return recording
    if not recording.plateaus or not recording.tethered:
        return replace(recording, states=States())
    return in_one_thread(_tested, recording)


def _tested(recording: Recording) -> Recording:
    motion = motion_of(recording)
    lag = find_lag(motion, edges_of(recording.plateaus, recording.magnet_mm))
    least = recording.setup.plateaus.minimum_s
    plateaus, notices = _by_the_beads(recording, motion, lag)
    plateaus, moved = cut_at_focus_moves(motion, plateaus, least)
    notices += moved
    cut: list[Plateau] = []
    unbelieved: list[int] = []
    doubtful: dict[tuple[str, int], str] = {}
    limit = math.log(CHANCE_PER_RECORDING / len(plateaus))
    for plateau in plateaus:
        changes = _changes(motion, plateau.start, plateau.stop, limit)
        if changes and len(recording.tethered) == 1:
            # one bead does not say whether it is the force that changes
            if len(changes) <= MOST_ALONE:
                doubtful[recording.tethered[0], len(cut)] = LONE_REASON
                notices.append(lone_notice(motion, recording.tethered[0], len(cut), changes))
            changes = []
        parts = _parts(plateau, changes)
        kept = [one for one in parts if lasts_s(recording, *one) >= least] if changes else parts
        numbers = range(len(cut), len(cut) + len(kept))
        said = part_notices(motion, plateau, changes, parts, kept, len(cut))
        if any(notice.code == HIDDEN for notice in said):
            unbelieved += numbers
        notices += said
        cut += [
            replace(plateau, number=number, start=start, stop=stop)
            for number, (start, stop) in zip(numbers, kept, strict=True)
        ]
    alone = changes_alone(motion, cut, least, math.log(CHANCE_PER_RECORDING / len(plateaus)))
    notices += [alone_notice(motion, one) for one in alone]
    trends = [trend for plateau in cut if (trend := force_trend(motion, plateau)) is not None]
    notices += [trend_notice(trend) for trend in trends]
    refused = {(one.bead, one.plateau.number): ALONE_REASON for one in alone if one.whole}
    doubtful |= {
        (bead, trend.plateau.number): TREND_REASON
        for trend in trends
        if trend.bias > MOST_BIAS
        for bead in recording.tethered
    }
    return replace(
        recording,
        positions_nm=_without(recording.positions_nm, alone),
        plateaus=tuple(cut),
        notices=(*recording.notices, *notices),
        states=States(refused, doubtful, frozenset(unbelieved)),
    )


def _without(
    positions_nm: Mapping[str, FloatArray], alone: Sequence[Alone]
) -> Mapping[str, FloatArray]:
    """Positions without those of beads that are in another state than in the rest of a plateau."""
    blanked = {one.bead: positions_nm[one.bead].copy() for one in alone if not one.whole}
    for one in alone:
        if not one.whole:
            blanked[one.bead][slice(*one.left_out)] = np.nan
    return {**positions_nm, **blanked}


def _by_the_beads(
    recording: Recording, motion: Motion, lag: Lag | None
) -> tuple[tuple[Plateau, ...], list[Notice]]:
    """Plateaus between the moves as the beads show them, and what is to be said of the log."""
    if lag is None or not lag.wrong:
        return recording.plateaus, []
    moved = moved_plateaus(recording, lag)
    kept = tuple(plateau for plateau in moved if plateau is not None)
    return kept, lag_notices(recording, motion, lag, moved)


def _changes(motion: Motion, start: int, stop: int, limit: float) -> list[Change]:
    """Changes of the force within a stretch, in time order."""
    found = strongest_change(motion, start, stop, limit)
    if found is None:
        return []
    before = _changes(motion, start, max(found.low, start), limit)
    after = _changes(motion, min(found.high, stop), stop, limit)
    return [*before, found, *after]


def _parts(plateau: Plateau, changes: list[Change]) -> list[tuple[int, int]]:
    """Rows of what changes leave of a plateau."""
    starts = [plateau.start, *(change.high for change in changes)]
    stops = [*(change.low for change in changes), plateau.stop]
    return list(zip(starts, stops, strict=True))


def lasts_s(recording: Recording, start: int, stop: int) -> float:
    """Seconds that rows [start, stop) last."""
    if stop <= start:
        return 0.0
    frame_s = (recording.time_s[-1] - recording.time_s[0]) / (len(recording.time_s) - 1)
    return float(recording.time_s[stop - 1] - recording.time_s[start] + frame_s)
