"""One folder is one run: a new one is written beside the old one and takes its place whole.

A run fills a hidden folder within its own, as that may be the only place that can be written. Once
all of it is there, the folder is renamed: from then on the new run counts, and whoever comes next
finishes what was interrupted. First the old run's files go, `run.json` before all others; then the
new ones come, `run.json` last. So files of two runs never stand side by side, whenever a process is
killed, and a folder with `run.json` is whole.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.files import clear_leftovers, scratch_name

RUN, RECORDING = "run.json", "recording.csv"
# What a run writes, but for the recording of a film: that may have become the input of another.
RESULTS = (
    *("forces.parquet", "forces.csv", "beads.parquet", "beads.csv"),
    *("crosscheck.parquet", "mismatch.json", "details", "report"),
)
# The new run: whole, while the old one goes; and while its files take their places.
WHOLE, COMING = ".mtpipe-whole", ".mtpipe-coming"
SCRATCH = "mtpipe-run"


@contextmanager
def new_run(out: Path) -> Iterator[Path]:
    """Give an empty folder to fill, which becomes the run in `out` on leaving without an error.

    With an error, `out` stays as it was, but for the recording of a film, which may have taken
    hours: where there is no earlier run it is kept. What killed runs left is cleared.

    Raises
    ------
    MtpipeError : the folder cannot be written.
    """
    _check_writable(out)
    finish(out)
    clear_leftovers(out, SCRATCH)
    fresh = out / scratch_name(SCRATCH)
    fresh.mkdir()
    try:
        yield fresh
        fresh.rename(out / WHOLE)
    except BaseException:
        if (fresh / RECORDING).exists() and not (out / RUN).exists():
            (fresh / RECORDING).replace(out / RECORDING)
        raise
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
    finish(out)


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
