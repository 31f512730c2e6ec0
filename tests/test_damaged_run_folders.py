"""Folders of runs that were edited, damaged or mixed: the report is drawn, or one sentence said."""

import copy
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mtpipe.ground.errors import MtpipeError
from mtpipe.report import pages
from mtpipe.report.contents import RunContent
from mtpipe.report.folder import (
    COLUMNS,
    JSON_FILES,
    RunFolderError,
    _read_json,
    _read_table,
    read_run_folder,
)
from tests.report_folder import write_run_folder

FAULTS = Path(__file__).parents[2] / "shared" / "cases" / "faults"
ODD = (None, True, -1, 0, 3.5, 1e300, "odd", "\u2028<b>", [], [None], [[1, "a"]], {}, {"a": 1})
EDITS, DRAWN = 80, 2
MODELS = {"run.json": RunContent, **JSON_FILES}


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return write_run_folder(tmp_path_factory.mktemp("sound") / "run", plateaus=2)


@pytest.fixture
def folder(sound, tmp_path, monkeypatch):
    monkeypatch.setattr("plotly.offline.get_plotlyjs", lambda: "")  # its 4 MB change nothing
    return Path(shutil.copytree(sound, tmp_path / "run"))


def refused(read):
    """What is said against something; empty where nothing is."""
    try:
        read()
    except MtpipeError as error:
        return str(error)
    return ""


def outcome(folder):
    """What is said of a folder; empty where its report is drawn."""
    return refused(lambda: pages.write_report(folder))


def places(content, path=()):
    """Every place in a JSON document."""
    yield path
    if isinstance(content, dict):
        for key in content:
            yield from places(content[key], (*path, key))
    elif isinstance(content, list):
        for k in range(min(len(content), 2)):  # the others are like these
            yield from places(content[k], (*path, k))


def edited(content, path, value):
    """A copy of a document with another value at a place; without it, where the value is `del`."""
    content = copy.deepcopy(content)
    inner = content
    for key in path[:-1]:
        inner = inner[key]
    if value == "del":
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return content


@pytest.mark.slow
@pytest.mark.parametrize("name", ["run.json", *JSON_FILES])
def test_any_edit_of_a_json_file_is_drawn_or_told(folder, name):
    whole = json.loads((folder / name).read_text(encoding="utf-8"))
    every = [path for path in places(whole) if path]
    random = np.random.default_rng(len(name))
    told, accepted = [], []
    for _ in range(EDITS):
        path = every[random.integers(len(every))]
        value = [*ODD, "del"][random.integers(len(ODD) + 1)]
        (folder / name).write_text(json.dumps(edited(whole, path, value)), encoding="utf-8")
        said = refused(lambda: _read_json(folder / name, MODELS[name]))
        (told if said else accepted).append(said or (folder / name).read_bytes())
    assert len(told) > EDITS / 4
    assert all(name in said for said in told)
    for content in accepted[:DRAWN]:
        (folder / name).write_bytes(content)
        outcome(folder)


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b"null", b"\xff\xfe", b'{"run": "\\ud800"}'])
@pytest.mark.parametrize("name", ["run.json", *JSON_FILES])
def test_a_json_file_that_is_none_is_told(folder, name, content):
    (folder / name).write_bytes(content)
    assert name in refused(lambda: _read_json(folder / name, MODELS[name]))


def odd_column(column, kind):
    """Another column of the same length."""
    n = len(column)
    return {
        "words": ["odd"] * n,
        "numbers": np.full(n, -3.5),
        "infinite": np.full(n, np.inf),
        "huge": np.full(n, 1e300),
        "zero": np.zeros(n),
        "nothing": [None] * n,
        "truth": [True] * n,
        "lists": [[1.0]] * n,
        "dates": pd.date_range("2026-01-01", periods=n),
        "first": column.iloc[:1].repeat(n).to_numpy(),
    }[kind]


KINDS = ("words", "numbers", "infinite", "huge", "zero", "nothing", "truth", "lists", "dates",
         "first")  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", COLUMNS)
def test_any_edit_of_a_table_is_drawn_or_told(folder, name):
    table = pd.read_parquet(folder / name)
    random = np.random.default_rng(len(name))
    columns = random.permutation(table.columns)[:5]
    accepted = []
    places = [name for name in ("bead", "plateau", "axis") if name in table.columns]
    for column in dict.fromkeys([*columns, *places]):
        for kind in random.permutation(KINDS)[:2]:
            table.assign(**{column: odd_column(table[column], kind)}).to_parquet(folder / name)
            said = refused(lambda: _read_table(folder / name, COLUMNS[name]))
            assert not said or name in said
            accepted += [] if said else [(folder / name).read_bytes()]
    for content in accepted[:DRAWN]:
        (folder / name).write_bytes(content)
        outcome(folder)
    table.to_parquet(folder / name)
    data = (folder / name).read_bytes()
    for at in random.integers(4, len(data), 15):
        (folder / name).write_bytes(data[:at] + bytes([data[at] ^ 0x55]) + data[at + 1 :])
        refused(lambda: _read_table(folder / name, COLUMNS[name]))
    for content in (data[: len(data) // 2], b""):
        (folder / name).write_bytes(content)
        assert name in outcome(folder)
    table.drop(columns=columns[0]).to_parquet(folder / name)
    assert columns[0] in outcome(folder)


@pytest.mark.parametrize(
    ("name", "column", "value"),
    [("crosscheck.parquet", "p_value", np.nan), ("details/spectra.parquet", "frequency_hz", 0.0)],
)
def test_a_number_that_cannot_be_drawn_is_told(folder, name, column, value):
    table = pd.read_parquet(folder / name)
    table.loc[0, column] = value
    table.to_parquet(folder / name)
    assert f"column {column} h" in refused(lambda: _read_table(folder / name, COLUMNS[name]))


@pytest.mark.parametrize("name", [*COLUMNS, *JSON_FILES])
def test_files_of_another_run_are_refused(folder, tmp_path, name):
    path = folder / name
    if path.suffix == ".json":
        content = json.loads(path.read_text(encoding="utf-8"))
        path.write_text(json.dumps(content | {"run": "another"}), encoding="utf-8")
    else:
        table = pd.read_parquet(path)
        table.attrs["run"] = "another"
        table.to_parquet(path)
    with pytest.raises(RunFolderError, match=r"belongs to another run") as told:
        read_run_folder(folder)
    assert name in str(told.value)


@pytest.mark.skipif(not FAULTS.is_dir(), reason="needs ../shared/cases/faults")
def test_the_damaged_files_of_the_cases_are_told(sound, folder):
    files = [f for kind in ("runjson", "runfolder") for f in (FAULTS / kind).iterdir()]
    assert files
    for file in files:
        name = file.name.rpartition("__")[2]
        (place,) = (p for p in (folder / name, folder / "details" / name) if p.exists())
        shutil.copy(file, place)
        assert name in outcome(folder), file.name
        place.chmod(0o644)
        shutil.copy(sound / place.relative_to(folder), place)
    assert not outcome(folder)
