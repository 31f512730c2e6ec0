"""Writing files and folders whole or not at all.

Content goes to a temporary neighbour on the same file system first and is then renamed, so that a
reader never meets half a file, and a run that is stopped leaves the previous result untouched.
"""

from __future__ import annotations

import os
import re
import shutil
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def as_text(name: str) -> str:
    """The name of a file as text that can be written anywhere.

    On Linux a name may have bytes that are no UTF-8, as files from Windows' disks and archives do;
    they are shown as `\\xfc`.
    """
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def in_one_line(text: str) -> str:
    """The text, in which signs that end a line or steer a terminal are shown: `\\n`, `\\x1b`."""
    return "".join(c if _is_shown(c) else c.encode("unicode_escape").decode() for c in text)


def _is_shown(sign: str) -> bool:
    return unicodedata.category(sign) not in ("Cc", "Zl", "Zp")


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all; text as UTF-8. The folder is made where it is missing, and
    what a killed process left of an earlier attempt is cleared.

    What is no Unicode, as of a file's name in another encoding, becomes a question mark.
    """
    data = content.encode("utf-8", "replace") if isinstance(content, str) else content
    path.parent.mkdir(parents=True, exist_ok=True)
    clear_leftovers(path.parent, path.name)
    # opened by name and not by `tempfile`, whose files only their owner may read
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def folder_written_whole(path: Path) -> Iterator[Path]:
    """Give an empty folder to fill; on leaving without an error it takes the place of `path`.

    With an error, `path` stays as it was. What `path` held before is removed only after the new
    folder stands in its place.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    clear_leftovers(path.parent, path.name)
    scratch = path.with_name(scratch_name(path.name))
    fresh, previous = scratch / "new", scratch / "previous"
    try:
        fresh.mkdir(parents=True)
        yield fresh
        if path.exists():
            path.rename(previous)
        try:
            fresh.rename(path)
        except OSError:
            if previous.exists():
                previous.rename(path)
            raise
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def scratch_name(name: str) -> str:
    """Name of a hidden folder that this process fills, for what is to be called `name`."""
    return f".{name}-{os.getpid()}"


def clear_leftovers(folder: Path, name: str) -> None:
    """Remove hidden files and folders for `name` whose processes have been killed."""
    hidden = re.compile(rf"\.{re.escape(name)}[-.](\d+)(\.[a-z]+)*")
    for left in folder.iterdir():
        match = hidden.fullmatch(left.name)
        if match is None or _is_running(int(match[1])):
            continue
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    if process == os.getpid():
        return False  # what an earlier process of this number left
    if os.name == "nt":  # where there is no way to ask that does no harm
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
