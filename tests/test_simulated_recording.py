"""Simulated recordings: as described, repeatable, written, read, and calibrated as any other."""

import json
import math
import os
import subprocess
import sys
import tomllib

import numpy as np
import pytest

import mtpipe
from mtpipe.cli.entry import main
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.experiment.state import bead_state
from mtpipe.ground.errors import MtpipeError, SetupError
from mtpipe.setup.setup import parse_setup
from mtpipe.simulation.simulate import free_names, simulate, timetable
from mtpipe.simulation.written import canonical_csv, simulate_to_folder
from tests.simulated import setup_content

pytestmark = pytest.mark.slow

SETUP = """# a comment that stays
schema = 1
[camera]
frame_rate_hz = 120.0
exposure_s = 0.0083
[beads]
radius_nm = 500.0
reference = ["ref1"]
[tether]
contour_length_nm = 1200.0
persistence_length_nm = 50.0
[buffer]
temperature_K = 298.15
viscosity_mPa_s = 0.9
[field]
direction = "x"
[model]
effects = ["wall_drag", "tracking_noise", "rotation_coupling"]
tracking_noise = { noise_nm = 1.5 }
"""


def content(**changes):
    return setup_content(
        model={"effects": ["wall_drag", "tracking_noise", "rotation_coupling"]}, **changes
    )


def test_the_same_seed_gives_the_same_recording_and_another_does_not():
    setup = parse_setup(content())
    one, same, other = (simulate(setup, [1, 4], 600, seed) for seed in (1, 1, 2))
    for bead in ("b1", "ref1"):
        np.testing.assert_array_equal(one.positions_nm[bead], same.positions_nm[bead])
        assert np.all(one.positions_nm[bead] != other.positions_nm[bead])


def test_more_beads_leave_those_that_are_there_as_they_were():
    setup = parse_setup(content(beads={"radius_nm": 500.0, "reference": ["b2", "r"]}))
    few, many = (simulate(setup, [2], 600, 3, beads=count) for count in (1, 3))
    assert list(few.positions_nm) == ["b1", "b2", "r"]
    assert many.tethered == ("b1", "b3", "b4")
    for bead in few.positions_nm:
        np.testing.assert_array_equal(few.positions_nm[bead], many.positions_nm[bead])
    assert free_names(2, ["b1", "b3"]) == ["b2", "b4"]


def test_noise_lost_frames_and_the_stage_are_as_described():
    setup = parse_setup(content(beads={"radius_nm": 500.0, "reference": ["r1", "r2"]}))
    recording = simulate(setup, [2], 20_000, 5, noise_nm=(1, 2, 3), lost_share=0.1)
    share = np.mean(np.isnan(recording.positions_nm["b1"]).all(axis=1))
    assert share == pytest.approx(0.1, abs=5 * math.sqrt(0.09 / 20_000))
    # what two references share is the stage; the rest is the noise of both
    apart = recording.positions_nm["r1"] - recording.positions_nm["r2"]
    np.testing.assert_allclose(
        np.nanstd(apart, axis=0), np.sqrt(2) * np.array([1, 2, 3]), rtol=0.03
    )
    quiet = simulate(setup, [2], 20_000, 5, noise_nm=(0, 0, 0))
    stage = quiet.positions_nm["r1"] - quiet.positions_nm["r1"][0]
    np.testing.assert_allclose(stage, quiet.positions_nm["r2"] - quiet.positions_nm["r2"][0])
    steps = np.diff(stage, axis=0).std(axis=0)
    np.testing.assert_allclose(steps, np.array([1, 1, 1.5]) / math.sqrt(120), rtol=0.03)


def test_magnets_rest_and_move():
    experiment, _ = experiment_of(parse_setup(content()), [1.0, 4.0, 4.0], 700)
    table = timetable(experiment)
    assert len(table.magnet_mm) == table.edges[-1] == 3 * 700 + 2 * 120
    assert [f for f, rest in zip(table.force_pN, table.rest, strict=True) if rest >= 0] == [1, 4, 4]
    moving = [f for f, rest in zip(table.force_pN, table.rest, strict=True) if rest < 0]
    assert moving == sorted(moving)
    assert 1 < moving[0] < moving[-2] < 4
    # in the recording only the rests are plateaus, and the bead goes up as they say
    recording = simulate(parse_setup(content()), [1.0, 4.0, 4.0], 700, 1)
    rests = [(p.start, p.stop, p.magnet_mm) for p in recording.plateaus]
    assert rests == [(i * 820, i * 820 + 700, experiment.rests[i].magnet_mm) for i in range(3)]
    heights = [
        np.median(recording.positions_nm["b1"][p.start : p.stop, 2]) for p in recording.plateaus
    ]
    assert heights == pytest.approx(
        [bead_state(experiment, force).extension_nm for force in (1, 4, 4)], abs=12
    )


def test_a_force_at_which_a_spring_would_pass_the_surface_is_told():
    setup = parse_setup(
        content(tether={"contour_length_nm": 7000.0, "persistence_length_nm": 50.0})
    )
    low, high = (simulate(setup, [force], 700, 1) for force in (0.005, 1.0))
    assert low.positions_nm["b1"][:, 2].min() < 0
    (said,) = [one.message for one in low.notices if one.code == "through_surface"]
    assert "0.005 pN" in said
    assert "through_surface" not in {one.code for one in high.notices}


def test_step_by_step_the_recording_is_the_same_experiment():
    """Same stage, references, noise and timetable; only the tethered bead moves otherwise."""
    setup = parse_setup(content())
    one, other = (simulate(setup, [1, 4], 700, 1, engine=e) for e in ("linear", "brownian"))
    np.testing.assert_array_equal(one.positions_nm["ref1"], other.positions_nm["ref1"])
    np.testing.assert_array_equal(one.magnet_mm, other.magnet_mm)
    assert np.all(one.positions_nm["b1"] != other.positions_nm["b1"])
    for plateau in one.plateaus:
        means = [r.trace_nm("b1", plateau).mean(axis=0)[2] for r in (one, other)]
        assert means[0] == pytest.approx(means[1], abs=15)
    plain = parse_setup(setup_content())
    notices = simulate(plain, [1], 700, 1, engine="brownian").notices
    assert "turns_anyway" in {notice.code for notice in notices}


@pytest.mark.parametrize(
    ("changes", "forces"),
    [
        ({}, (0.5, 2.0, 8.0)),
        (
            {
                "camera": {"frame_rate_hz": 200.0, "exposure_s": 0.002},
                "beads": {"radius_nm": 1400.0, "reference": ["ref1"]},
                "tether": {"contour_length_nm": 2700.0, "persistence_length_nm": 50.0},
                "field": {"direction": "y"},
            },
            (1.0, 12.0),
        ),
    ],
    ids=["short tether", "long tether"],
)
def test_the_forces_come_back(changes, forces):
    simulated = simulate(parse_setup(content(**changes)), forces, 8192, 11)
    calibration = mtpipe.calibrate(mtpipe.subtract_drift(simulated))
    (bead,) = calibration.beads
    for plateau, force in zip(bead.plateaus, forces, strict=True):
        for trace in plateau.axes[:2]:
            assert abs(trace.force.value - force) < 4 * trace.force.stderr
            assert trace.force.stderr < 0.1 * force


# --- files and the command


@pytest.fixture
def setup_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(SETUP)
    return path


def test_the_files_are_the_recording_and_its_truth(setup_file, tmp_path):
    out = tmp_path / "out"
    recording = simulate_to_folder(setup_file, out, [1, 4], 700, 3, beads=2, lost_share=0.05)
    assert sorted(path.name for path in out.iterdir()) == [
        "recording.csv", "setup.toml", "truth.json",
    ]  # fmt: skip
    assert (out / "setup.toml").read_text() == SETUP
    read = mtpipe.load(out / "recording.csv")
    np.testing.assert_allclose(read.time_s, recording.time_s, atol=0.51e-6)
    np.testing.assert_array_equal(read.frame, recording.frame)
    assert read.tethered == ("b1", "b2")
    for bead, positions in recording.positions_nm.items():
        np.testing.assert_allclose(read.positions_nm[bead], positions, atol=0.51e-3)
        assert np.isnan(positions).any()
    assert [dataclass_of(p) for p in read.plateaus] == [dataclass_of(p) for p in recording.plateaus]

    truth = json.loads((out / "truth.json").read_text())
    assert (truth["schema"], truth["seed"], truth["engine"]) == ("mtpipe.truth/1", 3, "linear")
    assert truth["mtpipe"] == mtpipe.__version__
    assert {one["code"] for one in truth["assumed"]} == {"stage_assumed", "magnet_assumed"}
    bead = {
        "radius_nm": 500.0,
        "turns": True,
        "offset_nm": 0.0,
        "z_per_turn_nm": 0.0,
        "aside_per_turn_nm": 0.0,
    }
    assert truth["experiment"]["bead"] == bead
    experiment, _ = experiment_of(read.setup, [1, 4], 700)
    for bead in ("b1", "b2"):
        plateaus = truth["beads"][bead]["plateaus"]
        assert [p["magnet_mm"] for p in plateaus] == [p.magnet_mm for p in read.plateaus]
        for told, force in zip(plateaus, (1, 4), strict=True):
            state = bead_state(experiment, force)
            end = told["extension_nm"] + experiment.fluid.thermal_energy_pN_nm / force / 2
            assert (told["force_pN"], told["extension_nm"]) == (force, state.extension_nm)
            # along the field F over the mean height of the tether's end, across it plus the radius
            assert told["stiffness_pN_per_nm"]["x"] == pytest.approx(force / end)
            assert told["stiffness_pN_per_nm"]["y"] == pytest.approx(force / (end + 500))
            frictions = np.diag(state.motion.friction)
            for axis, friction in zip("xyz", frictions[:3], strict=True):
                assert told["friction_pN_s_per_nm"][axis] == pytest.approx(friction)
                corner = told["stiffness_pN_per_nm"][axis] / friction / 2 / np.pi
                assert told["corner_frequency_hz"][axis] == pytest.approx(corner)
            assert told["noise_nm"] == {"x": 1.5, "y": 1.5, "z": 1.5}


def dataclass_of(plateau):
    return plateau.number, plateau.start, plateau.stop, plateau.magnet_mm


def test_a_file_has_no_more_digits_than_it_says(setup_file, tmp_path):
    recording = simulate_to_folder(setup_file, tmp_path, [2], 700, 1, lost_share=0.2)
    header, *rows = canonical_csv(recording).decode().splitlines()
    assert header == ("time_s,magnet_mm,b1_x_nm,b1_y_nm,b1_z_nm,ref1_x_nm,ref1_y_nm,ref1_z_nm")
    assert len(rows) == 700
    cells = [row.split(",") for row in rows]
    assert {len(row) for row in cells} == {8}
    digits = [
        max(len(cell.partition(".")[2]) for cell in column) for column in zip(*cells, strict=True)
    ]
    assert digits == [6, 3, 3, 3, 3, 3, 3, 3]
    lost = [row for row in cells if row[2] == ""]
    assert lost
    assert all(row[3] == row[4] == "" for row in lost)


def test_a_laboratory_s_own_columns_are_no_part_of_a_simulated_setup(setup_file, tmp_path):
    own = (
        SETUP
        + """
[source]
preset = "dekker-text"

[source.lost]
all_zero_rows = true

[plateaus]
minimum_s = 4.0
"""
    )
    plain = SETUP + "\n[plateaus]\nminimum_s = 4.0\n"
    setup_file.write_text(own)
    simulate_to_folder(setup_file, tmp_path / "out", [2], 600, 1)
    written = (tmp_path / "out" / "setup.toml").read_text()
    assert "# a comment that stays" in written
    assert tomllib.loads(written) == tomllib.loads(plain)
    assert len(mtpipe.load(tmp_path / "out" / "recording.csv").plateaus) == 1
    setup_file.write_text('source.preset = "dekker-text"\n' + SETUP)
    with pytest.raises(SetupError, match=r"\[source\] cannot be taken out"):
        simulate_to_folder(setup_file, tmp_path / "other", [2], 600, 1)


def test_nothing_is_written_where_it_cannot_be_whole(setup_file, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(MtpipeError, match="cannot be written"):
        simulate_to_folder(setup_file, tmp_path / "file" / "out", [2], 600, 1)
    with pytest.raises(MtpipeError, match="does not hold the bead"):
        simulate_to_folder(setup_file, tmp_path / "out", [0.001], 600, 1)
    assert not list((tmp_path / "out").iterdir())


def command(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "mtpipe", "simulate", *map(str, arguments)],
        capture_output=True, text=True, env=os.environ | {"COLUMNS": "200"},
    )  # fmt: skip


def test_the_command_writes_what_run_reads(setup_file, tmp_path):
    done = command(
        setup_file, "--force", "1,5", "--frames", 4096, "--seed", 1, "--out", tmp_path / "a"
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == f"Recording: {tmp_path / 'a' / 'recording.csv'}"
    for seed, out in ((1, "b"), (2, "c")):
        simulate_to_folder(setup_file, tmp_path / out, [1, 5], 4096, seed)
    same, again, other = ((tmp_path / out / "recording.csv").read_bytes() for out in "abc")
    assert same == again
    assert same != other
    result = mtpipe.run(tmp_path / "a" / "recording.csv", tmp_path / "run")
    (bead,) = result.calibration.beads
    for plateau, force in zip(bead.plateaus, (1, 5), strict=True):
        trace = plateau.axes[0]
        assert abs(trace.force.value - force) < 4 * trace.force.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--force", "1,a"), 2, "'1,a': numbers are needed, with commas between"),
        (("--force", "1,"), 2, "numbers are needed"),
        (("--force", "nan"), 2, "numbers are needed"),
        (("--force", "1,-2"), 2, "forces above 0 pN are needed"),
        (("--force", "1", "--frames", "-5"), 2, "--frames"),
        (("--force", "1", "--noise", "1,2"), 2, "one number of at least 0 is needed, or three"),
        (("--force", "1", "--lost-share", "1"), 2, "a share below 1 is needed"),
        (("--force", "1", "--engine", "warp"), 2, "'warp' is none of linear, brownian"),
        ((), 2, "--force"),
        (("--force", "0.001"), 1, "mtpipe: at 0.001 pN the tether does not hold the bead"),
    ],
)
def test_a_wrong_call_is_told_in_a_sentence(
    setup_file, tmp_path, monkeypatch, capsys, arguments, code, said
):
    call = ["mtpipe", "simulate", str(setup_file), "--out", str(tmp_path / "out"), *arguments]
    monkeypatch.setattr(sys, "argv", call)
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == code
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error
