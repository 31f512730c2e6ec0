"""Which recordings there are below a folder, and which files are none.

A recording is a file with a setup beside it or in a folder above, up to where the search begins. A
setup whose `[source] files` names files makes one recording of them, in its own folder or in each
below that has files of these names. Images in a folder are one film.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mtpipe.ground.errors import MtpipeError, RecordingError
from mtpipe.ground.files import as_text
from mtpipe.ingest.data_files import SETUP_NAME, Found, data_files, find_recording, natural_order
from mtpipe.ingest.kinds import is_prose, kind_of
from mtpipe.ingest.read import with_preset
from mtpipe.report.run_folder import RUN
from mtpipe.setup.setup import Setup, read_setup
from mtpipe.tracking.stack import SUFFIXES


@dataclass(frozen=True)
class There:
    """A recording below a folder.

    Attributes
    ----------
    name : its path below that folder. path, setup : as for `mtpipe.load`.
    """

    name: str
    path: Path
    setup: Path


@dataclass(frozen=True)
class Aside:
    """A file or folder, by its path below the folder, that is no recording, and why."""

    name: str
    why: str


def recordings_below(folder: Path, leave: Path) -> tuple[list[There], list[Aside]]:
    """All recordings below a folder, and what was left aside.

    Parameters
    ----------
    leave : a folder that is not looked into, where results go.
    """
    found: list[There] = []
    aside: list[Aside] = []
    used: set[Path] = set()
    setups: dict[Path, Path] = {}

    def name_of(path: Path) -> str:
        below = path.relative_to(folder)
        return as_text(below.as_posix() if below.parts else path.resolve().name)

    for here, folders, names in os.walk(folder):
        place = Path(here)
        folders[:] = sorted(
            (n for n in folders if not n.startswith(".") and (place / n).resolve() != leave),
            key=lambda name: natural_order(Path(name)),
        )
        if RUN in names:
            folders.clear()
            aside.append(Aside(name_of(place), "is a run of mtpipe"))
            continue
        if SETUP_NAME in names:
            setups[place] = place / SETUP_NAME
        elif place != folder and place.parent in setups:
            setups[place] = setups[place.parent]
        files = [file for file in _files(place) if file.resolve() not in used]
        if place not in setups:
            why = f"no {SETUP_NAME} beside it or in a folder above"
            aside += [Aside(name_of(file), why) for file in files]
            continue
        here_found = _In(place, setups[place], files)
        found += [There(name_of(path), path, setups[place]) for path in here_found.recordings()]
        used |= {file.resolve() for file in here_found.used}
        aside += [Aside(name_of(file), why) for file, why in here_found.aside.items()]
    return found, [one for one in aside if (folder / one.name).resolve() not in used]


def _files(place: Path) -> list[Path]:
    """Files that may be recordings, images too, in the order of their names."""
    images = [
        path
        for path in place.iterdir()
        if path.suffix.lower() in SUFFIXES and path.is_file() and not path.name.startswith(".")
    ]
    return sorted([*data_files(place), *images], key=natural_order)


class _In:
    """What there is in one folder, with its setup.

    Attributes
    ----------
    used : files of recordings, and logs and tables that go with them. aside : others, and why.
    """

    def __init__(self, place: Path, setup: Path, files: Sequence[Path]) -> None:
        self.place, self.setup, self.files = place, setup, files
        self.used: set[Path] = set()
        self.aside: dict[Path, str] = {}

    def recordings(self) -> Iterator[Path]:
        """Paths of recordings."""
        try:
            stated = read_setup(self.setup)
        except MtpipeError:  # whoever reads a recording with it says what is wrong
            stated = None
        if stated is not None and stated.source is not None and stated.source.files:
            yield from self._named(stated)
            return
        images = [file for file in self.files if file.suffix.lower() in SUFFIXES]
        candidates = [file for file in self.files if file not in images]
        if stated is not None:
            candidates = self._with_positions(stated, candidates)
        candidates = [file for file in candidates if self._is_data(file)]
        for file in candidates:
            self.used.add(file)
            yield file
        if images and candidates:
            why = "images beside a recording, which may have been tracked from them"
            self.aside |= dict.fromkeys(images, why)
        elif images:
            self.used |= set(images)
            yield self.place

    def _named(self, stated: Setup) -> Iterator[Path]:
        """The one recording of files that a setup names, where they are there."""
        try:
            found = find_recording(self.place, stated)
        except RecordingError:
            if self.setup.parent == self.place and self.files:
                yield self.place  # whoever reads it says which are missing
                return
        else:
            self.used |= set(found.files) | self._logs(stated, found)
            yield self.place
        why = f"[source] files of {as_text(str(self.setup))} does not name it"
        self.aside |= {file: why for file in self.files if file not in self.used}

    def _with_positions(self, stated: Setup, files: list[Path]) -> list[Path]:
        """Files that hold positions; logs of the magnets and look-up tables are none."""
        tracking = stated.tracking
        tables = [tracking.look_up_table, *tracking.look_up_table_of.values()]
        self.used |= {self.setup.parent / name for name in tables if name}
        there = Found(self.place.name, stated, tuple(files), self.place)
        if tracking.magnet is not None:
            images = [file for file in self.files if file.suffix.lower() in SUFFIXES]
            self.used |= set(tracking.magnet.logs(images, self.setup.parent))
        if stated.source is not None and stated.source.knows_its_files:
            try:
                found = find_recording(self.place, stated)
                there, _ = with_preset(replace(found, files=found.files))
            except MtpipeError:
                pass  # whoever reads a file says what is wrong
            why = f"no file of positions of the preset {stated.source.preset}"
            self.aside |= {file: why for file in files if file not in there.files}
        self.used |= self._logs(there.setup, there)
        return [file for file in there.files if file not in self.used]

    def _logs(self, stated: Setup, found: Found) -> set[Path]:
        magnet = None if stated.source is None else stated.source.magnet
        if magnet is None or magnet.file is None:
            return set()
        return set(magnet.logs(found.files, found.folder))

    def _is_data(self, file: Path) -> bool:
        try:
            prose = kind_of(file) == "text" and is_prose(file)
        except RecordingError as error:
            self.aside[file] = error.message
            return False
        if prose:
            self.aside[file] = "has no row of numbers"
        return not prose
