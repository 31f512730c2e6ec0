"""Narrow lines: seen where they are, told from chance, and named although they are faint or wander.

Seeds are fixed. Where a bound is statistical, the chance that it fails for a right programme is
stated beside it.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from mtpipe.crosschecking.lines import (
    distinct_lines,
    strongest_lines,
    with_line_bins,
    with_lines_apart,
)
from mtpipe.crosschecking.prepared_bead import described, prepare
from mtpipe.diagnosis.naming import FORM_NATS
from mtpipe.drift import subtract_drift
from mtpipe.effects.catalogue import OWN
from mtpipe.effects.effect import Evidence
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.joint_fit.hypotheses import best_of
from tests.small_case import FRAMES, generator, raw, setup

RATE_HZ = 120.0
VIBRATION = next(effect for effect in OWN if effect.name == "vibration")


def ready(recording):
    return prepare(subtract_drift(recording), "b1")


def vibrating(recording, line_hz, amplitude_nm, coherence_s=np.inf, seed=1):
    """The bead's y with a wave whose phase diffuses."""
    random = generator(seed)
    steps = np.sqrt(2 / RATE_HZ / coherence_s) * random.normal(size=len(recording.time_s))
    phase = 2 * np.pi * (line_hz * recording.time_s + random.random()) + np.cumsum(steps)
    wave = np.outer(amplitude_nm * np.sin(phase), [0, 1, 0])
    positions = recording.positions_nm | {"b1": recording.positions_nm["b1"] + wave}
    return replace(recording, positions_nm=positions)


def named(case, lines_hz):
    forces = tuple(float(f) for f in case.fit.force_pN)
    found = best_of(case.fit, VIBRATION, Evidence(lines_hz, forces))
    sizes = VIBRATION.strengths(found.fit.model.described(found.fit.theta))
    return found, {name: value for name, value, _ in sizes}


@pytest.mark.parametrize("seed", range(4))
def test_chance_has_no_bins_of_its_own(seed):
    """The largest of some 6000 ordinates gains 10 nats by chance in 1 of 100 recordings."""
    case = ready(raw(seed))
    assert strongest_lines(case)[0][0] < 10
    assert with_lines_apart(case) is case


def test_a_faint_line_is_lost_in_a_usual_bin_and_seen_in_its_own():
    """Its size is within three standard errors but for 1 seed in 400."""
    case = ready(vibrating(raw(1), 31.7, 5.0))
    own = with_lines_apart(case)
    (line_hz,) = own.lines_hz
    assert line_hz == pytest.approx(31.7, abs=0.3 * RATE_HZ / FRAMES)
    usual, _ = named(case, own.lines_hz)
    found, sizes = named(own, own.lines_hz)
    assert found.net > max(FORM_NATS, usual.net + 10)
    assert "coherence_s" not in sizes
    stderr = np.sqrt(found.fit.covariance.diagonal())[-2] / (2 * sizes["amplitude_y_nm"])
    assert abs(sizes["amplitude_y_nm"] - 5.0) < 3 * stderr


def test_how_long_a_line_keeps_its_phase_is_found():
    """Within a factor of 2 of the truth but for 1 seed in 100."""
    case = with_lines_apart(ready(vibrating(raw(2), 31.7, 15.0, coherence_s=2.0)))
    found, sizes = named(case, case.lines_hz)
    steady = best_of(
        case.fit, replace(VIBRATION, hypotheses=_steady), Evidence(case.lines_hz, (1.0,) * 3)
    )
    assert found.net > steady.net + 10
    assert sizes["amplitude_y_nm"] == pytest.approx(15.0, rel=0.2)
    assert 1.0 < sizes["coherence_s"] < 4.0


@pytest.mark.parametrize("seed", range(4))
def test_a_line_that_wanders_is_placed_within_its_width(seed):
    """A coherence of 6 s is a width of 0.053 Hz. Where a line was half a width off, what was fitted
    left most of it. Three standard errors of its frequency, √(2/(6 s · 51 s))/2π, and half a step
    of the search.
    """
    case = ready(vibrating(raw(seed), 31.7, 12.0, coherence_s=6.0, seed=seed))
    nats, line_hz = strongest_lines(case)[0]
    assert nats > 50
    assert line_hz == pytest.approx(31.7, abs=0.04 + 0.25 * RATE_HZ / FRAMES)


def _steady(experiment, evidence):
    return VIBRATION.hypotheses(experiment, evidence)[:1]


def test_two_lines_are_one_vibration():
    """Sizes are within 30 %, three standard errors, but for 1 seed in 200."""
    case = with_lines_apart(ready(vibrating(vibrating(raw(4), 31.7, 12.0), 47.0, 8.0, seed=2)))
    assert sorted(case.lines_hz) == pytest.approx([31.7, 47.0], abs=0.3 * RATE_HZ / FRAMES)
    found, sizes = named(case, case.lines_hz)
    alone, _ = named(case, case.lines_hz[:1])
    assert found.net > alone.net + 10
    assert found.hypothesis.numbers == 8
    told = {
        sizes["line_hz"]: sizes["amplitude_y_nm"],
        sizes["line_2_hz"]: sizes["amplitude_2_y_nm"],
    }
    assert [told[hz] for hz in sorted(told)] == pytest.approx([12.0, 8.0], rel=0.3)
    said = VIBRATION.cause(found.fit.model.described(found.fit.theta))
    assert all(f"{hz:.2f} Hz" in said for hz in case.lines_hz)
    slow = VIBRATION.hypotheses(case.fit.model.experiment, Evidence((0.3, 0.9), (1.0,) * 3))
    assert {len(one.experiment.stage.lines) for one in slow} == {1}
    # what is named is not named again
    again = VIBRATION.hypotheses(
        found.fit.model.described(found.fit.theta), Evidence((20.0,), (1.0,) * 3)
    )
    assert not again


def test_bins_of_a_lines_own_tell_the_forces_the_same():
    """Where there is no line they only cut the same ordinates otherwise."""
    case = ready(raw(3))
    own = with_line_bins(case, (31.7,))
    assert len(own.fit.model.data[0].spectrum.edges) > len(case.fit.model.data[0].spectrum.edges)
    shift = np.log(own.fit.force_pN / case.fit.force_pN)
    assert np.abs(shift / (case.fit.force_stderr_pN / case.fit.force_pN)).max() < 0.2
    assert described(own).camera == described(case).camera


def test_a_line_is_counted_once():
    assert distinct_lines((50.0, 50.4, 30.0, 49.5)) == (50.0, 30.0)
    assert distinct_lines((50.0, 30.0), [30.2]) == (50.0,)


def test_a_slow_wave_keeps_its_phase_for_some_periods_or_is_no_line():
    """What keeps it for less is a bump of noise, which other effects describe."""
    experiment, _ = experiment_of(setup(), (1.0, 4.0), 4096)
    evidence = Evidence((0.14,), (1.0, 4.0))
    _, diffusing = VIBRATION.hypotheses(experiment, evidence)
    coherence = diffusing.parameters[-1]
    assert math.exp(coherence.lower) == pytest.approx(3 / 0.14)
    assert coherence.lower < coherence.start < coherence.upper
    assert diffusing.experiment.stage.lines[0].coherence_s == pytest.approx(
        math.exp(coherence.start)
    )
