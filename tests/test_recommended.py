"""The force to quote: the rule, what is in its interval, and the verdict that goes with it."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import mtpipe
from mtpipe.calibration.calibration import calibrate
from mtpipe.calibration.recommended_force import BeadForces
from mtpipe.calibration.scatter import scatter_beyond_errors
from mtpipe.calibration.spectral_force import (
    contradictions_of,
    forces_of_spectra,
    of_ln,
    spectral_force,
)
from mtpipe.diagnosis.forces_from_heights import lever_ln_errors
from mtpipe.diagnosis.forces_to_quote import bead_forces
from mtpipe.ground.estimate import Estimate
from mtpipe.physics.tether import Chain, mean_extension_nm
from mtpipe.pipeline.verdict import BeadVerdict
from mtpipe.pipeline.verdict_diagnosed import with_diagnosis
from tests.simulated import recording

FORCES_PN = (0.5, 2.0, 6.0)
CHAIN = Chain(1200.0, 50.0, 298.15)


@pytest.fixture(scope="module")
def bead():
    return calibrate(mtpipe.subtract_drift(recording(FORCES_PN, 4096))).beads[0]


def diagnosed(verdict, *, before=FORCES_PN, after=None, pulls=0.0, moved=None, p_value=1e-6):
    """What a diagnosis may have found: forces of the configured fit without and with names."""

    def fit(forces):
        return SimpleNamespace(
            force_pN=np.array(forces),
            force_stderr_pN=0.01 * np.array(forces),
            height_pulls=np.full(len(forces), pulls),
            slopes=[SimpleNamespace(extension_nm=[100.0]) for _ in forces],
            data=None,
            expected=None,
            converged=True,
            theta=None,
            model=SimpleNamespace(
                parameters=(),
                described=lambda theta: SimpleNamespace(chain=CHAIN),
                data=None,
                heights=lambda *_: SimpleNamespace(missed_nm=np.full(len(forces), pulls)),
            ),
        )

    plateaus = [SimpleNamespace(number=i) for i in range(len(before))]
    first = fit(before)
    last = first if after is None else fit(after)
    correction = None
    if moved is not None:
        shift = np.full(len(before), moved)
        correction = SimpleNamespace(ln_force_shift=shift, ln_force_stderr=0 * shift)
    named = () if after is None else (SimpleNamespace(name="viscosity", equivalent=()),)
    return SimpleNamespace(
        verdict=verdict,
        named=named,
        named_once=named,
        before=SimpleNamespace(case=SimpleNamespace(plateaus=plateaus, fit=first)),
        after=SimpleNamespace(case=SimpleNamespace(plateaus=plateaus, fit=last), p_value=p_value),
        fit=last,
        force_pN=last.force_pN,
        force_stderr_pN=last.force_stderr_pN,
        unexplained=SimpleNamespace(correction=correction) if verdict == "unexplained" else None,
    )


def sources(forces):
    return {one.source for one in forces.recommended.values()}


def values(forces):
    return [one.force.value for _, one in sorted(forces.recommended.items())]


def with_friction_contradicted(bead, ratio):
    measured = Estimate(ratio, 0.01, (ratio - 0.01, ratio + 0.01), "", "")
    return replace(bead, friction_contradicts=True, friction_ratio=measured)


def test_forces_of_a_bead_are_told_in_a_line(bead):
    shown = repr(bead_forces(bead, None))
    assert shown.startswith("BeadForces: 3 of 3 to use; 0.")
    assert shown.count(" pN") == 3
    assert "\n" not in shown
    assert len(shown) < 150
    none = repr(BeadForces({}))
    assert none == "BeadForces: 0 of 0 to use"


def test_without_a_cross_check_x_and_y_are_quoted(bead):
    forces = bead_forces(bead, None)
    assert sources(forces) == {"spectra"}
    assert values(forces) == pytest.approx(FORCES_PN, rel=0.15)
    assert math.isnan(forces.bound_percent)
    shared = [one.force.value for one in bead.plateaus[0].axes if one.force is not None]
    assert values(forces)[0] == shared[0]


def test_what_the_cross_check_does_not_contradict_is_quoted_with_heights(bead):
    forces = bead_forces(bead, diagnosed("consistent"))
    assert sources(forces) == {"heights"}
    assert values(forces) == list(FORCES_PN)
    assert forces.bound_percent == 0


def test_what_is_explained_is_quoted_with_what_was_named(bead):
    forces = bead_forces(bead, diagnosed("explained", after=(0.6, 2.0, 6.0)))
    assert sources(forces) == {"named"}
    assert values(forces) == [0.6, 2.0, 6.0]
    assert forces.configured[0].value == 0.5
    assert forces.changed_percent == pytest.approx(20)


def test_forces_that_rest_on_wrong_heights_are_not_quoted(bead):
    """As on real recordings: z's power and heights pull the configured forces down by a factor."""
    forces = bead_forces(bead, diagnosed("unexplained", before=(0.2, 0.8, 2.4), pulls=20.0))
    assert sources(forces) == {"spectra_alone"}
    for true, one in zip(FORCES_PN, forces.recommended.values(), strict=True):
        assert abs(one.force.value - true) < 3 * one.force.stderr
    assert forces.bound_percent < 15


def test_sound_spectra_are_quoted_where_heights_that_look_sound_give_other_forces(bead):
    forces = bead_forces(bead, diagnosed("unexplained", before=(0.2, 0.8, 2.4)))
    assert sources(forces) == {"spectra_alone"}
    assert values(forces) == pytest.approx(FORCES_PN, rel=0.15)


def test_heights_are_quoted_where_the_spectra_contradict_themselves(bead):
    shapeless = replace(
        bead,
        plateaus=tuple(
            replace(
                plateau,
                axes=tuple(
                    replace(one, free=replace(one.free, p_value=1e-30)) for one in plateau.axes
                ),
            )
            for plateau in bead.plateaus
        ),
    )
    heights = tuple(1.3 * f for f in FORCES_PN)
    forces = bead_forces(shapeless, diagnosed("unexplained", before=heights, moved=0.05))
    assert sources(forces) == {"heights_alone"}
    assert values(forces) == list(heights)
    assert forces.bound_percent > 100 * math.expm1(0.05)
    # the spectra, though useless, are what is left to say how far off the heights may be
    assert forces.recommended[2].force.interval[0] < FORCES_PN[2] * 1.02


def test_heights_within_what_friction_leaves_open_are_quoted(bead):
    """A lateral scale that is wrong moves friction and force alike, and no height."""
    wrong = with_friction_contradicted(bead, 0.7)
    near = tuple(1.3 * f for f in FORCES_PN)
    assert sources(bead_forces(wrong, diagnosed("unexplained", before=near))) == {"heights_alone"}
    far = tuple(3.0 * f for f in FORCES_PN)
    assert sources(bead_forces(wrong, diagnosed("unexplained", before=far))) == {"spectra_alone"}


def test_where_both_contradict_themselves_the_interval_reaches_what_friction_says(bead):
    wrong = with_friction_contradicted(bead, 0.7)
    forces = bead_forces(wrong, diagnosed("unexplained", pulls=20.0))
    assert sources(forces) == {"spectra_alone"}
    for one in forces.recommended.values():
        low, high = one.force.interval
        assert low <= one.force.value * 0.7
        assert high >= one.force.value / 0.7
    assert forces.bound_percent > 100 * (1 / 0.7 - 1)


def test_determinations_that_agree_bound_one_another(bead):
    forces = bead_forces(bead, diagnosed("unexplained"))
    assert sources(forces) == {"heights_alone"}
    spectra = bead_forces(bead, None)
    best = min(one.force.stderr / one.force.value for one in spectra.recommended.values())
    assert 100 * best / 3 < forces.bound_percent < 15


def test_a_plateau_of_several_states_has_no_force_that_is_ok(bead):
    mixed = replace(bead.plateaus[1], not_one_state="the force changes in it")
    several = replace(bead, plateaus=(bead.plateaus[0], mixed, bead.plateaus[2]))
    for found in (None, diagnosed("consistent")):
        forces = bead_forces(several, found)
        assert forces.recommended[1].force.status == "not_one_state"
        assert len(forces.usable_pN) == 2


def test_a_plateau_without_a_force_says_why_in_a_word(bead):
    def words(**changes):
        plateaus = tuple(
            replace(one, axes=tuple(replace(axis, **changes) for axis in one.axes))
            for one in bead.plateaus
        )
        recommended = forces_of_spectra(replace(bead, plateaus=plateaus)).recommended
        return {(one.source, one.force.status) for one in recommended.values()}

    stuck = {"refusal": "it is stuck", "fit": None, "posterior": None, "force": None}
    assert words(**stuck) == {("none", "refused")}
    # where z is unknown the stiffnesses are good, and no force follows from them
    assert words(force=None) == {("none", "not_identified")}


def test_sound_spectra_have_no_contradiction_and_wrong_ones_have(bead):
    sound = contradictions_of(bead)
    assert (sound.shape, sound.friction_ln, sound.axes_ln, sound.ln_error) == (False, 0, 0, 0)
    plateaus = []
    for plateau in bead.plateaus:
        axes = [
            replace(one, force_alone=one.force_alone.scaled(1.6, "pN")) if one.axis == "y" else one
            for one in plateau.axes
        ]
        plateaus.append(replace(plateau, axes=tuple(axes)))
    apart = contradictions_of(replace(bead, plateaus=tuple(plateaus)))
    assert apart.axes_ln == pytest.approx(math.log(1.6), rel=0.2)
    assert apart.ln_error == pytest.approx(math.log(1.6) / 2, rel=0.2)


def test_two_forces_that_differ_are_averaged_by_what_each_knows(bead):
    plateau = bead.plateaus[1]
    axes = tuple(
        replace(one, shares_force=False, force=of_ln(math.log(force), 0.05, ""))
        if one.axis != "z"
        else one
        for one, force in zip(plateau.axes, (2.0, 2.4, 0.0), strict=True)
    )
    mean = spectral_force(replace(plateau, axes=axes))
    assert 2.0 < mean.value < 2.4
    assert 0.03 < mean.stderr / mean.value <= 0.05


def test_a_lever_that_the_tether_contradicts_is_in_the_error(bead):
    forces = {i: of_ln(math.log(f), 0.01, "") for i, f in enumerate(FORCES_PN)}
    assert max(lever_ln_errors(bead, CHAIN, forces).values()) < 0.02
    assert lever_ln_errors(bead, None, forces) == {}
    longer = tuple(
        replace(plateau, extension_nm=1.25 * float(mean_extension_nm(CHAIN, force)))
        for plateau, force in zip(bead.plateaus, FORCES_PN, strict=True)
    )
    wrong = lever_ln_errors(replace(bead, plateaus=longer), CHAIN, forces)
    assert list(wrong.values()) == pytest.approx([math.log(1.25)] * 3, rel=0.02)


def test_scatter_beyond_errors_is_what_was_added():
    random = np.random.default_rng(5)
    stderr = random.uniform(0.01, 0.05, 4000)
    for scatter in (0.02, 0.1):
        off = stderr * random.normal(size=4000) + scatter * random.normal(size=4000)
        assert scatter_beyond_errors(off, stderr) == pytest.approx(scatter, rel=0.1)
    assert scatter_beyond_errors(0.6 * stderr, stderr) == 0.0
    assert scatter_beyond_errors(np.array([]), np.array([])) == 0.0


UNCHECKED = BeadVerdict("b1", "unchecked", ())


def judged(bead, found, verdict=UNCHECKED, tolerance=0.03):
    return with_diagnosis(verdict, bead_forces(bead, found), found, tolerance)


def test_good_needs_the_cross_check(bead):
    assert judged(bead, None).verdict == "unchecked"
    assert with_diagnosis(UNCHECKED, None, None, 0.03).verdict == "unchecked"
    assert judged(bead, diagnosed("consistent")).verdict == "good"
    refused = replace(UNCHECKED, verdict="refused", reasons=("free",))
    assert judged(bead, diagnosed("consistent"), refused).verdict == "refused"


def test_what_moves_no_force_by_more_than_the_tolerance_leaves_a_bead_good(bead):
    small = diagnosed("explained", after=tuple(1.01 * f for f in FORCES_PN))
    large = diagnosed("explained", after=tuple(1.2 * f for f in FORCES_PN))
    assert (judged(bead, small).verdict, judged(bead, small).material) == ("good", False)
    assert (judged(bead, large).verdict, judged(bead, large).material) == ("caution", True)
    assert judged(bead, large, tolerance=0.25).verdict == "good"
    assert "viscosity" in judged(bead, small).reasons[0]
    left = diagnosed("unexplained", before=(0.2, 0.8, 2.4), pulls=20.0)
    assert judged(bead, left, tolerance=0.01).verdict == "caution"
    assert judged(bead, left, tolerance=0.5).verdict == "good"
    assert "cause is not known" in judged(bead, left).reasons[0]


def test_a_caution_stays_one_and_keeps_its_reasons(bead):
    doubtful = replace(UNCHECKED, verdict="caution", reasons=("short",))
    one = judged(bead, diagnosed("consistent"), doubtful)
    assert (one.verdict, one.reasons, one.mismatch) == ("caution", ("short",), "consistent")


def test_a_force_that_is_not_known_to_a_factor_of_two_is_no_number(bead):
    for ratio, known in ((0.6, True), (0.3, False)):
        wrong = with_friction_contradicted(bead, ratio)
        forces = bead_forces(wrong, diagnosed("unexplained", pulls=20.0))
        assert {one.force.status == "ok" for one in forces.recommended.values()} == {known}
        assert all(one.force.interval[0] > 0 for one in forces.recommended.values())
        assert len(forces.usable_pN) == (3 if known else 0)
