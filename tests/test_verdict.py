"""Verdicts and their reasons: no cause is told that nothing speaks for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mtpipe
from mtpipe.calibration.calibration import calibrate
from mtpipe.calibration.quality import trace_flags
from mtpipe.calibration.spectral_force import spectral_force
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.notice import Notice
from mtpipe.ground.status import P_POOR
from mtpipe.pipeline.verdict import bead_verdict, tether_reasons
from mtpipe.setup.setup import parse_setup
from tests.simulated import recording, setup_content

STATED_NM = (1200.0, 50.0)


class Fit:
    """As much of a fitted tether as a verdict looks at."""

    def __init__(self, contour_nm: float, persistence_nm: float) -> None:
        self.contour_length_nm = self._known(contour_nm, 0.005)
        self.persistence_length_nm = self._known(persistence_nm, 0.05)
        self.recommended = self

    @staticmethod
    def _known(value: float, relative: float) -> Estimate:
        error = relative * value
        return Estimate(value, error, (value - error, value + error), "nm", "made up")


@pytest.fixture(scope="module")
def setup():
    contour, persistence = STATED_NM
    return parse_setup(setup_content(tether={
        "contour_length_nm": contour, "persistence_length_nm": persistence,
    }))  # fmt: skip


def said(setup, own: tuple[float, float], *others: tuple[float, float]) -> str:
    curves = {"own": Fit(*own)} | {f"b{i}": Fit(*other) for i, other in enumerate(others)}
    return " | ".join(tether_reasons(curves, setup)["own"])


def test_a_tether_as_stated_has_no_reason(setup):
    assert said(setup, STATED_NM, STATED_NM, STATED_NM) == ""


def test_two_tethers_are_suspected_only_where_the_other_beads_are_as_stated(setup):
    twofold = (1200.0, 25.0)
    assert "more than one tether" in said(setup, twofold, STATED_NM, STATED_NM)
    alone = said(setup, twofold)
    assert "persistence length is 25 ± 1.2 nm, the setup says 50 nm" in alone
    assert "more than one" not in alone
    assert "z (its scale, or where it is 0) or the number of tethers" in alone
    # no whole number of tethers makes 33 nm of 50
    assert said(setup, (1200.0, 33.5), STATED_NM, STATED_NM).endswith("the setup says 50 nm")


def test_what_all_beads_show_is_z_and_not_the_tethers(setup):
    shared = said(setup, (1200.0, 24.0), (1200.0, 26.0), (1200.0, 25.0))
    assert "the other beads differ too: z" in shared
    assert "more than one" not in shared


def test_where_both_lengths_are_off_z_is_likelier(setup):
    both = said(setup, (1000.0, 24.0), STATED_NM, STATED_NM)
    assert both.endswith("both lengths are off, z (its scale, or where it is 0) is probably wrong")
    assert "more than one tether" not in both


@pytest.fixture(scope="module")
def calibration():
    """Of a bead whose y shows a line that no setup lists, as x of it does not."""
    raw = recording((1.0, 5.0), 4096)
    xyz = raw.positions_nm["b1"].copy()
    xyz[:, 1] += 30.0 * np.sin(2 * np.pi * 17.0 * raw.time_s)
    positions = {**raw.positions_nm, "b1": xyz}
    return calibrate(mtpipe.subtract_drift(replace(raw, positions_nm=positions)))


@pytest.fixture(scope="module")
def shaken(calibration):
    return calibration.beads[0]


def test_a_number_is_one_to_use_only_where_the_spectrum_is_the_models(shaken):
    for plateau in shaken.plateaus:
        x, y, _ = plateau.axes
        assert y.fit.p_value < P_POOR
        assert plateau.status(y) == "unlike_model"
        force = spectral_force(plateau)
        assert force.status == plateau.force_status
        if not x.shares_force:
            assert plateau.status(x) == "ok"
            assert force.value == pytest.approx(x.force.value)


def test_a_small_p_value_is_written_as_on_paper(calibration, setup):
    (bead,) = calibration.beads
    flags = [
        one for plateau in bead.plateaus for one in trace_flags(calibration, bead, plateau, setup)
    ]
    said = [one.message for one in flags if one.code == "poor_fit" and one.axis == "y"]
    assert len(said) == 2
    assert all("10⁻" in one and "e-" not in one for one in said)


def test_a_spectrum_unlike_the_model_is_judged_by_the_cross_check_where_there_is_one(shaken, setup):
    flags = tuple(
        Notice("poor_fit", "caution", "differs", "b1", plateau.plateau.number, "y")
        for plateau in shaken.plateaus
    )
    alone = bead_verdict(shaken, flags, setup)
    assert alone.verdict == "caution"
    assert "spectrum unlike the model in 2 of 2 plateaus" in alone.reasons
    checked = bead_verdict(shaken, flags, setup, cross_checked=True)
    assert not any("spectrum unlike" in reason for reason in checked.reasons)


def test_a_force_whose_lever_may_be_nought_is_none_to_use(setup):
    raw = mtpipe.subtract_drift(recording((1.0, 5.0), 2048))
    (bead,) = calibrate(replace(raw, z_zero_stderr_nm={"b1": 5000.0})).beads
    for plateau in bead.plateaus:
        x = plateau.axes[0]
        assert x.estimates.stiffness.status == "ok"
        assert x.force.interval[0] == 0.0
        assert plateau.status(x) == plateau.force_status == "zero_force"
        assert spectral_force(plateau).status == "zero_force"
    verdict = bead_verdict(bead, (), setup)
    assert verdict.verdict == "refused"
    assert verdict.reasons == ("in every plateau the force may be zero within its error",)
    with_flags = mtpipe.force_extension(replace(raw, z_zero_stderr_nm={"b1": 5000.0}))
    assert with_flags == {}
