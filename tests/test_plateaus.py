"""Plateaus: stretches of resting magnets."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mtpipe.recording.plateaus import find_plateaus
from mtpipe.setup.tables import Plateaus


def spans(plateaus):
    return [(p.start, p.stop, p.magnet_mm) for p in plateaus]


def test_stretches_of_one_value_are_plateaus_and_short_ones_are_moves():
    magnet = np.array([3.0] * 60 + [2.5] * 5 + [2.0] * 70)
    found = find_plateaus(np.arange(135) / 10, magnet, Plateaus(minimum_s=5))
    assert spans(found) == [(0, 60, 3.0), (65, 135, 2.0)]
    assert [p.number for p in found] == [0, 1]


def test_without_a_magnet_the_whole_recording_is_one():
    assert spans(find_plateaus(np.arange(100) / 10, None, Plateaus())) == [(0, 100, None)]


def test_rotation_cuts_a_plateau_and_settling_is_left_out():
    resting = np.ones(300, dtype=bool)
    resting[100:120] = False
    choice = Plateaus(minimum_s=5, settle_s=1.0)
    found = find_plateaus(np.arange(300) / 10, np.full(300, 2.0), choice, resting)
    assert spans(found) == [(0, 100, 2.0), (130, 300, 2.0)]


def test_frames_without_a_position_belong_to_none():
    magnet = np.array([np.nan] * 20 + [2.0] * 80)
    assert spans(find_plateaus(np.arange(100) / 10, magnet, Plateaus())) == [(20, 100, 2.0)]


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.01]))
def test_plateaus_are_disjoint_long_enough_and_within_tolerance(seed, tolerance):
    rng = np.random.default_rng(seed)
    values = np.repeat(rng.choice([1.0, 2.0, 3.0], 12), rng.integers(1, 90, 12))
    magnet = values + rng.uniform(-1, 1, len(values)) * tolerance / 2
    found = find_plateaus(
        np.arange(len(values)) / 10, magnet, Plateaus(minimum_s=2, tolerance_mm=tolerance)
    )
    end = 0
    for plateau in found:
        assert plateau.start >= end
        end = plateau.stop
        assert plateau.stop - plateau.start >= 20
        assert np.ptp(magnet[plateau.start : plateau.stop]) <= 2 * tolerance
        assert len(set(values[plateau.start : plateau.stop])) == 1
