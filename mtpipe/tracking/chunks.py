"""Tracking chunk by chunk: each bead's part of a chunk is work for one process, or for several.

Several where there are fewer beads than processes. Regions follow their beads from chunk to chunk.
While processes work on one chunk the next is read.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.notice import Notice
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.tracked import Notes
from mtpipe.tracking.find_beads import Region
from mtpipe.tracking.follow import corner, cut, followed, is_lost, sought
from mtpipe.tracking.measured import LOST_REASONS
from mtpipe.tracking.positions import Positions, locate
from mtpipe.tracking.precision import precision_nm
from mtpipe.tracking.regions import Tables
from mtpipe.tracking.stack import Stack

if TYPE_CHECKING:
    from mtpipe.tracking.lookup_table import LookUpTable

Images = NDArray[Any]
FEWEST_FRAMES = 32  # per process: less is not worth sending
PRECISION_SAMPLES = 3  # chunks in which the precision is estimated


@dataclass(frozen=True, eq=False)
class BeadRows:
    """One bead in a chunk: (n,) positions in the image, in nm, and their quality."""

    x_nm: FloatArray
    y_nm: FloatArray
    z_nm: FloatArray
    quality: FloatArray


@dataclass
class Work:
    """What stays the same from chunk to chunk, and what is counted on the way."""

    stack: Stack
    method: str
    tables: Tables
    saturated_above: float | None
    pixel_nm: float
    regions: dict[str, Region]  # where they are now
    lost: dict[str, Counter[int]] = field(default_factory=dict)
    precision: dict[str, list[FloatArray]] = field(default_factory=dict)

    def notes(self, name: str, notices: Sequence[Notice]) -> Notes:
        """What the recording says of its tracking."""
        precision = {bead: _median(samples) for bead, samples in self.precision.items()}
        lost = {
            bead: {LOST_REASONS[code]: n for code, n in sorted(counts.items())}
            for bead, counts in self.lost.items()
        }
        used = {bead: path.name for bead, path in self.tables.of(self.regions).items()}
        return Notes(name, self.method, precision, used, lost, tuple(notices))

    def lost_notices(self) -> Iterator[Notice]:
        """How many frames each bead lost, and why."""
        for bead, counts in self.lost.items():
            total = sum(counts.values())
            if not total:
                continue
            why = ", ".join(f"{LOST_REASONS[code]} {n}" for code, n in counts.most_common())
            said = f"The tracker lost it in {total} of {self.stack.frames} frames: {why}."
            severity = "info" if total < 0.5 * self.stack.frames else "warning"
            yield Notice("lost_by_tracker", severity, said, bead)  # type: ignore[arg-type]


def _median(samples: Sequence[FloatArray]) -> tuple[float | None, float | None, float | None]:
    table = np.array(samples).reshape(-1, 3)
    x, y, z = (
        float(np.median(known)) if len(known := column[np.isfinite(column)]) else None
        for column in table.T
    )
    return x, y, z


def tracked_chunks(
    work: Work, pool: Executor, workers: int
) -> Iterator[tuple[int, dict[str, BeadRows]]]:
    """First frame and positions of each chunk; the next is read while one is worked on."""
    stack = work.stack
    sampled = max(1, math.ceil(stack.frames / stack.chunk_frames / PRECISION_SAMPLES))
    chunks = enumerate(stack.chunks())
    number, frames = next(chunks)
    start = 0
    while True:
        sample = number // sampled if number % sampled == 0 else None
        asked = _asked(work, frames, pool, workers, sample)
        following = next(chunks, None)
        done = {
            bead: _collected(work, bead, [future.result() for future in futures], frames)
            for bead, futures in asked.items()
        }
        yield start, done
        if following is None:
            return
        start += len(frames)
        number, frames = following


def _asked(
    work: Work, frames: Images, pool: Executor, workers: int, sample: int | None
) -> dict[str, list[Future[_Located]]]:
    """Every bead's share of a chunk, given to the processes.

    `sample` counts the chunks in which the precision is estimated; None: in this one it is not.
    """
    pieces = math.ceil(workers / len(work.regions))
    pieces = max(1, min(pieces, len(frames) // FEWEST_FRAMES))
    tables = work.tables.of(work.regions)
    return {
        bead: [
            pool.submit(
                _located,
                piece,
                work.method,
                tables.get(bead),
                work.saturated_above,
                work.pixel_nm,
                sample if k == 0 else None,
            )
            for k, piece in enumerate(np.array_split(cut(frames, region), pieces))
        ]
        for bead, region in work.regions.items()
    }


_Located = tuple[Positions, FloatArray | None]


def _located(
    images: Images,
    method: str,
    table: Path | None,
    saturated_above: float | None,
    pixel_nm: float,
    sample: int | None,
) -> _Located:
    """Positions of a bead in images of its region and, in a sample of them, their precision."""
    known = None if table is None else _table(table)
    found = locate(images, method=method, table=known, saturated_above=saturated_above)
    if sample is None or found.lost.all():
        return found, None
    good = images[found.lost == 0]
    # the same noise in every sample would leave its chance in their median
    return found, precision_nm(good, pixel_nm, method, known, seed=sample)


@functools.lru_cache(maxsize=256)
def _table(path: Path) -> LookUpTable:
    """A table, read once by each process."""
    from mtpipe.tracking.lookup_table import LookUpTable

    return LookUpTable.load(path)


def _collected(work: Work, bead: str, pieces: Sequence[_Located], frames: Images) -> BeadRows:
    """Positions in the image from those in the region, which then follows its bead."""
    region = work.regions[bead]
    shape = (work.stack.height, work.stack.width)
    row, column = corner(region, shape)
    x = np.concatenate([found.x_px for found, _ in pieces]) + column
    y = np.concatenate([found.y_px for found, _ in pieces]) + row
    lost = np.concatenate([found.lost for found, _ in pieces])
    counts = work.lost.setdefault(bead, Counter())
    counts.update(lost[lost != 0].tolist())
    samples = work.precision.setdefault(bead, [])
    samples += [precision for _, precision in pieces if precision is not None]
    region = followed(region, x, y)
    if is_lost(x):
        others = [other for name, other in work.regions.items() if name != bead]
        region = sought(region, frames, others, functools.partial(_centres, work))
    work.regions[bead] = region
    return BeadRows(
        x * work.pixel_nm,
        y * work.pixel_nm,
        np.concatenate([found.z_nm for found, _ in pieces]),
        np.concatenate([found.quality for found, _ in pieces]),
    )


def _centres(work: Work, images: Images) -> tuple[FloatArray, FloatArray]:
    """x and y of a bead in images of a region, whatever its height."""
    found = locate(images, method=work.method, saturated_above=work.saturated_above)
    return found.x_px, found.y_px
