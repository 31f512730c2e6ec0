"""Readers of text: setups, canonical CSV and laboratories' own text."""

from __future__ import annotations

import gzip
import json
import math
import tomllib
from collections.abc import Iterator
from copy import deepcopy
from functools import cache, partial
from pathlib import Path
from typing import Any

import grammar
import numpy as np
from case import Case, Reader, Step
from odd import NAMES, Random, odd_value, pick
from tables_read import ROWS, five_columns, five_source, setup_of, steps

from mtpipe.setup.setup import read_setup
from mtpipe.tracking.scan import focus_positions_nm

CHECKOUT = Path(__file__).parents[2]
CELLS = ("", "nan", "-1.#IND000", "inf", "1e400", "-", "x", '"', '"1', "1,5", "1;5", "1.5.5", "0x1",
         "2026-01-01 00:00:00", "12:00:00", "١", "\0", "é", "1e-400", "9" * 400, "1 2", "#", "True",
         "\u2028", "1_000", "+1", " 1 ", "'1'", *NAMES)  # fmt: skip

# ------------------------------------------------------------------ setups


@cache
def setups() -> tuple[str, ...]:
    """The setups that are in the checkout."""
    files = [
        *sorted((CHECKOUT / "sample_data").glob("*/setup.toml")),
        *sorted((CHECKOUT / "tests" / "data" / "real_setups").glob("*.toml")),
    ]
    return tuple(file.read_text(encoding="utf-8") for file in files)


@cache
def setup_seeds() -> list[Case]:
    """Setups as they are in the checkout."""
    return [Case({"setup.toml": text.encode()}, "setup.toml") for text in setups()]


def odd_setup(random: Random) -> Case:
    """A setup in which keys have other values, are gone, or stand in other places."""
    content = tomllib.loads(pick(random, setups()))
    for _ in range(int(random.integers(1, 5))):
        tables = [content, *(v for v in content.values() if isinstance(v, dict))]
        table = pick(random, tables)
        way = random.integers(5)
        if not table or way == 0:
            table[pick(random, (*KEYS, *NAMES))] = odd_value(random)
        elif way == 1:
            table.pop(pick(random, list(table)))
        elif way == 2:
            pick(random, tables)[pick(random, KEYS)] = deepcopy(table[pick(random, list(table))])
        else:
            table[pick(random, list(table))] = odd_value(random)
        if not content:
            break
    return Case({"setup.toml": toml(content).encode("utf-8", "surrogatepass")}, "setup.toml")


KEYS = (
    "schema", "camera", "beads", "tether", "buffer", "field", "model", "magnet", "plateaus",
    "drift", "source", "tracking", "report", "frame_rate_hz", "frame_rate_hz_stderr", "exposure_s",
    "pixel_size_nm", "radius_nm", "radius_nm_stderr", "reference", "effects", "files", "format",
    "delimiter", "encoding", "first_column", "order", "names", "x", "y", "z", "units", "position",
    "scale", "lost", "tokens", "values", "time", "column", "unit", "z_zero", "z_zero_of",
    "value_nm", "touch_rows", "keep_rows", "preset", "regions", "size_px", "look_up_table_of",
    "cutoff_hz", "method", "tolerance", "minimum_s", "rotation", "frame", "decimal", "comment",
)  # fmt: skip


def toml(table: dict[str, Any]) -> str:
    """A table as TOML: one key per line, all below it within the line."""
    return "\n".join(f"{json.dumps(k)} = {_value(v)}" for k, v in table.items() if v is not None)


def _value(value: Any) -> str:
    if isinstance(value, dict):
        inner = (f"{json.dumps(k)} = {_value(v)}" for k, v in value.items() if v is not None)
        return "{" + ", ".join(inner) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_value(v) for v in value if v is not None) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value, ensure_ascii=False)


def setup_steps(path: Path, case: Case) -> Iterator[Step]:
    """Reading the setup."""
    yield partial(read_setup, path)


# ------------------------------------------------------------------ CSV and text


def lines_of(columns: dict[str, Any], mark: str, *, header: bool = True, decimal: str = ".") -> str:
    """Text of a table."""
    rows = zip(*columns.values(), strict=True)
    body = [mark.join(repr(float(v)).replace(".", decimal) for v in row) for row in rows]
    return "\n".join([mark.join(columns), *body] if header else body) + "\n"


def _canonical() -> dict[str, Any]:
    columns = five_columns()
    return {
        "time_s": columns["Time"],
        "magnet_mm": columns["Magnet"],
        **{f"{bead}_{axis.lower()}_nm": columns[axis] for bead in ("b1", "ref1") for axis in "XYZ"},
        "b1_quality": np.ones(ROWS),
    }


@cache
def csv_seeds() -> list[Case]:
    """Canonical files, packed, in UTF-16, with Windows' line ends, with notes; focus positions."""
    text = lines_of(_canonical(), ",")
    notes = '# mtpipe track: {"beads": [], "notices": []}\n'
    setup = setup_of(None, ("ref1",))
    semicolon = setup_of({"delimiter": "semicolon", "decimal": ","}, ("ref1",))
    focus = lines_of({"frame": np.arange(ROWS), "z_nm": np.arange(ROWS) * 20.0}, ",")
    return [
        Case({"r.csv": text.encode()}, "r.csv", setup),
        Case({"r.csv.gz": gzip.compress(text.encode(), mtime=0)}, "r.csv.gz", setup),
        Case({"r.csv": text.encode("utf-16")}, "r.csv", setup),
        Case({"r.csv": text.replace("\n", "\r\n").encode("utf-8-sig")}, "r.csv", setup),
        Case({"r.csv": (notes + text).encode()}, "r.csv", setup),
        Case({"r.csv": lines_of(_canonical(), ";", decimal=",").encode()}, "r.csv", semicolon),
        Case({"z.csv": focus.encode()}, "z.csv", setup),
    ]


def odd_csv(random: Random) -> Case:
    """A canonical file with other cells, columns and names, at times packed after that."""
    case = pick(random, [c for c in csv_seeds() if c.target == "r.csv"])
    content = _encoded(_odd_text(case.files["r.csv"].decode("latin-1"), random), random)
    return case.with_content(gzip.compress(content, mtime=0) if random.random() < 0.1 else content)


def _encoded(text: str, random: Random) -> bytes:
    kinds = ("latin-1", "utf-8", "utf-8", "utf-16", "utf-16-le", "utf-32", "utf-8-sig", "cp932")
    return text.encode(pick(random, kinds), "replace")


def _odd_text(text: str, random: Random) -> str:
    mark = next((m for m in ",;\t " if m in text), ",")
    rows = [line.split(mark) for line in text.splitlines()]
    for _ in range(int(random.integers(1, 5))):
        k, way = int(random.integers(len(rows)) * random.random()), random.integers(9)
        if not rows[k]:
            continue
        j = int(random.integers(len(rows[k])))
        if way <= 2:
            rows[k][j] = pick(random, CELLS)
        elif way == 3 and rows[0]:
            rows[0][j % len(rows[0])] = pick(random, NAMES)
        elif way == 4:
            rows[k] += [pick(random, CELLS)] * int(random.integers(1, 4))
        elif way == 5:
            del rows[k][j]
        elif way == 6:
            cell = pick(random, CELLS)
            for row in rows[1:]:
                if j < len(row):
                    row[j] = cell
        elif way == 7:
            rows = rows[: k + 1]
        else:
            rows.insert(k, [pick(random, CELLS)] * int(random.integers(1, 9)))
    return pick(random, ("\n", "\n", "\n", "\r\n", "\r", "\n\n")).join(mark.join(r) for r in rows)


@cache
def text_seeds() -> list[Case]:
    """Laboratories' own layouts, with logs of magnets and PicoTwist's plots."""
    columns = five_columns()
    bare = five_source(1, 2, 3, 4, 5, format="text", header=False)
    log = lines_of({"t": columns["Time"][::6], "m": columns["Magnet"][::6]}, " ", header=False)
    logged = {
        "beads": {"first_column": 2, "order": "xyz", "names": ["b1"]},
        "units": {"position": "nm"},
        "time": {"column": 1, "unit": "s"},
        "magnet": {"file": "motor.txt", "time_column": 1, "column": 2, "header": False},
        "lost": {"tokens": ["-1.#IND000"]},
        "header": False,
        "z_zero": {"unknown": True},
    }
    calisto = {"preset": "calisto-text", "units": {"position": "nm"}, "time": {"unit": "s"},
               "magnet": False, "z_zero": {"unknown": True}}  # fmt: skip
    numbered = {"n": np.arange(ROWS)} | {k: columns[k] for k in ("Time", "X", "Y", "Z")}
    positions = {k: columns[k] for k in ("Time", "X", "Y", "Z")}
    head = "LabVIEW Measurement\t\nDate\t2026/01/01\n***End_of_Header***\t\n"
    return [
        Case({"r.txt": lines_of(columns, " ", header=False).encode()}, "r.txt", setup_of(bare)),
        Case({"r.txt": lines_of(columns, "\t").encode()}, "r.txt", setup_of(five_source())),
        Case({"r.txt": (head + lines_of(columns, "\t", decimal=",")).encode("cp1252")}, "r.txt",
             setup_of(five_source(decimal=",", skip_lines=3))),
        Case({"r.txt": lines_of(positions, " ", header=False).encode(), "motor.txt": log.encode()},
             "r.txt", setup_of(logged)),
        Case({"r.txt": lines_of(numbered, " ", header=False).encode()}, "r.txt", setup_of(calisto)),
        Case({"r.gr": picotwist()}, "r.gr", setup_of({
            "beads": {"name": "b1", "z": "y"}, "units": {"position": "nm"},
            "frame": {"column": "frame"}, "z_zero": {"unknown": True}})),
    ]  # fmt: skip


def picotwist() -> bytes:
    """A plot file of two curves."""
    values = np.random.default_rng(0).normal(1000, 30, 2 * ROWS).astype("<f4").tobytes()
    head = f"%\n-lp title\n-ibfz 0 {ROWS}\n-lx\n-ibfz {4 * ROWS} {ROWS}\n"
    return head.encode() + b"\x1a" + values


def odd_text(random: Random) -> Case:
    """A laboratory's file with other cells, columns and names."""
    case = pick(random, [c for c in text_seeds() if c.target == "r.txt"])
    name = pick(random, list(case.files))
    content = _encoded(_odd_text(case.files[name].decode("latin-1"), random), random)
    return case.with_content(content, name)


def csv_steps(path: Path, case: Case) -> Iterator[Step]:
    """Reading it as a recording or, by its name, as a table of focus positions."""
    if path.name == "z.csv":
        yield partial(focus_positions_nm, path, ROWS)
    else:
        yield from steps(path, case)


def _grammar_setup(number: int) -> Case:
    content = grammar.example(grammar.SETUPS, number).encode("utf-8", "surrogatepass")
    return Case({"setup.toml": content}, "setup.toml")


def _grammar_csv(number: int) -> Case:
    content = grammar.example(grammar.CSV, number).encode("utf-8", "surrogatepass")
    return Case({"r.csv": content}, "r.csv", csv_seeds()[0].setup)


def _grammar_text(number: int) -> Case:
    content = grammar.example(grammar.TEXT, number).encode("utf-8", "surrogatepass")
    return Case({"r.txt": content}, "r.txt", text_seeds()[number % 2].setup)


READERS = (
    Reader("setup", setup_seeds, odd_setup, setup_steps, _grammar_setup),
    Reader("csv", csv_seeds, odd_csv, csv_steps, _grammar_csv),
    Reader("text", text_seeds, odd_text, steps, _grammar_text),
)
