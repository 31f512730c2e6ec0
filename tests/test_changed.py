"""Descriptions with other values: as `dataclasses.replace` makes them, checks included."""

import dataclasses

import pytest

from mtpipe.experiment.changed import changed
from mtpipe.experiment.description import Line, Optics, Stage
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.physics.camera import Camera
from tests.small_case import setup


def test_it_is_what_replace_makes():
    experiment, _ = experiment_of(setup(), (1.0, 4.0), 100)
    for one, values in (
        (experiment, {"along": 1, "rests": ()}),
        (experiment.bead, {"offset_nm": 12.0}),
        (experiment.stage, {"lines": (Line(3.0, (1.0, 0.0, 0.0)),)}),
        (experiment.chain, {"temperature_K": 300.0}),
    ):
        other = changed(one, **values)
        assert other == dataclasses.replace(one, **values)
        assert hash(other) == hash(dataclasses.replace(one, **values))
        assert other != one


def test_what_was_worked_out_of_old_values_is_not_kept():
    optics = Optics()
    assert optics.matrix[0, 0] == 1.0
    assert changed(optics, lateral_scale=2.0).matrix[0, 0] == 2.0


def test_values_are_checked_and_fields_known():
    with pytest.raises(ValueError, match="exposure"):
        changed(Camera(0.01, 0.005), exposure_s=0.02)
    with pytest.raises(TypeError):
        changed(Stage(), nothing=1)
