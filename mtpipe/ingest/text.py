"""Delimited text, canonical or a laboratory's own, read block by block.

pyarrow parses the numbers; here is what it needs to be told (where the numbers begin, what
separates them) and what it does not say: the line and column at which a file is at fault. Text
columns are told apart by position, as a header may name two alike.
"""

from __future__ import annotations

import csv
import io
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv

from mtpipe.errors import RecordingError
from mtpipe.ingest.files import open_stream
from mtpipe.ingest.lines import line_blocks
from mtpipe.ingest.source import Delimiter, Layout
from mtpipe.recording import FloatArray

MARKS: dict[Delimiter, str] = {"comma": ",", "tab": "\t", "semicolon": ";", "whitespace": "\t"}
LOST_TOKENS = (
    "", "nan", "NaN", "NAN", "-nan", "-NaN", "NA", "N/A", "n/a", "NULL", "null", "None", "--",
    "-1.#IND", "1.#IND", "-1.#IND00", "1.#IND00", "-1.#IND000", "1.#IND000", "-1.#IND0000",
    "1.#QNAN", "-1.#QNAN", "1.#QNAN0", "-1.#QNAN0", "1.#QNAN00", "1.#QNAN000",
)  # fmt: skip
INFINITE_TOKENS = ("1.#INF", "-1.#INF", "1.#INF00", "-1.#INF00", "1.#INF000", "-1.#INF000")
DAMAGE = (EOFError, zlib.error, OSError)


@dataclass(frozen=True)
class TextTable:
    """A text file whose layout is known.

    Attributes
    ----------
    names : of the columns; their numbers where there is no header.
    skip : lines before the first row of numbers.
    guesses : sentences on what the setup left open and the file answered.
    """

    path: Path
    names: tuple[str, ...]
    has_names: bool
    delimiter: Delimiter
    decimal: str
    encoding: str
    skip: int
    lost_tokens: tuple[str, ...]
    guesses: tuple[str, ...]

    def batches(self, wanted: Sequence[int]) -> Iterator[list[FloatArray]]:
        """Yield the wanted columns (positions from 0) block by block, empty cells as NaN.

        Raises
        ------
        RecordingError : naming line and column of what is no number, or the damage.
        """
        names = [str(i) for i in range(len(self.names))]
        chosen = [names[i] for i in wanted]
        parse = arrow_csv.ParseOptions(delimiter=MARKS[self.delimiter])
        convert = arrow_csv.ConvertOptions(
            include_columns=list(dict.fromkeys(chosen)),
            column_types=dict.fromkeys(chosen, pa.float64()),
            null_values=[*LOST_TOKENS, *INFINITE_TOKENS, *self.lost_tokens],
            decimal_point=self.decimal,
        )
        tabbed = self.delimiter == "whitespace"
        rows = 0
        with open_stream(self.path) as stream:
            try:
                for block in line_blocks(stream, self.encoding, skip=self.skip, tabbed=tabbed):
                    read = arrow_csv.ReadOptions(
                        column_names=names, block_size=block.size, use_threads=False
                    )
                    table = arrow_csv.read_csv(pa.BufferReader(block), read, parse, convert)
                    rows += table.num_rows
                    yield [_array(table.column(c)) for c in chosen]
            except DAMAGE as error:
                raise RecordingError(
                    f"is damaged or cut off after {rows} rows ({error})", where=str(self.path)
                ) from None
            except pa.ArrowException as error:
                raise self._located(wanted, rows, error) from None
        if not rows:
            raise RecordingError("has no rows of numbers", where=str(self.path))

    def _located(self, wanted: Sequence[int], rows: int, error: Exception) -> RecordingError:
        """Go through the lines after `rows` good rows to find the one at fault."""
        lost = {*LOST_TOKENS, *INFINITE_TOKENS, *self.lost_tokens}
        try:
            with open_stream(self.path) as stream:
                text = io.TextIOWrapper(stream, encoding=self.encoding, errors="replace")
                for number, line in enumerate(text, start=1):
                    if number <= self.skip or not line.strip("\r\n"):
                        continue
                    rows -= 1
                    if rows >= 0:
                        continue
                    fault = self._fault(line, wanted, lost)
                    if fault is not None:
                        return RecordingError(
                            fault[1], where=f"{self.path}, line {number}{fault[0]}"
                        )
        except (*DAMAGE, csv.Error) as damage:
            return RecordingError(f"is damaged ({damage})", where=str(self.path))
        reason = str(error).splitlines()[0][:200]
        return RecordingError(f"is no table of numbers ({reason})", where=str(self.path))

    def _fault(self, line: str, wanted: Sequence[int], lost: set[str]) -> tuple[str, str] | None:
        cells = split_line(line, self.delimiter)
        if len(cells) != len(self.names):
            return "", f"has {len(cells)} columns where {len(self.names)} are expected"
        for i in wanted:
            cell = cells[i]
            try:
                if cell not in lost:
                    float(cell.strip().replace(self.decimal, "."))
            except ValueError:
                name = self.names[i] if self.has_names else str(i + 1)
                return f", column {name}", f"{cell[:40]!r} is no number"
        return None


def open_text(path: Path, layout: Layout, lost_tokens: tuple[str, ...] = ()) -> TextTable:
    """Find out where the numbers of a text file begin and what its columns are called.

    Raises
    ------
    RecordingError : no line of numbers, or damage.
    """
    lines, ended = _first_lines(path, layout.encoding, layout.skip_lines)
    start = layout.skip_lines
    while start < len(lines) and _passed_over(lines[start], layout.comment):
        start += 1
    if start >= len(lines):
        what = "has no data" if ended else f"has no data in its first {len(lines)} lines"
        raise RecordingError(what, where=str(path))
    guesses = []
    delimiter = layout.delimiter
    if delimiter is None:
        delimiter = _guess_delimiter(lines[start], layout.decimal)
        guesses.append(f"columns are taken to be separated by {delimiter}")
    try:
        cells = split_line(lines[start], delimiter)
    except csv.Error as error:
        raise RecordingError(f"is no table ({error})", where=f"{path}, line {start + 1}") from None
    header = layout.header
    if header is None:
        header = not any(_is_number(c, layout.decimal) for c in cells)
        guesses.append(f"the first line is taken for {'a header' if header else 'numbers'}")
    names = [c.strip() for c in cells] if header else [str(i + 1) for i in range(len(cells))]
    return TextTable(
        path=path,
        names=tuple(names),
        has_names=header,
        delimiter=delimiter,
        decimal=layout.decimal,
        encoding=layout.encoding,
        skip=start + int(header),
        lost_tokens=lost_tokens,
        guesses=tuple(guesses),
    )


def split_line(line: str, delimiter: Delimiter) -> list[str]:
    """Cells of one line."""
    if delimiter == "whitespace":
        return line.split()
    cells = next(csv.reader([line.strip("\r\n")], delimiter=MARKS[delimiter]), [])
    return cells or [""]


def _first_lines(path: Path, encoding: str, skip: int) -> tuple[list[str], bool]:
    """The first lines of a file (some hundred beyond `skip`), and whether that is all of it."""
    limit = skip + 500
    try:
        with open_stream(path) as stream:
            text = io.TextIOWrapper(stream, encoding=encoding, errors="replace")
            lines = []
            for line in iter(lambda: text.readline(1 << 20), ""):
                lines.append(line)
                if len(lines) == limit:
                    break
    except (*DAMAGE, UnicodeError) as error:
        raise RecordingError(f"is damaged ({error})", where=str(path)) from None
    if lines:
        lines[0] = lines[0].removeprefix("\ufeff")
    return lines, len(lines) < limit


def _passed_over(line: str, comment: str) -> bool:
    stripped = line.strip()
    return not stripped or bool(comment and stripped.startswith(comment))


def _guess_delimiter(line: str, decimal: str) -> Delimiter:
    if "\t" in line:
        return "tab"
    if ";" in line:
        return "semicolon"
    return "comma" if "," in line and decimal == "." else "whitespace"


def _is_number(cell: str, decimal: str) -> bool:
    try:
        float(cell.strip().replace(decimal, "."))
    except ValueError:
        return cell.strip() in (*LOST_TOKENS[1:], *INFINITE_TOKENS)
    return True


def _array(column: pa.ChunkedArray) -> FloatArray:
    return cast(FloatArray, column.to_numpy()).astype(np.float64, copy=False)
