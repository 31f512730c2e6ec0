"""Presets of `[source]`: each reads a small made-up recording of its instrument exactly."""

import h5py
import numpy as np
import pytest

import mtpipe
from mtpipe.ground.errors import RecordingError, SetupError
from mtpipe.setup.measured import Measured
from mtpipe.setup.presets import PRESETS
from tests.ingest_recordings import (
    RATE,
    N,
    axes_of,
    codes,
    height,
    magscope_batches,
    magscope_positions,
    motion,
    preset,
    sentences,
    setup_of,
    survives_a_round_trip,
    table,
    write,
    write_magscope,
)

FRAME = np.arange(N) + 1.0
CALISTO = {"preset": "calisto-text", "units": {"position": "um"}, "time": {"unit": "ms"}}
SHON = {"preset": "shon-text"}
DEKKER = {"preset": "dekker-text"}


def stepped(recording):
    """The magnet is told right at every frame, and its two rests are the plateaus."""
    known = np.isfinite(recording.magnet_mm)
    np.testing.assert_allclose(
        recording.magnet_mm[known], height(recording.time_s[known]), atol=1e-9
    )
    assert [p.magnet_mm for p in recording.plateaus] == [3.0, 2.0]


# --- calisto-text ---------------------------------------------------------------------------


def write_calisto(folder, positions, *, turns=None, lost=()):
    """Positions in um, time in ms; the motors' own clock runs at 20 Hz."""
    kept = np.setdiff1d(np.arange(N), lost)
    columns = [FRAME, FRAME * 1000 / RATE, *(c / 1000 for c in axes_of(positions))]
    write(folder / "beads.txt", table([c[kept] for c in columns], "\t"))
    clock = np.arange(0, 4.2, 0.05)
    motor = [np.arange(len(clock)), 1000 * clock, height(clock)]
    motor += [] if turns is None else [np.full(len(clock), turns)]
    write(folder / "motors.txt", table(motor, "   "))
    return folder / "beads.txt"


def test_calisto_text(tmp_path):
    positions = motion(N, beads=("b0", "b1", "ref"))
    positions["b1"][17] = np.nan
    path = write_calisto(tmp_path, positions, lost=range(200, 206))
    (tmp_path / "notes.txt").write_text("measured on Monday, all was well\n")
    setup = preset(CALISTO, reference=("b2",))
    recording = mtpipe.load(path, setup)
    kept = np.setdiff1d(np.arange(N), range(200, 206))
    assert list(recording.positions_nm) == ["b0", "b1", "b2"]
    assert recording.references == ("b2",)
    for read, xyz in zip(recording.positions_nm.values(), positions.values(), strict=True):
        np.testing.assert_allclose(read, xyz[kept], rtol=1e-14)
    np.testing.assert_allclose(recording.time_s, FRAME[kept] / RATE)
    assert recording.frame.tolist() == FRAME[kept].tolist()
    stepped(recording)
    survives_a_round_trip(recording)
    assert {"guessed_layout", "camera_gaps", "lost_frames"} <= codes(recording)
    assert "b0, b1, b2" in sentences(recording)
    assert "motors.txt is taken for the motor file" in sentences(recording)
    assert "time stamps are taken in ms" in sentences(recording)


def test_calisto_text_in_a_folder_that_holds_the_motor_file_as_well(tmp_path):
    write_calisto(tmp_path, motion(N))
    recording = mtpipe.load(tmp_path, preset({**CALISTO, "beads": {"names": ["left", "right"]}}))
    assert list(recording.positions_nm) == ["left", "right"]
    assert [f.name for f in recording.files] == ["beads.txt"]
    stepped(recording)


def test_the_users_own_keys_override_a_preset(tmp_path):
    positions = motion(N)
    path = write_calisto(tmp_path, positions, turns=5.0)
    (tmp_path / "motors.txt").rename(tmp_path / "stage.dat")
    source = {
        **CALISTO,
        "beads": {"name": "mine", "x": 4, "y": 3, "z": 5},
        "magnet": {"file": "stage.dat", "scale": -1.0, "offset_mm": 5.0},
        "scale": {"z": -1.0},
        "frame": False,
    }
    recording = mtpipe.load(path, preset(source))
    expected = positions["b1"][:, [1, 0, 2]] * [1, 1, -1]
    np.testing.assert_allclose(recording.positions_nm["mine"], expected, rtol=1e-14)
    assert recording.frame[0] == 0
    assert [p.magnet_mm for p in recording.plateaus] == [2.0, 3.0]
    assert recording.setup.source.rotation.column == 4
    survives_a_round_trip(recording)
    recording = mtpipe.load(path, preset({**source, "magnet": False}))
    assert recording.magnet_mm is None
    assert recording.setup.source.rotation is None


def test_rotation_in_a_motor_file_of_calisto(tmp_path):
    path = write_calisto(tmp_path, motion(N), turns=5.0)
    lines = (tmp_path / "motors.txt").read_text().split("\n")
    lines[10:20] = [line.replace(" 5.0", f" {k}.0") for k, line in enumerate(lines[10:20])]
    (tmp_path / "motors.txt").write_text("\n".join(lines))
    recording = mtpipe.load(path, preset(CALISTO, minimum_s=0.2))
    assert "rotation" in codes(recording)
    recording = mtpipe.load(path, preset({**CALISTO, "rotation": False}, minimum_s=0.2))
    assert "rotation" not in codes(recording)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda f: (f / "motors.txt").unlink(), "there is no motor file"),
        (lambda f: write(f / "second.txt", ["0 0 3", "1 1 3"]), "2 files look like motor files"),
        (lambda f: write(f / "beads.txt", ["0 0 1 2 3 4", "1 1 1 2 3 4"]), "has 6 columns, where"),
        (lambda f: write(f / "beads.txt", ["0 0 1"]), "has 3 columns and is a motor file"),
        (lambda f: (f / "beads.txt").write_bytes(b"\x89HDF\r\n\x1a\n"), "is hdf5, where text"),
    ],
)
def test_faults_of_calisto_text(tmp_path, change, what):
    path = write_calisto(tmp_path, motion(N))
    change(tmp_path)
    with pytest.raises(RecordingError, match=what):
        mtpipe.load(path, preset(CALISTO))


def test_an_index_that_counts_no_frames_is_taken_away_by_false(tmp_path):
    path = write_calisto(tmp_path, motion(N))
    lines = [line.split("\t") for line in path.read_text().splitlines()]
    write(path, ["\t".join(["0", *cells[1:]]) for cells in lines])
    with pytest.raises(RecordingError, match="frame number 0 occurs twice") as caught:
        mtpipe.load(path, preset(CALISTO))
    assert "frame = false" in caught.value.mend
    assert mtpipe.load(path, preset({**CALISTO, "frame": False})).frame[-1] == N - 1


# --- calisto-hdf5 ---------------------------------------------------------------------------


def write_calisto_hdf5(path, positions, turns=None):
    clock = np.arange(-1.0, 5.0, 0.05)
    with h5py.File(path, "w") as file:
        file["timestamp"] = np.arange(N) / RATE
        file["stage/t_s"], file["stage/mag_pos_mm"] = clock, height(clock)
        if turns is not None:
            file["stage/mag_rot_turn"] = turns(clock)
        for group, xyz in positions.items():
            for k, axis in enumerate("xyz"):
                file[f"{group}/{axis}_nm"] = xyz[:, k]
    return path


def test_calisto_hdf5(tmp_path):
    positions = motion(N, beads=("M0", "R1", "M2", "3"))
    positions["R1"] /= 10
    positions["M2"][5, 2] = np.nan
    write_calisto_hdf5(tmp_path / "run.h5", positions, turns=lambda t: np.clip(10 * t - 30, 0, 5))
    recording = mtpipe.load(tmp_path, preset("calisto-hdf5", minimum_s=0.4))
    for group, xyz in positions.items():
        bead = "b3" if group == "3" else group
        np.testing.assert_array_equal(recording.positions_nm[bead], xyz)
    assert recording.references == ("R1",)
    assert recording.setup.beads.reference == ("R1",)
    np.testing.assert_array_equal(recording.time_s, np.arange(N) / RATE)
    np.testing.assert_allclose(recording.magnet_mm, height(recording.time_s), atol=1e-9)
    assert [p.magnet_mm for p in recording.plateaus] == [3.0, 2.0]
    assert recording.plateaus[1].stop < 300
    assert {"rotation", "guessed_layout", "preset", "lost_frames"} <= codes(recording)
    survives_a_round_trip(recording)
    recording = mtpipe.load(tmp_path, preset({"preset": "calisto-hdf5", "leave_out": ["R1"]}))
    assert recording.references == ()


@pytest.mark.parametrize(
    ("gone", "what"),
    [
        ("timestamp", "no column 'timestamp'"),
        ("stage/t_s", "no column 'stage/t_s'"),
        ("stage/mag_pos_mm", "no column 'stage/mag_pos_mm'"),
        ("M0/z_nm", r"no column '[^']*M0/z_nm' \(M0 z\).* There are: .*M0/x_nm"),
        ("M0", "no tethered bead|every bead is a reference"),
    ],
)
def test_datasets_that_calisto_hdf5_lacks(tmp_path, gone, what):
    positions = motion(N, beads=("M0", "R1"))
    path = write_calisto_hdf5(tmp_path / "run.h5", positions)
    with h5py.File(path, "a") as file:
        del file[gone]
    with pytest.raises(RecordingError, match=what):
        mtpipe.load(path, preset("calisto-hdf5"))


def test_text_is_no_calisto_hdf5(tmp_path):
    path = write(tmp_path / "run.h5", ["1 2 3"])
    with pytest.raises(RecordingError, match="is text, not hdf5") as caught:
        mtpipe.load(path, preset("calisto-hdf5"))
    assert "preset" in caught.value.mend


# --- dekker-text ----------------------------------------------------------------------------


@pytest.mark.parametrize("axes", ["yz", "xyz"])
def test_dekker_text(tmp_path, axes):
    xyz = motion(N, beads=("b1",))["b1"]
    columns = [xyz[:, "xyz".index(a)] / 1000 for a in axes]
    columns[-1][30] = np.nan
    write(tmp_path / "bead.txt", table(columns))
    time = np.arange(N) / RATE
    write(tmp_path / "bead_motors.txt", table([height(time)]))
    recording = mtpipe.load(tmp_path, preset(DEKKER))
    expected = xyz.copy()
    expected[30, 2] = np.nan
    if axes == "yz":
        expected[:, 0] = np.nan
    np.testing.assert_allclose(recording.positions_nm["b1"], expected, rtol=1e-14)
    np.testing.assert_allclose(recording.time_s, time)
    np.testing.assert_array_equal(recording.magnet_mm, height(time))
    assert [p.magnet_mm for p in recording.plateaus] == [3.0, 2.0]
    assert f"taken for {', '.join(axes)} of one bead" in sentences(recording)
    survives_a_round_trip(recording)
    some = mtpipe.load(
        tmp_path, preset({**DEKKER, "keep_rows": [[11, 390]], "skip_rows": [[50, 60]]})
    )
    np.testing.assert_array_equal(some.magnet_mm, height(time)[[*range(10, 49), *range(60, 390)]])


@pytest.mark.parametrize(
    ("change", "what", "mend"),
    [
        (lambda f: (f / "bead_motors.txt").unlink(), "there is no such magnet log", "= false"),
        (lambda f: write(f / "bead_motors.txt", ["3"] * 9), "has 9 rows where the", ""),
        (lambda f: write(f / "bead_motors.txt", ["1 2 3"] * N), "has 3 columns, where", "column"),
        (lambda f: write(f / "bead.txt", ["1 2 3 4"] * N), "has 4 columns, where y, z", "beads"),
    ],
)  # fmt: skip
def test_faults_of_dekker_text(tmp_path, change, what, mend):
    path = write(tmp_path / "bead.txt", table(axes_of(motion(N, beads=("b1",)))))
    write(tmp_path / "bead_motors.txt", table([np.full(N, 3.0)]))
    change(tmp_path)
    with pytest.raises(RecordingError, match=what) as caught:
        mtpipe.load(path, preset(DEKKER))
    assert mend in (caught.value.mend or "")


def test_dekker_text_with_columns_of_its_own(tmp_path):
    xyz = motion(N, beads=("b1",))["b1"]
    path = write(tmp_path / "bead.txt", table([FRAME, xyz[:, 1], xyz[:, 0], xyz[:, 2]]))
    write(tmp_path / "bead_motors.txt", table([FRAME, FRAME, np.full(N, 3.0)]))
    own = {"beads": {"name": "b1", "x": 3, "y": 2, "z": 4}, "units": {"position": "nm"},
           "magnet": {"column": 3}}  # fmt: skip
    recording = mtpipe.load(path, preset({**DEKKER, **own}))
    np.testing.assert_array_equal(recording.positions_nm["b1"], xyz)
    assert np.all(recording.magnet_mm == 3.0)
    recording = mtpipe.load(path, preset({**DEKKER, **own, "magnet": False}))
    assert recording.magnet_mm is None


# --- shon-text ------------------------------------------------------------------------------

FPS = 1200.0


def shon_setup(source=SHON, rate="unknown", pixel=80.0, **options):
    setup = preset(source, rate=rate, minimum_s=0.1, **options)
    camera = setup.camera.model_copy(update={"pixel_size_nm": Measured(value=pixel)})
    return setup.model_copy(update={"camera": camera})


def write_shon(folder, positions, fps=("1200", "340\t-120", "1\t-1")):
    """Pixels of 80 nm; the motor log is at 20 Hz on the frames' clock."""
    pixels = [c / (80 if k % 3 < 2 else 0.878) for k, c in enumerate(axes_of(positions))]
    write(folder / "r008-001.xls", table([FRAME, *pixels], "\t"))
    clock = np.arange(0, 0.45, 0.05)
    turns, piezo = np.full(len(clock), 0.25), np.full(len(clock), 12.0)
    write(folder / "s008-001.xls", table([clock, shon_height(clock), turns, piezo], "\t"))
    write(folder / "c008.fps", list(fps))
    return folder / "r008-001.xls"


def shon_height(time_s):
    return np.interp(time_s, [0.15, 0.2], [15.0, 18.0])


def test_shon_text(tmp_path):
    positions = motion(N, beads=("ref1", "b1", "b2"))
    positions["b2"][40] = np.nan
    path = write_shon(tmp_path, positions)
    for where in (path, tmp_path):
        recording = mtpipe.load(where, shon_setup())
        assert list(recording.positions_nm) == ["ref1", "b1", "b2"]
        assert recording.references == ("ref1",)
        for bead, xyz in positions.items():
            np.testing.assert_allclose(recording.positions_nm[bead], xyz, rtol=1e-14)
        assert recording.setup.camera.frame_rate_hz.value == FPS
        np.testing.assert_allclose(recording.time_s, FRAME / FPS)
        np.testing.assert_allclose(recording.magnet_mm, shon_height(FRAME / FPS), atol=1e-12)
        assert [p.magnet_mm for p in recording.plateaus] == [15.0, 18.0]
    offsets = {n.bead: n.message for n in recording.notices if n.code == "tether_offset"}
    assert "340 nm" in offsets["b1"]
    assert "to the left" in offsets["b1"]
    assert "-120 nm" in offsets["b2"]
    assert "to the right" in offsets["b2"]
    assert "rotation" not in codes(recording)
    survives_a_round_trip(recording)


def test_shon_text_with_names_and_a_scale_of_ones_own(tmp_path):
    positions = motion(N, beads=("ref1", "b1", "b2"))
    path = write_shon(tmp_path, positions)
    source = {**SHON, "beads": {"names": ["glass", "left", "right"]}, "scale": {"z": 0.439}}
    recording = mtpipe.load(path, shon_setup(source, rate=1203.0))
    assert recording.references == ("glass",)
    assert recording.setup.camera.frame_rate_hz.value == 1203.0
    np.testing.assert_allclose(
        recording.positions_nm["right"], positions["b2"] * [1, 1, 0.5], rtol=1e-14
    )
    assert {n.bead for n in recording.notices if n.code == "tether_offset"} == {"left", "right"}
    (tmp_path / "c008.fps").unlink()
    (tmp_path / "s008-001.xls").unlink()
    recording = mtpipe.load(path, shon_setup({**SHON, "magnet": False}, rate=1200.0))
    assert recording.magnet_mm is None
    assert recording.references == ("ref1",)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda f: (f / "s008-001.xls").unlink(), "no motor log s008-001.xls beside it"),
        (lambda f: (f / "c008.fps").unlink(), "there is no c008.fps beside it"),
        (lambda f: write(f / "c008.fps", ["fast"]), "c008.fps: cannot be read"),
        (lambda f: write(f / "c008.fps", [""]), "no frame rate in its first line"),
        (lambda f: write(f / "r008-001.xls", ["1 2 3"]), "has 3 columns, where frame number"),
        (lambda f: write(f / "r008-002.xls", ["1 2 3 4"]), "2 recordings are there"),
        (lambda f: (f / "r008-001.xls").write_bytes(b"\xd0\xcf\x11\xe0"), "is an Excel workbook"),
        (lambda f: (f / "r008-001.xls").unlink(), "no data files of preset shon-text"),
    ],
)
def test_faults_of_shon_text(tmp_path, change, what):
    write_shon(tmp_path, motion(N, beads=("ref1", "b1", "b2")))
    change(tmp_path)
    with pytest.raises(RecordingError, match=what):
        mtpipe.load(tmp_path, shon_setup())


def test_a_frame_rate_that_contradicts_the_fps_file_and_a_file_of_another_name(tmp_path):
    path = write_shon(tmp_path, motion(N, beads=("ref1", "b1", "b2")))
    with pytest.raises(RecordingError, match="says 1200 frames per second, the setup 400"):
        mtpipe.load(path, shon_setup(rate=400.0))
    other = path.rename(tmp_path / "tether.xls")
    with pytest.raises(RecordingError, match=r"is not called r###-###\.xls"):
        mtpipe.load(other, shon_setup())
    recording = mtpipe.load(
        other, shon_setup({**SHON, "magnet": {"file": "s008-001.xls"}}, rate=FPS)
    )
    assert [p.magnet_mm for p in recording.plateaus] == [15.0, 18.0]


def test_shon_offsets_that_do_not_fit_the_beads_are_told(tmp_path):
    path = write_shon(tmp_path, motion(N, beads=("ref1", "b1", "b2")), fps=("1200", "340", "1"))
    recording = mtpipe.load(path, shon_setup())
    assert "1 tether offsets for 2 magnetic beads" in sentences(recording)


# --- all of them ----------------------------------------------------------------------------


def test_columns_is_the_table_without_a_preset(tmp_path):
    positions = motion(N)
    path = write(tmp_path / "t.txt", table(axes_of(positions)))
    plain = {"beads": {"first_column": 1, "names": ["b1", "ref1"]}, "units": {"position": "nm"}}
    named, unnamed = (
        mtpipe.load(path, setup_of(s)) for s in ({**plain, "preset": "columns"}, plain)
    )
    assert named.notices == unnamed.notices
    for bead, xyz in positions.items():
        np.testing.assert_array_equal(named.positions_nm[bead], xyz)
        np.testing.assert_array_equal(unnamed.positions_nm[bead], xyz)


# How a recording of each preset is written into a folder; `tests/test_init.py` has them found.
WRITERS = {
    "calisto-text": lambda folder: write_calisto(folder, motion(N)),
    "calisto-hdf5": lambda folder: write_calisto_hdf5(
        folder / "r.h5", motion(N, beads=("M0", "M1", "R2"))
    ),
    "magscope-hdf5": lambda folder: write_magscope(
        folder / "t.h5", magscope_batches(magscope_positions())
    ),
    "dekker-text": lambda folder: (
        write(folder / "a_motors.txt", ["3"] * N),
        write(folder / "a.txt", table(c / 1e3 for c in axes_of(motion(N, beads=("b1",))))),
    ),
    "shon-text": lambda folder: write_shon(folder, motion(N, beads=("ref1", "b1", "b2"))),
}
# Their files have no clock, so that the setup states the frame rate.
WITHOUT_CLOCK = {"dekker-text"}


def test_every_preset_is_tried():
    assert {*WRITERS, "columns"} == set(PRESETS)


@pytest.mark.parametrize("name", WRITERS)
def test_a_setup_with_a_preset_names_its_files_by_that(tmp_path, name):
    WRITERS[name](tmp_path)
    needed = "\n    ".join(PRESETS[name].needs.values())
    rate = '"unknown"' if name == "shon-text" else "100.0"
    (tmp_path / "setup.toml").write_text(f"""schema = 1
    camera = {{ frame_rate_hz = {rate}, exposure_s = "unknown", pixel_size_nm = 80.0 }}
    beads = {{ radius_nm = 500.0 }}
    tether = {{ contour_length_nm = "unknown", persistence_length_nm = 50.0 }}
    buffer = {{ temperature_K = 298.0, viscosity_mPa_s = 0.9 }}
    field.direction = "x"
    plateaus.minimum_s = 0.1
    [source]
    preset = "{name}"
    {needed}
    """)
    by_setup, by_folder = mtpipe.load(tmp_path / "setup.toml"), mtpipe.load(tmp_path)
    assert by_setup.setup == by_folder.setup
    assert by_setup.setup.source.preset == name
    assert len(by_setup.plateaus) >= 1


@pytest.mark.parametrize(
    ("source", "what"),
    [
        ({"preset": "calisto"}, "no preset 'calisto'; did you mean calisto-text.*shon-text"),
        ({"preset": 3}, "there is no preset 3; known: calisto-text, .*columns"),
        ({"preset": "calisto-text"}, r'units\.position = "um" and time\.unit = "ms"'),
        ({"preset": "calisto-text", "units": {"position": "nm"}}, r"give time\.unit"),
        ({"preset": "shon-text", "beeds": {}}, "beeds.* is not a key"),
        ({"preset": "columns", "units": {"position": "nm"}}, "beads is missing"),
        ({**DEKKER, "magnet": {"time_column": 1}}, "row_by_row goes with file"),
    ],
)
def test_a_wrong_preset_is_told_by_its_key(source, what):
    with pytest.raises(SetupError, match=what):
        setup_of(source)
