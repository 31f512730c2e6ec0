"""Presets: the layouts that known instruments and programs write, as defaults of `[source]`.

A preset is a table of `[source]` that the user's own keys override, key by key; it is data, and
what only the files can tell (which file is the motor log, how many beads there are) is found out
in `instruments`. The layouts are those of the programs themselves, cited at each table.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

CALISTO_TEXT = "calisto-text"
CALISTO_HDF5 = "calisto-hdf5"
MAGSCOPE_HDF5 = "magscope-hdf5"
DEKKER_TEXT = "dekker-text"
SHON_TEXT = "shon-text"
COLUMNS = "columns"

BEAD_COLUMNS = ("x", "y", "z", "first_column")
REMOVABLE = ("time", "frame", "magnet", "rotation")
WHITESPACE = {"format": "text", "delimiter": "whitespace", "header": False}


@dataclass(frozen=True)
class Preset:
    """Defaults of `[source]` for one layout.

    Attributes
    ----------
    table : the defaults, as they would stand in the setup.
    files : pattern (re) of the names of its recordings in a folder; `called` says it in words.
    needs : keys that differ from set-up to set-up and that no file tells, each with an example.
    columns : patterns (re) of names of columns; a file that has one of each is known by them.
    """

    table: Mapping[str, Any]
    files: str = ".*"
    called: str = "any name"
    needs: Mapping[str, str] = field(default_factory=dict)
    columns: tuple[str, ...] = ()

    def has_columns(self, names: Iterable[str]) -> bool:
        """Whether a file with columns of these names is known by them."""
        there = list(names)
        return bool(self.columns) and all(
            any(re.fullmatch(pattern, name) for name in there) for pattern in self.columns
        )


PRESETS: dict[str, Preset] = {
    # lipfertlab/calisto, README and src/CALISTO/engines/landing_engine.py (2026). CALISTO has the
    # units as factors of each set-up in its config.yaml, one pair for beads, one for the motors.
    CALISTO_TEXT: Preset(
        table={
            **WHITESPACE,
            "frame": {"column": 1},
            "time": {"column": 2},
            "beads": {"first_column": 3, "order": "xyz"},
            "magnet": {**WHITESPACE, "column": 3, "time_column": 2},
        },
        needs={"units": 'units.position = "um"', "time.unit": 'time.unit = "ms"'},
    ),
    # as above; names say the units, but for `timestamp`, which CALISTO's own set-up takes in s
    CALISTO_HDF5: Preset(
        table={
            "format": "hdf5",
            "time": {"column": "timestamp", "unit": "s"},
            "units": {"position": "nm"},
            "beads": [
                {"name": "M{n}", "x": "M{n}/x_nm", "y": "M{n}/y_nm", "z": "M{n}/z_nm"},
                {"name": "R{n}", "x": "R{n}/x_nm", "y": "R{n}/y_nm", "z": "R{n}/z_nm"},
                {"name": "b{n}", "x": "{n}/x_nm", "y": "{n}/y_nm", "z": "{n}/z_nm"},
            ],
            "magnet": {"column": "stage/mag_pos_mm", "time_column": "stage/t_s"},
        },
        files=r".*\.(h5|hdf5)(\.gz)?",
        called="*.h5",
        columns=("timestamp", r"[MR]?\d+/x_nm", "stage/mag_pos_mm"),
    ),
    # 7jameslondon/MagScope, magscope/tracking_data.py; the columns are those of `magscope`
    MAGSCOPE_HDF5: Preset(
        table={
            "format": "hdf5",
            "time": {"column": "time_s", "unit": "s"},
            "units": {"position": "nm"},
            "beads": {"name": "b{n}", "x": "bead {n} x", "y": "bead {n} y", "z": "bead {n} z"},
        },
        files=r".*\.(h5|hdf5)(\.gz)?",
        called="Tracking Data *.h5",
    ),
    # svandersmagt/BEP, forceAnalysisPro.m, and svandersmagt/MT-Force-Calibration, readme.txt: the
    # motor file has a row for every row of the bead file
    DEKKER_TEXT: Preset(
        table={
            **WHITESPACE,
            "units": {"position": "um"},
            "magnet": {
                **WHITESPACE,
                "file": "{name}_motors.txt",
                "row_by_row": True,
                "column": 1,
            },
        },
        files=r"(?!.*_motors\.).*",
        called="<name>.txt beside <name>_motors.txt",
    ),
    # ShonLab/Magnetic-Tweezers, "force calibration/analysis.m": time is frame number / frame rate
    # on the motor's clock, magnet rotation counts turns, 0.878 is n(water)/n(oil)
    SHON_TEXT: Preset(
        table={
            **WHITESPACE,
            "frame": {"column": 1},
            "units": {"x": "pixel", "y": "pixel", "z": "nm"},
            "scale": {"z": 0.878},
            "beads": {"first_column": 2, "order": "xyz"},
            "magnet": {**WHITESPACE, "column": 2, "time_column": 1, "time_unit": "s"},
            "rotation": {"column": 3, "unit": "turn", "in_log": True},
        },
        files=r"r\d+-\d+\.xls(\.gz)?",
        called="r###-###.xls",
    ),
    COLUMNS: Preset(table={}),
}


def with_preset(table: Mapping[str, Any]) -> dict[str, Any]:
    """A `[source]` table with its preset's defaults under the user's keys.

    A table of the preset is taken away by `false` (`magnet = false`). Beads that the user
    describes by columns of their own replace the preset's; with names alone they keep its columns.

    Raises
    ------
    ValueError : the preset is not known, or a key it needs is missing.
    """
    name = table.get("preset")
    if name is None:
        return dict(table)
    if name not in PRESETS:
        near = difflib.get_close_matches(str(name), PRESETS, n=1)
        hint = f"did you mean {near[0]}? Known: " if near else "known: "
        raise ValueError(f"preset: there is no preset {name!r}; {hint}{', '.join(PRESETS)}")
    preset = PRESETS[name]
    defaults = dict(preset.table)
    beads = table.get("beads")
    if isinstance(beads, Mapping) and any(key in beads for key in BEAD_COLUMNS):
        defaults.pop("beads", None)
    merged = _merged(defaults, table)
    for key in REMOVABLE:
        if merged.get(key) is False:
            merged[key] = None
    if table.get("magnet") is False and "rotation" not in table:
        merged["rotation"] = None  # it stands in the same log
    missing = [text for key, text in preset.needs.items() if not _states(merged, key)]
    if missing:
        raise ValueError(
            f'preset "{name}" says nothing of units, which differ from set-up to set-up; give '
            f"{' and '.join(missing)}, or whatever yours writes"
        )
    return merged


def _merged(under: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(under)
    for key, value in over.items():
        below = merged.get(key)
        if isinstance(below, Mapping) and isinstance(value, Mapping):
            merged[key] = _merged(below, value)
        else:
            merged[key] = value
    return merged


def _states(table: Mapping[str, Any], key: str) -> bool:
    """Whether a dotted key is there, or need not be as the table it is in was taken away."""
    head, _, rest = key.partition(".")
    if not rest:
        return bool(table.get(head))
    inner = table.get(head)
    return inner is None or (isinstance(inner, Mapping) and rest in inner)
