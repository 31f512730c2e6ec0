"""What is wrong with a recording, told in words.

An error where going on would give a wrong force, a notice where not. One bad bead loses nothing
else: it is left out and named, unless it was the last.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError, SetupError
from mtpipe.ground.notice import Notice, Severity
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import AXES
from mtpipe.setup.setup import Setup

WIDEST_NM = 10_000.0
QUIETEST_NM = 0.5
STILL_NM = 2.0
LONG_TETHER_NM = 100.0
LOST_CAUTION = 0.05
LOST_WARNING = 0.5
MOVING_SHARE = 0.5
MOVING_NM = 5.0
MOST_SAMPLED = 2_000_000
ZERO_ROWS = 2
# Share of the frames in which a coordinate is that of the frame before: with steps of half the
# standard deviation of its change from frame to frame, a fifth. Rounding then adds some 4 % of that
# change's variance.
COARSE_SHARE = 0.2
# Differences of the same number of steps are equal up to this (nm).
ROUNDING_NM = 1e-6
MOST_LOST = 1_000_000
MOST_LOST_SHARE = 20


@dataclass(frozen=True)
class Sound:
    """The beads that passed, and the remarks on all."""

    positions_nm: dict[str, FloatArray]
    notices: tuple[Notice, ...]


def check_beads(positions_nm: Mapping[str, FloatArray], setup: Setup, rate_hz: float) -> Sound:
    """Leave out beads that are no beads, and remark on the others.

    Parameters
    ----------
    positions_nm : (n_frames, 3) for each bead; constant axes become NaN in place.

    Raises
    ------
    SetupError : a reference bead of the setup is not in the recording.
    RecordingError : no bead is left, all-zero rows, or positions in a wrong unit.
    """
    missing = [b for b in setup.beads.reference if b not in positions_nm]
    if missing:
        raise SetupError(
            f"[beads.reference] {missing[0]!r} is not in the recording",
            mend=f"It has: {_listed(list(positions_nm))}.",
        )
    notices: list[Notice] = []
    kept: dict[str, FloatArray] = {}
    for bead, xyz in positions_nm.items():
        said = _without_constant_axes(bead, xyz)
        notices += said
        if not any(n.code in ("constant_bead", "no_positions") for n in said):
            kept[bead] = xyz
    _refuse_if_none(kept, setup, notices)
    _refuse_zero_rows(kept)
    reference = set(setup.beads.reference)
    spread = {bead: _block_spread(xyz, rate_hz) for bead, xyz in kept.items()}
    notices += _check_units({b: xyz for b, xyz in kept.items() if b not in reference}, setup)
    notices += _check_heights({b: xyz for b, xyz in kept.items() if b not in reference}, setup)
    notices += _check_references(spread, reference)
    notices += [n for bead, xyz in kept.items() for n in _lost(bead, xyz)]
    notices += [n for b, xyz in kept.items() if b not in reference for n in _coarse(b, xyz)]
    return Sound(kept, tuple(notices))


def check_gaps(frame: NDArray[np.int64], locate: Callable[[int], str]) -> tuple[Notice, ...]:
    """Say how many frames the camera lost.

    Raises
    ------
    RecordingError : so many that a time stamp or frame number must be wrong.
    """
    jump = np.diff(frame) - 1
    lost = int(frame[-1]) - int(frame[0]) + 1 - len(frame)
    if lost == 0:
        return ()
    if lost > max(MOST_LOST, MOST_LOST_SHARE * len(frame)):
        row = int(np.argmax(jump))
        raise RecordingError(
            f"{int(jump[row])} frames are missing before it, more than any camera loses",
            where=locate(row + 1),
            mend="Correct the time stamp or frame number, or split the recording.",
        )
    share = lost / (int(frame[-1] - frame[0]) + 1)
    said = f"The camera lost {lost} frames ({100 * share:.2g} %) in {np.count_nonzero(jump)} gaps."
    return (Notice("camera_gaps", "caution" if share > LOST_CAUTION else "info", said),)


def _without_constant_axes(bead: str, xyz: FloatArray) -> list[Notice]:
    constant, recorded = [], 0
    for axis, name in enumerate(AXES):
        column = xyz[:, axis]
        low, high = _range(column)
        if np.isnan(low):
            continue
        recorded += 1
        if low == high and len(column) > 1:
            constant.append(name)
            value = low
    if recorded == 0:
        said = f"Bead {bead} has no position at all and is left out."
        return [Notice("no_positions", "warning", said, bead=bead)]
    lateral = [a for a in "xy" if np.isfinite(xyz[:, AXES.index(a)]).any()]
    if constant and (len(constant) == recorded or (lateral and set(lateral) <= set(constant))):
        said = (
            f"Bead {bead} never moves ({', '.join(constant)} constant at {value:g} nm): "
            "a placeholder, no measurement. It is left out."
        )
        return [Notice("constant_bead", "warning", said, bead=bead)]
    notices = []
    for name in constant:
        xyz[:, AXES.index(name)] = np.nan
        said = f"{name} of bead {bead} never changes and is taken as not recorded."
        notices.append(Notice("constant_column", "warning", said, bead=bead, axis=name))
    return notices


def _refuse_if_none(kept: Mapping[str, FloatArray], setup: Setup, notices: list[Notice]) -> None:
    reference = setup.beads.reference
    if any(b not in reference for b in kept):
        return
    why = next((n.message for n in notices if n.bead not in reference), "")
    if why:
        raise RecordingError(f"no tethered bead is left. {why}")
    raise RecordingError(
        "every bead is a reference bead, none is tethered", mend="Correct [beads] reference."
    )


def _refuse_zero_rows(positions_nm: Mapping[str, FloatArray]) -> None:
    columns = [
        xyz[:, axis]
        for xyz in positions_nm.values()
        for axis in range(3)
        if not np.isnan(xyz[:, axis]).all()
    ]
    if len(columns) < 2:
        return
    zero = np.ones(len(columns[0]), dtype=np.bool_)
    for column in columns:
        zero &= column == 0
    count = int(np.count_nonzero(zero))
    if count >= ZERO_ROWS:
        first = int(np.argmax(zero))
        raise RecordingError(
            f"in {count} rows, the first of them row {first + 1}, every position is exactly 0",
            mend="If they are a start-up block, set all_zero_rows = true in [source.lost]; in a "
            "canonical file leave such cells empty.",
        )


def _check_units(tethered: Mapping[str, FloatArray], setup: Setup) -> list[Notice]:
    """Positions in a wrong unit: an error if every tethered bead says so, else a remark."""
    notices: list[Notice] = []
    for bead, xyz in tethered.items():
        for axis in (0, 1):
            said = unlike_a_tether(xyz[:, axis], setup)
            if said:
                said = f"Bead {bead} {said} in {AXES[axis]}: it is not tethered, or not in nm."
                notices.append(Notice("unit", "warning", said, bead=bead, axis=AXES[axis]))
                break
    if notices and len(notices) == len(tethered):
        raise RecordingError(
            notices[0].message,
            mend="Correct the unit (positions of canonical files are nm; of others, "
            "[source.units]).",
        )
    return notices


def unlike_a_tether(column: FloatArray, setup: Setup) -> str:
    """How positions (n,), in nm, move as no tethered bead does; "" where one may."""
    length = setup.tether.contour_length_nm.value
    widest = max(WIDEST_NM, 3 * length) if length is not None else WIDEST_NM
    column = _sampled(column)
    if np.isnan(column).all():
        return ""
    low, high = np.nanquantile(column, [0.01, 0.99])
    spread = float(np.nanstd(column)) if high - low < 10 * QUIETEST_NM else QUIETEST_NM
    if high - low > widest:
        return f"wanders over {(high - low) / 1000:.3g} µm"
    return f"moves by only {spread:.2g} nm (rms)" if spread < QUIETEST_NM else ""


def _check_heights(tethered: Mapping[str, FloatArray], setup: Setup) -> list[Notice]:
    """Heights that hardly change, as if they were in µm; x and y are told by `_check_units`.

    At the highest forces the height of a short tether may fluctuate by no more than a nm, but the
    tracker's noise does not.
    """
    length = setup.tether.contour_length_nm.value
    if length is None or length <= LONG_TETHER_NM:
        return []
    still = {}
    for bead, xyz in tethered.items():
        z = _sampled(xyz[:, 2])
        if not np.isnan(z).all():
            low, high = np.nanquantile(z, [0.001, 0.999])
            if high - low < STILL_NM:
                still[bead] = float(high - low)
    if not still:
        return []
    said = (
        f"The height of {_listed(list(still))} changes by no more than "
        f"{max(still.values()):.2g} nm in the whole recording, on a tether of {length:g} nm: z may "
        "not be in nm."
    )
    # of the recording: a wrong unit is seldom that of one bead
    return [Notice("unit", "caution", said, axis="z")]


def _check_references(spread: Mapping[str, float], reference: set[str]) -> list[Notice]:
    tethered = [s for bead, s in spread.items() if bead not in reference and np.isfinite(s)]
    typical = float(np.median(tethered)) if tethered else np.inf
    return [
        Notice(
            "moving_reference",
            "warning",
            f"Reference bead {bead} fluctuates by {s:.3g} nm within a second, tethered beads by "
            f"{typical:.3g} nm: it may not be fixed to the surface.",
            bead=bead,
        )
        for bead, s in spread.items()
        if bead in reference and s > max(MOVING_NM, MOVING_SHARE * typical)
    ]


def _lost(bead: str, xyz: FloatArray) -> list[Notice]:
    share = 0.0
    for axis in range(3):
        finite = int(np.count_nonzero(np.isfinite(xyz[:, axis])))
        if finite:
            share = max(share, 1 - finite / len(xyz))
    if share == 0:
        return []
    level: Severity = "info"
    if share > LOST_CAUTION:
        level = "warning" if share > LOST_WARNING else "caution"
    said = f"The tracker lost bead {bead} in {100 * share:.2g} % of the frames."
    return [Notice("lost_frames", level, said, bead=bead)]


def _coarse(bead: str, xyz: FloatArray) -> list[Notice]:
    """Axes along which a bead often rests where it was, and else moves by whole steps."""
    change = np.abs(np.diff(xyz, axis=0))
    # where no axis changes, the whole frame is a copy
    moves = np.any(change > 0, axis=1)
    found: list[tuple[float, float, str]] = []
    for axis, name in enumerate(AXES):
        known = change[moves & np.isfinite(change[:, axis]), axis]
        steps = known[known > ROUNDING_NM]
        rests = 1 - len(steps) / max(len(known), 1)
        if len(steps) and rests > COARSE_SHARE:
            found.append((rests, float(np.min(steps)), name))
    if not found:
        return []
    rests, step_nm, _ = max(found)
    axes = " and ".join(name for _, _, name in found)
    said = (
        f"{axes} of bead {bead} are stored in steps of {step_nm:.2g} nm, which is coarse beside "
        f"its motion: in {100 * rests:.2g} % of the frames nothing changes. Forces are wrong by "
        "that, most of all high ones. Export positions with more digits."
    )
    return [Notice("coarse_positions", "caution", said, bead=bead)]


def _block_spread(xyz: FloatArray, rate_hz: float) -> float:
    """Median over stretches of a second of the standard deviation in x and y, in nm."""
    width = max(8, round(rate_hz))
    blocks = len(xyz) // width
    if blocks == 0:
        return np.nan
    every = max(1, len(xyz) // MOST_SAMPLED)
    pieces = xyz[: blocks * width, :2].reshape(blocks, width, 2)[::every]
    spreads = []
    for axis in (0, 1):
        column = pieces[:, :, axis]
        whole = column[np.asarray(np.isfinite(column).all(axis=1))]
        if len(whole):
            spreads.append(float(np.median(np.std(whole, axis=1))))
    return max(spreads, default=np.nan)


def _range(column: FloatArray) -> tuple[float, float]:
    low, high = np.fmin.reduce(column), np.fmax.reduce(column)
    return float(low), float(high)


def _sampled(column: FloatArray) -> FloatArray:
    return column[:: max(1, len(column) // MOST_SAMPLED)]


def _listed(beads: list[str]) -> str:
    return ", ".join(beads[:12]) + (", ..." if len(beads) > 12 else "")
