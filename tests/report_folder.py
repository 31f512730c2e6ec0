"""A made-up run folder for the tests of the report: plausible numbers from formulas and a seed.

`write_run_folder` makes three beads by default: a good one whose name is nasty, one without z, and
one that is refused; more good beads on demand. The good one has a joint fit in which x and y share
the force, but for y of plateau 2, which contradicts the others. The first of more beads has one in
which they share none, and measured friction.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.physics.tether import Chain, mean_extension_nm

NASTY = '../<b id="x">&b 1/2'
NO_Z, REFUSED = "b2", "b10"
RUN = "4f1c0b9ad2e84c5f9f0a5d3c7b6e8a90"
RADIUS_NM, RATE_HZ, CONTOUR_NM, PERSISTENCE_NM = 1400.0, 120.0, 2700.0, 50.0
KT = 4.114
STOKES = 6 * np.pi * 0.89e-9 * RADIUS_NM
FORCES_PN = np.array([0.3, 0.9, 2.6, 7.5, 11.0, 0.15, 4.0, 1.5, 5.5, 0.5])
PLATEAU_S = 60.0
LEFT_OUT = (NASTY, 2, "y")
SHARED = "series of spectra: x and y share the force, friction expected from the setup"
APART = "series of spectra: x and y apart, friction measured on this bead"
ALONE = "spectrum, friction expected from the setup"


@dataclass(frozen=True)
class Trace:
    bead: str
    plateau: int
    axis: str
    force_pN: float
    refused: bool
    measured: bool

    @property
    def method(self) -> str:
        if self.axis == "z" or (self.bead, self.plateau, self.axis) == LEFT_OUT:
            return ALONE
        return series(self.bead) or ALONE


def series(bead: str) -> str:
    return {NO_Z: "", REFUSED: "", "more0": APART}.get(bead, SHARED)


def estimate(quantity: str, unit: str, value: float, relative: float) -> dict[str, float]:
    error = abs(value) * relative
    names = (f"{quantity}{part}_{unit}" for part in ("", "_stderr", "_low", "_high"))
    return dict(zip(names, (value, error, value - error, value + error), strict=True))


def missing(quantity: str, unit: str) -> dict[str, float]:
    return estimate(quantity, unit, np.nan, np.nan)


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
        "details/spectra": pd.concat([spectrum(row, rng) for row in usable(forces)]),
        "details/traces": pd.concat([trace(b, forces, rng) for b in beads], ignore_index=True),
        "details/drift": drift(plateaus),
        "details/references": references(),
        "details/posteriors": pd.concat(
            [posterior(row, rng) for row in usable(forces) if row["status"] != "refused"]
        ),
        "crosscheck": pd.concat(
            [crosscheck(b, plateaus, rng) for b in beads if b != NO_Z], ignore_index=True
        ),
        **crosscheck_curves([b for b in beads if b != NO_Z], plateaus, rng),
        "details/force_extension": pd.DataFrame(
            [
                fit_row(b, m)
                for b in beads
                if b not in (REFUSED, NO_Z)
                for m in ("marko-siggia", "bouchiat", "extensible")
            ]
        ),
    }
    for name, table in tables.items():
        table.attrs["run"] = RUN
        table.to_parquet(folder / f"{name}.parquet")
    (folder / "run.json").write_text(json.dumps(run(forces)), encoding="utf-8")
    (folder / "mismatch.json").write_text(json.dumps(mismatch(beads[0])), encoding="utf-8")
    drawn = {"run": RUN, "recording": "made up", "beads": {beads[0]: before_after(plateaus)}}
    (folder / "details/before_after.json").write_text(json.dumps(drawn), encoding="utf-8")
    left = {"run": RUN, "recording": "made up", "beads": {REFUSED: unexplained()}}
    (folder / "details/unexplained.json").write_text(json.dumps(left), encoding="utf-8")
    return folder


def mismatch(bead: str) -> dict[str, Any]:
    effect = {
        "effect": "viscosity",
        "sentence": "x, 1–20 Hz, plateau 0: the buffer's viscosity is 1.2 mPa s; …",
        "parameters": {"viscosity_mPa_s": {"value": 1.2, "stderr": 0.02, "unit": "mPa s"}},
        "delta_bic": -80.0,
        "heldout_gain_nats": 35.0,
        "p_before": 1e-9,
        "p_after": 0.4,
        "equivalent": ["bead_radius"],
    }
    force = {
        "plateau": 0,
        "magnet_mm": 3.0,
        "force_pN": 1.02,
        "stderr_pN": 0.02,
        "force_before_pN": 0.98,
        "stderr_before_pN": 0.02,
    }
    found = {"verdict": "explained", "located": [], "effects": [effect], "forces": [force]}
    left = {"verdict": "unexplained", "located": [], "effects": [], "forces": [force]}
    beads = {bead: found, REFUSED: left}
    return {"schema": "mtpipe.mismatch/1", "run": RUN, "recording": "made up", "beads": beads}


def before_after(plateaus: int) -> dict[str, Any]:
    """A tenth too much power in two bands of every trace, which naming the cause takes away."""
    f = np.geomspace(0.05, 60, 20)
    expected = 100 / (1 + f**2)
    stages = {"before": 1.1, "after": 1.0}
    spectra = [
        {
            "axis": axis,
            "plateau": 0,
            "frequency_hz": f.tolist(),
            "ordinates": [100.0] * 20,
            **{
                stage: {"expected_nm2_per_hz": (expected / r).tolist(), "ratio": [r] * 20}
                for stage, r in stages.items()
            },
        }
        for axis in "xyz"
    ]
    residuals: dict[str, Any] = {
        stage: {axis: [[10 * (r - 1)] * plateaus] * 2 for axis in "xyz"}
        | {"height": [None] + [8 * (r - 1)] * (plateaus - 1)}
        for stage, r in stages.items()
    }
    return {
        "plateaus": list(range(plateaus)),
        "bands_hz": [0.05, 1.7, 60.0],
        "residuals": residuals,
        "spectra": spectra,
    }


def unexplained() -> dict[str, Any]:
    """A bead with 20 % too much power about 1 Hz along y, the same at all forces."""
    f = np.geomspace(0.05, 60, 30)
    factor = 1 + 0.2 * np.exp(-(np.log(f) ** 2))
    curves = {"frequency_hz": f, "factor": factor}
    curves |= {"factor_low": factor - 0.03, "factor_high": factor + 0.03}
    panels = [
        {
            "axis": axis,
            "plateau": None,
            "frequency_hz": f.tolist(),
            "ratio": (factor if axis == "y" else np.ones(30)).tolist(),
            "ratio_stderr": [0.04] * 30,
            "correction": {name: values.tolist() for name, values in curves.items()}
            if axis == "y"
            else None,
        }
        for axis in "xyz"
    ]
    place = {"plateau": None, "band_hz": [0.4, 2.5], "factor": 1.16, "factor_stderr": 0.02}
    force = {"plateau": 0, "magnet_mm": 3.0, "force_pN": 0.98, "corrected_pN": 1.04}
    return {
        "sentence": "Nothing in the catalogue explains it. Between 0.4 and 2.5 Hz along y …",
        "looks": [],
        "shapes": [shape("variance"), shape("distribution")],
        "nearest": None,
        "correction": {
            "gain_nats": 41.0,
            "axes": [{"axis": "y", "common": True, "places": [place | {"rms": 0.08}]}],
            "panels": panels,
            "forces": [force | {"corrected_stderr_pN": 0.03, "low_pN": 0.95, "high_pN": 1.07}],
        },
    }


def shape(kind: str) -> dict[str, Any]:
    """Something that doubles from one end to the other along x in plateau 1."""
    curve = np.geomspace(1, 2, 16)
    told = {"value": curve, "value_low": 0.9 * curve, "value_high": 1.1 * curve}
    told |= {"curve": curve, "curve_low": 0.95 * curve, "curve_high": 1.05 * curve}
    arrays = {name: values.tolist() for name, values in told.items()}
    return {"kind": kind, "axis": "x", "plateau": 1, "at": list(range(16)), **arrays}


def usable(forces: pd.DataFrame) -> list[dict[str, Any]]:
    rows = forces.to_dict("records")
    return [r for r in rows if r["status"] != "refused" or r["bead"] == REFUSED]


def force_row(t: Trace, rng: np.random.Generator) -> dict[str, Any]:
    alone = t.force_pN * rng.normal(1, 0.02) * (1.15 if t.method == ALONE else 1.0)
    force = alone if t.method in (ALONE, APART) else t.force_pN
    chain = Chain(CONTOUR_NM, PERSISTENCE_NM, 298.15)
    length = float(mean_extension_nm(chain, t.force_pN))
    arm = {"x": length, "y": length + RADIUS_NM, "z": CONTOUR_NM / 20}[t.axis]
    friction = STOKES * {"x": 1.3, "y": 1.35, "z": 1.9}[t.axis] * rng.normal(1, 0.02)
    stiffness, fits = force / arm, not t.refused and t.measured
    corner = stiffness / (2 * np.pi * friction)
    bound = fits and t.plateau == 0
    named = [
        ("force", "pN", force if t.axis != "z" else np.nan, 0.014),
        ("force_alone", "pN", alone if t.axis != "z" else np.nan, 0.019),
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
        "extension_stderr_nm": 6.0 / force if t.bead != NO_Z else np.nan,
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
        row |= missing("force", "pN") | missing("force_alone", "pN")
    if (t.bead, t.plateau, t.axis) == LEFT_OUT:
        row |= {"flags": "unlike_the_series"}
    if bound:
        row |= {"noise_nm": 0.2, "noise_stderr_nm": np.nan}
        row |= {"noise_low_nm": 0.0, "noise_high_nm": 1.4, "status": "at_bound"}
    if t.refused:
        row["refusal"] = "The bead moves 2 nm rms and does not respond to the force: it is stuck."
    elif not t.measured:
        row["refusal"] = "z was not recorded."
    return row


def bead_row(bead: str, forces: pd.DataFrame, plateaus: int) -> dict[str, Any]:
    mine = forces.loc[forces["bead"] == bead, "force_pN"]
    verdict = {NO_Z: "caution", REFUSED: "refused"}.get(bead, "good")
    reasons = {
        NO_Z: "z was not recorded, so there is no force | stiffness and friction are determined",
        REFUSED: "all traces refused: the bead is stuck to the surface",
    }
    row: dict[str, Any] = {
        "bead": bead,
        "verdict": verdict,
        "reasons": reasons.get(bead, ""),
        "plateaus": plateaus,
        "plateaus_used": 0 if bead == REFUSED else plateaus,
        "force_min_pN": mine.min(),
        "force_max_pN": mine.max(),
        "tether_model": "bouchiat" if verdict == "good" else "",
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
        known = verdict == "good"
        row |= estimate(quantity, unit, value, relative) if known else missing(quantity, unit)
    return row | missing("stretch_modulus", "pN")


def fit_row(bead: str, model: str) -> dict[str, Any]:
    persistence = {"marko-siggia": 47.1, "bouchiat": 49.26, "extensible": 49.4}[model]
    modulus = estimate("stretch_modulus", "pN", 1100.0, 0.2)
    modulus |= {"stretch_modulus_high_pN": 2100.0}
    if bead == "more0":  # not told from infinity: a lower limit only
        modulus |= {"stretch_modulus_pN": np.nan, "stretch_modulus_high_pN": np.inf}
    return (
        {"bead": bead, "model": model}
        | estimate("contour_length", "nm", 2703.4, 0.002)
        | estimate("persistence_length", "nm", persistence, 0.03)
        | (modulus if model == "extensible" else missing("stretch_modulus", "pN"))
        | {"force_low_pN": 0.3, "force_high_pN": 7.5, "points": 8, "chi2": 5.3, "dof": 6}
        | {"p_value": 0.51, "recommended": model == "bouchiat", "offset_nm": 0.0}
    )


def spectrum(row: dict[str, Any], rng: np.random.Generator) -> pd.DataFrame:
    edges = np.unique(np.geomspace(1, PLATEAU_S * RATE_HZ / 2, 80).astype(int))
    n = np.diff(edges)
    f = np.sqrt(edges[:-1] * edges[1:]) / PLATEAU_S
    refused = row["status"] == "refused"
    corner = 30.0 if refused else row["corner_frequency_hz"]
    friction = STOKES if refused else row["friction_pN_s_per_nm"]
    model = KT / (np.pi**2 * friction * (f**2 + corner**2)) + 0.3
    power = model * rng.gamma(n, 1 / n)
    columns = {"frequency_hz": f, "ordinates": n, "power_nm2_per_hz": power}
    table = pd.DataFrame(columns | {"model_nm2_per_hz": np.nan if refused else model})
    return table.assign(bead=row["bead"], plateau=row["plateau"], axis=row["axis"])


def crosscheck(bead: str, plateaus: int, rng: np.random.Generator) -> pd.DataFrame:
    """Looks of a consistent bead; the first more has a line at 30 Hz in y of plateau 1."""
    places = [(axis, p) for axis in "xyz" for p in (*range(plateaus), None)]
    rows = [
        {"statistic": statistic, "axis": axis, "plateau": p}
        | {"band_low_hz": low, "band_high_hz": high, "time_low_s": since, "time_high_s": until}
        for axis, p in places
        for statistic, low, high, since, until in (
            ("psd_band", 0.1, 3.0, np.nan, np.nan),
            ("psd_band", 3.0, 60.0, np.nan, np.nan),
            ("line", 29.9, 30.1, np.nan, np.nan),
            ("mean_step", np.nan, np.nan, 20.0, 60.0),
            ("skewness", np.nan, np.nan, np.nan, np.nan),
        )
    ]
    table = pd.DataFrame(rows).astype({"plateau": "Int64"})
    table["value"] = rng.normal(size=len(table))
    table["p_value"] = rng.uniform(0.01, 1, len(table))
    odd = (table["statistic"] == "line") & (table["axis"] == "y") & (table["plateau"] == 1)
    if bead == "more0":
        table.loc[odd.fillna(False), ["value", "p_value"]] = [9.5, 3e-9]
    return table.assign(
        bead=bead,
        magnet_mm=np.where(table["plateau"].isna(), np.nan, 3.0),
        simulated_median=0.0,
        simulated_low=-1.9,
        simulated_high=2.1,
        extrapolated=table["p_value"] < 0.02,
        simulations=48,
        bead_p_value=2.4e-7 if bead == "more0" else 0.43,
    )


def crosscheck_curves(
    beads: list[str], plateaus: int, rng: np.random.Generator
) -> dict[str, pd.DataFrame]:
    f = np.geomspace(0.05, 60, 40)
    x = np.linspace(-400, 400, 36)
    t = 2.0 ** np.arange(10) / RATE_HZ
    curves = {
        "spectrum": ("frequency_hz", f, "power", "nm2_per_hz", 400 / (1 + f**2)),
        "histogram": ("deviation_nm", x, "density", "per_nm", np.exp(-((x / 100) ** 2) / 2) / 250),
        "allan": ("averaged_s", t, "variance", "nm2", 9e3 * t / (t**2 + 0.1)),
    }
    return {
        f"details/crosscheck_{kind}": pd.concat(
            [
                pd.DataFrame(
                    {
                        over: at,
                        f"{quantity}_{unit}": expected * rng.normal(1, 0.05, len(at)),
                        f"simulated_{unit}": expected,
                        f"simulated_low_{unit}": expected * 0.9,
                        f"simulated_high_{unit}": expected * 1.1,
                    }
                ).assign(bead=bead, plateau=plateau, axis=axis)
                for bead in beads
                for plateau in range(plateaus)
                for axis in "xyz"
            ],
            ignore_index=True,
        )
        for kind, (over, at, quantity, unit, expected) in curves.items()
    }


def posterior(row: dict[str, Any], rng: np.random.Generator) -> pd.DataFrame:
    shift, other = rng.standard_normal((2, 1000))
    table = pd.DataFrame(
        {
            "force_pN": row["force_pN"] * (1 + 0.014 * shift),
            "stiffness_pN_per_nm": row["stiffness_pN_per_nm"] * (1 + 0.013 * shift),
            "friction_pN_s_per_nm": row["friction_pN_s_per_nm"]
            * (1 + 0.021 * (0.6 * shift + 0.8 * other)),
            "noise_nm": 4.2 + 0.3 * other,
        }
    )
    return table.assign(bead=row["bead"], plateau=row["plateau"], axis=row["axis"])


def moved_nm(t: np.ndarray, axis: str) -> np.ndarray:
    speed, wave = {"x": (0.9, 12.0), "y": (-0.5, 20.0), "z": (0.25, 8.0)}[axis]
    return speed * t + wave * np.sin(t / 40)


def trace(bead: str, forces: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    mine = forces[forces["bead"] == bead]
    t = np.linspace(0, mine["start_s"].max() + PLATEAU_S, 2000)
    tables = []
    for axis in "xyz":
        rows = mine[mine["axis"] == axis].sort_values("start_s")
        which = np.clip(np.searchsorted(rows["start_s"], t) - 1, 0, len(rows) - 1)
        stiffness = rows["stiffness_pN_per_nm"].fillna(1.0).to_numpy()[which]
        height = rows["extension_nm"].fillna(0).to_numpy()[which] if axis == "z" else 0.0
        spread = np.sqrt(KT / stiffness)
        mean = height + spread * rng.normal(0, 0.6, len(t))
        low, high = mean - spread * rng.uniform(0.8, 2, len(t)), mean + spread * 1.4
        seen = (t < 100) | (t > 106)
        if bead == NO_Z and axis == "z":
            continue
        for stage, added in (("raw", moved_nm(t, axis)), ("subtracted", 0.0)):
            table = pd.DataFrame(
                {
                    "time_s": t,
                    "low_nm": low + added,
                    "mean_nm": mean + added,
                    "high_nm": high + added,
                }
            )
            tables.append(table[seen].assign(bead=bead, axis=axis, stage=stage))
    return pd.concat(tables)


def drift(plateaus: int) -> pd.DataFrame:
    t = np.linspace(0, 5 + plateaus * (PLATEAU_S + 5), 2000)
    return pd.concat(
        pd.DataFrame({"time_s": t, "axis": axis, "drift_nm": moved_nm(t, axis)}) for axis in "xyz"
    )


def references() -> pd.DataFrame:
    row = {"used": True, "reason": "", "weight_x": 1.0, "weight_y": 1.0, "weight_z": 1.0}
    noise = {"noise_x_nm": 2.1, "noise_y_nm": 2.3, "noise_z_nm": 5.2}
    left_out = {"used": False, "reason": "jumps by 48 nm at 103 s"}
    left_out |= {f"weight_{axis}": 0.0 for axis in "xyz"}
    return pd.DataFrame([{"bead": "ref1"} | row | noise, {"bead": "ref2"} | row | noise | left_out])


def run(forces: pd.DataFrame) -> dict[str, Any]:
    notices: list[dict[str, Any]] = [
        notice("reference_jumps", "caution", "Reference bead ref2 jumps by 48 nm and is left out."),
        notice("time_is_rounded", "info", "Times are rounded; frames were put on the 120 Hz grid."),
        notice("no_extension", "warning", "z was not recorded: there is no force.", NO_Z),
        notice("not_crosschecked", "info", "It was not cross-checked: z is missing.", NO_Z),
    ]
    for row in forces[forces["flags"] != ""].to_dict("records"):
        where = row["bead"], row["plateau"], row["axis"]
        if (*where,) == LEFT_OUT:
            text = "This trace contradicts the bead's others and was fitted by itself."
            notices.append(notice("unlike_the_series", "caution", text, *where))
            continue
        notices += [
            notice(
                "near_nyquist", "caution", "The corner is 0.7 of the Nyquist frequency.", *where
            ),
            notice("lost_frames", "info", "31 of 7200 frames are lost (0.4 %).", *where),
        ]
    return {
        "run": RUN,
        "version": "0.1.0",
        "recording": "run <2> & more.csv",
        "setup": setup(),
        "conditions": {"temperature_K": 298.15},
        "inputs": [{"name": "run 2.csv", "bytes": 1234567, "sha256": "0f" * 32}],
        "drift": {
            "method": "reference",
            "cutoff_hz": [0.61, 0.58, None],
            "drift_rms_nm": [104.0, 61.0, 30.2],
            "noise_added_nm": [0.21, 0.23, 5.2],
        },
        "notices": notices,
        "seed": 20261121,
        "started": "2026-11-21T07:49:00+00:00",
        "seconds": {"read": 1.2, "drift": 0.4, "fit": 31.0},
    }


def notice(code: str, severity: str, message: str, *where: Any) -> dict[str, Any]:
    bead, plateau, axis = (*where, None, None, None)[:3]
    place = {"bead": bead, "plateau": plateau, "axis": axis}
    return {"code": code, "severity": severity, "message": message} | place


def setup() -> dict[str, Any]:
    return {
        "schema": 1,
        "camera": {"frame_rate_hz": RATE_HZ, "exposure_s": 0.008},
        "beads": {"radius_nm": RADIUS_NM, "radius_nm_stderr": 30.0, "reference": ["ref1", "ref2"]},
        "tether": {"contour_length_nm": "unknown", "persistence_length_nm": PERSISTENCE_NM},
        "buffer": {"temperature_K": 298.15, "viscosity_mPa_s": 0.89},
        "field": {"direction": "x"},
        "model": {"effects": ["wall_drag", "tracking_noise"]},
    }
