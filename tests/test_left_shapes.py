"""Courses of time and distributions that no effect explains, drawn smooth, and what they leave open
about the force.

Seeds are fixed. Where a bound is statistical, the chance that it fails for a right programme is
stated beside it.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from mtpipe.crosschecking.battery.statistic import Statistic
from mtpipe.crosschecking.check import check_bead, recorded_of
from mtpipe.crosschecking.prepared_bead import prepare
from mtpipe.diagnosis.left_in_distribution import independent_positions, left_in_distribution
from mtpipe.diagnosis.left_in_time import left_in_time
from mtpipe.diagnosis.smooth_curve import smooth_curve
from mtpipe.diagnosis.unexplained import unexplained
from mtpipe.diagnosis.unexplained_content import content_of
from mtpipe.drift import subtract_drift
from tests.small_case import case, generator, raw

pytestmark = pytest.mark.slow

ALONG_X = 0


def changed(seed, change, only=None):
    """The recording with x changed in one plateau or in all, checked with few simulations."""
    clean = subtract_drift(raw(seed))
    xyz = clean.positions_nm["b1"].copy()
    for i, plateau in enumerate(clean.plateaus):
        if only in (None, i):
            x = xyz[plateau.start : plateau.stop, ALONG_X]
            xyz[plateau.start : plateau.stop, ALONG_X] = x.mean() + change(x - x.mean())
    recording = replace(clean, positions_nm=clean.positions_nm | {"b1": xyz})
    return check_bead(prepare(recording, "b1"), generator(seed), rounds=(24,))


def oddest(check, statistic):
    """The look of that statistic along x that is oddest."""
    mine = [
        (float(p), look)
        for look, p in zip(check.statistics, check.p_values, strict=True)
        if (look.kind, look.axis) == (statistic, "x")
    ]
    return min(mine, key=lambda one: one[0])[1]


def test_a_curve_follows_what_is_there_within_its_errors():
    """40 draws of some 8 independent points: 68 % ± 8 % but for 1 in 100."""
    random, at = generator(1), np.linspace(0.0, 60.0, 24)
    truth, stderr = np.sin(at / 12), np.full(24, 0.3)
    inside, gains = [], []
    for _ in range(40):
        found = smooth_curve(at, truth + stderr * random.normal(size=24), stderr)
        inside.append(np.abs(found.mean - truth) < found.stderr)
        gains.append(found.gain_nats)
    assert 0.58 < np.mean(inside) < 0.80
    assert min(gains) > 3


def test_points_that_scatter_by_their_errors_gain_nothing():
    """A curve gains 3 nats by chance in 1 of 100; more than 4 of 100 do once in 300."""
    random, at = generator(2), np.linspace(0.0, 1.0, 16)
    gains = [smooth_curve(at, random.normal(size=16), np.ones(16)).gain_nats for _ in range(100)]
    assert np.sum(np.array(gains) > 3) <= 4


def test_a_constant_is_drawn_as_it_is_whatever_its_size():
    found = smooth_curve(np.arange(8.0), np.full(8, 700.0) + 1e-3 * np.arange(8) % 2, np.ones(8))
    np.testing.assert_allclose(found.mean, 700.0, atol=1e-2)
    assert found.stderr.max() < 1.0


def test_a_step_of_any_height_is_drawn():
    for height_nm in (1e-6, 1e3, 1e9):
        values = np.where(np.arange(16) < 8, 0.0, height_nm)
        found = smooth_curve(np.arange(16.0), values, np.full(16, 0.05))
        assert np.all(np.isfinite(found.mean))
        np.testing.assert_allclose(found.mean, values, atol=0.1 + 0.1 * height_nm)


def test_positions_stored_in_coarse_steps_have_no_middle_half_to_tell_the_force_by():
    check, plateau = changed(6, lambda x: x), 2
    stored = [position.copy() for position in check.case.positions_nm]
    x = stored[plateau][:, ALONG_X]
    step = 3 * x.std()
    stored[plateau][:, ALONG_X] = x.mean() + step * np.round((x - x.mean()) / step)
    check = replace(check, case=replace(check.case, positions_nm=tuple(stored)))
    found = left_in_distribution(check, Statistic("kurtosis", "x", (plateau,)))
    assert np.isnan(found.ln_force_shift)
    assert "middle half" not in found.words
    left = unexplained(check, None, beside=False)
    left.__dict__["shapes"] = (found,)
    (told,) = json.loads(json.dumps(content_of(left), allow_nan=False))["shapes"]
    assert told["force_factor"] is None


def test_a_variance_that_grows_is_drawn_and_both_halves_have_the_force_that_heights_hold():
    """Beyond 4 standard errors of the difference once in 16 000."""
    check = changed(1, lambda x: x * np.linspace(0.6, 1.4, len(x)), only=1)
    found = left_in_time(check, oddest(check, "variance_trend"))
    assert (found.kind, found.axis, found.plateau) == ("variance", ALONG_X, 1)
    rise, error = np.diff(found.curve.mean[[0, -1]]), np.hypot(*found.curve.stderr[[0, -1]])
    assert rise == pytest.approx(2 * np.log(1.375 / 0.625), abs=4 * error)
    (first, error), (second, other) = found.halves
    assert first == pytest.approx(second, abs=4 * np.hypot(error, other))
    words = found.words
    assert words.startswith("the variance, over that of the plateau, runs from ")
    assert re.search(r"alone, its first half gives a force of .* pN, the second .* pN$", words)


def test_a_mean_that_moves_is_drawn_in_nm():
    check = changed(2, lambda x: x + 90 * np.linspace(-1, 1, len(x)) ** 3, only=2)
    found = left_in_time(check, oddest(check, "mean_trend"))
    assert (found.kind, found.plateau) == ("mean", 2)
    assert found.curve.mean[0] == pytest.approx(-74, abs=4 * found.curve.stderr[0])
    assert found.curve.mean[-1] == pytest.approx(74, abs=4 * found.curve.stderr[-1])
    assert " nm at " in found.words


def test_tails_are_drawn_and_the_force_without_them_is_higher():
    random = generator(7)

    def with_tails(x):
        hit = random.random(len(x)) < 0.03
        return x + hit * 4 * x.std() * random.choice([-1, 1], size=len(x))

    check = changed(3, with_tails)
    found = left_in_distribution(check, oddest(check, "kurtosis"))
    assert found.curve.mean[[0, -1]].min() > 1
    assert found.curve.mean[16] == pytest.approx(0.2, abs=0.25)
    assert found.ln_force_shift > 2 * found.ln_force_stderr
    left = unexplained(check, None, beside=False)
    shape = next(one for one in left.shapes if one.kind == "distribution")
    assert f"In plateau {left.number(shape.plateau)}, along x, positions " in left.sentence
    assert (
        "times as frequent as in a normal distribution; taken from the width of the middle half"
        in left.sentence
    )
    told = json.loads(json.dumps(content_of(left), allow_nan=False))["shapes"]
    (one,) = [one for one in told if one["kind"] == "distribution"]
    assert np.all(np.array(one["value_low"]) < one["value"])
    assert np.all(np.array(one["curve_low"]) < one["curve_high"])
    assert one["force_factor"] == pytest.approx(np.exp(found.ln_force_shift), rel=0.2)


def test_looks_of_spectra_have_no_such_shape():
    check = changed(4, lambda x: x)
    look = Statistic("psd_band", "x", (0,), (1.0, 4.0))
    assert left_in_time(check, look) is None
    assert left_in_distribution(check, look) is None


def test_nothing_is_drawn_of_a_clean_trace():
    check = changed(5, lambda x: x)
    assert left_in_time(check, Statistic("variance_trend", "x", (0, 1, 2), pooled=True)) is None
    assert left_in_distribution(check, Statistic("kurtosis", "x", (0, 1, 2), pooled=True)) is None


def test_independent_positions_tell_the_variance_as_well_as_all_frames_do():
    """The variance of 60 variances is known within 18 %; 4 of that."""
    plateau = 2
    known = independent_positions(recorded_of(case(raw(6)))[plateau], ALONG_X)
    recordings = [raw(1000 + k) for k in range(60)]
    rows = slice(recordings[0].plateaus[plateau].start, recordings[0].plateaus[plateau].stop)
    spreads = [one.positions_nm["b1"][rows, ALONG_X].var() for one in recordings]
    assert np.var(np.log(spreads)) == pytest.approx(2 / known, rel=0.74)
