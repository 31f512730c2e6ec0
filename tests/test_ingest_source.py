"""Laboratories' own layouts, read by the `[source]` table alone."""

import gzip

import numpy as np
import pytest

from mtpipe.ground.errors import MtpipeError, RecordingError, SetupError
from mtpipe.ingest import load
from tests.ingest_recordings import RATE, codes, motion, setup_of, write

N = 300
NM = {"units": {"position": "nm"}}
ONE = {"beads": {"name": "b1", "x": 2, "y": 3, "z": 4}, **NM}


def rows(columns, mark="\t", form="{:.6f}"):
    return [mark.join(form.format(v) for v in row) for row in zip(*columns, strict=True)]


def lab_columns(positions, *before):
    return [*before, *(p[:, k] for p in positions.values() for k in range(3))]


def test_pixels_micrometres_and_a_repeating_pattern(tmp_path):
    positions = motion(N)
    units = {b: np.column_stack([p[:, 0] / 64.6, p[:, 1] / 64.7, p[:, 2] / -880]) for b, p in
             positions.items()}  # fmt: skip
    magnet, angle = np.full(N, 2500.0), np.zeros(N)
    write(tmp_path / "t.xls", rows(lab_columns(units, magnet, angle)))
    source = {
        "beads": {"first_column": 3, "order": "xyz", "names": ["b1", "ref1"]},
        "units": {"x": "pixel", "y": "pixel", "z": "µm", "pixel_size_y_nm": 64.7,
                  "pixel_size_x_nm": 64.6},
        "scale": {"z": -0.88},
        "magnet": {"column": 1, "unit": "um"},
    }  # fmt: skip
    recording = load(tmp_path / "t.xls", setup_of(source))
    for bead, xyz in positions.items():
        np.testing.assert_allclose(recording.positions_nm[bead], xyz, atol=1e-3)
    np.testing.assert_allclose(recording.magnet_mm, 2.5)
    np.testing.assert_allclose(recording.time_s, np.arange(N) / RATE)
    assert {"guessed_layout", "rows_are_frames", "z_zero_unknown"} <= codes(recording)


@pytest.mark.parametrize(
    ("layout", "head", "mark", "decimal", "encoding"),
    [
        ({"delimiter": "semicolon", "decimal": ",", "header": True}, ["Zeit;x;y;z"], ";", ",",
         "utf-8"),
        ({"delimiter": "comma", "skip_lines": 2, "header": False}, ["a, b", "µ"], ",", ".",
         "latin-1"),
        ({"delimiter": "whitespace", "header": False}, ["", "# remark"], "   ", ".", "utf-8"),
        ({"delimiter": "tab", "header": True, "encoding": "utf-16"}, ["t\tx\ty\tz"], "\t", ".",
         "utf-16"),
        ({}, ["t,x,y,z"], ",", ".", "utf-8"),
        ({"encoding": "latin-1"}, ["t (µs)\tx\ty\tz"], "\t", ".", "latin-1"),
    ],
)  # fmt: skip
def test_ways_to_write_a_table(tmp_path, layout, head, mark, decimal, encoding):
    positions = motion(N, beads=("b1",))
    lines = rows(lab_columns(positions, np.arange(N) * 10.0), mark)
    path = write(tmp_path / "t.txt", head + [r.replace(".", decimal) for r in lines], encoding)
    source = {**ONE, **layout, "time": {"column": 1, "unit": "ms"}}
    recording = load(path, setup_of(source, reference=()))
    np.testing.assert_allclose(recording.positions_nm["b1"], positions["b1"], atol=1e-4)
    np.testing.assert_allclose(recording.time_s, np.arange(N) / 100)


def test_names_with_numbers_find_every_bead(tmp_path):
    positions = motion(N, beads=("b0", "b7", "ref1"))
    head = ["t", *(f"{a}{k} (um)" for k in (0, 7) for a in "XYZ"), "RX", "RY", "RZ"]
    columns = lab_columns(positions, np.arange(N) / 100)
    for column in columns[1:]:
        column /= 1000
    write(tmp_path / "t.txt", ["\t".join(head), *rows(columns)])
    source = {
        "beads": [
            {"name": "b{n}", "x": "X{n} (um)", "y": "Y{n} (um)", "z": "Z{n} (um)"},
            {"name": "ref1", "x": "RX", "y": "RY", "z": "RZ"},
        ],
        "units": {"position": "um"},
        "time": {"column": "t", "unit": "s"},
        "leave_out": ["b0"],
    }
    recording = load(tmp_path / "t.txt", setup_of(source))
    assert list(recording.positions_nm) == ["b7", "ref1"]
    np.testing.assert_allclose(recording.positions_nm["b7"], 1000 * positions["b7"], atol=1e-2)


def test_a_rounded_clock_gives_the_rate_of_its_ends(tmp_path):
    n, rate = 3000, 145.0
    rng = np.random.default_rng(1)
    time = np.array([float(f"{i / rate:.3g}") for i in range(n)])
    assert np.any(np.diff(time) == 0)
    columns = [rng.normal(0, 3e-8, n), time]
    path = write(tmp_path / "w.txt", ["", *rows(columns, " ", "{:.6g}")])
    source = {
        "delimiter": "whitespace",
        "header": False,
        "units": {"x": "m"},
        "beads": {"name": "b1", "x": 1},
        "time": {"column": 2, "unit": "s", "rounded": True},
    }
    recording = load(path, setup_of(source, rate="unknown", reference=()))
    assert recording.setup.camera.frame_rate_hz.value == pytest.approx(rate, rel=5e-3)
    assert np.ptp(np.diff(recording.frame)) == 0
    assert "frame_rate_derived" in codes(recording)
    source["time"]["rounded"] = False
    with pytest.raises(RecordingError, match="occurs twice") as caught:
        load(path, setup_of(source, rate="unknown", reference=()))
    assert "rounded = true" in caught.value.mend


def test_the_rate_of_millisecond_stamps_is_not_their_median(tmp_path):
    n, rate = 2000, 120.0
    time = np.round(1000 * np.arange(n) / rate)
    lines = rows(lab_columns(motion(n, beads=("b1",)), time))
    del lines[500:560]
    path = write(tmp_path / "t.txt", lines)
    source = {**ONE, "time": {"column": 1, "unit": "ms"}}
    recording = load(path, setup_of(source, rate="unknown", reference=()))
    assert recording.setup.camera.frame_rate_hz.value == pytest.approx(rate, rel=1e-4)
    assert recording.frame[-1] == n - 1
    assert "irregular_stamps" not in codes(recording)


def test_magnet_log_with_its_own_clock(tmp_path):
    positions = motion(1000)
    write(tmp_path / "beads.txt", rows(lab_columns(positions, 50 + np.arange(1000) / RATE)))
    log_time = np.arange(0, 8.5, 0.05)
    height = np.where(log_time < 4, 3.0, 2.0)
    turns = np.clip((log_time - 6) * 10, 0, 5)
    lines = ["time;z;turns", *rows([1000 * log_time, height, turns], ";")]
    write(tmp_path / "motor.log", [line.replace(".", ",") for line in lines])
    source = {
        "beads": {"first_column": 2, "names": ["b1", "ref1"]},
        **NM,
        "time": {"column": 1, "unit": "s"},
        "magnet": {"file": "motor.log", "delimiter": "semicolon", "decimal": ",", "column": "z",
                   "time_column": "time", "time_unit": "ms", "clock_offset_s": 50.0},
        "rotation": {"column": "turns", "unit": "turn", "in_log": True},
    }  # fmt: skip
    recording = load(tmp_path / "beads.txt", setup_of(source, minimum_s=1.0, settle_s=0.3))
    spans = [(p.start, p.stop, p.magnet_mm) for p in recording.plateaus]
    assert [value for _, _, value in spans] == [3.0, 2.0, 2.0]
    np.testing.assert_allclose([s[:2] for s in spans], [(0, 396), (430, 575), (705, 846)], atol=6)
    assert np.isnan(recording.magnet_mm[850:]).all()
    assert {"outside_log", "rotation"} <= codes(recording)
    source["magnet"]["clock_offset_s"] = 0.0
    with pytest.raises(RecordingError, match="log covers"):
        load(tmp_path / "beads.txt", setup_of(source))


def test_what_means_lost(tmp_path):
    positions = motion(N, beads=("b1",))
    columns = lab_columns(positions, np.full(N, 2.0))
    lines = rows(columns)
    for i in range(5):
        lines[i] = "0\t0\t0\t0"
    lines[10] = "2.0\tInf\t1000\t1000"
    lines[11] = "2.0\t-1.#IND000\t1000\t1000"
    lines[12] = "2.0\tGONE\t1000\t1000"
    lines[13] = "2.0\t-1\t1000\t1000"
    path = write(tmp_path / "t.txt", lines)
    source = {**ONE, "header": False, "magnet": {"column": 1}}
    lost = {"tokens": ["GONE"], "values": [-1.0]}
    with pytest.raises(RecordingError, match="every position is exactly 0"):
        load(path, setup_of({**source, "lost": lost}, reference=()))
    lost["all_zero_rows"] = True
    recording = load(path, setup_of({**source, "lost": lost}, reference=()))
    x = recording.positions_nm["b1"][:, 0]
    assert np.flatnonzero(np.isnan(x)).tolist() == [0, 1, 2, 3, 4, 10, 11, 12, 13]
    assert recording.plateaus[0].start == 5
    assert {"all_zero_rows", "infinite", "lost_frames"} <= codes(recording)


def test_rows_are_kept_and_left_out_through_all_files(tmp_path):
    positions = motion(N, beads=("b1",))
    lines = rows(lab_columns(positions, np.arange(N)))
    (tmp_path / "01.txt.gz").write_bytes(gzip.compress("\n".join(lines[:100]).encode()))
    (tmp_path / "02.txt.gz").write_bytes(gzip.compress("\n".join(lines[100:]).encode()))
    source = {**ONE, "frame": {"column": 1}, "files": ["*.txt.gz"], "header": False,
              "keep_rows": [[51, 300]], "skip_rows": [[101, 110]]}  # fmt: skip
    recording = load(tmp_path, setup_of(source, reference=()))
    expected = [*range(50, 100), *range(110, N)]
    assert recording.frame.tolist() == expected
    np.testing.assert_allclose(recording.positions_nm["b1"], positions["b1"][expected], atol=1e-4)


def test_clocks_that_restart_in_each_file(tmp_path):
    lines = rows(lab_columns(motion(N, beads=("b1",)), np.arange(N) % 100))
    for k in range(3):
        write(tmp_path / f"{k}.txt", lines[100 * k : 100 * k + 100])
    source = {**ONE, "frame": {"column": 1, "restarts": True}, "header": False}
    recording = load(tmp_path, setup_of(source, reference=()))
    assert recording.frame.tolist() == list(range(N))
    source["frame"]["restarts"] = False
    with pytest.raises(RecordingError, match=r"frame number goes backward.*99.*to 0"):
        load(tmp_path, setup_of(source, reference=()))


@pytest.mark.parametrize("kind", ["matlab", "npz", "hdf5", "groups", "records", "tdms", "parquet"])
def test_files_of_arrays(tmp_path, kind):
    xyz = motion(N, beads=("b1",))["b1"]
    path, time = tmp_path / "recording.dat", np.arange(N) / RATE
    beads = {"name": "b{n}", "x": "b{n}/x", "y": "b{n}/y", "z": "b{n}/z"}
    clock = "time"
    if kind in ("matlab", "npz"):
        import scipy.io

        beads = {"name": "b1", "x": "p[1]", "y": "p[2]", "z": "p[3]"}
        with path.open("wb") as stream:
            if kind == "matlab":
                scipy.io.savemat(stream, {"p": xyz.T, "time": time, "note": "text"})
            else:
                np.savez(stream, p=xyz, time=time, empty=np.zeros((0, 0)))
    elif kind == "tdms":
        import nptdms

        with nptdms.TdmsWriter(path) as writer:
            channels = {"time": time, **{f"b1/{a}": xyz[:, k] for k, a in enumerate("xyz")}}
            writer.write_segment(
                [nptdms.ChannelObject("g", name, data) for name, data in channels.items()]
            )
    elif kind == "parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table({"time": time, **{f"b1/{a}": xyz[:, k] for k, a in
                                                  enumerate("xyz")}}), path)  # fmt: skip
    else:
        import h5py

        with h5py.File(path, "w") as file:
            file["time"] = time
            if kind == "records":
                kinds = [(a, "f8") for a in "xyz"]
                file["b1"] = np.array([tuple(row) for row in xyz], dtype=kinds)
            for k, axis in enumerate("xyz" if kind != "records" else ""):
                file[f"b1/{axis}" if kind == "groups" else f"tracks/b1/{axis}"] = xyz[:, k]
            if kind == "groups":
                file["stage/t_s"], file["stage/mm"] = [0.0, 2.0], [2.0, 2.0]
        if kind == "hdf5":
            beads = {a: f"tracks/b{{n}}/{a}" for a in "xyz"}
    source = {"beads": beads, **NM, "time": {"column": clock, "unit": "s"}}
    if kind == "groups":
        source["magnet"] = {"column": "stage/mm", "time_column": "stage/t_s"}
    recording = load(path, setup_of(source, reference=()))
    np.testing.assert_array_equal(recording.positions_nm["b1"], xyz)
    np.testing.assert_array_equal(recording.time_s, time)
    if kind == "groups":
        assert recording.plateaus[0].magnet_mm == 2.0
    gzipped = tmp_path / "again.gz"
    gzipped.write_bytes(gzip.compress(path.read_bytes()))
    if kind != "parquet":
        again = load(gzipped, setup_of(source, reference=()))
        np.testing.assert_array_equal(again.positions_nm["b1"], xyz)
    damaged = tmp_path / "damaged.dat"
    damaged.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(MtpipeError):
        load(damaged, setup_of(source, reference=()))


def test_plot_files_of_cycles(tmp_path):
    values = np.random.default_rng(0).normal(0, 0.02, 250).astype("<f4")
    head = '% plot data\n-lt "Z"\n\n-a \n-ibfz 0 100\n\n-a \n-ibfz 400 150\n\x1a'
    (tmp_path / "z.gr").write_bytes(head.encode() + values.tobytes())
    source = {"beads": {"name": "b1", "z": "y"}, "units": {"z": "um"}, "frame": {"column": "frame"}}
    recording = load(tmp_path / "z.gr", setup_of(source, reference=()))
    np.testing.assert_allclose(recording.positions_nm["b1"][:, 2], values * 1000.0)
    assert recording.frame[[0, 99, 100, -1]].tolist() == [0, 99, 101, 250]


@pytest.mark.parametrize(
    ("change", "error", "what"),
    [
        ({"beads": {"name": "b1", "x": 9}}, RecordingError, "column 9.*there are 4"),
        ({"beads": {"name": "b1", "x": "x"}}, RecordingError, "columns have no names"),
        ({"beads": {"first_column": 2, "names": ["a", "b"]}}, RecordingError, "room for 1 beads"),
        ({"beads": {"x": 1}}, SetupError, "the bead needs a name"),
        ({"beads": {"name": "b1", "x": 0}}, SetupError, "counted from 1"),
        ({"beads": {"name": "b", "x": "x{n}"}}, SetupError, r"needs \{n\}"),
        ({"beads": {"name": "b1", "first_column": 1}}, SetupError, "goes with names"),
        ({"beads": {"first_column": 1, "order": "xx"}}, SetupError, "once each"),
        ({"units": {}}, SetupError, "unit of x is missing"),
        ({"units": {"position": "inch"}}, SetupError, "units.position"),
        ({"units": {"x": "pixel", "y": "nm", "z": "nm"}}, SetupError, "size of a pixel is missing"),
        ({"scale": {"z": 0}}, SetupError, "leaves no position"),
        ({"delimeter": "tab"}, SetupError, "not a key"),
        ({"delimiter": "comma", "decimal": ","}, SetupError, "both be a comma"),
        ({"z_zero": {"value_nm": 1.0, "unknown": True}}, SetupError, "give one of"),
        ({"format": "tdms"}, RecordingError, "is text, not tdms"),
        ({"magnet": {"column": 1, "file": "m.txt"}}, SetupError, "needs its own clock"),
        ({"leave_out": ["b9"]}, SetupError, "'b9'"),
        ({"keep_rows": [[5, 2]]}, SetupError, "no range of rows"),
    ],
)
def test_a_wrong_table_is_told_by_its_key(tmp_path, change, error, what):
    path = write(tmp_path / "t.txt", rows(lab_columns(motion(N, beads=("b1",)), np.arange(N))))
    with pytest.raises(error, match=what):
        load(path, setup_of({**ONE, "header": False, **change}, reference=()))


def test_a_misspelt_column_lists_near_names(tmp_path):
    lines = ["t\tx_pos\ty_pos", *rows([np.arange(N), np.arange(N), np.arange(N)])]
    path = write(tmp_path / "t.txt", lines)
    source = {"beads": {"name": "b1", "x": "xpos"}, **NM}
    with pytest.raises(RecordingError, match="no column 'xpos'") as caught:
        load(path, setup_of(source, reference=()))
    assert "x_pos" in caught.value.mend


def test_a_column_that_a_pattern_misses_lists_what_is_there(tmp_path):
    lines = ["X1\tY1\tX2\theight2\tY2", *rows([np.arange(N)] * 5)]
    path = write(tmp_path / "t.txt", lines)
    source = {"beads": {"name": "b{n}", "x": "X{n}", "y": "Y{n}", "z": "Z{n}"}, **NM}
    with pytest.raises(RecordingError, match=r"no column 'Z1' \(b1 z\)") as caught:
        load(path, setup_of(source, reference=()))
    assert "There are: X1, Y1, X2, height2, Y2." in caught.value.mend
    source["beads"] = {"name": "b{n}", "x": "pos{n}"}
    with pytest.raises(RecordingError, match=r"no column that \[source\.beads\]") as caught:
        load(path, setup_of(source, reference=()))
    assert "There are: X1, Y1, X2, height2, Y2." in caught.value.mend


def test_a_setup_that_names_its_files_is_a_recording(tmp_path):
    write(tmp_path / "data.txt", rows(lab_columns(motion(N, beads=("b1",)), np.arange(N))))
    (tmp_path / "here").mkdir()
    toml = tmp_path / "here" / "setup.toml"
    content = """schema = 1
    camera = { frame_rate_hz = 100.0, exposure_s = "unknown" }
    beads = { radius_nm = 500.0 }
    tether = { contour_length_nm = "unknown", persistence_length_nm = 50.0 }
    buffer = { temperature_K = 298.0, viscosity_mPa_s = 0.9 }
    field.direction = "x"
    plateaus.minimum_s = 1.0
    source = { files = "../data.txt", units.position = "nm", beads = { name = "b1", x = 2 } }
    """
    toml.write_text(content)
    assert len(load(toml).time_s) == N
    assert len(load(tmp_path / "here").time_s) == N
    toml.write_text(content.replace("../data.txt", "../other.txt"))
    with pytest.raises(RecordingError, match=r"no file '\.\./other\.txt'"):
        load(toml)


@pytest.mark.parametrize("rate", [RATE, "unknown"])
def test_a_wrong_unit_of_time_is_told_by_the_table_that_states_it(tmp_path, rate):
    microseconds = 1e6 * np.arange(400) / RATE
    lines = rows(lab_columns(motion(400, beads=("b1",)), microseconds))
    source = {**ONE, "time": {"column": 1, "unit": "ms"}}
    with pytest.raises(RecordingError, match=r"column 1 seems not to be in ms\. Correct unit in"):
        load(write(tmp_path / "t.txt", lines), setup_of(source, rate=rate, reference=()))
