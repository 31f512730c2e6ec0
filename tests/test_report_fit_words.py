"""Which fit the forces come from, in words."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from mtpipe.calibration.series_choice import SeriesChoice
from mtpipe.report.fit_words import JointFit, fit_source, joint_fit

SHARED = "series of spectra: x and y share the force, friction expected from the setup"
MEASURED = "series of spectra: x and y apart, friction measured on this bead"


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("expected", [True, False])
def test_the_words_of_the_choice_are_understood(shared: bool, expected: bool) -> None:
    fit = cast(Any, SimpleNamespace(model=SimpleNamespace(force_shared=shared)))
    assert joint_fit(SeriesChoice(fit, expected, ()).words) == JointFit(shared, expected)


@pytest.mark.parametrize("method", ["spectrum, friction free", "none", "", None])
def test_other_methods_are_no_joint_fit(method: str | None) -> None:
    assert joint_fit(method) is None


def bead(series: str = SHARED) -> dict[str, Any]:
    return {"series": series, "friction_ratio": 1.31, "friction_ratio_stderr": 0.012}


def rows(method: str, axes: str = "xy", plateaus: int = 3, **changed: Any) -> list[dict[str, Any]]:
    row = {"status": "ok", "method": method, "flags": "", "extension_nm": 900.0} | changed
    return [row | {"plateau": p, "axis": axis} for p in range(plateaus) for axis in axes]


def test_the_most_informed_fit_needs_no_excuse() -> None:
    source = fit_source(bead(), rows(SHARED), radius_known=True)
    assert source is not None
    assert source.label == "joint"
    assert "6 spectra" in source.sentence
    assert [reason[:26] for reason in source.reasons] == ["The friction is the one ex"]


def test_a_less_informed_fit_says_why() -> None:
    source = fit_source(bead(MEASURED), rows(MEASURED), radius_known=True)
    assert source is not None
    assert source.label == "joint, x and y apart, friction measured"
    assert "x and y each have their own force" in source.sentence
    apart, friction = source.reasons
    assert "no fit with one force for both describes the spectra" in apart
    assert "contradict the one expected" in friction
    assert "1.310 ± 0.012 times as much" in friction


def test_one_axis_cannot_share() -> None:
    method = "series of spectra: x and y apart, friction expected from the setup"
    source = fit_source(bead(method), rows(method, axes="x"), radius_known=True)
    assert source is not None
    assert source.label == "joint"
    assert source.sentence.endswith("only x could be used.")
    assert len(source.reasons) == 1


def test_an_unknown_radius_is_said() -> None:
    source = fit_source(bead(), rows(SHARED), radius_known=False)
    assert source is not None
    assert "radius is unknown in the setup" in source.reasons[0]


def test_traces_that_were_left_out_are_named() -> None:
    odd = rows("spectrum, friction expected from the setup", flags="drift;unlike_the_series")[:2]
    source = fit_source(bead(), [*odd, *rows(SHARED)[2:]], radius_known=True)
    assert source is not None
    assert "4 spectra" in source.sentence
    assert source.reasons[-1].startswith(
        "Plateau 0 along x; plateau 0 along y contradict the others"
    )


@pytest.mark.parametrize(("extension", "why"), [(900.0, "No joint"), (None, "A joint fit")])
def test_spectra_by_themselves_say_why(extension: float | None, why: str) -> None:
    mine = rows("spectrum, friction free", extension_nm=extension)
    source = fit_source(bead(""), mine, radius_known=True)
    assert source is not None
    assert source.label == "each separately"
    assert source.sentence == "Each spectrum was fitted separately (friction free)."
    assert source.reasons[0].startswith(why)


def test_a_refused_bead_has_no_source() -> None:
    assert fit_source(bead(""), rows("none", status="refused"), radius_known=True) is None
