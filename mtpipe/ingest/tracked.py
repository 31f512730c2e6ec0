"""What `mtpipe track` notes in the recordings it writes, beside the positions.

The notes travel with the file: as its first comment line in CSV, as metadata of the schema in
Parquet. They say by what the positions were tracked, how precise they are by the images, and that
z, where there is any, is a height in a look-up table, whose zero is not the surface until the
setup says so (`[source] z_zero`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.ingest.announced import HARMLESS_BYTES
from mtpipe.ingest.data_files import open_stream
from mtpipe.ingest.kinds import kind_of
from mtpipe.recording.recording import Tracked

SCHEMA = "mtpipe.tracking/1"
COMMENT = f"# {SCHEMA} "
PARQUET_KEY = SCHEMA


@dataclass(frozen=True)
class Notes:
    """The notes of one recording.

    Attributes
    ----------
    stack : name of the image stack.
    method : by which positions were found.
    precision_nm : x, y, z per bead, None where it is not known.
    look_up_table : name of each bead's table; beads without are absent.
    lost : how many frames each bead lost, by reason.
    notices : what was said when it was tracked.
    """

    stack: str
    method: str
    precision_nm: Mapping[str, tuple[float | None, float | None, float | None]]
    look_up_table: Mapping[str, str]
    lost: Mapping[str, Mapping[str, int]]
    notices: Sequence[Notice]

    def as_json(self) -> str:
        """The notes in one line; a question mark for what is no Unicode in the name of a file."""
        content = {"schema": SCHEMA, **asdict(self)}
        text = json.dumps(content, ensure_ascii=False, allow_nan=False)
        return text.encode("utf-8", "replace").decode("utf-8")


def notes_of(text: str, where: str) -> Notes:
    """The notes from their line.

    Raises
    ------
    RecordingError : they are damaged.
    """
    try:
        content: dict[str, Any] = json.loads(text)
        del content["schema"]
        content["notices"] = tuple(Notice(**one) for one in content["notices"])
        precision = content["precision_nm"]
        content["precision_nm"] = {bead: (x, y, z) for bead, (x, y, z) in precision.items()}
        return Notes(**content)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise RecordingError(
            f"its notes on tracking ({SCHEMA}) are damaged ({error})",
            where=where,
            mend="Track the stack again, or take the notes away.",
        ) from None


def read_notes(path: Path) -> Notes | None:
    """The notes in a canonical recording; None in one that `mtpipe track` did not write.

    Raises
    ------
    RecordingError : they are damaged.
    """
    if kind_of(path) == "parquet":
        import pyarrow.parquet as pq

        with pq.ParquetFile(path) as file:
            text = (file.metadata.metadata or {}).get(PARQUET_KEY.encode())
        return None if text is None else notes_of(text.decode(), str(path))
    begin = COMMENT.encode()
    with open_stream(path) as stream:
        if stream.read(len(begin)) != begin:
            return None
        return notes_of(stream.readline(HARMLESS_BYTES).decode("utf-8", "replace"), str(path))


def read_tracked(files: Sequence[Path]) -> tuple[Tracked | None, tuple[Notice, ...]]:
    """What the files of a recording say of their tracking, and the notices of that time."""
    notes = [one for one in map(read_notes, files) if one is not None]
    if not notes:
        return None, ()
    precision = {
        bead: tuple(float("nan") if one is None else one for one in values)
        for each in notes
        for bead, values in each.precision_nm.items()
    }
    tracked = Tracked(
        {bead: (values[0], values[1], values[2]) for bead, values in precision.items()},
        frozenset(bead for each in notes for bead in each.look_up_table),
    )
    return tracked, tuple(dict.fromkeys(notice for each in notes for notice in each.notices))
