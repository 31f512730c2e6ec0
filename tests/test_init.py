"""`mtpipe init`: a setup proposed for a laboratory's files, read by the readers as any setup."""

import dataclasses
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

import mtpipe
from mtpipe.cli.commands import app
from mtpipe.ground.errors import NoSetupError, RecordingError, SetupError
from mtpipe.ingest import load
from mtpipe.proposal.bead_columns import names_of
from mtpipe.proposal.magnet_log import clock_offset
from mtpipe.proposal.proposal import checked, propose
from mtpipe.proposal.questions import as_setup_part, parsed
from mtpipe.proposal.rest import rest_of
from mtpipe.proposal.surface import surface_of
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.setup.setup import parse_setup, read_setup
from mtpipe.setup.source_signals import ZZero
from mtpipe.setup.tables import Plateaus
from mtpipe.tracking.scan import table_from_scan
from tests.laboratory_files import LENGTH_NM, LOG_BEFORE_S, RATE, Laboratory
from tests.simulated import setup_content
from tests.stack_images import draw
from tests.test_ingest_presets import WITHOUT_CLOCK, WRITERS

pytestmark = pytest.mark.slow

SAMPLE = Path(__file__).parents[1] / "sample_data" / "laboratory_text"
SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="module")
def laboratory():
    return Laboratory()


def proposed(folder, answers=None, name=None):
    """The proposal of a folder or a file in it, written, and the recording read with it."""
    setup = folder / "setup.toml"
    paths = [folder if name is None else folder / name]
    proposal = propose(paths, setup, answers=as_setup_part(answers or {}, "answers"))
    setup.write_text(proposal.text, encoding="utf-8")
    return proposal, load(setup)


def test_german_text_with_its_own_magnet_log(laboratory, tmp_path):
    laboratory.german(tmp_path)
    proposal, recording = proposed(tmp_path, name="Messung 12.txt")
    laboratory.holds(recording, {"ref": "ref", "kugel1": "b1", "kugel2": "b2"})
    assert recording.references == ("ref",)
    assert recording.setup.camera.frame_rate_hz.value == RATE  # "Bildrate: 100 Hz"
    assert recording.setup.camera.exposure_s.value == pytest.approx(0.008)
    assert recording.setup.source.magnet.file == "Motor 12.txt"
    # the log's clock began 33.4 s later; the beads tell it
    assert recording.setup.source.magnet.clock_offset_s == pytest.approx(33.4, abs=1.0)
    assert any("clock_offset_s" in guess for guess in proposal.guesses)
    laboratory.rests(recording)


@pytest.mark.parametrize("shift", [0.0, 0.004])
@pytest.mark.parametrize("step_s", [0.01, 0.1, 0.25])
def test_a_motor_that_scatters_at_rest_has_one_rest_for_each_place(step_s, shift):
    """A log with few entries per second: their scatter was read from two of them, and rests split.

    Entries on frames and between them, and one for each frame.
    """
    random = np.random.default_rng(3)
    time_s = np.arange(26_000) / 104
    clock = np.arange(-2.0, 255.0, step_s) + shift
    places = np.array([8.87, 7.22, 5.54, 4.08, 3.14])
    magnet = places[np.clip(clock // 50, 0, 4).astype(int)] + random.normal(0, 0.003, len(clock))
    rest = rest_of(time_s, np.interp(time_s, clock, magnet.round(3)).round(7), log=True)
    plateaus = find_plateaus(time_s, np.interp(time_s, clock, magnet), Plateaus(**rest.choices))
    assert [round(one.magnet_mm, 1) for one in plateaus] == [8.9, 7.2, 5.5, 4.1, 3.1]


def test_rests_of_a_motor_without_scatter_need_no_tolerance():
    time_s = np.arange(8_000) / 104
    position = np.interp(time_s, *np.transpose(
        [(at + late, 9 - 0.1 * k) for k in range(16) for at, late in ((5 * k, 0.3), (5 * k, 4.9))]
    ))  # fmt: skip
    assert "tolerance_mm" not in rest_of(time_s, position, log=True).choices


def test_french_text_with_a_log_called_log(laboratory, tmp_path):
    laboratory.french(tmp_path)
    for name in ("manip_07.dat", None):  # the file, and its folder
        proposal, recording = proposed(tmp_path, name=name)
        laboratory.holds(recording, {"bille1": "ref", "bille2": "b1", "bille3": "b2"})
        assert recording.references == ("bille1",)
        assert recording.setup.camera.frame_rate_hz.value == RATE
        assert recording.setup.camera.exposure_s.value == pytest.approx(0.008)
        assert recording.setup.source.magnet.file == "manip_07_moteurs.log"
        laboratory.rests(recording)
        # z that may have to be corrected for refraction is told, and what nobody knows
        assert any(guess.startswith("source.scale.z") for guess in proposal.guesses)
        assert "beads.radius_nm" in proposal.unknown
        assert "camera.exposure_s" not in proposal.unknown


def test_spanish_text_with_a_log_in_times_of_day(laboratory, tmp_path):
    laboratory.spanish(tmp_path)
    _, recording = proposed(tmp_path)
    laboratory.holds(recording, {"b1": "ref", "b2": "b1", "b3": "b2"})
    assert recording.setup.camera.frame_rate_hz.value == RATE
    assert recording.setup.camera.exposure_s.value == pytest.approx(0.008)
    # the first frame is at 12 s, and 3 s after the log's first entry
    assert recording.setup.source.magnet.clock_offset_s == pytest.approx(9.0, abs=1.0)
    laboratory.rests(recording)


@pytest.mark.parametrize("clock", ["Tempo [s]", "Czas [s]"])
def test_italian_text_with_a_log_in_times_of_day(laboratory, tmp_path, clock):
    """A clock is known by its word, or in a language that is not known by values and unit."""
    laboratory.italian(tmp_path, clock)
    _, recording = proposed(tmp_path, name="misura_03.txt")
    laboratory.holds(recording, {"b2": "ref", "b1": "b1", "b3": "b2"})
    assert recording.references == ("b2",)
    assert recording.setup.source.time.column == clock
    assert recording.setup.camera.frame_rate_hz.value == RATE
    assert recording.setup.camera.exposure_s.value == pytest.approx(0.008)
    offset_s = recording.setup.source.magnet.clock_offset_s
    assert offset_s == pytest.approx(LOG_BEFORE_S, abs=1.0)
    (told,) = [notice.message for notice in recording.notices if notice.code == "log_clock"]
    assert f"first entry is taken to be at {offset_s:g} s of the recording" in told
    laboratory.rests(recording)


def test_hdf5_in_dutch(laboratory, tmp_path):
    """`eenheid` is a unit as `unit` is; so nothing about units is a guess."""
    laboratory.hdf5_in_dutch(tmp_path / "opname.h5")
    proposal, recording = proposed(tmp_path)
    laboratory.holds(recording, {"b1": "ref", "b2": "b1", "b3": "b2"})
    assert recording.setup.source.magnet.unit == "um"
    assert not [guess for guess in proposal.guesses if guess.startswith("source.units")]
    told = next(guess for guess in proposal.guesses if guess.startswith("source.magnet"))
    assert "unit as the file says" in told
    laboratory.rests(recording)


def test_matlab_in_dutch(laboratory, tmp_path):
    laboratory.dutch(tmp_path / "meting.mat")
    _, recording = proposed(tmp_path)
    laboratory.holds(recording, {"b1": "ref", "b2": "b1", "b3": "b2"})
    assert recording.setup.camera.pixel_size_nm.value == 93.5
    assert recording.setup.camera.exposure_s.value == pytest.approx(0.008)
    laboratory.rests(recording)


def staircase(at_s, dwell_s=20.0, steps=5):
    """Which of equally long dwells, one after the other, a time is in."""
    return np.clip(np.floor(at_s / dwell_s), 0, steps - 1)


@pytest.mark.parametrize("before_s", [0.0, 60.0])
def test_a_staircase_of_equal_steps_fits_one_step_later_too(before_s):
    """Its log is laid over all of the recording; if it is longer, both ways are told."""
    time_s = np.arange(0, 100, 0.02)
    random = np.random.default_rng(2)
    step = staircase(time_s)
    # what moves most and follows the magnets least comes first: without it they explain more
    heights = [900 + 60 * np.sqrt(step) + 300 / (1 + 4 * step) * random.normal(size=len(step))]
    log_s = np.arange(3.0 - before_s, 100.0 + before_s, 0.1)
    magnet = 8 - staircase(log_s + before_s, steps=20)
    found = clock_offset(log_s - 740.0, magnet, time_s, heights, related=False)
    if before_s == 0:
        assert found.seconds == pytest.approx(740.0, abs=1.0)
        assert found.rival is None
    else:
        assert found.rival is not None
        assert abs(found.rival - found.seconds) > 15


def test_no_magnets_are_told(laboratory, tmp_path):
    laboratory.french(tmp_path)
    (tmp_path / "manip_07_moteurs.log").unlink()
    proposal, _ = proposed(tmp_path)
    assert any("No positions of the magnets" in line for line in proposal.seen)


def test_the_surface_is_where_beads_lie_down(laboratory, tmp_path):
    laboratory.german(tmp_path)
    _, recording = proposed(tmp_path, name="Messung 12.txt")
    first, last = recording.setup.source.z_zero.touch_rows
    assert last <= laboratory.down_rows + RATE
    assert last - first > 0.6 * laboratory.down_rows
    z = recording.positions_nm["kugel1"][:, 2]
    assert np.nanmedian(z[-500:]) == pytest.approx(laboratory.height_nm[-1], abs=40)


def test_no_surface_where_no_bead_comes_down(laboratory, tmp_path):
    """Recordings at high force alone have no stretch to take z = 0 from."""
    rows = slice(laboratory.rows_of(-1), None)
    laboratory.columns(tmp_path / "r.csv", rows)
    _, recording = proposed(tmp_path)
    assert recording.setup.source.z_zero.touch_rows is None


def test_one_file_for_each_bead(laboratory, tmp_path):
    laboratory.per_bead(tmp_path)
    _, recording = proposed(tmp_path)
    laboratory.holds(recording, {"ref1": "ref", "bead1": "b1", "bead2": "b2"})
    assert recording.references == ("ref1",)
    laboratory.rests(recording)


def test_files_of_beads_have_to_be_of_one_recording(laboratory, tmp_path):
    laboratory.per_bead(tmp_path)
    proposed(tmp_path)
    text = (tmp_path / "bead2.txt").read_text().splitlines()
    (tmp_path / "bead2.txt").write_text("\n".join(text[:-5]) + "\n")
    with pytest.raises(RecordingError, match=r"same rows; they have bead1.txt: \d+, bead2.txt"):
        load(tmp_path / "setup.toml")


@pytest.mark.parametrize("axes_first", [False, True])
def test_hdf5_with_an_array_of_three_axes(laboratory, tmp_path, axes_first):
    laboratory.hdf5(tmp_path / "run7.h5", axes_first=axes_first)
    _, recording = proposed(tmp_path)
    laboratory.holds(recording, {"b1": "ref", "b2": "b1", "b3": "b2"})
    assert recording.references == ("b1",)  # by its motion
    laboratory.rests(recording)


def test_hdf5_with_a_group_for_each_bead(laboratory, tmp_path):
    """Each bead has an array in a group with its number; an attribute says the exposure."""
    path = tmp_path / "chan4.h5"
    laboratory.hdf5_by_bead(path)
    _, recording = proposed(tmp_path, name=path.name)
    laboratory.holds(recording, {"b00": "ref", "b01": "b1", "b02": "b2"})
    assert recording.references == ("b00",)
    assert recording.setup.camera.exposure_s.value == pytest.approx(0.008)
    laboratory.rests(recording)


def test_hdf5_with_x_and_y_apart_from_z(laboratory, tmp_path):
    path = tmp_path / "s3_run4.h5"
    laboratory.hdf5_height_apart(path)
    _, recording = proposed(tmp_path, name=path.name)
    laboratory.holds(recording, {"particle00": "ref", "particle01": "b1", "particle02": "b2"})
    assert recording.references == ("particle00",)
    assert recording.setup.camera.pixel_size_nm.value == 100.0
    laboratory.rests(recording)


def test_heights_alone_are_not_done(laboratory, tmp_path):
    np.savetxt(
        tmp_path / "z.csv",
        np.column_stack([laboratory.time_s, laboratory.positions_nm["b1"][:, 2]]),
        delimiter=",", header="time,b1_z", comments="",
    )  # fmt: skip
    setup = tmp_path / "setup.toml"
    setup.write_text(propose([tmp_path], setup).text, encoding="utf-8")
    with pytest.raises(RecordingError, match="x and y of b1 were not found"):
        checked(setup, None)


def test_files_of_beads_without_a_clock(laboratory, tmp_path):
    """They have nothing to compare but their rows."""
    for name, bead in (("ref1", "ref"), ("bead1", "b1")):
        np.savetxt(tmp_path / f"{name}.txt", laboratory.positions_nm[bead], header="x y z")
    _, recording = proposed(tmp_path, {"frame_rate_hz": RATE})
    assert set(recording.positions_nm) == {"ref1", "bead1"}


def test_a_log_in_times_of_day_is_set_right_by_the_beads(laboratory, tmp_path):
    """Its first entry is before the recording's first frame: the two do not begin together."""
    laboratory.german(tmp_path, log_in_times_of_day=True)
    proposal, recording = proposed(tmp_path, name="Messung 12.txt")
    assert recording.setup.source.magnet.clock_offset_s == pytest.approx(LOG_BEFORE_S, abs=1.0)
    assert any("clock_offset_s" in guess for guess in proposal.guesses)
    laboratory.rests(recording)


def test_a_stated_length_speaks_against_a_touch(laboratory, tmp_path):
    """A chain far shorter than the tether is known to be is no sign that beads lie down."""
    laboratory.german(tmp_path)
    answers = {"contour_length_nm": 3 * LENGTH_NM}
    _, recording = proposed(tmp_path, answers, name="Messung 12.txt")
    assert recording.setup.source.z_zero.touch_rows is None


def test_a_lone_bead_touches_only_if_its_length_is_known(laboratory, tmp_path):
    """Nothing else speaks against a touch that is none: z = 0 would be wrong in silence."""
    laboratory.german(tmp_path)
    _, recording = proposed(tmp_path, name="Messung 12.txt")
    kept = {bead: recording.positions_nm[bead] for bead in ("ref", "kugel1")}
    alone = dataclasses.replace(recording, positions_nm=kept)
    assert surface_of(alone, (), LENGTH_NM).touch is not None
    unknown = surface_of(alone, ())
    assert unknown.touch is None
    assert "may be down in rows 1 to" in unknown.why
    assert "tether.contour_length_nm" in unknown.why


def test_tdms_with_a_group_for_the_motor(laboratory, tmp_path):
    laboratory.tdms(tmp_path / "exp.tdms")
    _, recording = proposed(tmp_path)
    laboratory.holds(recording, {"b0": "ref", "b1": "b1", "b2": "b2"})
    assert recording.setup.source.magnet.column == "Motor/Magnet (mm)"
    laboratory.rests(recording)


def test_numbers_without_names(laboratory, tmp_path):
    """Frame, time in ms, magnet, rotation, then pixels and µm; -1 means lost."""
    laboratory.plain(tmp_path / "data001.txt")
    _, recording = proposed(tmp_path, {"pixel_size_nm": 100.0})
    laboratory.holds(recording, {"b1": "ref", "b2": "b1", "b3": "b2"})
    assert recording.setup.source.units.x == "pixel"
    assert recording.setup.source.lost.values == (-1.0,)
    laboratory.rests(recording)


def test_series_whose_clock_begins_anew(laboratory, tmp_path):
    laboratory.series(tmp_path)
    _, recording = proposed(tmp_path)
    laboratory.holds(recording, {"ref": "ref", "b1": "b1", "b2": "b2"})
    assert recording.setup.source.time.restarts


def test_recordings_that_do_not_go_on_are_not_joined(laboratory, tmp_path):
    laboratory.columns(tmp_path / "r0.csv", slice(0, 1500))
    lines = (tmp_path / "r0.csv").read_text().splitlines()
    table = np.loadtxt(lines[1:], delimiter=",")
    table[:, 2:] += 9000.0  # other beads, at the same times
    np.savetxt(tmp_path / "r1.csv", table, "%.4f", ",", header=lines[0], comments="")
    with pytest.raises(RecordingError, match=r"recordings of their own.*Give one of them"):
        proposed(tmp_path)


@pytest.mark.parametrize("name", WRITERS)
def test_presets_are_found(tmp_path, name):
    WRITERS[name](tmp_path)
    rate = {"frame_rate_hz": 100.0} if name in WITHOUT_CLOCK else {}
    _, recording = proposed(tmp_path, {**rate, "minimum_s": 0.1, "pixel_size_nm": 80.0})
    assert recording.setup.source.preset == name
    assert np.isfinite(recording.positions_nm[recording.tethered[0]]).any()


def test_what_cannot_be_read_yet_is_written_all_the_same(laboratory, tmp_path):
    """A user who states a wrong unit has the rest of the setup, and is told."""
    laboratory.columns(tmp_path / "r.csv", slice(None))
    answers = tmp_path / "answers.toml"
    answers.write_text('source.units.position = "mm"\n')
    done = run(tmp_path / "r.csv", "--answers", answers)
    assert done.exit_code == 1
    assert "it is not tethered, or not in nm" in done.output
    text = (tmp_path / "setup.toml").read_text()
    assert 'units = { position = "mm" }' in text
    assert 'time = { column = "time"' in text


def test_a_run_without_a_setup_points_to_init(laboratory, tmp_path):
    laboratory.columns(tmp_path / "r.csv", slice(None))
    with pytest.raises(NoSetupError, match="mtpipe init"):
        load(tmp_path / "r.csv")


def test_a_missing_column_lists_what_is_there(laboratory, tmp_path):
    laboratory.columns(tmp_path / "r.csv", slice(None))
    proposed(tmp_path)
    text = (tmp_path / "setup.toml").read_text()
    (tmp_path / "setup.toml").write_text(text.replace('column = "motor"', 'column = "moter"'))
    with pytest.raises(RecordingError, match=r"Did you mean motor\? There are: time, motor, r"):
        load(tmp_path / "setup.toml")


def test_long_tables_are_told(tmp_path):
    lines = ["frame,particle,x,y"]
    lines += [f"{k},{bead},{k % 7},{k % 5}" for k in range(300) for bead in (0, 1, 2)]
    (tmp_path / "tracks.csv").write_text("\n".join(lines))
    with pytest.raises(RecordingError, match="a row for each bead in each frame"):
        proposed(tmp_path)


def test_answers_stand_and_nothing_is_guessed_over_them(laboratory, tmp_path):
    laboratory.columns(tmp_path / "r.csv", slice(None))
    answers = {
        "radius_nm": 525.0,
        "beads": {"reference": []},
        "source": {"z_zero": {"value_nm": 7.0}},
    }
    _, recording = proposed(tmp_path, answers)
    assert recording.setup.beads.radius_nm.value == 525.0
    assert recording.references == ()
    assert recording.setup.source.z_zero.value_nm == 7.0


def test_what_nobody_answers_is_usual_or_unknown_and_says_so(laboratory, tmp_path):
    laboratory.columns(tmp_path / "r.csv", slice(None))
    proposal, recording = proposed(tmp_path)
    line = next(x for x in proposal.text.splitlines() if x.startswith("persistence_length_nm"))
    assert "usual value, not measured: change it" in line
    for value in (recording.setup.camera.exposure_s, recording.setup.tether.contour_length_nm):
        assert not value.known


@pytest.mark.parametrize(
    ("owners", "names"),
    [
        ([("b", "1"), ("ref", "1")], ["b1", "ref1"]),
        ([("b", "1"), ("b", "2"), ("ref", "1")], ["b1", "b2", "ref1"]),
        ([("roi", "3", "bead", "1"), ("roi", "3", "bead", "2")], ["bead1", "bead2"]),
        ([("1",), ("2",)], ["b1", "b2"]),
    ],
)
def test_beads_have_the_numbers_of_their_columns(owners, names):
    assert names_of(owners) == names


def test_answers_of_a_person(laboratory, tmp_path):
    """Enter takes what stands in brackets; a wrong answer is asked again."""
    laboratory.columns(tmp_path / "r.csv", slice(None))
    said = iter(["sheep", "5 ms"])
    asked = []

    def ask(text, default):
        asked.append(text)
        return next(said) if "shutter" in text else default

    setup = tmp_path / "setup.toml"
    setup.write_text(propose([tmp_path], setup, ask=ask).text, encoding="utf-8")
    assert load(setup).setup.camera.exposure_s.value == pytest.approx(0.005)
    assert sum("shutter" in text for text in asked) == 2
    assert any("a number" in text and "'sheep'" in text for text in asked)


def test_answers_in_the_units_of_people():
    assert parsed("camera.exposure_s", "6,5 ms") == pytest.approx(0.0065)
    assert parsed("buffer.temperature_K", "22 °C") == pytest.approx(295.15)
    assert parsed("beads.reference", "ref1, ref2") == ["ref1", "ref2"]
    assert parsed("beads.radius_nm", "unknown") == "unknown"
    with pytest.raises(SetupError):
        parsed("field.direction", "z")
    told = as_setup_part({"temperature_K": "22 °C", "camera": {"exposure_s": "5 ms"}}, "answers")
    assert told["buffer"]["temperature_K"] == pytest.approx(295.15)
    assert told["camera"]["exposure_s"] == pytest.approx(0.005)
    with pytest.raises(SetupError, match="radius_nm: a number"):
        as_setup_part({"radius_nm": "sheep"}, "answers.toml")
    for wrong in ({"radius": 500.0}, {"beads": {"radius": 500.0}}):
        with pytest.raises(SetupError, match="Did you mean radius_nm"):
            as_setup_part(wrong, "answers.toml")


def run(*arguments):
    return CliRunner().invoke(app, ["init", *map(str, arguments)])


def test_the_command_writes_and_never_overwrites(laboratory, tmp_path):
    laboratory.columns(tmp_path / "r.csv", slice(None))
    done = run(tmp_path / "r.csv")
    assert done.exit_code == 0, done.output
    assert "mtpipe reads 2 tethered beads, 1 reference bead and" in done.output
    assert "beads.reference = [" in done.output
    assert "Next: mtpipe run" in done.output
    before = (tmp_path / "setup.toml").read_text()
    (tmp_path / "setup.toml").write_text(before + "# mine\n")
    refused = run(tmp_path / "r.csv")
    assert refused.exit_code == 2
    assert (tmp_path / "setup.toml").read_text().endswith("# mine\n")
    assert run(tmp_path / "r.csv", "--overwrite").exit_code == 0
    assert (tmp_path / "setup.toml").read_text() == before


def test_the_command_says_what_is_left(tmp_path):
    """The bundled text has no clock: without its frame rate the log's cannot be found."""
    for file in SAMPLE.iterdir():
        if file.suffix in (".gz", ".txt"):
            shutil.copy(file, tmp_path)
    done = run(tmp_path / "chip3_r012.txt.gz")
    assert done.exit_code == 1
    assert "Left for you:" in done.output
    assert "the frame rate is unknown" in done.output
    answers = tmp_path / "answers.toml"
    answers.write_text("frame_rate_hz = 150.0\npixel_size_nm = 108.3\nscale.z = 0.88\n")
    done = run(tmp_path / "chip3_r012.txt.gz", "--answers", answers, "--overwrite")
    assert done.exit_code == 0, done.output
    found, true = load(tmp_path / "setup.toml"), load(SAMPLE / "setup.toml")
    assert found.references == ("b1",)
    assert found.setup.source.magnet.clock_offset_s == pytest.approx(87.25, abs=1.0)
    for bead, other in (("b2", "b1"), ("b3", "b2")):
        away = found.positions_nm[bead] - true.positions_nm[other]
        assert np.nanmax(np.abs(away[:, :2])) < 0.01
        assert abs(np.nanmedian(away[:, 2])) < 15  # z = 0 from the same stretch


def test_film(tmp_path):
    random = np.random.default_rng(1)
    moving = (120 + random.normal(0, 0.8, 60), 40 + random.normal(0, 0.8, 60), 0.0)
    frames = draw((81, 162), [(40.0, 40.0, 0.0), moving])
    tifffile.imwrite(
        tmp_path / "film.tif", frames, imagej=True, metadata={"finterval": 0.01, "axes": "TYX"}
    )
    setup = tmp_path / "setup.toml"
    proposal = propose([tmp_path / "film.tif"], setup)
    setup.write_text(proposal.text, encoding="utf-8")
    assert "frame_rate_hz = 100.0" in proposal.text
    assert 'reference = ["bead1"]' in proposal.text
    assert checked(setup, proposal.film) == "the film"
    assert any("mtpipe lut" in line for line in proposal.seen)
    with pytest.raises(SetupError, match="this is a film"):
        propose([tmp_path / "film.tif"], setup, answers={"source": {"scale": {"z": 0.88}}})


def film_below(folder):
    """A folder of single images in the folder of the experiment, where the magnets' log lies."""
    random = np.random.default_rng(1)
    moving = (120 + random.normal(0, 0.8, 400), 40 + random.normal(0, 0.8, 400), 0.0)
    (folder / "Pos0").mkdir()
    for k, image in enumerate(draw((81, 162), [(40.0, 40.0, 0.0), moving])):
        tifffile.imwrite(folder / "Pos0" / f"img_{k:06}.tif", image)
    at = np.arange(8230.0, 28230.0, 100.0)
    magnet = np.where(at < 18230, 3.0, 1.0) + random.normal(0, 0.002, len(at))
    lines = [f"{t:.0f};{m:.4f}" for t, m in zip(at, magnet, strict=True)]
    (folder / "motors.log").write_text("\n".join(["elapsed_ms;magnet height (mm)", *lines, ""]))
    return as_setup_part({"frame_rate_hz": 20.0, "pixel_size_nm": 100.0}, "answers")


@pytest.mark.parametrize("given", [["."], ["Pos0", "motors.log"], ["Pos0"]])
def test_film_in_a_folder_below_the_log(tmp_path, given):
    answers = film_below(tmp_path)
    setup = tmp_path / "setup.toml"
    proposal = propose([tmp_path / name for name in given], setup, answers=answers)
    setup.write_text(proposal.text, encoding="utf-8")
    assert proposal.film == tmp_path / "Pos0"
    read = read_setup(setup)
    assert read.tracking.magnet.file == "motors.log"
    # the motor's noise is no move: without a tolerance no plateau would last
    assert 0.002 < read.plateaus.tolerance_mm < 0.1
    # two clocks that hardly overlap are taken to begin together
    assert read.tracking.magnet.clock_offset_s == pytest.approx(-8.23)
    assert any("mtpipe run checks it" in guess for guess in proposal.guesses)


def test_a_focus_scan_beside_a_film_is_not_taken_for_it(tmp_path):
    answers = film_below(tmp_path)
    tifffile.imwrite(tmp_path / "scan.tif", draw((81, 162), [(40.0, 40.0, np.arange(9.0))]))
    np.savetxt(tmp_path / "scan_z.csv", np.arange(400.0), header="z_um", comments="")
    with pytest.raises(RecordingError, match=r"several films or focus scans \(scan.tif, Pos0\)"):
        propose([tmp_path], tmp_path / "setup.toml", answers=answers)


def test_look_up_tables_are_no_recording(tmp_path):
    answers = film_below(tmp_path)
    heights = np.arange(-1000.0, 1000.0, 50.0)
    draw_at = [(40.0, 40.0, heights), (120.0, 40.0, heights)]
    scan, positions = tmp_path / "scan.tif", tmp_path / "positions.csv"
    tifffile.imwrite(scan, draw((81, 162), draw_at))
    positions.write_text("\n".join(["focus", *map(str, heights)]))
    with pytest.raises(RecordingError, match="Call the focus positions z_nm or z_um"):
        table_from_scan(scan, positions, refractive_index_factor=1.0, bead="bead1")
    positions.write_text("\n".join(["z_nm", *map(str, heights)]))
    for bead in ("bead1", "bead2"):
        table = table_from_scan(scan, positions, refractive_index_factor=1.0, bead=bead)
        table.save(tmp_path / f"{bead}.npz")
    for file in (scan, positions):
        file.unlink()
    proposal = propose([tmp_path], tmp_path / "setup.toml", answers=answers)
    assert proposal.film == tmp_path / "Pos0"
    assert 'look_up_table_of = { bead1 = "bead1.npz", bead2 = "bead2.npz" }' in proposal.text
    assert "one for each bead by its name" in proposal.text
    # only the beginning was seen: how to say where beads lie on the surface is a line to copy
    (line,) = [guess for guess in proposal.guesses if guess.startswith("source.z_zero")]
    table = tomllib.loads(line[line.index("z_zero = {", 1) :])["z_zero"]
    assert ZZero.model_validate(table).no_plateau
    (tmp_path / "bead1.npz").unlink()
    alone = propose([tmp_path / "Pos0"], tmp_path / "setup.toml", answers=answers)
    assert 'look_up_table = "bead2.npz"' in alone.text
    assert "of one bead, and beads differ" in alone.text


@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared is not beside this checkout")
@pytest.mark.parametrize(
    "case",
    ["excel_sep_line", "header_cp1252", "lost_word_padded", "matlab_struct", "numpy_npy",
     "pandas_hdf_table", "parquet_clock_time", "row_ends_with_delimiter", "scale_attribute",
     "tdms_clock_time_channel", "tdms_rate_unknown", "units_row_under_header", "utf16_with_mark"],
)  # fmt: skip
def test_files_of_many_kinds_are_read_as_their_setups_say(case, tmp_path):
    folder = SHARED / "cases" / "files" / case
    (file,) = (f for f in folder.iterdir() if f.stem == "rec")
    shutil.copy(file, tmp_path)
    _, recording = proposed(tmp_path)
    true = load(file)
    np.testing.assert_allclose(recording.positions_nm["b1"], true.positions_nm["b1"], atol=1e-6)
    np.testing.assert_allclose(recording.time_s, true.time_s, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_bead_that_hangs_low_does_not_touch_if_its_height_gives_the_stated_length(seed):
    """At 0.1 pN on 7 µm of DNA lateral variance is known to 15 %, which a touch may fit too."""
    setup = parse_setup(
        setup_content(
            beads={"radius_nm": 1400.0, "reference": ["ref1"]},
            tether={"contour_length_nm": 7000.0, "persistence_length_nm": 50.0},
        )
    )
    hanging = mtpipe.simulate(setup, [0.1, 0.3, 0.8, 2.0, 5.0], 8192, seed)
    assert surface_of(hanging, hanging.plateaus, 7000.0).touch is None
