"""The noise to expect of a bead, from its images and the reference beads."""

import dataclasses
import math

import numpy as np
import pytest

import mtpipe
from mtpipe.calibration.noise_prior import expected_noise_nm
from mtpipe.recording.recording import Drift, ReferenceUse, Tracked
from mtpipe.setup.setup import parse_setup
from tests.stack_images import setup_text

NAN = math.nan


@pytest.fixture(scope="module")
def recording():
    import tomllib

    setup = parse_setup(tomllib.loads(setup_text(reference='"ref1"')))
    return mtpipe.simulate(setup, forces_pN=[1.0], frames=600, seed=1)


def drift(noise_nm, used=True):
    use = ReferenceUse("ref1", used, (1.0, 1.0, 1.0), noise_nm)
    none = (None, None, None)
    return Drift("reference", none, (use,), np.zeros((1, 3)), (0.0,) * 3, (0.0,) * 3, (0.0,) * 3)


def of(recording, precision, reference=(2.0, 2.0, 6.0), used=True, shown=(2.0, 2.0, 6.0)):
    tracked = Tracked(precision, frozenset())
    known = dataclasses.replace(recording, tracked=tracked, drift=drift(reference, used))
    return expected_noise_nm(known, "b1", shown)


def test_recordings_from_elsewhere_have_the_noise_of_their_reference_beads(recording):
    assert expected_noise_nm(recording, "b1", (2.0, None, 5.0)) == (2.0, None, 5.0)


def test_the_images_scale_what_the_reference_beads_show(recording):
    precision = {"b1": (3.0, 1.0, 10.0), "ref1": (1.0, 1.0, 5.0)}
    assert of(recording, precision) == pytest.approx((6.0, 2.0, 12.0))


def test_without_reference_beads_the_images_alone(recording):
    none = (None, None, None)
    precision = {"b1": (3.0, 1.0, NAN)}
    assert of(recording, precision, used=False, shown=none) == (3.0, 1.0, None)


def test_where_the_images_say_nothing_the_reference_beads_alone(recording):
    precision = {"b1": (NAN, 1.0, NAN), "ref1": (1.0, NAN, 5.0)}
    assert of(recording, precision) == (2.0, 2.0, 6.0)
    assert of(recording, {}) == (2.0, 2.0, 6.0)
