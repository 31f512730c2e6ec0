"""The setup: what it accepts, and the sentence for each fault."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mtpipe.diagnosis.corrections.catalogue import REMEDIES
from mtpipe.effects.catalogue import OWN
from mtpipe.ground.errors import MtpipeError, NoSetupError, SetupError
from mtpipe.setup.setup import parse_setup, read_setup
from mtpipe.setup.tables import EFFECTS
from tests.simulated import setup_content
from tests.stack_images import setup_text


def test_standard_errors_and_unknowns():
    content = setup_content(
        beads={"radius_nm": 1400, "radius_nm_stderr": 30.0, "reference": ["r"]},
        tether={"contour_length_nm": "unknown", "persistence_length_nm": 50.0},
    )
    setup = parse_setup(content)
    assert setup.beads.radius_nm.value == 1400
    assert setup.beads.radius_nm.stderr == 30
    assert setup.beads.radius_nm.relative_stderr == pytest.approx(30 / 1400)
    assert not setup.tether.contour_length_nm.known
    assert setup.tether.persistence_length_nm.stderr == 0


def test_a_dumped_setup_reads_back_as_itself():
    camera = {"frame_rate_hz": 120.0, "exposure_s": "unknown", "pixel_size_nm": 64.6}
    setup = parse_setup(setup_content(camera=camera))
    assert parse_setup(setup.model_dump(mode="json", by_alias=True)) == setup


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"camera": {"frame_rate_hz": 120.0}}, ["camera.exposure_s", "missing", "unknown"]),
        ({"camera": {"frame_rate_hz": 120.0, "exposure_s": 0.02}}, ["longer than a frame"]),
        ({"camera": {"frame_rate_hz": -1.0, "exposure_s": 0.01}}, ["frame_rate_hz", "positive"]),
        ({"camera": {"frame_rate_hz": "fast", "exposure_s": 0.01}}, ["frame_rate_hz", "'fast'"]),
        (
            {"camera": {"frame_rate_hz": 1.0, "exposure_s": 0.5, "fps": 3}},
            ["camera.fps", "not a key"],
        ),
        ({"beads": {"radius_nm": 1.0, "radius_nm_stderr": -2.0}}, ["radius_nm_stderr", "-2.0"]),
        ({"buffer": {"temperature_K": 25.0, "viscosity_mPa_s": 1.0}}, ["25", "in K"]),
        ({"buffer": {"temperature_K": 298.0, "viscosity_mPa_s": 0.00089}}, ["0.00089", "mPa s"]),
        ({"beads": {"radius_nm": 1.4}}, ["radius_nm", "1.4", "unit"]),
        ({"beads": {"radius_nm": "unknown", "radius_nm_stderr": 5.0}}, ["radius_nm_stderr"]),
        ({"model": {"efects": ["wall_drag"]}}, ["efects", "effects?"]),
        ({"model": {"wal_drag": {"x": 1.0}}}, ["wal_drag", "wall_drag?"]),
        ({"field": {"direction": "z"}}, ["field.direction"]),
        ({"model": {"effects": ["wall_dragg"]}}, ["wall_dragg", "wall_drag?"]),
        ({"schema": 2}, ["schema"]),
        ({"drift": {"method": "highpass"}}, ["cutoff_hz"]),
        ({"drift": {"method": "reference", "cutoff_hz": -1.0}}, ["cutoff_hz", "positive"]),
        ({"plateaus": {"minimum_s": 0}}, ["plateaus.minimum_s"]),
        ({"magnet": [{"position_mm": 1.0}]}, ["magnet.0.force_pN", "missing"]),
        ({"magnet": {"position_mm": 1.0, "force_pN": 2.0}}, ["write [[magnet]] in place of"]),
        ({"beads": {"radius_nm": 500, "reference": "r"}}, ["reference] must be a list, as in"]),
        ({"field": "x"}, ["[field] must be a table", "got 'x'"]),
        ({"plateaus": {"minimum_s": "long"}}, ["must be a valid number, got 'long'"]),
        ({"tether": {"contour_length_nm": 2.7, "persistence_length_nm": 50.0}}, ["2.7", "unit"]),
        ({"tether": {"contour_length_nm": 2700, "persistence_length_nm": 0.05}}, ["0.05", "unit"]),
        (
            {"magnet": [{"position_mm": 3.0, "force_pN": f} for f in (4.1, 5.1)]},
            ["[[magnet]] gives the position 3 mm two forces, 4.1 and 5.1 pN"],
        ),
    ],
)  # fmt: skip
def test_faults_name_their_key(changes, words):
    with pytest.raises(SetupError) as caught:
        parse_setup(setup_content(**changes))
    for word in words:
        assert word in str(caught.value)
    assert "nput should" not in str(caught.value)


@pytest.mark.parametrize(
    ("table", "mend"), [("schema", "write schema = 1"), ("field", "[field] is missing")]
)
def test_what_is_missing_and_cannot_be_unknown_is_not_advised_to_be(table, mend):
    content = setup_content()
    del content[table]
    with pytest.raises(SetupError) as caught:
        parse_setup(content)
    assert mend in str(caught.value)
    assert "unknown" not in str(caught.value)


def test_one_force_may_stand_twice_and_chains_of_all_kinds_pass():
    magnets = [{"position_mm": 3.0, "force_pN": 4.1}, {"position_mm": 3.0, "force_pN": 4.1}]
    assert len(parse_setup(setup_content(magnet=magnets)).magnet) == 2
    for contour, persistence in ((50.0, 0.4), (10_000.0, 17_000.0), (100_000.0, 50.0)):
        tether = {"contour_length_nm": contour, "persistence_length_nm": persistence}
        assert parse_setup(setup_content(tether=tether)).tether.contour_length_nm.value == contour


def test_a_byte_order_mark_is_passed_over(tmp_path):
    plain, marked = tmp_path / "plain.toml", tmp_path / "marked.toml"
    plain.write_text(setup_text(), encoding="utf-8")
    marked.write_text(setup_text(), encoding="utf-8-sig")
    assert read_setup(marked) == read_setup(plain)


def test_no_setup_where_one_should_be_is_a_wrong_call(tmp_path):
    for path in (tmp_path / "setup.toml", tmp_path):
        with pytest.raises(NoSetupError):
            read_setup(path)


def test_exposure_rounded_to_a_tenth_of_a_percent_is_forgiven():
    setup = parse_setup(setup_content(camera={"frame_rate_hz": 120.0, "exposure_s": 0.0083340}))
    assert setup.camera.exposure_s.value == 0.0083340


def test_every_effect_of_the_contract_is_known():
    assert sorted(EFFECTS) == sorted([*(effect.name for effect in OWN), *REMEDIES])
    parse_setup(
        setup_content(model={"effects": list(EFFECTS), "vibration": {"frequency_hz": 50.0}})
    )


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"schema = ", "TOML"), (b"\xff\xfe", "cannot be read"), (None, "no such setup file")],
)
def test_unreadable_files_are_named(tmp_path, content, words):
    path = tmp_path / "setup.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SetupError, match=words) as caught:
        read_setup(path)
    assert "setup.toml" in str(caught.value)


SCALARS = st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5)
VALUES = (
    SCALARS
    | st.lists(SCALARS, max_size=2)
    | st.dictionaries(st.text(max_size=5), SCALARS, max_size=2)
)


@given(table=st.sampled_from(sorted(setup_content())), value=VALUES)
def test_any_nonsense_is_a_sentence(table, value):
    # anything but a SetupError escapes and fails
    with contextlib.suppress(SetupError):
        parse_setup(setup_content(**{table: value}))


def test_errors_read_as_sentences():
    error = MtpipeError("the file is empty", where="a.csv", mend="Export it again.")
    assert str(error) == "a.csv: the file is empty. Export it again."
    assert str(MtpipeError("nothing", where="a.csv")) == "a.csv: nothing"
