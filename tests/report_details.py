"""Tables of the made-up run folder's `details` and of its cross-check."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from tests.report_beads import KT, NO_Z, PLATEAU_S, RATE_HZ, STOKES, UNEXPLAINED, estimate, missing


def fit_row(bead: str, model: str) -> dict[str, Any]:
    persistence = {"marko-siggia": 47.1, "bouchiat": 49.26, "extensible": 49.4}[model]
    modulus = estimate("stretch_modulus", "pN", 1100.0, 0.2)
    modulus |= {"stretch_modulus_high_pN": 2100.0}
    if bead == UNEXPLAINED:  # not told from infinity: a lower limit only
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
    if bead == UNEXPLAINED:
        table.loc[odd.fillna(False), ["value", "p_value"]] = [9.5, 3e-9]
    return table.assign(
        bead=bead,
        magnet_mm=np.where(table["plateau"].isna(), np.nan, 3.0),
        simulated_median=0.0,
        simulated_low=-1.9,
        simulated_high=2.1,
        extrapolated=table["p_value"] < 0.02,
        simulations=48,
        bead_p_value=2.4e-7 if bead == UNEXPLAINED else 0.43,
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
            "force_pN": row["force_axis_pN"] * (1 + 0.014 * shift),
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
