"""The main job and its commands: files, exit codes, messages, and what the run folder promises."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import mtpipe
from mtpipe.setup.setup import parse_setup
from tests.simulated import RATE_HZ, recording, setup_content

pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).parents[1]


def write(folder, raw, setup=None):
    """A canonical recording and its setup.toml in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    table = {"time_s": raw.time_s, "magnet_mm": raw.magnet_mm}
    for bead, xyz in raw.positions_nm.items():
        for axis in range(3):
            table[f"{bead}_{'xyz'[axis]}_nm"] = xyz[:, axis]
    pd.DataFrame(table).to_csv(folder / "recording.csv", index=False, float_format="%.4f")
    lines = ["schema = 1"]
    for name, content in (setup or setup_content()).items():
        if name != "schema":
            lines.append(f"[{name}]")
            lines += [f"{key} = {json.dumps(value)}" for key, value in content.items()]
    (folder / "setup.toml").write_text("\n".join(lines))
    return folder / "recording.csv"


def command(*arguments, **environment):
    return subprocess.run(
        [sys.executable, "-m", "mtpipe", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"COLUMNS": "200", "NO_COLOR": "1"} | environment,
    )


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    path = write(folder, recording((0.5, 2.0, 6.0), 2048))
    done = command("run", path, "--out", folder / "out", "--workers", "1")
    return folder / "out", done


def test_run_writes_every_file_and_says_where(finished):
    out, done = finished
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert str(out / "report" / "index.html") in done.stdout
    files = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    promised = {
        "forces.parquet", "forces.csv", "beads.parquet", "beads.csv", "run.json",
        "report/index.html", "details/spectra.parquet", "details/traces.parquet",
        "details/drift.parquet", "details/references.parquet", "details/posteriors.parquet",
        "details/force_extension.parquet", "crosscheck.parquet", "mismatch.json",
        "details/before_after.json", "details/unexplained.json",
    }  # fmt: skip
    assert promised <= files
    assert not [name for name in files if name.endswith(".tmp")]


def test_tables_have_the_columns_of_their_description(finished):
    out, _ = finished
    text = (CHECKOUT / "docs" / "run-folder.md").read_text(encoding="utf-8")
    forces = pd.read_parquet(out / "forces.parquet")
    section = text.split("## `forces.parquet`")[1].split("## ")[0]
    first_cells = re.findall(r"^\| (`[^|]*`) \|", section, flags=re.MULTILINE)
    named = re.findall(r"`(\w+)`", " ".join(first_cells))
    assert {"force_pN", "force_stderr_pN", "force_source", "status"} <= set(named)
    for name in named:
        assert name in forces.columns, name
    assert len(forces) == 3 * 3
    assert list(forces.columns) == list(pd.read_csv(out / "forces.csv").columns)


def test_forces_are_true_and_z_has_none(finished):
    out, _ = finished
    forces = pd.read_parquet(out / "forces.parquet").set_index(["axis", "plateau"])
    for axis in "xy":
        for plateau, true in enumerate((0.5, 2.0, 6.0)):
            row = forces.loc[(axis, plateau)]
            assert abs(row.force_pN - true) < 4 * row.force_stderr_pN
            assert row.force_low_pN < row.force_pN < row.force_high_pN
            assert row.posterior_converged
    assert forces.loc["z"].force_axis_pN.isna().all()
    quoted = forces.reset_index().groupby("plateau").force_pN
    assert (quoted.min() == quoted.max()).all()
    assert forces.loc["z"].stiffness_pN_per_nm.notna().any()


def test_the_diagnosis_is_written_as_the_contract_has_it(finished):
    out, _ = finished
    mismatch = json.loads((out / "mismatch.json").read_text(encoding="utf-8"))
    assert mismatch["schema"] == "mtpipe.mismatch/1"
    bead = mismatch["beads"]["b1"]
    assert set(bead) == {
        "verdict", "located", "effects", "terms", "force_bound_percent", "material", "forces",
    }  # fmt: skip
    quoted = pd.read_parquet(out / "forces.parquet").set_index("plateau").force_pN
    for row in bead["forces"]:
        assert (quoted[row["plateau"]] == row["force_pN"]).all()
    assert bead["verdict"] in ("consistent", "explained", "unexplained")
    left = json.loads((out / "details" / "unexplained.json").read_text(encoding="utf-8"))
    assert left["recording"] == mismatch["recording"]
    assert set(left["beads"]) == ({"b1"} if bead["verdict"] == "unexplained" else set())
    drawn = json.loads((out / "details" / "before_after.json").read_text(encoding="utf-8"))
    assert set(drawn["beads"]) == ({"b1"} if bead["effects"] else set())
    looks = pd.read_parquet(out / "crosscheck.parquet")
    assert set(looks.bead) == {"b1"}
    assert looks.p_value.between(0, 1).all()


def test_other_methods_are_rows_of_their_own(tmp_path):
    path = write(tmp_path, recording((0.5, 2.0), 2048))
    done = command(
        "run", path, "--out", tmp_path / "out", "--workers", "1",
        "--method", "equipartition", "--method", "allan", "--no-crosscheck",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    forces = pd.read_parquet(tmp_path / "out" / "forces.parquet")
    for method in ("equipartition", "allan"):
        rows = forces[forces.method == method]
        assert list(rows.axis) == ["x", "y", "x", "y"]
        true = rows.plateau.map({0: 0.5, 1: 2.0})
        assert ((rows.force_axis_pN - true).abs() < 4 * rows.force_axis_stderr_pN).all()
    own = forces[~forces.method.isin(["equipartition", "allan"])]
    assert not own.duplicated(["bead", "plateau", "axis"]).any()
    refused = command("run", path, "--out", tmp_path / "no", "--method", "wishful")
    assert refused.returncode == 2
    assert "wishful" in refused.stderr
    assert "hadamard" in refused.stderr


def test_run_json_has_inputs_seeds_and_times(finished):
    out, _ = finished
    content = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert content["version"] == mtpipe.__version__
    assert content["setup"]["camera"]["frame_rate_hz"]["value"] == RATE_HZ
    assert len(content["inputs"][0]["sha256"]) == 64
    assert content["seed"] == 0
    assert set(content["seconds"]) >= {"read", "drift", "calibrate", "force-extension"}


def test_report_is_written_again_from_the_files(finished):
    out, _ = finished
    before = (out / "report" / "index.html").read_text(encoding="utf-8")
    (out / "report" / "index.html").unlink()
    done = command("report", out)
    assert done.returncode == 0, done.stderr
    assert (out / "report" / "index.html").read_text(encoding="utf-8") == before


def test_a_cross_check_is_replaced_by_a_run_without_one_only_on_demand(tmp_path, finished):
    out, _ = finished
    path = write(tmp_path, recording((0.5, 2.0, 6.0), 2048))
    kept = tmp_path / "kept"
    shutil.copytree(out, kept)
    before = (kept / "run.json").read_bytes()
    done = command("run", path, "--out", kept, "--workers", "1", "--no-crosscheck")
    assert done.returncode == 1
    assert "cross-check of an earlier run" in done.stderr
    assert (kept / "run.json").read_bytes() == before
    mtpipe.run(path, kept, cross_check=False, overwrite=True)
    assert json.loads((kept / "mismatch.json").read_text(encoding="utf-8"))["beads"] == {}
    assert pd.read_parquet(kept / "crosscheck.parquet").empty


def test_every_file_of_a_run_carries_its_identity(finished):
    out, _ = finished
    identity = json.loads((out / "run.json").read_text(encoding="utf-8"))["run"]
    for path in out.rglob("*"):
        if path.suffix == ".parquet":
            assert pd.read_parquet(path).attrs["run"] == identity, path.name
        elif path.suffix == ".json" and "report" not in path.parts:
            assert json.loads(path.read_text(encoding="utf-8"))["run"] == identity, path.name
    assert not [path for path in out.iterdir() if path.name.startswith(".")]


def test_same_seed_same_forces(tmp_path, finished):
    out, _ = finished
    path = write(tmp_path, recording((0.5, 2.0, 6.0), 2048))
    mtpipe.run(path, tmp_path / "again", workers=1, cross_check=False)
    mtpipe.run(path, tmp_path / "other", workers=1, seed=7, cross_check=False)
    first, again, other = (
        pd.read_parquet(folder / "forces.parquet")
        for folder in (out, tmp_path / "again", tmp_path / "other")
    )
    # what is quoted may rest on the cross-check; what each trace says does not
    traces = [c for c in first if not re.match("force_(?!axis)", c)]
    pd.testing.assert_frame_equal(first[traces], again[traces])
    assert not again.force_pN.equals(other.force_pN)
    assert set(again.force_source) == {"spectra"}


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["run", "nowhere.csv", "--out", "o"], 2, "nowhere.csv"),
        (["run"], 2, "RECORDING"),
        (["frobnicate"], 2, "frobnicate"),
        (["report", "nowhere"], 2, "nowhere"),
        (["--help"], 0, "demo"),
        (["run", "--help"], 0, "--setup"),
        (["--version"], 0, mtpipe.__version__),
    ],
)
def test_exit_codes(arguments, code, words):
    done = command(*arguments)
    assert done.returncode == code
    assert words in done.stdout + done.stderr
    assert "Traceback" not in done.stderr


def test_unusable_data_is_one_line_and_exit_code_one(tmp_path):
    path = write(tmp_path, recording((1.0,), 1024))
    text = path.read_text().splitlines()
    text[100] = text[100].replace(text[100].split(",")[3], "12,5x", 1)
    path.write_text("\n".join(text))
    done = command("run", path, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "101" in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) <= 3
    assert not (tmp_path / "out" / "run.json").exists()


def test_missing_setup_is_named(tmp_path):
    path = write(tmp_path, recording((1.0,), 1024))
    (tmp_path / "setup.toml").unlink()
    done = command("run", path, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "setup.toml" in done.stderr


def test_no_reference_bead_is_said(tmp_path):
    raw = recording((2.0,), 2048)
    alone = {"b1": raw.positions_nm["b1"]}
    setup = setup_content(beads={"radius_nm": 500.0, "reference": []})
    path = write(tmp_path, type(raw)(**{**vars(raw), "positions_nm": alone}), setup)
    done = command("run", path, "--out", tmp_path / "out", "--no-crosscheck")
    assert done.returncode == 0
    assert "no reference bead" in done.stdout.lower()
    assert "[drift]" in done.stdout


def test_high_pass_is_an_explicit_choice_and_honoured_by_the_fit(tmp_path):
    setup = setup_content(
        beads={"radius_nm": 500.0}, drift={"method": "highpass", "cutoff_hz": 0.2}
    )
    raw = recording((4.0,), 8192, drift_nm_per_root_s=8.0)
    alone = {"b1": raw.positions_nm["b1"]}
    path = write(tmp_path, type(raw)(**{**vars(raw), "positions_nm": alone}), setup)
    result = mtpipe.run(path, tmp_path / "out", workers=1)
    spectra = pd.read_parquet(tmp_path / "out" / "details" / "spectra.parquet")
    assert spectra.frequency_hz.min() >= 0.2
    for one in result.calibration.beads[0].plateaus[0].axes[:2]:
        assert abs(one.force.value - 4.0) < 4 * one.force.stderr


def test_import_is_light():
    """`import mtpipe` pulls in none of the slow libraries; they come with first use."""
    code = "import sys, mtpipe; print(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    for heavy in ("numpy", "scipy", "pandas", "lmfit", "emcee", "plotly", "h5py", "pyarrow"):
        assert heavy not in loaded


def test_public_names_exist_and_do_what_they_say():
    for name in mtpipe.__all__:
        assert getattr(mtpipe, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        mtpipe.nonsense  # noqa: B018
    x = np.random.default_rng(0).normal(size=2048)
    fit = mtpipe.fit_trace(
        x, frame_rate_hz=120.0, exposure_s=1 / 120, temperature_K=298.15, tracking_noise_nm="fit"
    )
    assert fit.noise.unit == "nm"
    assert mtpipe.sample_posterior(fit).stiffness.unit == "pN/nm"


def test_force_extension_of_a_recording():
    raw = mtpipe.subtract_drift(recording((0.3, 0.8, 2.0, 5.0, 9.0), 2048))
    curve = mtpipe.force_extension(raw)["b1"]
    assert curve.recommended.contour_length_nm.value == pytest.approx(1200, rel=0.02)
    assert curve.recommended.persistence_length_nm.value == pytest.approx(50, rel=0.2)


def test_paths_may_be_text_and_an_unwritable_folder_is_told_before_the_work(tmp_path):
    path = write(tmp_path, recording((1.0,), 1024))
    result = mtpipe.run(str(path), str(tmp_path / "out"), cross_check=False)
    assert (tmp_path / "out" / "run.json").exists()
    assert result.seed == 0
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    done = command("run", path, "--out", blocked / "sub")
    assert done.returncode == 1
    assert "cannot be written" in done.stderr
    assert "defect" not in done.stderr


def test_a_reference_that_moves_is_said_on_the_terminal_and_in_the_verdict(tmp_path):
    raw = recording((1.0,), 4096)
    positions = {name: xyz.copy() for name, xyz in raw.positions_nm.items()}
    loose = np.cumsum(np.random.default_rng(2).normal(size=(4096, 3)), axis=0)
    positions["ref1"] += 40 * np.sin(loose / 6)
    path = write(tmp_path, type(raw)(**{**vars(raw), "positions_nm": positions}))
    done = command("run", path, "--out", tmp_path / "out", "--no-crosscheck")
    assert done.returncode == 0
    assert "ref1" in done.stdout
    beads = pd.read_csv(tmp_path / "out" / "beads.csv")
    assert beads.verdict[0] != "good"


@pytest.mark.parametrize("fault", [7.0, np.nan])
def test_a_reference_that_is_left_out_is_in_no_trace(tmp_path, fault):
    raw = recording((1.0,), 2048)
    content = setup_content()
    content["beads"] = content["beads"] | {"reference": ["ref1", "dead"]}
    positions = {**raw.positions_nm, "dead": np.full((2048, 3), fault)}
    changed = vars(raw) | {"positions_nm": positions, "setup": parse_setup(content)}
    path = write(tmp_path, type(raw)(**changed), content)
    result = mtpipe.run(path, tmp_path / "out", cross_check=False)
    assert any("left out" in one.message and one.bead == "dead" for one in result.notices)
    (verdict,) = result.verdicts
    assert verdict.verdict == "unchecked"
    assert verdict.reasons == ()


def test_a_bead_left_out_on_reading_keeps_its_row(tmp_path):
    raw = recording((1.0,), 2048)
    positions = {**raw.positions_nm, "dead": np.full((2048, 3), 7.0)}
    path = write(tmp_path, type(raw)(**{**vars(raw), "positions_nm": positions}))
    done = command("run", path, "--out", tmp_path / "out", "--no-crosscheck")
    assert done.returncode == 0, done.stderr
    beads = pd.read_csv(tmp_path / "out" / "beads.csv").set_index("bead")
    assert beads.verdict["dead"] == "refused"
    assert "never moves" in beads.reasons["dead"]
    assert beads.verdict["b1"] == "unchecked"
    assert "dead" in done.stdout
    assert "b1: unchecked. Not checked against a simulation." in done.stdout
