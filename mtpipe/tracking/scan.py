"""A look-up table from a calibration stack: `mtpipe lut`.

The stack is a focus scan with the bead at rest; a table says at which focus position each frame
was taken. Positions are a column `z_nm` (or `z_um`), a row for each frame, or with a column
`frame` (the first is 0) for those that it names.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mtpipe.ground.errors import MtpipeError, RecordingError
from mtpipe.ground.types import FloatArray, NamedProgress
from mtpipe.ingest.columns import Names
from mtpipe.ingest.read import open_table
from mtpipe.setup.setup import Setup
from mtpipe.setup.source_parts import NM_PER_UNIT, Layout
from mtpipe.tracking.find_beads import Region
from mtpipe.tracking.follow import cut
from mtpipe.tracking.lookup_table import LookUpTable
from mtpipe.tracking.measured import DEFAULT_METHOD
from mtpipe.tracking.regions import FIRST_FRAMES, beads_in, check_inside, said_of, stated_regions
from mtpipe.tracking.stack import Stack, open_stack
from mtpipe.tracking.stack_look import Reading

POSITIONS = Layout(format="text", header=True)


def table_from_scan(
    stack: Path | str,
    positions: Path | str,
    *,
    refractive_index_factor: float,
    bead: str | None = None,
    region: tuple[float, float, int] | None = None,
    setup: Setup | None = None,
    progress: NamedProgress | None = None,
) -> LookUpTable:
    """Make a look-up table of one bead from a focus scan.

    Parameters
    ----------
    stack : as for `mtpipe.track`. positions : the focus position of each frame (see the module).
    refractive_index_factor : height per focus position; negative where the focus counts down.
    bead : its name; needed where several are found.
    region : x, y of its centre and side of its region, in pixels; default: as the setup has it,
        else it is found.
    setup : gives regions, method, size of a pixel and the camera's largest grey level.

    Raises
    ------
    MtpipeError : what a user can mend, in one sentence.
    """
    say = progress or (lambda step, done, total: None)
    opened = open_stack(
        Path(stack),
        lambda done, total: say("looking at the stack", done, total),
        None if setup is None else Reading.chosen(setup.tracking),
    )
    z_nm = focus_positions_nm(Path(positions), opened.frames)
    say("finding beads", 0, 1)
    chosen = _region(opened, bead, region, setup)
    check_inside(chosen, opened)
    images, done = [], 0
    for frames in opened.chunks():
        images.append(cut(frames, chosen))
        done += len(frames)
        say("reading the scan", done, opened.frames)
    known = np.isfinite(z_nm)
    pixel = None if setup is None else setup.camera.pixel_size_nm
    method = None if setup is None else setup.tracking.method
    saturated_above = None if setup is None else setup.tracking.saturated_above
    return LookUpTable.build(
        np.concatenate(images)[known],
        z_nm[known],
        bead=chosen.name,
        refractive_index_factor=refractive_index_factor,
        pixel_size_nm=None if pixel is None else pixel.value,
        stack=opened.name,
        method=method or DEFAULT_METHOD,
        saturated_above=opened.highest if saturated_above is None else saturated_above,
    )


def focus_positions_nm(path: Path, frames: int) -> FloatArray:
    """Focus position of each frame in nm, (frames,); NaN where the table has none.

    Raises
    ------
    RecordingError : there is no such column, or the rows do not fit the frames.
    """
    table = open_table(path, POSITIONS)
    names = Names(table.names, table.has_names, str(path))
    unit = next((unit for unit in NM_PER_UNIT if f"z_{unit}" in table.names), None)
    if unit is None:
        raise RecordingError(
            "has no column z_nm (or z_um): the focus position of each frame",
            where=str(path),
            mend=f"It has: {', '.join(table.names[:12])}. Call the focus positions z_nm or z_um in "
            "its first line; and frame, if there is one, the column that numbers the frames.",
        )
    numbered = "frame" in table.names
    wanted = [names.find(f"z_{unit}", "focus position")]
    wanted += [names.find("frame", "frame number")] if numbered else []
    columns = [np.concatenate(c) for c in zip(*table.batches(wanted), strict=True)]
    if not columns:
        raise RecordingError("has no rows", where=str(path))
    focus = columns[0] * NM_PER_UNIT[unit]
    if not numbered:
        if len(focus) != frames:
            raise RecordingError(
                f"has {len(focus)} rows where the stack has {frames} frames",
                where=str(path),
                mend="Give a row for each frame, or a column frame (the first is 0).",
            )
        return focus
    number = columns[1]
    wrong = ~((number >= 0) & (number < frames) & (number == np.rint(number)))
    if wrong.any():
        raise RecordingError(
            f"names frame {number[wrong][0]:g}, but the stack has {frames} frames, "
            f"0 to {frames - 1}",
            where=str(path),
        )
    named, times = np.unique(number, return_counts=True)
    if times.max() > 1:
        raise RecordingError(f"names frame {named[times > 1][0]:g} twice", where=str(path))
    z_nm = np.full(frames, np.nan)
    z_nm[number.astype(int)] = focus
    return z_nm


def _region(
    stack: Stack,
    bead: str | None,
    region: tuple[float, float, int] | None,
    setup: Setup | None,
) -> Region:
    """The region of the bead: as told, as in the setup, or found over the whole scan."""
    if region is not None:
        return Region(bead or "bead1", *region)
    regions = () if setup is None else stated_regions(setup.tracking)
    if regions:
        said = "the setup has " + ", ".join(r.name for r in regions)
    else:
        size = None if setup is None else setup.tracking.size_px
        found, rings = beads_in(_spread(stack), stack, size)
        regions, said = found.regions, said_of(found, rings, "the scan").message.rstrip(".")
    named = [one for one in regions if bead in (one.name, None)]
    if bead is not None and not named:
        raise RecordingError(f"there is no bead {bead!r} in the scan: {said}", where=stack.name)
    if len(named) != 1:
        raise MtpipeError(
            f"a look-up table is that of one bead: {said}",
            where=stack.name,
            mend="Choose one with --bead NAME, or give its region.",
        )
    return named[0]


def _spread(stack: Stack) -> np.ndarray:
    """Some frames from all over the scan: near the focus a bead has hardly any rings."""
    step = max(1, stack.frames // FIRST_FRAMES)
    kept = []
    start = 0
    for frames in stack.chunks():
        kept.append(frames[-start % step :: step].copy())
        start += len(frames)
    return np.concatenate(kept)
