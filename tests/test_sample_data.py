"""The bundled recordings: they load, agree with their truth, are small, and can be made again."""

from __future__ import annotations

import gzip
import hashlib
import json
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from mtpipe.calibration.extension import mean_with_stderr
from mtpipe.drift import subtract_drift
from mtpipe.ingest import load
from mtpipe.physics.mistracking import without_mistracked
from mtpipe.pipeline.demo import (
    SAMPLES,
    Sample,
    findings,
    recording_in,
    run_demo,
    sample_data,
    truth_of,
)
from mtpipe.recording.recording import Recording

pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).parents[1]
SHARED = CHECKOUT.parent / "shared"
FOLDERS = sorted(p.parent for p in (CHECKOUT / "sample_data").glob("*/setup.toml"))
MOST_BYTES = 6_000_000
PER_PLATEAU = ("force_pN", "extension_nm", "friction_pN_s_per_nm", "friction_z_pN_s_per_nm")

each_recording = pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)


@cache
def _loaded(folder: Path) -> Recording:
    return load(recording_in(folder))


def _truth(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "truth.json").read_text(encoding="utf-8"))


def _unpacked(path: Path) -> bytes:
    content = path.read_bytes()
    return gzip.decompress(content) if content.startswith(b"\x1f\x8b") else content


def test_there_are_recordings_of_every_kind():
    assert sample_data() == CHECKOUT / "sample_data"
    names = {folder.name for folder in FOLDERS}
    assert {"several_beads", "laboratory_text"} < names
    assert sum(name.startswith("clean_") for name in names) == 2


def test_they_are_small():
    files = [p for p in (CHECKOUT / "sample_data").rglob("*") if p.is_file()]
    assert sum(p.stat().st_size for p in files) < MOST_BYTES


@each_recording
def test_truth_names_every_tethered_bead_and_plateau(folder):
    recording, truth = _loaded(folder), _truth(folder)
    assert set(truth) == set(recording.tethered)
    tethers = [bead for bead in truth.values() if "force_pN" in bead]
    assert tethers
    for bead in tethers:
        assert [len(bead[name]) for name in PER_PLATEAU] == 4 * [len(recording.plateaus)]
        order = np.argsort([plateau.magnet_mm for plateau in recording.plateaus])
        assert np.all(np.diff(np.array(bead["force_pN"])[order]) < 0), "nearer magnets pull more"


@each_recording
def test_mean_heights_are_the_true_extensions(folder):
    recording = subtract_drift(_loaded(folder))
    for name, bead in _truth(folder).items():
        if "extension_nm" not in bead:
            continue
        for plateau, true in zip(recording.plateaus, bead["extension_nm"], strict=True):
            trace, _ = without_mistracked(recording.trace_nm(name, plateau))
            mean, stderr = mean_with_stderr(trace[:, 2])
            # 8 nm: where z = 0 is for a bead that touches the surface is no better known
            assert mean == pytest.approx(true, abs=8 + 4 * stderr), (name, plateau.number)


@pytest.fixture(scope="module")
def made_again(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made_again")
    script = CHECKOUT / "workflows" / "sample_data" / "make.py"
    subprocess.run([sys.executable, str(script), str(folder)], check=True)
    return folder


@pytest.mark.parametrize("name", ["several_beads", "laboratory_text"])
def test_the_simulated_ones_can_be_made_again(made_again, name):
    bundled, made = CHECKOUT / "sample_data" / name, made_again / name
    assert {p.name for p in made.iterdir()} == {p.name for p in bundled.iterdir()}
    for path in bundled.iterdir():
        if path.suffix in (".toml", ".json"):
            assert (made / path.name).read_text() == path.read_text()
        else:
            one, other = (_table(folder / path.name) for folder in (bundled, made))
            # another processor may round the last digit written the other way
            np.testing.assert_allclose(one, other, rtol=0, atol=0.0101)


def test_the_clean_ones_are_those_of_the_challenge(made_again):
    if not (SHARED / "challenge").is_dir():
        pytest.skip("../shared/challenge is not beside the checkout")
    for folder in (f for f in FOLDERS if f.name.startswith("clean_")):
        for path in folder.iterdir():
            assert (made_again / folder.name / path.name).read_bytes() == path.read_bytes()


def test_nothing_is_from_the_recordings_that_may_not_be_copied():
    if not (SHARED / "recordings").is_dir():
        pytest.skip("../shared/recordings is not beside the checkout")
    theirs = {_digest(p) for p in (SHARED / "recordings").rglob("*") if p.is_file()}
    ours = {_digest(p) for p in (CHECKOUT / "sample_data").rglob("*") if p.is_file()}
    assert len(theirs) > 100
    assert not theirs & ours


def test_the_demo_compares_with_the_truth(tmp_path, monkeypatch):
    whole = CHECKOUT / "sample_data" / "clean_short_tether"
    case = tmp_path / "data" / "short"
    case.mkdir(parents=True)
    lines = _unpacked(whole / "recording.csv.gz").decode().splitlines(keepends=True)
    (case / "recording.csv").write_text("".join(lines[:16_000]))
    (case / "setup.toml").write_text((whole / "setup.toml").read_text())
    plateaus = len(load(case / "recording.csv").plateaus)
    bead = _truth(whole)["b1"]
    forces = bead["force_pN"][:plateaus]
    # a truth that is wrong by a factor of two in the second plateau must show as such
    forces[1] *= 2
    (case / "truth.json").write_text(json.dumps({"b1": bead | {"force_pN": forces}}))
    monkeypatch.setattr("mtpipe.pipeline.demo.sample_data", lambda: tmp_path / "data")
    monkeypatch.setattr("mtpipe.pipeline.demo.SAMPLES", (Sample("short", cross_check=False),))
    text = run_demo(tmp_path / "out", workers=1)
    assert (tmp_path / "out" / "short" / "report" / "index.html").is_file()
    row = next(line for line in text.splitlines() if line.startswith("short"))
    assert "one tether" in row
    assert "unchecked" in row
    assert "concealed" not in text
    counted = int(text.split(" true forces lie")[0].split()[-3])
    possible = int(text.split(" true forces lie")[0].split()[-1])
    # x and y share each force
    assert possible == plateaus
    assert counted <= possible - 1


def test_the_demo_cross_checks_one_that_conceals_nothing_and_one_that_does():
    answers = {
        sample.folder: truth_of(CHECKOUT / "sample_data" / sample.folder)
        for sample in SAMPLES
        if sample.cross_check
    }
    concealed = sorted((truth["b1"]["concealed"] for truth in answers.values()), key=len)
    assert concealed[0] == []
    assert len(concealed[-1]) == 1
    for folder, truth in answers.items():
        assert len(truth["b1"]["force_pN"]) == len(
            _loaded(CHECKOUT / "sample_data" / folder).plateaus
        )
    assert not all(sample.cross_check for sample in SAMPLES)


def test_what_was_found_stands_beside_what_was_concealed():
    truth = {bead: {"force_pN": [1.0, 2.0], "concealed": [name]} for bead, name in
             (("b1", "exposure"), ("b2", "drift"))} | {"b3": {"concealed": []}}  # fmt: skip
    forces = [
        {"force_before_pN": 0.9, "force_pN": 1.01},
        {"force_before_pN": 1.8, "force_pN": 1.98},
    ]
    effect = {"effect": "exposure", "sentence": "the camera exposes for 2 ms."}
    beads = {
        "b1": {"verdict": "explained", "effects": [effect], "forces": forces},
        "b2": {"verdict": "unexplained", "effects": [], "forces": forces},
        "b3": {"verdict": "consistent", "effects": [], "forces": forces},
    }
    said = list(findings(SimpleNamespace(mismatch={"beads": beads}), truth))
    assert said == [
        "exposure was concealed; found: exposure. the camera exposes for 2 ms.",
        "with the setup as it is, forces are off by 10.0% (median); with what was found, by 1.0%.",
        "drift was concealed; found: no cause.",
        "nothing was concealed; recording and simulation agree.",
    ]


def _digest(path: Path) -> str:
    return hashlib.sha256(_unpacked(path)).hexdigest()


def _table(path: Path) -> np.ndarray:
    text = path.name.endswith((".txt", ".txt.gz"))
    table = pd.read_csv(
        path,
        sep="\t" if text else ",",
        header=None if text else 0,
        na_values=["-1.#IND000"],
    )
    return table.to_numpy(dtype=float)
