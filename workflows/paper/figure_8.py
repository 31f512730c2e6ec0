"""Figure 8: the force up to which the error stays below 10 %, against the tether's length.

A corner frequency limits every method, so a method's limit in Hz becomes a force for every tether,
radius, viscosity and frame rate. The paper's limits (32 and 47 Hz at 120 Hz, in proportion at other
frame rates) stand beside ours, for recordings of 137 s. Nothing is simulated here.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from output import COLOURS, Part, markdown, panels, write_part
from quoted import (
    CORRECTED_LIMIT_HZ,
    CORRECTED_LIMIT_PN,
    SHORT_TETHER_LIMIT_PN,
    SHORT_TETHER_NM,
    UNCORRECTED_LIMIT_HZ,
    UNCORRECTED_LIMIT_PN,
    Beside,
)
from recovery import EXACT, rms_limit
from setting import Setting

RADII_NM = (1400.0, 500.0)
CONTOURS_NM = (600.0, SHORT_TETHER_NM, 2700.0, 7000.0, 15000.0)
DURATION_S = 16384 / 120
FAST_HZ = 200.0
# Nyquist of the camera for which the paper gives its limits.
PAPER_NYQUIST_HZ = 60.0
CAMERA_LIMITS = 0.1
RULES = {
    "arctangent-uncorrected": UNCORRECTED_LIMIT_HZ / PAPER_NYQUIST_HZ,
    "arctangent": CORRECTED_LIMIT_HZ / PAPER_NYQUIST_HZ,
}
CHANGES = {
    "as is": {},
    "viscosity × 2": {"viscosity_mPa_s": 2.0},
    f"{FAST_HZ:g} Hz": {"frame_rate_hz": FAST_HZ},
}


def part(seed: int, repeats: int) -> Part:
    """Limits in pN; seed and repeats are of no use to it."""
    del seed, repeats
    table = force_limits(CONTOURS_NM)
    rows = []
    for (radius, contour), group in table.groupby(["radius_nm", "contour_nm"], sort=False):
        cells = {(row.change, row.method): row for row in group.itertuples()}
        shown = [f"{radius / 1000:g}", f"{contour / 1000:.3g}"]
        for change in CHANGES:
            for method in RULES:
                if (change, method) in cells:
                    row = cells[change, method]
                    shown.append(f"{row.paper_pN:.3g}; {row.ours_pN:.3g}")
            shown.append(f"{cells[change, EXACT].ours_pN:.3g}")
        rows.append(shown)
    columns = ["R (µm)", "contour (µm)", "no correction", "n = ±1", "exact fit"]
    for change in list(CHANGES)[1:]:
        columns += [f"n = ±1, {change}", f"exact fit, {change}"]
    quoted = [b.row for b in quoted_forces()]
    text = f"""{markdown(columns, rows)}

Largest force in pN: by the paper's limit; by ours, a root-mean-square error of 10 % in recordings
of {DURATION_S:.0f} s. Above 40 pN Marko and Siggia's chain no longer holds, and DNA overstretches
at 65 pN. So a number above says only that neither blur nor aliasing is the limit.

{markdown(["", "paper", "ours", "deviation"], quoted)}
"""
    return Part(text, _figure(), {"limits": table})


def force_limits(contours_nm: tuple[float, ...]) -> pd.DataFrame:
    """One row per radius, contour length, change and method."""
    rows = []
    for radius in RADII_NM:
        for contour in contours_nm:
            for change, values in CHANGES.items():
                setting = Setting(radius_nm=radius, contour_length_nm=contour, **values)
                nyquist = setting.camera.nyquist_hz
                frames = round(DURATION_S * setting.frame_rate_hz)
                for method in (*RULES, EXACT):
                    if method == "arctangent-uncorrected" and values:
                        continue
                    ours = rms_limit(method, frames, above=CAMERA_LIMITS) * nyquist
                    paper = RULES[method] * nyquist if method in RULES else np.nan
                    rows.append(
                        {
                            "radius_nm": radius,
                            "contour_nm": contour,
                            "change": change,
                            "method": method,
                            "ours_hz": ours,
                            "ours_pN": setting.force_at_corner(ours),
                            "paper_hz": paper,
                            "paper_pN": (
                                setting.force_at_corner(paper) if np.isfinite(paper) else np.nan
                            ),
                        }
                    )
    return pd.DataFrame(rows)


def quoted_forces() -> list[Beside]:
    """The forces that the paper names beside those at its own corner frequencies."""
    long = Setting()
    corrected = f"{CORRECTED_LIMIT_HZ:g} Hz"
    return [
        Beside(
            f"force at {UNCORRECTED_LIMIT_HZ:g} Hz, 2.7 µm, R = 1.4 µm",
            "pN",
            UNCORRECTED_LIMIT_PN,
            long.force_at_corner(UNCORRECTED_LIMIT_HZ),
        ),
        Beside(
            f"force at {corrected}, 2.7 µm, R = 1.4 µm",
            "pN",
            CORRECTED_LIMIT_PN,
            long.force_at_corner(CORRECTED_LIMIT_HZ),
        ),
        *(
            Beside(
                f"force at {corrected}, 3.6 kb, R = {radius / 1000:g} µm",
                "pN",
                SHORT_TETHER_LIMIT_PN,
                Setting(radius_nm=radius, contour_length_nm=SHORT_TETHER_NM).force_at_corner(
                    CORRECTED_LIMIT_HZ
                ),
            )
            for radius in RADII_NM
        ),
    ]


def _figure():
    figure, axes = panels(len(RADII_NM))
    lines = force_limits(tuple(np.geomspace(300, 20000, 25)))
    styles = {"as is": "-", "viscosity × 2": "--", f"{FAST_HZ:g} Hz": ":"}
    names = {"arctangent-uncorrected": "no correction", "arctangent": "n = ±1", EXACT: EXACT}
    for axis, radius in zip(axes, RADII_NM, strict=True):
        for (method, change), group in lines[lines.radius_nm == radius].groupby(
            ["method", "change"]
        ):
            axis.plot(
                group.contour_nm / 1000,
                group.ours_pN,
                color=COLOURS[method],
                ls=styles[change],
                lw=1.2,
                label=f"{names[method]}, {change}",
            )
            if change == "as is" and method in RULES:
                axis.plot(
                    group.contour_nm / 1000,
                    group.paper_pN,
                    color=COLOURS[method],
                    lw=3,
                    alpha=0.3,
                    label=f"{names[method]}, paper's limit",
                )
        axis.axhline(65, color="#888888", lw=0.8)
        axis.set(
            xscale="log",
            yscale="log",
            ylim=(0.3, 400),
            xlabel="contour length (µm)",
            ylabel="largest force (pN)",
            title=f"R = {radius / 1000:g} µm (grey: DNA overstretches)",
        )
        axis.title.set_fontsize(9)
    axes[0].legend(frameon=False, fontsize=6, loc="lower right")
    return figure


if __name__ == "__main__":
    write_part("figure-8", part, repeats=0, unit="nothing is simulated")
