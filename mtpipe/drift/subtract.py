"""Drift subtraction as a step from recording to recording."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np

from mtpipe.drift.combine import combined
from mtpipe.drift.fast_z import FastShare, beyond_shared_nm, fast_share
from mtpipe.drift.grid import Grid, grid_of, piece_coefficients
from mtpipe.drift.highpass import slow_motion_nm
from mtpipe.drift.lowpass import (
    Cutoff,
    PowerBins,
    at_cutoff,
    best_cutoff,
    low_pass,
    octave_edges_hz,
    power_bins,
)
from mtpipe.drift.noise import OWN_MOTION_HZ
from mtpipe.drift.references import Assessment, assess
from mtpipe.drift.stage_moves import stage_moves_nm
from mtpipe.drift.uncorrected import course_left, left_notice
from mtpipe.ground.notice import Notice, Severity
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.surface import put_surface_at_zero
from mtpipe.recording.recording import AXES, Drift, Recording
from mtpipe.setup.tables import DriftChoice

LOST_CAUTION = 0.01
# Seconds that are averaged for the starting point of drift subtracted frame by frame: the noise of
# a single frame would shift the trace.
START_S = 0.25


def subtract_drift(recording: Recording, *, choice: DriftChoice | None = None) -> Recording:
    """Take drift off the tethered beads, and find their z = 0 again where they touch the surface.

    Where the setup names such a stretch, it tells z = 0 better once the stage stands still.

    Parameters
    ----------
    recording : as read.
    choice : default: the setup's `[drift]` table.

    Returns
    -------
    A recording whose tethered beads have the drift subtracted (from its start, so that positions
    keep their origin), whose reference beads are raw, with `drift` and further notices. Where the
    drift is unknown for longer than can be bridged, the tethered beads are NaN.

    Raises
    ------
    RecordingError : fewer than two frames, or none in the stretch of touching.
    """
    return put_surface_at_zero(_subtracted(recording, choice))


def _subtracted(recording: Recording, choice: DriftChoice | None) -> Recording:
    choice = recording.setup.drift if choice is None else choice
    if choice.method == "highpass":
        return _high_passed(recording, float(choice.cutoff_hz))
    if choice.method == "none":
        text = 'Drift was not removed, as the setup says so ([drift] method = "none").'
        return _untouched(recording, "none", Notice("drift_kept", "info", text))
    if not recording.references:
        text = (
            "No reference bead: drift was not removed, and slow motion may contain it. To remove "
            'slow motion, set [drift] method = "highpass" and cutoff_hz = <number in Hz>.'
        )
        return _untouched(recording, "reference", Notice("no_reference", "caution", text))
    return _referenced(recording, choice)


def reference_noise_nm(recording: Recording) -> dict[str, tuple[float, float, float]]:
    """White tracking noise per frame (x, y, z) of every reference bead, nm; nan where unknown."""
    return {use.bead: use.noise_nm for use in assess(recording, grid_of(recording)).uses}


def _referenced(recording: Recording, choice: DriftChoice) -> Recording:
    grid = grid_of(recording)
    found = assess(recording, grid)
    subtracted = np.zeros((len(grid.row), 3))
    notices = list(found.notices)
    cutoffs: list[float | None] = [None, None, None]
    added, start = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    beyond: dict[str, FloatArray] = {}
    for axis, name in enumerate(AXES):
        used = [u for u in found.uses if u.weight[axis] > 0]
        if not used:
            tracked = [recording.positions_nm[b][:, axis] for b in recording.tethered]
            if any(np.isfinite(t).any() for t in tracked):
                text = (
                    f"No reference bead was tracked along {name} for long enough: drift along "
                    f"{name} was not removed, and slow motion may contain it."
                )
                notices.append(Notice("no_reference", "caution", text, axis=name))
            continue
        weight = np.array([u.weight[axis] for u in used])
        noise = np.array([u.noise_nm[axis] for u in used])
        series = combined([found.axes[u.bead][axis].series_nm for u in used], weight, grid.rate_hz)
        white_nm = float(np.sqrt(np.sum((weight * noise) ** 2)))
        share = max(found.axes[u.bead][axis].own_share for u in used)
        moves = stage_moves_nm(series, grid.rate_hz)
        series = series - moves
        chosen = _cutoff(series, grid, white_nm, share, choice)
        cutoffs[axis], added[axis] = chosen.cutoff_hz, chosen.noise_added_nm
        drift = low_pass(series, grid.rate_hz, chosen.cutoff_hz)
        frames = _start_frames(grid, chosen.cutoff_hz)
        start[axis] = chosen.start_stderr_nm / math.sqrt(frames)
        subtracted[:, axis] = (drift - _start(drift, frames) + moves)[grid.row]
        if name == "z":
            for bead in recording.tethered:
                z = grid.series_nm(recording, bead, axis) - moves
                found_share = fast_share(z, series, white_nm, grid, chosen.cutoff_hz)
                if found_share is not None:
                    beyond[bead] = beyond_shared_nm(found_share, drift, grid)[grid.row]
                    notices.append(_share_notice(bead, found_share))
    lost = int(np.sum(np.isnan(subtracted).any(axis=1)))
    if lost:
        notices.append(_lost_notice(lost, len(grid.row)))
    result = _with_drift(
        recording, found, choice, cutoffs, subtracted, added, start, beyond, notices
    )
    return result if any(use.weight[2] > 0 for use in found.uses) else _with_left(result, recording)


def _cutoff(
    series: FloatArray, grid: Grid, white_nm: float, own_share: float, choice: DriftChoice
) -> Cutoff:
    """The low-pass asked for, or the best one for what is left in the plateaus."""
    known = np.isfinite(series)
    pieces = grid.known_pieces(known)
    asked = None if choice.cutoff_hz in ("auto", "none") else float(choice.cutoff_hz)
    if not pieces or math.isnan(white_nm):
        return Cutoff(asked, math.nan, math.nan)
    found = piece_coefficients(series, pieces, known)
    edges = octave_edges_hz([len(c) for c in found], grid.rate_hz)
    bins = power_bins([(c, c) for c in found], grid.rate_hz, edges)
    noise_nm2 = _noise_nm2(bins, white_nm, own_share)
    if choice.cutoff_hz != "auto":
        return at_cutoff(bins, noise_nm2, white_nm, asked)
    return best_cutoff(bins, noise_nm2, white_nm)


def _noise_nm2(bins: PowerBins, white_nm: float, own_share: float) -> FloatArray:
    """Variance per coefficient that is the reference's own: white noise, and its own motion.

    Own motion is known above 0.5 Hz only; below, a loose bead's spectrum is level.
    """
    white_nm2 = np.full(len(bins.count), white_nm**2)
    if own_share == 0:
        return white_nm2
    moving = np.maximum(bins.power_nm2 / bins.count - white_nm2, 0.0) * own_share
    edge = (bins.frequency_hz >= OWN_MOTION_HZ) & (bins.frequency_hz < 2 * OWN_MOTION_HZ)
    level = np.average(moving[edge], weights=bins.count[edge]) if edge.any() else 0.0
    return np.asarray(white_nm2 + np.where(bins.frequency_hz < OWN_MOTION_HZ, level, moving))


def _start_frames(grid: Grid, cutoff_hz: float | None) -> int:
    return max(1, round(START_S * grid.rate_hz)) if cutoff_hz is None else 1


def _start(drift: FloatArray, frames: int) -> float:
    known = drift[np.isfinite(drift)]
    return float(np.mean(known[:frames])) if len(known) else math.nan


def _with_drift(
    recording: Recording,
    found: Assessment,
    choice: DriftChoice,
    cutoffs: list[float | None],
    subtracted: FloatArray,
    added: list[float],
    start: list[float],
    beyond: dict[str, FloatArray],
    notices: list[Notice],
) -> Recording:
    drift = Drift(
        choice.method,
        (cutoffs[0], cutoffs[1], cutoffs[2]),
        found.uses,
        subtracted,
        _rms(subtracted),
        (added[0], added[1], added[2]),
        (start[0], start[1], start[2]),
        beyond,
    )
    positions = {
        bead: xyz - drift.of_bead(bead) if bead in recording.tethered else xyz
        for bead, xyz in recording.positions_nm.items()
    }
    return replace(
        recording,
        positions_nm=positions,
        notices=(*recording.notices, *notices),
        drift=drift,
    )


def _high_passed(recording: Recording, cutoff_hz: float) -> Recording:
    """Each tethered bead loses its own slow motion; `subtracted_nm` is the mean over the beads."""
    grid = grid_of(recording)
    positions = dict(recording.positions_nm)
    mean = np.zeros((len(grid.row), 3))
    for bead in recording.tethered:
        slow = slow_motion_nm(recording, grid, bead, cutoff_hz)
        positions[bead] = positions[bead] - slow
        mean += slow / len(recording.tethered)
    cutoffs = (cutoff_hz, cutoff_hz, cutoff_hz)
    drift = Drift("highpass", cutoffs, (), mean, _rms(mean), (0.0,) * 3, (0.0,) * 3)
    text = (
        f"all motion slower than {cutoff_hz:g} Hz was removed, the beads' own included; "
        "lower frequencies are not fitted, and z keeps its drift from plateau to plateau"
    )
    notice = Notice("highpass", "info", text)
    result = replace(
        recording, positions_nm=positions, notices=(*recording.notices, notice), drift=drift
    )
    return _with_left(result, recording)


def _untouched(
    recording: Recording, method: Literal["reference", "none"], notice: Notice
) -> Recording:
    nothing = np.zeros((len(recording.time_s), 3))
    zero = (0.0, 0.0, 0.0)
    drift = Drift(method, (None, None, None), (), nothing, zero, zero, zero)
    result = replace(recording, notices=(*recording.notices, notice), drift=drift)
    return _with_left(result, recording)


def _with_left(result: Recording, raw: Recording) -> Recording:
    """A recording whose z kept the stage's motion from plateau to plateau, with how large it is."""
    left = course_left(raw)
    said = left_notice(raw, left)
    notices = result.notices if said is None else (*result.notices, said)
    assert result.drift is not None
    return replace(result, notices=notices, drift=replace(result.drift, left_along_z=left))


def _lost_notice(lost: int, frames: int) -> Notice:
    severity: Severity = "caution" if lost > LOST_CAUTION * frames else "info"
    text = (
        f"The drift is unknown in {lost} frames ({lost / frames:.2%}), as the reference "
        "beads are lost there for too long; the tethered beads are left out in these frames."
    )
    return Notice("reference_lost", severity, text)


def _share_notice(bead: str, found: FastShare) -> Notice:
    low, high = float(found.share.min()), float(found.share.max())
    span = f"{low:.2f}" if f"{low:.2f}" == f"{high:.2f}" else f"{low:.2f} to {high:.2f}"
    text = (
        f"z of {bead} shows {span} of the fast motion along z that the reference beads show, where "
        f"they vibrate together ({len(found.share)} stretches of time): the slope "
        "of its look-up table differs from theirs; this share of their motion faster than "
        f"{OWN_MOTION_HZ:g} Hz was subtracted, and the scale of its own z may be as far off"
    )
    return Notice("z_slope", "caution", text, bead, axis="z")


def _rms(subtracted: FloatArray) -> tuple[float, float, float]:
    known = np.isfinite(subtracted)
    square = np.where(known, subtracted, 0.0) ** 2
    x, y, z = np.sqrt(square.sum(axis=0) / np.maximum(known.sum(axis=0), 1)).tolist()
    return (x, y, z)
