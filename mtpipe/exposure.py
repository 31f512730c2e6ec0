"""Estimating an exposure that the laboratory does not know, from the traces themselves.

On one trace a shorter exposure and white tracking noise predict exactly the same data (PHYSICS
3.A). Only a bead that shows its tracking noise without moving splits the two, so the estimate needs
a reference bead and takes the tethered beads' noise to be the reference's. Without one a whole
frame is assumed: fitted noise then stands in for a shorter exposure, which below half the Nyquist
frequency moves forces by a few percent at most.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mtpipe.conditions import Conditions
from mtpipe.errors import FitError
from mtpipe.fit.model import TraceModel
from mtpipe.fit.trace import fit_model
from mtpipe.notice import Notice
from mtpipe.spectrum import Spectrum, periodogram
from mtpipe.traces import Trace

SHARES_OF_A_FRAME = np.linspace(0.05, 1.0, 20)
# Slow traces are not blurred and say nothing of the exposure.
SLOWEST_CORNER_OVER_NYQUIST = 0.05
MOST_TRACES = 24


def estimate_exposure(
    beads: Mapping[str, Sequence[Trace]], conditions: Conditions, noise: tuple[float, float] | None
) -> tuple[float, Notice]:
    """Exposure in s that all lateral traces together find most likely.

    Parameters
    ----------
    beads : their traces. conditions : all but the exposure.
    noise : tracking noise of the reference beads in x and y, nm; None without reference beads.

    Returns
    -------
    The exposure, and a notice with its 68 % interval and what was assumed.
    """
    frame_s = 1 / conditions.frame_rate_hz
    models = [] if noise is None else _informative(beads, conditions, noise)
    if noise is None or not models:
        reason = (
            "without a reference bead it cannot be told from tracking noise"
            if noise is None
            else "no trace moves fast enough to tell it"
        )
        return frame_s, Notice(
            "exposure_assumed",
            "caution",
            f"The exposure is unknown, and {reason}; a whole frame ({frame_s * 1e3:.3g} ms) was "
            "assumed. Read the camera's register: forces near the Nyquist frequency depend on it.",
        )
    deviance = np.array(
        [
            sum(fit_model(replace(m, exposure_s=share * frame_s)).deviance for m in models)
            for share in SHARES_OF_A_FRAME
        ]
    )
    deviance -= deviance.min()
    best = float(SHARES_OF_A_FRAME[np.argmin(deviance)])
    within = SHARES_OF_A_FRAME[deviance <= 1.0]
    step = float(SHARES_OF_A_FRAME[1] - SHARES_OF_A_FRAME[0])
    low, high = max(float(within[0]) - step / 2, 0.0), min(float(within[-1]) + step / 2, 1.0)
    return best * frame_s, Notice(
        "exposure_estimated",
        "caution",
        f"The exposure is unknown; from the blur of {len(models)} traces it is {best:.2f} of a "
        f"frame (68 % interval {low:.2f} to {high:.2f}), taking a tracking noise of "
        f"{noise[0]:.2g} nm in x and {noise[1]:.2g} nm in y as the reference beads show it. A "
        "shorter exposure and more noise look the same on these traces; read the camera's register "
        "to be sure.",
    )


def _informative(
    beads: Mapping[str, Sequence[Trace]], conditions: Conditions, noise: tuple[float, float]
) -> list[TraceModel]:
    frame_s = 1 / conditions.frame_rate_hz
    found: list[tuple[float, TraceModel]] = []
    for traces in beads.values():
        for trace in traces:
            for axis in (0, 1):
                spectrum = _spectrum(trace, axis, frame_s)
                if spectrum is None or not 2 * noise[axis] ** 2 < spectrum.variance_nm2:
                    continue
                model = TraceModel(
                    spectrum,
                    frame_s,
                    conditions.thermal_energy_pN_nm,
                    noise_variance_nm2=noise[axis] ** 2,
                )
                ratio = fit_model(model).nyquist_ratio
                # beyond Nyquist stiffness, friction and exposure cannot be told apart
                if SLOWEST_CORNER_OVER_NYQUIST < ratio < 1:
                    found.append((ratio, model))
    found.sort(key=lambda pair: -pair[0])
    return [model for _, model in found[:MOST_TRACES]]


def _spectrum(trace: Trace, axis: int, frame_s: float) -> Spectrum | None:
    try:
        return periodogram(trace.position_nm[:, axis], frame_s)
    except FitError:
        return None
