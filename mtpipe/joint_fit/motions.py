"""The bead's own motion as plateaus see it, noise apart: its power and its mean height.

Most parameters of an experiment do not change the motion, and fits need it again and again, so the
latest results are cached.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtpipe.experiment.readout import Readout, readout
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.batch_cache import BatchCache
from mtpipe.joint_fit.data import PlateauData
from mtpipe.joint_fit.layers import Moving
from mtpipe.joint_fit.random_walk import line_of, sees_walks
from mtpipe.physics.camera import Camera, mean_variance
from mtpipe.spectra.window import expected_matrices, seen_modes

DIAGONAL = np.arange(3)


@dataclass(frozen=True, eq=False)
class Motion:
    """What is expected of the bead's own motion.

    Attributes
    ----------
    power : (n_bins, 3, 3). height_variance_nm2 : of the mean height, apart from a random walk's.
    walked_nm2 : (3,) as of `Expectation`.
    """

    power: FloatArray
    extension_nm: float
    height_variance_nm2: float
    walked_nm2: FloatArray


Key = tuple[PlateauData, Moving, float]
# Size of the cache of motions: as many as the slopes of a fit need in a usual recording. Noise is
# not part of a motion, so the same one is asked for again with other noise.
MOST_KNOWN = 512
_KNOWN: BatchCache[Key, Motion] = BatchCache(MOST_KNOWN)


def motions(those: Sequence[Key]) -> list[Motion | FitError]:
    """The bead's own motion in plateaus, under descriptions at forces, or why there is none."""
    found: dict[Key, Motion | FitError] = {}
    missing: dict[Camera, list[tuple[Key, Readout]]] = {}
    for key in dict.fromkeys(those):
        data, moving, force_pN = key
        known = _KNOWN.get(key)
        if known is not None:
            found[key] = known
            continue
        try:
            state = moving.core.state(force_pN)
        except FitError as error:
            found[key] = error.with_traceback(None)
            continue
        parts = readout(moving.experiment, state, data.duration_s)
        missing.setdefault(moving.experiment.camera, []).append((key, parts))
    for camera, some in missing.items():
        seen = _seen(camera, [(key[0], parts) for key, parts in some])
        for (key, _), motion in zip(some, seen, strict=True):
            found[key] = motion
            _KNOWN.put(key, motion)
    return [found[key] for key in those]


def _seen(camera: Camera, those: Sequence[tuple[PlateauData, Readout]]) -> list[Motion]:
    """Motions in plateaus as one camera sees them."""
    counts = [len(parts.tau_s) for _, parts in those]
    first = np.cumsum([0, *counts])
    tau_s = np.concatenate([parts.tau_s for _, parts in those])
    covariance = np.concatenate([parts.covariance_nm2 for _, parts in those])
    longest_s = np.repeat([data.spectrum.windows[0].longest_s for data, _ in those], counts)
    # frames that are lost are taken for time that is lost
    frames = np.repeat([data.frames for data, _ in those], counts)
    modes = seen_modes(tau_s, longest_s, camera)
    of_mean = mean_variance(covariance[:, 2, 2], tau_s, camera, frames)
    found: list[Motion] = []
    for data, together in itertools.groupby(those, key=lambda one: one[0]):
        some = [parts for _, parts in together]
        begins = first[len(found) : len(found) + len(some) + 1]
        power = expected_matrices(data.spectrum.windows, modes, covariance, begins)
        for parts, own, (a, b) in zip(some, power, itertools.pairwise(begins), strict=True):
            # a walk moves the heights of all later plateaus: that is the model's business
            variance_nm2 = float(of_mean[a : b - parts.walks].sum())
            found.append(_with_white(data, camera, parts, own, variance_nm2))
    return found


def _with_white(
    data: PlateauData, camera: Camera, parts: Readout, power: FloatArray, variance_nm2: float
) -> Motion:
    """A motion with its white part, and without the line of a walk.

    Parameters
    ----------
    power : (n_bins, 3, 3) of its modes, which is changed. variance_nm2 : their part of the mean
        height's.
    """
    if parts.white_nm2.any():
        power += 2 * camera.frame_s * parts.white_nm2 * _white(data)
        variance_nm2 += float(parts.white_nm2[2, 2]) / data.frames
    walked_nm2 = np.zeros(3)
    if parts.walks and sees_walks(data):
        gone = -np.expm1(-data.duration_s / parts.tau_s[-1])
        walked_nm2 = 2 * np.diag(parts.covariance_nm2[-1]) * gone
        line = line_of(data).power[:, DIAGONAL, DIAGONAL]
        power[:, DIAGONAL, DIAGONAL] -= walked_nm2 * line
    return Motion(power, parts.extension_nm, variance_nm2, walked_nm2)


@functools.lru_cache(maxsize=256)
def _white(data: PlateauData) -> FloatArray:
    """(n_bins, 3, 3) what the windows make of white noise of each axis, and common to two."""
    root = np.sqrt([window.white for window in data.spectrum.windows])
    return np.asarray(np.einsum("af,bf->fab", root, root))
