"""`details/unexplained.json`: what no effect explains, as plain data for the report to draw."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mtpipe.diagnosis.bent_scale import Beside
from mtpipe.diagnosis.left_in_distribution import LeftInDistribution
from mtpipe.diagnosis.left_in_time import LeftInTime
from mtpipe.diagnosis.smooth_correction import (
    FARTHEST,
    AxisCorrection,
    Place,
    SmoothCorrection,
)
from mtpipe.diagnosis.unexplained import CLEAR, Unexplained, ln_force_bounds, strongest
from mtpipe.recording.recording import AXES

# Bands in which recorded power is drawn.
POINTS = 36


def content_of(left: Unexplained) -> dict[str, Any]:
    """`details/unexplained.json` of one bead, as docs/run-folder.md has it."""
    correction = left.correction
    return {
        "sentence": left.sentence,
        "looks": [_statistic_dict(left, i) for i in left.contradicting],
        "shapes": [_shape_dict(left, one) for one in left.shapes],
        "nearest": None
        if left.nearest is None
        else {
            "effect": left.nearest.tried.effect.name,
            "gain_nats": float(left.nearest.tried.gain),
            "penalty_nats": float(left.nearest.tried.penalty),
            "share": left.nearest_share,
            "reason": left.nearest.reason,
        },
        "bend": None if left.bend is None else _bend_dict(left, left.bend),
        "correction": None
        if correction is None
        else {
            "gain_nats": correction.gain_nats,
            "axes": [_axis_dict(left, correction, one) for one in correction.axes],
            "panels": [_panel(left, correction, axis) for axis in range(3)],
            "forces": _forces(left, correction),
        },
    }


def _bend_dict(left: Unexplained, beside: Beside) -> dict[str, Any]:
    """Another scale of z above some height, and the forces with it."""
    bend = beside.bend
    relative, stderr = bend.relative
    return {
        "relative": relative,
        "relative_stderr": stderr,
        "from_nm": bend.from_nm,
        "plateaus": [left.number(i) for i in bend.above],
        "gain_nats": beside.gain,
        "penalty_nats": beside.penalty,
        "share": beside.share,
        "forces": [
            {
                "plateau": plateau.number,
                "magnet_mm": plateau.magnet_mm,
                "force_pN": float(bend.fit.force_pN[i]),
                "force_stderr_pN": float(bend.fit.force_stderr_pN[i]),
            }
            for i, plateau in enumerate(left.check.case.plateaus)
        ],
    }


def _statistic_dict(left: Unexplained, i: int) -> dict[str, Any]:
    statistic = left.check.statistics[i]
    values = float(left.check.observed[i]), *left.simulated(i), float(left.check.p_values[i])
    names = "value", "simulated_median", "simulated_low", "simulated_high", "p_value"
    return {
        "statistic": statistic.kind,
        "axis": statistic.axis,
        "plateaus": [left.number(k) for k in statistic.plateaus],
        "band_hz": None if statistic.band_hz is None else list(statistic.band_hz),
        "time_s": None if statistic.time_s is None else list(statistic.time_s),
        **{name: _finite(value) for name, value in zip(names, values, strict=True)},
    }


def _shape_dict(left: Unexplained, one: LeftInTime | LeftInDistribution) -> dict[str, Any]:
    """A course or a distribution: points, the curve through them, and what it does to the force."""
    force: dict[str, Any]
    if isinstance(one, LeftInTime):
        force = {
            "halves": None
            if one.halves is None
            else [{"force_pN": f, "force_stderr_pN": stderr} for f, stderr in one.halves]
        }
    else:
        factor = math.exp(one.ln_force_shift)
        force = {
            "force_factor": _finite(factor),
            "force_factor_stderr": _finite(factor * one.ln_force_stderr),
        }
    curve, shown = one.curve, (lambda values: values) if one.kind == "mean" else np.exp
    return {
        "kind": one.kind,
        "axis": AXES[one.axis],
        "plateau": left.number(one.plateau),
        "at": curve.at.tolist(),
        "value": shown(one.values).tolist(),
        "value_low": shown(one.values - one.stderr).tolist(),
        "value_high": shown(one.values + one.stderr).tolist(),
        "curve": shown(curve.mean).tolist(),
        "curve_low": shown(curve.mean - curve.stderr).tolist(),
        "curve_high": shown(curve.mean + curve.stderr).tolist(),
        "gain_nats": curve.gain_nats,
        **force,
    }


def _axis_dict(
    left: Unexplained, correction: SmoothCorrection, one: AxisCorrection
) -> dict[str, Any]:
    return {
        "axis": AXES[one.axis],
        "common": one.common,
        "places": [
            {
                "plateau": None if one.common else left.number(k),
                "band_hz": list(place.band_hz),
                "factor": math.exp(place.ln),
                "factor_stderr": math.exp(place.ln) * place.stderr,
                "rms": place.rms,
            }
            for k, place in concerned(correction, one)
        ],
    }


def _panel(left: Unexplained, correction: SmoothCorrection, axis: int) -> dict[str, Any]:
    """What is drawn of an axis: of all plateaus, or of the one where a correction is clearest.

    Recorded power over what is expected with the forces shifted, averaged over few bands.
    """
    one = next((one for one in correction.axes if one.axis == axis), None)
    number = None if one is None or one.common else strongest(correction, one)[0]
    spectra = left.spectra
    mine = (spectra.axis == axis) & ((number is None) | (spectra.plateau == number))
    edges = np.geomspace(*correction.band_hz, POINTS + 1)
    cell = np.clip(np.digitize(spectra.frequency_hz[mine], edges) - 1, 0, POINTS - 1)
    n = spectra.ordinates[mine]
    total = np.bincount(cell, n, POINTS)
    there = total > 0
    summed = [
        np.bincount(cell, n * values, POINTS)[there] / total[there]
        for values in (np.log(spectra.frequency_hz[mine]), correction.left[mine])
    ]
    panel = {
        "axis": AXES[axis],
        "plateau": None if number is None else left.number(number),
        "frequency_hz": np.exp(summed[0]).tolist(),
        "ratio": summed[1].tolist(),
        "ratio_stderr": (summed[1] / np.sqrt(total[there])).tolist(),
        "correction": None,
    }
    if one is not None:
        ln, stderr = correction.curve(one, number or 0)
        panel["correction"] = {
            "frequency_hz": correction.frequency_hz.tolist(),
            "factor": np.exp(ln).tolist(),
            "factor_low": np.exp(ln - stderr).tolist(),
            "factor_high": np.exp(ln + stderr).tolist(),
        }
    return panel


def _forces(left: Unexplained, correction: SmoothCorrection) -> list[dict[str, Any]]:
    """Forces as fitted and with the correction free, and the range that holds both."""
    lower, upper = ln_force_bounds(correction)
    fitted = left.check.case.fit.force_pN
    low, corrected, high = (
        fitted * np.exp(np.clip(ln, -FARTHEST, FARTHEST))
        for ln in (lower, correction.ln_force_shift, upper)
    )
    return [
        {
            "plateau": plateau.number,
            "magnet_mm": plateau.magnet_mm,
            "force_pN": float(fitted[i]),
            "corrected_pN": float(corrected[i]),
            "corrected_stderr_pN": float(corrected[i] * correction.ln_force_stderr[i]),
            "low_pN": float(low[i]),
            "high_pN": float(high[i]),
        }
        for i, plateau in enumerate(left.check.case.plateaus)
    ]


def concerned(correction: SmoothCorrection, one: AxisCorrection) -> list[tuple[int, Place]]:
    """Curves of an axis that are clearly not none; at least the strongest."""
    number, _ = strongest(correction, one)
    places = [(k, correction.place(one, k)) for k in range(len(one.coefficients))]
    return [
        (k, place) for k, place in places if k == number or abs(place.ln) > CLEAR * place.stderr
    ]


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
