"""What is in a run's folder: whose files they are, whether they are whole."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from pyarrow.fs import LocalFileSystem

from mtpipe.report.run_folder import RUN

# What two runs of the same recording have of their own, besides their identities.
OWN_KEYS = ("started", "seconds")
OWN_ROWS = re.compile(rb"<dt>(Started|Time taken)</dt>\s*<dd>.*?</dd>", re.DOTALL)
Contents = Mapping[str, bytes]


@dataclass(frozen=True)
class Found:
    """A folder after something happened to the run that was to be written there.

    Attributes
    ----------
    whole : "old" or "new" where all files of that run are there and no others, else "".
    torn : a file is of neither run, such as half a file; or `run.json` is there and others are not.
    mixed : there are files of both.
    """

    whole: str
    torn: bool
    mixed: bool


class TornError(Exception):
    """A file cannot be read."""


def found(out: Path, runs: Mapping[str, Contents]) -> Found:
    """What a folder holds, where it can be files of these runs."""
    files = visible(out)
    owners, identities = [], set()
    for name, path in files.items():
        try:
            content, identity = read(path)
        except TornError:
            return Found("", torn=True, mixed=False)
        owners.append({run for run, contents in runs.items() if contents.get(name) == content})
        identities |= {identity} - {None}
    if not all(owners):
        return Found("", torn=True, mixed=False)
    common = set(runs).intersection(*owners)
    whole = [run for run in common if set(files) == set(runs[run])]
    return Found(
        whole[0] if whole and len(identities) == 1 else "",
        torn=RUN in files and bool(common) and not whole,
        mixed=not common or len(identities) > 1,
    )


def contents(out: Path) -> Contents:
    """All files of a run that nobody disturbed, as `read` has them."""
    return {name: read(path)[0] for name, path in visible(out).items()}


def visible(out: Path) -> dict[str, Path]:
    """Files by name, without those that a run hides as it fills or changes them."""
    return {
        path.relative_to(out).as_posix(): path
        for path in out.rglob("*")
        if path.is_file() and not path.relative_to(out).parts[0].startswith(".")
    }


def leftovers(out: Path) -> list[str]:
    """What is hidden within a folder, or stands beside it."""
    hidden = [path.name for path in out.rglob("*") if path.name.startswith(".")]
    return hidden + [path.name for path in out.parent.iterdir() if path != out]


def read(path: Path) -> tuple[bytes, str | None]:
    """Content of a file without what is its run's own, and the identity of the run if it has one.

    Raises
    ------
    TornError : it cannot be read.
    """
    try:
        if path.suffix == ".parquet":
            table = pd.read_parquet(
                path, filesystem=LocalFileSystem(), page_checksum_verification=True
            )
            identity = str(table.attrs.pop("run"))
            buffer = io.BytesIO()
            table.to_parquet(buffer, index=False)
            return buffer.getvalue(), identity
        if path.suffix == ".json":
            told = json.loads(path.read_bytes())
            identity = told.pop("run")
            kept = {key: value for key, value in told.items() if key not in OWN_KEYS}
            return json.dumps(kept).encode(), identity
        content = path.read_bytes()
        return OWN_ROWS.sub(b"", content) if path.suffix == ".html" else content, None
    except Exception as error:  # pyarrow and pandas raise anything on half a file
        raise TornError(str(path)) from error
