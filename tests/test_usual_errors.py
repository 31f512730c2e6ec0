"""Values that a setup states without an error: usual ones are taken, and said."""

import pytest

from mtpipe.joint_fit.parameters import stated_parameters
from mtpipe.setup.conditions import usual_errors
from mtpipe.setup.setup import parse_setup
from mtpipe.setup.usual_errors import exact

CONTENT = {
    "schema": 1,
    "camera": {"frame_rate_hz": 120.0, "exposure_s": 0.008, "pixel_size_nm": 100.0},
    "beads": {"radius_nm": 1400.0, "reference": ["ref1"]},
    "tether": {"contour_length_nm": 2700.0, "persistence_length_nm": 50.0},
    "buffer": {"temperature_K": 298.15, "viscosity_mPa_s": 0.89},
    "field": {"direction": "x"},
}


def test_a_value_without_an_error_has_the_usual_one():
    setup = parse_setup(CONTENT)
    assert setup.beads.radius_nm.stderr == pytest.approx(42.0)
    assert setup.buffer.viscosity_mPa_s.relative_stderr == pytest.approx(0.02)
    assert setup.buffer.temperature_K.stderr == 1.0
    assert setup.tether.contour_length_nm.relative_stderr == pytest.approx(0.01)
    assert setup.tether.persistence_length_nm.relative_stderr == pytest.approx(0.05)
    assert setup.camera.pixel_size_nm.relative_stderr == pytest.approx(0.01)
    assert setup.camera.exposure_s.relative_stderr == pytest.approx(0.01)
    free = {parameter.name for parameter in stated_parameters(setup)}
    assert {"ln bead radius", "ln viscosity", "ln contour length"} <= free


def test_what_is_stated_stands():
    setup = parse_setup(
        {**CONTENT, "beads": {"radius_nm": 1400.0, "radius_nm_stderr": 7.0, "reference": []}}
    )
    assert (setup.beads.radius_nm.stderr, setup.beads.radius_nm.usual) == (7.0, False)


def test_the_usual_errors_that_were_taken_are_one_sentence():
    (said,) = usual_errors(parse_setup(CONTENT))
    assert (said.code, said.severity) == ("usual_errors", "info")
    assert "bead radius 3%" in said.message
    assert "temperature 1 K" in said.message
    assert "frame rate" not in said.message


def test_an_exact_setup_has_none():
    setup = parse_setup(exact(CONTENT))
    assert usual_errors(setup) == []
    assert stated_parameters(setup) == ()


def test_what_is_unknown_has_no_usual_error():
    setup = parse_setup({**CONTENT, "beads": {"radius_nm": "unknown", "reference": []}})
    assert setup.beads.radius_nm.value is None
    assert not setup.beads.radius_nm.usual
