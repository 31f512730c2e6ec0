"""The made-up run folder's JSON files: what was found, what is drawn of it, and the run itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from tests.report_beads import (
    LEFT_OUT,
    MISMATCH,
    NO_Z,
    PERSISTENCE_NM,
    RADIUS_NM,
    RATE_HZ,
    RUN,
    UNEXPLAINED,
)


def mismatch(beads: list[str]) -> dict[str, Any]:
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
        "force_before_pN": 1.0,
        "stderr_before_pN": 0.02,
    }
    line = {
        "axis": "y",
        "plateaus": [1],
        "band_hz": [29.9, 30.1],
        "time_s": None,
        "statistic": "line",
        "p_value": 3e-9,
    }
    made: dict[str, Any] = {}
    for bead in beads:
        verdict = MISMATCH.get(bead, "consistent")
        if verdict:
            made[bead] = {
                "verdict": verdict,
                "located": [line] if verdict == "unexplained" else [],
                "effects": [effect] if verdict == "explained" else [],
                "terms": [],
                "forces": [force],
                "force_bound_percent": 1.1,
                "material": bead == UNEXPLAINED,
            }
    return {"schema": "mtpipe.mismatch/1", "run": RUN, "recording": "made up", "beads": made}


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
            text = "This trace contradicts the bead's other traces and was fitted separately."
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
