"""How files of columns are read: as a recording, and each column by itself."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from case import Case, Step
from odd import Random, odd_array, odd_name, pick

import mtpipe
from mtpipe.ingest.arrays import ArrayTable
from mtpipe.ingest.read import open_table
from mtpipe.setup.setup import Setup, parse_setup
from mtpipe.setup.source_parts import Layout

FIVE = ("Time", "Magnet", "X", "Y", "Z")
ROWS, RATE_HZ = 60, 100.0
MOST_COLUMNS = 12


def setup_of(source: dict[str, Any] | None, reference: tuple[str, ...] = ()) -> Setup:
    """A setup with this `[source]` table, for recordings of some 60 rows."""
    content: dict[str, Any] = {
        "schema": 1,
        "camera": {"frame_rate_hz": RATE_HZ, "exposure_s": 0.005, "pixel_size_nm": 100.0},
        "beads": {"radius_nm": 500.0, "reference": list(reference)},
        "tether": {"contour_length_nm": 1000.0, "persistence_length_nm": 50.0},
        "buffer": {"temperature_K": 298.0, "viscosity_mPa_s": 0.9},
        "field": {"direction": "x"},
        "plateaus": {"minimum_s": 0.1, "tolerance_mm": 0.01},
    }
    return parse_setup(content if source is None else content | {"source": source})


def five_columns(rows: int = ROWS) -> dict[str, np.ndarray[Any, Any]]:
    """Time, magnet and positions of one bead."""
    random = np.random.default_rng(0)
    return {
        "Time": np.arange(rows) / RATE_HZ,
        "Magnet": np.full(rows, 3.0),
        **{axis: np.round(random.normal(1000, 30, rows), 3) for axis in "XYZ"},
    }


def five_source(*names: str | int, **more: Any) -> dict[str, Any]:
    """The `[source]` table of these columns, under the names that a container gives them."""
    time, magnet, x, y, z = names or ("Time", "Magnet", "X", "Y", "Z")
    return {
        "beads": {"name": "b1", "x": x, "y": y, "z": z},
        "units": {"position": "nm"},
        "time": {"column": time, "unit": "s"},
        "magnet": {"column": magnet, "unit": "mm"},
        "z_zero": {"value_nm": 0.0},
    } | more


def one_file(name: str, content: bytes, *names: str | int, **more: Any) -> Case:
    """A case of one file with the five columns, under the names that it gives them."""
    return Case({name: content}, name, setup_of(five_source(*names, **more)))


def odd_columns(random: Random, *, rare: bool = True) -> dict[str, Any]:
    """Columns as they should be, of which some are odd, gone, or under another name."""
    columns: dict[str, Any] = dict(five_columns())
    for _ in range(int(random.integers(1, 4))):
        name = pick(random, FIVE)
        way = random.integers(4)
        if way == 0:
            columns.pop(name, None)
        elif way == 1:
            columns[odd_name(random)] = odd_array(random, rare=rare)
        else:
            columns[name] = odd_array(random, rare=rare)
    return columns


def steps(path: Path, case: Case) -> Iterator[Step]:
    """Reading a recording, and every column of its file."""
    yield partial(mtpipe.load, path, case.setup)
    stated = case.setup.source or Layout()
    layout = Layout(**{name: getattr(stated, name) for name in Layout.model_fields})
    incomplete = "take" if case.options["take"] else None
    yield partial(_every_column, path, layout.model_copy(update={"incomplete": incomplete}))


def _every_column(path: Path, layout: Layout) -> None:
    """Read the first columns, those of one length together; the first fault ends it."""
    table = open_table(path, layout)
    columns = range(min(len(table.names), MOST_COLUMNS))
    lengths = table.lengths if isinstance(table, ArrayTable) else (0,) * len(table.names)
    for length in dict.fromkeys(lengths[k] for k in columns):
        for _ in table.batches([k for k in columns if lengths[k] == length]):
            pass
