"""Drift subtraction against simulated stages whose motion is known."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mtpipe.drift import reference_noise_nm, subtract_drift
from mtpipe.drift.lowpass import low_pass
from mtpipe.drift.stage_moves import stage_moves_nm
from mtpipe.recording.recording import Plateau, Recording
from mtpipe.setup.setup import parse_setup
from mtpipe.setup.tables import DriftChoice
from tests.stage import RATE_HZ, N, codes, ou, recording_of, walk

SHARED = Path(__file__).resolve().parents[2] / "shared" / "challenge"


def scene(rng, drift, noises=(1.5,), bead_rms_nm=30.0):
    """A tethered bead b1 and references ref1, ref2, ... that share the stage's drift."""
    n = len(drift)
    positions = {"b1": drift + ou(rng, n, bead_rms_nm, 5.0) + [0, 0, 2500.0]}
    for i, noise in enumerate(noises, start=1):
        positions[f"ref{i}"] = drift + noise * rng.standard_normal((n, 3)) + 1000.0 * i
    return positions, [f"ref{i}" for i in range(1, len(noises) + 1)]


def error_nm(recording: Recording, drift, choice=None):
    """Root mean square, per axis, of what the subtraction got wrong."""
    wrong = subtract_drift(recording, choice=choice).drift.subtracted_nm - drift
    return np.nanstd(wrong, axis=0)


@pytest.mark.parametrize("step_nm", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("noises", [(1.5,), (1.5, 0.7), (2.0, 1.0, 1.5)])
def test_white_noise_of_references_is_found_amid_drift(step_nm, noises):
    rng = np.random.default_rng(1)
    positions, references = scene(rng, walk(rng, N, step_nm), noises)
    found = reference_noise_nm(recording_of(positions, references))
    for reference, noise in zip(references, noises, strict=True):
        tolerance = 0.04 if step_nm < 1 or len(noises) > 1 else 0.10
        np.testing.assert_allclose(found[reference], noise, rtol=tolerance)


def test_a_random_walk_in_the_floor_is_not_taken_for_noise():
    rng = np.random.default_rng(2)
    positions, references = scene(rng, walk(rng, N, 1.0), (0.3,))
    naive = np.diff(positions["ref1"], axis=0).std(axis=0) / np.sqrt(2)
    found = np.array(reference_noise_nm(recording_of(positions, references))["ref1"])
    assert (naive > 0.7).all()
    assert (found < 0.45).all()


def stage(name, rng):
    t = np.arange(N) / RATE_HZ
    line = 8 * np.sin(2 * np.pi * 29.8 * t + 1) + 4 * np.sin(2 * np.pi * 35.7 * t)
    return {
        "walk 0.02": lambda: walk(rng, N, 0.02),
        "walk 0.1": lambda: walk(rng, N, 0.1),
        "walk 0.5": lambda: walk(rng, N, 0.5),
        "walk 3": lambda: walk(rng, N, 3.0),
        "ramp": lambda: np.outer(t, [1.0, -3.0, 0.1]),
        "ramp and walk": lambda: np.outer(t, [1.0, -3.0, 0.1]) + walk(rng, N, 0.1),
        "lines": lambda: line[:, None] + walk(rng, N, 0.1),
        "focus steps": lambda: (
            np.outer(200.0 * np.floor(t / 30), [0.1, 0.1, 5]) + walk(rng, N, 0.1)
        ),
    }[name]()


STAGES = ["walk 0.02", "walk 0.1", "walk 0.5", "walk 3", "ramp", "ramp and walk", "lines"]


@pytest.mark.parametrize("name", STAGES)
def test_the_cutoff_chosen_is_within_a_few_percent_of_the_best(name):
    rng = np.random.default_rng(3)
    drift = stage(name, rng)
    positions, references = scene(rng, drift)
    recording = recording_of(positions, references)
    scan = [
        [np.std(low_pass(positions["ref1"][:, a], RATE_HZ, cutoff) - drift[:, a]) for a in range(3)]
        for cutoff in np.geomspace(0.03, 80, 40)
    ]
    frame_by_frame = error_nm(recording, drift, DriftChoice(cutoff_hz="none"))
    chosen = error_nm(recording, drift)
    # Below 0.1 nm, a fifteenth of the noise, the error is that of the line's two parameters.
    best = np.maximum(np.minimum(np.min(scan, axis=0), frame_by_frame), 0.1)
    assert (chosen < 1.06 * best).all()
    assert (chosen < 1.02 * frame_by_frame).all()
    assert (chosen < 1.02 * np.maximum(drift.std(axis=0), 0.1)).all()


def test_cutoffs_lie_where_they_should():
    rng = np.random.default_rng(4)
    cutoffs = {}
    for name in ("ramp", "walk 0.1", "lines"):
        positions, references = scene(rng, stage(name, rng))
        cutoffs[name] = np.array(
            subtract_drift(recording_of(positions, references)).drift.cutoff_hz, dtype=float
        )
    # A walk's power a/(2 pi f/rate)^2 meets the noise at rate/2pi * 0.1/1.5 = 1.3 Hz.
    assert (cutoffs["ramp"] < 0.1).all()
    assert ((cutoffs["walk 0.1"] > 0.6) & (cutoffs["walk 0.1"] < 2.6)).all()
    assert (cutoffs["lines"] > 36).all()


def test_noise_added_is_the_error_without_drift():
    rng = np.random.default_rng(5)
    positions, references = scene(rng, np.zeros((N, 3)))
    recording = recording_of(positions, references)
    for cutoff in (2.0, 20.0, "none"):
        choice = DriftChoice(cutoff_hz=cutoff)
        added = subtract_drift(recording, choice=choice).drift.noise_added_nm
        np.testing.assert_allclose(added, error_nm(recording, 0.0, choice), rtol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("cutoff", ["auto", 0.4, 3.0, "none"])
def test_error_of_the_start_is_what_is_stated(cutoff):
    """100 recordings, three axes: the root mean square is known to 4 %, and stated to 15 %."""
    rng = np.random.default_rng(7)
    n = 3000
    wrong, stated = [], []
    for _ in range(100):
        drift = walk(rng, n, 0.15)
        recording = recording_of(*scene(rng, drift, (2.0,)))
        found = subtract_drift(recording, choice=DriftChoice(cutoff_hz=cutoff)).drift
        # without noise in between: what the bead's own positions would be moved by
        frames = 30 if cutoff == "none" else 1
        inside = slice(n // 4, 3 * n // 4)
        missed = found.subtracted_nm - (drift - drift[:frames].mean(axis=0))
        wrong.append(missed[inside].mean(axis=0))
        stated.append(found.start_stderr_nm)
    ratio = np.sqrt(np.mean(np.square(wrong)) / np.mean(np.square(stated)))
    assert 0.8 < ratio < 1.2


def test_references_stay_raw_and_positions_keep_their_origin():
    rng = np.random.default_rng(6)
    drift = stage("ramp and walk", rng)
    positions, references = scene(rng, drift, (1.0, 2.0))
    before = {bead: xyz.copy() for bead, xyz in positions.items()}
    result = subtract_drift(recording_of(positions, references))
    assert result.positions_nm["ref1"] is positions["ref1"]
    for bead, xyz in before.items():
        np.testing.assert_array_equal(positions[bead], xyz)
    np.testing.assert_array_equal(result.drift.subtracted_nm[0], 0)
    np.testing.assert_allclose(
        result.positions_nm["b1"], before["b1"] - result.drift.subtracted_nm, rtol=1e-14
    )
    weights = np.array([u.weight for u in result.drift.references])
    np.testing.assert_allclose(weights[0] / weights[1], 4.0, rtol=0.15)
    np.testing.assert_allclose(weights.sum(axis=0), 1.0)


@pytest.mark.parametrize("noises", [(1.5,), (1.5, 1.0), (1.5, 1.0, 1.2)])
@pytest.mark.parametrize("name", ["walk 0.1", "walk 0.5", "lines", "focus steps"])
def test_good_references_are_never_accused(name, noises):
    for seed in range(4):
        rng = np.random.default_rng(100 + seed)
        positions, references = scene(rng, stage(name, rng), noises)
        result = subtract_drift(recording_of(positions, references))
        assert all(u.used and not u.reason for u in result.drift.references)
        assert result.notices == ()


@pytest.mark.parametrize("noises", [(1.5,), (1.5, 1.5)])
def test_mistracked_frames_do_not_poison_the_drift(noises):
    rng = np.random.default_rng(7)
    drift = stage("walk 0.1", rng)
    positions, references = scene(rng, drift, noises)
    clean = error_nm(recording_of(positions, references), drift)
    spoilt = positions | {"ref1": positions["ref1"].copy()}
    wrong = np.concatenate([np.arange(9000, 9200), rng.integers(0, N, 40)])
    spoilt["ref1"][wrong, 2] += rng.choice([-1, 1], len(wrong)) * rng.uniform(1e2, 4e5, len(wrong))
    result = subtract_drift(recording_of(spoilt, references))
    error = np.nanstd(result.drift.subtracted_nm - drift, axis=0)
    assert (error < 1.1 * clean).all()
    notice = next(n for n in result.notices if n.code == "reference_mistracked")
    assert notice.bead == "ref1"
    assert 230 <= int(notice.message.split(" in ")[1].split()[0]) <= 340


@pytest.mark.parametrize("number", [2, 3])
def test_a_reference_that_jumps_is_left_out_and_named(number):
    rng = np.random.default_rng(8)
    drift = stage("walk 0.1", rng)
    positions, references = scene(rng, drift, (1.0,) * number)
    positions["ref2"][6000:, 0] += 12.0
    result = subtract_drift(recording_of(positions, references))
    uses = {u.bead: u for u in result.drift.references}
    assert [b for b, u in uses.items() if not u.used] == ["ref2"]
    assert uses["ref2"].weight == (0, 0, 0)
    assert "jumps once along x, first at 50.0 s" in uses["ref2"].reason
    assert ("reference_left_out", "ref2") in codes(result)
    assert (np.nanstd(result.drift.subtracted_nm - drift, axis=0) < 0.4).all()


@pytest.mark.parametrize("number", [2, 3])
def test_a_loosely_attached_reference_is_left_out_and_named(number):
    rng = np.random.default_rng(9)
    drift = stage("walk 0.1", rng)
    positions, references = scene(rng, drift, (1.0,) * number)
    positions["ref1"] += ou(rng, N, 6.0, 8.0)
    result = subtract_drift(recording_of(positions, references))
    assert [u.bead for u in result.drift.references if not u.used] == ["ref1"]
    notice = next(n for n in result.notices if n.code == "reference_left_out")
    assert "loosely attached" in notice.message
    assert notice.bead == "ref1"


def test_the_only_reference_is_named_when_loose_and_its_motion_is_not_passed_on():
    rng = np.random.default_rng(10)
    drift = stage("walk 0.1", rng)
    positions, references = scene(rng, drift, (1.0,))
    positions["ref1"] += ou(rng, N, 6.0, 8.0)
    recording = recording_of(positions, references)
    result = subtract_drift(recording)
    notice = next(n for n in result.notices if n.code == "reference_moves")
    assert (notice.severity, notice.bead) == ("warning", "ref1")
    assert "loosely attached" in result.drift.references[0].reason
    error = error_nm(recording, drift)
    assert (error < 0.6 * error_nm(recording, drift, DriftChoice(cutoff_hz="none"))).all()
    assert (error < drift.std(axis=0)).all()


def test_the_only_reference_is_named_when_it_jumps_and_the_stage_is_not():
    rng = np.random.default_rng(11)
    jump = np.where(np.arange(N) < 8000, 0.0, 60.0)[:, None] * [1, 0, 0]
    positions, references = scene(rng, stage("walk 0.1", rng), (1.0,), bead_rms_nm=15.0)
    alone = positions | {"ref1": positions["ref1"] + jump}
    result = subtract_drift(recording_of(alone, references))
    assert ("reference_moves", "ref1") in codes(result)
    assert "jumps once along x" in result.drift.references[0].reason
    both = {bead: xyz + jump for bead, xyz in positions.items()}
    assert codes(subtract_drift(recording_of(both, references))) == []


@pytest.mark.parametrize("lasts_s", [0.0, 0.3])
def test_a_focus_that_is_moved_leaves_no_swing(lasts_s):
    """A low-pass would leave half of the move, and ten times the noise for half a second."""
    rng = np.random.default_rng(11)
    drift = walk(rng, N, 0.2)
    time_s = np.arange(N) / RATE_HZ
    drift[:, 2] += np.interp(time_s, [30.0, 30.0 + lasts_s + 0.5 / RATE_HZ], [0.0, 400.0])
    recording = recording_of(*scene(rng, drift))
    wrong = subtract_drift(recording).drift.subtracted_nm[:, 2] - drift[:, 2]
    wrong -= np.median(wrong)
    about = np.abs(time_s - 30.0) < 1.0
    assert np.abs(wrong[about]).max() < 40.0 if lasts_s else np.abs(wrong[about]).max() < 5.0
    assert wrong[about].std() < 4.0 if lasts_s else wrong[about].std() < 1.5


@pytest.mark.parametrize("name", STAGES)
def test_other_stages_are_left_to_the_low_pass(name):
    rng = np.random.default_rng(12)
    drift = stage(name, rng)
    for axis in range(3):
        seen = drift[:, axis] + 1.5 * rng.standard_normal(N)
        assert not stage_moves_nm(seen, RATE_HZ).any()


def test_a_reference_that_is_lost_for_a_while_leaves_no_step():
    rng = np.random.default_rng(12)
    drift = stage("walk 0.1", rng)
    positions, references = scene(rng, drift, (1.0, 1.0))
    positions["ref1"] += np.linspace(0, 40, N)[:, None]
    positions["ref1"][5000:5600] = np.nan
    positions["ref2"][9000:9300] = np.nan
    result = subtract_drift(recording_of(positions, references), choice=DriftChoice(cutoff_hz=2))
    wrong = result.drift.subtracted_nm - drift - np.linspace(0, 20, N)[:, None]
    assert np.isfinite(wrong).all()
    for edge in (5000, 5600, 9000, 9300):
        step = wrong[edge : edge + 120].mean(axis=0) - wrong[edge - 120 : edge].mean(axis=0)
        assert (np.abs(step) < 0.6).all()


def test_short_losses_are_bridged_and_long_ones_lose_the_tethered_beads():
    rng = np.random.default_rng(13)
    drift = stage("walk 0.1", rng)
    positions, references = scene(rng, drift)
    positions["ref1"][3000:3010] = np.nan
    positions["ref1"][7000:8000] = np.nan
    result = subtract_drift(recording_of(positions, references), choice=DriftChoice(cutoff_hz=2))
    lost = np.isnan(result.positions_nm["b1"]).any(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(lost), np.arange(7000, 8000))
    notice = next(n for n in result.notices if n.code == "reference_lost")
    assert "1000 frames" in notice.message
    frame_by_frame = subtract_drift(
        recording_of(positions, references), choice=DriftChoice(cutoff_hz="none")
    )
    assert np.isnan(frame_by_frame.positions_nm["b1"]).any(axis=1).sum() == 1010


def test_missing_frames_and_a_pause_of_hours_do_not_ring():
    rng = np.random.default_rng(14)
    drift = stage("walk 0.1", rng)
    drift[9000:] += 5000.0
    frame = np.arange(N)
    frame[4000:] += 5
    frame[9000:] += 10**8
    positions, references = scene(rng, drift)
    plateaus = (Plateau(0, 0, 9000, None), Plateau(1, 9000, N, None))
    recording = recording_of(positions, references, frame=frame, plateaus=plateaus)
    wrong = subtract_drift(recording).drift.subtracted_nm - drift
    assert (wrong[:9000].std(axis=0) < 0.4).all()
    assert (wrong[9000:].std(axis=0) < 0.4).all()
    assert (np.abs(wrong[8990:9010] - wrong.mean(axis=0)) < 2.5).all()


def test_coarse_rounding_and_placeholders_are_no_faults_of_tracking():
    rng = np.random.default_rng(18)
    positions, references = scene(rng, stage("walk 0.1", rng), (1.0, 1.0))
    positions["ref1"] = np.round(positions["ref1"] / 5) * 5
    assert subtract_drift(recording_of(positions, references)).notices == ()
    positions["ref1"] = np.full((N, 3), 7.0)
    result = subtract_drift(recording_of(positions, references))
    assert [u.bead for u in result.drift.references if u.used] == ["ref2"]
    assert codes(result) == [("reference_left_out", "ref1")]


def test_an_axis_without_reference_keeps_its_drift_and_says_so():
    rng = np.random.default_rng(15)
    positions, references = scene(rng, stage("walk 0.1", rng))
    positions["ref1"][:, 2] = np.nan
    result = subtract_drift(recording_of(positions, references))
    np.testing.assert_array_equal(result.positions_nm["b1"][:, 2], positions["b1"][:, 2])
    said = [(n.code, n.axis) for n in result.notices]
    assert said == [("no_reference", "z"), ("drift_left", "z")]
    message = result.notices[0].message
    assert message.startswith("No reference bead was tracked along z")
    assert message.endswith("drift along z was not removed, and slow motion may contain it.")


def test_without_reference_nothing_is_removed_and_the_choice_is_named():
    rng = np.random.default_rng(16)
    positions, _ = scene(rng, stage("walk 0.1", rng), ())
    recording = recording_of(positions, [])
    result = subtract_drift(recording)
    np.testing.assert_array_equal(result.positions_nm["b1"], positions["b1"])
    notice, size = result.notices
    assert (notice.code, notice.severity) == ("no_reference", "caution")
    assert 'method = "highpass"' in notice.message
    assert (size.code, size.severity) == ("drift_left", "caution")
    for one in result.notices:  # they stand alone in terminal and report
        assert one.message[0].isupper()
        assert one.message.endswith(".")
    kept = subtract_drift(recording, choice=DriftChoice(method="none"))
    assert [n.code for n in kept.notices] == ["drift_kept", "drift_left"]
    assert kept.drift.method == "none"


def test_highpass_removes_ramps_to_the_ends_and_keeps_extensions():
    rng = np.random.default_rng(17)
    t = np.arange(N) / RATE_HZ
    drift = np.outer(t, [2.0, -2.0, 2.0])
    positions, _ = scene(rng, drift, ())
    still = positions["b1"] - drift
    positions["b1"][8192:, 2] -= 800.0
    positions["b1"][500:510] = np.nan
    plateaus = (Plateau(0, 0, 8192, 5.0), Plateau(1, 8192, N, 6.0))
    recording = recording_of(positions, [], plateaus=plateaus)
    result = subtract_drift(recording, choice=DriftChoice(method="highpass", cutoff_hz=0.2))
    assert result.drift.cutoff_hz == (0.2, 0.2, 0.2)
    xyz = result.positions_nm["b1"]
    # What is left of x and y is the still bead without its own slow part, at the ends too.
    for part in (slice(0, 400), slice(N - 400, N)):
        away = xyz[part, :2].mean(axis=0) - np.nanmean(xyz[:, :2], axis=0)
        assert (np.abs(away) < 15).all()
    np.testing.assert_allclose(np.nanstd(xyz[:, :2], axis=0), still[:, :2].std(axis=0), rtol=0.05)
    for p in plateaus:
        rows = slice(p.start, p.stop)
        raw, left = positions["b1"][rows, 2], xyz[rows, 2]
        assert np.nanmean(left) == pytest.approx(np.nanmean(raw), abs=0.5)
        assert np.nanstd(left) == pytest.approx(30, rel=0.05)
    untouched = dataclasses.replace(recording, plateaus=())
    zless = subtract_drift(untouched, choice=DriftChoice(method="highpass", cutoff_hz=0.2))
    np.testing.assert_array_equal(zless.positions_nm["b1"][:, 2], positions["b1"][:, 2])


CASES = ["rec_202540ed", "rec_b3eb60e5", "rec_cd3c3323", "rec_d425caec"]


@pytest.mark.skipif(not SHARED.exists(), reason="no ../shared beside the checkout")
@pytest.mark.parametrize("case", CASES)
def test_reference_noise_of_an_independent_simulator(case):
    import json

    from mtpipe.recording.plateaus import find_plateaus

    folder = SHARED / "cases" / case
    setup = parse_setup(tomllib.loads((folder / "setup.toml").read_text()))
    table = pd.read_csv(folder / "recording.csv.gz", comment="#")
    time, magnet = table["time_s"].to_numpy(), table["magnet_mm"].to_numpy()
    positions = {b: table[[f"{b}_{a}_nm" for a in "xyz"]].to_numpy() for b in ("b1", "ref1")}
    frame = np.rint(time * setup.camera.frame_rate_hz.value).astype(np.int64)
    plateaus = find_plateaus(time, magnet, setup.plateaus)
    recording = Recording(case, setup, time, frame - frame[0], positions, magnet, plateaus)
    cases = json.loads((SHARED / "answers.json").read_text())["cases"]
    truth = next(c for c in cases if c["name"] == case)["reference_noise_nm"]
    np.testing.assert_allclose(reference_noise_nm(recording)["ref1"], truth, rtol=0.02)
    assert codes(subtract_drift(recording)) in ([], [("reference_lost", None)])
