"""What files say of their numbers themselves is respected, or refused by name."""

import h5py
import nptdms
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from mtpipe.ground.errors import RecordingError, SetupError
from mtpipe.ingest import load
from mtpipe.ingest.column_attributes import stated_by
from mtpipe.ingest.units import unit_in_name, unit_of
from tests.ingest_recordings import (
    N,
    assert_plain,
    codes,
    five_columns,
    five_setup,
    sentences,
    write,
)

LOST_ROWS = [7, 8, 200]


def write_hdf5(path, columns, attributes=None, root=None):
    """Columns as datasets; `attributes` of X, Y and Z, `root` of the file."""
    with h5py.File(path, "w") as file:
        file.attrs.update(root or {})
        for name, values in columns.items():
            file[name] = values
            if name in "XYZ":
                file[name].attrs.update(attributes or {})
    return path


def write_tdms(path, columns, properties=None):
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [nptdms.ChannelObject("g", n, v, properties or {}) for n, v in columns.items()]
        )
    return path


def write_parquet(path, columns, of_fields=None, of_file=None):
    fields = [
        pa.field(n, pa.from_numpy_dtype(v.dtype), metadata=of_fields if n in "XYZ" else None)
        for n, v in columns.items()
    ]
    schema = pa.schema(fields, metadata=of_file)
    pq.write_table(pa.table(list(columns.values()), schema=schema), path)
    return path


@pytest.mark.parametrize("kind", ["hdf5", "parquet"])
@pytest.mark.parametrize(("scale", "offset"), [(0.25, 0.0), (0.125, 500.0), (-0.001, 20.0)])
def test_packed_integers_are_unpacked_and_the_fill_value_is_lost(tmp_path, kind, scale, offset):
    columns = five_columns()
    packed = dict(columns)
    for axis in "XYZ":
        counts = np.rint((columns[axis] - offset) / scale).astype("i4")
        columns[axis] = counts * scale + offset
        counts[LOST_ROWS] = -99999
        packed[axis] = counts
    attributes = {"scale_factor": scale, "add_offset": offset, "_FillValue": -99999}
    path = tmp_path / "r.dat"
    if kind == "hdf5":
        write_hdf5(path, packed, attributes)
    else:
        write_parquet(path, packed, {k: str(v) for k, v in attributes.items()})
    recording = load(path, five_setup())
    assert_plain(recording, columns, lost=LOST_ROWS)
    assert "attributes_applied" in codes(recording)
    raw = load(path, five_setup(attributes="setup", scale=dict.fromkeys("xyz", scale)))
    assert "attributes_put_aside" in codes(raw)
    assert "scale_factor" in sentences(raw)
    np.testing.assert_allclose(raw.positions_nm["b1"][7], scale * -99999)


def test_values_out_of_the_valid_range_are_lost(tmp_path):
    columns = five_columns()
    wrong = {k: v.copy() for k, v in columns.items()}
    for axis in "XYZ":
        wrong[axis][LOST_ROWS] = [-5e6, 5e6, 1e9]
    path = write_hdf5(tmp_path / "r.h5", wrong, {"valid_range": [-1e5, 1e5]})
    assert_plain(load(path, five_setup()), columns, lost=LOST_ROWS)


def test_cells_that_were_never_written_are_lost(tmp_path):
    columns = five_columns()
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values, fillvalue=-7777.0)
        for axis in "XYZ":
            file[axis][300:] = -7777.0
    lost = list(range(300, N))
    assert_plain(load(tmp_path / "r.h5", five_setup()), columns, lost=lost)


@pytest.mark.parametrize(
    ("name", "value"), [("gain", 2.5), ("offset", 100.0), ("calibration_factor", 64.6)]
)
def test_an_attribute_without_agreed_meaning_is_refused_by_name(tmp_path, name, value):
    columns = five_columns()
    path = write_hdf5(tmp_path / "r.h5", columns, {name: value})
    with pytest.raises(RecordingError, match=f"attribute {name} = {value:g}") as caught:
        load(path, five_setup())
    assert 'attributes = "setup"' in caught.value.mend
    assert_plain(load(path, five_setup(attributes="setup")), columns)
    neutral = {"gain": 1.0, "offset": 0.0, "calibration_factor": 1.0}
    assert_plain(load(write_hdf5(path, columns, neutral), five_setup()), columns)


def with_units(path, kind, columns, unit):
    """The columns in a file that says of X, Y and Z in what unit they are."""
    if kind == "hdf5":
        return write_hdf5(path, columns, {"units": unit})
    if kind == "parquet":
        return write_parquet(path, columns, {"unit": unit})
    if kind == "tdms":
        channels = [
            nptdms.ChannelObject("g", n, v, {"unit_string": unit} if n in "XYZ" else {})
            for n, v in columns.items()
        ]
        with nptdms.TdmsWriter(path) as writer:
            writer.write_segment(channels)
        return path
    rows = [",".join(f"{v:.9f}" for v in row) for row in zip(*columns.values(), strict=True)]
    return write(path, [",".join(columns), f"s,mm,{unit},{unit},{unit}", *rows])


CARRIERS = ["hdf5", "tdms", "parquet", "units row"]


@pytest.mark.parametrize("kind", CARRIERS)
@pytest.mark.parametrize("unit", ["um", "µm", "[Micrometers]", "mm", "cm"])
def test_a_unit_that_no_bead_can_have_is_told_and_the_setup_s_taken(tmp_path, kind, unit):
    columns = five_columns()
    path = with_units(tmp_path / "r.dat", kind, columns, unit)
    recording = load(path, five_setup())
    assert_plain(recording, columns)
    (said,) = [n for n in recording.notices if n.code == "unit_contradicts"]
    assert said.severity == "caution"
    assert "X, Y, Z would be in" in said.message
    assert "by the setup in nm" in said.message
    aside = load(path, five_setup(attributes="setup"))
    assert_plain(aside, columns)
    assert "attributes_put_aside" in codes(aside)


@pytest.mark.parametrize("kind", CARRIERS)
@pytest.mark.parametrize(
    ("setup", "unit", "factor"),
    [
        ("um", "nm", 1.0),  # the setup is wrong
        ("nm", "um", 1e-3),
        ("nm", "um", 0.05),  # beads move by 1.5 nm or 1.5 µm: who knows
        ("nm", "angstrom", 1.0),
        ("nm", "px", 1.0),
    ],
)
def test_a_unit_that_contradicts_the_setup_is_an_error(tmp_path, kind, setup, unit, factor):
    columns = five_columns()
    written = columns | {axis: columns[axis] * factor for axis in "XYZ"}
    path = with_units(tmp_path / "r.dat", kind, written, unit)
    with pytest.raises(RecordingError, match=r"column X \(b1 x\) is in .* by the file") as caught:
        load(path, five_setup(units={"position": setup}))
    assert f"in {setup} by the setup" in caught.value.message
    scale = dict.fromkeys("xyz", 1 / factor)
    aside = five_setup(units={"position": "nm"}, attributes="setup", scale=scale)
    assert_plain(load(path, aside), columns)


def test_stamps_tell_the_unit_of_time_and_nothing_that_of_magnets(tmp_path):
    columns = five_columns()
    path = write_hdf5(tmp_path / "r.h5", columns)
    with h5py.File(path, "a") as file:
        file["Time"].attrs["units"] = "ms"
    recording = load(path, five_setup())
    assert_plain(recording, columns)
    assert "unit_contradicts" in codes(recording)
    with pytest.raises(RecordingError, match=r"column Time \(time\) is in ms by the file"):
        load(path, five_setup(rate="unknown"))
    with h5py.File(path, "a") as file:
        del file["Time"].attrs["units"]
        file["Magnet"].attrs["units"] = "um"
    with pytest.raises(RecordingError, match=r"column Magnet \(magnet\) is in um by the file"):
        load(path, five_setup())


def test_an_unknown_unit_is_the_file_s_own(tmp_path):
    columns = five_columns()
    written = columns | {axis: columns[axis] / 1000 for axis in "XYZ"}
    setup = five_setup(units={"position": "unknown"})
    recording = load(write_hdf5(tmp_path / "r.h5", written, {"units": "µm"}), setup)
    assert_plain(recording, columns)
    assert "unit_derived" in codes(recording)
    for unit, told in (("furlong", "'furlong'"), ("", "nothing"), ("ms", "'ms'")):
        with pytest.raises(SetupError, match=f'x is "unknown", .* the file says {told}'):
            load(write_hdf5(tmp_path / "r.h5", written, {"units": unit}), setup)


def test_a_unit_cannot_be_unknown_and_put_aside():
    with pytest.raises(SetupError, match="puts the file's aside"):
        five_setup(units={"position": "unknown"}, attributes="setup")


def test_a_unit_that_agrees_or_says_nothing_is_no_error(tmp_path):
    columns = five_columns()
    for unit in ("nm", "nanometre", "(nm)", "a.u."):
        recording = load(write_hdf5(tmp_path / "r.h5", columns, {"units": unit}), five_setup())
        assert_plain(recording, columns)
        assert ("unit_not_known" in codes(recording)) == (unit == "a.u.")


def test_a_unit_in_a_name_is_only_a_caution(tmp_path):
    columns = five_columns()
    rows = [",".join(f"{v:.4f}" for v in row) for row in zip(*columns.values(), strict=True)]
    names = ("Time (s)", "Magnet (mm)", "X (µm)", "Y [nm]", "Z (nm)")
    path = write(tmp_path / "r.csv", [",".join(names), *rows])
    recording = load(path, five_setup(names))
    assert_plain(recording, columns)
    assert "column X (µm)" in sentences(recording).replace("Column", "column")
    assert [n.severity for n in recording.notices if n.code == "unit_contradicts"] == ["caution"]


def rated(path, kind, columns, words):
    """The plain recording whose file states the rate in one of the usual ways."""
    if kind == "tdms":
        write_tdms(path, columns, words)
    elif kind == "hdf5 column":
        write_hdf5(path, columns, words)
    elif kind == "hdf5 file":
        write_hdf5(path, columns, root=words)
    elif kind == "parquet":
        write_parquet(path, columns, of_file={k: str(v) for k, v in words.items()})
    else:
        frame = pd.DataFrame(columns)
        frame.attrs = words
        frame.to_parquet(path)
    return path


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("tdms", {"wf_increment": 0.01, "wf_start_offset": 0.0}),
        ("hdf5 column", {"frame_rate": 100.0}),
        ("hdf5 file", {"Frame rate (Hz)": 100}),
        ("hdf5 file", {"dt_ms": 10.0}),
        ("hdf5 file", {"Sampling freq": "0,1 kHz"}),
        ("hdf5 column", {"period": "10 ms"}),
        ("tdms", {"Rate": "100 fps"}),
        ("parquet", {"fps": 100.0}),
        ("pandas", {"frame_rate_hz": 100.0}),
    ],
)
def test_a_rate_is_taken_where_it_is_unknown_and_refused_where_it_contradicts(
    tmp_path, kind, words
):
    columns = five_columns()
    path = rated(tmp_path / "r.dat", kind, columns, words)
    recording = load(path, five_setup(rate="unknown", time=False))
    assert_plain(recording, columns)
    assert "was taken from the file" in sentences(recording)
    for rate in (50.0, 101.0, 120.0):
        with pytest.raises(RecordingError, match=f"setup says {rate:g} .*file says 100"):
            load(path, five_setup(rate=rate, time=False))
    assert load(path, five_setup(rate=100.4, time=False)).setup.camera.frame_rate_hz.value == 100.4
    aside = load(path, five_setup(rate=120.0, time=False, attributes="setup"))
    assert aside.setup.camera.frame_rate_hz.value == 120.0
    assert "attributes_put_aside" in codes(aside)


def within(group, columns):
    return {f"{group}/{name}": values for name, values in columns.items()}


def single_in_hdf5(path, name, value, unit="", group=""):
    with h5py.File(path, "w") as file:
        for column, values in five_columns().items():
            file[f"{group}/{column}"] = values
        file[name] = value
        file[name].attrs["units"] = unit


def attribute_of_a_group(path):
    write_hdf5(path, within("tracks", five_columns()))
    with h5py.File(path, "a") as file:
        file.create_group("camera").attrs["fps"] = 100


def struct_in_matlab_7_3(path):
    """As MATLAB writes `data.fps = '100 Hz'`: a group, and text as numbers."""
    write_hdf5(path, within("data", five_columns()))
    with h5py.File(path, "a") as file:
        file["data"].attrs["MATLAB_class"] = np.bytes_("struct")
        file["data/fps"] = np.frombuffer("100 Hz".encode("utf-16-le"), "u2")[:, None]
        file["data/fps"].attrs["MATLAB_class"] = np.bytes_("char")


def archive(path, **arrays):
    with path.open("wb") as stream:
        np.savez(stream, **arrays)


FPS = np.dtype([("fps", "f8"), ("camera", "S1")])
SINGLES = {
    "scalar": lambda p: single_in_hdf5(p, "frame_rate", 100.0),
    "array of one": lambda p: single_in_hdf5(p, "fps", [[100]]),
    "text": lambda p: single_in_hdf5(p, "Sampling frequency", "0.1 kHz"),
    "record": lambda p: single_in_hdf5(p, "info", np.array((100.0, b"a"), "f8,S1").view(FPS)[()]),
    "unit beside": lambda p: single_in_hdf5(p, "info/camera/frame_interval", 10.0, "ms"),
    "other group": lambda p: single_in_hdf5(p, "meta/dt", 0.01, "s", "tracks/bead"),
    "group above": lambda p: single_in_hdf5(p, "tracks/fps", 100.0, "frames/s", "tracks/bead"),
    "group's attribute": attribute_of_a_group,
    "matlab 7.3": struct_in_matlab_7_3,
    "matlab": lambda p: savemat(p, {**five_columns(), "frameRate": 100}),
    "matlab struct": lambda p: savemat(p, {"data": {**five_columns(), "fps": 100.0}}),
    "matlab text": lambda p: savemat(p, {"data": five_columns(), "cam": {"fps": "100 Hz"}}),
    "matlab 4": lambda p: savemat(p, {**five_columns(), "dt": 0.01}, format="4"),
    "numpy": lambda p: archive(p, frame_rate_hz=np.array([100.0]), **five_columns()),
}


PLACES = {
    "other group": "tracks/bead/", "group above": "tracks/bead/", "group's attribute": "tracks/",
    "matlab struct": "data/", "matlab text": "data/", "matlab 7.3": "data/",
}  # fmt: skip


@pytest.mark.parametrize("way", SINGLES)
def test_a_rate_in_a_single_value_is_that_of_the_columns(tmp_path, way):
    path = tmp_path / "r.dat"
    SINGLES[way](path)
    place = PLACES.get(way, "")
    bead = {"name": "b1"} | {axis: f"{place}{axis.upper()}" for axis in "xyz"}
    named = {"beads": bead, "magnet": {"column": f"{place}Magnet", "unit": "mm"}, "time": False}
    recording = load(path, five_setup(rate="unknown", **named))
    assert_plain(recording, five_columns())
    assert "100 Hz, was taken from the file" in sentences(recording)
    for rate in (50.0, 120.0):
        with pytest.raises(RecordingError, match=f"setup says {rate:g} .*file says 100"):
            load(path, five_setup(rate=rate, **named))
    aside = load(path, five_setup(rate=120.0, attributes="setup", **named))
    assert aside.setup.camera.frame_rate_hz.value == 120.0


def test_rates_of_one_place_have_to_agree_and_the_nearest_counts(tmp_path):
    path = tmp_path / "r.h5"
    single_in_hdf5(path, "fps", 100.0)
    with h5py.File(path, "a") as file:
        file["magnet/position"] = np.zeros(3)
        file["magnet/fps"] = 20.0  # of the magnet's own log
        file["frame_interval_ms"] = 10.0
    assert_plain(load(path, five_setup(rate="unknown", time=False)), five_columns())
    with h5py.File(path, "a") as file:
        file.attrs["frame_rate"] = 60.0
    with pytest.raises(RecordingError, match=r"contradict themselves: frame_rate .* 60 .*fps"):
        load(path, five_setup(rate=100.0, time=False))
    assert_plain(load(path, five_setup(time=False, attributes="setup")), five_columns())


def test_stamps_that_contradict_the_file_s_own_rate_are_an_error(tmp_path):
    path = rated(tmp_path / "r.tdms", "tdms", five_columns(), {"wf_increment": 0.02})
    with pytest.raises(RecordingError, match=r"time stamps say 100 .*file says 50"):
        load(path, five_setup(rate="unknown"))
    with pytest.raises(RecordingError, match=r"setup says 100 .*file says 50"):
        load(path, five_setup())


def test_a_second_between_frames_is_a_placeholder(tmp_path):
    columns = five_columns()
    path = rated(tmp_path / "r.tdms", "tdms", columns, {"wf_increment": 1.0})
    recording = load(path, five_setup(time=False))
    assert_plain(recording, columns)
    assert "rate_placeholder" in codes(recording)
    with pytest.raises(RecordingError, match="frame rate is unknown"):
        load(path, five_setup(time=False, rate="unknown"))


def test_waveforms_that_begin_later_or_at_different_times(tmp_path):
    columns = five_columns()
    path = rated(
        tmp_path / "r.tdms", "tdms", columns, {"wf_increment": 0.01, "wf_start_offset": 2.5}
    )
    recording = load(path, five_setup(time=False, rate="unknown"))
    np.testing.assert_allclose(recording.time_s, columns["Time"] + 2.5)
    channels = [
        nptdms.ChannelObject("g", n, v, {"wf_start_offset": 0.5 * (n == "Z")})
        for n, v in columns.items()
    ]
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(channels)
    with pytest.raises(RecordingError, match=r"begin at different times.*Z at 0\.5 s"):
        load(path, five_setup(time=False))


def test_scaling_of_ni_is_applied_and_an_unknown_one_refused(tmp_path):
    columns = five_columns()
    scaled = {
        "NI_Number_Of_Scales": 1,
        "NI_Scale[0]_Scale_Type": "Linear",
        "NI_Scale[0]_Linear_Slope": 0.25,
        "NI_Scale[0]_Linear_Y_Intercept": 10.0,
        "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
    }
    for scale_type in ("Linear", "Sinusoid"):
        channels = []
        for name, values in columns.items():
            if name in "XYZ":
                counts = np.rint((values - 10) / 0.25).astype("i4")
                columns[name] = counts * 0.25 + 10
                words = scaled | {"NI_Scale[0]_Scale_Type": scale_type}
                channels.append(nptdms.ChannelObject("g", name, counts, words))
            else:
                channels.append(nptdms.ChannelObject("g", name, values))
        with nptdms.TdmsWriter(tmp_path / "r.tdms") as writer:
            writer.write_segment(channels)
        if scale_type == "Linear":
            assert_plain(load(tmp_path / "r.tdms", five_setup()), columns)
        else:
            with pytest.raises(RecordingError, match="scale of NI's, Sinusoid"):
                load(tmp_path / "r.tdms", five_setup())


def test_attributes_with_a_value_for_each_column(tmp_path):
    columns = five_columns()
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["all"] = np.column_stack(list(columns.values())) / [1, 1, 2, 2, 2]
        file["all"].attrs["units"] = ["s", "mm", "nm", "nm", "nm"]
        file["all"].attrs["scale_factor"] = [1.0, 1.0, 2.0, 2.0, 2.0]
    names = tuple(f"all[{k}]" for k in range(1, 6))
    assert_plain(load(tmp_path / "r.h5", five_setup(names)), columns)
    with pytest.raises(RecordingError, match=r"all\[3\] \(b1 x\) is in nm by the file"):
        load(tmp_path / "r.h5", five_setup(names, units={"position": "um"}))


@pytest.mark.parametrize("rate", [1e9, 2e6, 1e-3, 0.05])
def test_a_rate_of_no_camera_is_refused(rate):
    with pytest.raises(SetupError, match=r"frame_rate_hz = .* is not between 0\.1 and 1e\+06 Hz"):
        five_setup(rate=rate)


def test_units_as_they_are_written():
    told = [
        "µm",
        "μm",
        "um",
        "[um]",
        "Micrometers",
        "microns",
        " nm ",
        "milliseconds since 2024-1-1",
    ]
    assert [unit_of(one) for one in told] == [*["um"] * 6, "nm", "ms"]
    assert [unit_of(one) for one in ("V", "", "furlong")] == [None] * 3
    assert [unit_in_name(one) for one in ("X (µm)", "X [nm]", "X (left)", "X")] == [
        "µm", "nm", "", ""
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["units", "Einheit", "unité", "unidad", "Unità", "eenheid"])
def test_units_are_said_in_the_languages_that_laboratories_write(name):
    assert stated_by({name: "µm"}).unit == "µm"


@pytest.mark.parametrize(
    ("written", "unit"), [("omwentelingen", "turn"), ("Secondi", "s"), ("[Grad]", "degree")]
)
def test_units_are_written_out_in_these_languages(written, unit):
    assert unit_of(written) == unit


def test_attributes_of_any_type_raise_nothing():
    odd = {
        "units": b"nm", "scale_factor": np.array([[2.0]]), "dt": "soon", "fps": np.nan, "x": None,
        "valid_range": "all", "_FillValue": np.array(["a", "b"]), "framerate": -1, "unit": 5,
        "title": object(), "add_offset": True,
    }  # fmt: skip
    stated = stated_by(odd)
    assert (stated.unit, stated.scale, stated.rate_hz, stated.lost) == ("nm", 2.0, None, ())
