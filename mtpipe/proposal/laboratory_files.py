"""Which files are the recording, how they belong together, and which may be the magnets' log.

Files with the same columns are a series in time if one goes on where another ends, and one file for
each bead if they hold one bead and the same rows.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from mtpipe.ground.errors import MtpipeError, RecordingError
from mtpipe.ground.files import as_text
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.data_files import data_files, natural_order
from mtpipe.proposal.columns import Columns, columns_of
from mtpipe.proposal.look import MOST_ROWS, Column, Look, look_at
from mtpipe.tracking.lookup_table import LookUpTable
from mtpipe.tracking.stack import SUFFIXES, is_pattern, named_like
from mtpipe.tracking.tiff import TIFF_MAGICS

Together = Literal["one", "series", "beads"]
# Files whose names differ in numbers alone: up to 30 all are looked at, of more the first two and
# some 8 spread over the rest.
MOST_LOOKED_AT, SPREAD_OVER = 30, 8
# Largest move of a bead from the end of one file to the start of the next, in median steps from row
# to row; rows at each edge that are compared.
FARTHEST_STEPS, EDGE_ROWS = 15.0, 20
BEAD_WORDS = re.compile(r"bead|kugel|ref|tether|particle|perle|^[br]\d", re.IGNORECASE)


@dataclass(frozen=True)
class GivenFilm:
    """A film that was given, and the files that may be its look-up tables and magnets' log."""

    path: Path
    beside: tuple[Path, ...]


@dataclass(frozen=True, eq=False)
class FoundFiles:
    """The files of a recording.

    Attributes
    ----------
    folder : in which they are. files : in the order of reading.
    look, columns : of the first (of the first that moves, where one begins with zeros).
    together : how they belong together; `restarts` whether each begins its clock anew.
    logs : other files, as they were looked at.
    seen : all files of the recording that were looked at.
    """

    folder: Path
    files: tuple[Path, ...]
    look: Look
    columns: Columns
    together: Together = "one"
    restarts: bool = False
    logs: tuple[Look, ...] = ()
    seen: tuple[Look, ...] = ()

    def of_all(self, column: Column) -> FloatArray:
        """Values of a column in all files that were looked at."""
        found = [c.seconds for look in self.seen for c in look.columns if c.told == column.told]
        return np.concatenate(found or [column.seconds])


def film_of(paths: Sequence[Path]) -> GivenFilm | None:
    """The film among what is given; None where that is a recording in numbers.

    Raises
    ------
    RecordingError : there are several, or there is no such file.
    """
    given = [one for path in paths for one in _named(path)]
    films = [film for path in given for film in _films_at(path)]
    if len(given) == 1 and given[0].is_dir() and films != given and _holds_recording(given[0]):
        return None
    if len(films) > 1:
        names = ", ".join(as_text(film.name) for film in films[:6])
        raise RecordingError(
            f"there are images of several films or focus scans ({names})",
            where=str(films[0].parent),
            mend="Give the film, or a pattern of its images' names in quotes. A focus scan becomes "
            "a look-up table first: mtpipe lut",
        )
    if not films:
        return None
    (film,) = films
    apart = [file for path in given if path != film for file in _files_of(path)]
    # camera programs put the images into a folder of their own, below the one of the experiment
    homes = [film, film.resolve().parent] if film.is_dir() else [film.parent]
    around = [file for home in homes for file in files_and_logs(home)]
    return GivenFilm(film, (*dict.fromkeys([*apart, *around]),))


def _films_at(path: Path) -> list[Path]:
    """Films at a path: itself, or those in a folder, of which names that begin alike are one."""
    if path.is_file():
        with path.open("rb") as stream:
            return [path] if stream.read(4) in TIFF_MAGICS else []
    names = {_first_word(p.name): p for p in sorted(path.iterdir()) if p.suffix.lower() in SUFFIXES}
    below = [p for p in sorted(path.iterdir()) if p.is_dir() and _has_images(p)]
    return [path] if len(names) == 1 and not below else [*names.values(), *below]


def _has_images(folder: Path) -> bool:
    return any(p.suffix.lower() in SUFFIXES for p in folder.iterdir())


def _holds_recording(folder: Path) -> bool:
    """Whether a folder of images holds a recording in numbers, and not just a scan's positions."""
    try:
        found = find_files([folder])
    except RecordingError:
        return False
    return any("x" in bead.axes for bead in found.columns.beads)


def _files_of(path: Path) -> list[Path]:
    return files_and_logs(path) if path.is_dir() else [path]


def files_and_logs(folder: Path) -> list[Path]:
    """Files that may hold a recording or the magnets' log: `.log` is never the former."""
    logs = [p for p in folder.iterdir() if p.is_file() and p.suffix.lower() == ".log"]
    return sorted([*data_files(folder), *logs], key=natural_order)


def find_files(paths: Sequence[Path]) -> FoundFiles:
    """Find out which of the files given, or those beside one that is given, are what.

    Raises
    ------
    RecordingError : there is no recording among them, or there are several.
    """
    folder, given, beside = _given(paths)
    looks: dict[Path, tuple[Look, Columns]] = {}
    others: list[Look] = []
    faults: list[RecordingError] = []
    for path in _representatives(given):
        try:
            look = look_at(path)
        except RecordingError as error:
            faults.append(error)
            continue
        try:
            looks[path] = look, columns_of(look)
        except RecordingError as error:
            faults.append(error)
            others.append(look)
    if not looks:
        if faults:
            raise faults[0]
        raise RecordingError("the folder has no data files", where=str(folder))
    shapes: dict[tuple[str, ...], list[Path]] = {}
    for path, (look, _) in looks.items():
        shapes.setdefault(look.shape, []).append(path)
    shape, members = max(shapes.items(), key=lambda one: (_beads(looks, one[1]), len(one[1])))
    chosen = {path: looks[path] for path in members}
    others += [look for path, (look, _) in looks.items() if path not in members]
    skeletons = {_skeleton(path) for path in members}
    files = tuple(p for p in given if p in chosen or (p not in looks and _skeleton(p) in skeletons))
    others = [look for look in others if look.path not in files]
    for path in beside:
        if not _is_alike(path, files):
            try:
                others.append(look_at(path))
            except RecordingError:
                continue  # whatever else lies there
    # what most of them look like: the first may begin with nothing
    alike = Counter(repr(columns.entries) for _, columns in chosen.values())
    usual = max(chosen, key=lambda path: alike[repr(chosen[path][1].entries)])
    look, columns = chosen[usual]
    logs = tuple(one for one in others if one.shape != shape)
    seen = tuple(one for one, _ in chosen.values())
    if len(files) == 1:
        return FoundFiles(folder, files, look, columns, logs=logs, seen=seen)
    together, restarts = _together(files, chosen, columns)
    return FoundFiles(folder, files, look, columns, together, restarts, logs, seen)


def _given(paths: Sequence[Path]) -> tuple[Path, list[Path], list[Path]]:
    """Folder, the files to be looked at, and those beside a single one."""
    paths = [one for given in paths for one in _named(given)]
    if len(paths) == 1 and paths[0].is_dir():
        files = _no_tables(data_files(paths[0]))
        return paths[0], files, [p for p in files_and_logs(paths[0]) if p not in files]
    files = [p for path in paths for p in (data_files(path) if path.is_dir() else [path])]
    folder = files[0].parent if files else paths[0]
    beside = [p for p in files_and_logs(folder) if p not in files] if len(files) == 1 else []
    return folder, sorted(files, key=natural_order), beside[:MOST_LOOKED_AT]


def _no_tables(files: Sequence[Path]) -> list[Path]:
    """Files without look-up tables, whose numbers are no recording."""
    return [path for path in files if not (path.suffix == ".npz" and _is_table(path))]


def _is_table(path: Path) -> bool:
    try:
        LookUpTable.load(path)
    except MtpipeError:
        return False
    return True


def _named(path: Path) -> list[Path]:
    """What is there under a name, or by a pattern."""
    found = [path] if path.exists() else named_like(path) if is_pattern(path) else []
    if not found:
        raise RecordingError("there is no such file or folder", where=str(path))
    return found


def _first_word(name: str) -> str:
    """The first letters of a name: files of one film share them, whatever number follows."""
    found = re.search(r"[^\W\d_]+", name)
    return found[0] if found else ""


def _skeleton(path: Path) -> str:
    return re.sub(r"\d+", "#", as_text(path.name))


def _is_alike(path: Path, files: Sequence[Path]) -> bool:
    """Whether a file beside the recording is another recording of its kind, by its name."""
    return any(_skeleton(path) == _skeleton(file) for file in files)


def _representatives(files: Sequence[Path]) -> list[Path]:
    """All files, or of many with like names the first two and some of the others."""
    groups: dict[str, list[Path]] = {}
    for path in files:
        groups.setdefault(_skeleton(path), []).append(path)
    chosen = []
    for group in groups.values():
        if len(group) > MOST_LOOKED_AT:
            group = [group[1], *group[:: len(group) // SPREAD_OVER]]
        chosen += group
    return sorted(chosen, key=natural_order)


def _beads(looks: dict[Path, tuple[Look, Columns]], members: Sequence[Path]) -> int:
    """Columns of positions times rows: a recording has more than what lies beside it."""
    return max(
        sum(len(b.axes) for b in looks[p][1].beads) * looks[p][0].rows for p in members
    ) * len(members)


def _together(
    files: Sequence[Path], looks: dict[Path, tuple[Look, Columns]], usual: Columns
) -> tuple[Together, bool]:
    """How files of the same columns belong together, and whether each begins its clock anew.

    Raises
    ------
    RecordingError : they are recordings of their own.
    """
    seen = [(path, *looks[path]) for path in files if path in looks]
    one_bead = all(len(columns.beads) == 1 for _, _, columns in seen)
    same_rows = len({look.rows for _, look, _ in seen}) == 1
    clocks = [columns.time or columns.frame for _, _, columns in seen]
    if one_bead and same_rows and len(seen) > 1:
        first = clocks[0]
        if first is not None and all(
            c is not None and np.array_equal(c.seconds, first.seconds) for c in clocks
        ):
            return "beads", False
        if first is None and all(BEAD_WORDS.search(as_text(p.stem)) for p in files):
            return "beads", False
    pairs = [
        (a, b) for a, b in itertools.pairwise(seen) if files.index(b[0]) == files.index(a[0]) + 1
    ]
    goes_on = [_goes_on(a[1], b[1], usual) for a, b in pairs]
    starts = [float(c.values[0].astype(np.float64)) for c in clocks if c is not None]
    rising = len(starts) == len(seen) and all(np.diff(starts) > 0)
    numbered = len({_skeleton(path) for path in files}) == 1
    if rising or (numbered and goes_on and np.mean([one is not False for one in goes_on]) > 0.5):
        restarts = len(starts) == len(seen) and not rising
        return "series", restarts
    names = ", ".join(as_text(path.name) for path in files[:5])
    raise RecordingError(
        f"{len(files)} files have the same columns ({names}{', ...' if len(files) > 5 else ''}), "
        "and none goes on where another ends: they seem to be recordings of their own",
        where=str(files[0].parent),
        mend="Give one of them.",
    )


def _goes_on(look: Look, following: Look, columns: Columns) -> bool | None:
    """Whether beads are at the beginning of a file where they were at another's end.

    None where that cannot be told.
    """
    if look.rows >= MOST_ROWS:
        return None
    then = {column.told: column.seconds for column in following.columns}
    now = {column.told: column.seconds for column in look.columns}
    near = []
    for told in (column.told for bead in columns.beads for column in bead.axes.values()):
        last, first = now[told][np.isfinite(now[told])], then[told][np.isfinite(then[told])]
        if len(last) < 2 * EDGE_ROWS or len(first) < EDGE_ROWS:
            continue
        step = np.median(np.abs(np.diff(last)))
        apart = abs(np.median(last[-EDGE_ROWS:]) - np.median(first[:EDGE_ROWS]))
        near.append(apart < FARTHEST_STEPS * step)
    return bool(np.mean(near) > 0.5) if near else None
