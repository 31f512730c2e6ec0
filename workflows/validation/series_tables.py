"""Markdown tables of the joint fits of a bead's series, from the rows `series` collects.

Errors of forces, radius and friction are those of logarithms, in percent; of noise, in nm².
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from report import bias, percent, rms, table
from series import STATED_BOUND
from series_cases import (
    EXTENSIONS_NM,
    FORCES_PN,
    HELD,
    RADIUS_NM,
    RATE_HZ,
    VISCOSITY_MPA_S,
    Case,
)

from mtpipe.physics.tethered_bead import friction_pN_s_per_nm

OTHERS = {
    "ln_radius": "radius",
    "ln_friction_scale": "friction scale",
    "noise_0": "noise variance x (nm²)",
    "noise_1": "noise variance y (nm²)",
}


def joint_table(cases: Sequence[Case], rows: pd.DataFrame) -> str:
    """The true joint fit: a row per case and coordinate, then what holds of whole series."""
    lines = []
    for case in cases:
        of_case = rows[rows.case == case.name]
        for name, one in of_case.groupby("coordinate", sort=False):
            lines.append([
                case.name, *_named(str(name)), _size(one.bound.iloc[0], str(name)),
                _stated(str(name)), f"{rms(one.error / one.bound):.2f}",
                _bias(one.error, str(name)),
                f"{percent(one.fit_holds)}, {percent(one.posterior_holds)}",
            ])  # fmt: skip
    coordinates = table(
        "series | quantity | corner / Nyquist, x | bound"
        " | bound without the scatter of the friction"
        " | rms error / bound | bias (%, noise nm²) | 68 %: fit, posterior",
        lines,
    )
    return "\n\n".join([coordinates, _whole_series_table(cases, rows)])


def _whole_series_table(cases: Sequence[Case], rows: pd.DataFrame) -> str:
    lines = []
    for case in cases:
        of_case = rows[rows.case == case.name]
        forces = of_case[of_case.coordinate.str.startswith("ln_force")]
        one = of_case.groupby("repeat").first()
        lines.append([
            case.name, str(len(one)), f"{rms(forces.error / forces.bound):.2f}",
            f"{percent(forces.fit_holds)}, {percent(forces.posterior_holds)}",
            percent(~one.converged),
            f"{1e3 * one.fit_s.median():.0f} / {1e3 * one.posterior_s.median():.0f}",
        ])  # fmt: skip
    return table(
        "series | number | rms error / bound, all forces | 68 %: fit, posterior"
        " | posteriors not converged (%) | CPU ms: fit / posterior",
        lines,
    )


def pipeline_table(rows: pd.DataFrame, joint: pd.DataFrame) -> str:
    """Forces of whole recordings, of the series and of x alone, against the joint bound."""
    lines = []
    held = joint[(joint.case == HELD.name) & joint.coordinate.str.startswith("ln_force_")]
    bounds = held.groupby("coordinate").bound.first().tolist()
    for (plateau, one), bound in zip(rows.groupby("plateau"), bounds, strict=True):
        lines.append([
            f"{FORCES_PN[int(str(plateau))]:.2f}", f"{_corner(int(str(plateau))):.2f}",
            f"{bound:.1%}", *_told(one, "force", bound), *_told(one, "alone", bound),
        ])  # fmt: skip
    recordings = rows.groupby("repeat").first()
    shares = recordings.chosen.value_counts(normalize=True)
    chosen = ", ".join(f"{_short(str(name))} {share:.1%}" for name, share in shares.items())
    summary = (
        f"Chosen in {len(recordings)} recordings: {chosen}; traces left out in "
        f"{percent(recordings.left_out)} %. Forces not converged: {percent(~rows.force_converged)}"
        f" %. All forces: rms error over bound {_over(rows, 'force', bounds):.2f}, "
        f"{percent(rows[rows.force_told].force_holds)} % within 68 %."
    )
    each = "rms error / bound | bias (%) | within 68 % (%) | without (%)"
    header = "force (pN) | corner / Nyquist, x | bound | series: " + each + " | x alone: " + each
    return f"{table(header, lines)}\n\n{summary}"


def choice_table(cases: Sequence[Case], rows: pd.DataFrame) -> str:
    """What is chosen for true and for faulty series, and how far its forces are off."""
    words = [str(word) for word in rows.chosen.value_counts().index]
    lines = []
    for case in cases:
        one = rows[rows.case == case.name]
        got = one[one.left_out.notna()]
        lines.append([
            case.name, str(len(one)), *(percent(one.chosen == word) for word in words),
            percent(got.left_out > 0),
            percent(got.odd_left_out.astype(bool)) if case.has_odd_plateau else "–",
            f"{math.sqrt(got.mean_square_pull.mean()):.2f}",
            f"{100 * got.largest_error.median():.1f}",
        ])  # fmt: skip
    return table(
        "series | number | "
        + " | ".join(f"{_short(word)} (%)" for word in words)
        + " | traces left out (%) | these are the odd plateau's (%)"
        " | rms pull of forces | largest error of a force, median (%)",
        lines,
    )


def _named(coordinate: str) -> tuple[str, str]:
    """Name of a coordinate, and the corner frequency over Nyquist where it is a force."""
    if not coordinate.startswith("ln_force_"):
        return OTHERS[coordinate], "–"
    plateau = _plateau(coordinate)
    return f"force {FORCES_PN[plateau]:.2f} pN", f"{_corner(plateau):.2f}"


def _plateau(coordinate: str) -> int:
    return int(coordinate.removeprefix("ln_force_"))


def _corner(plateau: int) -> float:
    length = float(EXTENSIONS_NM[plateau])
    friction = float(friction_pN_s_per_nm(length, RADIUS_NM, VISCOSITY_MPA_S, wall=True))
    return float(FORCES_PN[plateau]) / length / friction / (math.pi * RATE_HZ)


def _stated(coordinate: str) -> str:
    if not coordinate.startswith("ln_force_"):
        return "–"
    return f"{STATED_BOUND[_plateau(coordinate)]:.1%}"


def _size(value: float, coordinate: str) -> str:
    return f"{value:.2f}" if coordinate.startswith("noise") else f"{value:.2%}"


def _bias(errors: pd.Series, coordinate: str) -> str:
    return bias(errors / 100) if coordinate.startswith("noise") else bias(errors)


def _told(one: pd.DataFrame, name: str, bound: float) -> list[str]:
    got = one[one[f"{name}_told"]]
    without = percent(~one[f"{name}_told"])
    if len(got) < 2:
        return ["–", "–", "–", without]
    errors = got[f"{name}_error"]
    return [f"{rms(errors / bound):.2f}", bias(errors), percent(got[f"{name}_holds"]), without]


def _over(rows: pd.DataFrame, name: str, bounds: Sequence[float]) -> float:
    return rms(rows[f"{name}_error"] / rows.plateau.map(dict(enumerate(np.asarray(bounds)))))


def _short(chosen: str) -> str:
    return chosen.removeprefix("series of spectra: ")
