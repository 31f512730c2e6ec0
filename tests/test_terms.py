"""Terms of known form: none at strength zero, simulated as expected, recovered, and said."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pytest

from mtpipe.effects import drift, reference_noise
from mtpipe.effects.catalogue import OWN
from mtpipe.effects.terms.catalogue import TERMS
from mtpipe.effects.terms.mixing import Share
from mtpipe.experiment.changes import with_step
from mtpipe.joint_fit.fit import fit_configured
from mtpipe.joint_fit.hypotheses import try_effects, with_hypothesis
from mtpipe.joint_fit.score_test import _worth_beginning, most_promising, promised_gain
from tests import test_effects as effects

pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class KnownTerm(effects.Known):
    """A term at a strength that shows; `weak` : share of its size that is hardly seen, of a square
    or of a size. `most` : times its gain that it may promise there.
    """

    weak: float | None = None
    most: float = 3.0

    @property
    def effect(self):
        return next(term for term in TERMS if term.name == self.name)


LN = math.log
KNOWN = [
    KnownTerm("lorentzian_x", (60.0, LN(2.0), -1.0, 0.5), (0.0, LN(2.0), 0.0, 0.0)),
    KnownTerm("lorentzian_z", (40.0, LN(15.0), 0.5, 0.3), (0.0, LN(15.0), 0.0, 0.0), which=1),
    KnownTerm("power_law_y", (12.0, 0.8, 0.4), (0.0, 1.0, 0.0)),
    KnownTerm("power_law", (12.0, 8.0, 15.0, 0.9), (0.0, 0.0, 0.0, 1.0), weak=1e-3),
    KnownTerm("white_z", (30.0, 0.5), (0.0, 0.0)),
    KnownTerm("gain_step_x", (0.12,), (0.0,), which=1),
    KnownTerm("scatter_step_y", (40.0,), (0.0,), which=2),
    KnownTerm("wander_step_y", (900.0, 1.2), (0.0, 1.0), which=1, weak=1e-4),
    KnownTerm("wander_step_x", (1500.0, 1.4), (0.0, 1.0), which=3, weak=1e-4),
    KnownTerm(
        "wander_by_plateau_z",
        (*np.square([3.0, 30.0, 8.0, 20.0, 12.0])[: len(effects.FORCES_PN)], 1.3),
        (*np.zeros(len(effects.FORCES_PN)), 1.0),
        weak=1e-5,
        most=8.0,
    ),
    KnownTerm("gain_by_plateau_z", (0.1, -0.2, 0.2, -0.15), (0.0,) * len(effects.FORCES_PN)),
    KnownTerm("share_step_y_in_z", (0.15,), (0.0,), which=1),
    KnownTerm("turning_aside", (150.0,), (0.0,)),
    KnownTerm("gain_y", (0.15, 0.3), (0.0, 0.0)),
    KnownTerm("mixing_x_in_z", (0.15, 0.2), (0.0, 0.0)),
    KnownTerm("mixing_z_in_y", (0.3, -0.2), (0.0, 0.0)),
    KnownTerm("course_of_friction", (0.3,), (0.0,), which=2),
    KnownTerm("course_of_length", (-0.08,), (0.0,), which=0),
]
each_term = pytest.mark.parametrize("known", KNOWN, ids=[known.name for known in KNOWN])


def test_every_form_is_tested_here():
    assert {known.effect.form for known in KNOWN} == {term.form for term in TERMS}
    assert len({term.name for term in TERMS}) == len(TERMS)


@each_term
def test_without_strength_a_term_is_nothing(known):
    model, _ = effects.model_of(known.base, np.random.default_rng(1))
    none = effects.changed(known.hypothesis, known.nothing)
    for i, force in enumerate(effects.FORCES_PN):
        without, with_it = (model.expected(e, i, force) for e in (known.base, none))
        np.testing.assert_allclose(with_it.power, without.power, rtol=1e-6, atol=1e-9)
        assert with_it.extension_nm == pytest.approx(without.extension_nm)


@each_term
def test_simulations_with_a_term_are_as_expected_with_it_and_not_without(known):
    random = np.random.default_rng(2)
    model, phi = effects.model_of(known.changed, random)
    with_it, without = effects.worst_disagreement(model, phi, (known.changed, known.base), random)
    assert with_it < 1
    assert without > 1


@each_term
def test_a_known_strength_is_recovered(known):
    model, _ = effects.model_of(known.changed, np.random.default_rng(3))
    silent = fit_configured(effects.replace(model, experiment=known.base))
    (found,) = try_effects(silent, [known.effect], known.evidence)
    assert found.net > 0
    here = slice(len(effects.FORCES_PN), None)
    pulls = found.fit.theta[here] - np.array(known.strength)
    pulls /= np.sqrt(np.diag(found.fit.covariance[here, here]))
    assert np.all(np.abs(pulls) < 4)


@each_term
def test_a_term_is_said_in_words_and_numbers(known):
    said = known.effect.cause(known.changed)
    assert said.startswith(known.effect.axes[0]) or "along" in said
    assert not said.endswith(".")
    strengths = known.effect.strengths(known.changed)
    assert strengths
    assert all(math.isfinite(value) for _, value, _ in strengths)
    # what the experiment already has is not tried again
    assert not known.effect.hypotheses(known.changed, known.evidence)


@each_term
def test_what_a_term_promises_is_not_much_less_than_it_gains(known):
    """It may be more: a square that the expected power bends away from is taken as straight."""
    hypothesis = known.hypothesis
    first = hypothesis.parameters[0]
    share = known.weak or (0.02 if first.lower == 0 else 0.1)
    sizes = [p is first or 0 == first.lower == p.lower for p in hypothesis.parameters]
    weak = [
        share * strength if is_size else p.start
        for p, is_size, strength in zip(hypothesis.parameters, sizes, known.strength, strict=True)
    ]
    model, _ = effects.model_of(effects.changed(hypothesis, weak), np.random.default_rng(4))
    silent = fit_configured(effects.replace(model, experiment=known.base))
    size = effects.replace(
        hypothesis,
        experiment=effects.changed(hypothesis, weak),
        parameters=tuple(itertools.compress(hypothesis.parameters, sizes)),
    )
    gain = with_hypothesis(silent, size).log_likelihood - silent.log_likelihood
    assert 0.6 * gain - 1 < promised_gain(silent, hypothesis) < known.most * gain + 1
    if gain < 2:
        return  # too little to be told from none
    chosen = most_promising(silent, [known.effect], known.evidence, 3)
    assert chosen[known.name]


def test_of_many_beginnings_the_best_and_some_elsewhere_are_taken():
    gains = [10.0, 11.0, 12.0, 13.0, None, 14.0, 0.0, 9.0, 8.0, 9.5]
    chosen = _worth_beginning(gains, 8.5)
    assert {2, 3, 5} <= set(chosen)
    # of 0, 1, 7 and 9, that are left, three: the first, the last, and one between
    assert set(chosen) - {2, 3, 5} in ({0, 1, 9}, {0, 7, 9})
    assert _worth_beginning([1.0, None], 0.5) == (0,)


def test_drift_has_no_name_along_an_axis_that_records_a_share_of_another():
    """The stage's motion along z comes with the share."""
    (alone,) = drift.EFFECT.hypotheses(effects.BASE, effects.EVIDENCE)
    mixed = with_step(effects.BASE, Share((1, 2), 1.0, 0.3))
    (beside,) = drift.EFFECT.hypotheses(mixed, effects.EVIDENCE)
    assert [one.name for one in alone.parameters] == [f"walk along {axis}" for axis in "xyz"]
    assert [one.name for one in beside.parameters] == ["walk along x", "walk along z"]


ALONG = "reference motion along "


@pytest.mark.parametrize(("pair", "moving"), [((1, 2), "xz"), ((2, 0), "xy")])
def test_a_reference_does_not_move_along_an_axis_that_records_a_share_of_another(pair, moving):
    """The share of the stage's motion has its sizes there, and is not the reference's."""
    mixed = with_step(effects.BASE, Share(pair, 1.0, 0.3))
    for one in reference_noise.EFFECT.hypotheses(mixed, effects.EVIDENCE):
        names = [parameter.name for parameter in one.parameters]
        assert [name[len(ALONG)] for name in names if name.startswith(ALONG)] == list(moving)
        assert any(name.startswith("reference at the start") for name in names) == ("z" in moving)


@pytest.mark.parametrize(
    ("name", "strength", "beside"),
    [
        ("gain_x", (0.2, -1.0), "lateral_scale"),
        ("mixing_x_in_z", (0.15, -1.0), "z_crosstalk"),
    ],
)
def test_what_changes_with_the_force_is_found_beside_what_does_the_same_at_all_forces(
    name, strength, beside
):
    """A fit that starts from the same at all forces would stay there: the other does that."""
    known = KnownTerm(name, strength, (0.0, 0.0))
    model, _ = effects.model_of(known.changed, np.random.default_rng(6))
    silent = fit_configured(effects.replace(model, experiment=known.base))
    other = next(one for one in OWN if one.name == beside)
    (tried,) = try_effects(silent, [other], known.evidence)
    with_other = tried.fit
    chosen = most_promising(with_other, [known.effect], known.evidence, 3)
    found = try_effects(with_other, [known.effect], known.evidence, beside=True, only=chosen)
    assert chosen
    assert found[0].net > 0
