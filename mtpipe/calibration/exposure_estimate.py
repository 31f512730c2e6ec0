"""Estimating an exposure that the laboratory does not know, from the traces themselves.

On one trace a shorter exposure and white tracking noise predict exactly the same data (PHYSICS
3.A). Only a bead that shows its tracking noise without moving splits the two, so the estimate needs
a reference bead and takes the tethered beads' noise to be the reference's. Without one a whole
frame is assumed: fitted noise then stands in for a shorter exposure, which below half the Nyquist
frequency moves forces by a few percent at most.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mtpipe.fit.model import TraceModel
from mtpipe.fit.trace import fit_model
from mtpipe.ground.errors import FitError
from mtpipe.ground.notice import Notice
from mtpipe.ground.types import FloatArray
from mtpipe.physics.modes import Modes
from mtpipe.recording.traces import Trace
from mtpipe.setup.conditions import Conditions
from mtpipe.spectra.spectrum import periodogram

SHARES_OF_A_FRAME = np.linspace(0.05, 1.0, 39)
# Slow traces are not blurred and say nothing of the exposure; beyond Nyquist stiffness, friction
# and exposure cannot be told apart.
CORNER_OVER_NYQUIST = (0.05, 1.0)
# Below a tenth of the corner frequency lies drift, and nothing about the camera.
LOWEST_OVER_CORNER = 0.1
MOST_TRACES_OF_A_BEAD = 8
P_POOR = 1e-3


def estimate_exposure(
    beads: Mapping[str, Sequence[Trace]], conditions: Conditions, noise: tuple[float, float] | None
) -> tuple[float, float, Notice]:
    """Exposure in s that the lateral traces of all beads find most likely.

    Parameters
    ----------
    beads : their traces. conditions : all but the exposure.
    noise : tracking noise of the reference beads in x and y, nm; None without reference beads.

    Returns
    -------
    The exposure, the median of what the beads say, its standard error (from the likelihood of all,
    or from the scatter between beads where that is more; 0 where it had to be assumed), and a
    notice.
    """
    frame_s = 1 / conditions.frame_rate_hz
    profiles = [] if noise is None else _profiles(beads, conditions, noise)
    if noise is None or not profiles:
        reason = (
            "without a reference bead it cannot be told from tracking noise"
            if noise is None
            else "no bead moves fast enough for blur to show it"
        )
        assumed = Notice(
            "exposure_assumed",
            "caution",
            f"The exposure is unknown, and {reason}; a whole frame ({frame_s * 1e3:.3g} ms) was "
            "assumed. Read the camera's register: forces near the Nyquist frequency depend on it.",
        )
        return frame_s, 0.0, assumed
    found = np.array([SHARES_OF_A_FRAME[np.argmin(profile)] for profile in profiles])
    best = float(np.median(found))
    total = np.sum(profiles, axis=0)
    within = SHARES_OF_A_FRAME[total <= total.min() + 1.0]
    step = float(SHARES_OF_A_FRAME[1] - SHARES_OF_A_FRAME[0])
    half = max(float(np.ptp(within)) / 2 + step / 2, float(np.std(found)))
    low, high = max(best - half, 0.0), min(best + half, 1.0)
    estimated = Notice(
        "exposure_estimated",
        "caution",
        f"The exposure is unknown; from the blur of {len(profiles)} bead"
        f"{'s' if len(profiles) > 1 else ''} it is {best:.2f} of a frame (68 % interval {low:.2f} "
        f"to {high:.2f}), taking a tracking noise of {noise[0]:.2g} nm in x and {noise[1]:.2g} nm "
        "in y as the reference beads show it. A shorter exposure and more noise look the same on "
        "these traces; read the camera's register to be sure.",
    )
    return best * frame_s, half * frame_s, estimated


def _profiles(
    beads: Mapping[str, Sequence[Trace]], conditions: Conditions, noise: tuple[float, float]
) -> list[FloatArray]:
    """Per bead, the deviance against the share of a frame, summed over the traces that fit."""
    frame_s = 1 / conditions.frame_rate_hz
    profiles = []
    for traces in beads.values():
        total = np.zeros(len(SHARES_OF_A_FRAME))
        used = 0
        for model in _informative(traces, conditions, noise):
            fits = [
                fit_model(replace(model, exposure_s=share * frame_s)) for share in SHARES_OF_A_FRAME
            ]
            if max(fit.p_value for fit in fits) > P_POOR:
                total += [fit.deviance for fit in fits]
                used += 1
        if used:
            profiles.append(total)
    return profiles


def _informative(
    traces: Sequence[Trace], conditions: Conditions, noise: tuple[float, float]
) -> list[TraceModel]:
    """The traces of a bead that are blurred most, without their slowest motion."""
    slowest, fastest = CORNER_OVER_NYQUIST
    found: list[tuple[float, TraceModel]] = []
    for trace in traces:
        height_nm = float(np.nanmean(trace.position_nm[:, 2])) if trace.recorded[2] else math.nan
        for axis in (0, 1):
            modes = conditions.modes(axis, height_nm)
            first = _model(trace, axis, conditions, noise[axis], modes, 0.0)
            if first is None or not 2 * noise[axis] ** 2 < first.spectrum.variance_nm2:
                continue
            fit = fit_model(first)
            if not slowest < fit.nyquist_ratio < fastest:
                continue
            lowest_hz = LOWEST_OVER_CORNER * fit.corner_frequency.value
            model = _model(trace, axis, conditions, noise[axis], modes, lowest_hz)
            if model is not None:
                found.append((fit.nyquist_ratio, model))
    found.sort(key=lambda pair: -pair[0])
    return [model for _, model in found[:MOST_TRACES_OF_A_BEAD]]


def _model(
    trace: Trace,
    axis: int,
    conditions: Conditions,
    noise_nm: float,
    modes: Modes,
    lowest_hz: float,
) -> TraceModel | None:
    frame_s = 1 / conditions.frame_rate_hz
    try:
        spectrum = periodogram(trace.position_nm[:, axis], frame_s, lowest_hz=lowest_hz)
    except FitError:
        return None
    return TraceModel(
        spectrum,
        frame_s,
        conditions.thermal_energy_pN_nm,
        noise_variance_nm2=noise_nm**2,
        modes=modes,
    )
