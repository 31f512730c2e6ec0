"""From an image stack to a recording.

The stack comes in chunks of at most 128 frames; each bead's part of a chunk is work for one
process, or for several where there are fewer beads than processes. Regions follow their beads from
chunk to chunk. While processes work on one chunk the next is read; rows are written as they come.
What is held at a time is two chunks and the regions cut from them, however long the stack is.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mtpipe.errors import RecordingError, SetupError
from mtpipe.ingest.files import SETUP_NAME
from mtpipe.ingest.tracked import Notes
from mtpipe.notice import Notice
from mtpipe.processes import executor
from mtpipe.recording import FloatArray
from mtpipe.setup import Setup, read_setup
from mtpipe.tracking.find_beads import Region
from mtpipe.tracking.follow import corner, cut, followed, is_lost, sought
from mtpipe.tracking.positions import DEFAULT_METHOD, LOST_REASONS, METHODS, Positions, locate
from mtpipe.tracking.precision import precision_nm
from mtpipe.tracking.regions import Tables, regions_of, tables_of
from mtpipe.tracking.stack import Stack, open_stack
from mtpipe.tracking.stack_times import frame_times
from mtpipe.tracking.track_files import Rows, check_out, recording_written_whole

if TYPE_CHECKING:
    from mtpipe.tracking.lookup_table import LookUpTable

Images = NDArray[Any]
Progress = Callable[[str, int, int], None]
FEWEST_FRAMES = 32  # per process: less is not worth sending
PRECISION_SAMPLES = 3  # chunks in which the precision is estimated


@dataclass(frozen=True)
class TrackedStack:
    """What became of a stack.

    Attributes
    ----------
    out : the recording. regions : of the beads in the first frames. frames : of the stack.
    notes : as they stand in the recording.
    """

    out: Path
    regions: tuple[Region, ...]
    frames: int
    notes: Notes


def track(
    stack: Path | str,
    out: Path | str,
    *,
    setup: Path | str | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> TrackedStack:
    """Track the beads of an image stack and write a recording.

    Parameters
    ----------
    stack : a TIFF file, a folder with a series of them, or a pattern of their names.
    out : recording to write: .csv, .csv.gz or .parquet.
    setup : setup.toml; default: beside the stack.
    workers : processes. More than one needs the usual guard `if __name__ == "__main__":` in a
        script that calls this.
    progress : called with (step, done, of how many).

    Raises
    ------
    MtpipeError : what a user can mend, in one sentence.
    """
    path, out = Path(stack), Path(out)
    say = progress or (lambda step, done, total: None)
    setup_file = Path(setup) if setup is not None else _folder(path) / SETUP_NAME
    stated = read_setup(setup_file)
    pixel_nm, method = _pixel_size_nm(stated, setup_file), _method(stated, setup_file)
    check_out(out)
    opened = open_stack(path, lambda done, total: say("looking at the stack", done, total))
    try:
        time_s, timed = frame_times(opened.stamps, opened.frames, stated.camera.frame_rate_hz.value)
    except RecordingError as error:
        error.where = f"{path}{f', {error.where}' if error.where else ''}"
        raise
    magnet_mm, rested = _magnets(stated, time_s, opened, setup_file.parent)
    tables = tables_of(stated.tracking, setup_file.parent, pixel_nm)
    say("finding beads", 0, 1)
    regions, found = regions_of(opened, stated, tables)
    now = {region.name: region for region in regions}
    work = _Work(opened, method, tables, _saturated_above(stated, opened), pixel_nm, now)
    with executor(workers) as pool, recording_written_whole(out) as writer:
        for start, done in _tracked_chunks(work, pool, workers):
            rows = slice(start, start + len(done[regions[0].name].x_nm))
            writer.write(
                Rows(
                    time_s[rows],
                    None if magnet_mm is None else magnet_mm[rows],
                    {bead: np.column_stack([p.x_nm, p.y_nm, p.z_nm]) for bead, p in done.items()},
                    {bead: p.quality for bead, p in done.items()},
                )
            )
            say("tracking beads", rows.stop, opened.frames)
        notices = (*opened.notices, *timed, *rested, *found, *tables.notices(regions))
        notes = work.notes(path.name, (*notices, *work.lost_notices()))
        writer.finish(notes)
    return TrackedStack(out, regions, opened.frames, notes)


def _folder(path: Path) -> Path:
    return path if path.is_dir() else path.parent


def _pixel_size_nm(setup: Setup, where: Path) -> float:
    stated = setup.camera.pixel_size_nm
    if stated is None or stated.value is None:
        raise SetupError(
            "[camera] pixel_size_nm is missing: positions in an image are in pixels",
            where=str(where),
            mend="Give the size of a pixel in the sample, in nm.",
        )
    return stated.value


def _method(setup: Setup, where: Path) -> str:
    method = setup.tracking.method or DEFAULT_METHOD
    if method not in METHODS:
        raise SetupError(
            f"[tracking] method: there is no method {method!r}; known: {', '.join(METHODS)}",
            where=str(where),
        )
    return method


def _saturated_above(setup: Setup, stack: Stack) -> float | None:
    """The camera's largest grey level, by the setup or else by the bits of a pixel."""
    if setup.tracking.saturated_above is not None:
        return setup.tracking.saturated_above
    return float(2**stack.bits - 1) if stack.bits else None


def _magnets(
    setup: Setup, time_s: FloatArray, stack: Stack, folder: Path
) -> tuple[FloatArray | None, tuple[Notice, ...]]:
    """Position of the magnets at each frame from the log that the setup names."""
    from mtpipe.ingest.collect import Collected
    from mtpipe.ingest.magnets import read_magnets
    from mtpipe.ingest.read import open_table
    from mtpipe.ingest.source import Source

    if setup.tracking.magnet is None:
        return None, ()
    rate = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    log = Source.model_construct(magnet=setup.tracking.magnet)
    columns = Collected({}, time_s, None, None, None, (0,), 0, {}, ())
    files = [file.path for file in stack.files]
    magnets = read_magnets(columns, time_s, rate, log, files, folder, open_table)
    return magnets.position_mm, magnets.notices


# ------------------------------------------------------------------ chunk by chunk


@dataclass(frozen=True, eq=False)
class BeadRows:
    """One bead in a chunk: (n,) positions in the image, in nm, and their quality."""

    x_nm: FloatArray
    y_nm: FloatArray
    z_nm: FloatArray
    quality: FloatArray


@dataclass
class _Work:
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


def _tracked_chunks(
    work: _Work, pool: Executor, workers: int
) -> Iterator[tuple[int, dict[str, BeadRows]]]:
    """First frame and positions of each chunk; the next is read while one is worked on."""
    stack = work.stack
    sampled = max(1, math.ceil(stack.frames / stack.chunk_frames / PRECISION_SAMPLES))
    chunks = enumerate(stack.chunks())
    number, frames = next(chunks)
    start = 0
    while True:
        asked = _asked(work, frames, pool, workers, precise=number % sampled == 0)
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
    work: _Work, frames: Images, pool: Executor, workers: int, *, precise: bool
) -> dict[str, list[Future[_Located]]]:
    """Every bead's share of a chunk, given to the processes."""
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
                work.pixel_nm if precise and k == 0 else None,
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
    pixel_nm: float | None,
) -> _Located:
    """Positions of a bead in images of its region and, with a pixel size, their precision."""
    known = None if table is None else _table(table)
    found = locate(images, method=method, table=known, saturated_above=saturated_above)
    if pixel_nm is None:
        return found, None
    good = images[found.lost == 0]
    return found, precision_nm(good, pixel_nm, method, known) if len(good) else None


@functools.lru_cache(maxsize=256)
def _table(path: Path) -> LookUpTable:
    """A table, read once by each process."""
    from mtpipe.tracking.lookup_table import LookUpTable

    return LookUpTable.load(path)


def _collected(work: _Work, bead: str, pieces: Sequence[_Located], frames: Images) -> BeadRows:
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


def _centres(work: _Work, images: Images) -> tuple[FloatArray, FloatArray]:
    """x and y of a bead in images of a region, whatever its height."""
    found = locate(images, method=work.method, saturated_above=work.saturated_above)
    return found.x_px, found.y_px
