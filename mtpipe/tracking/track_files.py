"""Writing a tracked recording piece by piece, so that its length costs no memory.

Rows go to a file of their own beside the recording; at the end the notes on tracking, which are
known only then, are put before them and the whole takes its place. CSV, `.csv.gz` and Parquet, by
the name.
"""

from __future__ import annotations

import gzip
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np

from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.files import clear_leftovers
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.tracked import COMMENT, PARQUET_KEY, Notes
from mtpipe.recording.recording import AXES

if TYPE_CHECKING:
    import pyarrow as pa

# Digits after the point: µs, nm of the magnets, pm of the beads, and of the quality.
TIME_DIGITS, MAGNET_DIGITS, POSITION_DIGITS, QUALITY_DIGITS = 6, 6, 3, 4


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a recording: n frames.

    Attributes
    ----------
    time_s, magnet_mm : (n,); no magnets: None.
    positions_nm : (n, 3) per bead, NaN where lost.
    quality : (n,) per bead.
    """

    time_s: FloatArray
    magnet_mm: FloatArray | None
    positions_nm: Mapping[str, FloatArray]
    quality: Mapping[str, FloatArray]

    def table(self) -> pa.Table:
        """The columns as FORMATS has them, NaN as null."""
        import pyarrow as pa

        columns = {"time_s": np.round(self.time_s, TIME_DIGITS)}
        if self.magnet_mm is not None:
            columns["magnet_mm"] = np.round(self.magnet_mm, MAGNET_DIGITS)
        for bead, xyz in self.positions_nm.items():
            for k, axis in enumerate(AXES):
                columns[f"{bead}_{axis}_nm"] = np.round(xyz[:, k], POSITION_DIGITS)
            columns[f"{bead}_quality"] = np.round(self.quality[bead], QUALITY_DIGITS)
        return pa.table({name: pa.array(x, from_pandas=True) for name, x in columns.items()})


def check_out(out: Path) -> None:
    """Fail before the work where the recording cannot be written.

    Raises
    ------
    MtpipeError : a suffix that is no recording's, or a folder that cannot be written.
    """
    if not out.name.endswith((".csv", ".csv.gz", ".parquet")):
        raise MtpipeError(
            "a recording is written as .csv, .csv.gz or .parquet",
            where=str(out),
            mend="Choose another --out.",
        )
    with _told(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        clear_leftovers(out.parent, out.name)
        trial = _beside(out)
        trial.touch()
        trial.unlink()


class RecordingWriter:
    """Takes rows and in the end the notes; use it by `recording_written_whole`."""

    def __init__(self, out: Path, temporary: Path) -> None:
        self._out, self._rows = out, temporary
        self._stream: IO[bytes] | None = None
        self._parquet: Any = None
        self._header = b""

    def write(self, rows: Rows) -> None:
        """Append rows; all calls have the same columns.

        Raises
        ------
        MtpipeError : they cannot be written, as on a full disc.
        """
        with _told(self._out):
            self.write_table(rows.table())

    def write_table(self, table: pa.Table) -> None:
        """Append rows to the file that is begun: Parquet or CSV, as its name says."""
        if self._out.suffix == ".parquet":
            import pyarrow.parquet as pq

            if self._parquet is None:
                self._parquet = pq.ParquetWriter(self._rows, table.schema)
            self._parquet.write_table(table)
            return
        from pyarrow import csv

        if self._stream is None:
            self._header = (",".join(table.column_names) + "\n").encode()
            self._stream = self._opened(self._rows)
        options = csv.WriteOptions(include_header=False, quoting_style="none")
        csv.write_csv(table, self._stream, options)

    def finish(self, notes: Notes) -> None:
        """Put the notes before the rows and the whole in its place; raises as `write`."""
        with _told(self._out):
            self._finish(notes)

    def _finish(self, notes: Notes) -> None:
        if self._parquet is not None:
            self._parquet.add_key_value_metadata({PARQUET_KEY: notes.as_json()})
            self.close()
            self._rows.replace(self._out)
            return
        self.close()
        whole = self._rows.with_name(self._rows.name + ".whole")
        try:
            # a gzip file may have several members: the notes are one, the rows the next
            with self._opened(whole) as head:
                head.write((COMMENT + notes.as_json() + "\n").encode() + self._header)
            with whole.open("ab") as target, self._rows.open("rb") as rows:
                shutil.copyfileobj(rows, target)
                target.flush()
                os.fsync(target.fileno())
            whole.replace(self._out)
        finally:
            whole.unlink(missing_ok=True)

    def close(self) -> None:
        """Close what is open."""
        for one in (self._stream, self._parquet):
            if one is not None:
                one.close()
        self._stream = self._parquet = None

    def _opened(self, path: Path) -> IO[bytes]:
        if self._out.suffix == ".gz":
            return cast(IO[bytes], gzip.open(path, "wb"))
        return path.open("wb")


@contextmanager
def recording_written_whole(out: Path) -> Iterator[RecordingWriter]:
    """A writer whose recording appears when `finish` has been called, and never in part."""
    temporary = _beside(out)
    writer = RecordingWriter(out, temporary)
    try:
        yield writer
    finally:
        with suppress(OSError):
            writer.close()
        temporary.unlink(missing_ok=True)


@contextmanager
def _told(out: Path) -> Iterator[None]:
    """Turn what the system says against writing into an error in words."""
    try:
        yield
    except OSError as error:
        raise MtpipeError(
            f"cannot be written ({error.strerror})", where=str(out), mend="Choose another --out."
        ) from None


def _beside(out: Path) -> Path:
    return out.with_name(f".{out.name}.{os.getpid()}.rows")
