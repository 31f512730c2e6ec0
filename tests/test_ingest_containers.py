"""Every way in which programs put the same numbers into a file gives the same recording."""

from datetime import timedelta

import h5py
import nptdms
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest import load
from mtpipe.ingest.instants import are_instants, instants_of, is_instant, since
from tests.ingest_recordings import (
    FIVE,
    RATE,
    N,
    assert_plain,
    five_columns,
    five_setup,
    write,
)


def stacked(columns):
    """(frames, beads, 3): the bead and another one beside it."""
    xyz = np.column_stack([columns[axis] for axis in "XYZ"])
    return np.stack([xyz + 5000.0, xyz], axis=1)


def matlab(path, content, version="5"):
    scipy.io.savemat(path, content, format=version, appendmat=False)
    return path


def named(prefix, names=FIVE):
    return tuple(f"{prefix}{name}" for name in names)


def cells(columns):
    cell = np.empty(5, dtype=object)
    cell[:] = list(columns.values())
    return cell


@pytest.mark.parametrize(
    ("content", "names"),
    [
        (lambda c: {"data": c}, named("data/")),
        (lambda c: {"a": {"b": {"c": c}}}, named("a/b/c/")),
        (lambda c: {"c": cells(c)}, tuple(f"c[{k}]" for k in range(1, 6))),
        (
            lambda c: {
                "t": c["Time"],
                "m": c["Magnet"][:, None],
                "bead": np.array([({"x": c[a]},) for a in "XYZ"], dtype=[("pos", object)]),
            },
            ("t", "m", "bead[1]/pos/x", "bead[2]/pos/x", "bead[3]/pos/x"),
        ),
        (
            lambda c: {"t": c["Time"], "m": c["Magnet"], "p": stacked(c)},
            ("t", "m", "p[2,1]", "p[2,2]", "p[2,3]"),
        ),
        (
            lambda c: {"t": c["Time"], "m": c["Magnet"], "p": stacked(c).T},
            ("t", "m", "p[1,2]", "p[2,2]", "p[3,2]"),
        ),
    ],
)
def test_matlab_structs_cells_and_arrays(tmp_path, content, names):
    columns = five_columns()
    path = matlab(tmp_path / "r.mat", content(columns))
    assert_plain(load(path, five_setup(names)), columns)


def test_matlab_4(tmp_path):
    columns = five_columns()
    path = matlab(tmp_path / "r.mat", {k: v[:, None] for k, v in columns.items()}, "4")
    assert path.read_bytes()[:4] == b"\0\0\0\0"  # no word says what it is
    assert_plain(load(path, five_setup()), columns)


def test_matlab_7_3_cells_and_structs_are_named_as_in_version_5(tmp_path):
    """Written as MATLAB does: references into #refs#, structs as groups."""
    columns = five_columns()
    with h5py.File(tmp_path / "r.mat", "w", userblock_size=512) as file:
        for name, values in columns.items():
            file[f"#refs#/{name}"] = values[None, :]
        group = file.create_group("bead")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        kind = h5py.special_dtype(ref=h5py.Reference)
        for field in ("X", "Y"):
            group.create_dataset(field, (1, 2), dtype=kind)[0] = [
                file[f"#refs#/{field}"].ref, file["#refs#/Z"].ref
            ]  # fmt: skip
        cell = file.create_dataset("c", (2, 1), dtype=kind)
        cell[:, 0] = [file["#refs#/Time"].ref, file["#refs#/Magnet"].ref]
    content = (tmp_path / "r.mat").read_bytes()
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b" ")
    (tmp_path / "r.mat").write_bytes(head + content[512:])
    names = ("c[1]", "c[2]", "bead[1]/X", "bead[1]/Y", "bead[2]/X")
    assert_plain(load(tmp_path / "r.mat", five_setup(names)), columns)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("turned", [False, True])
def test_a_numpy_array(tmp_path, order, turned):
    columns = five_columns()
    table = np.column_stack(list(columns.values()))
    np.save(tmp_path / "r.npy", np.asarray(table.T if turned else table, order=order))
    assert_plain(load(tmp_path / "r.npy", five_setup((1, 2, 3, 4, 5))), columns)
    names = tuple(f"array[{k}]" for k in range(1, 6))
    assert_plain(load(tmp_path / "r.npy", five_setup(names)), columns)


def test_numpy_records_and_archives(tmp_path):
    columns = five_columns()
    kinds = [("t", "f8"), ("m", "f4"), ("pos", "f8", (2, 3))]
    records = np.zeros(len(columns["Time"]), dtype=kinds)
    records["t"], records["m"], records["pos"] = columns["Time"], 3.0, stacked(columns)
    np.save(tmp_path / "r.npy", records)
    inner = ("t", "m", "pos[2,1]", "pos[2,2]", "pos[2,3]")
    assert_plain(load(tmp_path / "r.npy", five_setup(inner)), columns)
    np.savez_compressed(tmp_path / "r.npz", all=records, note=np.array({"a": 1}, dtype=object))
    assert_plain(load(tmp_path / "r.npz", five_setup(named("all/", inner))), columns)
    with pytest.raises(RecordingError, match=r"'note' .*Python objects"):
        load(tmp_path / "r.npz", five_setup(("note", *named("all/", inner[1:]))))


@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 0, 2), (2, 1, 0)])
def test_hdf5_arrays_of_three_axes(tmp_path, axes):
    columns = five_columns()
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["Time"], file["Magnet"] = columns["Time"], columns["Magnet"]
        file["pos"] = stacked(columns).transpose(axes)
    bead_first = axes != (2, 1, 0)
    names = [f"pos[2,{k}]" if bead_first else f"pos[{k},2]" for k in (1, 2, 3)]
    assert_plain(load(tmp_path / "r.h5", five_setup(("Time", "Magnet", *names))), columns)
    with pytest.raises(RecordingError, match=r"'pos' \(b1 x\) is there, but has 6 columns") as told:
        load(tmp_path / "r.h5", five_setup(("Time", "Magnet", "pos", *names[1:])))
    assert "pos[1,1], pos[1,2]" in told.value.mend
    every = {"first_column": "pos[1,1]", "order": "xyz", "names": ["other", "b1"]}
    if bead_first:
        both = load(tmp_path / "r.h5", five_setup(beads=every))
        assert_plain(both, columns)
        np.testing.assert_array_equal(both.positions_nm["other"], both.positions_nm["b1"] + 5000)


def test_tables_that_pandas_writes_in_hdf5(tmp_path):
    """`format="table"`: one field that holds the row's numbers (pandas needs PyTables for it)."""
    columns = five_columns()
    n = len(columns["Time"])
    kinds = [("index", "i8"), ("values_block_0", "f8", (5,)), ("values_block_1", "S4", (1,))]
    table = np.zeros(n, dtype=kinds)
    table["index"], table["values_block_0"] = np.arange(n), np.column_stack([*columns.values()])
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["tracks/table"] = table
    names = tuple(f"tracks/table/values_block_0[{k}]" for k in range(1, 6))
    assert_plain(load(tmp_path / "r.h5", five_setup(names)), columns)


def test_parquet_lists_and_structs(tmp_path):
    columns = five_columns()
    xyz = np.column_stack([columns[a] for a in "XYZ"])
    for kind in (pa.list_(pa.float64(), 3), pa.list_(pa.float64())):
        table = {
            "stage": pa.StructArray.from_arrays([columns["Time"], columns["Magnet"]], ["t", "m"]),
            "pos": pa.array(list(xyz), type=kind),
            "note": pa.array([b"raw"] * len(xyz)),
        }
        pq.write_table(pa.table(table), tmp_path / "r.parquet")
        names = ("stage/t", "stage/m", "pos[1]", "pos[2]", "pos[3]")
        assert_plain(load(tmp_path / "r.parquet", five_setup(names)), columns)
    with pytest.raises(RecordingError, match=r"'note' .*binary"):
        load(tmp_path / "r.parquet", five_setup(("stage/t", "stage/m", "note", *names[3:])))


def test_links_are_followed_within_the_file_and_refused_beyond_it(tmp_path):
    columns = five_columns()
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["X"] = columns["X"]
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name, values in columns.items():
            file[f"raw/{name}"] = values
        for name in columns:
            file[f"soft/{name}"] = h5py.SoftLink(f"/raw/{name}")
        file["hard"] = file["raw"]
        file["raw/round"] = file["raw"]
        file["far"] = h5py.ExternalLink("other.h5", "/X")
        file["nowhere"] = h5py.SoftLink("/gone")
        layout = h5py.VirtualLayout((len(columns["X"]),), dtype="f8")
        layout[:] = h5py.VirtualSource("other.h5", "X", shape=(len(columns["X"]),))
        file.create_virtual_dataset("virtual", layout)
    for prefix in ("raw/", "soft/", "hard/"):
        assert_plain(load(tmp_path / "r.h5", five_setup(named(prefix))), columns)
    for name, what in [("far", "into another file, other.h5"), ("nowhere", "link to nothing"),
                       ("virtual", "kept in another file, other.h5")]:  # fmt: skip
        with pytest.raises(RecordingError, match=f"'{name}' .*{what}"):
            load(tmp_path / "r.h5", five_setup(("raw/Time", "raw/Magnet", name, "raw/Y", "raw/Z")))


@pytest.mark.parametrize("record", [False, True])
def test_netcdf_3(tmp_path, record):
    columns = five_columns()
    path = tmp_path / "r.nc"
    with scipy.io.netcdf_file(path, "w") as file:
        file.createDimension("row", None if record else len(columns["X"]))
        for name, values in columns.items():
            one = file.createVariable(name, "i4" if name in "XYZ" else "f8", ("row",))
            one[:] = np.rint(values * 1000) if name in "XYZ" else values
            if name in "XYZ":
                one.scale_factor, one.units = np.float64(0.001), "nm"
    assert_plain(load(path, five_setup()), columns)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(RecordingError, match="is cut off or damaged, and nothing is taken"):
        load(path, five_setup())
    path.write_bytes(b"CDF\x05" + whole[4:])
    with pytest.raises(RecordingError, match=r"version 5, .*nccopy"):
        load(path, five_setup())


def test_objects_of_matlab_s_own_are_named(tmp_path):
    with h5py.File(tmp_path / "r.mat", "w") as file:
        for name, values in five_columns().items():
            file[name] = values
        file["trace"] = np.array([[0xDD000000, 2, 1, 1, 1, 1]], "u4")
        file["trace"].attrs["MATLAB_class"] = np.bytes_("table")
        file["trace"].attrs["MATLAB_object_decode"] = np.int32(3)
    with pytest.raises(RecordingError, match=r"an object of MATLAB's own \(table\)"):
        load(tmp_path / "r.mat", five_setup(("Time", "Magnet", "trace[1]", "Y", "Z")))


def test_what_cannot_be_used_is_listed_with_its_shape_and_type(tmp_path):
    columns = five_columns()
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name, values in columns.items():
            file[name] = values
        file["film"] = np.zeros((60, 200, 300), "u1")
        file["phase"] = np.zeros(400, "c16")
        file["notes"] = ["good", "bad"]
        file["gain"] = 3.0
        file["none"] = np.zeros((0, 3))
    with pytest.raises(RecordingError) as caught:
        load(tmp_path / "r.h5", five_setup(("Time", "Magnet", "x_pos", "Y", "Z")))
    for told in ("film (60 × 200 × 300 uint8", "phase (400 complex)", "notes (2 text",
                 "gain (a single float64 (3.0))", "none (empty)"):  # fmt: skip
        assert told in caught.value.mend
    with pytest.raises(RecordingError, match=r"'phase' .*is there, but is no column .*400 complex"):
        load(tmp_path / "r.h5", five_setup(("Time", "Magnet", "phase", "Y", "Z")))


@pytest.mark.parametrize("chunks", [(1, 30), (64, 30), (1000, 1), (1000, 30), None])
def test_a_wide_array_is_read_once(tmp_path, chunks, monkeypatch):
    """Each number once, whatever the chunks: reads of h5py are counted."""
    beads = np.random.default_rng(0).normal(0, 30, (1000, 30)).astype("f4")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file.create_dataset("pos", data=beads, chunks=chunks)
    read = []
    get = h5py.Dataset.__getitem__

    def counted(self, index):
        values = get(self, index)
        read.append(np.size(values))
        return values

    monkeypatch.setattr(h5py.Dataset, "__getitem__", counted)
    table = {"first_column": "pos[1]", "order": "xyz"}
    setup = five_setup(beads=table, time=False, magnet=None)
    recording = load(tmp_path / "r.h5", setup)
    assert read == [beads.size]
    together = np.concatenate([recording.positions_nm[f"b{k + 1}"] for k in range(10)], axis=1)
    np.testing.assert_array_equal(together, beads)


@pytest.mark.parametrize("kind", [pa.list_(pa.float64()), pa.large_list(pa.float32())])
@pytest.mark.parametrize("none", [None, []])
def test_lists_in_parquet_that_are_empty_where_a_frame_is_lost(tmp_path, kind, none):
    columns = five_columns()
    xyz = [[float(columns[axis][i]) for axis in "XYZ"] for i in range(N)]
    xyz[0] = xyz[7] = none
    xyz[9] = xyz[9][:2]  # z is lost
    table = {k: columns[k] for k in ("Time", "Magnet")} | {"p": pa.array(xyz, kind)}
    pq.write_table(pa.table(table), tmp_path / "r.parquet")
    setup = five_setup(beads={"name": "b1", "x": "p[1]", "y": "p[2]", "z": "p[3]"})
    found = load(tmp_path / "r.parquet", setup).positions_nm["b1"]
    np.testing.assert_array_equal(np.argwhere(np.isnan(found).any(axis=1)).ravel(), [0, 7, 9])
    expected = np.column_stack([columns[axis] for axis in "XYZ"])
    expected[[0, 7]], expected[9, 2] = np.nan, np.nan
    np.testing.assert_allclose(found, expected, atol=1e-3)
    gone = pa.table(table | {"p": pa.array([none] * N, kind)})
    pq.write_table(gone, tmp_path / "r.parquet")
    with pytest.raises(RecordingError, match=r"no column 'p\[1\]'.*p \(400 rows of"):
        load(tmp_path / "r.parquet", setup)


START = np.datetime64("2024-03-30T23:59:58.5", "ns")


def moments(columns):
    """The plain recording's times as clock times that pass midnight."""
    return START + np.rint(columns["Time"] * 1e9).astype("timedelta64[ns]")


OFFSET = "+05:30"
ZONES = [None, "UTC", "Europe/Amsterdam", OFFSET]


@pytest.mark.parametrize("zone", ZONES)
@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_clock_times_in_parquet(tmp_path, zone, unit):
    columns = five_columns()
    stamps = pa.array(moments(columns)).cast(pa.timestamp(unit), safe=False)
    local = pa.compute.strftime(stamps, "%Y-%m-%d %H:%M:%S")
    if zone == OFFSET:  # which an older Arrow does not take for a zone
        ahead = pa.scalar(timedelta(hours=5, minutes=30), pa.duration(unit))
        stamps = pa.compute.subtract(stamps, ahead).cast(pa.timestamp(unit, zone))
    elif zone is not None:
        stamps = pa.compute.assume_timezone(stamps, zone)
    for values in (stamps, local):
        if pa.types.is_string(values.type) and unit == "ms" and zone is not None:
            continue
        table = {"Time": values, **{k: columns[k] for k in FIVE[1:]}}
        pq.write_table(pa.table(table), tmp_path / "r.parquet")
        assert_plain(load(tmp_path / "r.parquet", five_setup()), columns)


def test_durations_and_times_of_day_in_parquet(tmp_path):
    columns = five_columns()
    whole = np.rint(columns["Time"] * 1e6).astype("i8")
    day = 86_400 * 10**6
    for values in (pa.array(whole, pa.duration("us")),
                   pa.array((whole + day - 1_500_000) % day, pa.time64("us"))):  # fmt: skip
        table = {"Time": values, **{k: columns[k] for k in FIVE[1:]}}
        pq.write_table(pa.table(table), tmp_path / "r.parquet")
        assert_plain(load(tmp_path / "r.parquet", five_setup()), columns)


def test_clock_times_of_pandas_with_zone(tmp_path):
    columns = five_columns()
    frame = pd.DataFrame(columns | {"Time": pd.DatetimeIndex(moments(columns), tz="Asia/Tokyo")})
    frame.to_parquet(tmp_path / "r.parquet")
    assert_plain(load(tmp_path / "r.parquet", five_setup()), columns)
    frame.to_csv(tmp_path / "r.csv", index=False)
    assert_plain(load(tmp_path / "r.csv", five_setup()), columns)


def test_clock_times_in_tdms(tmp_path):
    columns = five_columns()
    with nptdms.TdmsWriter(tmp_path / "r.tdms") as writer:
        data = columns | {"Time": moments(columns).astype("datetime64[us]")}
        writer.write_segment([nptdms.ChannelObject("g", n, v) for n, v in data.items()])
    assert_plain(load(tmp_path / "r.tdms", five_setup()), columns)


@pytest.mark.parametrize("kind", ["text", "fixed text", "since", "numpy's own"])
def test_clock_times_in_hdf5(tmp_path, kind):
    columns = five_columns()
    stamps = moments(columns)
    unit = "s"
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name in FIVE[1:]:
            file[name] = columns[name]
        if kind == "text":
            file["Time"] = [str(stamp) for stamp in stamps]
        elif kind == "fixed text":
            file["Time"] = np.array([f"{stamp}Z" for stamp in stamps], dtype="S32")
        elif kind == "since":
            file["Time"] = np.rint(columns["Time"] * 1e3).astype("i8")
            file["Time"].attrs["units"] = "milliseconds since 2024-03-30 23:59:58.5"
            unit = "ms"
        else:
            kind_of_time = h5py.opaque_dtype(stamps.dtype)
            file.create_dataset("Time", data=stamps.astype(kind_of_time))
    setup = five_setup()
    if unit == "ms":
        with pytest.raises(RecordingError, match=r"column Time .*is in ms .*milliseconds since"):
            load(tmp_path / "r.h5", setup)
        setup = five_setup_in(unit)
    assert_plain(load(tmp_path / "r.h5", setup), columns)


def five_setup_in(unit):
    setup = five_setup()
    time = setup.source.time.model_copy(update={"unit": unit})
    return setup.model_copy(update={"source": setup.source.model_copy(update={"time": time})})


@pytest.mark.parametrize(
    "form",
    [
        "{0:%Y-%m-%d %H:%M:%S}.{1:06}", "{0:%Y-%m-%dT%H:%M:%S}.{1:06}Z", "{0:%H:%M:%S}.{1:06}",
        "{0:%Y-%m-%dT%H:%M:%S}.{1:06}+02:00", "{0:%d.%m.%Y %H:%M:%S},{1:06}",
        "{0:%m/%d/%Y %I:%M:%S}.{1:06} {0:%p}", "{0:%Y/%m/%d %H:%M:%S}.{1:06}",
        "{0:%H:%M:%S}:{1:06}", "{0:%Y%m%dT%H%M%S}.{1:06}", "{0:%Y%m%d %H:%M:%S}.{1:06}",
        "{0:%Y-%m-%d_%H-%M-%S}.{1:06}", "{0:%d.%m.%y %H:%M:%S},{1:06}",
        "{0:%d-%b-%Y %H:%M:%S}.{1:06}", "{0:%B %d, %Y %I:%M:%S}.{1:06} {0:%p}",
        "{0:%Y-%m-%d %H:%M:%S}.{1:06} CET",
    ],
)  # fmt: skip
def test_clock_times_in_text(tmp_path, form):
    columns = five_columns()
    stamps = [pd.Timestamp(stamp) for stamp in moments(columns)]
    written = [form.format(s, s.microsecond) for s in stamps]
    lines = ["\t".join([w, *(repr(float(columns[k][i])) for k in FIVE[1:])])
             for i, w in enumerate(written)]  # fmt: skip
    for head in (["\t".join(FIVE)], ["Recorder 2", "started 12:00", "\t".join(FIVE)]):
        path = write(tmp_path / "r.txt", [*head, *lines])
        assert_plain(load(path, five_setup()), columns)


@pytest.mark.parametrize(
    ("start_s", "form"),
    [
        (3598.5, "{1:02}:{2:02}.{3:03}"),  # of a spreadsheet, which begins anew at the full hour
        (3598.5, "{1:02}:{2:02},{3:03}"),
        (3598.5, "{1:02}:{2:02}:{3:03}"),
        (3598.5, "{4}:{2:02}.{3:03}"),  # minutes that go on
        (3598.5, "{5}{1:02}:{2:02}.{3:03}"),  # an hour where there is one
        (598.5, "{4}:{2:02}.{3:03}"),
        (0.0, "{4}:{2:02}.{3:g}"),
    ],
)
def test_minutes_and_seconds_as_clock_times(tmp_path, start_s, form):
    columns = five_columns()
    written = []
    for ms in np.rint(1000 * (columns["Time"] + start_s)).astype(int).tolist():
        minutes, rest = divmod(ms, 60_000)
        hours, minute = divmod(minutes, 60)
        hour = f"{hours}:" if hours else ""
        written.append(form.format(hours, minute, rest // 1000, rest % 1000, minutes, hour))
    if "g}" in form:  # no fraction where it is nought
        written = [
            f"{w.rpartition('.')[0]}{f'{i % 100 / 100:g}'[1:]}" for i, w in enumerate(written)
        ]
    lines = ["\t".join([w, *(repr(float(columns[k][i])) for k in FIVE[1:])])
             for i, w in enumerate(written)]  # fmt: skip
    path = write(tmp_path / "r.txt", ["\t".join(FIVE), *lines])
    assert_plain(load(path, five_setup()), columns)


def test_minutes_begin_anew_hour_after_hour_in_any_pieces():
    seconds = np.arange(3000.0, 20_000.0, 7.25)
    written = [f"{int(s) // 60 % 60:02}:{s % 60:06.3f}" for s in seconds]
    moments = instants_of(written)
    found, last_s = [], 0.0
    for piece in np.split(moments, [1, 90, 500, 1200]):
        found.append(since(moments[0], piece, last_s))
        last_s = found[-1][-1]
    np.testing.assert_array_equal(np.concatenate(found), seconds - 3000)
    # a log that began before the recording
    np.testing.assert_array_equal(since(moments[-1], moments[-3:-1]), [-14.5, -7.25])
    later = instants_of(["00:01.5", "00:02.5"])
    np.testing.assert_array_equal(since(later[0], instants_of(["59:59.5", "00:03.5"])), [-2, 2])


def test_what_is_no_clock_time():
    assert not are_instants(["2024-03-31 01:59:59 CET", "2024-03-31 03:00:00 CEST"])
    for text in ("12:00:00 lost", "30-Foo-2024 12:00:00", "20240330", "120000.008", "25:00:00",
                 "12:60.5", "1:2.5", "12:30.5 PM"):  # fmt: skip
        assert not is_instant(text)


@pytest.mark.parametrize("kind", ["parquet", "hdf5", "tdms"])
def test_numbers_that_were_written_as_text(tmp_path, kind):
    columns = five_columns()
    written = {k: [repr(v) for v in values.tolist()] for k, values in columns.items()}
    written["X"][7] = written["X"][8] = "NaN"
    path = tmp_path / "r.dat"
    if kind == "parquet":
        pd.DataFrame(written).to_parquet(path)
    elif kind == "hdf5":
        with h5py.File(path, "w") as file:
            for name, values in written.items():
                file[name] = values
    else:
        with nptdms.TdmsWriter(path) as writer:
            writer.write_segment([nptdms.ChannelObject("g", n, v) for n, v in written.items()])
    recording = load(path, five_setup())
    assert np.isnan(recording.positions_nm["b1"][[7, 8], 0]).all()
    recording.positions_nm["b1"][[7, 8], 0] = columns["X"][[7, 8]]
    assert_plain(recording, columns)


def test_a_series_of_files_counts_from_its_first_clock_time(tmp_path):
    columns = five_columns()
    lines = [",".join([str(s), *(repr(float(columns[k][i])) for k in FIVE[1:])])
             for i, s in enumerate(moments(columns))]  # fmt: skip
    write(tmp_path / "a1.csv", [",".join(FIVE), *lines[:150]])
    write(tmp_path / "a2.csv", [",".join(FIVE), *lines[150:]])
    assert_plain(load(tmp_path, five_setup()), columns)


def test_a_magnet_log_with_clock_times_shares_the_recording_s_clock(tmp_path):
    columns = five_columns()
    columns["Magnet"] = np.where(columns["Time"] < 2.005, 3.0, 1.0)
    stamps = moments(columns)
    lines = [",".join([str(s), *(repr(float(columns[k][i])) for k in "XYZ")])
             for i, s in enumerate(stamps)]  # fmt: skip
    write(tmp_path / "r.csv", ["Time,X,Y,Z", *lines])
    log = [f"{stamps[i]},{columns['Magnet'][i]}" for i in range(0, 400)]
    before = [f"{START - np.timedelta64(5, 's')},3.0", "2024-03-30T23:59:55,3.0"]
    write(tmp_path / "motor.log", ["when,where", *before, *log])
    magnet = {"file": "motor.log", "column": "where", "time_column": "when", "unit": "mm"}
    recording = load(tmp_path / "r.csv", five_setup(magnet=magnet))
    assert_plain(recording, columns)
    assert [p.magnet_mm for p in recording.plateaus] == [3.0, 1.0]


def test_a_clock_time_is_no_position(tmp_path):
    columns = five_columns()
    lines = [f"{i / RATE},3,{s},1,2" for i, s in enumerate(moments(columns))]
    path = write(tmp_path / "r.csv", [",".join(FIVE), *lines])
    with pytest.raises(RecordingError, match=r"column X .*clock times"):
        load(path, five_setup())
