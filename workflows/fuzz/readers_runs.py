"""The reader of run folders, `mtpipe report`."""

from __future__ import annotations

import copy
import io
import json
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
import plotly.offline
import pyarrow.parquet as pq
from case import Case, Reader, Step
from odd import Random, array_of, odd_value, pick
from readers_parquet import no_utf_8, parquet

from mtpipe.report import pages
from tests.report_folder import write_run_folder

# What is the same for all runs is made once: plotly's script of 4 MB, and the templates.
plotly.offline.get_plotlyjs = lambda: ""
pages.templates = cache(pages.templates)
# Every table is cut to so many rows of a trace, which is enough for each to be drawn.
MOST_ROWS = 400


@cache
def run_seeds() -> list[Case]:
    """One run of three beads and two plateaus; any of its files may be damaged."""
    with TemporaryDirectory() as scratch:
        folder = write_run_folder(Path(scratch) / "run", plateaus=2)
        files = {
            str(path.relative_to(folder)): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.suffix in (".json", ".parquet")
        }
    return [Case({name: _short(name, content) for name, content in files.items()}, ".")]


def _short(name: str, content: bytes) -> bytes:
    if not name.endswith(".parquet"):
        return content
    table = pd.read_parquet(io.BytesIO(content))
    keys = [key for key in ("bead", "plateau", "axis", "stage") if key in table]
    if len(table) <= MOST_ROWS or not keys:
        return content
    short = table[table.groupby(keys).cumcount() < MOST_ROWS // 40]
    short.attrs = table.attrs
    return _parquet(short)


def _parquet(table: pd.DataFrame) -> bytes:
    stream = io.BytesIO()
    table.to_parquet(stream)
    return stream.getvalue()


def odd_run(random: Random) -> Case:
    """One file gone, or with other keys, columns, values or text that is no UTF-8."""
    case = run_seeds()[0]
    name = pick(random, list(case.files))
    if random.random() < 0.03:
        return Case({n: c for n, c in case.files.items() if n != name}, ".")
    odd = _odd_json if name.endswith(".json") else _odd_table
    return case.with_content(odd(case.files[name], random), name)


def _odd_json(content: bytes, random: Random) -> bytes:
    whole = json.loads(content)
    for _ in range(int(random.integers(1, 3))):
        parent, key = pick(random, list(_places(whole)))
        way = random.integers(3)
        if way == 0 and isinstance(parent, dict):
            del parent[key]
        elif way == 1:
            parent[key] = copy.deepcopy(pick(random, list(_places(whole)))[0])
        else:
            parent[key] = odd_value(random)
        if not whole:
            break
    text = json.dumps(whole, ensure_ascii=bool(random.integers(2)))
    return text.encode(pick(random, ("utf-8", "utf-8", "utf-8", "utf-16", "latin-1")), "replace")


def _places(content: Any) -> Iterator[tuple[Any, Any]]:
    items = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in items:
        yield content, key
        if isinstance(value, (dict, list)):
            yield from _places(value)


def _odd_table(content: bytes, random: Random) -> bytes:
    table = pd.read_parquet(io.BytesIO(content))
    attrs = dict(table.attrs)
    for _ in range(int(random.integers(1, 3))):
        name, way = pick(random, list(table.columns)), random.integers(7)
        if way == 0 and len(table.columns) > 1:
            table = table.drop(columns=name)
        elif way == 1:
            table = table.iloc[: int(random.integers(len(table) + 1))]
        elif way == 2:
            table = table.rename(columns={name: str(pick(random, list(table.columns)))})
            table = table.loc[:, ~table.columns.duplicated()]
        elif way == 3:
            table = table.assign(**{name: [_cell(random)] * len(table)})
        elif way == 4 and len(table):
            values = table[name].astype(object).to_numpy().copy()
            values[random.integers(len(values))] = _cell(random)
            table = table.assign(**{name: values})
        else:
            kind = pick(random, ("f8", "f4", "i8", "u1", "?", "M8[ns]", "m8[ms]", "S5", "U3"))
            table = table.assign(**{name: array_of(random, kind, (len(table),))})
    if random.random() < 0.1:
        attrs = {"run": odd_value(random)}
    table.attrs = attrs
    try:
        content = _parquet(table)
    except Exception:  # what pandas does not write
        content = _parquet(table.map(repr))
    return _without_utf_8(content, random) if random.random() < 0.1 else content


def _without_utf_8(content: bytes, random: Random) -> bytes:
    """The table with one column of text that is no UTF-8."""
    table = pq.read_table(io.BytesIO(content))
    k = int(random.integers(table.num_columns))
    return parquet(table.set_column(k, table.column_names[k], no_utf_8(table.num_rows)))


def _cell(random: Random) -> Any:
    if random.random() < 0.15:
        return b"\xff\xfe"  # text that is no UTF-8
    return pick(random, (None, True, -1, 0, 3.5, np.inf, -np.inf, np.nan, 1e300, 10**15, "odd", "x",
                         "a\nb", "\u2028<b>", [1.0], "ok", "refused", "b1"))  # fmt: skip


def run_steps(path: Path, case: Case) -> Iterator[Step]:
    """Writing the report again."""
    yield partial(pages.write_report, path)


READERS = (Reader("run", run_seeds, odd_run, run_steps),)
