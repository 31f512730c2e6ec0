"""Beads whose z shows fast motion of the stage on a scale of its own (`mtpipe.drift.fast_z`)."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.signal import lfilter

from mtpipe.drift import subtract_drift
from mtpipe.drift.fast_z import fast_share
from mtpipe.drift.grid import Grid
from mtpipe.recording.recording import Plateau
from mtpipe.setup.tables import DriftChoice
from tests.stage import RATE_HZ, N, codes, ou, recording_of, walk

TIME_S = np.arange(N) / RATE_HZ
GRID = Grid(RATE_HZ, np.arange(N), ((0, N),))


def vibration(rng, amplitude_nm=20.0):
    """Two lines whose phases wander, as of a building."""
    phase = np.cumsum(0.01 * rng.standard_normal((2, N)), axis=1)
    return sum(
        amplitude_nm * np.sin(2 * np.pi * f * TIME_S + p)
        for f, p in zip((29.77, 35.77), phase, strict=True)
    )


def scene(rng, share, fast_nm, *, noises=(1.5, 1.0), plateaus=None):
    """One tethered bead that shows `share` of the fast motion in z, and references that show it."""
    slow = walk(rng, N, 0.1)
    fast = np.column_stack([np.zeros(N), np.zeros(N), fast_nm])
    positions = {"b1": ou(rng, N, 30.0, 5.0) + slow + np.reshape(share, (-1, 1)) * fast}
    for i, noise in enumerate(noises):
        positions[f"ref{i}"] = slow + fast + noise * rng.standard_normal((N, 3))
    return recording_of(positions, [b for b in positions if b != "b1"], plateaus=plateaus)


def line_left(recording, hz=29.77):
    """Power of z at a line over its neighbours'; 1 without a line."""
    z = recording.positions_nm["b1"][:, 2]
    power = np.abs(np.fft.rfft(z - z.mean())) ** 2
    away = np.abs(np.fft.rfftfreq(N, 1 / RATE_HZ) - hz)
    return power[away < 0.2].mean() / power[(away > 0.5) & (away < 2)].mean()


@pytest.mark.parametrize("share", [0.8, 1.3])
def test_a_vibration_shown_on_another_scale_is_taken_off_whole(share):
    rng = np.random.default_rng(1)
    recording = scene(rng, share, vibration(rng))
    without = subtract_drift(recording)
    found = without.drift.beyond_nm["b1"]
    assert line_left(recording) > 50
    assert line_left(without) < 1.5
    # so much of the vibration a common scale would have left
    assert np.ptp(found) > 2 * 20 * abs(share - 1)
    assert ("z_slope", "b1") in codes(without)
    (said,) = [n.message for n in without.notices if n.code == "z_slope"]
    low, high = map(float, re.search(r"shows ([\d.]+) to ([\d.]+) of", said).groups())
    assert share - 0.1 < low <= share <= high < share + 0.1
    np.testing.assert_array_equal(
        without.drift.of_bead("b1")[:, :2], without.drift.subtracted_nm[:, :2]
    )


def test_shares_are_within_their_errors():
    """68 % within one standard error: 240 stretches, false failure below 10⁻³ on either side."""
    within = []
    for seed in range(18):
        rng = np.random.default_rng((2, seed))
        recording = scene(rng, 1.2, vibration(rng, 40.0), noises=(40.0, 40.0))
        stage = (recording.positions_nm["ref0"] + recording.positions_nm["ref1"])[:, 2] / 2
        found = fast_share(recording.positions_nm["b1"][:, 2], stage, 40 / 2**0.5, GRID, None)
        within.extend(np.abs(found.share - 1.2) < found.stderr)
    assert len(within) == 18 * 14
    assert 0.58 < np.mean(within) < 0.78


def test_a_share_that_changes_with_the_focus_is_followed():
    rng = np.random.default_rng(3)
    share = np.where(np.arange(N) < N // 2, 1.3, 0.95)
    recording = scene(rng, share, vibration(rng))
    assert line_left(subtract_drift(recording)) < 2


def test_it_holds_in_the_plateaus_in_which_it_is_seen():
    rng = np.random.default_rng(4)
    half = N // 2
    fast = np.where(np.arange(N) < half, vibration(rng), 0.0)
    plateaus = (Plateau(0, 0, half, None), Plateau(1, half, N, None))
    without = subtract_drift(scene(rng, 1.3, fast, plateaus=plateaus))
    assert np.ptp(without.drift.beyond_nm["b1"][:half]) > 10
    assert not without.drift.beyond_nm["b1"][half:].any()


def loose(rng):
    """A reference that moves on its own by 15 nm: the bead shows but a part of its motion."""
    own = lfilter([1], [1, -0.9], 6.5 * rng.standard_normal(N))
    recording = scene(rng, 1.0, walk(rng, N, 0.5)[:, 0], noises=(1.0,))
    recording.positions_nm["ref0"][:, 2] += own
    return recording


def tilting(rng):
    """Each frequency has a share of its own, which no scale has."""
    recording = scene(rng, 1.0, vibration(rng))
    recording.positions_nm["b1"][:, 2] += 60 * np.sin(2 * np.pi * 12.0 * TIME_S)
    for reference in recording.references:
        recording.positions_nm[reference][:, 2] += 100 * np.sin(2 * np.pi * 12.0 * TIME_S)
    return recording


@pytest.mark.parametrize(
    "recorded",
    [
        lambda rng: scene(rng, 1.0, vibration(rng)),
        lambda rng: scene(rng, 1.0, vibration(rng, 200.0)),
        lambda rng: scene(rng, 1.0, np.zeros(N)),
        lambda rng: scene(rng, 1.0, walk(rng, N, 3.0)[:, 0]),
        lambda rng: scene(rng, 1.0, 500.0 * np.floor(TIME_S / 30), noises=(1.5,)),
        loose,
        tilting,
    ],
    ids=["shared", "strong", "still", "walk", "focus", "loose", "tilting"],
)
def test_a_bead_that_shows_all_is_left_alone(recorded):
    """One in 10⁶ recordings would be taken for another scale where 1 is the truth."""
    for seed in range(8):
        without = subtract_drift(recorded(np.random.default_rng((5, seed))))
        assert not without.drift.beyond_nm
        assert "z_slope" not in dict(codes(without))


def test_what_is_not_subtracted_needs_no_share():
    rng = np.random.default_rng(6)
    recording = scene(rng, 1.3, vibration(rng))
    without = subtract_drift(recording, choice=DriftChoice(cutoff_hz=5.0))
    assert not without.drift.beyond_nm
