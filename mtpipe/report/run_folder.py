"""One folder is one run: a new one is written beside the old one and takes its place whole.

A run fills a hidden folder within its own, as that may be the only place that can be written. Once
all of it is there, the folder is renamed: from then on the new run counts, and whoever comes next
finishes what was interrupted. First the old run's files go, `run.json` before all others; then the
new ones come, `run.json` last. So files of two runs never stand side by side, whenever a process is
killed, and a folder with `run.json` is whole.

Another hidden folder is the run's journal: what is done of it, for the same run to go on from.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.files import clear_leftovers, scratch_name

RUN, RECORDING = "run.json", "recording.csv"
# What a run writes, but for the recording of a film: that may have become the input of another.
RESULTS = (
    *("forces.parquet", "forces.csv", "beads.parquet", "beads.csv"),
    *("crosscheck.parquet", "mismatch.json", "details", "report"),
    *("rotation.csv", "rotation.html"),
)
# The new run: whole, while the old one goes; and while its files take their places.
WHOLE, COMING = ".mtpipe-whole", ".mtpipe-coming"
SCRATCH = "mtpipe-run"
JOURNAL = ".mtpipe-journal-"


@contextmanager
def new_run(out: Path) -> Iterator[Path]:
    """Give an empty folder to fill, which becomes the run in `out` on leaving without an error.

    With an error, `out` stays as it was. What killed runs left is cleared.

    Raises
    ------
    MtpipeError : the folder cannot be written.
    """
    make_ready(out)
    fresh = out / scratch_name(SCRATCH)
    fresh.mkdir()
    try:
        yield fresh
        fresh.rename(out / WHOLE)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
    finish(out)


def make_ready(out: Path) -> None:
    """Make a folder that runs can be written into, and clear what killed ones left in it.

    Raises
    ------
    MtpipeError : the folder cannot be written.
    """
    _check_writable(out)
    finish(out)
    clear_leftovers(out, SCRATCH)


@contextmanager
def journal(out: Path, content: str) -> Iterator[Path]:
    """The folder in which a run of this content keeps what is done; journals of others are removed.

    With an error, the recording of a film, which may have taken hours, is put into `out` where
    there is no earlier run.
    """
    mine = out / f"{JOURNAL}{content[:16]}"
    clear_journals(out, but=mine)
    try:
        yield mine
    except BaseException:
        if (mine / RECORDING).exists() and not (out / RUN).exists():
            shutil.copyfile(mine / RECORDING, out / RECORDING)
        raise


def clear_journals(out: Path, *, but: Path | None = None) -> None:
    """Remove what runs in a folder have kept of what was done."""
    for one in out.glob(f"{JOURNAL}*"):
        if one != but:
            shutil.rmtree(one, ignore_errors=True)


def told(out: Path) -> dict[str, Any]:
    """`run.json` of the run in a folder; empty where there is none that can be read."""
    try:
        content = json.loads((out / RUN).read_bytes())
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def finish(out: Path) -> None:
    """Finish the change to a new run, if a process was killed within it."""
    whole, coming = out / WHOLE, out / COMING
    if whole.is_dir() and not coming.is_dir():
        for name in (RUN, *RESULTS):
            _remove(out / name)
        whole.rename(coming)
    if coming.is_dir():
        for file in sorted(coming.iterdir(), key=lambda file: file.name == RUN):
            _remove(out / file.name)
            file.rename(out / file.name)
        coming.rmdir()


def refuse_to_erase(out: Path) -> None:
    """Raise MtpipeError if a folder holds a cross-check, which a run without one would erase."""
    try:
        beads = json.loads((out / "mismatch.json").read_bytes())["beads"]
    except (OSError, ValueError, LookupError, TypeError):  # there is none, or none that can be read
        return
    if beads:
        raise MtpipeError(
            "holds the cross-check of an earlier run, which a run without one would erase",
            where=str(out),
            mend="Choose another --out, or say --overwrite.",
        )


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _check_writable(out: Path) -> None:
    """Fail before the work, not after it, where the folder cannot be written."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise MtpipeError(
            f"cannot be written ({error.strerror})", where=str(out), mend="Choose another --out."
        ) from None
