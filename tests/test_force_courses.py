"""Forces that change within plateaus are seen in the heights, with their direction and course."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mtpipe.configured.courses import force_courses
from mtpipe.configured.data import plateau_data, whitening
from mtpipe.configured.expectation import Subtraction
from mtpipe.configured.fit import fit_configured
from mtpipe.configured.model import ConfiguredModel
from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import (
    Bead,
    Experiment,
    Fluid,
    ForceCourse,
    Rest,
    Stage,
    Tracker,
)
from mtpipe.experiment.readout import force_course
from mtpipe.experiment.state import bead_state
from mtpipe.physics.camera import Camera
from mtpipe.physics.tether import Chain
from mtpipe.simulation.linear import simulate_motion
from mtpipe.simulation.readout import force_pieces, height_within_pieces, recorded

FORCES_PN, FRAMES, FRAME_S = (0.5, 2.0, 8.0), 4096, 1 / 100
STEADY = Experiment(
    chain=Chain(2700.0, 50.0, 298.15, "marko-siggia"),
    bead=Bead(1400.0),
    fluid=Fluid(298.15, 0.9),
    along=0,
    camera=Camera(FRAME_S, FRAME_S),
    stage=Stage(),
    tracker=Tracker((2.0, 2.0, 3.0)),
    rests=tuple(Rest(force, FRAMES, 5.0 - i) for i, force in enumerate(FORCES_PN)),
)
NO_SUBTRACTION = Subtraction((None,) * 3, (0.0,) * 3)


def seen(experiment, seed):
    random = np.random.default_rng(seed)
    positions = []
    for i, force in enumerate(FORCES_PN):
        changes, frames = zip(*force_pieces(experiment, i, FRAMES), strict=True)
        forces = force * (1 + np.array(changes))
        states = [bead_state(experiment, float(f)) for f in forces]
        motion = simulate_motion(list(zip(states, frames, strict=True)), experiment.camera, random)
        positions.append(recorded(motion, np.repeat(forces, frames), experiment, random))
    phi = [whitening(x, FRAME_S) for x in positions]
    data = tuple(plateau_data(x, FRAME_S, p) for x, p in zip(positions, phi, strict=True))
    fit = fit_configured(ConfiguredModel(data, STEADY, (), NO_SUBTRACTION))
    each, common = force_courses(fit, positions, FRAME_S)
    return [seen.course for seen in each], common


@pytest.mark.parametrize(
    "course",
    [
        ForceCourse(0.3),
        ForceCourse(-0.3),
        ForceCourse(-0.4, "settling", 1 / 8),
        ForceCourse(0.25, "step", 0.7),
        ForceCourse(-0.15, "step", 0.375),
    ],
)
def test_a_change_is_found_where_it_is(course):
    courses = (ForceCourse(), course, ForceCourse())
    found, _ = seen(with_magnets(STEADY, courses=courses), 1)
    assert found[0].relative_change == found[2].relative_change == 0
    assert found[1].kind == course.kind
    assert found[1].relative_change == pytest.approx(course.relative_change, abs=0.1)
    assert found[1].at == pytest.approx(course.at, abs=0.08 if course.kind == "settling" else 2e-3)


def test_a_steady_force_is_seen_to_be_steady():
    """One plateau in a hundred may be taken for changing; 3 of 30 are with probability 0.3 %."""
    found = [seen(STEADY, seed) for seed in range(10)]
    assert sum(c.relative_change != 0 for each, _ in found for c in each) <= 2
    assert sum(common.course.relative_change != 0 for _, common in found) <= 1


@pytest.mark.parametrize("course", [ForceCourse(-0.03), ForceCourse(0.04, "settling", 0.15)])
def test_a_small_change_that_all_plateaus_have_is_found_in_all_together(course):
    _, common = seen(with_magnets(STEADY, courses=(course,) * 3), 2)
    assert common.course.kind == course.kind
    assert abs(common.course.relative_change - course.relative_change) < 4 * common.stderr
    assert abs(common.course.relative_change) > 4 * common.stderr


@pytest.mark.parametrize(
    "course",
    [ForceCourse(0.2), ForceCourse(0.2, "settling", 0.1), ForceCourse(-0.2, "step", 0.33)],
)
def test_a_course_has_its_mean_and_its_change(course):
    along = force_course(course, 4000)
    assert along.mean() == pytest.approx(0, abs=1e-12)
    assert along[-1] - along[0] == pytest.approx(course.relative_change, rel=5e-3)
    pieces = force_pieces(with_magnets(STEADY, courses=(course,) * 3), 0, FRAMES)
    assert sum(frames for _, frames in pieces) == FRAMES
    assert sum(change * frames for change, frames in pieces) / FRAMES == pytest.approx(0, abs=2e-3)
    assert len(pieces) < 5 if course.kind == "step" else len(pieces) > 10


def test_a_steady_plateau_is_played_in_one_piece():
    courses = (replace(ForceCourse(0.1), relative_change=0.0), ForceCourse(0.1), ForceCourse())
    assert force_pieces(with_magnets(STEADY, courses=courses), 0, 100) == [(0.0, 100)]


def test_heights_follow_a_smooth_course_within_its_pieces():
    experiment = with_magnets(STEADY, courses=(ForceCourse(0.4),) * 3)
    force, frames = FORCES_PN[1], 240
    along = force * (1 + force_course(ForceCourse(0.4), frames))
    pieces = np.repeat(*map(list, zip(*force_pieces(experiment, 1, frames), strict=True)))
    expected = [bead_state(experiment, float(f)).extension_nm for f in along]
    stepped = [bead_state(experiment, force * (1 + float(c))).extension_nm for c in pieces]
    within = height_within_pieces(experiment, 1, force, frames)
    np.testing.assert_allclose(np.array(stepped) + within, expected, atol=0.05)
    steady = with_magnets(STEADY, courses=(ForceCourse(0.4, "step", 0.3),) * 3)
    assert not height_within_pieces(steady, 1, force, frames).any()


def test_what_is_lost_is_no_course():
    """Two plateaus whose heights are lost but for one end: nothing is seen, and nothing fails."""
    positions = []
    for i, force in enumerate(FORCES_PN):
        random = np.random.default_rng(i)
        state = bead_state(STEADY, force)
        motion = simulate_motion([(state, FRAMES)], STEADY.camera, random)
        motion[FRAMES // 12 : -FRAMES // 12 if i else None] = np.nan
        positions.append(motion)
    phi = [whitening(x, FRAME_S) for x in positions]
    data = tuple(plateau_data(x, FRAME_S, p) for x, p in zip(positions, phi, strict=True))
    fit = fit_configured(ConfiguredModel(data, STEADY, (), NO_SUBTRACTION))
    each, _ = force_courses(fit, positions, FRAME_S)
    assert each[0].course.relative_change == 0
