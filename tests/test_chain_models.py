"""Chains that a user composes: exact limits, brute force, composition, beads together, choice."""

import math
import re
from dataclasses import replace
from pathlib import Path

import lmfit
import numpy as np
import pytest
from scipy.integrate import quad

import mtpipe
from mtpipe.curves.chain_models import MOLECULES, name_of, valid_for
from mtpipe.curves.extension_curve import fit_curve
from mtpipe.fit.points import Assay, ExtensionPoints
from mtpipe.ground.errors import FitError, MtpipeError
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.jointed_chain import jointed_extension_nm, langevin
from mtpipe.physics.tether import Chain, mean_extension_nm

pytestmark = pytest.mark.slow

KELVIN = 298.0
KT = float(thermal_energy_pN_nm(KELVIN))
JOINTED = {"contour_length_nm": 500.0, "kuhn_length_nm": 1.5, "temperature_K": KELVIN}
PAGE = Path(__file__).parents[1] / "docs" / "curves.md"


@pytest.mark.parametrize("pull", [1e-6, 1e-3, 0.0099, 0.0101, 0.5, 3.0, 40.0])
def test_a_segment_is_a_dipole_by_brute_force(pull):
    cosine, weight = np.polynomial.legendre.leggauss(200)
    weight = weight * np.exp(pull * (cosine - 1))
    brute = weight @ cosine / weight.sum()
    assert float(langevin(pull)) == pytest.approx(brute, rel=1e-9, abs=1e-15)
    assert float(langevin(-pull)) == -float(langevin(pull))


def test_a_jointed_chain_in_its_limits():
    weak, strong = 1e-4, 500.0
    slope = JOINTED["contour_length_nm"] * JOINTED["kuhn_length_nm"] / (3 * KT)
    assert float(jointed_extension_nm(weak, **JOINTED)) == pytest.approx(slope * weak, rel=1e-6)
    short = 1 - KT / (strong * JOINTED["kuhn_length_nm"])
    assert float(jointed_extension_nm(strong, **JOINTED)) == pytest.approx(500 * short, rel=1e-12)
    soft = jointed_extension_nm(20.0, **JOINTED, stretch_modulus_pN=800.0)
    rigid = jointed_extension_nm(20.0, **JOINTED)
    assert float(soft / rigid) == pytest.approx(1 + 20 / 800)


@pytest.mark.parametrize("force_pN", [0.5, 3.0, 10.0, 30.0, 60.0])
def test_stretching_is_that_of_springs_to_what_the_docstring_says(force_pN):
    """A segment as a spring in three dimensions, by quadrature over its length."""
    b, modulus = 1.5, 800.0

    def mean(of):
        def integrand(length):
            pull = force_pN * length / KT
            energy = modulus * (length - b) ** 2 / (2 * b * KT)
            # sinh(pull)/pull over its value at b, which keeps it finite
            weight = length**2 * math.exp(-energy + pull - force_pN * b / KT)
            weight *= -math.expm1(-2 * pull) / pull
            return weight * of(length, pull)

        return quad(integrand, 0.5 * b, 1.8 * b, limit=200)[0]

    exact = mean(lambda length, pull: length * float(langevin(pull))) / mean(lambda *_: 1.0) / b
    ours = float(
        jointed_extension_nm(
            force_pN,
            contour_length_nm=1.0,
            kuhn_length_nm=b,
            temperature_K=KELVIN,
            stretch_modulus_pN=modulus,
        )
    )
    assert 0 < exact - ours < 2 * KT / (b * modulus)


def points(truth_nm, force, *, error=0.01, error_nm=0.5, seed=None, lever=False):
    random = None if seed is None else np.random.default_rng(seed)
    noise = np.zeros((2, len(force))) if random is None else random.normal(size=(2, len(force)))
    extension = truth_nm + error_nm * noise[0]
    measured = force * np.exp(error * noise[1])
    errors = np.full(len(force), error_nm)
    number = np.arange(len(force))
    return ExtensionPoints(
        number, measured, error * measured, extension, errors, extension if lever else None
    )


def curve(bead, made, assay=None):
    return fit_curve(bead, made, assay or Assay(KELVIN))


def test_a_worm_like_chain_is_fitted_as_in_a_run():
    force = np.geomspace(0.3, 9.0, 10)
    made = curve("b1", points(mean_extension_nm(Chain(1200.0, 50.0, KELVIN), force), force, seed=3))
    fit = mtpipe.fit_together(mtpipe.worm_like_chain(temperature_K=KELVIN), {"b1": made})
    own = next(one for one in made.fits if one.model == "bouchiat")
    assert fit.chi2 == pytest.approx(own.chi2, rel=1e-4)
    assert fit.dof == own.dof
    assert fit.bic == pytest.approx(own.bic, rel=1e-4)
    for name in ("contour_length_nm", "persistence_length_nm"):
        mine, theirs = fit.own["b1"][name], getattr(own, name)
        assert mine.value == pytest.approx(theirs.value, rel=1e-4)
        assert mine.stderr == pytest.approx(theirs.stderr, rel=0.03)
    assert "10 of 10 forces of 1 bead" in fit.sentence


def handle_and_strand():
    return (
        mtpipe.molecule("dsDNA", 2000, temperature_K=KELVIN, prefix="ds_")
        + mtpipe.molecule("ssDNA", 800, temperature_K=KELVIN, prefix="ss_")
        + mtpipe.extension_offset()
    )


def test_segments_in_series_add_and_are_told_apart_with_one_held():
    model = handle_and_strand()
    assert isinstance(model, lmfit.Model)
    assert valid_for(model).force_range_pN == (10.0, 40.0)
    force = np.linspace(10.5, 39.0, 16)
    handle = Chain(676.0, 50.0, KELVIN, "extensible", 1000.0)
    strand = jointed_extension_nm(
        force, contour_length_nm=470.0, kuhn_length_nm=1.4, temperature_K=KELVIN,
        stretch_modulus_pN=800.0,
    )  # fmt: skip
    truth = mean_extension_nm(handle, force) + strand - 12.0
    for name in ("ds_contour_length_nm", "ds_persistence_length_nm", "ds_stretch_modulus_pN",
                 "ss_stretch_modulus_pN"):  # fmt: skip
        model.set_param_hint(name, vary=False)
    made = curve("b1", points(truth, force))
    # to the surface only the chain of a run would matter, which this molecule is not
    fit = mtpipe.fit_together(model, {"b1": replace(made, surface_force_pN=0.0)})
    own = fit.own["b1"]
    assert own["ss_contour_length_nm"].value == pytest.approx(470.0, rel=1e-3)
    assert own["ss_kuhn_length_nm"].value == pytest.approx(1.4, rel=1e-2)
    assert own["offset_nm"].value == pytest.approx(12.0, abs=0.5)
    assert own["ds_contour_length_nm"].status == "fixed"
    assert fit.chi2 < 1e-4


def test_what_beads_share_is_one_number_with_a_smaller_error():
    force = np.geomspace(0.3, 9.0, 10)
    contours = {"b1": 1180.0, "b2": 1220.0, "b3": 1250.0}
    curves = {
        bead: curve(
            bead,
            points(mean_extension_nm(Chain(c, 47.0, KELVIN), force), force, seed=i, error=0.03),
        )
        for i, (bead, c) in enumerate(contours.items())
    }  # fmt: skip
    model = mtpipe.worm_like_chain(temperature_K=KELVIN)
    together = mtpipe.fit_together(model, curves, shared=["persistence_length_nm"])
    alone = [mtpipe.fit_together(model, {bead: one}) for bead, one in curves.items()]
    shared = together.shared["persistence_length_nm"]
    assert abs(shared.value - 47.0) < 4 * shared.stderr
    singles = [fit.own[b]["persistence_length_nm"].stderr for fit, b in zip(alone, contours)]  # noqa: B905
    assert shared.stderr == pytest.approx(np.mean(singles) / math.sqrt(3), rel=0.2)
    for bead, contour in contours.items():
        one = together.own[bead]["contour_length_nm"]
        assert abs(one.value - contour) < 4 * one.stderr
    assert set(together.table.bead) == {"all", *contours}
    assert "persistence_length" in repr(together)
    assert len(together.plot().data) == 6


def test_an_offset_moves_forces_that_were_found_from_heights():
    force = np.geomspace(0.2, 9.0, 14)
    truth = mean_extension_nm(Chain(1200.0, 50.0, KELVIN), force)
    made = points(truth - 60.0, force * (truth - 60.0) / truth, lever=True)
    unknown = curve("b1", made, Assay(KELVIN, zero_stderr_nm=math.inf))
    model = mtpipe.worm_like_chain(temperature_K=KELVIN)
    with pytest.raises(MtpipeError, match="no offset"):
        mtpipe.fit_together(model, {"b1": unknown})
    fit = mtpipe.fit_together(model + mtpipe.extension_offset(), {"b1": unknown})
    assert fit.own["b1"]["offset_nm"].value == pytest.approx(60.0, abs=1.0)
    assert fit.own["b1"]["persistence_length_nm"].value == pytest.approx(50.0, rel=0.01)


def test_the_range_is_told_and_an_outlier_left_out():
    force = np.array([2.0, 5.0, 12.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0])
    truth = jointed_extension_nm(force, **JOINTED, stretch_modulus_pN=800.0)
    truth[5] += 20.0
    made = curve("b1", points(truth, force))
    model = mtpipe.molecule("ssDNA", 900, temperature_K=KELVIN)
    fit = mtpipe.fit_together(model, {"b1": replace(made, surface_force_pN=0.0)})
    assert list(fit.points["b1"].plateau) == [2, 3, 4, 6, 7, 8]
    assert "6 of 9 forces" in fit.sentence
    assert "hairpins" in fit.sentence
    assert "1 more than 5 standard errors off" in fit.sentence
    assert fit.own["b1"]["kuhn_length_nm"].value == pytest.approx(1.5, rel=0.01)


@pytest.mark.parametrize("jointed", [True, False])
def test_the_model_that_made_the_points_is_chosen(jointed):
    force = np.geomspace(0.5, 9.5, 12)
    truth = (
        jointed_extension_nm(force, **JOINTED)
        if jointed
        else mean_extension_nm(Chain(500.0, 2.0, KELVIN), force)
    )
    made = replace(curve("b1", points(truth, force, seed=5)), surface_force_pN=0.0)
    both = [mtpipe.freely_jointed_chain(temperature_K=KELVIN),
            mtpipe.worm_like_chain(temperature_K=KELVIN)]  # fmt: skip
    for order in (both, both[::-1]):
        fit, why = mtpipe.choose_model(order, {"b1": made})
        assert name_of(fit.model).startswith("freely" if jointed else "worm")
        assert why.startswith(name_of(fit.model))
        assert fit.p_value > 1e-3


def test_stretching_that_is_not_there_is_not_chosen():
    force = np.geomspace(0.5, 38.0, 12)
    for modulus, chosen in ((np.inf, "rigid"), (700.0, "soft")):
        truth = jointed_extension_nm(force, **JOINTED, stretch_modulus_pN=modulus)
        made = replace(curve("b1", points(truth, force, seed=8)), surface_force_pN=0.0)
        rigid, soft = (
            mtpipe.freely_jointed_chain(temperature_K=KELVIN, extensible=e) for e in (False, True)
        )
        fit, _ = mtpipe.choose_model([soft, rigid], {"b1": made})
        assert ("stretch_modulus_pN" in fit.model.param_names) == (chosen == "soft")


@pytest.mark.parametrize("name", MOLECULES)
def test_every_molecule_recovers_itself(name):
    model = mtpipe.molecule(name, 1000, temperature_K=KELVIN)
    low, high = valid_for(model).force_range_pN
    force = np.geomspace(max(low, 0.3) * 1.01, high * 0.99, 12)
    values = {key: one.value for key, one in model.make_params().items()}
    truth = np.asarray(model.eval(force_pN=force, **values))
    made = replace(curve("b1", points(truth, force, error=1e-3, error_nm=0.05)), surface_force_pN=0)
    model.set_param_hint("contour_length_nm", value=0.8 * values["contour_length_nm"])
    fit = mtpipe.fit_together(model, {"b1": made})
    for key, value in values.items():
        assert fit.own["b1"][key].value == pytest.approx(value, rel=0.01), key


def test_faults_are_told_in_a_sentence():
    force = np.geomspace(0.3, 9.0, 3)
    made = {"b1": curve("b1", points(mean_extension_nm(Chain(900.0, 50.0, KELVIN), force), force))}
    model = mtpipe.worm_like_chain(temperature_K=KELVIN)
    with pytest.raises(MtpipeError, match="no parameter 'kuhn'"):
        mtpipe.fit_together(model, made, shared=["kuhn"])
    with pytest.raises(FitError, match="3 forces do not determine 3 parameters"):
        mtpipe.fit_together(model + mtpipe.extension_offset(), made)
    with pytest.raises(FitError, match=r"0 forces .* \(freely jointed.*\) holds from 10 to 60"):
        mtpipe.fit_together(mtpipe.molecule("ssDNA", 500, temperature_K=KELVIN), made)
    with pytest.raises(MtpipeError, match="Known: dsDNA"):
        mtpipe.molecule("PNA", 10, temperature_K=KELVIN)


@pytest.mark.parametrize("zero_stderr_nm", [0.0, 3.0])
def test_the_page_names_what_is_there_and_its_example_runs(monkeypatch, zero_stderr_nm):
    """Of a recording in which z = 0 is exact, and of one in which the beads' touch told it."""
    text = PAGE.read_text(encoding="utf-8")
    for name, kind in MOLECULES.items():
        (row,) = re.findall(rf"^\| `{name}` \| .*$", text, re.MULTILINE)
        assert f"{kind.nm_per_unit:g} nm per" in row
        assert f"{kind.stiffness_nm:g} nm" in row
    (example,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    force = np.geomspace(0.3, 9.0, 8)
    truth = mean_extension_nm(Chain(1190.0, 50.0, KELVIN), force)
    assay = Assay(KELVIN, zero_stderr_nm=zero_stderr_nm)
    made = {
        bead: curve(bead, points(truth, force, seed=i), assay)
        for i, bead in enumerate(("b1", "b2"))
    }  # fmt: skip
    recording = mtpipe.simulate(
        mtpipe.read_setup(PAGE.parents[1] / "sample_data" / "clean_short_tether" / "setup.toml"),
        [2.0], 64, 1,
    )  # fmt: skip
    monkeypatch.setattr(mtpipe, "load", lambda path: recording, raising=False)
    monkeypatch.setattr(mtpipe, "subtract_drift", lambda raw: raw, raising=False)
    monkeypatch.setattr(mtpipe, "force_extension", lambda recording: made, raising=False)
    names = {}
    exec(compile(example, str(PAGE), "exec"), names)
    assert names["fit"].shared["contour_length_nm"].status == "ok"
    assert names["why"].startswith("worm-like chain")
