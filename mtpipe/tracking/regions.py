"""Which regions are tracked, and which look-up table belongs to each.

Regions are those of the setup, else the beads found in the first frames; everything that was seen
and is not tracked is said. A look-up table is made for one bead, size of region and pixel.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mtpipe.ground.errors import RecordingError, SetupError
from mtpipe.ground.notice import Notice
from mtpipe.setup.setup import Setup
from mtpipe.setup.tracking_table import Tracking
from mtpipe.tracking.find_beads import FoundBeads, Region, find_beads
from mtpipe.tracking.stack import Stack

if TYPE_CHECKING:
    from mtpipe.tracking.lookup_table import LookUpTable
    from mtpipe.tracking.ring_information import RingInformation

FIRST_FRAMES = 50
FIRST_BYTES = 1 << 25
PIXEL_TOLERANCE = 1e-3
# Offset of a bead from its region's middle, as a share of the side, that is allowed: half of that
# at which a bead is lost.
BESIDE = 1 / 8


@dataclass(frozen=True)
class Tables:
    """Look-up tables by the setup: one for all beads, and those of single ones."""

    common: Path | None
    own: Mapping[str, Path]
    loaded: Mapping[Path, LookUpTable]

    def of(self, beads: Iterable[str]) -> dict[str, Path]:
        """The table of each bead that has one."""
        found = {bead: self.own.get(bead, self.common) for bead in beads}
        return {bead: path for bead, path in found.items() if path is not None}

    def size_px(self, bead: str) -> int | None:
        """Side of the region that a bead's table was made from."""
        path = self.of([bead]).get(bead)
        return None if path is None else self.loaded[path].region_size_px

    def notices(self, regions: Sequence[Region]) -> Iterator[Notice]:
        """What a user must know of the heights of these beads."""
        names = [region.name for region in regions]
        tables = self.of(names)
        without = [name for name in names if name not in tables]
        if without:
            who = "any bead" if len(without) == len(names) else ", ".join(without)
            said = (
                f"There is no look-up table of {who}, so z is empty there: without z there is no "
                "extension, and without extension no force; what is left are fluctuations in x and "
                "y. `mtpipe lut` makes a table of a focus scan."
            )
            yield Notice("no_look_up_table", "warning", said, axis="z")
        for bead, path in tables.items():
            made_for = self.loaded[path].bead
            if made_for != bead:
                said = (
                    f"Its heights are from the look-up table of {made_for} ({path.name}); beads "
                    "differ in their rings, which shifts and scales z."
                )
                yield Notice("other_beads_table", "caution", said, bead)


def tables_of(choice: Tracking, folder: Path, pixel_nm: float) -> Tables:
    """Read the look-up tables that a setup names, relative to its folder.

    Raises
    ------
    RecordingError : a table is missing, damaged or made with pixels of another size.
    """
    from mtpipe.tracking.lookup_table import LookUpTable

    # absolute, as processes read them again
    own = {bead: (folder / name).resolve() for bead, name in choice.look_up_table_of.items()}
    common = None if choice.look_up_table is None else (folder / choice.look_up_table).resolve()
    loaded = {}
    for path in {*own.values(), *([] if common is None else [common])}:
        table = LookUpTable.load(path)
        made = table.pixel_size_nm
        if made is not None and abs(made / pixel_nm - 1) > PIXEL_TOLERANCE:
            raise RecordingError(
                f"was made with pixels of {made:g} nm, the setup says {pixel_nm:g} nm",
                where=str(path),
                mend="Correct [camera] pixel_size_nm, or make the table again.",
            )
        loaded[path] = table
    return Tables(common, own, loaded)


def regions_of(
    stack: Stack, setup: Setup, tables: Tables
) -> tuple[tuple[Region, ...], tuple[Notice, ...]]:
    """The regions to track, with the sizes that their tables want, and what was not taken.

    Raises
    ------
    RecordingError, SetupError : no bead, or one that the setup names is not there.
    """
    choice = setup.tracking
    notices: tuple[Notice, ...] = ()
    regions = stated_regions(choice)
    found, rings = None, None
    if not regions:
        found, rings = beads_in(first_frames(stack), stack, choice.size_px)
        regions = found.regions
        if not regions:
            raise RecordingError(
                said_of(found, rings).message.removesuffix("."),
                where=stack.name,
                mend="Give a smaller size_px, or the beads as [[tracking.regions]].",
            )
    sized = tuple(
        replace(region, size_px=tables.size_px(region.name) or region.size_px) for region in regions
    )
    if found is not None:
        notices = (said_of(replace(found, regions=sized), rings),)
    for region in sized:
        # a table may be larger than fits about a bead that is found nearer to the border
        of_table = found is not None and tables.size_px(region.name) is not None
        check_inside(region, stack, beside=BESIDE if of_table else 0)
    if choice.regions:  # beads that are found are apart already
        check_apart(sized, stack)
    names = [region.name for region in sized]
    there = f"there are {', '.join(names[:12])}{', …' if len(names) > 12 else ''}"
    for stated, key in (
        (setup.beads.reference, "[beads] reference"),
        (choice.look_up_table_of, "[tracking] look_up_table_of"),
    ):
        for bead in stated:
            if bead in names:
                continue
            said = f"{key} names {bead!r}, which is none of the beads: {there}"
            if choice.regions or key != "[beads] reference":
                raise SetupError(said)
            # names of beads that are found cannot be known before
            notices += (
                Notice("no_such_reference", "caution", f"{said}. Name one of these there."),
            )
    return sized, notices


def stated_regions(choice: Tracking) -> tuple[Region, ...]:
    """The regions that the setup states; none where beads are to be found."""
    return tuple(Region(r.name, r.x_px, r.y_px, r.size_px) for r in choice.regions)


def beads_in(
    frames: np.ndarray, stack: Stack, size_px: int | None
) -> tuple[FoundBeads, RingInformation | None]:
    """The beads in some frames of a stack, and their rings; parameters, errors as `find_beads`."""
    from mtpipe.tracking.region_sizes import sized

    try:
        return sized(find_beads(frames, size_px=size_px), frames, size_px)
    except RecordingError as error:
        error.where = stack.name
        raise


def first_frames(stack: Stack) -> np.ndarray:
    """The frames in which beads are looked for: the first 50, fewer of large images."""
    frames = max(2, min(FIRST_FRAMES, FIRST_BYTES // stack.kind.nbytes))
    with closing(stack.chunks(frames)) as chunks:
        return next(chunks)


def said_of(
    found: FoundBeads, rings: RingInformation | None, where: str = "the first frames"
) -> Notice:
    """What was found and refused, in words, with places and sizes of regions."""
    count = len(found.regions)
    said = f"{count} {'bead was' if count == 1 else 'beads were'} found in {where}"
    if found.regions:
        places = (f"{r.name} at x = {r.x_px:.0f}, y = {r.y_px:.0f}" for r in found.regions)
        said += f" ({'; '.join(places)})"
    said += "."
    if found.regions and rings is not None:
        sizes = [region.size_px for region in found.regions]
        said += f" Regions have {_squares(sizes)} pixels; tracking uses "
        said += " to ".join(
            dict.fromkeys(f"{rings.share(s):.0%}" for s in (min(sizes), max(sizes)))
        )
        said += " of what the rings tell of x and y."
    if found.refused:
        places = (f"at x = {r.x_px:.0f}, y = {r.y_px:.0f}: {r.reason}" for r in found.refused)
        count = len(found.refused)
        said += f" {count} {'is' if count == 1 else 'are'} not tracked ({'; '.join(places)})."
    if found.fainter:
        said += f" Much smaller or fainter patterns, taken for dirt: {found.fainter}."
    return Notice("beads_found", "info", said)


def _squares(sizes_px: Sequence[int]) -> str:
    """One size or the smallest and the largest, in words."""
    return " to ".join(dict.fromkeys(f"{s} x {s}" for s in (min(sizes_px), max(sizes_px))))


def check_inside(region: Region, stack: Stack, beside: float = 0) -> None:
    """Raise RecordingError if a region juts out of the image.

    `beside` is the part of its side by which it may, and is then moved inward.
    """
    half = (region.size_px - 1) / 2 - beside * region.size_px
    inside = (
        region.size_px <= min(stack.width, stack.height)
        and half - 1 <= region.x_px <= stack.width - half
        and half - 1 <= region.y_px <= stack.height - half
    )
    if not inside:
        raise RecordingError(
            f"the region of {region.name}, {region.size_px} pixels about x = {region.x_px:.0f}, "
            f"y = {region.y_px:.0f}, is cut by the border of the image "
            f"({stack.width} x {stack.height} pixels)",
            where=stack.name,
            mend="Move it, make it smaller, or leave the bead out of [[tracking.regions]].",
        )


def check_apart(regions: Sequence[Region], stack: Stack) -> None:
    """Raise RecordingError if a region has its centre in another, and so could see its bead."""
    for one, other in itertools.combinations(regions, 2):
        apart = max(abs(one.x_px - other.x_px), abs(one.y_px - other.y_px))
        if apart < max(one.size_px, other.size_px) / 2:
            raise RecordingError(
                f"the regions of {one.name} and {other.name} overlap so far that one bead would "
                f"be tracked as two: their centres are {apart:.0f} pixels apart",
                where=stack.name,
                mend="Make them smaller, or leave one out of [[tracking.regions]].",
            )
