"""Files of a known instrument: the preset whose layout they have."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from mtpipe.ingest.data_files import data_files
from mtpipe.proposal.laboratory_files import FoundFiles
from mtpipe.proposal.look import Look
from mtpipe.proposal.nature import nature_of
from mtpipe.setup.presets import (
    CALISTO_TEXT,
    DEKKER_TEXT,
    PRESETS,
    SHON_TEXT,
)


def magscope_files(paths: Sequence[Path]) -> tuple[Path, ...]:
    """The files given if they are MagScope's, whose ragged records are no table of columns."""
    from mtpipe.ingest.arrays import open_arrays
    from mtpipe.ingest.kinds import kind_of

    files = [p for path in paths for p in (data_files(path) if path.is_dir() else [path])]
    for file in files:
        if kind_of(file) != "hdf5":
            return ()
        if not any(
            name.startswith("tracking/frame_timestamps") for name in open_arrays(file, "hdf5").names
        ):
            return ()
    return tuple(files)


def preset_of(found: FoundFiles) -> str | None:
    """The preset that fits the files of a recording; None for a layout of its own."""
    look, file = found.look, found.files[0]
    by_names = (name for name, preset in PRESETS.items() if preset.has_columns(look.table.names))
    if known := next(by_names, None):
        return known
    if look.kind != "text" or look.table.has_names or len(found.files) > 1:
        return None
    width = len(look.table.names)
    if re.fullmatch(PRESETS[SHON_TEXT].files, file.name):
        return SHON_TEXT if (width - 1) % 3 == 0 and _beside(file, f"s{file.name[1:]}") else None
    if width in (2, 3) and _beside(file, f"{file.name.partition('.')[0]}_motors.txt"):
        return DEKKER_TEXT
    if (width - 2) % 3 == 0 and _is_calisto(look.columns[:2]):
        logs = [log for log in found.logs if _is_calisto_log(log)]
        return CALISTO_TEXT if len(logs) == 1 else None
    return None


def _beside(file: Path, name: str) -> bool:
    return file.with_name(name).is_file()


def _is_calisto(columns: Sequence[object]) -> bool:
    """Whether a file begins with a frame index and a time stamp."""
    index, stamp = (nature_of(column.seconds) for column in columns)  # type: ignore[attr-defined]
    return index in ("count", "clock") and stamp in ("clock", "count")


def _is_calisto_log(look: Look) -> bool:
    return (
        look.kind == "text"
        and not look.table.has_names
        and len(look.table.names) in (3, 4)
        and _is_calisto(look.columns[:2])
    )
