"""What a preset leaves to the files: which of them is the motor log, how many beads there are.

Each instrument has a function that looks at the heads of the files and completes the setup's
`[source]`; what it had to guess is said in a notice. What the user states is left as it is.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice, Severity
from mtpipe.ingest.arrays import open_arrays
from mtpipe.ingest.column_attributes import RATE_TOLERANCE
from mtpipe.ingest.data_files import Found, data_files
from mtpipe.ingest.kinds import kind_of
from mtpipe.ingest.text import open_text
from mtpipe.setup.presets import CALISTO_HDF5, CALISTO_TEXT, DEKKER_TEXT, SHON_TEXT
from mtpipe.setup.source_parts import BeadColumns, Layout
from mtpipe.setup.source_signals import Magnet, Rotation
from mtpipe.setup.source_table import Source

MOTOR_COLUMNS = (3, 4)  # frame, time stamp, magnet, and rotation in some
NO_MAGNET = "or write magnet = false if they rested all the time"


@dataclass(frozen=True)
class Facts:
    """What the files of an instrument say beyond the setup.

    `source` is complete; `files` are those with positions; `references` are beads that the layout
    says are fixed to the surface; `rate_hz` is None where no file gives the frame rate.
    """

    source: Source
    files: tuple[Path, ...]
    references: tuple[str, ...] = ()
    rate_hz: float | None = None
    notices: tuple[Notice, ...] = ()


def look_at(found: Found, source: Source) -> Facts:
    """Complete a preset from the files of the recording.

    Raises
    ------
    RecordingError : a file that the layout needs is missing, has other columns than the layout,
        or contradicts the setup.
    """
    looks = {
        CALISTO_TEXT: _calisto_text,
        CALISTO_HDF5: _calisto_hdf5,
        DEKKER_TEXT: _dekker_text,
        SHON_TEXT: _shon_text,
    }
    look = looks.get(source.preset or "")
    return look(found, source) if look is not None else Facts(source, found.files)


def _calisto_text(found: Found, source: Source) -> Facts:
    """Bead files have 2 + 3 columns per bead and motor files 3 or 4, so they can be told apart."""
    widths = {file: _width(file, source) for file in found.files}
    files = tuple(file for file, width in widths.items() if width not in MOTOR_COLUMNS)
    if not files:
        raise RecordingError(
            f"has {widths[found.files[0]]} columns and is a motor file; the bead file has frame, "
            "time stamp and x, y, z of every bead",
            where=str(found.files[0]),
        )
    for file in files:
        _refuse_width(file, widths[file], 2, "frame, time stamp and x, y, z of every bead")
    notices = []
    beads, named = _named_beads(source, 3, [f"b{k}" for k in range((widths[files[0]] - 2) // 3)])
    if named:
        notices.append(
            _guess(f"Beads have no names in the file: in the order of its columns they are {named}")
        )
    update: dict[str, Any] = {"beads": beads}
    magnet, said = _calisto_motors(found, source, files)
    if magnet is not None:
        update["magnet"] = magnet
        notices += [_guess(sentence) for sentence in said]
        log = magnet.logs(files, found.folder)[0]
        turned = log.is_file() and _width(log, magnet) == max(MOTOR_COLUMNS)
        if turned and "rotation" not in source.model_fields_set:
            update["rotation"] = Rotation(column=4, unit="turn", in_log=True)
    return Facts(source.model_copy(update=update), files, notices=tuple(notices))


def _calisto_motors(
    found: Found, source: Source, files: Sequence[Path]
) -> tuple[Magnet | None, list[str]]:
    """The table of the motor file, which is looked for beside the beads unless it is named."""
    magnet = source.magnet
    if magnet is None:
        return None, []
    update: dict[str, Any] = {}
    said = []
    if magnet.file is None:
        folder = files[0].parent
        logs = [p for p in data_files(folder) if _is_calisto_log(p, magnet)]
        if len(logs) != 1:
            wrong = (
                f"{len(logs)} files look like motor files ({', '.join(p.name for p in logs[:5])})"
                if logs
                else "there is no motor file (frame, time stamp, magnet position)"
            )
            raise RecordingError(
                f"{wrong} beside {files[0].name}",
                where=str(folder),
                mend=f"Name it with [source.magnet] file, {NO_MAGNET}.",
            )
        update["file"] = os.path.relpath(logs[0], found.folder)
        said.append(f"{logs[0].name} is taken for the motor file, by its number of columns")
    if "time_unit" not in magnet.model_fields_set and source.time is not None:
        update["time_unit"] = source.time.unit
        said.append(f"The motor file's time stamps are taken in {source.time.unit}, as the beads'")
    return magnet.model_copy(update=update), said


def _is_calisto_log(path: Path, layout: Layout) -> bool:
    try:
        return _width(path, layout) in MOTOR_COLUMNS
    except RecordingError:  # something else that lies in the folder
        return False


def _calisto_hdf5(found: Found, source: Source) -> Facts:
    if kind_of(found.files[0]) != "hdf5":
        return Facts(source, found.files)
    names = open_arrays(found.files[0], "hdf5").names
    notices = []
    if source.time is not None and source.time.column == "timestamp":
        notices.append(_guess(f"The dataset timestamp is taken in {source.time.unit}"))
    update: dict[str, Any] = {}
    turns = "stage/mag_rot_turn"
    logged = source.magnet is not None and source.magnet.time_column is not None
    if turns in names and logged and "rotation" not in source.model_fields_set:
        update["rotation"] = Rotation(column=turns, unit="turn", in_log=True)
    references: tuple[str, ...] = ()
    if any(bead.name == "R{n}" for bead in source.beads):
        matches = [re.fullmatch(r"(R\d+)/x_nm", name) for name in names]
        beads = tuple(match[1] for match in matches if match)
        references = tuple(b for b in beads if b not in source.leave_out)
    if references:
        notices.append(_of_layout(f"Reference beads, as the file has them: {_list(references)}"))
    return Facts(source.model_copy(update=update), found.files, references, notices=tuple(notices))


def _dekker_text(found: Found, source: Source) -> Facts:
    notices = []
    update: dict[str, Any] = {}
    if not source.beads:
        width = _width(found.files[0], source)
        if width not in (2, 3):
            raise RecordingError(
                f"has {width} columns, where y, z or x, y, z of one bead are expected",
                where=str(found.files[0]),
                mend="Describe them with [source] beads.",
            )
        axes = "xyz"[3 - width :]
        columns = {axis: k + 1 for k, axis in enumerate(axes)}
        update["beads"] = (BeadColumns.model_validate({"name": "b1", **columns}),)
        notices.append(_guess(f"The columns are taken for {', '.join(axes)} of one bead, b1"))
    magnet = source.magnet
    if magnet is not None and magnet.row_by_row:
        for log in magnet.logs(found.files, found.folder):
            width = _width(log, magnet) if log.is_file() else 1
            if width > 1 and magnet.column == 1:
                raise RecordingError(
                    f"has {width} columns, where one, the magnet height, is expected",
                    where=str(log),
                    mend="Say which it is with [source.magnet] column.",
                )
    return Facts(source.model_copy(update=update), found.files, notices=tuple(notices))


def _shon_text(found: Found, source: Source) -> Facts:
    if len(found.files) > 1:
        raise RecordingError(
            f"{len(found.files)} recordings are there ({_list([f.name for f in found.files])}), "
            "each with a clock of its own",
            where=str(found.folder),
            mend="Give one of them, or name it with [source] files.",
        )
    file = found.files[0]
    called = re.fullmatch(r"r(\d+)-\d+\..*", file.name)
    notices = []
    update: dict[str, Any] = {}
    magnet = source.magnet
    if magnet is not None and magnet.file is None:
        log = file.with_name(f"s{file.name[1:]}")
        if called is None or not log.is_file():
            raise RecordingError(
                f"there is no motor log s{called[0][1:]} beside it"
                if called
                else "is not called r###-###.xls, so the name of its motor log is not known",
                where=str(file),
                mend=f"Name it with [source.magnet] file, {NO_MAGNET}.",
            )
        update["magnet"] = magnet.model_copy(update={"file": os.path.relpath(log, found.folder)})
    width = _width(file, source)
    _refuse_width(file, width, 1, "frame number and x, y, z of the reference bead and every other")
    beads, named = _named_beads(source, 2, ["ref1", *(f"b{k}" for k in range(1, (width - 1) // 3))])
    update["beads"] = beads
    references = beads[0].names[:1] if beads[0].first_column == 2 else ()
    if named:
        notices.append(
            _of_layout(f"Beads in the order of the columns: {named}, the first fixed to the glass")
        )
    rate = None
    calibration = file.with_name(f"c{called[1]}.fps") if called else None
    if calibration is not None and calibration.is_file():
        rate, said = _shon_calibration(calibration, [*beads[0].names[1:]])
        notices += said
    stated = found.setup.camera.frame_rate_hz.value
    if rate is None and stated is None:
        raise RecordingError(
            f"there is no {calibration.name if calibration else 'c###.fps'} beside it to say the "
            "frame rate",
            where=str(file),
            mend="Give camera.frame_rate_hz.",
        )
    if rate is not None and stated is not None and abs(rate / stated - 1) > RATE_TOLERANCE:
        raise RecordingError(
            f"says {rate:g} frames per second, the setup {stated:g}",
            where=str(calibration),
            mend='Correct camera.frame_rate_hz (or write "unknown").',
        )
    return Facts(source.model_copy(update=update), found.files, references, rate, tuple(notices))


def _shon_calibration(path: Path, beads: Sequence[str]) -> tuple[float, list[Notice]]:
    """Frame rate; and how far off its pole each bead is held, which is told and not corrected.

    The second line of the file is that distance in nm, the third +1 or -1 for beads that lean to
    the left or right (Shon et al., Sci. Adv. 2019, eaav1697).
    """
    try:
        lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
        rows = [[float(cell) for cell in re.split(r"[\s,;]+", line.strip())] for line in lines]
    except (ValueError, OSError) as error:
        raise RecordingError(f"cannot be read ({error})", where=str(path)) from None
    if not rows or not 0 < rows[0][0] < float("inf"):
        raise RecordingError("has no frame rate in its first line", where=str(path))
    rate = rows[0][0]
    notices = [_of_layout(f"The frame rate, {rate:g} Hz, is that of {path.name}")]
    for row, what in zip(rows[1:3], ("tether offsets", "orientations"), strict=False):
        if beads and len(row) != len(beads):
            said = f"{path.name} has {len(row)} {what} for {len(beads)} magnetic beads"
            notices.append(_of_layout(said, "caution"))
            return rate, notices
    if len(rows) >= 3:
        for bead, offset, lean in zip(beads, rows[1], rows[2], strict=False):
            if offset != 0:
                side = "left" if lean > 0 else "right"
                said = (
                    f"{path.name}: the tether holds bead {bead} {offset:g} nm off its pole, and "
                    f"the bead leans to the {side}; z is not corrected for it."
                )
                notices.append(Notice("tether_offset", "caution", said, bead=bead))
    return rate, notices


def _named_beads(
    source: Source, first_column: int, names: Sequence[str]
) -> tuple[tuple[BeadColumns, ...], str]:
    """The beads with names, and the names in words; as they stand where the user described them."""
    entry = source.beads[0]
    as_preset = entry.first_column == first_column and entry.order == "xyz"
    if len(source.beads) > 1 or not as_preset or entry.names:
        return source.beads, ""
    return (entry.model_copy(update={"names": tuple(names)}),), _list(names)


def _width(path: Path, layout: Layout) -> int:
    """Number of columns of a text file.

    Raises
    ------
    RecordingError : the file is of another kind, such as an Excel workbook.
    """
    kind = kind_of(path)
    if kind != "text":
        raise RecordingError(f"is {kind}, where text is expected", where=str(path))
    return len(open_text(path, layout).names)


def _refuse_width(path: Path, width: int, before: int, expected: str) -> None:
    if width < before + 3 or (width - before) % 3:
        raise RecordingError(f"has {width} columns, where {expected} are expected", where=str(path))


def _guess(sentence: str) -> Notice:
    return Notice("guessed_layout", "info", f"{sentence}.")


def _of_layout(sentence: str, severity: Severity = "info") -> Notice:
    return Notice("preset", severity, f"{sentence}.")


def _list(names: Sequence[str]) -> str:
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
