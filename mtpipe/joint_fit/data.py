"""A bead's recording reduced to what the configured experiment predicts: spectra and mean heights.

Per plateau the binned periodograms of x, y and z and their cross-periodograms, of the frames in
which all axes are there, and the mean of z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.spectra import MatrixSpectrum, matrix_periodogram
from mtpipe.spectra.correlation import lag_one_correlation
from mtpipe.spectra.spectrum import prewhitening


@dataclass(frozen=True, eq=False)
class PlateauData:
    """One plateau of one bead.

    Attributes
    ----------
    spectrum : power matrix per bin.
    mean_nm : (3,) mean position; z is the extension. frames : that have all axes, which it is of.
    duration_s : lost frames included.
    """

    spectrum: MatrixSpectrum
    mean_nm: FloatArray
    frames: int
    duration_s: float


def whitening(position_nm: FloatArray, frame_s: float) -> tuple[float, ...]:
    """Prewhitening of each axis, from its correlation of successive frames."""
    phi = []
    for x in position_nm.T:
        ratio = lag_one_correlation(x - np.nanmean(x))
        tau_s = -frame_s / math.log(ratio) if 0 < ratio < 1 else 0.0
        phi.append(prewhitening(tau_s, frame_s) if tau_s > 0 else 0.0)
    return tuple(phi)


def plateau_data(
    position_nm: FloatArray,
    frame_s: float,
    phi: tuple[float, ...],
    lines_hz: tuple[float, ...] = (),
) -> PlateauData:
    """Reduce one plateau.

    Parameters
    ----------
    position_nm : (n, 3) on the camera's grid, NaN where lost.
    phi : prewhitening of each axis (`whitening`). lines_hz : that have bins of their own.

    Raises
    ------
    FitError : too few frames, or an axis that never moves.
    """
    together = np.asarray(np.isfinite(position_nm)).all(axis=1)
    frames = int(together.sum())
    complete = position_nm
    if frames < len(position_nm):
        complete = np.where(np.asarray(together)[:, None], position_nm, np.nan)
    return PlateauData(
        matrix_periodogram(complete, frame_s, phi, lines_hz),
        np.asarray(complete[together].mean(axis=0)),
        frames,
        len(position_nm) * frame_s,
    )
