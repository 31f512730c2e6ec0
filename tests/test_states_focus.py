"""Heights that no force makes, and lags too uncertain to move a log by."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import mtpipe
from mtpipe.states import with_states
from mtpipe.states.edges import edges_of
from mtpipe.states.focus import focus_numbers
from mtpipe.states.lag import find_lag
from mtpipe.states.motion import Motion, motion_of
from mtpipe.states.size import heights_go_both_ways
from tests.test_states import simulated

ROWS = 2000
BEFORE, AFTER = slice(0, ROWS), slice(ROWS, 2 * ROWS)


def motion(random, steps, *, sideways=1.0, drift=0.0):
    """Beads of white noise of 1 nm whose heights step and whose sideways motion changes."""
    late = np.arange(2 * ROWS) >= ROWS
    shared = drift * np.cumsum(random.normal(size=2 * ROWS))
    positions = {}
    for number, step in enumerate(steps):
        xyz = random.normal(size=(2 * ROWS, 3))
        xyz[late, :2] *= sideways
        xyz[:, 2] += step * late + shared
        positions[f"b{number}"] = xyz
    return Motion(np.arange(2 * ROWS) / 100, 0.01, positions, np.zeros(2 * ROWS), None)


@pytest.mark.parametrize(
    ("steps", "sideways", "wanted"),
    [
        ((0.4, -0.4, 0.0), 1.0, True),
        ((0.4, 0.4, 0.4), 1.0, False),
        ((0.4, 0.0, 0.0), 1.0, False),
        ((0.4, -0.4, 0.0), 0.8, False),
    ],
)
def test_heights_that_go_up_and_down_are_none_of_the_force(steps, sideways, wanted):
    """Steps of 12 standard errors; a still bead falls by three in one of 700 seeds."""
    moved = motion(np.random.default_rng(3), steps, sideways=sideways)
    assert heights_go_both_ways(moved, BEFORE, AFTER) is wanted


@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_noise_and_shared_drift_do_not_go_both_ways(drift):
    """By chance one of three beads rises and one falls by three errors in one of 90 000: 40 tries
    fail for one seed in 2000.
    """
    random = np.random.default_rng(4)
    found = [
        heights_go_both_ways(motion(random, (0, 0, 0), drift=drift), BEFORE, AFTER)
        for _ in range(40)
    ]
    assert not any(found)


@pytest.mark.slow
def test_a_focus_that_moves_beads_both_ways_keeps_the_position_believed():
    truth = simulated(beads=4)
    plateau = truth.plateaus[2]
    at = plateau.start + (plateau.stop - plateau.start) // 2
    positions = {bead: xyz.copy() for bead, xyz in truth.positions_nm.items()}
    for bead, step in zip(truth.tethered, (60.0, 60.0, 60.0, -60.0), strict=True):
        positions[bead][at : plateau.stop, 2] += step
    recording = mtpipe.subtract_drift(dataclasses.replace(truth, positions_nm=positions))
    found = with_states(recording)
    (notice,) = [n for n in found.notices if n.code in {"height_step", "hidden_step"}]
    assert notice.code == "height_step"
    assert "up for some and down for others" in notice.message
    assert not found.states.unbelieved


@pytest.mark.parametrize(("error_dwells", "applied"), [(0.6, True), (1.1, False)])
def test_a_lag_less_certain_than_the_shortest_dwell_is_not_applied(
    monkeypatch, error_dwells, applied
):
    recording = mtpipe.subtract_drift(simulated())
    edges = edges_of(recording.plateaus, recording.magnet_mm)
    starts = [0, *(edge.start for edge in edges)]
    stops = [*(edge.stop for edge in edges), len(recording.time_s)]
    shortest = min(b - a for a, b in zip(starts, stops, strict=True))
    error = error_dwells * shortest
    # five standard errors, which is certain but for the length of the dwells
    monkeypatch.setattr("mtpipe.states.lag._common", lambda lags, errors: (5 * error, error))
    found = find_lag(motion_of(recording), edges)
    # no edge is where the lag would have it, so that each that is seen has its own
    assert bool(found.own) is applied


def focused(own_nm, *, move_nm=600.0):
    """A move of the focus in the middle of plateau 2; the bead's table shows it otherwise."""
    truth = simulated(beads=1)
    plateau = truth.plateaus[2]
    at = (plateau.start + plateau.stop) // 2
    positions = {bead: xyz.copy() for bead, xyz in truth.positions_nm.items()}
    for bead, xyz in positions.items():
        xyz[at:, 2] -= move_nm + (own_nm if bead in truth.tethered else 0.0)
    moved = dataclasses.replace(truth, positions_nm=positions)
    return with_states(mtpipe.subtract_drift(moved)), plateau, at


def test_a_plateau_is_cut_where_the_focus_moves_and_a_bead_shows_it():
    found, plateau, at = focused(80.0)
    (notice,) = [n for n in found.notices if n.code == "focus_moved"]
    assert "Plateau 2 is cut" in notice.message
    assert len(found.plateaus) == 6
    before, after = found.plateaus[2:4]
    assert before.start == plateau.start
    assert before.stop <= at <= after.start
    assert after.stop == plateau.stop
    assert before.magnet_mm == after.magnet_mm
    assert focus_numbers(found, found.plateaus) == (0, 0, 0, 1, 1, 1)
    assert not found.states.unbelieved
    assert not found.states.doubtful


def test_a_focus_that_moves_without_a_trace_cuts_nothing():
    found, plateau, _ = focused(0.0)
    assert [p for p in found.plateaus if p.start == plateau.start] == [plateau]
    assert "focus_moved" not in [n.code for n in found.notices]
    assert set(focus_numbers(found, found.plateaus)) == {0, 1}


def test_a_recording_whose_focus_stays_has_one():
    found = with_states(mtpipe.subtract_drift(simulated(beads=1)))
    assert set(focus_numbers(found, found.plateaus)) == {0}
