"""Where z = 0 may be: a stretch in which the beads touch the surface, or what heights look like.

A touch is told by what a worm-like chain does. Lateral variance v and height h above the surface
give the force kT h / v; the chain's length and the place of the surface are found together from all
plateaus of a bead, with 50 nm of persistence length. Is the lowest plateau within a small part of
the length from there, the bead is down. Shutter time and persistence length move such forces by
some ten percent and that place hardly: it is where forces vanish.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.tether import Chain, extension_nm
from mtpipe.recording.recording import Plateau, Recording

ROOM_K = 296.0
# Chain of contour length 1 nm: its extension is that of any chain over its length.
CHAIN = Chain(1.0, 50.0, ROOM_K, "marko-siggia")
FEWEST_PLATEAUS = 3
FEWEST_ROWS = 200
# The lowest plateau touches if it is within this part of the chain's length from the surface.
TOUCHING_SHARE = 0.3
# Least length of a chain over the stated one: refraction (0.88), another persistence length and
# fragments make it seem shorter.
SHORTEST_SHARE = 0.6
# A length within this part of the stated one is the tether's, short of refraction (0.88).
LENGTH_SHARE = 0.1
# Levels this close to the lowest, in parts of the range of heights, are as low.
ALIKE_SHARE, GAP_ROWS = 0.1, 400
# With the magnets at one place, to 2 % of their range, heights must agree to 30 % of theirs.
SAME_PLACE, CONTRADICTED = 0.02, 0.3
# A bead that comes down falls by at least 100 nm, and its lateral variance rises 5 times.
SMALLEST_REACH_NM = 100.0
STIFFER = 5.0
# Heights of references that are about 0 are heights above the surface.
NEAR_NM = 150.0
TALLEST_NM = 20_000.0
PIECES = 40
SHORTEST_PIECE_S = 2.0


TAKEN_FOR_HEIGHT = (
    "z is taken for the height above the surface already. If it is not, forces are wrong in "
    "proportion"
)


@dataclass(frozen=True)
class Level:
    """Heights and lateral variances of the tethered beads in one stretch of rows.

    `magnet_mm` is None where the magnets' place is not known.
    """

    start: int
    stop: int
    magnet_mm: float | None
    height_nm: dict[str, float]
    variance_nm2: dict[str, float]


@dataclass(frozen=True)
class Surface:
    """What `z_zero` may say, and why; `touch_rows` count from 0 to below the second."""

    z_zero: dict[str, object]
    why: str
    touch: tuple[int, int] | None = None


def surface_of(
    recording: Recording, stretches: Sequence[Plateau], contour_nm: float | None = None
) -> Surface:
    """Propose where z = 0 is.

    A bead that is alone and of unknown length is not taken to touch: drift or a high lowest force
    look the same, and neither another bead nor the length speaks against it.

    Parameters
    ----------
    recording : with its reference beads; z as the file has it, in nm.
    contour_nm : length of the tether, where it is known.
    stretches : in which the magnets rest, short ones too; none where their place is not known.
    """
    beads = [b for b in recording.tethered if np.isfinite(recording.positions_nm[b][:, 2]).any()]
    if not beads:
        return Surface({"unknown": True}, "no bead has heights: neither extension nor force")
    stage = _stage_nm(recording)
    levels = [
        level
        for piece in _pieces(recording, stretches)
        if (level := _level(recording, beads, stage, piece)) is not None
    ]
    levels = _without_contradicted(levels)
    doubt, elsewhere = "", _without_a_touch(recording, beads, stage)
    if len(levels) >= FEWEST_PLATEAUS:
        first, last = _down(levels)
        lowest = min(levels[first : last + 1], key=_median_height)
        touching = [_touches(bead, levels, lowest, contour_nm) for bead in beads]
        start, stop = levels[first].start, levels[last].stop
        hanging = [_hangs(bead, levels, elsewhere, contour_nm) for bead in beads]
        if np.mean(touching) > 0.5 and np.mean(hanging) <= 0.5:
            if len(beads) > 1 or contour_nm is not None:
                many = f"{sum(touching)} of {len(beads)} beads seem"
                many = many if len(beads) > 1 else "the bead seems"
                why = f"{many} to be down on the surface there, by height and lateral motion"
                return Surface({}, why, (start, stop))
            doubt = (
                f". The bead may be down in rows {start + 1} to {stop}; as it is alone, only the "
                "tether's length can tell: state tether.contour_length_nm and propose again"
            )
    return replace(elsewhere, why=elsewhere.why + doubt)


def _without_a_touch(recording: Recording, beads: Sequence[str], stage: FloatArray) -> Surface:
    """What reference beads, or z as it is, say of z = 0."""
    references = [
        float(np.nanmedian(recording.positions_nm[b][:FEWEST_ROWS, 2]))
        for b in recording.references
        if np.isfinite(recording.positions_nm[b][:FEWEST_ROWS, 2]).any()
    ]
    low = float(np.median([np.nanquantile(_height(recording, b, stage), 0.01) for b in beads]))
    if references:
        place = float(np.mean(references))
        if abs(place) < NEAR_NM:
            return Surface({"value_nm": 0.0}, "reference beads are at z = 0")
        return Surface(
            {"value_nm": float(f"{place:.5g}")},
            "no bead comes down; reference beads are at this height. If it is not that of the "
            "surface, forces are wrong in proportion",
        )
    if -NEAR_NM < low < TALLEST_NM:
        return Surface({"value_nm": 0.0}, TAKEN_FOR_HEIGHT)
    return Surface({"unknown": True}, "no bead comes down: neither extension nor force until known")


def _median_height(level: Level) -> float:
    return float(np.median([*level.height_nm.values()]))


def _down(levels: Sequence[Level]) -> tuple[int, int]:
    """First and last of the longest row of levels that are about as low as the lowest."""
    heights = np.array([_median_height(level) for level in levels])
    low = heights <= heights.min() + ALIKE_SHARE * np.ptp(heights)
    runs: list[tuple[int, int]] = []
    for k in np.flatnonzero(low).tolist():
        together = runs and runs[-1][1] == k - 1
        if together and levels[k].start - levels[k - 1].stop < GAP_ROWS:
            runs[-1] = (runs[-1][0], k)
        else:
            runs.append((k, k))
    return max(runs, key=lambda run: levels[run[1]].stop - levels[run[0]].start)


def _without_contradicted(levels: Sequence[Level]) -> list[Level]:
    """Levels without those that are far below others with the magnets at the same place.

    Rings of a bead out of focus are taken for those on the other side of it at times.
    """
    heights = np.array([_median_height(level) for level in levels])
    places = np.array([np.nan if one.magnet_mm is None else one.magnet_mm for one in levels])
    if len(levels) == 0 or np.isnan(places).any() or np.ptp(places) == 0:
        return list(levels)
    same = np.abs(places[:, None] - places) < SAME_PLACE * np.ptp(places)
    above = heights - heights[:, None] > CONTRADICTED * np.ptp(heights)
    wrong = (same & above).any(axis=1)
    return [level for level, one in zip(levels, wrong, strict=True) if not one]


def _pieces(recording: Recording, stretches: Sequence[Plateau]) -> list[Plateau]:
    """Rows of stretches to compare: where the magnets rest, else equal parts of the time."""
    long_enough = [one for one in stretches if one.stop - one.start >= FEWEST_ROWS]
    if len(long_enough) >= FEWEST_PLATEAUS:
        return long_enough
    n = len(recording.time_s)
    frame_s = float(np.median(np.diff(recording.time_s)))
    rows = max(FEWEST_ROWS, round(SHORTEST_PIECE_S / frame_s), n // PIECES)
    return [Plateau(0, k, k + rows, None) for k in range(0, n - rows + 1, rows)]


def _stage_nm(recording: Recording) -> FloatArray:
    """Motion along z that the reference beads share, 0 at the beginning; 0 without any."""
    rows = np.arange(len(recording.time_s))
    found = []
    for bead in recording.references:
        z = recording.positions_nm[bead][:, 2]
        known = np.flatnonzero(np.isfinite(z))
        if len(known):
            # frames in which the reference was lost are bridged
            found.append(np.interp(rows, known, z[known]) - np.median(z[known[:FEWEST_ROWS]]))
    return np.mean(found, axis=0) if found else np.zeros(len(rows))


def _height(recording: Recording, bead: str, stage: FloatArray) -> FloatArray:
    return np.asarray(recording.positions_nm[bead][:, 2] - stage)


def _level(
    recording: Recording, beads: Sequence[str], stage: FloatArray, piece: Plateau
) -> Level | None:
    start, stop = piece.start, piece.stop
    height, variance = {}, {}
    for bead in beads:
        xyz = recording.positions_nm[bead][start:stop]
        known = np.isfinite(xyz[:, 2])
        if np.count_nonzero(known) < FEWEST_ROWS // 2:
            return None
        height[bead] = float(np.median(xyz[known, 2] - stage[start:stop][known]))
        lateral = [float(np.nanvar(xyz[:, a])) for a in (0, 1) if np.isfinite(xyz[:, a]).any()]
        variance[bead] = min(lateral, default=np.nan)
    return Level(start, stop, piece.magnet_mm, height, variance)


def _touches(bead: str, levels: Sequence[Level], lowest: Level, contour_nm: float | None) -> bool:
    """Whether a bead is down in its lowest level, by where a chain's force would vanish.

    A chain far shorter than the tether is known to be speaks against it: the bead hung too high,
    or heights drifted.
    """
    z = np.array([level.height_nm[bead] for level in levels])
    variance = np.array([level.variance_nm2[bead] for level in levels])
    low, reach = lowest.height_nm[bead], float(np.ptp(z))
    lowest_at = levels.index(lowest)
    if not np.isfinite(variance).all() or reach < SMALLEST_REACH_NM:
        return False
    stiffer = variance[lowest_at] / np.min(variance)
    if stiffer < STIFFER:
        return False
    best, cost = (np.inf, 1.0), np.inf
    # how far the lowest level is above the surface, in parts of the range of heights
    for above in np.concatenate([np.linspace(0.0, 0.5, 11), np.geomspace(0.6, 60.0, 40)]) * reach:
        length, misfit_nm2 = _chain(np.maximum(z - low + above, 1.0), variance)
        misfit = misfit_nm2 / reach**2
        if misfit < cost:
            best, cost = (above, length), misfit
    if contour_nm is not None and best[1] < SHORTEST_SHARE * contour_nm:
        return False
    return bool(best[0] < TOUCHING_SHARE * best[1])


def _hangs(bead: str, levels: Sequence[Level], other: Surface, contour_nm: float | None) -> bool:
    """Whether z as the file has it, with another z = 0, gives a chain of the tether's length, and
    its lowest level is well above the surface.
    """
    zero_nm = other.z_zero.get("value_nm")
    if contour_nm is None or not isinstance(zero_nm, float):
        return False
    extension = np.array([level.height_nm[bead] for level in levels]) - zero_nm
    variance = np.array([level.variance_nm2[bead] for level in levels])
    if not (np.isfinite(variance).all() and extension.min() > TOUCHING_SHARE * contour_nm):
        return False
    length, _ = _chain(extension, variance)
    return abs(length / contour_nm - 1) < LENGTH_SHARE


def _chain(extension: FloatArray, variance_nm2: FloatArray) -> tuple[float, float]:
    """Length of a chain with these extensions and lateral variances (levels,), and the sum of its
    squared misfits.
    """
    force_pN = float(thermal_energy_pN_nm(ROOM_K)) * extension / variance_nm2
    relative = extension_nm(CHAIN, force_pN)
    length = float(extension @ relative / (relative @ relative))
    return length, float(np.sum((length * relative - extension) ** 2))
