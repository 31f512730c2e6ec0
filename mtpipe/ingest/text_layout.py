"""Where the table of a text file begins, what separates its columns and what they are called.

Judged by content: rows of numbers are told by their last rows in the head of the file, where no
preamble reaches; the names stand above the first of them, perhaps with units between. Every choice
that the setup leaves open is a sentence for a notice.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.cells import is_number, is_value
from mtpipe.ingest.column_attributes import NOTHING, Stated
from mtpipe.ingest.names import plain
from mtpipe.ingest.units import is_row_of_units, unit_in_name
from mtpipe.setup.source_parts import NUMBER, Delimiter, Layout

MARKS: dict[Delimiter, str] = {"comma": ",", "tab": "\t", "semicolon": ";", "pipe": "|",
                               "whitespace": "\t"}  # fmt: skip
# Excel's first line, which says what separates the columns.
SEPARATOR = re.compile(r'"?sep=(.)"?\s*', re.IGNORECASE)
SEPARATORS: dict[str, Delimiter] = {",": "comma", ";": "semicolon", "\t": "tab", "|": "pipe"}
BODY_ROWS = 100
# A delimiter stands equally often in all rows but for remarks among them.
SAME_SHARE = 0.9
QUOTED = re.compile(r'"[^"]*"')


@dataclass(frozen=True)
class Found:
    """What was found: names, `skip` lines before the numbers, units of columns, guesses."""

    names: tuple[str, ...]
    has_names: bool
    delimiter: Delimiter
    skip: int
    stated: tuple[Stated, ...]
    guesses: tuple[str, ...]


@dataclass(frozen=True)
class Line:
    """A line with its number (from 0) and its cells."""

    number: int
    text: str
    cells: list[str]


def find_table(
    lines: Sequence[str], layout: Layout, lost_tokens: Sequence[str], asked: Sequence[str]
) -> Found:
    """Find the table in the first lines of a file.

    Parameters
    ----------
    asked : names of columns that the setup asks for; of several lines that could be the names the
        one that has most of them is.

    Raises
    ------
    RecordingError : there is no line but remarks, or a line that no table has.
    """
    guesses: list[str] = []
    kept = [
        k
        for k, line in enumerate(lines)
        if k >= layout.skip_lines and not is_passed_over(line, layout.comment)
    ]
    delimiter = layout.delimiter
    if kept and (match := SEPARATOR.fullmatch(lines[kept[0]])) and match[1] in SEPARATORS:
        delimiter = delimiter or SEPARATORS[match[1]]
        guesses.append(f'columns are separated by {delimiter}, as the line "sep=" says')
        del kept[0]
    if not kept:
        raise RecordingError("has no data")
    body = kept[max(len(kept) // 2, len(kept) - BODY_ROWS) :]
    body = body[:-1] if len(body) > 2 else body  # the last may be cut off
    if delimiter is None:
        delimiter = _guess_delimiter([lines[k] for k in body], layout.decimal)
        guesses.append(f"columns are taken to be separated by {delimiter}")
    table = [Line(k, lines[k], _cells(lines[k], delimiter, k)) for k in kept]
    rows = _Rows.of([line for line in table if line.number in set(body)], layout, lost_tokens)
    named = _Header(layout, delimiter, rows, _matches(asked))
    begin = named.certain(table)
    at = next((k for k, line in enumerate(table) if k >= begin and rows.has(line)), None)
    if at is not None and len(table[at].cells) != rows.width:
        message, mend = wrong_width(table[at].text, len(table[at].cells), rows.width)
        raise RecordingError(message, where=f"line {table[at].number + 1}", mend=mend)
    if layout.header is False:
        at = at or 0
        if at:
            guesses.append(f"{_lines(table[:at])} before the numbers are passed over")
        return _without_names(rows.width, table[at].number, delimiter, guesses)
    if layout.header and (at == 0 or at is None):
        at = 1  # what is stated to be a header is one, be its names numbers
    if at is None:
        at = 1
    above = table[:at]
    if not above:
        remark = named.in_remark(lines, table[0].number)
        if remark is None:
            guesses.append("the first line is taken for numbers")
            return _without_names(rows.width, table[0].number, delimiter, guesses)
        guesses.append(f"line {remark.number + 1}, a remark, is taken for the columns' names")
        return _with_names(remark.cells, None, table[0].number, delimiter, guesses)
    skip = table[at].number if at < len(table) else above[-1].number + 1
    header, units = named.among(above)
    if header is None:
        named_best = max(above, key=lambda line: (named.asked(line), line.number))
        if layout.header or named.asked(named_best) >= max(2, rows.width // 2):
            raise RecordingError(
                f"line {named_best.number + 1}, where the columns' names are expected, has "
                f"{len(named_best.cells)} of them, and the rows below have {rows.width} columns "
                f"({named_best.text.strip()[:60]!r})",
                mend=_otherwise(named_best.text, delimiter, skip),
            )
        guesses.append(f"{_lines(above)} before the numbers are passed over; none names columns")
        return _without_names(rows.width, skip, delimiter, guesses)
    if layout.header is None or header.number != above[0].number:
        guesses.append(f"line {header.number + 1} is taken for the columns' names")
    if units is not None:
        guesses.append(f"line {units.number + 1} is taken for their units")
    others = [line for line in above if line.number not in (header.number, _number(units))]
    if others:
        guesses.append(f"{_lines(others)} before the numbers are passed over")
    return _with_names(header.cells, units, skip, delimiter, guesses)


def is_passed_over(line: str, comment: str) -> bool:
    """Whether a line is blank or a remark."""
    stripped = line.strip()
    return not stripped or bool(comment and stripped.startswith(comment))


def wrong_width(line: str, columns: int, expected: int) -> tuple[str, str]:
    """What is wrong with a line that has another number of columns, and how that is mended."""
    return (
        f"has {columns} columns where {expected} are expected ({line.strip()[:60]!r})",
        "Lines before the table are passed over with skip_lines, remarks in it with comment, the "
        "mark that they begin with, in [source].",
    )


def split_line(line: str, delimiter: Delimiter) -> list[str]:
    """Cells of one line."""
    if delimiter == "whitespace":
        return line.split()
    cells = next(csv.reader([line.strip("\r\n")], delimiter=MARKS[delimiter]), [])
    return cells or [""]


def count_of(asked: Sequence[str]) -> Callable[[str], int]:
    """Counts how many of the names that are asked for are in a text."""
    parts = [plain(name.partition(NUMBER)[0]) or plain(name) for name in asked]

    def found(text: str) -> int:
        shown = plain(text)
        return sum(part in shown for part in parts)

    return found


def _matches(asked: Sequence[str]) -> Callable[[Line], int]:
    """Counts how many cells of a line are names that are asked for."""
    whole = {plain(name) for name in asked if NUMBER not in name}
    parts = [plain(name).partition(NUMBER) for name in asked if NUMBER in name]
    patterns = [re.compile(rf"{re.escape(head)}\d+{re.escape(tail)}") for head, _, tail in parts]

    def matching(line: Line) -> int:
        cells = {plain(cell) for cell in line.cells}
        numbered = sum(any(p.fullmatch(cell) for cell in cells) for p in patterns)
        return len(cells & whole) + numbered

    return matching


@dataclass(frozen=True)
class _Rows:
    """What the table's rows have in common."""

    width: int
    numeric: tuple[int, ...]
    empty_at_end: int
    value: Callable[[str], bool]
    number: Callable[[str], bool]

    @classmethod
    def of(cls, body: Sequence[Line], layout: Layout, lost_tokens: Sequence[str]) -> _Rows:
        marks = {layout.decimal, "."} | ({","} if layout.delimiter != "comma" else set())

        def number(cell: str) -> bool:
            return any(is_number(cell, mark) for mark in marks)

        def value(cell: str) -> bool:
            return number(cell) or is_value(cell, layout.decimal, lost_tokens)

        width = Counter(len(line.cells) for line in body).most_common(1)[0][0]
        rows = [line.cells for line in body if len(line.cells) == width]
        many = range(width)
        numeric = [j for j in many if sum(value(r[j]) for r in rows) > len(rows) / 2]
        numeric = [j for j in numeric if any(value(r[j]) and r[j].strip() for r in rows)]
        filled = [j for j in many if any(r[j].strip() for r in rows)]
        empty_at_end = width - 1 - max(filled, default=0)
        return cls(width, tuple(numeric), empty_at_end, value, number)

    def has(self, line: Line) -> bool:
        """Whether a line is one of the rows, or of another width but all numbers."""
        cells = line.cells
        if len(cells) == self.width and self.numeric:
            worded = [cells[j] for j in self.numeric if any(c.isalnum() for c in cells[j])]
            return bool(worded) and sum(map(self.value, worded)) >= len(worded) / 2
        filled = [cell for cell in cells if cell.strip()]
        return len(filled) > 1 and all(map(self.value, filled)) and any(map(self.number, filled))


@dataclass(frozen=True)
class _Header:
    """Finds the line of names."""

    layout: Layout
    delimiter: Delimiter
    rows: _Rows
    asked: Callable[[Line], int]

    def among(self, above: Sequence[Line]) -> tuple[Line | None, Line | None]:
        """The line of names and the line of units below it, among the lines before the rows."""
        fitting = [line for one in above if (line := self._fitted(one)) is not None]
        if not fitting:
            alone = self.layout.header is not False and not self.rows.numeric
            return (above[0], None) if alone else (None, None)
        most = max(fitting, key=lambda line: (self.asked(line), line.number))
        chosen = len(fitting) - 1
        if self.asked(most):
            chosen = fitting.index(most)
        elif chosen and is_row_of_units(fitting[chosen].cells):
            chosen -= 1
        below = fitting[chosen + 1] if chosen + 1 < len(fitting) else None
        if below is not None and not is_row_of_units(below.cells):
            below = None
        return fitting[chosen], below

    def certain(self, table: Sequence[Line]) -> int:
        """Where the rows begin at the earliest: after a line with all names asked for, else 0."""
        for k, one in enumerate(table):
            if self.rows.number(one.cells[0] if one.cells else ""):
                continue  # a row; there are many
            line = self._fitted(one)
            if line is not None and self.asked(line) >= max(2, self.rows.width // 2):
                return k + 1
        return 0

    def in_remark(self, lines: Sequence[str], first: int) -> Line | None:
        """Names in the last remark before the rows, as numpy.savetxt writes them."""
        for k in range(first - 1, self.layout.skip_lines - 1, -1):
            text = lines[k].strip()
            if not text:
                continue
            bare = text.removeprefix(self.layout.comment).strip()
            line = self._fitted(Line(k, bare, _cells(bare, self.delimiter, k)))
            return line if line is not None and self.asked(line) else None
        return None

    def _fitted(self, line: Line) -> Line | None:
        """The line with as many cells as the rows have, by this or another delimiter."""
        ways = [line.cells]
        others: list[Delimiter] = ["tab", "semicolon", "comma"]
        if self.layout.delimiter is None:
            ways += [_cells(line.text, one, line.number) for one in others]
        ways.append(re.split(r"\t+|\s{2,}", line.text.strip()))
        for way in ways:
            cells = [cell.strip() for cell in way]
            while len(cells) > self.rows.width and not cells[-1]:
                cells.pop()
            lacking = self.rows.width - len(cells)
            if 0 < lacking <= self.rows.empty_at_end:
                cells += [""] * lacking
            numbers = self.layout.header is not True and all(map(self.rows.number, cells))
            if len(cells) == self.rows.width and not numbers:
                return Line(line.number, line.text, cells)
        return None


def _with_names(
    names: list[str], units: Line | None, skip: int, delimiter: Delimiter, guesses: list[str]
) -> Found:
    stated = []
    for k, name in enumerate(names):
        own, in_name = units.cells[k].strip() if units else "", unit_in_name(name)
        if own:
            stated.append(Stated(unit=own, unit_words=f"{own!r} in line {_number(units) + 1}"))
        elif in_name:
            stated.append(Stated(unit=in_name, unit_words=f"the name {name!r}", unit_in_name=True))
        else:
            stated.append(NOTHING)
    cleaned = tuple(name.strip() for name in names)
    return Found(cleaned, True, delimiter, skip, tuple(stated), tuple(guesses))


def _without_names(width: int, skip: int, delimiter: Delimiter, guesses: list[str]) -> Found:
    names = tuple(str(i + 1) for i in range(width))
    return Found(names, False, delimiter, skip, (NOTHING,) * width, tuple(guesses))


def _otherwise(header: str, delimiter: Delimiter, skip: int) -> str:
    """What to do with a line of names that does not fit the rows."""
    other = _guess_delimiter([header], "")
    if other not in (delimiter, "whitespace"):
        return (
            f'Its names are separated by {other}s: write delimiter = "{other}" in [source], and '
            'decimal = "," if the numbers have commas.'
        )
    return f"Tell columns by number, with header = false and skip_lines = {skip} in [source]."


def _cells(line: str, delimiter: Delimiter, number: int) -> list[str]:
    try:
        return split_line(line, delimiter)
    except csv.Error as error:
        raise RecordingError(f"line {number + 1} is no line of a table ({error})") from None


def _guess_delimiter(body: Sequence[str], decimal: str) -> Delimiter:
    bare = [QUOTED.sub("", line) for line in body]
    likely: tuple[Delimiter, ...] = ("tab", "semicolon", "pipe", "comma")
    for delimiter in likely:
        mark = MARKS[delimiter]
        if mark == decimal:
            continue
        counts = Counter(line.count(mark) for line in bare)
        count, rows = counts.most_common(1)[0]
        if count and rows >= SAME_SHARE * len(bare):
            return delimiter
    return "whitespace"


def _number(line: Line | None) -> int:
    return -1 if line is None else line.number


def _lines(lines: Sequence[Line]) -> str:
    first, last = lines[0].number + 1, lines[-1].number + 1
    return f"line {first}" if first == last else f"lines {first} to {last}"
