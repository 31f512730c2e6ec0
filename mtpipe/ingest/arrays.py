"""Files that hold arrays: MATLAB, HDF5, netCDF, LabVIEW TDMS, numpy's, PicoTwist plots.

Each is presented as a table of columns with names (`contents`). Names in HDF5 are full paths
without the leading slash; in TDMS `group/channel`, or the channel alone where the file has one
group.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.files import as_text
from mtpipe.ingest.announced import check_fits, no_room
from mtpipe.ingest.bounded import unpacked
from mtpipe.ingest.column_attributes import NOTHING, Stated
from mtpipe.ingest.contents import BLOCK_BYTES, Array, Contents, values_of
from mtpipe.ingest.data_files import is_packed, open_stream
from mtpipe.setup.source_parts import TAKE, Format, Layout

# Formats whose index is at the end: of a file that is cut off nothing can be found.
INDEX_LAST: dict[Format, bytes] = {"npz": b"PK\x05\x06"}
END_BYTES = 1 << 16
# What HDF5 says of a file that a program has open, or had as it was stopped.
STILL_OPEN = ("already open for write", "consistency flags", "lock file")


@dataclass(frozen=True)
class ArrayTable:
    """A file of arrays seen as a table.

    `names`, `has_names`, `stated`, `unusable` and `remarks` as in `collect.OpenTable`; nothing
    about it is guessed. `lengths` are the columns' numbers of rows. `take`: of columns of different
    length the rows that all have are taken.
    `as_stated`: values are scaled, and lost, as the file says.
    """

    path: Path
    names: tuple[str, ...]
    kind: Format
    lengths: tuple[int, ...] = ()
    stated: tuple[Stated, ...] = ()
    unusable: Mapping[str, str] = field(default_factory=dict)
    take: bool = False
    as_stated: bool = True
    has_names: bool = True
    guesses: tuple[str, ...] = ()
    remarks: list[str] = field(default_factory=list, compare=False)

    def batches(self, wanted: Sequence[int]) -> Iterator[list[NDArray[Any]]]:
        """Yield the wanted columns (positions from 0) piece by piece.

        Yields
        ------
        (n,) float64 for each, or datetime64[ns] where it holds clock times.

        Raises
        ------
        RecordingError : columns of different length, or damage.
        """
        try:
            with _open(self.path, self.kind, self.take) as contents:
                columns = list(contents.columns())
                chosen = [columns[i] for i in wanted]
                count = self._rows([(column.name, array.rows) for array, column in chosen])
                check_fits(count * len(chosen), str(self.path))
                together: dict[int, list[int]] = {}
                for k, (array, _) in enumerate(chosen):
                    together.setdefault(id(array), []).append(k)
                step = _step([array for array, _ in chosen])
                for start in range(0, count, step):
                    stop = min(start + step, count)
                    batch: list[NDArray[Any]] = [None] * len(chosen)  # type: ignore[list-item]
                    for places in together.values():
                        of_array = [chosen[k][1] for k in places]
                        read = chosen[places[0]][0].read(start, stop, of_array)
                        for k, column, raw in zip(places, of_array, read, strict=True):
                            stated = column.stated if self.as_stated else NOTHING
                            batch[k] = values_of(raw, column, stated)
                    yield batch
        except RecordingError:
            raise
        except Exception as error:  # the libraries raise anything on a damaged file
            raise _damaged(self.path, self.kind, error) from error

    def _rows(self, lengths: list[tuple[str, int]]) -> int:
        """Number of rows that all columns have."""
        found = {rows for _, rows in lengths}
        least, most = min(found, default=0), max(found, default=0)
        if least == most or (self.take and least):
            if least < most:
                self.remarks.append(
                    f"{self.path.name}: {least} of {most} rows are whole in all columns and are "
                    "taken"
                )
            return least
        told = ", ".join(f"{name}: {rows}" for name, rows in lengths)
        raise RecordingError(
            f"columns differ in length ({told[:300]})",
            where=str(self.path),
            mend=f"If its program was stopped while it wrote: {TAKE} ({least} rows of each).",
        )


def open_arrays(path: Path, kind: Format, layout: Layout | None = None) -> ArrayTable:
    """List the columns of a file of arrays.

    Raises
    ------
    RecordingError : the file is damaged, cut off, not of this kind, or holds no numbers.
    """
    take = layout is not None and layout.incomplete is not None
    try:
        with _open(path, kind, take) as contents:
            lengths = tuple(array.rows for array, _ in contents.columns())
            columns = [column for _, column in contents.columns()]
            stated, unusable, cut = contents.stated(), contents.unusable, contents.cut
    except RecordingError:
        raise
    except Exception as error:  # the libraries raise anything on a damaged file
        raise _damaged(path, kind, error) from error
    if cut and not take:
        raise RecordingError(cut, where=str(path), mend=f"Copy the file again. {TAKE}.")
    if not columns:
        held = "; ".join(f"{name} ({what})" for name, what in list(unusable.items())[:12])
        raise RecordingError(
            f"holds no arrays of numbers ({kind})" + (f". It holds {held}" if held else ""),
            where=str(path),
        )
    remarks = [f"{path.name} {cut}; what is whole is taken"] if cut else []
    return ArrayTable(
        path=path,
        names=tuple(column.name for column in columns),
        kind=kind,
        lengths=lengths,
        stated=stated,
        unusable=unusable,
        take=take,
        as_stated=layout is None or layout.attributes is None,
        remarks=remarks,
    )


def _damaged(path: Path, kind: Format, error: Exception) -> RecordingError:
    if isinstance(error, MemoryError):
        return no_room(str(path))
    reason = f"{type(error).__name__}: {error}".splitlines()[0][:200]
    mark = INDEX_LAST.get(kind)
    if mark is not None:
        with path.open("rb") as stream:
            stream.seek(max(0, path.stat().st_size - END_BYTES))
            if mark not in stream.read():
                return RecordingError(
                    f"is cut off: its end, where a file of this kind ({kind}) says what is in it, "
                    "is missing, so nothing can be taken from it",
                    where=str(path),
                    mend="Copy the file again.",
                )
    mend = None
    if any(words in str(error) for words in STILL_OPEN):
        mend = (
            "It is still written, or its program was stopped: close the program, or mend the file "
        )
        mend += "with HDF5's own h5clear --status."
    return RecordingError(f"cannot be read as {kind} ({reason})", where=str(path), mend=mend)


def _step(arrays: list[Array]) -> int:
    """Rows to read at once: some 64 MB, in whole pieces as the file keeps them."""
    different = {id(array): array for array in arrays}.values()
    rows = max(1, BLOCK_BYTES // sum(array.row_bytes for array in different))
    large = [a.chunk_rows for a in different if a.chunk_rows * a.row_bytes > BLOCK_BYTES // 2]
    piece = max(large, default=1)
    return -(-rows // piece) * piece


@contextmanager
def _open(path: Path, kind: Format, take: bool) -> Iterator[Contents]:
    """Look through a file; what is said against it from within names it."""
    with ExitStack() as stack:
        stream = stack.enter_context(open_stream(path))
        if is_packed(stream):
            stream = unpacked(stream, str(path))  # gzipped: these formats jump about in the file
        try:
            yield _contents(stream, stack, kind, take)
        except RecordingError as error:
            file = as_text(str(path))
            if error.where != file:
                error.where = f"{file}, {error.where}" if error.where else file
            raise


def _contents(stream: BinaryIO, stack: ExitStack, kind: Format, take: bool) -> Contents:
    """What a file holds; each reader's library is loaded only where it is needed."""
    if kind == "hdf5":
        from mtpipe.ingest.hdf5 import open_hdf5

        return open_hdf5(stream, stack, take=take)
    if kind == "netcdf":
        from mtpipe.ingest.netcdf import open_netcdf

        return open_netcdf(stream, stack)
    if kind == "tdms":
        from mtpipe.ingest.tdms import open_tdms

        return open_tdms(stream, stack)
    if kind == "matlab":
        from mtpipe.ingest.matlab import open_matlab

        return open_matlab(stream, take=take)
    if kind in ("npz", "npy"):
        from mtpipe.ingest.numpy_files import open_npy, open_npz

        return open_npz(stream, stack) if kind == "npz" else open_npy(stream)
    from mtpipe.ingest.gr import open_gr

    return open_gr(stream)
