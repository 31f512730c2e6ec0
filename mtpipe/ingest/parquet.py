"""Parquet files, read by row groups so that a long recording is never there twice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mtpipe.errors import RecordingError
from mtpipe.ingest.announced import check_fits
from mtpipe.recording import FloatArray

BLOCK_ROWS = 1 << 17


@dataclass(frozen=True)
class ParquetTable:
    """A Parquet file; attributes as in `text.TextTable`."""

    path: Path
    names: tuple[str, ...]
    has_names: bool = True
    guesses: tuple[str, ...] = ()

    def batches(self, wanted: Sequence[int]) -> Iterator[list[FloatArray]]:
        """Yield the wanted columns (positions from 0) block by block, nulls as NaN.

        Raises
        ------
        RecordingError : a column is no numbers, or the file is damaged.
        """
        chosen = [self.names[i] for i in wanted]
        try:
            with pq.ParquetFile(self.path) as file:
                check_fits(file.metadata.num_rows * len(wanted), str(self.path))
                for batch in file.iter_batches(BLOCK_ROWS, columns=list(dict.fromkeys(chosen))):
                    yield [self._numbers(batch.column(name), name) for name in chosen]
        except RecordingError:
            raise
        except Exception as error:  # a damaged file raises anything
            raise _damaged(self.path, error) from error

    def _numbers(self, column: pa.Array, name: str) -> FloatArray:
        kind = column.type
        if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_null(kind)):
            raise RecordingError(
                f"column {name} holds {kind} where numbers are expected", where=str(self.path)
            )
        return np.asarray(
            column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False), dtype=np.float64
        )


def open_parquet(path: Path) -> ParquetTable:
    """Read the names of the columns.

    Raises
    ------
    RecordingError : the file is damaged or two columns have one name.
    """
    try:
        with pq.ParquetFile(path) as file:
            names = tuple(file.schema_arrow.names)
    except Exception as error:  # a damaged file raises anything
        raise _damaged(path, error) from error
    double = sorted({n for n in names if names.count(n) > 1})
    if double:
        raise RecordingError(f"has two columns named {double[0]!r}", where=str(path))
    return ParquetTable(path, names)


def _damaged(path: Path, error: Exception) -> RecordingError:
    reason = f"{type(error).__name__}: {error}".splitlines()[0][:200]
    return RecordingError(f"is damaged ({reason})", where=str(path))
