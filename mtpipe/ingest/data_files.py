"""Which files a recording consists of, and their checksums.

A gzipped file is opened as what it contains.
"""

from __future__ import annotations

import glob
import gzip
import hashlib
import os
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast

from mtpipe.ground.errors import RecordingError, SetupError
from mtpipe.ground.files import as_text
from mtpipe.ingest.bounded import BoundedReader
from mtpipe.recording.recording import SourceFile
from mtpipe.setup.presets import COLUMNS, PRESETS
from mtpipe.setup.setup import Setup, read_setup
from mtpipe.setup.source_table import Source

# What reading a packed file raises where it is damaged or cut off.
DAMAGE = (EOFError, zlib.error, OSError)
SETUP_NAME = "setup.toml"
NO_DATA = {".toml", ".md", ".json", ".py", ".pdf", ".png", ".jpg", ".tif", ".tiff", ".log"}


@dataclass(frozen=True)
class Found:
    """A recording as found on disk: its name, setup and files, in the order of reading."""

    name: str
    setup: Setup
    files: tuple[Path, ...]
    folder: Path


def find_recording(path: Path, setup: Path | str | Setup | None) -> Found:
    """Find the files of a recording and its setup.

    Parameters
    ----------
    path : a file, a folder, or a `setup.toml` that names the files (`mtpipe.ingest.load`).

    Raises
    ------
    RecordingError : there is no such file or no data file in the folder.
    SetupError : there is no setup, or it names no files where it must.
    """
    if not path.exists():
        raise RecordingError("there is no such file or folder", where=str(path))
    if path.suffix == ".toml":
        parsed = _setup(setup, path)
        if parsed.source is None or not parsed.source.knows_its_files:
            raise SetupError(
                "names no files to read", where=str(path), mend="Add files to its [source] table."
            )
        files = _in_folder(path.parent, parsed)
        return Found(as_text(path.parent.resolve().name), parsed, files, path.parent)
    folder = path if path.is_dir() else path.parent
    parsed = _setup(setup, folder / SETUP_NAME)
    if not path.is_dir():
        return Found(as_text(path.name), parsed, (path,), folder)
    files = _in_folder(folder, parsed)
    name = files[0].name if len(files) == 1 else folder.resolve().name
    return Found(as_text(name), parsed, files, folder)


def describe(path: Path, folder: Path) -> SourceFile:
    """Name, checksum and size of a file, read piece by piece."""
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    name = path.relative_to(folder) if path.is_relative_to(folder) else Path(path.name)
    return SourceFile(as_text(name.as_posix()), digest, path.stat().st_size)


@contextmanager
def open_stream(path: Path) -> Iterator[BinaryIO]:
    """Open a file for reading bytes, unpacking gzip on the way."""
    with BoundedReader(path) as stream:
        packed = stream.read(2) == b"\x1f\x8b"
        stream.seek(0)
        if not packed:
            yield stream
            return
        with gzip.GzipFile(fileobj=stream) as unpacked:
            yield cast(BinaryIO, unpacked)


def is_packed(stream: BinaryIO) -> bool:
    """Whether a stream unpacks gzip, in which jumping about takes long."""
    return isinstance(stream, gzip.GzipFile)


def read_begin(stream: BinaryIO, size: int) -> bytes:
    """The first bytes, up to `size` or as far as a packed stream goes that is cut off.

    Raises
    ------
    OSError, EOFError, zlib.error : there are none before the damage.
    """
    read = getattr(stream, "read1", stream.read)
    begin = b""
    try:
        while len(begin) < size and (piece := read(size - len(begin))):
            begin += piece
    except DAMAGE:
        if not begin:
            raise
    return begin


def _setup(setup: Path | str | Setup | None, default: Path) -> Setup:
    if isinstance(setup, Setup):
        return setup
    return read_setup(default if setup is None else Path(setup))


def data_files(folder: Path) -> list[Path]:
    """Files of a folder that may hold data, in name order."""
    files = [
        p
        for p in folder.iterdir()
        if p.is_file() and p.suffix.lower() not in NO_DATA and not p.name.startswith(".")
    ]
    return sorted(files, key=natural_order)


def _in_folder(folder: Path, setup: Setup) -> tuple[Path, ...]:
    """The recording's files: those that `[source] files` names, else all of the right kind."""
    named = setup.source is not None and setup.source.files
    return _named(folder, setup) if named else _data(folder, setup)


def _named(folder: Path, setup: Setup) -> tuple[Path, ...]:
    assert setup.source is not None
    found: list[Path] = []
    for pattern in setup.source.files:
        # an absolute pattern stands alone; "~" and ".." work as in a shell
        expanded = _pattern(folder / Path(pattern).expanduser())
        matches = [Path(p) for p in glob.glob(expanded, recursive=True) if Path(p).is_file()]
        if not matches:
            raise RecordingError(
                f"there is no file {pattern!r} there, though [source] files names it",
                where=str(folder),
            )
        found += [p for p in sorted(matches, key=natural_order) if p not in found]
    return tuple(found)


def _pattern(path: Path) -> str:
    """A pattern in which folders and files that are there stand for themselves, brackets or not."""
    there = Path(path.anchor)
    parts = [path.anchor] if path.anchor else []
    for part in path.parts[len(parts) :]:
        there = there / part
        parts.append(glob.escape(part) if there.exists() else part)
    return os.path.join(*parts)


def _data(folder: Path, setup: Setup) -> tuple[Path, ...]:
    log = _log_name(setup.source)
    preset = setup.source.preset if setup.source is not None else None
    layout = PRESETS[preset or COLUMNS]
    files = [p for p in data_files(folder) if p.name != log and re.fullmatch(layout.files, p.name)]
    if not files:
        kind = f" of preset {preset} ({layout.called})" if preset is not None else ""
        raise RecordingError(f"the folder has no data files{kind}", where=str(folder))
    kinds = sorted({"".join(p.suffixes[-2:]) if p.suffix == ".gz" else p.suffix for p in files})
    if len(kinds) > 1:
        raise RecordingError(
            f"the folder holds files of several kinds ({', '.join(kinds)})",
            where=str(folder),
            mend="Name the recording's own with [source] files.",
        )
    return tuple(files)


def _log_name(source: Source | None) -> str | None:
    return source.magnet.file if source is not None and source.magnet is not None else None


def natural_order(path: Path) -> list[tuple[int, int, str]]:
    """Sorts by name with numbers by value, so that 2.txt comes before 10.txt."""
    parts = re.findall(r"\d+|\D+", path.name)
    return [(0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts]
