"""Delimited text, canonical or a laboratory's own, read block by block.

pyarrow parses the numbers; here is what it does not say: the line and column at which a file is at
fault, and whether its last row is whole. Text columns are told apart by position, as a header may
name two alike.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.cells import COMMON, is_number, is_value, values_of_cells
from mtpipe.ingest.column_attributes import Stated
from mtpipe.ingest.data_files import DAMAGE, open_stream, read_begin
from mtpipe.ingest.encodings import encoding_of
from mtpipe.ingest.last_row import last_row_fault
from mtpipe.ingest.lines import line_blocks
from mtpipe.ingest.text_layout import (
    MARKS,
    count_of,
    find_table,
    is_passed_over,
    split_line,
    wrong_width,
)
from mtpipe.setup.source_parts import TAKE, Delimiter, Layout

HEAD_LINES = 500
HEAD_BYTES = 1 << 16
LONGEST_LINE = 1 << 20


@dataclass(frozen=True)
class TextTable:
    """A text file whose layout is known.

    Attributes
    ----------
    names : of the columns; their numbers where there is no header.
    skip : lines before the first row of numbers.
    take : whether what is whole of a file that is cut off is taken.
    stated, guesses, remarks : as in `collect.OpenTable`.
    """

    path: Path
    names: tuple[str, ...]
    has_names: bool
    delimiter: Delimiter
    decimal: str
    encoding: str
    comment: str
    skip: int
    lost_tokens: tuple[str, ...]
    take: bool
    stated: tuple[Stated, ...]
    guesses: tuple[str, ...]
    unusable: dict[str, str] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list, compare=False)

    def batches(self, wanted: Sequence[int]) -> Iterator[list[NDArray[Any]]]:
        """Yield the wanted columns (positions from 0) block by block.

        Yields
        ------
        (n,) float64 for each, NaN where a cell says that there is no number; datetime64[ns] where
        cells are clock times.

        Raises
        ------
        RecordingError : naming line and column of what is no number, or the damage.
        """
        rows = 0
        before: pa.Buffer | None = None
        tabbed = self.delimiter == "whitespace"
        with open_stream(self.path) as stream:
            try:
                for block in line_blocks(
                    stream, self.encoding, skip=self.skip, tabbed=tabbed, comment=self.comment
                ):
                    whole = self._without_cut_row(block, before, rows)
                    before = block
                    if whole is None:
                        continue
                    batch = self._parsed(whole, wanted)
                    if batch is None:
                        raise self._located(wanted, rows)
                    rows += len(batch[0]) if batch else 0
                    yield batch
            except DAMAGE as error:
                if not self.take or not rows:
                    raise RecordingError(
                        f"is damaged or cut off after {rows} rows ({error})",
                        where=str(self.path),
                        mend=f"Copy the file again. {TAKE}." if rows else None,
                    ) from None
                self.remarks.append(
                    f"{self.path.name} is damaged or cut off after {rows} rows, which are taken"
                )
        if not rows:
            raise RecordingError("has no rows of numbers", where=str(self.path))

    def line_of(self, row: int) -> int:
        """Number of the line (from 1) in which a row of numbers (from 0) stands."""
        for number, _ in self.rows():
            if row == 0:
                return number
            row -= 1
        return self.skip + 1

    def _parsed(self, block: pa.Buffer, wanted: Sequence[int]) -> list[NDArray[Any]] | None:
        """Values of the wanted columns in a block; None if something in it is no value."""
        names = [str(i) for i in range(len(self.names))]
        chosen = [names[i] for i in wanted]
        read = arrow_csv.ReadOptions(column_names=names, block_size=block.size, use_threads=False)
        parse = arrow_csv.ParseOptions(delimiter=MARKS[self.delimiter])

        def table(kind: pa.DataType, **options: Any) -> pa.Table:
            convert = arrow_csv.ConvertOptions(
                include_columns=list(dict.fromkeys(chosen)),
                column_types=dict.fromkeys(chosen, kind),
                **options,
            )
            return arrow_csv.read_csv(pa.BufferReader(block), read, parse, convert)

        try:
            quick = table(
                pa.float64(),
                null_values=[*COMMON, *self.lost_tokens],
                decimal_point=self.decimal,
            )
            columns = [quick.column(name).to_numpy() for name in chosen]
            return [np.asarray(column, dtype=np.float64) for column in columns]
        except pa.ArrowException:
            pass  # something is no plain number: all cells are looked at
        try:
            cells = table(pa.string(), strings_can_be_null=False)
        except pa.ArrowException:
            return None
        values = [values_of_cells(cells.column(n), self.decimal, self.lost_tokens) for n in chosen]
        whole = [one for one in values if one is not None]
        return whole if len(whole) == len(values) else None

    def _without_cut_row(
        self, block: pa.Buffer, before: pa.Buffer | None, rows: int
    ) -> pa.Buffer | None:
        """The block without a last row that the end of the file has cut; None if that was all.

        Raises
        ------
        RecordingError : the row is cut, and what is whole is not to be taken.
        """
        if bytes(memoryview(block)[-1:]) in (b"\n", b"\r"):
            return block
        content = block.to_pybytes()
        at = max(content.rfind(b"\n"), content.rfind(b"\r")) + 1
        earlier = content[:at] if at or before is None else before.to_pybytes()
        fault = last_row_fault(content[at:], earlier, self.delimiter, self.decimal, self.names)
        if fault is None:
            return block
        if fault.certain and not self.take:
            raise RecordingError(
                f"{fault.said} ({content[at:].decode('utf-8', 'replace').strip(chr(0))[-40:]!r})",
                where=f"{self.path}, last line",
                mend=f"Copy the file again. {TAKE}.",
            )
        self.remarks.append(f"{self.path.name}: its last row {fault.said} and is left out")
        return block.slice(0, at) if at else None

    def rows(self) -> Iterator[tuple[int, str]]:
        """Yield the lines that hold rows, with their numbers from 1."""
        with open_stream(self.path) as stream:
            text = io.TextIOWrapper(stream, encoding=self.encoding, errors="replace")
            for number, line in enumerate(_lines(text, self.path), start=1):
                if number > self.skip and not is_passed_over(line, self.comment):
                    yield number, line

    def _located(self, wanted: Sequence[int], rows: int) -> RecordingError:
        """Go through the lines after `rows` good rows to find the one at fault."""
        try:
            for number, line in self.rows():
                rows -= 1
                if rows < 0 and (fault := self._fault(line, wanted)) is not None:
                    place, message, mend = fault
                    return RecordingError(
                        message, where=f"{self.path}, line {number}{place}", mend=mend
                    )
        except (*DAMAGE, csv.Error) as damage:
            return RecordingError(f"is damaged ({damage})", where=str(self.path))
        return RecordingError("is no table of numbers", where=str(self.path))

    def _fault(self, line: str, wanted: Sequence[int]) -> tuple[str, str, str] | None:
        """Column, what is wrong and how it is mended, of a line that is at fault."""
        cells = split_line(line, self.delimiter)
        if len(cells) != len(self.names):
            return "", *wrong_width(line, len(cells), len(self.names))
        for i in wanted:
            cell = cells[i]
            if is_value(cell, self.decimal, self.lost_tokens):
                continue
            name = self.names[i] if self.has_names else str(i + 1)
            other = "," if self.decimal == "." else "."
            mend = (
                f"The file is read with decimal = {self.decimal!r} ([source] decimal); one mark "
                "holds for all of it."
                if is_number(cell, other)
                else "If the word means that the bead was lost, write it into [source] "
                "lost.tokens; lines before the numbers are passed over with skip_lines."
            )
            return f", column {name}", f"{cell[:40]!r} is no number", mend
        return None


def open_text(
    path: Path, layout: Layout, lost_tokens: tuple[str, ...] = (), asked: tuple[str, ...] = ()
) -> TextTable:
    """Find out where the numbers of a text file begin and what its columns are called.

    Parameters
    ----------
    lost_tokens : words that mean lost.
    asked : names of columns that are asked for, which help to find the line of names.

    Raises
    ------
    RecordingError : no line of numbers, or damage.
    """
    encoding, said = layout.encoding, ""
    try:
        if encoding is None:
            with open_stream(path) as stream:
                encoding, said = encoding_of(read_begin(stream, HEAD_BYTES), count_of(asked))
        lines, ended = _first_lines(path, encoding, layout.skip_lines)
    except (*DAMAGE, UnicodeError) as error:
        raise RecordingError(f"is damaged ({error})", where=str(path)) from None
    try:
        found = find_table(lines, layout, lost_tokens, asked)
    except RecordingError as error:
        more = ended or error.message != "has no data"
        said = error.message + ("" if more else f" in its first {len(lines)} lines")
        where = f"{path}, {error.where}" if error.where else str(path)
        raise RecordingError(said, where=where, mend=error.mend) from None
    return TextTable(
        path=path,
        names=found.names,
        has_names=found.has_names,
        delimiter=found.delimiter,
        decimal=layout.decimal,
        encoding=encoding,
        comment=layout.comment,
        skip=found.skip,
        lost_tokens=lost_tokens,
        take=layout.incomplete is not None,
        stated=found.stated,
        guesses=((said,) if said else ()) + found.guesses,
    )


def _first_lines(path: Path, encoding: str, skip: int) -> tuple[list[str], bool]:
    """The first lines of a file (`HEAD_LINES` beyond `skip`), and whether that is all of it."""
    limit = skip + HEAD_LINES
    lines: list[str] = []
    with open_stream(path) as stream:
        text = io.TextIOWrapper(stream, encoding=encoding, errors="replace")
        try:
            for line in _lines(text, path):
                lines.append(line)
                if len(lines) == limit:
                    break
        except DAMAGE:
            if not lines:
                raise  # else the reading itself tells how many rows are whole
    if lines:
        lines[0] = lines[0].removeprefix("\ufeff")
    return lines, len(lines) < limit


def _lines(text: io.TextIOWrapper, path: Path) -> Iterator[str]:
    """Yield the lines of a text, of which none is held whole that is no line of a table.

    Raises
    ------
    RecordingError : a line does not end.
    """
    for number, line in enumerate(iter(lambda: text.readline(LONGEST_LINE), ""), start=1):
        if len(line) == LONGEST_LINE:
            raise RecordingError(
                f"does not end within {LONGEST_LINE} characters, so this is no table of lines",
                where=f"{path}, line {number}",
                mend="Export it with a line for each frame.",
            )
        yield line
