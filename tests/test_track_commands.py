"""Tracking as users call it: the commands, several processes."""

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import mtpipe
from mtpipe.cli.commands import app
from mtpipe.ground.errors import RecordingError
from mtpipe.tracking.track import track
from tests.stack_images import setup_text

pytestmark = pytest.mark.slow


def test_processes_and_carriers_change_nothing(tracked, tmp_path):
    folder, *_ = tracked
    first = pd.read_csv(folder / "recording.csv", comment="#")
    steps = []
    for name, workers in (("a.parquet", 1), ("b.csv.gz", 2)):
        track(
            folder / "film.tif",
            tmp_path / name,
            setup=folder / "setup.toml",
            workers=workers,
            progress=lambda step, done, total: steps.append((step, done, total)),
        )
        recording = mtpipe.load(tmp_path / name, folder / "setup.toml")
        assert recording.tracked.table_height == {"bead1", "bead2"}
        for bead in ("bead1", "bead2"):
            columns = [f"{bead}_{axis}_nm" for axis in "xy"]
            assert np.allclose(recording.positions_nm[bead][:, :2], first[columns], atol=2e-3)
    assert steps[-1] == ("tracking beads", 400, 400)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.parquet", "b.csv.gz"]


def test_the_commands(tracked, scan, tmp_path):
    folder, *_ = tracked
    runner = CliRunner()
    film, setup = str(folder / "film.tif"), str(folder / "setup.toml")
    done = runner.invoke(
        app, ["track", film, "--setup", setup, "--out", str(tmp_path / "r.csv"), "--workers", "1"]
    )
    assert done.exit_code == 0, done.output
    assert "2 beads were found" in done.output
    assert "(2 beads, 400 frames)" in done.output
    asked = ["lut", str(scan / "scan.tif"), "--z", str(scan / "z.csv")]
    factor = ["--refractive-index-factor", "0.88"]
    done = runner.invoke(
        app, [*asked, *factor, "--out", str(tmp_path / "t.npz"), "--region", "40,45,41"]
    )
    assert done.exit_code == 0, done.output
    assert "Look-up table of bead1" in done.output
    assert "No --refractive-index-factor" not in done.output
    done = runner.invoke(app, [*asked, "--out", str(tmp_path / "t.npz"), "--region", "40,45,41"])
    assert done.exit_code == 0, done.output
    assert "focus positions are taken for heights (factor 1)" in done.output
    for wrong in (
        [*asked, *factor, "--out", str(tmp_path / "t.txt")],
        [*asked, *factor, "--out", str(tmp_path / "t.npz"), "--region", "40,45"],
    ):
        assert runner.invoke(app, wrong).exit_code == 2


def test_a_series_may_be_run_by_the_pattern_of_its_names(tmp_path):
    (tmp_path / "setup.toml").write_text(setup_text())
    (tmp_path / "film_1.tif").write_bytes(b"II*\x00")
    series = ["run", str(tmp_path / "film_*.tif"), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, series)
    assert isinstance(done.exception, RecordingError)
    assert "film_1.tif" in str(done.exception)
