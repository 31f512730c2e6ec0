"""Calibration of a recording: every tethered bead, spread over the machine's cores.

What happens to one bead is `mtpipe.bead_calibration`'s matter; here are the conditions that all
beads share.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from multiprocessing import get_context

from mtpipe.bead_calibration import BeadResult, calibrate_bead
from mtpipe.conditions import Conditions, conditions_of
from mtpipe.exposure import estimate_exposure
from mtpipe.notice import Notice
from mtpipe.recording import Recording
from mtpipe.traces import traces_of

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Calibration:
    """Calibration of a recording."""

    conditions: Conditions
    beads: tuple[BeadResult, ...]
    notices: tuple[Notice, ...]


def calibrate(
    recording: Recording,
    *,
    seed: int = 0,
    workers: int = 1,
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate every tethered bead of a recording (after drift subtraction).

    Parameters
    ----------
    recording : drift already subtracted, if it is to be.
    seed : of the posteriors; each bead's own seed derives from it and the bead's name.
    workers : processes; beads are spread over them.
    progress : called with (beads done, beads).

    Raises
    ------
    SetupError : the frame rate is not known.
    """
    conditions, notices = conditions_of(recording.setup)
    beads = {bead: traces_of(recording, bead) for bead in recording.tethered}
    noise = _reference_noise(recording)
    if recording.setup.camera.exposure_s.value is None:
        lateral = None if noise[0] is None or noise[1] is None else (noise[0], noise[1])
        exposure, notice = estimate_exposure(beads, conditions, lateral)
        conditions = replace(conditions, exposure_s=exposure)
        notices = (*notices, notice)
    lowest_hz = _lowest_frequencies(recording)
    contour = recording.setup.tether.contour_length_nm.value or 0.0
    jobs = [
        (
            bead,
            traces,
            conditions,
            lowest_hz,
            contour,
            recording.z_zero_stderr_nm.get(bead, 0.0),
            noise,
            seed,
        )
        for bead, traces in beads.items()
    ]
    results: dict[str, BeadResult] = {}
    if workers <= 1 or len(jobs) <= 1:
        for job in jobs:
            results[job[0]] = calibrate_bead(*job)
            if progress is not None:
                progress(len(results), len(jobs))
    else:
        # spawned, not forked: threads of the numerical libraries do not survive a fork
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            futures = {pool.submit(calibrate_bead, *job): job[0] for job in jobs}
            for future in as_completed(futures):
                results[futures[future]] = future.result()
                if progress is not None:
                    progress(len(results), len(jobs))
    return Calibration(conditions, tuple(results[job[0]] for job in jobs), notices)


def _reference_noise(recording: Recording) -> tuple[float | None, float | None, float | None]:
    """Per axis, the white tracking noise of the reference beads in use, in nm."""
    used = [one for one in recording.drift.references if one.used] if recording.drift else []
    if not used:
        return (None, None, None)
    x, y, z = (_median_positive([one.noise_nm[axis] for one in used]) for axis in range(3))
    return (x, y, z)


def _median_positive(values: list[float]) -> float | None:
    known = [value for value in values if value > 0]
    return statistics.median(known) if known else None


def _lowest_frequencies(recording: Recording) -> tuple[float, float, float]:
    drift = recording.drift
    if drift is None or drift.method != "highpass":
        return (0.0, 0.0, 0.0)
    x, y, z = (cutoff or 0.0 for cutoff in drift.cutoff_hz)
    return (x, y, z)
