"""Time-domain averages of a relaxation mode seen by a camera: exact for any exposure.

One Ornstein–Uhlenbeck mode of variance s² and relaxation time τ, recorded with the exposure W of
each frame D, plus white tracking noise ε² (PHYSICS section 1). Means are over m successive frames;
Allan and Hadamard variances are normalised so that white noise gives ε²/m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mtpipe.ground.types import FloatArray
from mtpipe.physics import camera as cam
from mtpipe.physics.camera import Camera


@dataclass(frozen=True)
class SeenMotion:
    """One mode as a camera records it.

    Attributes
    ----------
    variance_nm2 : s² = kT/k. tau_s : γ/k. noise_variance_nm2 : ε², white.
    """

    variance_nm2: float
    tau_s: float
    camera: Camera
    noise_variance_nm2: float = 0.0

    def lag_covariance(self, lag_frames: ArrayLike) -> FloatArray:
        """Covariance c in nm² of positions `lag_frames` frames apart; noise at lag 0."""
        lag = np.abs(np.asarray(lag_frames, dtype=float))
        zero = cam.frame_variance(self.variance_nm2, self.tau_s, self.camera)
        one = cam.lag_one_covariance(self.variance_nm2, self.tau_s, self.camera)
        tail = one * np.exp(-np.maximum(lag - 1, 0.0) * self.camera.frame_s / self.tau_s)
        return np.where(lag == 0, zero + self.noise_variance_nm2, tail)

    def mean_variance(self, frames: ArrayLike) -> FloatArray:
        """Variance V(m) of the mean of m ≥ 1 frames, nm².

        V(m) = c₀/m + (2c₁/m²) [m(1−q) − (1−q^m)]/(1−q)², written with the blur factor b and the
        edge factor so that nothing cancels: V(m) = c₀/m + c₁ [b(mD/τ) − b(D/τ)/m]/edge(D/τ)².
        """
        m = np.asarray(frames, dtype=float)
        step = self.camera.frame_s / self.tau_s
        zero = cam.frame_variance(self.variance_nm2, self.tau_s, self.camera)
        one = cam.lag_one_covariance(self.variance_nm2, self.tau_s, self.camera)
        sums = cam.blur_factor(m * step) - cam.blur_factor(step) / m
        white = (zero + self.noise_variance_nm2) / m
        return np.asarray(white + one * sums / cam.edge_factor(step) ** 2)

    def allan_variance(self, frames: ArrayLike) -> FloatArray:
        """Half the mean square difference of successive means of m frames: 2V(m) − 2V(2m), nm².

        For W = D identical to Eq 17 of Lansdorp & Saleh 2012.
        """
        m = np.asarray(frames, dtype=float)
        return 2 * self.mean_variance(m) - 2 * self.mean_variance(2 * m)

    def hadamard_variance(self, frames: ArrayLike) -> FloatArray:
        """A sixth of the mean square second difference of successive means of m frames, nm².

        With the covariances of means one and two apart written as variances of longer means:
        (15 V(m) − 24 V(2m) + 9 V(3m))/6. A linear drift has no second difference (Pritzl 2024).
        """
        m = np.asarray(frames, dtype=float)
        one, two, three = (self.mean_variance(n * m) for n in (1, 2, 3))
        return 2.5 * one - 4 * two + 1.5 * three
