"""Sizes that `[model.<effect>]` pins are held by the configured fit, and what cannot be is told."""

from dataclasses import replace

import pytest

from mtpipe.crosschecking.crosscheck import crosscheck
from mtpipe.crosschecking.prepared_bead import OTHER_FORMULA_NATS, described, preference, prepare
from mtpipe.crosschecking.setup_effects import with_listed
from mtpipe.diagnosis.refit import other_formulas
from mtpipe.drift import subtract_drift
from mtpipe.ground.errors import SetupError
from mtpipe.pipeline.results import not_simulated
from tests.small_case import raw, setup

KNOWN = ["wall_drag", "rotation_coupling", "tracking_noise"]


@pytest.fixture(scope="module")
def recorded():
    return subtract_drift(raw(11))


def fitted(recorded, **model):
    """The configured fit under a setup with these further effects and tables."""
    effects = KNOWN + [name for name in model if name not in KNOWN]
    changed = setup(model={"effects": effects, **{k: v for k, v in model.items() if v}})
    case = with_listed(prepare(replace(recorded, setup=changed), "b1"), changed)
    return described(case), {parameter.name for parameter in case.fit.model.parameters}


def test_a_pinned_size_is_held_and_an_unpinned_one_fitted(recorded):
    free, parameters = fitted(recorded, axial_scale={})
    held, left = fitted(recorded, axial_scale={"factor": 1.004})
    assert held.optics.axial_scale == pytest.approx(1.004, rel=1e-9)
    assert free.optics.axial_scale == pytest.approx(1.0, abs=5e-3)
    assert free.optics.axial_scale != 1.004
    assert len(parameters - left) == 1


def test_one_size_of_several_can_be_pinned(recorded):
    held, left = fitted(recorded, drift={"walk_y_nm_per_root_s": 0.25})
    walk = held.stage.unsubtracted_nm_per_root_s
    assert walk[1] == pytest.approx(0.25)
    assert {"walk along x", "walk along z"} < left
    assert "walk along y" not in left


def test_a_pinned_modulus_goes_with_either_formula(recorded):
    """Errors of forces have in them what the chain's other formula would make of them."""
    pinned = {"effects": [*KNOWN, "extensible_tether"]}
    pinned["extensible_tether"] = {"stretch_modulus_pN": 900.0}
    changed = setup(model=pinned)
    case = with_listed(prepare(replace(recorded, setup=changed), "b1"), changed)
    (other,) = other_formulas(case.fit)
    chains = [fit.model.experiment.chain for fit in (case.fit, other)]
    assert {chain.formula for chain in chains} == {"extensible-marko-siggia", "extensible"}
    assert [chain.stretch_modulus_pN for chain in chains] == pytest.approx([900.0, 900.0])
    preferred = {
        chain.formula: preference(fit) - fit.log_likelihood
        for chain, fit in zip(chains, (case.fit, other), strict=True)
    }
    assert preferred["extensible-marko-siggia"] == pytest.approx(OTHER_FORMULA_NATS)
    assert preferred["extensible"] == 0


@pytest.mark.parametrize(
    ("pinned", "noise_nm"), [(2.5, (2.5, 2.5, 2.5)), ([2.0, 2.1, 3.2], (2.0, 2.1, 3.2))]
)
def test_pinned_noise_is_held(recorded, pinned, noise_nm):
    held, left = fitted(recorded, tracking_noise={"noise_nm": pinned})
    assert held.tracker.noise_nm == noise_nm
    assert not any("tracking noise" in name for name in left)


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ({"axial_scale": {"facter": 1.0}}, "facter is no size that can be pinned. It has factor"),
        ({"axial_scale": {"factor": 50.0}}, "cannot be. Write a number between"),
        ({"axial_scale": {"factor": "unknown"}}, "is no number"),
        ({"wall_drag": {"height_nm": 3.0}}, "no size that can be pinned"),
        ({"tracking_noise": {"nois_nm": 3.0}}, "nois_nm is no size that can be pinned"),
        ({"tracking_noise": {"noise_nm": [1.0, 2.0]}}, "one each for x, y and z"),
    ],
)
def test_what_cannot_be_pinned_is_told(recorded, model, words):
    with pytest.raises(SetupError) as told:
        fitted(recorded, **model)
    assert words in str(told.value)


def test_a_recording_with_its_drift_is_not_compared():
    check = crosscheck(raw(11))
    assert not check.beads
    assert "drift was not subtracted" in check.refused["b1"]


def test_listed_effects_that_no_simulation_has_are_told():
    assert not not_simulated(KNOWN)
    (told,) = not_simulated([*KNOWN, "pixel_locking", "surface_sticking"])
    assert "pixel_locking, surface_sticking" in told.message
    assert (told.code, told.severity) == ("effects_not_simulated", "caution")


def test_a_whole_tether_that_does_not_turn_its_bead_is_told():
    assert not not_simulated([*KNOWN, "anharmonic_tether"])
    (told,) = not_simulated(["wall_drag", "anharmonic_tether"])
    assert "anharmonic_tether without rotation_coupling" in told.message
