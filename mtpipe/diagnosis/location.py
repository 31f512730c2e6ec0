"""Where recording and simulation differ."""

from __future__ import annotations

from typing import Any

import numpy as np

from mtpipe.crosschecking.battery.statistic import Statistic
from mtpipe.crosschecking.check import BeadCheck
from mtpipe.diagnosis.bent_scale import Beside
from mtpipe.recording.recording import AXES

MOST_PLACES = 8
PLACE_P = 1e-3
# p-values are not told below this.
LEAST_P = 1e-300


def located(check: BeadCheck) -> list[dict[str, Any]]:
    """The most significant places, one per statistic and axis, best first.

    What concerns two axes together, or all, is listed for each of them.
    """
    places: list[dict[str, Any]] = []
    seen: set[tuple[str, str]] = set()
    for i in np.argsort(check.p_values):
        statistic, p = check.statistics[int(i)], float(check.p_values[int(i)])
        if len(places) >= MOST_PLACES or (p > PLACE_P and places):
            break
        if (statistic.kind, statistic.axis) in seen:
            continue
        seen.add((statistic.kind, statistic.axis))
        places += [
            {
                "axis": axis,
                "plateaus": [check.case.plateaus[k].number for k in concerned(check, statistic)],
                "band_hz": None if statistic.band_hz is None else list(statistic.band_hz),
                "time_s": None if statistic.time_s is None else list(statistic.time_s),
                "statistic": statistic.kind,
                "p_value": p,
            }
            for axis in statistic.axis or AXES
        ]
    return places[:MOST_PLACES]


def bent_heights(check: BeadCheck, beside: Beside) -> dict[str, Any]:
    """The plateaus above a bend of z's scale, as one place."""
    return {
        "axis": "z",
        "plateaus": [check.case.plateaus[i].number for i in beside.bend.above],
        "band_hz": None,
        "time_s": None,
        "statistic": "extension",
        "p_value": max(beside.p_value, LEAST_P),
    }


def concerned(check: BeadCheck, statistic: Statistic) -> tuple[int, ...]:
    """Plateaus of a statistic; of a pooled one those that show it by themselves, or all."""
    if not statistic.pooled:
        return statistic.plateaus
    alone = {
        other.plateaus[0]
        for other, p in zip(check.statistics, check.p_values, strict=True)
        if not other.pooled
        and other.kind == statistic.kind
        and other.axis == statistic.axis
        and (statistic.band_hz is None or other.band_hz == statistic.band_hz)
        and p < 0.01
    }
    return tuple(sorted(alone)) or statistic.plateaus
