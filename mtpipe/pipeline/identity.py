"""What a run is asked for, and the identity of all that decides its numbers.

Two runs with the same identity have the same numbers, whenever and wherever they are made. It is
known before the recording is read, from the checksums of its files.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from mtpipe.ground.version import VERSION
from mtpipe.ingest.data_files import SETUP_NAME, describe, find_recording
from mtpipe.ingest.read import with_preset
from mtpipe.report.marks import Mark, read_marks
from mtpipe.setup.setup import Setup, read_setup
from mtpipe.setup.tables import EFFECTS_GROUP
from mtpipe.tracking.stack import find_files, is_stack


@dataclass(frozen=True)
class Asked:
    """What a run is asked for.

    Attributes
    ----------
    path, out, setup, seed, methods, cross_check, overwrite : as of `mtpipe.run`.
    growing : its files are still being written; what of it is whole is taken (`pipeline.growing`).
    """

    path: Path
    out: Path
    setup: Path | None = None
    seed: int = 0
    methods: tuple[str, ...] = ()
    cross_check: bool = True
    overwrite: bool = False
    growing: bool = False

    @property
    def film(self) -> bool:
        """Whether the recording is an image stack, which is tracked first."""
        return is_stack(self.path, self.setup)

    @property
    def stretches(self) -> tuple[Mark, ...]:
        """Stretches of time that a reader leaves out by hand."""
        return tuple(mark for mark in read_marks(self.out) if mark.stretch_s is not None)

    @property
    def setup_file(self) -> Path:
        """The setup, of a film."""
        folder = self.path if self.path.is_dir() else self.path.parent
        return folder / SETUP_NAME if self.setup is None else self.setup


def identity(asked: Asked) -> str:
    """SHA-256 of versions, setup as read, content of all files, and what is asked for.

    Raises
    ------
    MtpipeError : there is no setup that can be read, or no file.
    """
    setup, there, folder = _read_from(asked)
    content = {
        "left out": [(one.bead, one.stretch_s) for one in asked.stretches],
        "version": VERSION,
        "effects": sorted(_with_version(entry) for entry in entry_points(group=EFFECTS_GROUP)),
        "setup": setup.model_dump(mode="json", by_alias=True),
        "files": [asdict(describe(file, folder)) for file in there],
        "seed": asked.seed,
        "methods": asked.methods,
        "cross_check": asked.cross_check,
        "growing": asked.growing,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def files_of(asked: Asked) -> list[Path]:
    """All files that a run reads, but for its setup.

    Raises
    ------
    MtpipeError : as `identity`.
    """
    return _read_from(asked)[1]


def _read_from(asked: Asked) -> tuple[Setup, list[Path], Path]:
    """Setup, files that are there, and the folder of the recording."""
    setup, files, folder = _of_film(asked) if asked.film else _of_recording(asked)
    return setup, [file for file in dict.fromkeys(files) if file.is_file()], folder


def _with_version(entry: EntryPoint) -> str:
    """An effect of another package, and which it is of."""
    return f"{entry.value} {entry.dist.version if entry.dist is not None else ''}"


def _of_recording(asked: Asked) -> tuple[Setup, list[Path], Path]:
    found, _ = with_preset(find_recording(asked.path, asked.setup))
    magnet = None if found.setup.source is None else found.setup.source.magnet
    logs = [] if magnet is None else magnet.logs(found.files, found.folder)
    return found.setup, [*found.files, *logs], found.folder


def _of_film(asked: Asked) -> tuple[Setup, list[Path], Path]:
    setup, folder = read_setup(asked.setup_file), asked.setup_file.parent
    films = find_files(asked.path)
    tracking = setup.tracking
    tables = [tracking.look_up_table, *tracking.look_up_table_of.values()]
    logs = [] if tracking.magnet is None else tracking.magnet.logs(films, folder)
    return setup, [*films, *logs, *(folder / name for name in tables if name)], folder
