"""Concealed effects are named, a clean recording is left alone; `mismatch.json` is as agreed."""

from __future__ import annotations

import functools
import importlib
import json
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

import mtpipe
from mtpipe.crosschecking.beads import bead_generator
from mtpipe.crosschecking.check import check_bead
from mtpipe.crosschecking.prepared_bead import FORMULAS, prepare
from mtpipe.diagnosis.alternatives import indistinguishable
from mtpipe.diagnosis.before_after import content_of
from mtpipe.diagnosis.evidence import (
    BLOCK_S,
    evidence_of,
    noise_between_blocks_nm2,
    reference_moves,
)
from mtpipe.diagnosis.explain import concluded, explain
from mtpipe.diagnosis.explanation import Alternative, Explanation, Named, agrees
from mtpipe.diagnosis.forces_to_quote import diagnosed_forces
from mtpipe.diagnosis.heldout import halves_of
from mtpipe.diagnosis.mismatch import Mismatch, _each_once
from mtpipe.diagnosis.naming import Weighed
from mtpipe.diagnosis.prior import CAUSE_NATS, with_one_more
from mtpipe.diagnosis.refit import other_formulas
from mtpipe.drift.lowpass import low_pass
from mtpipe.effects.catalogue import OWN
from mtpipe.effects.effect import Evidence
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.joint_fit.hypotheses import FittedEffect, best_of, together
from mtpipe.setup.setup import parse_setup
from mtpipe.simulation.simulate import simulate_experiment
from tests.simulated import VISCOSITY_MPA_S, setup_content

pytestmark = pytest.mark.slow

FORCES_PN, FRAMES = (0.8, 3.0, 10.0), 4096
SETUP = parse_setup(
    setup_content(model={"effects": ["wall_drag", "rotation_coupling", "tracking_noise"]})
)
AXIAL_SCALE, VISCOSITY_FACTOR = 0.9, 1.3
# Keys of FORMATS section 4, and no others.
BEAD = {
    "verdict", "located", "effects", "terms", "force_bound_percent", "material", "forces",
}  # fmt: skip
LOCATED = {"axis", "plateaus", "band_hz", "time_s", "statistic", "p_value"}
EFFECT = {
    "effect", "sentence", "parameters", "delta_bic", "heldout_gain_nats", "p_before", "p_after",
    "equivalent", "probability"}  # fmt: skip
PARAMETER = {"value", "stderr", "unit"}
FORCE = {
    "plateau", "magnet_mm", "force_pN", "stderr_pN", "force_before_pN", "stderr_before_pN",
}  # fmt: skip


def recording(concealed, seed):
    """What the setup says is simulated, but for what is concealed; the drift is subtracted."""
    experiment, _ = experiment_of(SETUP, FORCES_PN, FRAMES, formula=FORMULAS[0])
    if concealed == "viscosity":
        thick = VISCOSITY_FACTOR * VISCOSITY_MPA_S
        experiment = replace(experiment, fluid=replace(experiment.fluid, viscosity_mPa_s=thick))
    simulated = simulate_experiment(experiment, SETUP, seed)
    if concealed == "axial_scale":
        scale = np.array([1.0, 1.0, AXIAL_SCALE])
        scaled = {bead: xyz * scale for bead, xyz in simulated.positions_nm.items()}
        simulated = replace(simulated, positions_nm=scaled)
    return mtpipe.subtract_drift(simulated)


SEEDS = {"nothing": 1, "viscosity": 2, "axial_scale": 3}
every_case = pytest.mark.parametrize("concealed", list(SEEDS))


@functools.cache
def diagnosed(concealed):
    """The diagnosis, once for all tests."""
    found = mtpipe.diagnose(recording(concealed, SEEDS[concealed]))
    assert isinstance(found, Mismatch)
    assert not found.refused
    assert not found.unexplained
    return found


@functools.cache
def mismatch(concealed):
    return diagnosed(concealed).as_dict()


def bead(concealed):
    return mismatch(concealed)["beads"]["b1"]


def test_a_recording_that_is_as_configured_is_consistent():
    found = bead("nothing")
    assert (found["verdict"], found["located"], found["effects"]) == ("consistent", [], [])
    for row, force in zip(found["forces"], FORCES_PN, strict=True):
        assert row["force_pN"] == row["force_before_pN"]
        assert abs(row["force_pN"] - force) < 4 * row["stderr_pN"]


@pytest.mark.parametrize(
    ("concealed", "name", "truth", "unit"),
    [
        ("viscosity", "viscosity_mPa_s", VISCOSITY_FACTOR * VISCOSITY_MPA_S, "mPa s"),
        ("axial_scale", "factor", AXIAL_SCALE, ""),
    ],
)
def test_what_is_concealed_is_named_with_its_strength(concealed, name, truth, unit):
    found = bead(concealed)
    assert found["verdict"] == "explained"
    (named,) = found["effects"]
    assert named["effect"] == concealed
    ((said, strength),) = named["parameters"].items()
    assert (said, strength["unit"]) == (name, unit)
    assert abs(strength["value"] - truth) < 4 * strength["stderr"]
    assert strength["stderr"] < 0.1 * truth
    assert named["p_before"] < 0.004 <= named["p_after"]
    assert named["delta_bic"] < -20
    assert named["heldout_gain_nats"] > 5
    assert concealed not in named["equivalent"]


@pytest.mark.parametrize("concealed", ["viscosity", "axial_scale"])
def test_forces_are_nearer_to_the_truth_with_the_effect_than_without(concealed):
    off = {"force_pN": [], "force_before_pN": []}
    for row, force in zip(bead(concealed)["forces"], FORCES_PN, strict=True):
        assert abs(row["force_pN"] - force) < 4 * row["stderr_pN"]
        for key, values in off.items():
            values.append(math.log(row[key] / force))
    after, before = (np.sqrt(np.mean(np.square(values))) for values in off.values())
    assert after < before / 2


@pytest.mark.parametrize(("concealed", "axis"), [("viscosity", "x"), ("axial_scale", "z")])
def test_the_mismatch_is_located(concealed, axis):
    places = bead(concealed)["located"]
    assert axis in {place["axis"] for place in places}
    values = [place["p_value"] for place in places]
    assert values == sorted(values)
    assert values[0] < 1e-3
    for place in places:
        assert set(place["plateaus"]) <= set(range(len(FORCES_PN)))
        assert place["plateaus"]
        for interval in (place["band_hz"], place["time_s"]):
            assert interval is None or (len(interval) == 2 and interval[0] < interval[1])


@pytest.mark.parametrize("concealed", ["viscosity", "axial_scale"])
def test_the_sentence_says_cause_consequence_and_agreement(concealed):
    (named,) = bead(concealed)["effects"]
    sentence = named["sentence"]
    cause, consequence = {
        "viscosity": ("The buffer's viscosity is", r"(raised|lowered) forces by up to SIZE %"),
        "axial_scale": ("z is recorded", r"lowered forces to as little as SIZE of what they are"),
    }[concealed]
    assert sentence.startswith(cause)
    size = r"[\d.]+ ± [\d.]+"
    assert re.search(f"Ignoring it {consequence.replace('SIZE', size)}", sentence)
    assert "With this cause the recording agrees with its simulation" in sentence
    place = r"This shows most (along the field \(x\)|across the field \(y\)|in height \(z\))"
    where = rf"{place}.*(at [\d.–]+ pN \(plateaus? [\d, ]+\)|at all forces)\. Ignoring"
    assert re.search(where, sentence)
    assert not re.search(r"\b(nan|inf|none)\b", sentence, re.IGNORECASE)


def test_spectra_and_residuals_are_drawn_only_where_something_is_named():
    assert content_of(diagnosed("nothing").beads["b1"]) is None


@pytest.mark.parametrize("concealed", ["viscosity", "axial_scale"])
def test_residuals_are_chance_with_the_effect_and_not_without(concealed):
    drawn = content_of(diagnosed(concealed).beads["b1"])
    json.dumps(drawn, allow_nan=False)
    assert drawn["plateaus"] == [0, 1, 2]

    def squares(stage):
        left = drawn["residuals"][stage]
        assert len(left["height"]) == len(FORCES_PN)
        rows = [left["height"], *(row for axis in "xyz" for row in left[axis])]
        assert len(rows) == 1 + 3 * (len(drawn["bands_hz"]) - 1)
        return np.square([z for row in rows for z in row if z is not None])

    before, after = squares("before"), squares("after")
    # of about 90 normal variates: 1 ± 0.15
    assert 0.5 < after.mean() < 1.6
    assert after.max() < 5**2
    assert before.mean() > 1.5 * after.mean()


def test_spectra_are_drawn_where_the_effect_changes_most():
    found = diagnosed("viscosity").beads["b1"]
    drawn = content_of(found)
    assert [one["axis"] for one in drawn["spectra"]] == ["x", "y", "z"]
    case = found.after.case
    for axis, one in enumerate(drawn["spectra"]):
        spectrum = case.fit.model.data[one["plateau"]].spectrum
        assert sum(one["ordinates"]) == pytest.approx(spectrum.ordinates.sum())
        assert min(one["ordinates"]) >= 8
        recorded = spectrum.power[:, axis, axis] / spectrum.gain(axis)
        for stage in ("before", "after"):
            power = np.multiply(one[stage]["ratio"], one[stage]["expected_nm2_per_hz"])
            mean = np.average(recorded, weights=spectrum.ordinates)
            assert np.average(power, weights=one["ordinates"]) == pytest.approx(mean, rel=0.1)


@every_case
def test_mismatch_json_has_the_keys_of_the_contract_and_no_others(concealed):
    found = mismatch(concealed)
    assert set(found) == {"schema", "recording", "beads"}
    assert found["schema"] == "mtpipe.mismatch/1"
    assert set(found["beads"]) == {"b1"}
    one = bead(concealed)
    assert set(one) == BEAD
    assert one["verdict"] in ("consistent", "explained", "unexplained")
    assert all(set(place) == LOCATED for place in one["located"])
    assert all(set(named) == EFFECT for named in one["effects"])
    assert all(
        0.5 < named["probability"] <= 1 for named in one["effects"] if not named["equivalent"]
    )
    for named in one["effects"]:
        assert all(set(strength) == PARAMETER for strength in named["parameters"].values())
    assert [set(row) for row in one["forces"]] == [FORCE] * len(FORCES_PN)
    assert [row["plateau"] for row in one["forces"]] == [0, 1, 2]
    plateaus = recording(concealed, SEEDS[concealed]).plateaus
    assert [row["magnet_mm"] for row in one["forces"]] == [p.magnet_mm for p in plateaus]


@every_case
def test_mismatch_is_plain_data(concealed):
    text = json.dumps(mismatch(concealed), allow_nan=False)
    assert json.loads(text) == mismatch(concealed)


def test_where_no_effect_helps_the_mismatch_is_unexplained_and_still_located():
    random = bead_generator(0, "b1")
    check = check_bead(prepare(recording("viscosity", 2), "b1"), random)
    found = explain(check, random, effects=())
    assert (found.verdict, found.named, found.nearest) == ("unexplained", (), None)
    forces = diagnosed_forces(recording("viscosity", 2), {"b1": found}, seed=0)
    mismatch = Mismatch("r", {"b1": found}, forces, 0.03, {})
    row = mismatch.as_dict()["beads"]["b1"]
    assert row["located"]
    assert row["effects"] == []
    assert set(mismatch.unexplained) == {"b1"}
    assert "No effect could be tried." in found.unexplained.sentence


def test_a_bead_that_cannot_be_simulated_is_refused_in_words():
    flat = recording("nothing", 4)
    blind = flat.positions_nm["b1"] * np.array([1.0, 1.0, np.nan])
    steps = []
    found = mtpipe.diagnose(
        replace(flat, positions_nm=flat.positions_nm | {"b1": blind}),
        progress=lambda step, done, total: steps.append((step, done, total)),
    )
    assert found.beads == {}
    assert "b1" in found.refused["b1"]
    assert found.as_dict()["beads"] == {}
    assert any("b1: comparing with simulations" in step for step, _, _ in steps)
    assert steps[-1][1:] == (1, 1)


@pytest.mark.parametrize("whose", ["reference", "bead"])
def test_slow_motion_is_known_to_be_the_references_or_the_beads(whose):
    """By whether it goes against what was subtracted; false once in 2000 (3.5 standard errors)."""
    experiment, _ = experiment_of(SETUP, FORCES_PN, FRAMES, formula=FORMULAS[0])
    changes = {
        "reference": {"reference_nm": (12.0, 12.0, 0.0), "reference_s": 3.0},
        "bead": {"unsubtracted_nm_per_root_s": (8.0, 8.0, 0.0)},
    }
    experiment = replace(experiment, stage=replace(experiment.stage, **changes[whose]))
    simulated = mtpipe.subtract_drift(simulate_experiment(experiment, SETUP, 5))
    check = SimpleNamespace(case=prepare(simulated, "b1"))
    assert reference_moves(check) is (whose == "reference")


def test_drift_beside_a_loose_reference_is_laid_to_the_reference():
    """It moves 20 nm within 40 ms, so that the stage's drift cannot be seen and is left."""
    experiment, _ = experiment_of(SETUP, FORCES_PN, FRAMES, formula=FORMULAS[0])
    loose = {"reference_nm": (20.0, 20.0, 10.0), "reference_s": 0.04}
    stage = replace(experiment.stage, random_nm_per_root_s=(1.0, 1.0, 1.0), **loose)
    simulated = simulate_experiment(replace(experiment, stage=stage), SETUP, 5)
    check = SimpleNamespace(case=prepare(mtpipe.subtract_drift(simulated), "b1"))
    assert check.case.reference_loose
    evidence = Evidence((), FORCES_PN, reference_loose=True)
    fit = check.case.fit
    assert best_of(fit, next(e for e in OWN if e.name == "drift"), evidence) is None
    found = best_of(fit, next(e for e in OWN if e.name == "reference_noise"), evidence)
    described = found.fit.model.described(found.fit.theta)
    assert found.gain > 20
    assert "so that little could be subtracted" in found.effect.cause(described)
    walks = {name: value for name, value, _ in found.effect.strengths(described)}
    assert walks["walk_z_nm_per_root_s"] == pytest.approx(1.0, rel=0.4)


@pytest.mark.parametrize(
    ("relaxation_s", "lost"), [(0.02, 0.0), (0.5, 0.0), (5.0, 0.0), (0.02, 0.2)]
)
def test_a_reference_may_move_as_far_as_its_own_trace_allows(relaxation_s, lost):
    """What it does move is within that, and is most of it where little else is in its trace."""
    experiment, _ = experiment_of(SETUP, FORCES_PN, FRAMES, formula=FORMULAS[0])
    moving = {"reference_nm": (6.0, 4.0, 5.0), "reference_s": relaxation_s}
    stage = replace(experiment.stage, **moving)
    tracker = replace(experiment.tracker, reference_noise_nm=(0.1,) * 3)
    experiment = replace(experiment, stage=stage, tracker=tracker)
    simulated = simulate_experiment(experiment, SETUP, 5)
    reference = simulated.positions_nm["ref1"].copy()
    reference[np.random.default_rng(1).random(len(reference)) < lost] = np.nan
    positions = {**simulated.positions_nm, "ref1": reference}
    case = prepare(mtpipe.subtract_drift(replace(simulated, positions_nm=positions)), "b1")
    for axis, size_nm in enumerate(stage.reference_nm):
        assert 0.95 < case.reference_largest.at(axis, relaxation_s) / size_nm**2 < 1.6


@pytest.mark.parametrize("moved", ["reference", "bead"])
def test_motion_that_the_references_trace_does_not_have_is_not_the_references(moved):
    """z of the bead moves by 5 nm within 0.3 s; the reference's trace has that, or has noise."""
    experiment, _ = experiment_of(SETUP, FORCES_PN, FRAMES, formula=FORMULAS[0])
    tracker = replace(experiment.tracker, reference_noise_nm=(1.0,) * 3)
    experiment = replace(experiment, tracker=tracker)
    if moved == "reference":
        stage = replace(experiment.stage, reference_nm=(0.0, 0.0, 5.0), reference_s=0.3)
        experiment = replace(experiment, stage=stage)
    simulated = simulate_experiment(experiment, SETUP, 5)
    if moved == "bead":
        bead = simulated.positions_nm["b1"].copy()
        kept = math.exp(-1 / (0.3 * SETUP.camera.frame_rate_hz.value))
        kicks = 5.0 * math.sqrt(1 - kept**2) * np.random.default_rng(3).standard_normal(len(bead))
        bead[:, 2] += lfilter([1], [1, -kept], kicks)
        simulated = replace(simulated, positions_nm={**simulated.positions_nm, "b1": bead})
    case = prepare(mtpipe.subtract_drift(simulated), "b1")
    evidence = Evidence((), FORCES_PN, reference_largest=case.reference_largest)
    effect = next(e for e in OWN if e.name == "reference_noise")
    known = best_of(case.fit, effect, evidence)
    anyhow = best_of(case.fit, effect, replace(evidence, reference_largest=None))
    assert anyhow.gain > 100
    if moved == "reference":
        assert known.gain > anyhow.gain - 3
        described = known.fit.model.described(known.fit.theta)
        assert described.stage.reference_nm[2] == pytest.approx(5.0, rel=0.2)
        assert described.stage.reference_s == pytest.approx(0.3, rel=0.3)
    else:
        assert known is None or known.gain < 0.6 * anyhow.gain


def moved_by_itself(reference_noise_nm, walk_nm, stage_nm, seed):
    """A bead that walks off, beside a reference with tracking noise on a stage that moves."""
    experiment, _ = experiment_of(SETUP, FORCES_PN, FRAMES, formula=FORMULAS[0])
    stage = replace(
        experiment.stage,
        unsubtracted_nm_per_root_s=(walk_nm,) * 3,
        random_nm_per_root_s=(stage_nm,) * 3,
    )
    tracker = replace(experiment.tracker, reference_noise_nm=(reference_noise_nm,) * 3)
    experiment = replace(experiment, stage=stage, tracker=tracker)
    return prepare(mtpipe.subtract_drift(simulate_experiment(experiment, SETUP, seed)), "b1")


def test_the_references_noise_is_not_taken_for_its_motion():
    """It goes against what was subtracted too, though nothing but the bead moves."""
    for seed in range(3):
        case = moved_by_itself(10.0, 2.0, 1.0, seed)
        assert reference_moves(SimpleNamespace(case=case)) is False


def test_noise_that_passes_the_low_pass_is_known_between_blocks():
    """Of 1200 blocks a variance is known within 5 %; beyond 4 of that once in 16 000."""
    case = moved_by_itself(10.0, 1.0, 1.0, 0)
    random, length = np.random.default_rng(3), round(BLOCK_S / case.frame_s)
    subtraction = case.fit.model.subtraction
    for axis, expected in enumerate(noise_between_blocks_nm2(case)):
        white = subtraction.noise_nm[axis] * random.normal(size=1200 * length)
        passed = low_pass(white, 1 / case.frame_s, subtraction.cutoff_hz[axis])
        steps = np.diff(passed.reshape(1200, length).mean(axis=1))
        assert steps.var() == pytest.approx(expected, rel=0.2)


def stand_in(name, net, before, after, *, frees=False):
    """A named effect whose checks are (p, whether heights are free with what is in it)."""

    def check(p_value, free):
        simulated = [None] * 120
        return SimpleNamespace(p_value=p_value, simulated=simulated, case=SimpleNamespace(fit=free))

    tried = FittedEffect(
        SimpleNamespace(name=name, form=""), SimpleNamespace(numbers=1), None, net, 0.0, None, 0
    )
    return Named(tried, (), check(before, False), check(after, frees), math.nan)


@pytest.mark.parametrize(
    ("scatter", "order", "verdict", "kept"),
    [
        (0.0, ["viscosity", "drift"], "explained", ["viscosity", "drift"]),
        (9.0, ["viscosity", "drift"], "unexplained", ["viscosity"]),
        (9.0, ["drift", "viscosity"], "unexplained", []),
        (9.0, ["viscosity"], "unexplained", ["viscosity"]),  # heights were free before
    ],
)
def test_what_frees_heights_is_not_named_where_they_are_off(
    monkeypatch, scatter, order, verdict, kept
):
    module = importlib.import_module("mtpipe.diagnosis.explain")
    monkeypatch.setattr(module, "gained_by_scatter", lambda fit, fitted: scatter)
    monkeypatch.setattr(module, "wanders", lambda fit: fit)
    monkeypatch.setattr(module, "bend_instead", lambda without, fitted, fit: None)
    monkeypatch.setattr("mtpipe.diagnosis.why_not.explained_share", lambda before, after: 0.5)
    named, free = [], False
    for name in order:
        free = free or name == "drift"
        one = stand_in(name, 50.0, 1e-9, 0.5, frees=free)
        named.append(replace(one, before=named[-1].after if named else one.before))
    first = named[0].before
    found = concluded(first, first, [], Weighed(named, named[-1].after), None)
    assert (found[0], [one.name for one in found[1]]) == (verdict, kept)
    assert found[2] is (found[1][-1].after if kept else named[0].before)
    if len(kept) < len(order):
        assert found[3].tried.effect.name == "drift"
        assert "mean heights scatter by more than" in found[3].reason


@pytest.mark.parametrize(
    ("p_first", "replaced", "verdict", "kept", "nearest"),
    [
        (1e-3, [], "explained", ["viscosity", "axial_scale"], None),
        (0.1, [1], "unexplained", ["viscosity"], "axial_scale"),
        # what is left of the set does not agree with its simulation
        (1e-3, [1], "unexplained", [], "axial_scale"),
        (1e-3, [0, 1], "unexplained", [], "viscosity"),
    ],
)
def test_what_a_bend_of_the_scale_tells_as_well_is_not_named(
    monkeypatch, p_first, replaced, verdict, kept, nearest
):
    module = importlib.import_module("mtpipe.diagnosis.explain")
    named = [
        stand_in("viscosity", 50.0, 1e-9, p_first),
        stand_in("axial_scale", 50.0, p_first, 0.5),
    ]
    bend = SimpleNamespace(words="a scale of z that is 5 % larger above 900 nm")
    rival = SimpleNamespace(bend=bend, replaced=[named[i].found for i in replaced], lead=9.0)
    monkeypatch.setattr(module, "gained_by_scatter", lambda fit, fitted: 0.0)
    monkeypatch.setattr(
        module, "bend_instead", lambda without, fitted, fit: rival if replaced else None
    )
    first = named[0].before
    found = concluded(first, first, [], Weighed(named, named[-1].after), None)
    assert (found[0], [one.name for one in found[1]]) == (verdict, kept)
    assert (found[3] and found[3].tried.effect.name) == nearest
    if nearest is not None:
        assert found[3].instead is bend
        assert found[3].reason == f"gains 50 in ln likelihood, but is no likelier than {bend.words}"


@pytest.mark.parametrize(
    ("before", "after", "agree"),
    [
        (1e-9, 0.3, True),
        (1e-9, 0.007, False),  # an alarm is not explained by what is nearly another
        (0.006, 0.007, True),  # there was no alarm
        (0.3, 0.001, False),
    ],
)
def test_what_was_an_alarm_has_to_agree_better_than_to_be_none(before, after, agree):
    assert agrees(SimpleNamespace(p_value=after), SimpleNamespace(p_value=before)) == agree


def one_tried(name, gain, penalty):
    return FittedEffect(SimpleNamespace(name=name, form=""), None, None, gain, penalty, None, 0)


@pytest.mark.parametrize(
    ("gain", "penalty", "foretold", "listed"),
    [
        (252.0, 5.4, 50.0, True),  # as good, at the same price
        (254.5, 16.2, 50.0, True),  # fits as well, though it has three numbers
        (245.0, 1.0, 50.0, True),  # fits worse, and costs as much less
        (245.0, 5.4, 50.0, False),  # the data tell it from the one named
        (240.0, 5.4, 3.0, True),  # fits worse, and tells as much of other time
        (230.0, 5.4, 3.0, False),  # fits much worse
        (240.0, 5.4, math.nan, True),  # what it tells of other time is not known
        (230.0, 5.4, math.nan, False),  # nor there, but it fits much worse
    ],
)
def test_effects_that_the_data_cannot_tell_apart_are_listed(gain, penalty, foretold, listed):
    named, other = one_tried("axial_scale", 251.5, 5.4), one_tried("hopping", gain, penalty)
    found = indistinguishable(named, [named, other], {"axial_scale"}, lambda one, two: foretold)
    assert [one.found.effect.name for one in found] == ["hopping"] * listed
    assert all(one.nats == pytest.approx(other.net - named.net) for one in found)


def test_what_is_not_seen_by_itself_is_no_alternative():
    """Its gain on time that was not fitted is not known, and it has none on time that was."""
    named, other = one_tried("axial_scale", 21.0, 5.4), one_tried("hopping", 8.0, 5.4)
    assert not indistinguishable(named, [named, other], {"axial_scale"}, lambda one, two: math.nan)


def test_a_cause_of_traces_and_of_spectra_is_said_once():
    random = bead_generator(0, "b1")
    before = check_bead(prepare(recording("viscosity", 2), "b1"), random)
    viscosity = next(effect for effect in OWN if effect.name == "viscosity")
    tried = best_of(before.case.fit, viscosity, Evidence((), FORCES_PN))
    named = Named(tried, (), before, before, math.nan)
    found = Explanation(before, before, (named, named), "explained", None)
    assert [one.name for one in found.named_once] == ["viscosity"]
    assert repr(found).count("viscosity") == 1


def test_what_alternatives_make_of_a_force_is_in_its_error():
    """The interval about the mean over the chain's formulas holds 68 % of what is left possible."""
    random = bead_generator(0, "b1")
    before = check_bead(prepare(recording("viscosity", 2), "b1"), random)
    tried = {
        name: best_of(
            before.case.fit, next(e for e in OWN if e.name == name), Evidence((), FORCES_PN)
        )
        for name in ("viscosity", "lateral_scale")
    }
    one, other = tried["viscosity"], tried["lateral_scale"]
    after = check_bead(replace(before.case, fit=one.fit), random)
    alone = Explanation(
        before, after, (Named(one, (), before, after, math.nan),), "explained", None
    )
    both = replace(alone, named=(Named(one, (Alternative(other, 0.0),), before, after, math.nan),))
    (formula,) = other_formulas(one.fit)
    mine, others = (
        fit.log_likelihood + with_one_more(fit, evidence_of(after)) for fit in (one.fit, formula)
    )
    nats = others - mine
    drawn = np.random.default_rng(3)
    other_chain = drawn.random(100_000) < np.exp(nats) / (1 + np.exp(nats))
    other_effect = drawn.random(100_000) < 0.5
    chain, effect = formula.force_pN - one.fit.force_pN, other.fit.force_pN - one.fit.force_pN
    for found, chosen in ((alone, np.zeros(100_000, bool)), (both, other_effect)):
        stderr = one.fit.force_stderr_pN * np.where(
            other_chain[:, None], formula.force_stderr_pN / one.fit.force_stderr_pN, 1.0
        )
        stderr *= np.where(chosen[:, None], other.fit.force_stderr_pN / one.fit.force_stderr_pN, 1)
        off = other_chain[:, None] * chain + chosen[:, None] * effect
        quoted = found.force_pN - one.fit.force_pN
        np.testing.assert_allclose(quoted, np.exp(nats) / (1 + np.exp(nats)) * chain, rtol=1e-9)
        off = np.abs(off + stderr * drawn.standard_normal(off.shape) - quoted)
        # six standard errors of a share of 100 000
        within = (off < found.force_stderr_pN).mean(axis=0)
        np.testing.assert_allclose(within, 0.6827, atol=0.009)
    assert both.named[0].equivalent == ("lateral_scale",)
    # effects fitted anew go with the formula that they were named with
    again = together(before.case.fit, [one], formula)
    assert again.model.experiment.chain.formula == formula.model.experiment.chain.formula
    assert again.log_likelihood == pytest.approx(formula.log_likelihood, abs=0.1)


def test_one_cause_more_is_worth_what_it_gains_beyond_its_price():
    """Only the viscosity is amiss; where nothing is, no cause promises more than its price."""
    worth = {}
    for name in ("nothing", "viscosity"):
        check = check_bead(prepare(recording(name, 2), "b1"), bead_generator(0, "b1"))
        evidence = evidence_of(check)
        worth[name] = with_one_more(check.case.fit, evidence)
        if name != "nothing":
            viscosity = next(effect for effect in OWN if effect.name == name)
            gained = best_of(check.case.fit, viscosity, evidence).net - CAUSE_NATS
    assert 0 < worth["nothing"] < 3
    # a parabola foretells a gain of dozens to some tenths
    assert worth["viscosity"] == pytest.approx(gained, rel=0.3)


def test_second_halves_begin_in_the_middle_of_their_plateaus():
    """A walk has moved the bead farther by then."""
    case = prepare(recording("nothing", 1), "b1")
    first, second = halves_of(case)
    model = case.fit.model
    for half, at in ((first, 0.25), (second, 0.75)):
        lasts = np.array([data.duration_s for data in half.data])
        whole = np.array([data.duration_s for data in model.data])
        np.testing.assert_allclose(lasts, whole / 2)
        middles = np.array(half.of(model).begins_s) + lasts / 2
        np.testing.assert_allclose(middles, np.array(model.begins_s) + at * whole)


def locked(simulated, size_nm, scale=1.0):
    """The recording of a tracker with the period of the pixels, z by a factor too large."""
    place = {bead: xyz.copy() for bead, xyz in simulated.positions_nm.items()}
    for bead, xyz in place.items():
        xyz[:, 2] *= scale
        if bead in simulated.tethered:
            xyz[:, :2] += size_nm * np.sin(2 * np.pi * xyz[:, :2] / 100.0)
    return replace(simulated, positions_nm=place)


@pytest.mark.parametrize(
    ("effects", "size_nm", "scale", "other"),
    [
        # with the rotation missing, p hardly rises where the tracker's response is undone
        (["wall_drag", "tracking_noise"], 4.0, 1.0, "rotation_coupling"),
        # with z's scale put right, the battery no longer objects
        (["wall_drag", "rotation_coupling", "tracking_noise"], 1.5, AXIAL_SCALE, "axial_scale"),
    ],
)
def test_pixel_locking_is_found_beside_an_effect_that_hides_what_it_does(
    effects, size_nm, scale, other
):
    experiment, _ = experiment_of(SETUP, FORCES_PN, FRAMES, formula=FORMULAS[0])
    seen = locked(simulate_experiment(experiment, SETUP, 5), size_nm, scale)
    concealed = replace(seen, setup=parse_setup(setup_content(model={"effects": effects})))
    found = mtpipe.diagnose(mtpipe.subtract_drift(concealed), seed=1).beads["b1"]
    assert {one.name for one in found.named} == {"pixel_locking", other}
    assert found.verdict == "explained"


def test_what_is_seen_in_traces_and_in_spectra_is_one_cause():
    """A look-up table is named by its curve within the bead's motion, and by its slopes."""

    def entry(effect, delta_bic, p_values, **parameters):
        before, after = p_values
        return {
            "effect": effect, "probability": 0.9, "sentence": f"{effect} {delta_bic}.",
            "parameters": parameters, "delta_bic": delta_bic, "heldout_gain_nats": None,
            "p_before": before, "p_after": after, "equivalent": [],
        }  # fmt: skip

    by_curve = entry("z_response", None, (1e-9, 1e-4), slope_error=0.1, curve=1.0)
    by_fit = entry("z_response", -50.0, (1e-4, 0.3), slope_error=0.2, offset_nm=90.0)
    drift = entry("drift", -20.0, (1e-4, 0.3), walk=1.0)
    for effects in ([by_curve, drift, by_fit], [by_fit, drift, by_curve]):
        first, second = _each_once(effects)
        assert second == drift
        assert first["effect"] == "z_response"
        assert first["delta_bic"] == -50.0
        assert first["parameters"] == {"slope_error": 0.2, "curve": 1.0, "offset_nm": 90.0}
        assert first["sentence"] == "z_response -50.0. z_response None."
        assert (first["p_before"], first["p_after"]) == (1e-9, 0.3)
