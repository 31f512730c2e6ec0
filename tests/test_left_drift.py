"""What no reference takes off: the stage's course along z, in extensions and in tethers' lengths.

Seeds are fixed; where a bound is one of chance, the comment says how often other seeds would fail.
"""

from __future__ import annotations

import importlib
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mtpipe
from mtpipe.calibration.extension import mean_with_stderr
from mtpipe.curves.tether_curves import tether_curves
from mtpipe.drift import subtract_drift
from mtpipe.drift.course import fit_course, piece_of
from mtpipe.drift.plateau_means import covariance_of_means
from mtpipe.fit.points import Assay, ExtensionPoints
from mtpipe.fit.tether import expected_extension_nm, fit_tether
from mtpipe.ingest.surface import z_zero_time_s
from mtpipe.physics.tether import Chain
from mtpipe.pipeline.run import _reference_warnings
from mtpipe.recording.recording import Plateau, StageCourse
from mtpipe.setup.setup import parse_setup
from mtpipe.setup.tables import DriftChoice
from mtpipe.simulation.simulate import simulate
from tests.simulated import recording, setup_content
from tests.small_case import setup
from tests.stage import RATE_HZ, ou, recording_of

pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).parents[1]
SPANS_S = np.array([(0.0, 40.0), (42.0, 60.0), (75.0, 150.0)])
FRAME_S = 1 / 60


def courses_nm(rng, number, steps, step_s, strength, rate=0.0):
    """(number, steps + 1) walks of the stage that begin at 0."""
    walk = np.cumsum(strength * math.sqrt(step_s) * rng.standard_normal((number, steps)), axis=1)
    return np.pad(walk, ((0, 0), (1, 0))) + rate * step_s * np.arange(steps + 1)


@pytest.mark.parametrize("origin_s", [0.0, 41.0, 50.0, 150.0])
def test_covariance_of_means_is_that_of_walks_played_out(origin_s):
    step_s = 0.25
    walks = courses_nm(np.random.default_rng(1), 10_000, 600, step_s, 1.5)
    walks -= walks[:, [round(origin_s / step_s)]]
    middle = (walks[:, 1:] + walks[:, :-1]) / 2
    edges = np.round(SPANS_S / step_s).astype(int)
    means = np.array([middle[:, a:b].mean(axis=1) for a, b in edges])
    expected = covariance_of_means(StageCourse(1.5, 0.0, 0.0), SPANS_S, origin_s)
    size = np.sqrt(np.diag(expected))
    # each has an error of 1.4 % of the sizes at most: more than 4 of them is asked
    np.testing.assert_allclose(np.cov(means) / np.outer(size, size),
                               expected / np.outer(size, size), atol=0.06)  # fmt: skip


def test_a_steady_stage_carries_means_by_their_middles():
    found = covariance_of_means(StageCourse(0.0, 0.0, 0.3), SPANS_S, 10.0)
    moved = 0.3 * (SPANS_S.mean(axis=1) - 10.0)
    np.testing.assert_allclose(found, np.outer(moved, moved))


def pieces(rng, strength, *, rate=0.0, beads=1, plateaus=4, frames=4096, thermal_nm=(60.0, 5.0)):
    """A stage seen by beads with level thermal motion, in plateaus that follow one another."""
    stage = courses_nm(rng, 1, plateaus * frames, FRAME_S, strength, rate)[0]
    return [
        piece_of(
            [
                stage[k * frames : (k + 1) * frames]
                + thermal_nm[k % len(thermal_nm)] * rng.standard_normal(frames)
                for _ in range(beads)
            ],
            FRAME_S,
        )
        for k in range(plateaus)
    ]


@pytest.mark.parametrize("beads", [1, 4])
@pytest.mark.parametrize("strength", [0.2, 1.5, 6.0])
def test_the_strength_is_found_within_its_error(strength, beads):
    rng = np.random.default_rng(2)
    found = [fit_course(pieces(rng, strength, beads=beads)) for _ in range(20)]
    values = np.array([one.random_nm_per_root_s for one in found])
    stated = np.mean([one.random_stderr_nm_per_root_s for one in found])
    # mean and scatter of 20 have standard errors of 0.22 and 0.16: three and a half of them
    assert abs(np.mean(values) - strength) < 0.8 * stated
    assert 0.45 < np.std(values) / stated < 1.55


def test_beads_together_tell_more_than_one():
    rng = np.random.default_rng(3)
    alone, together = (
        np.mean([
            fit_course(pieces(rng, 1.0, beads=n, thermal_nm=(80.0,))).random_stderr_nm_per_root_s
            for _ in range(8)
        ])
        for n in (1, 10)
    )  # fmt: skip
    assert together < 0.7 * alone


def test_a_steady_motion_is_told_from_a_walk():
    rng = np.random.default_rng(4)
    moving = [fit_course(pieces(rng, 0.5, rate=0.5)).steady_nm_per_s for _ in range(10)]
    assert np.median(moving) == pytest.approx(0.5, rel=0.2)
    # a rate is believed by chance in one of twenty: in half of ten in less than 1 of 10,000
    still = [fit_course(pieces(rng, 0.5)).steady_nm_per_s for _ in range(10)]
    assert np.median(still) < 0.02


def test_slow_thermal_motion_is_not_taken_for_the_stage():
    """A tether at low force relaxes in 0.5 s; its spectrum falls off within the coefficients."""
    rng = np.random.default_rng(5)
    q = math.exp(-FRAME_S / 0.5)
    found = []
    for _ in range(6):
        z = np.zeros((4, 4096))
        kicks = 100 * math.sqrt(1 - q * q) * rng.standard_normal(z.shape)
        for i in range(1, z.shape[1]):
            z[:, i] = q * z[:, i - 1] + kicks[:, i]
        # beside it one plateau that shows the stage
        held = 2 * rng.standard_normal(4096)
        held += courses_nm(rng, 1, 4095, FRAME_S, 0.5)[0]
        found.append(fit_course([piece_of([one], FRAME_S) for one in (*z, held)]))
    assert np.median([one.random_nm_per_root_s for one in found]) == pytest.approx(0.5, rel=0.35)


def test_nothing_tells_in_too_few_frames():
    z = np.random.default_rng(6).standard_normal(40)
    assert piece_of([z[:4]], FRAME_S) is None
    assert fit_course([piece_of([z], FRAME_S)]) is None
    assert fit_course([]) is None


def test_extensions_and_lengths_carry_the_stage():
    raw = simulate(setup(beads={"reference": []}), (0.6, 2.0, 4.0, 7.0), 2048, 1)
    moved = subtract_drift(raw)
    (notice,) = [n for n in moved.notices if n.code == "drift_left"]
    assert "along z between the first and the last plateau" in notice.message
    assert "nm per root second" in notice.message
    calibration = mtpipe.calibrate(moved)
    (bead,) = calibration.beads
    np.testing.assert_allclose(
        [p.extension_stderr_nm**2 - p.own_stderr_nm**2 for p in bead.plateaus],
        np.diag(bead.stage_nm2),
    )
    for plateau in bead.plateaus:
        mean, stderr = mean_with_stderr(plateau.trace.position_nm[:, 2])
        assert plateau.extension_nm == mean
        assert plateau.own_stderr_nm == pytest.approx(stderr)
    still = replace(
        bead,
        stage_nm2=None,
        plateaus=tuple(replace(p, extension_stderr_nm=p.own_stderr_nm) for p in bead.plateaus),
    )
    with_it, without = (
        tether_curves(replace(calibration, beads=(one,)))["b1"].recommended.contour_length_nm
        for one in (bead, still)
    )
    assert with_it.stderr > 2 * without.stderr
    # two of its standard errors: missed by chance in one of twenty seeds
    assert abs(with_it.value - 2700) < 2 * with_it.stderr


def test_a_reference_leaves_nothing_to_carry():
    raw = recording((0.5, 2.0), 2048)
    subtracted = subtract_drift(raw)
    assert subtracted.drift.left_along_z is None
    assert not [n for n in subtracted.notices if n.code.startswith("drift_")]
    (bead,) = mtpipe.calibrate(subtracted).beads
    assert bead.stage_nm2 is None
    for plateau in bead.plateaus:
        mean, stderr = mean_with_stderr(plateau.trace.position_nm[:, 2])
        assert (plateau.extension_nm, plateau.extension_stderr_nm) == (mean, stderr)


def test_every_way_without_a_reference_along_z_carries_the_stage():
    raw = recording((0.5, 2.0, 6.0), 2048)
    blind = {name: xyz.copy() for name, xyz in raw.positions_nm.items()}
    blind["ref1"][:, 2] = np.nan
    left = [
        subtract_drift(replace(raw, positions_nm=blind)),
        subtract_drift(raw, choice=DriftChoice(method="none")),
        subtract_drift(raw, choice=DriftChoice(method="highpass", cutoff_hz=0.2)),
    ]
    for one in left:
        course = one.drift.left_along_z
        # the simulation's stage walks by 1 nm per root second
        assert course.random_nm_per_root_s == pytest.approx(1.0, rel=0.6)
        assert course == left[0].drift.left_along_z


def test_a_stage_that_nothing_tells_leaves_no_bead_good():
    rng = np.random.default_rng(7)
    short = recording_of({"b1": ou(rng, 64, 30.0, 5.0)}, [], plateaus=(Plateau(0, 0, 64, None),))
    result = subtract_drift(short)
    assert result.drift.left_along_z is None
    assert [n.code for n in result.notices] == ["no_reference", "drift_unknown"]
    assert len(_reference_warnings(result)) == 1
    longer = recording_of({"b1": ou(rng, 1024, 30.0, 5.0)}, [])
    assert _reference_warnings(subtract_drift(longer)) == ()


def test_the_walk_begins_where_the_bead_touched_the_surface():
    z = np.abs(np.random.default_rng(8).standard_normal((2048, 3)))
    raw = recording_of({"b1": z}, [])
    assert z_zero_time_s(raw, "b1") == 0.0
    source = {
        "beads": [{"name": "b1", "x": "x", "z": "z"}],
        "units": {"position": "nm"},
        "z_zero": {"touch_time_s": [4.0, 8.0]},
    }
    content = setup_content(beads={"radius_nm": 500.0}, source=source)
    told = replace(raw, setup=parse_setup(content))
    assert z_zero_time_s(told, "b1") == pytest.approx(6.0, abs=1 / RATE_HZ)


def shares_that_hold(experiments: int) -> dict[str, tuple[float, float]]:
    """Of 68 % intervals of the lengths, with the stage's covariance and with none of it."""
    rng = np.random.default_rng(9)
    chain, force, assay = Chain(7000.0, 50.0, 298.0), np.geomspace(0.3, 8.0, 5), Assay(298.0)
    true_nm = expected_extension_nm(chain, force, assay)
    spans = np.array([(137.0 * k, 137.0 * k + 135.0) for k in range(len(force))])
    covariance = covariance_of_means(StageCourse(1.5, 0.0, 0.0), spans, 0.0)
    held: dict[str, list[tuple[bool, bool]]] = {"contour": [], "persistence": []}
    for _ in range(experiments):
        stage = rng.multivariate_normal(np.zeros(len(force)), covariance)
        extension = true_nm + stage + 3 * rng.standard_normal(len(force))
        measured = force * np.exp(0.015 * rng.standard_normal(len(force))) * extension / true_nm
        points = ExtensionPoints(
            np.arange(len(force)), measured, 0.015 * measured, extension,
            np.sqrt(9 + np.diag(covariance)), extension, covariance,
        )  # fmt: skip
        alone = replace(points, extension_stderr_nm=np.full(len(force), 3.0), stage_nm2=None)
        fits = [fit_tether(one, "bouchiat", assay) for one in (points, alone)]
        for name, truth in (("contour", 7000.0), ("persistence", 50.0)):
            intervals = [getattr(fit, f"{name}_length_nm").interval for fit in fits]
            held[name].append(tuple(low < truth < high for low, high in intervals))
    return {name: tuple(np.mean(pairs, axis=0)) for name, pairs in held.items()}


def test_lengths_hold_the_truth_with_the_stage_and_not_without():
    # 60 experiments: a standard error of 0.06, and bounds of three fail falsely in 1 of 370
    for with_it, without in shares_that_hold(60).values():
        assert 0.50 < with_it < 0.86
        assert without < 0.45


def test_the_study_counts_what_it_measured(monkeypatch):
    monkeypatch.syspath_prepend(str(CHECKOUT / "workflows" / "validation"))
    study = importlib.import_module("no_reference")
    against = study._against((0.9, 1.1), 1.2)
    assert not against["holds"]
    assert against["pull"] == pytest.approx(-1.867, abs=0.001)
    held = study._against((0.9, 1.1), 1.05)
    outcomes = [
        [
            {"what": "contour", **one, "pull_without": 5.0},
            {"what": "stage", "strength": 1.5, "told": True},
        ]
        for one in (held, held, against, held)
    ]
    row = study.coverage_table(outcomes).splitlines()[2].split(" | ")
    assert row[:3] == ["| contour", "4 of 4", "75.0"]
    assert row[-2] == "0.0"
