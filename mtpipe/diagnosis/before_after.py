"""`details/before_after.json`: spectra and residuals without and with what is named, as drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.diagnosis.explanation import Explanation
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import AXES

# Points of a drawn spectrum, the fewest ordinates of each, and the bands of a column of the map.
POINTS, FEWEST_ORDINATES, BANDS = 36, 8, 10


@dataclass(frozen=True, eq=False)
class Averaged:
    """A trace's spectrum in a few bands; bands without a bin are NaN.

    Attributes
    ----------
    frequency_hz, ordinates : (bands,). expected_nm2_per_hz : (bands,) of the fit, with the camera
        and without prewhitening. ratio : (bands,) recorded power over it.
    """

    frequency_hz: FloatArray
    ordinates: FloatArray
    expected_nm2_per_hz: FloatArray
    ratio: FloatArray

    @property
    def residual(self) -> FloatArray:
        """(bands,) how far the recorded power is above what is expected, in standard errors.

        The signed root of the deviance of a gamma variate (McCullagh & Nelder 1989, sections 2.4
        and 8.3), which is nearly normal also where ordinates are few.
        """
        deviance = 2 * self.ordinates * (self.ratio - 1 - np.log(self.ratio))
        return np.asarray(np.sign(self.ratio - 1) * np.sqrt(np.maximum(deviance, 0.0)))


def content_of(found: Explanation) -> dict[str, Any] | None:
    """`details/before_after.json` of one bead, as docs/run-folder.md has it; None where nothing is
    named.
    """
    if not found.named:
        return None
    stages = {"before": found.before.case, "after": found.after.case}
    numbers = [plateau.number for plateau in found.before.case.plateaus]
    edges = _edges_hz(found.before.case)
    return {
        "plateaus": numbers,
        "bands_hz": edges.tolist(),
        "residuals": {stage: _residuals(case, edges) for stage, case in stages.items()},
        "spectra": [_spectrum(stages, axis, numbers) for axis in range(3)],
    }


def averaged(case: PreparedBead, plateau: int, axis: int, edges_hz: FloatArray) -> Averaged:
    """The spectrum of a trace, by indices of plateau and axis, in bands between (bands + 1) edges.

    Means over ordinates; of the frequency in its logarithm.
    """
    spectrum = case.fit.model.data[plateau].spectrum
    whitened = case.fit.expected[plateau].power[:, axis, axis]
    bands = len(edges_hz) - 1
    band = np.clip(np.digitize(spectrum.frequency_hz, edges_hz) - 1, 0, bands - 1)
    total = np.bincount(band, spectrum.ordinates, bands)
    weight = np.where(total > 0, total, np.nan)
    log_frequency, expected, ratio = (
        np.bincount(band, spectrum.ordinates * values, bands) / weight
        for values in (
            np.log(spectrum.frequency_hz),
            whitened / spectrum.gain(axis),
            spectrum.power[:, axis, axis] / whitened,
        )
    )
    return Averaged(np.exp(log_frequency), weight, expected, ratio)


def _edges_hz(case: PreparedBead) -> FloatArray:
    """(BANDS + 1,) evenly in ln f, over all that is recorded."""
    frequencies = [data.spectrum.frequency_hz for data in case.fit.model.data]
    low, high = min(f[0] for f in frequencies), max(f[-1] for f in frequencies)
    return np.geomspace(low, high, BANDS + 1)


def _edges_of(case: PreparedBead, plateau: int) -> FloatArray:
    """Edges of the bands in which a plateau's spectrum is drawn, wider where ordinates are few."""
    spectrum = case.fit.model.data[plateau].spectrum
    frequency = spectrum.frequency_hz
    below = np.concatenate([[0.0], np.cumsum(spectrum.ordinates)])
    edges = [float(frequency[0])]
    begun = 0.0
    for edge in np.geomspace(frequency[0], frequency[-1], POINTS + 1)[1:-1].tolist():
        here = float(below[np.searchsorted(frequency, edge)])
        if min(here - begun, below[-1] - here) >= FEWEST_ORDINATES:
            edges.append(edge)
            begun = here
    return np.array([*edges, frequency[-1]])


def _residuals(case: PreparedBead, edges_hz: FloatArray) -> dict[str, Any]:
    """Per axis a row for each band, a column for each plateau, and a row of mean heights."""
    rows: dict[str, Any] = {}
    for axis, name in enumerate(AXES):
        columns = [
            averaged(case, k, axis, edges_hz).residual for k in range(case.fit.model.plateaus)
        ]
        rows[name] = [_listed(row) for row in np.transpose(columns)]
    return rows | {"height": _listed(case.fit.height_pulls)}


def _spectrum(stages: dict[str, PreparedBead], axis: int, numbers: list[int]) -> dict[str, Any]:
    """Of an axis, in the plateau where what is named changes most."""
    before, after = stages.values()
    mended = [_misfit(before, k, axis) - _misfit(after, k, axis) for k in range(len(numbers))]
    clearest = int(np.argmax(mended))
    edges = _edges_of(before, clearest)
    shown = {stage: averaged(case, clearest, axis, edges) for stage, case in stages.items()}
    return {
        "axis": AXES[axis],
        "plateau": numbers[clearest],
        "frequency_hz": shown["before"].frequency_hz.tolist(),
        "ordinates": shown["before"].ordinates.tolist(),
        **{
            stage: {
                "expected_nm2_per_hz": one.expected_nm2_per_hz.tolist(),
                "ratio": one.ratio.tolist(),
            }
            for stage, one in shown.items()
        },
    }


def _misfit(case: PreparedBead, plateau: int, axis: int) -> float:
    """Of a trace's spectrum, −ln likelihood but for what the data alone say (Whittle 1953)."""
    spectrum = case.fit.model.data[plateau].spectrum
    ratio = spectrum.power[:, axis, axis] / case.fit.expected[plateau].power[:, axis, axis]
    return float(np.sum(spectrum.ordinates * (ratio - 1 - np.log(ratio))))


def _listed(values: FloatArray) -> list[float | None]:
    """As JSON has it: null where there is no number."""
    return [value if math.isfinite(value) else None for value in values.tolist()]
