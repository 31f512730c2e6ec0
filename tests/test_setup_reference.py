"""The reference of the setup's keys: complete, true, and the same everywhere."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from mtpipe.cli.explain import page
from mtpipe.setup.reference import find_key, keys, usual_error
from mtpipe.setup.setup import parse_setup
from mtpipe.setup.usual_errors import USUAL_RELATIVE

ROOT = Path(__file__).parents[1]
KEYS = {key.path: key for key in keys()}
COMPLETE = """
schema = 1
camera = { frame_rate_hz = 120.0, exposure_s = 0.005 }
beads = { radius_nm = 1400.0 }
tether = { contour_length_nm = 2700.0, persistence_length_nm = 50.0 }
buffer = { temperature_K = 298.15, viscosity_mPa_s = 0.89 }
field = { direction = "x" }
"""
# What a key needs beside it; "" where it stands alone.
BESIDE = {
    "magnet": "position_mm = 3.0\nforce_pN = 4.1",
    "magnets": "width_mm = 5.0\nlength_mm = 5.0\nheight_mm = 5.0\ngap_mm = 1.0\n"
    'magnetised = "vertical"\nremanence_T = 1.4\ntouching_mm = 0.0\n'
    "saturation_kA_per_m = 42.0\nsaturating_field_mT = 12.0",
    "source.beads": 'name = "b1"\nx = 2',
    "source.time": 'column = 1\nunit = "s"',
    "source.frame": "column = 1",
    "source.magnet": "column = 2",
    "source.rotation": 'column = 2\nunit = "turn"',
    "tracking.regions": 'name = "b1"\nx_px = 1.0\ny_px = 2.0\nsize_px = 32',
    "tracking.magnet": 'column = 2\nfile = "log.txt"\ntime_column = 1',
}


def command(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "mtpipe", "explain", *arguments],
        capture_output=True,
        text=True,
        check=False,
        encoding="utf-8",
    )


@pytest.mark.parametrize("path", KEYS)
def test_every_key_says_what_it_means_and_shows_how_it_is_written(path):
    key = KEYS[path]
    assert key.meaning.endswith("."), path
    assert len(key.meaning) > 10 or key.meaning.startswith("Unit"), path
    assert key.is_table or tomllib.loads(key.example)


def with_example(key):
    """A whole setup in which the key stands as its example has it."""
    content = tomllib.loads(COMPLETE)
    place = content
    steps = key.table.replace("<bead>", "b1").split(".") if key.table else []
    for i, step in enumerate(steps):
        path = ".".join(steps[: i + 1])
        beside = tomllib.loads(BESIDE.get(path, ""))
        place = place.setdefault(step, {} | beside)
        if isinstance(place, list):
            place = place[0]
    example = tomllib.loads(key.example)
    if key.path.startswith("source.z_zero"):
        place.clear()
    place |= example
    match key.path.rpartition(".")[2]:
        case "names" | "first_column" | "order":
            place.clear()
            place |= {"first_column": 3} | example
        case "name" if "{n}" in key.example:
            place["x"] = "x{n}"
        case "x" | "y" | "z" if "{n}" in key.example:
            place.clear()
            place |= {"name": "b{n}"} | example
        case "row_by_row":
            place.pop("time_column", None)
            place["file"] = "log.txt"
        case "no_plateau":
            place["touch_rows"] = [1, 100]
        case "file" | "clock_offset_s":
            place["time_column"] = 1
        case "in_log":
            content["source"]["magnet"] = {"column": 2, "time_column": 1}
        case "decimal":
            place["delimiter"] = "tab"
        case "method" if key.path.startswith("drift"):
            place["cutoff_hz"] = 0.1
    source = content.get("source")
    if source and (set(source) & {"time", "frame", "magnet", "rotation", "units", "scale", "beads"}
                   or key.path in ("source.format", "source.header")):  # fmt: skip
        source.setdefault("beads", {"name": "b1", "x": 2})
        source.setdefault("units", {}).setdefault("position", "nm")
    for path in ("source.beads", "tracking.regions"):
        table, _, name = path.partition(".")
        if isinstance(content.get(table, {}).get(name), dict):
            content[table][name] = [content[table][name]]
    if isinstance(content.get("magnet"), dict):
        content["magnet"] = [content["magnet"]]
    return content


@pytest.mark.parametrize("path", [path for path, key in KEYS.items() if not key.is_table])
def test_every_example_is_a_setup(path):
    parse_setup(with_example(KEYS[path]))


def test_the_page_is_what_the_command_prints():
    written = (ROOT / "docs" / "setup-reference.md").read_text(encoding="utf-8")
    assert written == page() + "\n", "run mtpipe explain --markdown > docs/setup-reference.md"


def test_units_defaults_and_errors_are_those_in_effect():
    assert KEYS["camera.exposure_s"].unit == "s"
    assert KEYS["buffer.viscosity_mPa_s"].unit == "mPa s"
    assert KEYS["camera.exposure_s"].default == "required"
    assert KEYS["camera.pixel_size_nm"].default == "none"
    assert KEYS["plateaus.minimum_s"].default == "5.0"
    assert KEYS["drift.cutoff_hz"].kind == 'number or "auto" or "none"'
    assert KEYS["source.keep_rows"].kind == "list of pairs"
    assert "above 0" in KEYS["report.tolerance"].kind
    setup = parse_setup(tomllib.loads(COMPLETE))
    for path in ("camera.exposure_s", "beads.radius_nm", "tether.persistence_length_nm"):
        table, name = path.split(".")
        value = getattr(getattr(setup, table), name)
        assert usual_error(path) == f"{100 * value.relative_stderr:g} %"
        assert value.relative_stderr == pytest.approx(USUAL_RELATIVE[name])


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ("camera.exposure_s", "camera.exposure_s"),
        ("exposure_s", "camera.exposure_s"),
        ("camera.exposure_s_stderr", "camera.exposure_s"),
        ("[source.z_zero]", "source.z_zero"),
    ],
)
def test_a_key_is_found_by_its_path_or_its_name(asked, found):
    assert find_key(asked).path == found


@pytest.mark.slow
def test_explain_on_the_terminal():
    alone = command()
    assert alone.returncode == 0
    for table in ("camera", "beads", "tether", "buffer", "source", "tracking", "report"):
        assert f"  {table} " in alone.stdout
    one = command("camera.exposure_s")
    assert one.returncode == 0
    assert "Shutter time" in one.stdout
    assert "example  exposure_s = 0.0083333" in one.stdout
    wrong = command("camera.exposure")
    assert wrong.returncode == 2
    assert wrong.stderr.count("\n") == 1
    assert "camera.exposure_s" in wrong.stderr
