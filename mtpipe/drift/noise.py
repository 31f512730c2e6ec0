"""Noise of reference beads: white tracking noise, and motion of their own beside it.

All estimates work on cosine coefficients of the plateaus (`lowpass.coefficients`), where white
noise has the same variance in every coefficient. What two beads share is the stage: the product
of a bead's coefficient with the difference to a witness has the bead's own variance as its mean,
whatever the witness's own motion is (the three-cornered hat of Gray & Allan 1974, Proc. 28th Freq.
Control Symp.:243, for two beads). A lone reference has its tethered neighbours as witnesses; they
are too noisy to give its white noise, which is then the floor of its own spectrum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import nnls

from mtpipe.drift.lowpass import PowerBins, power_bins
from mtpipe.ground.types import FloatArray
from mtpipe.physics.walk import walk_variance_s

# White noise is read above this part of the Nyquist frequency; own motion above OWN_MOTION_HZ,
# below which stuck beads too wander apart by temperature and rotation of the field of view.
WHITE_FROM_NYQUIST = 0.1
OWN_MOTION_HZ = 0.5
FLOOR_BINS = 400
COEFFICIENTS_PER_BIN = 32
NEIGHBOURS = 15
OUTLIER_SIGMA = 5.0


@dataclass(frozen=True)
class OwnMotion:
    """Variance of a bead above 0.5 Hz that its witnesses do not share, white noise included."""

    variance_nm2: float
    stderr_nm2: float
    total_nm2: float


def white_noise_alone_nm(coefficients_nm: Sequence[FloatArray], rate_hz: float) -> float:
    """White noise of a lone reference: the floor of its spectrum beside random-walk drift.

    Parameters
    ----------
    coefficients_nm : for each plateau, (n,) nm.
    rate_hz : frames per second.
    """
    pairs = [(c, c) for c in coefficients_nm]
    bins = power_bins(pairs, rate_hz, _white_edges_hz(coefficients_nm, rate_hz))
    return _floor_nm(bins, _near(bins.power_nm2 / bins.count), rate_hz)


def white_noise_shared_nm(coefficients_nm: Sequence[Sequence[FloatArray]], rate_hz: float) -> float:
    """White noise of a reference that has others beside it: the floor of what it does not share.

    Parameters
    ----------
    coefficients_nm : first the bead's, then each other reference's coefficients, plateau by
        plateau.
    rate_hz : frames per second.
    """
    own, *others = coefficients_nm
    against = [c - np.mean(w, axis=0) for c, *w in zip(own, *others, strict=True)]
    edges = _white_edges_hz(own, rate_hz)
    unshared = power_bins(list(zip(own, against, strict=True)), rate_hz, edges)
    power = power_bins([(c, c) for c in own], rate_hz, edges)
    difference = power_bins([(d, d) for d in against], rate_hz, edges)
    scatter = np.sqrt(_near(power.power_nm2) * _near(difference.power_nm2)) / power.count
    return _floor_nm(unshared, scatter, rate_hz)


def own_motion(
    coefficients_nm: Sequence[FloatArray],
    witnesses_nm: Sequence[Sequence[FloatArray]],
    rate_hz: float,
) -> OwnMotion:
    """Variance above 0.5 Hz that is not shared with the witnesses.

    Every witness × plateau gives an unbiased value; they are weighted by their scatter.

    Parameters
    ----------
    coefficients_nm : for each plateau, (n,) nm.
    witnesses_nm : the same of every witness.
    """
    values, variances, totals = [], [], []
    for witness in witnesses_nm:
        for c, w in zip(coefficients_nm, witness, strict=True):
            first = max(1, math.ceil(OWN_MOTION_HZ * 2 * len(c) / rate_hz))
            c, w = c[first:], w[first:]
            if len(c) < COEFFICIENTS_PER_BIN or not np.isfinite(w).all():
                continue
            values.append(float(np.mean(c * (c - w))))
            variances.append(float(np.sum((c * w) ** 2)) / len(c) ** 2)
            totals.append(float(np.mean(c**2)))
    if not values:
        return OwnMotion(math.nan, math.inf, math.nan)
    weight = 1 / np.maximum(variances, 1e-300)
    mean = float(np.sum(weight * values) / np.sum(weight))
    total = float(np.sum(weight * totals) / np.sum(weight))
    return OwnMotion(mean, float(1 / np.sqrt(np.sum(weight))), total)


def _white_edges_hz(coefficients_nm: Sequence[FloatArray], rate_hz: float) -> FloatArray:
    longest = max(len(c) for c in coefficients_nm)
    total = sum(len(c) for c in coefficients_nm)
    n = int(np.clip(total // COEFFICIENTS_PER_BIN, 4, min(FLOOR_BINS, longest)))
    return np.linspace(WHITE_FROM_NYQUIST * rate_hz / 2, rate_hz / 2, n + 1)


def _near(power: FloatArray) -> FloatArray:
    return np.asarray(median_filter(power, NEIGHBOURS, mode="nearest"))


def _floor_nm(bins: PowerBins, scatter_nm2: FloatArray, rate_hz: float) -> float:
    """Root of the floor of a spectrum beside a slope.

    The floor and the spectrum of a random walk are fitted by least
    squares weighted with the scatter per coefficient; the slope stands for drift, or for the upper
    side of a loose bead's Lorentzian. Lines, which stand out from their neighbours, are left out.
    The exposure blurs a walk within a frame, which takes a W/(6 D) off the floor (exposure W,
    frame time D); this is not corrected, as a stage is no random walk on the scale of a frame.
    """
    power = bins.power_nm2 / bins.count
    error = scatter_nm2 * np.sqrt(2 / bins.count)
    usual = np.abs(power - _near(power)) < OUTLIER_SIGMA * error
    walk = rate_hz * walk_variance_s(bins.frequency_hz, 1 / rate_hz)
    shapes = np.column_stack([np.ones_like(walk), walk])[usual] / error[usual, None]
    (floor_nm2, _), _ = nnls(shapes, power[usual] / error[usual])
    return math.sqrt(floor_nm2)
