"""A made-up run folder for the tests of the report: plausible numbers from formulas and a seed.

`write_run_folder` makes three beads by default: a good one whose name is nasty, one without z, and
one that is refused; more good beads on demand. The good one has a joint fit in which x and y share
the force, but for y of plateau 2, which contradicts the others; a cause is named that hardly
changes its forces. The first of more beads is unexplained, with a fit in which x and y share no
force, and measured friction.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.physics.tether import Chain, mean_extension_nm
from tests import report_details, report_json
from tests.report_beads import (
    ALONE,
    CHANGE,
    CONTOUR_NM,
    FORCES_PN,
    LEFT_OUT,
    MISMATCH,
    NASTY,
    NO_Z,
    PERSISTENCE_NM,
    PLATEAU_S,
    RADIUS_NM,
    RATE_HZ,
    REFUSED,
    RUN,
    STOKES,
    UNEXPLAINED,
    Trace,
    estimate,
    missing,
    series,
)


def write_run_folder(folder: Path, *, good: int = 0, plateaus: int = 4) -> Path:
    rng = np.random.default_rng(7)
    beads = [NASTY, NO_Z, REFUSED, *(f"more{i}" for i in range(good))]
    forces_pN = FORCES_PN[:plateaus] * rng.normal(1, 0.02, (len(beads), plateaus))
    traces = [
        Trace(bead, p, axis, float(force), bead == REFUSED, not (bead == NO_Z and axis == "z"))
        for bead, of_bead in zip(beads, forces_pN, strict=True)
        for p, force in enumerate(of_bead)
        for axis in "xyz"
    ]
    (folder / "details").mkdir(parents=True)
    forces = pd.DataFrame([force_row(t, rng) for t in traces])
    tables = {
        "forces": forces,
        "beads": pd.DataFrame([bead_row(bead, forces, plateaus) for bead in beads]),
        "details/spectra": pd.concat([report_details.spectrum(row, rng) for row in usable(forces)]),
        "details/traces": pd.concat(
            [report_details.trace(b, forces, rng) for b in beads], ignore_index=True
        ),
        "details/drift": report_details.drift(plateaus),
        "details/references": report_details.references(),
        "details/posteriors": pd.concat(
            [
                report_details.posterior(row, rng)
                for row in usable(forces)
                if row["status"] != "refused"
            ]
        ),
        "crosscheck": pd.concat(
            [report_details.crosscheck(b, plateaus, rng) for b in beads if b != NO_Z],
            ignore_index=True,
        ),
        **report_details.crosscheck_curves([b for b in beads if b != NO_Z], plateaus, rng),
        "details/curve_points": forces[
            (forces["axis"] == "x") & forces["force_pN"].notna() & forces["extension_nm"].notna()
        ].assign(lever_nm=np.nan, zero_stderr_nm=0.0)[
            [
                *("bead", "plateau", "force_pN", "force_stderr_pN", "extension_nm"),
                *("extension_stderr_nm", "lever_nm", "zero_stderr_nm"),
            ]
        ],
        "details/curve_stage": pd.DataFrame(
            {"bead": pd.Series(dtype="str"), "plateau": pd.Series(dtype="int64")}
            | {"other_plateau": pd.Series(dtype="int64")}
            | {"covariance_nm2": pd.Series(dtype="float64")}
        ),
        "details/force_extension": pd.DataFrame(
            [
                report_details.fit_row(b, m)
                for b in beads
                if b not in (REFUSED, NO_Z)
                for m in ("marko-siggia", "bouchiat", "extensible")
            ]
        ),
    }
    for name, table in tables.items():
        table.attrs["run"] = RUN
        table.to_parquet(folder / f"{name}.parquet")
        if "/" not in name:
            table.to_csv(folder / f"{name}.csv", index=False)
    (folder / "run.json").write_text(json.dumps(report_json.run(forces)), encoding="utf-8")
    (folder / "mismatch.json").write_text(json.dumps(report_json.mismatch(beads)), encoding="utf-8")
    drawn = {
        "run": RUN,
        "recording": "made up",
        "beads": {beads[0]: report_json.before_after(plateaus)},
    }
    (folder / "details/before_after.json").write_text(json.dumps(drawn), encoding="utf-8")
    left = {"run": RUN, "recording": "made up", "beads": {REFUSED: report_json.unexplained()}}
    (folder / "details/unexplained.json").write_text(json.dumps(left), encoding="utf-8")
    return folder


def usable(forces: pd.DataFrame) -> list[dict[str, Any]]:
    rows = forces.to_dict("records")
    return [r for r in rows if r["status"] != "refused" or r["bead"] == REFUSED]


def force_row(t: Trace, rng: np.random.Generator) -> dict[str, Any]:
    alone = t.force_pN * rng.normal(1, 0.02) * (1.15 if t.method == ALONE else 1.0)
    chain = Chain(CONTOUR_NM, PERSISTENCE_NM, 298.15)
    length = float(mean_extension_nm(chain, t.force_pN))
    arm = {"x": length, "y": length + RADIUS_NM, "z": CONTOUR_NM / 20}[t.axis]
    friction = STOKES * {"x": 1.3, "y": 1.35, "z": 1.9}[t.axis] * rng.normal(1, 0.02)
    stiffness, fits = t.force_pN / arm, not t.refused and t.measured
    corner = stiffness / (2 * np.pi * friction)
    bound = fits and t.plateau == 0
    named = [
        ("force_axis", "pN", alone if t.axis != "z" else np.nan, 0.019),
        ("stiffness", "pN_per_nm", stiffness, 0.013),
        ("friction", "pN_s_per_nm", friction, 0.021),
        ("corner_frequency", "hz", corner, 0.024),
        ("effective_radius", "nm", RADIUS_NM * rng.normal(1.02, 0.02), 0.03),
        ("noise", "nm", 4.2, 0.08),
    ]
    row: dict[str, Any] = {
        "bead": t.bead,
        "plateau": t.plateau,
        "axis": t.axis,
        "magnet_mm": 6.0 - 0.45 * np.log(FORCES_PN[t.plateau] / 0.1),
        "start_s": 5.0 + t.plateau * (PLATEAU_S + 5),
        "duration_s": PLATEAU_S,
        "frames": int(PLATEAU_S * RATE_HZ),
        "lost_frames": 31 if t.plateau == 2 else 0,
        "extension_nm": length if t.bead != NO_Z else np.nan,
        "extension_stderr_nm": 6.0 / t.force_pN if t.bead != NO_Z else np.nan,
        "status": "ok" if fits else "refused",
        "tied_to": "",
        "method": t.method if fits else "none",
        "fit_deviance": float(rng.chisquare(60)) if fits else np.nan,
        "fit_dof": 60.0 if fits else np.nan,
        "fit_p_value": 0.42 if fits else np.nan,
        "posterior_rhat": 1.004 if fits else np.nan,
        "posterior_ess": 1400.0 if fits else np.nan,
        "posterior_converged": (t.plateau != 3) if fits else None,
        "nyquist_ratio": corner / (RATE_HZ / 2) if fits else np.nan,
        "flags": "near_nyquist;lost_frames" if fits and t.plateau == 2 and t.axis == "x" else "",
        "refusal": "",
    }
    for quantity, unit, value, relative in named:
        row |= estimate(quantity, unit, value, relative) if fits else missing(quantity, unit)
    if t.bead == NO_Z:
        row |= missing("force_axis", "pN")
    if (t.bead, t.plateau, t.axis) == LEFT_OUT:
        row |= {"flags": "unlike_the_series"}
    row |= quoted(t)
    if bound:
        row |= {"noise_nm": 0.2, "noise_stderr_nm": np.nan}
        row |= {"noise_low_nm": 0.0, "noise_high_nm": 1.4, "status": "at_bound"}
    if t.refused:
        row["refusal"] = "The bead moves 2 nm rms and does not respond to the force: it is stuck."
    elif not t.measured:
        row["refusal"] = "z was not recorded."
    return row


def quoted(t: Trace) -> dict[str, Any]:
    """The force to quote, the same for all axes, and those by other ways to the same plateau."""
    known = t.bead not in (NO_Z, REFUSED)
    named = {NASTY: "named", UNEXPLAINED: "spectra_alone"}
    force = t.force_pN if known else np.nan
    configured = force * {NASTY: 1 / CHANGE, UNEXPLAINED: 0.8}.get(t.bead, 1.0)
    return estimate("force", "pN", force, 0.014) | {
        "force_status": "ok" if known else "refused",
        "force_source": named.get(t.bead, "heights") if known else "none",
        "force_configured_pN": configured,
        "force_configured_stderr_pN": 0.01 * configured,
        "force_named_pN": force if t.bead == NASTY else np.nan,
        "force_named_stderr_pN": 0.01 * force if t.bead == NASTY else np.nan,
    }


def bead_row(bead: str, forces: pd.DataFrame, plateaus: int) -> dict[str, Any]:
    mine = forces.loc[forces["bead"] == bead, "force_pN"]
    verdict = {NO_Z: "caution", REFUSED: "refused", UNEXPLAINED: "caution"}.get(bead, "good")
    differs = "it differs from its simulation (p = 2e-07), and the cause is not known"
    reasons = {
        NASTY: "it differs from the setup by viscosity; the forces to quote include this",
        NO_Z: "z was not recorded, so there is no force | stiffness and friction are determined",
        REFUSED: f"{differs} | all traces refused: the bead is stuck to the surface",
        UNEXPLAINED: f"{differs} | its friction is 1.37 ± 0.06 times that expected",
    }
    row: dict[str, Any] = {
        "bead": bead,
        "verdict": verdict,
        "reasons": reasons.get(bead, ""),
        "mismatch": MISMATCH.get(bead, "consistent"),
        "force_bound_percent": {NO_Z: np.nan, UNEXPLAINED: 14.2}.get(bead, 0.0),
        "material": bead == UNEXPLAINED,
        "plateaus": plateaus,
        "plateaus_used": 0 if bead == REFUSED else plateaus,
        "force_min_pN": mine.min(),
        "force_max_pN": mine.max(),
        "tether_model": "bouchiat" if bead not in (NO_Z, REFUSED) else "",
        "series": series(bead),
        "friction_ratio": np.nan if bead == REFUSED else 1.012,
        "friction_ratio_stderr": np.nan if bead == REFUSED else 0.0137,
    }
    tracked = bead == NASTY  # the others are as if from elsewhere
    for axis, floor, explained in (("x", 1.21, 1.0), ("y", 1.34, 1.1), ("z", np.nan, 3.2)):
        told = bead != REFUSED
        row |= estimate(f"noise_floor_{axis}", "nm", floor if told else np.nan, 0.06)
        row |= {f"image_precision_{axis}_nm": explained if tracked else np.nan}
    for quantity, unit, value, relative in (
        ("contour_length", "nm", 2703.4, 0.002),
        ("persistence_length", "nm", 49.26, 0.031),
        ("radius", "nm", 1391.0, 0.012),
    ):
        known = bead not in (NO_Z, REFUSED)
        row |= estimate(quantity, unit, value, relative) if known else missing(quantity, unit)
    return row | missing("stretch_modulus", "pN")
