"""Verdicts and their reasons: no cause is told that nothing speaks for."""

from __future__ import annotations

import pytest

from mtpipe.estimate import Estimate
from mtpipe.setup import parse_setup
from mtpipe.verdict import tether_reasons
from tests.simulated import setup_content

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
    assert "so have the other beads: z" in shared
    assert "more than one" not in shared


def test_where_both_lengths_are_off_z_is_likelier(setup):
    both = said(setup, (1000.0, 24.0), STATED_NM, STATED_NM)
    assert "as both lengths are off, z" in both
    assert "more than one tether" not in both
