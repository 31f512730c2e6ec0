"""Several causes at once, on small recordings with a fixed seed."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mtpipe.crosschecking.check import check_bead
from mtpipe.crosschecking.lines import with_lines_apart
from mtpipe.crosschecking.prepared_bead import prepare
from mtpipe.diagnosis import alternatives, judging, naming, sets, single_events
from mtpipe.diagnosis.alternatives import place_of
from mtpipe.diagnosis.causes import (
    Causes,
    allowed,
    causes_of,
    exchanged,
    grown,
    likelier_by_exchange,
    likeliest_left,
    objected,
    worth_in_any,
)
from mtpipe.diagnosis.corrections.correction import Correction
from mtpipe.diagnosis.evidence import evidence_of
from mtpipe.diagnosis.explain import explain
from mtpipe.diagnosis.explanation import Alternative, Explanation, Named
from mtpipe.diagnosis.forces_to_quote import diagnosed_forces
from mtpipe.diagnosis.mismatch import bead_content
from mtpipe.diagnosis.naming import (
    Weighed,
    as_dear_as_a_term,
    last_named,
    of_fitted_time_only,
)
from mtpipe.diagnosis.prior import CAUSE_NATS
from mtpipe.diagnosis.probability import odds_against
from mtpipe.diagnosis.sets import several_causes
from mtpipe.diagnosis.time_corrections import hold_by_themselves
from mtpipe.drift import subtract_drift
from mtpipe.effects.catalogue import OWN
from mtpipe.effects.effect import Evidence
from mtpipe.effects.hopping import Hopping
from mtpipe.effects.terms.catalogue import TERMS
from mtpipe.effects.terms.course import FrictionCourse
from mtpipe.experiment.changes import with_step
from mtpipe.joint_fit.hypotheses import FittedEffect, try_effects
from mtpipe.simulation.setup_experiment import stated_experiment
from mtpipe.simulation.simulate import simulate_experiment
from tests.curved_table import sloping, stepped, with_table
from tests.small_case import FORCES_PN, FRAMES, NOISE_NM, generator, raw, setup

pytestmark = pytest.mark.slow

# FORMATS section 4
TERM = {
    "form", "axes", "plateaus", "sentence", "parameters", "delta_bic", "heldout_gain_nats",
    "p_before", "p_after",
}  # fmt: skip
BY_NAME = {one.name: one for one in (*OWN, *TERMS)}
NAMES = ("z_crosstalk", "lateral_scale", "viscosity", "axial_scale")


def changed(matrix):
    """A recording whose bead is seen through a matrix, about its mean in x and y."""
    recording = subtract_drift(raw(3))
    xyz = recording.positions_nm["b1"].copy()
    for plateau in recording.plateaus:
        rows = slice(plateau.start, plateau.stop)
        centre = np.array([*xyz[rows, :2].mean(axis=0), 0.0])
        xyz[rows] = (xyz[rows] - centre) @ np.asarray(matrix).T + centre
    return replace(recording, positions_nm=recording.positions_nm | {"b1": xyz})


def found(recording, names):
    effects = [effect for effect in OWN if effect.name in names]
    check = check_bead(prepare(recording, "b1"), generator(5), rounds=(24,))
    weighed = several_causes(check, check, effects, generator(6), lambda step: None)
    return check, weighed.named


@pytest.fixture(scope="module")
def seen():
    return changed([[1.0, 0.0, 0.0], [0.0, 1.25, 0.0], [0.3, 0.2, 1.0]])


def test_two_causes_are_named_together_with_their_sizes(seen):
    check, named = found(seen, NAMES)
    assert check.p_value < 1e-3
    assert {one.name for one in named} == {"z_crosstalk", "lateral_scale"}
    fit = named[-1].after.case.fit
    experiment = fit.model.described(fit.theta)
    sizes = {
        name: value for one in named for name, value, _ in one.found.effect.strengths(experiment)
    }
    # standard errors are some 0.005 for slopes and 2 % for the scale
    assert sizes["slope_x"] == pytest.approx(0.3, abs=0.03)
    assert sizes["factor_y"] == pytest.approx(1.25, rel=0.08)
    assert named[0].before is check
    assert all(a.after is b.before for a, b in itertools.pairwise(named))
    assert named[-1].after.p_value > 0.01
    assert all(one.heldout_gain > 0 for one in named)
    # nothing was fitted in their place yet, which makes no name certain
    assert all(one.probability < 0.99 for one in named)


def test_a_search_that_needs_too_many_causes_ends_and_names_none(seen, monkeypatch):
    """Two are needed; a recording that no dozen explains would otherwise be searched for hours."""
    monkeypatch.setattr(sets, "MOST_MEMBERS", 1)
    effects = [effect for effect in OWN if effect.name in NAMES]
    check = check_bead(prepare(seen, "b1"), generator(5), rounds=(24,))
    weighed = several_causes(check, check, effects, generator(6), lambda step: None)
    assert weighed.unfinished
    assert weighed.named == []


@pytest.mark.parametrize(("table", "slope"), [(sloping, 0.3), (sloping, -0.3), (stepped, 1.0)])
def test_what_a_curved_table_does_is_not_held_against_causes(seen, table, slope):
    """Heights are distributed by the table, and the causes beside it are right all the same."""
    curved = with_table(seen, 1, table, slope)
    effects = [BY_NAME[name] for name in (*NAMES, "hopping", "extensible_tether")]
    check = check_bead(prepare(curved, "b1"), generator(5), rounds=(24,))
    steps = []
    told = explain(check, generator(6), effects=effects, progress=steps.append)
    assert {one.name for one in told.named} == {"z_response", "z_crosstalk", "lateral_scale"}
    assert told.verdict == "explained"
    assert not any(step.startswith("without") for step in steps)
    assert not any(step == "weighing other sets" for step in steps)


def test_a_cause_without_a_name_is_described_by_its_form(seen):
    check, named = found(seen, ("lateral_scale", "viscosity", "axial_scale"))
    assert check.p_value < 1e-3
    assert [one.name for one in named if not one.form] == ["lateral_scale"]
    assert {one.name for one in named if one.form} == {"mixing_x_in_z", "mixing_y_in_z"}
    fit = named[-1].after.case.fit
    experiment = fit.model.described(fit.theta)
    shares = {
        one.name: {name: value for name, value, _ in one.found.effect.strengths(experiment)}
        for one in named
    }
    assert shares["mixing_x_in_z"]["share"] == pytest.approx(0.3, abs=0.03)
    told = Explanation(check, named[-1].after, tuple(named), "described", None)
    forces = diagnosed_forces(seen, {"b1": told}, seed=0)
    assert {one.source for one in forces["b1"].recommended.values()} == {"named"}
    content = bead_content(told, forces["b1"], 0.03)
    assert [one["effect"] for one in content["effects"]] == ["lateral_scale"]
    assert {one["form"] for one in content["terms"]} == {"mixing"}
    for term in content["terms"]:
        assert set(term) == TERM
        assert term["axes"][0] == "z"
        assert set(term["parameters"]) == {"share", "exponent"}
    # of y as recorded, which is 1.25 times as large
    assert shares["mixing_y_in_z"]["share"] * 1.25 == pytest.approx(0.2, abs=0.03)


def test_a_member_that_gains_no_more_than_its_price_goes_whenever_it_was_found():
    """x reads a share of z; the viscosity is as stated."""
    recording = changed([[1.0, 0.0, 0.8], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    first = check_bead(prepare(recording, "b1"), generator(5), rounds=(24,))
    evidence, without = evidence_of(first), first.case.fit
    (needless,) = try_effects(without, [BY_NAME["viscosity"]], evidence)
    (needed,) = try_effects(needless.fit, [BY_NAME["mixing_z_in_x"]], evidence, beside=True)
    both = causes_of((needless, needed), needed.fit, without)
    check = check_bead(replace(first.case, fit=both.fit), generator(6))
    places = [place_of(one, both.members, without, both.fit, ()) for one in both.members]
    fewer = naming._without_weakest(both, check, places, first, first, generator(7))
    assert fewer is not None
    assert fewer[0].names == {"mixing_z_in_x"}
    assert fewer[1].p_value > 0.01
    (place,) = [place_of(one, fewer[0].members, without, fewer[0].fit, ()) for one in [needed]]
    assert naming._without_weakest(*fewer, [place], first, first, generator(8)) is None


@pytest.fixture(scope="module")
def checked(seen):
    return check_bead(prepare(seen, "b1"), generator(5), rounds=(24,))


def begun_with(checked, names):
    """A set that these causes make, found one after the other."""
    without = checked.case.fit
    one = Causes((), without, 0.0)
    for name in names:
        evidence = evidence_of(replace(checked, case=replace(checked.case, fit=one.fit)))
        (tried,) = try_effects(one.fit, [BY_NAME[name]], evidence, beside=bool(one.members))
        one = causes_of((*one.members, tried), tried.fit, without)
    return one


def test_another_member_takes_the_place_of_one_that_explains_less(checked):
    wrong = begun_with(checked, ("z_crosstalk", "axial_scale"))
    members = [BY_NAME[name] for name in NAMES]
    weighed = {wrong.names: wrong}
    exchanged(wrong, checked.case.fit, members, evidence_of(checked), weighed)
    better = likeliest_left(weighed, [wrong])
    assert better is not None
    assert better.names == {"z_crosstalk", "lateral_scale"}
    assert better.score > wrong.score + 20
    assert likeliest_left(weighed, [wrong, better]) is None


def test_a_likelier_set_by_exchange_is_found_once_and_only_where_there_is_one(checked):
    """Before time that was not fitted blames a cause, its company may be what is wrong."""
    members = [BY_NAME[name] for name in NAMES]

    def likelier(one, weighed):
        without = checked.case.fit
        return likelier_by_exchange(one, without, members, evidence_of(checked), weighed)

    wrong = begun_with(checked, ("z_crosstalk", "axial_scale"))
    weighed = {wrong.names: wrong}
    better = likelier(wrong, weighed)
    assert better.names == {"z_crosstalk", "lateral_scale"}
    assert likelier(wrong, weighed) is None  # what was weighed already is nothing new
    assert likelier(better, {better.names: better}) is None


def test_a_set_is_weighed_beside_those_refused_by_what_simulations_say_against_them():
    def a_set(score, *names, p_value=1.0):
        members = tuple(SimpleNamespace(effect=SimpleNamespace(name=name)) for name in names)
        return judging.judged(Causes(members, None, score), SimpleNamespace(p_value=p_value))

    refused = a_set(100.0, "drift", "exposure", p_value=1e-9)
    part, more = a_set(99.0, "drift"), a_set(101.0, "drift", "exposure", "hopping")
    other, worse = a_set(85.0, "drift", "viscosity"), a_set(80.0, "drift", "vibration")
    weighed = {one.names: one for one in (refused, part, more, other, worse)}
    assert refused.worth == pytest.approx(100.0 - np.log(0.2e9))
    assert likeliest_left(weighed, [refused]) is other
    assert likeliest_left(weighed, [refused, other]) is None  # `worse` is no better than `refused`
    assert objected(more, [refused]).worth == pytest.approx(more.score - refused.objection)
    assert objected(part, [refused]).worth == pytest.approx(part.score - refused.objection)
    assert objected(other, [refused]).worth == other.score


def test_a_set_that_was_found_in_a_worse_optimum_is_found_again(checked):
    one = begun_with(checked, ("z_crosstalk",))
    whole = begun_with(checked, ("z_crosstalk", "lateral_scale"))
    members = [BY_NAME["lateral_scale"]]

    def next_of(worse_by):
        weighed = {whole.names: replace(whole, score=whole.score - worse_by)}
        beam, _ = grown([one], checked.case.fit, members, evidence_of(checked), weighed)
        return beam

    (again,) = next_of(100.0)
    assert again.names == whole.names
    assert again.score == pytest.approx(whole.score, abs=1.0)
    assert next_of(0.0) == []


def test_a_member_is_compared_with_others_as_its_set_has_it(monkeypatch):
    """A search from scratch may end in a lower optimum than the set's own fit."""
    recording = changed([[1.0, 0.0, 0.8], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    first = check_bead(prepare(recording, "b1"), generator(5), rounds=(24,))
    evidence, without = evidence_of(first), first.case.fit
    (found_well,) = try_effects(without, [BY_NAME["mixing_z_in_x"]], evidence)
    badly = replace(found_well, fit=without, gain=0.0)
    monkeypatch.setattr(alternatives, "try_effects", lambda *_, **__: [badly])
    place = place_of(found_well, [found_well], without, found_well.fit, ())
    assert place.own.fit is found_well.fit
    assert place.own.gain == pytest.approx(found_well.gain, abs=1.0)


def test_a_cause_on_which_another_rests_is_not_refused_for_want_of_a_held_out_gain():
    """A bead that does not turn is not seen to: what is left without its turning is not known."""
    silent = setup(model={"effects": ["wall_drag", "tracking_noise"]})
    recording = subtract_drift(replace(raw(3), setup=silent))
    check = check_bead(prepare(recording, "b1"), generator(5), rounds=(24,))
    evidence, without = evidence_of(check), check.case.fit
    (turns,) = try_effects(without, [BY_NAME["rotation_coupling"]], evidence)
    (seen,) = try_effects(turns.fit, [BY_NAME["bead_turning"]], evidence, beside=True)
    both = causes_of((turns, seen), seen.fit, without)
    last = replace(check, case=replace(check.case, fit=both.fit))
    assert np.isnan(naming._heldout(without, both, turns, last))
    assert np.isfinite(naming._heldout(without, both, seen, last))


@pytest.mark.parametrize("whole", [True, False])
def test_a_cause_that_gains_nothing_on_time_that_was_not_fitted_is_told(whole):
    """A wave that lasts for the first half of each plateau is no cause of the second half."""
    recording = raw(1)
    wave = 15.0 * np.sin(2 * np.pi * 31.7 * recording.time_s)
    for plateau in recording.plateaus:
        if not whole:
            wave[(plateau.start + plateau.stop) // 2 : plateau.stop] = 0.0
    bead = recording.positions_nm["b1"] + wave[:, None] * [0, 1, 0]
    recording = replace(recording, positions_nm=recording.positions_nm | {"b1": bead})
    case = with_lines_apart(prepare(subtract_drift(recording), "b1"))
    vibration = next(effect for effect in OWN if effect.name == "vibration")
    (member,) = try_effects(case.fit, [vibration], Evidence(case.lines_hz, FORCES_PN))
    assert member.gain > 100
    begun, last = (SimpleNamespace(case=replace(case, fit=fit)) for fit in (case.fit, member.fit))
    told = of_fitted_time_only(begun, causes_of((member,), member.fit, case.fit), last)
    assert told == ("" if whole else "vibration")


def test_friction_that_rises_is_described_and_not_named():
    """Forces rise with time, so that it might be friction that rises with the force."""
    course = FrictionCourse(-0.5, 2.5, np.log(1.8))
    experiment, _ = stated_experiment(setup(), FORCES_PN, FRAMES, noise_nm=NOISE_NM)
    recording = subtract_drift(simulate_experiment(with_step(experiment, course), setup(), 3))
    _, named = found(recording, (*NAMES, "bead_radius", "exposure", "contour_length"))
    assert [one.name for one in named] == ["course_of_friction"]
    fit = named[-1].after.case.fit
    (_, factor, _), *_ = named[0].found.effect.strengths(fit.model.described(fit.theta))
    assert factor == pytest.approx(1.8, rel=0.15)


def test_nothing_is_found_where_nothing_is_concealed():
    _, named = found(subtract_drift(raw(3)), NAMES)
    assert named == []


@pytest.mark.parametrize(
    ("p_values", "simulations"),
    [
        ([0.3], []),
        ([0.0005, 0.2], [240]),
        ([0.0005, 0.0005], [240]),
        ([1e-7], []),
        ([1e-7, 0.02], [240]),
    ],
    ids=["agrees", "agrees by many", "does not", "clearly not", "by its skewness alone"],
)
def test_whether_something_is_left_is_not_left_to_the_chance_of_few_simulations(
    monkeypatch, p_values, simulations
):
    """p-values, and numbers of simulations beyond the usual ones."""
    checks = [SimpleNamespace(p_value=p_value, case="the bead with it") for p_value in p_values]
    but_moments = p_values[0] if len(p_values) == 1 else 0.01
    monkeypatch.setattr(judging, "p_value_but_moments", lambda check: but_moments)
    asked = list(checks)
    rounds_asked = []

    def check_bead(case, random, *, rounds=None, begun=None):
        if rounds is not None:
            assert (case, begun) == ("the bead with it", checks[0])
            rounds_asked.extend(rounds)
        return asked.pop(0)

    monkeypatch.setattr(judging, "check_bead", check_bead)
    monkeypatch.setattr(judging, "replace", lambda case, fit: case)
    begun = SimpleNamespace(case="the bead with it")
    first = SimpleNamespace(p_value=1e-9)
    check = judging.checked_with(Causes((), None, 0.0), begun, first, None)
    assert check is checks[-1]
    assert not asked
    assert rounds_asked == simulations


@pytest.mark.parametrize(
    ("first_p", "lead", "rival_p", "taken"),
    [
        (0.03, 1.3, 0.3, "rival"),  # the battery objects to the first by 1.9 nats
        (0.03, 2.0, 0.3, "first"),  # by less than the first is likelier
        (0.03, 1.3, 0.06, "first"),  # and nearly as much to the other
        (0.25, 0.1, 0.9, "first"),  # both are clearly consistent
        (1e-9, 4.5, 0.3, "rival"),
        (1e-9, 4.5, 1e-4, "first"),  # something is left with either
    ],
)
def test_of_sets_that_are_nearly_as_likely_the_battery_decides(
    monkeypatch, first_p, lead, rival_p, taken
):
    checks = {
        name: SimpleNamespace(p_value=p_value, simulated=[None] * 120)
        for name, p_value in (("first", first_p), ("rival", rival_p))
    }
    monkeypatch.setattr(judging, "check_bead", lambda case, random: checks[case])
    monkeypatch.setattr(judging, "replace", lambda case, fit: fit)
    first, rival = Causes((), "first", 30.0), Causes((), "rival", 30.0 - lead)
    begun = SimpleNamespace(case=None)
    best, check, _ = judging.better_judged(first, checks["first"], [rival], begun, None)
    assert best.fit == taken
    assert check is checks[taken]


@pytest.mark.parametrize(("smooth", "gone"), [(False, ""), (True, "hopping")])
def test_a_member_is_contradicted_by_how_positions_are_distributed(smooth, gone):
    """Hops crowd heights at two levels. Gaussian motion of their power is fitted by them as well as
    they are, and is not distributed so.
    """
    experiment, _ = stated_experiment(setup(), FORCES_PN, 2 * FRAMES, noise_nm=NOISE_NM)
    hopping = with_step(experiment, Hopping(50.0, FORCES_PN[1], 5.0, smooth))
    recording = subtract_drift(simulate_experiment(hopping, setup(), 4))
    begun = check_bead(prepare(recording, "b1"), generator(5), rounds=(24,))
    (one,) = try_effects(begun.case.fit, [BY_NAME["hopping"]], evidence_of(begun))
    causes = causes_of((one,), one.fit, begun.case.fit)
    check = check_bead(replace(begun.case, fit=one.fit), generator(6))
    assert judging.contradicted(begun, causes, check, generator(7)) == gone


@pytest.mark.parametrize("smooth", [False, True])
def test_hops_are_named_where_they_are_seen_and_not_only_their_power(smooth):
    experiment, _ = stated_experiment(setup(), FORCES_PN, 2 * FRAMES, noise_nm=NOISE_NM)
    hopping = Hopping(15.0, FORCES_PN[1], 5.0, smooth)
    recording = subtract_drift(simulate_experiment(with_step(experiment, hopping), setup(), 4))
    _, named = found(recording, ("hopping", "drift", "viscosity"))
    assert ("hopping" in {one.name for one in named}) is not smooth


@pytest.mark.parametrize(
    ("nats", "rival", "score", "left_out"),
    [
        (20.0, "wander_step_z", 55.0, ""),
        (2.0, "wander_step_z", 55.0, "hopping"),
        (2.0, "wander_step_z", 45.0, ""),
        (2.0, "viscosity", 55.0, ""),
        (-2.0, "viscosity", 0.0, "hopping"),
    ],
)
def test_hops_that_are_not_clearly_seen_cost_as_much_as_a_form(
    monkeypatch, nats, rival, score, left_out
):
    monkeypatch.setattr(single_events, "seen_nats", lambda case, single, random: nats)
    drift, hopping, other = (
        FittedEffect(BY_NAME[name], None, None, 0.0, 0.0, None, 0)
        for name in ("drift", "hopping", rival)
    )
    best, instead = Causes((drift, hopping), None, 60.0), Causes((drift, other), None, score)
    case = prepare(changed(np.eye(3)), "b1")
    assert single_events.unseen_member(case, best, [best, instead], generator(1)) == left_out


@pytest.mark.parametrize(
    ("p_after", "chance_p", "holds"),
    [(1e-7, 1e-9, True), (1e-12, 1e-9, False), (1e-7, None, False)],
)
def test_a_curve_beside_an_unexplained_rest_is_one_that_brings_the_simulation_nearer(
    p_after, chance_p, holds
):
    before, after = SimpleNamespace(p_value=1e-8), SimpleNamespace(p_value=p_after)
    curve = Named(Correction("z_response", None, (), "", chance_p), (), before, after, math.nan)
    assert hold_by_themselves([curve]) is holds


@pytest.mark.parametrize(("nats", "odds"), [(20.0, 0.0), (0.0, 1.0), (-1.0, 1.0), (4.0, 0.3)])
def test_gaussian_motion_of_their_power_is_as_likely_as_hops_that_heights_do_not_show(
    monkeypatch, nats, odds
):
    monkeypatch.setattr(single_events, "seen_nats", lambda case, single, random: nats)
    hopping, drift = (
        FittedEffect(BY_NAME[name], None, None, 0.0, 0.0, None, 0) for name in ("hopping", "drift")
    )
    case = prepare(changed(np.eye(3)), "b1")
    given = single_events.odds_of_smooth(case, case.fit, hopping, generator(1))
    assert given >= odds if nats <= 0 else given <= odds
    assert single_events.odds_of_smooth(case, case.fit, drift, generator(1)) == 0
    # as likely as not: it is told by what it does
    assert BY_NAME["hopping"].unnamed == ("lorentzian", ("z",))


def test_a_term_in_place_of_hops_that_heights_do_not_show_is_compared_at_equal_cost():
    """The wander is likelier by 4 nats, and 6 nats less likely if only a term costs 10 more."""
    fit = prepare(subtract_drift(raw(1)), "b1").fit
    hopping, wander = (
        FittedEffect(BY_NAME[name], None, fit, gain, 15.0, None, 0)
        for name, gain in (("hopping", 57.0), ("wander_step_z", 61.0))
    )
    place = alternatives.Place(hopping, [wander, hopping], fit)
    dearer = as_dear_as_a_term(place)
    shown, not_shown = (
        odds_against(one.own, one.tried, {"hopping"}, fit, 0.0) for one in (place, dearer)
    )
    assert shown < 0.1
    assert not_shown > math.exp(4) - 1


@pytest.mark.parametrize(
    ("nameable", "expected"), [("abc", "abc"), ("ab", "ab"), ("", ""), ("abc ab", "abc")]
)
def test_a_set_that_agrees_and_cannot_be_named_gives_way_to_a_smaller_one(nameable, expected):
    agreed = [("a", 1), ("ab", 2), ("abc", 3)]
    asked = []

    def told(best, check):
        asked.append((best, check))
        return Weighed([best] if best in nameable.split() else [], check)

    end = last_named(agreed, told)
    assert end.named == ([expected] if expected else [])
    # where none can be named, what is said is of the largest
    assert end.check == (dict(agreed)[expected] if expected else 3)
    assert asked == agreed[::-1][: len(asked)]


@pytest.mark.parametrize(
    ("name", "objection", "nats"),
    [
        ("white_z", 0.0, 0.0),
        ("white_z", 4.0, 4.0),
        ("white_z", 30.0, 10.0),
        ("drift", 1.0, 1.0),
        ("drift", 30.0, CAUSE_NATS),
    ],
)
def test_what_simulations_object_to_pays_for_what_the_set_lacks(name, objection, nats):
    """A term costs 10 nats more than a name, unless it is known that something is lacking; a name
    always has to earn its numbers."""
    beside = Causes((), None, 0.0, objection)
    assert allowed(beside, BY_NAME[name]) == pytest.approx(nats)


@pytest.mark.parametrize(
    ("name", "odds_against", "rival_nats", "told"),
    [
        ("lateral_scale", 0.02, None, "lateral_scale"),
        ("lateral_scale", 50.0, None, "gain"),
        ("hopping", 50.0, None, "lorentzian"),
        ("lateral_scale", 1.5, 0.5, "lateral_scale"),
        ("z_crosstalk", 1.5, None, "mixing"),
        ("viscosity", 1.5, None, None),
    ],
)
def test_a_name_that_is_less_likely_than_not_is_told_by_its_form(
    name, odds_against, rival_nats, told
):
    """Of 1.5 against it, an alternative as likely as itself makes it likely again."""
    one = FittedEffect(BY_NAME[name], None, None, 30.0, 10.0, None, 0)
    rivals = () if rival_nats is None else (Alternative(one, rival_nats),)
    named = Named(one, rivals, None, None, 5.0, odds_against=odds_against)
    likely = alternatives.or_by_form(named)
    if told is None:
        assert likely is None
    else:
        assert (likely.form or likely.name) == told
        assert likely.name == name


@pytest.mark.parametrize(
    ("worths", "stops"),
    [((5.0,), False), ((5.0, 6.0), False), ((5.0, 4.0), True), ((5.0, 7.0, 6.0), True)],
)
def test_other_sets_are_tried_as_long_as_each_is_judged_better(worths, stops):
    refused = [sets.Refused(Causes((), None, worth), None, "") for worth in worths]
    assert sets.in_vain(refused) is stops


def test_a_likelier_set_with_more_causes_speaks_for_those_of_a_smaller_one():
    drift, hopping, viscosity = (
        FittedEffect(BY_NAME[name], None, None, 0.0, 0.0, None, 0)
        for name in ("drift", "hopping", "viscosity")
    )
    best = Causes((drift,), None, 20.0)
    others = [Causes((drift, hopping), None, 24.0, 3.0), Causes((viscosity,), None, 40.0)]
    assert worth_in_any(best, others) == pytest.approx(21.0)
    assert worth_in_any(best, others[1:]) == pytest.approx(20.0)
