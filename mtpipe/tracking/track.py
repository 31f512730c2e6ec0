"""From an image stack to a recording.

The stack comes in chunks of at most 128 frames (`mtpipe.tracking.chunks`), and rows are written as
they come. What is held at a time is two chunks and the regions cut from them, however long the
stack is.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mtpipe.ground.errors import RecordingError, SetupError
from mtpipe.ground.notice import Notice
from mtpipe.ground.processes import executor
from mtpipe.ground.progress import by_name
from mtpipe.ground.types import FloatArray, NamedProgress
from mtpipe.ingest.data_files import SETUP_NAME
from mtpipe.ingest.tracked import Notes
from mtpipe.setup.setup import Setup, read_setup
from mtpipe.tracking.chunks import Work, tracked_chunks
from mtpipe.tracking.find_beads import Region
from mtpipe.tracking.measured import DEFAULT_METHOD, METHODS
from mtpipe.tracking.regions import regions_of, tables_of
from mtpipe.tracking.stack import Stack, open_stack
from mtpipe.tracking.stack_look import Reading
from mtpipe.tracking.stack_times import frame_times
from mtpipe.tracking.track_files import Rows, check_out, recording_written_whole


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
    pool: Executor | None = None,
    progress: NamedProgress | None = None,
) -> TrackedStack:
    """Track the beads of an image stack and write a recording.

    Parameters
    ----------
    stack : a TIFF file, a folder with a series of them, or a pattern of their names.
    out : recording to write: .csv, .csv.gz or .parquet.
    setup : setup.toml; default: beside the stack.
    workers : processes. More than one needs the usual guard `if __name__ == "__main__":` in a
        script that calls this.
    pool : that does it in their place.
    progress : called with (step, done, of how many); default: a bar in a notebook.

    Raises
    ------
    MtpipeError : what a user can mend, in one sentence.
    """
    path, out = Path(stack), Path(out)
    say = by_name(progress)
    setup_file = Path(setup) if setup is not None else _folder(path) / SETUP_NAME
    stated = read_setup(setup_file)
    pixel_nm, method = _pixel_size_nm(stated, setup_file), _method(stated, setup_file)
    check_out(out)
    opened = open_stack(
        path,
        lambda done, total: say("looking at the stack", done, total),
        Reading.chosen(stated.tracking),
    )
    rate_hz = stated.camera.frame_rate_hz.value
    put_aside = stated.tracking.times == "setup"
    try:
        time_s, timed = frame_times(opened.stamps, opened.frames, rate_hz, put_aside=put_aside)
    except RecordingError as error:
        error.where = f"{path}{f', {error.where}' if error.where else ''}"
        raise
    magnet_mm, rested = _magnets(stated, time_s, opened, setup_file.parent)
    tables = tables_of(stated.tracking, setup_file.parent, pixel_nm)
    say("finding beads", 0, 1)
    regions, found = regions_of(opened, stated, tables)
    now = {region.name: region for region in regions}
    work = Work(opened, method, tables, _saturated_above(stated, opened), pixel_nm, now)
    with (
        executor(workers if pool is None else pool) as pool,
        recording_written_whole(out) as writer,
    ):
        for start, done in tracked_chunks(work, pool, workers):
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
    stated = setup.tracking.saturated_above
    return stack.highest if stated is None else stated


def _magnets(
    setup: Setup, time_s: FloatArray, stack: Stack, folder: Path
) -> tuple[FloatArray | None, tuple[Notice, ...]]:
    """Position of the magnets at each frame from the log that the setup names."""
    from mtpipe.ingest.collect import Collected
    from mtpipe.ingest.magnets import read_magnets
    from mtpipe.ingest.read import open_table
    from mtpipe.setup.source_table import Source

    if setup.tracking.magnet is None:
        return None, ()
    rate = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    log = Source.model_construct(magnet=setup.tracking.magnet)
    columns = Collected({}, time_s, None, None, None, (0,), 0, {}, ())
    files = [file.path for file in stack.files]
    magnets = read_magnets(columns, time_s, rate, log, files, folder, open_table)
    return magnets.position_mm, magnets.notices
