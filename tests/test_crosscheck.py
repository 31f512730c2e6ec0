"""The cross-check of whole recordings: calm where all is as configured, loud and to the point else.

Seeds are fixed. A clean recording has a p-value below 0.01 one time in a hundred; those here have
not. `workflows/crosscheck` measures the rates.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import mtpipe
from mtpipe.crosschecking.beads import bead_generator
from mtpipe.crosschecking.check import (
    CLEARLY_CONSISTENT,
    CONSISTENT_BY_FEW,
    ENOUGH,
    FAR_OFF,
    _Draws,
    check_bead,
    comparable_p_values,
    foreseen_p_value,
)
from mtpipe.crosschecking.check import ROUNDS as ROUNDS_OF
from mtpipe.crosschecking.crosscheck import COLUMNS
from mtpipe.crosschecking.curves import KINDS
from mtpipe.crosschecking.prepared_bead import described, prepare
from mtpipe.crosschecking.twin import TwinMaker
from mtpipe.diagnosis.evidence import evidence_of
from mtpipe.drift import subtract_drift
from mtpipe.drift.lowpass import low_pass
from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import ForceCourse
from mtpipe.ground.errors import RecordingError
from mtpipe.ground.processes import with_parts
from mtpipe.joint_fit.data import plateau_data
from mtpipe.joint_fit.expectation import Subtraction
from mtpipe.pipeline.tables_crosscheck import crosscheck_curves, crosscheck_table
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.setup.setup import Setup
from tests.small_case import FORCES_PN, FRAMES, case, generator, raw, setup

ROUNDS = (26,)


def check(recording, seed=1):
    return check_bead(case(recording), generator(seed), rounds=ROUNDS)


def moved(recording, motion_nm, bead="b1"):
    positions = recording.positions_nm | {bead: recording.positions_nm[bead] + motion_nm}
    return replace(recording, positions_nm=positions)


def oddest(found, below=1e-3):
    """The looks with the smallest p-values, oddest first."""
    order = np.argsort(found.p_values)
    return [found.statistics[i] for i in order if found.p_values[i] < below]


@pytest.fixture(scope="module")
def clean():
    return raw(11, lost_share=0.01)


@pytest.fixture(scope="module")
def calm(clean):
    return check_bead(case(clean), generator(1), rounds=ROUNDS, with_curves=True)


def test_a_recording_as_configured_is_consistent(calm):
    assert calm.p_value > 0.01
    assert not calm.overall.extrapolated
    assert {look.axis for look in calm.statistics} >= {"x", "y", "z", "xy", "xz", "yz"}
    assert np.isfinite(calm.observed).all()
    assert np.isfinite(calm.simulated).all()


def test_scores_of_a_clean_recording_are_about_standard_normal(calm):
    spread = calm.simulated.std(axis=0, ddof=1)
    scores = (calm.observed - calm.simulated.mean(axis=0)) / spread
    # some 250 scores, many of them correlated
    assert abs(np.mean(scores)) < 0.3
    assert np.std(scores) == pytest.approx(1, abs=0.25)


def test_curves_of_a_clean_recording_lie_within_the_simulated(calm):
    assert {curve.kind for curve in calm.curves} == set(KINDS)
    assert len(calm.curves) == 3 * 3 * 3
    for curve in calm.curves:
        assert np.all(curve.low <= curve.median)
        assert np.all(curve.median <= curve.high)
    inside = np.concatenate([(c.recorded >= c.low) & (c.recorded <= c.high) for c in calm.curves])
    # 2.5 % of 26 simulations are less than one of them, so the envelope holds about 94 %
    assert 0.85 < np.mean(inside) < 0.98


def test_the_same_seed_gives_the_same_answer(clean):
    first, again = (check_bead(case(clean), generator(5), rounds=(12,)) for _ in range(2))
    assert np.array_equal(first.simulated, again.simulated)
    assert first.p_value == again.p_value


def test_a_vibration_is_found_where_it_is(clean):
    wave = 8 * np.sin(2 * np.pi * 31.7 * clean.time_s)
    found = check(moved(clean, np.outer(wave, [0, 1, 0])))
    assert found.p_value < 1e-4
    look = next(look for look in oddest(found) if look.kind == "line")
    assert look.axis == "y"
    assert look.band_hz[0] - 0.2 < 31.7 < look.band_hz[1] + 0.2
    assert {one.axis for one in oddest(found, 1e-6)} <= {"y", "xy", "yz"}
    # an error of a tenth of the spectrum's steps is 10 standard errors of such a line's frequency
    assert evidence_of(found).lines_hz[0] == pytest.approx(31.7, abs=0.1 * 120 / FRAMES)


def test_a_wrong_viscosity_is_seen_in_lateral_motion(clean):
    wrong = setup(buffer={"viscosity_mPa_s": 0.89 / 1.4})
    found = check(replace(clean, setup=wrong))
    assert found.p_value < 1e-6
    assert "friction" in {look.kind for look in oddest(found)}


def test_drift_that_the_reference_does_not_share_is_seen_at_low_frequencies(clean):
    walk = np.cumsum(generator(3).normal(size=(len(clean.time_s), 3)), axis=0)
    found = check(moved(clean, 0.5 * walk))
    assert found.p_value < 1e-4
    low = [look.band_hz for look in oddest(found, 1e-6) if look.kind == "psd_band"]
    assert min(top for _, top in low) < 5.0


def test_missing_frames_that_the_file_counts_over_are_seen(clean):
    kept = np.flatnonzero(generator(4).random(len(clean.time_s)) > 0.25)
    time_s = clean.time_s[: len(kept)]
    found = check(
        replace(
            clean,
            time_s=time_s,
            frame=clean.frame[: len(kept)],
            positions_nm={bead: xyz[kept] for bead, xyz in clean.positions_nm.items()},
            magnet_mm=clean.magnet_mm[kept],
            plateaus=find_plateaus(time_s, clean.magnet_mm[kept], clean.setup.plateaus),
        )
    )
    assert found.p_value < 1e-3


@pytest.mark.slow
def test_turned_axes_are_seen_between_x_and_y(clean):
    xyz = clean.positions_nm["b1"]
    anchor = np.append(np.nanmean(xyz[:, :2], axis=0), 0.0)
    c, s = np.cos(np.radians(20)), np.sin(np.radians(20))
    turned = (xyz - anchor) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + anchor
    prepared = case(replace(clean, positions_nm=clean.positions_nm | {"b1": turned}))
    # of few simulations p depends on which they are
    found = check_bead(prepared, generator(1), rounds=(120,))
    assert found.p_value < 1e-3
    assert "xy" in {look.axis for look in oddest(found, 0.01)}


def test_twins_lose_the_frames_that_the_recording_lost(clean):
    one = case(clean)
    twin = TwinMaker(one).draw(generator(2))
    for simulated, recorded in zip(twin.positions_nm, one.positions_nm, strict=True):
        assert np.array_equal(np.isfinite(simulated), np.isfinite(recorded))
    for simulated, recorded in zip(twin.references_nm, one.references_nm, strict=True):
        spread = np.nanstd(recorded, axis=0)
        # what is left of the reference is its noise: 2048 frames, 8 % is five standard errors
        assert np.nanstd(simulated, axis=0) == pytest.approx(spread, rel=0.08)


def test_a_reference_that_is_not_simulated_is_the_recorded_one(clean):
    """A loose reference has a motion that no experiment has. In simulations it did not move at all,
    so that any correlation with it had a probability of 1e-95.
    """
    one = case(clean)
    cutoff_hz = one.fit.model.subtraction.cutoff_hz
    model = replace(one.fit.model, subtraction=Subtraction(cutoff_hz, (0.0, 2.0, 0.0)))
    one = replace(one, fit=replace(one.fit, model=model))
    twin = TwinMaker(one).draw(generator(2))
    for simulated, recorded in zip(twin.references_nm, one.references_nm, strict=True):
        np.testing.assert_array_equal(simulated[:, [0, 2]], recorded[:, [0, 2]])
        assert not np.array_equal(simulated[:, 1], recorded[:, 1], equal_nan=True)
    found = check_bead(one, generator(1), rounds=ROUNDS)
    coherences = [p for s, p in zip(found.statistics, found.p_values, strict=True)
                  if s.kind == "reference_coherence" and s.axis in "xz"]  # fmt: skip
    assert coherences
    assert min(coherences) > 1e-4


def test_stage_is_measured_from_the_reference(clean):
    # the typical stage of the simulation; some hundred cosine coefficients below the cutoff
    assert case(clean).fit.model.subtraction.stage_nm_per_root_s == pytest.approx(
        (1.0, 1.0, 1.5), rel=0.4
    )


def test_what_subtraction_leaves_of_the_stages_walk_is_expected():
    """Drawn 80 times: means of 80 ordinates and more, within four standard errors of 11 %."""
    one, random = case(raw(11)), generator(5)
    model, cutoff_hz, walk_nm = one.fit.model, 0.8, 5.0
    power = []
    for left_nm in (walk_nm, 0.0):
        subtraction = Subtraction((cutoff_hz,) * 3, (0.0,) * 3, (left_nm,) * 3)
        expected = replace(model, subtraction=subtraction).all_expected(one.fit.theta)
        power.append(expected[0].random_power)
    added = power[0] - power[1]
    found = np.zeros_like(added)
    for _ in range(80):
        steps = random.normal(size=(3 * len(one.positions_nm[0]), 3))
        stage = walk_nm * np.sqrt(one.frame_s) * np.cumsum(steps, axis=0)
        slow = [low_pass(along, 1 / one.frame_s, cutoff_hz) for along in stage.T]
        left = (stage - np.transpose(slow))[len(stage) // 3 : 2 * len(stage) // 3]
        found += plateau_data(left, one.frame_s, one.phi[0]).spectrum.power / 80
    for axis in range(3):
        seen = added[:, axis, axis] > 0.1 * added[:, axis, axis].max()
        assert seen.sum() > 10
        ratio = found[seen, axis, axis] / added[seen, axis, axis]
        assert np.mean(ratio) == pytest.approx(1.0, abs=0.1)
        assert np.all(np.abs(ratio - 1) < 0.5)


def test_a_focus_turned_in_a_plateau_is_no_motion_of_the_stage(clean):
    """Where the stage jumps, all beads jump; elsewhere it moves as before."""
    drift = clean.setup.drift.model_copy(update={"cutoff_hz": 1.0})
    still = replace(clean, setup=clean.setup.model_copy(update={"drift": drift}))
    jump = np.zeros((len(clean.time_s), 3))
    jump[(clean.plateaus[1].start + clean.plateaus[1].stop) // 2 :] = [0.0, 0.0, 3000.0]
    turned = moved(moved(still, jump), jump, "ref1")
    expected = np.array(case(still).fit.model.subtraction.stage_nm_per_root_s)
    np.testing.assert_allclose(
        case(turned).fit.model.subtraction.stage_nm_per_root_s, expected, rtol=0.3
    )


@pytest.mark.slow
def test_table_has_a_row_per_look_and_its_columns(clean):
    found = mtpipe.crosscheck(subtract_drift(clean), seed=3)
    table = found.table
    check_of = found.beads["b1"]
    assert tuple(table.columns) == COLUMNS
    assert len(table) == len(check_of.statistics)
    assert (table["bead_p_value"] == check_of.p_value).all()
    assert table["plateau"].isna().sum() == sum(look.pooled for look in check_of.statistics)
    assert table["p_value"].between(0, 1).all()
    assert (table["simulated_low"] <= table["simulated_high"]).all()
    assert crosscheck_table(found).equals(table)
    spectra = crosscheck_curves(found)["spectrum"]
    assert set(spectra["axis"]) == {"x", "y", "z"}


def test_without_a_cross_check_the_tables_are_empty_and_have_their_columns():
    assert list(crosscheck_table(None).columns) == list(COLUMNS)
    for table in crosscheck_curves(None).values():
        assert isinstance(table, pd.DataFrame)
        assert table.empty
        assert "bead" in table


def test_beads_draw_from_streams_of_their_own():
    assert bead_generator(1, "b1").random() == bead_generator(1, "b1").random()
    assert bead_generator(1, "b1").random() != bead_generator(1, "b2").random()
    assert bead_generator(1, "b1").random() != bead_generator(2, "b1").random()


def test_a_bead_without_heights_is_left_out_with_its_reason(clean):
    flat = clean.positions_nm["b1"] * np.array([1.0, 1.0, np.nan])
    blind = replace(clean, positions_nm=clean.positions_nm | {"b1": flat})
    found = mtpipe.crosscheck(subtract_drift(blind))
    assert not found.beads
    assert "b1 has no plateau of 256 frames with x, y and z" in found.refused["b1"]
    assert found.table.empty


@pytest.mark.parametrize(
    ("table", "key", "truth"),
    [
        ("beads", "radius_nm", 1400.0),
        ("tether", "contour_length_nm", 2700.0),
        ("tether", "persistence_length_nm", 50.0),
    ],
)
def test_what_is_unknown_is_estimated_and_the_recording_checked(clean, table, key, truth):
    unknown = replace(clean, setup=setup(**{table: {key: "unknown"}}))
    prepared = prepare(subtract_drift(unknown), "b1")
    found = described(prepared)
    place = found.bead if table == "beads" else found.chain
    stderr = float(np.sqrt(prepared.fit.covariance[len(FORCES_PN), len(FORCES_PN)]))
    assert abs(np.log(getattr(place, key) / truth)) < 4 * stderr
    assert stderr < 0.05
    assert check_bead(prepared, generator(3), rounds=ROUNDS).p_value > 1e-3


def test_a_high_passed_recording_is_refused(clean):
    choice = {"method": "highpass", "cutoff_hz": 0.5}
    content = clean.setup.model_dump(by_alias=True) | {"drift": choice}
    changed = replace(clean, setup=Setup.model_validate(content))
    with pytest.raises(RecordingError, match="lost its own slow motion"):
        prepare(subtract_drift(changed), "b1")


def test_without_reference_beads_the_drift_is_seen(clean):
    alone = {"b1": clean.positions_nm["b1"] + 0.02 * np.arange(len(clean.time_s))[:, None]}
    nothing = replace(clean, positions_nm=alone, setup=setup(beads={"reference": []}))
    found = check(nothing)
    assert found.case.references_nm is None
    assert found.p_value < 1e-4
    # a drift of z is a trend, and puts mean heights off as much
    assert {"mean_trend", "extension"} <= {look.kind for look in oddest(found)}


def shaken(recording, size_nm):
    return moved(
        recording, np.outer(size_nm * np.sin(2 * np.pi * 31.7 * recording.time_s), [0, 1, 0])
    )


@pytest.mark.slow
def test_few_simulations_are_enough_where_the_answer_is_clear(clean):
    far_off = check_bead(case(shaken(clean, 200.0)), generator(1))
    assert ROUNDS_OF[0] <= len(far_off.simulated) < ENOUGH
    assert far_off.p_value < FAR_OFF
    agrees = check_bead(case(clean), generator(1))
    number = len(agrees.simulated)
    assert agrees.p_value > CONSISTENT_BY_FEW.get(number, CLEARLY_CONSISTENT)
    assert number == ENOUGH or number in CONSISTENT_BY_FEW
    # the less the more simulations there are, as p-values of few scatter more
    levels = [CONSISTENT_BY_FEW.get(goal, CLEARLY_CONSISTENT) for goal in ROUNDS_OF]
    assert levels == sorted(levels, reverse=True)


@pytest.mark.slow
def test_a_check_goes_on_from_the_simulations_of_another(clean):
    whole = check_bead(case(clean), generator(1), rounds=(20,))
    random = generator(1)
    begun = check_bead(case(clean), random, rounds=(12,))
    more = check_bead(begun.case, random, rounds=(20,), begun=begun)
    assert np.array_equal(more.simulated, whole.simulated)


def test_theory_is_off_by_the_same_all_through_a_plateau(clean, monkeypatch):
    """A plateau whose force changes is played in pieces."""
    prepared = case(clean)
    model = prepared.fit.model
    courses = (ForceCourse(0.1), ForceCourse(), ForceCourse(0.3, "step", 0.5))
    model = replace(model, experiment=with_magnets(model.experiment, courses=courses))
    maker = TwinMaker(replace(prepared, fit=replace(prepared.fit, model=model)))
    played = []

    def simulate_motion(stretches, camera, random, *, unseen):
        # four pieces, a move, one, a move, two
        assert unseen == {4, 5, 6, 7, 9, 10, 11, 12}
        played.append([state for state, _ in stretches])
        return np.zeros((sum(frames for _, frames in stretches), 3))

    monkeypatch.setattr("mtpipe.crosschecking.twin.simulate_motion", simulate_motion)
    random = generator(1)
    for _ in range(6):
        maker.draw(random)
    variants = [[state for state, _ in stretches] for stretches in maker.variants]
    chosen = np.array(
        [
            [next(k for k in range(4) if variants[k][i] is state) for i, state in enumerate(states)]
            for states in played
        ]
    )
    first, last = chosen[:, :4], chosen[:, -2:]
    assert np.all(first == first[:, :1])
    assert np.all(last == last[:, :1])
    assert np.any(first[:, 0] != last[:, 0])
    assert len(np.unique(first)) > 1


@pytest.mark.slow
def test_curves_are_of_enough_simulations_and_change_nothing_else(clean):
    drawn, without = (
        check_bead(case(clean), generator(1), rounds=(12,), with_curves=with_curves)
        for with_curves in (True, False)
    )
    assert np.array_equal(drawn.simulated, without.simulated)
    assert len(drawn.simulated) == 12
    # of twelve the outermost two would hold fewer of the recorded values
    inside = np.concatenate([(c.recorded >= c.low) & (c.recorded <= c.high) for c in drawn.curves])
    assert 0.88 < np.mean(inside) < 0.98


@pytest.mark.slow
def test_p_values_compare_from_as_many_simulations():
    clean = raw(12)
    full = check_bead(case(shaken(clean, 8.0)), generator(2), rounds=(ENOUGH,))
    few = replace(full, simulated=full.simulated[:24], overall=replace(full.overall, p_value=0.5))
    assert comparable_p_values(full, full) == (full.p_value, full.p_value)
    first, second = comparable_p_values(full, few)
    assert first == second
    assert full.p_value < first < 1e-3


@pytest.mark.slow
def test_what_a_change_of_traces_will_do_is_foreseen_beside_the_simulations_there_are(clean):
    odd = check_bead(case(shaken(clean, 8.0)), generator(3), rounds=(ENOUGH,))
    assert foreseen_p_value(odd, odd.case) == pytest.approx(odd.p_value, rel=5)
    assert foreseen_p_value(odd, case(clean)) > 0.01
    lost = replace(clean, positions_nm=clean.positions_nm | {"b1": clean.positions_nm["b1"].copy()})
    lost.positions_nm["b1"][300:420] = np.nan
    # lost frames are looked at where there are enough: what only one of them has is left out
    assert foreseen_p_value(odd, case(lost)) > 0.01


@pytest.mark.slow
def test_simulations_spread_over_processes_are_the_same_to_the_bit(clean):
    prepared, checks, left = case(clean), [], []
    for parts in (1, 2):
        random = generator(6)
        checks.append(
            with_parts(parts, check_bead, prepared, random, rounds=(8, 12), with_curves=True)
        )
        left.append(random.normal())
    alone, spread = checks
    assert (alone.simulated == spread.simulated).all()
    assert alone.p_value == spread.p_value
    for one, other in zip(alone.curves, spread.curves, strict=True):
        assert (one.median == other.median).all()
    assert left[0] == left[1]


def test_simulations_drawn_ahead_leave_the_generator_as_if_they_were_not(clean):
    maker = TwinMaker(case(clean))
    ahead, alone = generator(7), generator(7)
    draws = _Draws(maker, ahead)
    for _ in range(3):
        draws.next()
    draws.back_to(1)  # the second could not be looked at
    for _ in range(2):
        maker.draw(alone)
    assert ahead.normal() == alone.normal()
