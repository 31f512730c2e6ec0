"""README's commands as they stand, on files as a reader would have them (its Python: test_python).

Only names that stand for a reader's own files are replaced. A new command of README has to be
entered in `READERS`.
"""

import json
import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tifffile

import mtpipe
from mtpipe.cli.entry import main
from mtpipe.pipeline.demo import Sample
from tests.stack_images import draw
from tests.tracked_film import FOCUS_NM, SHAPE

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
LAYOUT = (ROOT / "docs" / "how-to" / "file-layout.md").read_text(encoding="utf-8")
(SETUP,) = re.findall(r"```toml\n(schema.*?)```", LAYOUT, re.DOTALL)
ROWS = re.findall(r"^\| `(mtpipe [^`]+)` \| (.+) \|$", README, re.MULTILINE)

# Of each command: the folder in which a reader calls it, what stands in place of the names in
# capitals, and what it writes there. In an order in which each finds what others wrote.
READERS = {
    "mtpipe init my_recording.txt": ("own", {}, ["setup.toml"]),
    "mtpipe run setup.toml --out results": ("own", {}, ["results/report/index.html"]),
    "mtpipe simulate setup.toml --force 1,5,10 --out DIR": (
        "new", {"DIR": "simulated"}, ["simulated/recording.csv", "simulated/truth.json"],
    ),
    "mtpipe design setup.toml --reach 20": ("new", {}, []),
    "mtpipe init FILE…": ("file", {"FILE…": "motion.csv"}, ["setup.toml"]),
    "mtpipe run RECORDING --out DIR": (
        "recording", {"RECORDING": "recording.csv", "DIR": "out"},
        ["out/forces.csv", "out/beads.csv", "out/crosscheck.parquet", "out/mismatch.json",
         "out/report/index.html"],
    ),
    "mtpipe report DIR --figures": ("recording", {"DIR": "out"}, ["out/report/figures"]),
    'mtpipe mark DIR BEAD --plateau 4 --reason "…"': (
        "recording", {"DIR": "out", "BEAD": "b1"}, ["out/marks.toml"],
    ),
    "mtpipe batch FOLDER --out DIR": (
        "batch", {"FOLDER": "recordings", "DIR": "all"}, ["all/index.html"],
    ),
    "mtpipe magnet-curve DIR": (
        "curve", {"DIR": "runs"}, ["runs/magnet_curve.csv", "runs/magnet.toml"],
    ),
    "mtpipe run STACK --out DIR": (
        "film", {"STACK": "film.tif", "DIR": "out"}, ["out/recording.csv", "out/report/index.html"],
    ),
    "mtpipe run film.tif --out results": ("film", {}, ["results/report/index.html"]),
    "mtpipe track STACK --out recording.csv": ("film", {"STACK": "film.tif"}, ["recording.csv"]),
    "mtpipe lut STACK --z positions.csv --out lut.npz": (
        "film", {"STACK": "scan.tif"}, ["lut.npz"],
    ),
    "mtpipe explain KEY": ("new", {"KEY": "camera.exposure_s"}, []),
    "mtpipe demo": ("new", {}, []),
    "mtpipe watch FOLDER --out DIR": ("batch", {"FOLDER": "recordings", "DIR": "watched"}, []),
}  # fmt: skip


def commands():
    """All of README: lines of its blocks, and those in running text that say what to do it to."""
    lines = [line.partition(" #")[0].strip() for block in BLOCKS for line in block.splitlines()]
    parts = [part.strip() for line in lines for part in line.split("&&")]
    found = [part.removeprefix(".venv/bin/") for part in parts]
    found += re.findall(r"`(mtpipe [^`]+ [^`]+|mtpipe demo)`", README)
    return {one for one in found if one.startswith("mtpipe ")}


def called(line, folder, monkeypatch, capsys):
    """What a command says; it ends well."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", shlex.split(line))
    with pytest.raises(SystemExit) as stopped:
        main()
    out, err = capsys.readouterr()
    assert not stopped.value.code, f"{line}\n{out}\n{err}"
    return out


def simulated(folder, forces, frames, beads=1):
    """A recording of the experiment that docs/how-to/file-layout.md describes, with its setup."""
    folder.mkdir(parents=True)
    (folder / "setup.toml").write_text(SETUP, encoding="utf-8")
    size = ["--force", forces, "--frames", str(frames), "--beads", str(beads)]
    line = [sys.executable, "-m", "mtpipe", "simulate", "setup.toml", *size, "--out", "made"]
    subprocess.run(line, cwd=folder, check=True, capture_output=True)
    return folder / "made" / "recording.csv"


@pytest.fixture(scope="module")
def folders(tmp_path_factory, tracked):
    """A folder for each reader, with what they have before they begin."""
    home = tmp_path_factory.mktemp("readers")
    recording = simulated(home / "new", "0.5,1,2,4,8", 1024)
    (home / "recording").mkdir()
    shutil.copy(recording, home / "recording" / "recording.csv")
    (home / "recording" / "setup.toml").write_text(SETUP, encoding="utf-8")
    table = pd.read_csv(recording, comment="#")
    named = {"time_s": "Time (s)", "magnet_mm": "Motor (mm)"}
    for folder, name, mark in (("own", "my_recording.txt", "\t"), ("file", "motion.csv", ",")):
        (home / folder).mkdir()
        foreign = table.rename(columns=lambda one: named.get(one, one.replace("_nm", " (nm)")))
        foreign.to_csv(home / folder / name, sep=mark, index=False, float_format="%.4f")
    short = simulated(home / "batch" / "recordings" / "one", "1,3,8", 768)
    shutil.move(short, home / "batch" / "recordings" / "one" / "recording.csv")
    shutil.rmtree(home / "batch" / "recordings" / "one" / "made")
    several = simulated(home / "curve", "1,2,4,8", 768, beads=3)
    mtpipe.run(several, home / "curve" / "runs" / "one", cross_check=False)
    shutil.copytree(tracked[0], home / "film", ignore=shutil.ignore_patterns("recording*"))
    tifffile.imwrite(
        home / "film" / "scan.tif",
        draw(SHAPE, [(40.2, 45.1, FOCUS_NM)], seed=5),
        photometric="minisblack",
        metadata=None,
    )
    pd.DataFrame({"z_nm": FOCUS_NM}).to_csv(home / "film" / "positions.csv", index=False)
    return home


def test_every_command_has_a_reader():
    assert commands() == set(READERS)


def test_options_that_the_table_names_are_there(tmp_path, monkeypatch, capsys):
    assert len(ROWS) >= 14
    for command, words in ROWS:
        name = command.split()[1]
        options = re.findall(r"--[a-z-]+", f"{command} {words}")
        offered = called(f"mtpipe {name} --help", tmp_path, monkeypatch, capsys)
        for option in options:
            assert option in offered, f"{name} {option}"


ALONE = {"mtpipe demo", "mtpipe watch FOLDER --out DIR"}


@pytest.mark.parametrize("command", [one for one in READERS if one not in ALONE])
def test_a_command_does_as_readme_says(folders, command, monkeypatch, capsys):
    folder, names, written = READERS[command]
    line = " ".join(names.get(word, word) for word in command.split(" "))
    out = called(line, folders / folder, monkeypatch, capsys)
    assert out.strip()
    for path in written:
        assert (folders / folder / path).exists(), f"{line}: {path}"


def test_forces_of_a_run_are_those_that_were_simulated(folders):
    """A command may end well and have written nonsense."""
    forces = pd.read_csv(folders / "recording" / "out" / "forces.csv", comment="#")
    truth = json.loads((folders / "new" / "made" / "truth.json").read_text(encoding="utf-8"))
    quoted = sorted(forces.drop_duplicates("plateau")["force_pN"])
    true = sorted(rest["force_pN"] for rest in truth["beads"]["b1"]["plateaus"])
    assert len(quoted) == 5
    np.testing.assert_allclose(quoted, true, rtol=0.3)


def test_the_demo_runs(folders, tmp_path, monkeypatch, capsys):
    """On one of its recordings, without a cross-check: all take a minute (test_sample_data)."""
    (tmp_path / "data").mkdir()
    shutil.copytree(ROOT / "sample_data" / "clean_short_tether", tmp_path / "data" / "short")
    monkeypatch.setattr("mtpipe.pipeline.demo.sample_data", lambda: tmp_path / "data")
    monkeypatch.setattr("mtpipe.pipeline.demo.SAMPLES", (Sample("short", cross_check=False),))
    assert "one tether" in called("mtpipe demo", tmp_path, monkeypatch, capsys)


def test_watching_calibrates_what_is_there_until_it_is_stopped(folders):
    folder, names, _ = READERS["mtpipe watch FOLDER --out DIR"]
    line = [sys.executable, "-m", "mtpipe", "watch", names["FOLDER"], "--out", names["DIR"]]
    watching = subprocess.Popen(line, cwd=folders / folder, stdout=subprocess.DEVNULL)
    try:
        until = time.monotonic() + 120
        while not list((folders / folder / names["DIR"]).rglob("forces.csv")):
            assert watching.poll() is None
            assert time.monotonic() < until
            time.sleep(0.2)
    finally:
        watching.terminate()
        watching.wait(60)
