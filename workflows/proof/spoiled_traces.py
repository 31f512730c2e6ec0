"""Effects of the catalogue that are no matter of spectra: done to raw traces, of a given size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from mtpipe.experiment.description import Experiment
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import Recording

# A stuck bead stays stuck for so long on average; the stage's motion is known from so long.
EPISODE_S, STAGE_S = 2.0, 0.5


def stick(
    raw: Recording, experiment: Experiment, seconds: float, random: np.random.Generator
) -> Recording:
    """The bead goes with the surface for episodes, in the plateaus of the lowest forces."""
    frame_s = experiment.camera.frame_s
    forces = [rest.force_pN for rest in experiment.rests]
    lowest = np.argsort(forces)[: max(len(forces) // 3, 1)]
    stage = _smooth(raw.positions_nm["ref1"], max(round(STAGE_S / frame_s), 1))
    xyz = raw.positions_nm["b1"].copy()
    noise = np.asarray(experiment.tracker.noise_nm)
    left = round(seconds / frame_s)
    while left >= 2:
        plateau = raw.plateaus[int(random.choice(lowest))]
        rows = min(left, max(round(random.exponential(EPISODE_S) / frame_s), 2))
        rows = min(rows, (plateau.stop - plateau.start) // 3)
        start = int(random.integers(plateau.start, plateau.stop - rows))
        while not np.isfinite(xyz[start]).all():
            start -= 1
        there = slice(start, start + rows)
        held = xyz[start] + stage[there] - stage[start] + noise * random.normal(size=(rows, 3))
        xyz[there] = np.where(np.isfinite(xyz[there]), held, np.nan)
        left -= rows
    return replace(raw, positions_nm=raw.positions_nm | {"b1": xyz})


def _smooth(position_nm: FloatArray, frames: int) -> FloatArray:
    """(n, 3) running mean over the frames that were not lost."""
    rows = np.arange(len(position_nm))
    there = np.isfinite(position_nm).all(axis=1)
    whole = [np.interp(rows, rows[there], axis[there]) for axis in position_nm.T]
    return np.asarray(uniform_filter1d(np.column_stack(whole), frames, axis=0))


def respond(
    raw: Recording, experiment: Experiment, slope: float, random: np.random.Generator
) -> Recording:
    """The focus moves between two plateaus, and every bead's table answers in a way of its own."""
    moved_at = raw.plateaus[int(random.integers(1, len(raw.plateaus)))].start - 1
    move_nm = float(random.choice([-1.0, 1.0]) * random.uniform(300.0, 900.0))
    answered = {}
    for bead, xyz in raw.positions_nm.items():
        length_nm, phase = random.uniform(80.0, 300.0), random.uniform(0, 2 * np.pi)
        focused = xyz[:, 2] - np.where(np.arange(len(xyz)) < moved_at, 0.0, move_nm)
        # a sine of this size has slopes of the size asked for, root mean square
        error = np.sqrt(2) * slope * length_nm * np.sin(focused / length_nm + phase)
        answered[bead] = np.column_stack([xyz[:, :2], focused + error])
    return replace(raw, positions_nm=answered)


def lock(
    raw: Recording, experiment: Experiment, amplitude_nm: float, _: np.random.Generator
) -> Recording:
    """x and y of every bead bend with the period of the pixel."""
    pixel = raw.setup.camera.pixel_size_nm
    if pixel is None or pixel.value is None:
        raise ValueError("pixel locking needs a pixel size")
    bent = {}
    for bead, xyz in raw.positions_nm.items():
        lateral = amplitude_nm * np.sin(2 * np.pi * xyz[:, :2] / pixel.value)
        bent[bead] = xyz + np.column_stack([lateral, np.zeros(len(xyz))])
    return replace(raw, positions_nm=bent)
