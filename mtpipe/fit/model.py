"""The model of one trace's spectrum and its likelihood, in the coordinates that are fitted.

Coordinates θ = (ln stiffness, ln friction, noise variance): k in pN/nm, γ in pN s/nm, ε² in nm².
The logarithms make both scale parameters unbounded and the likelihood close to Gaussian; the noise
enters as variance because the likelihood is regular in it at the limit ε² = 0. Everything works on
many θ at once: shape (n, 3) in, (n, …) out.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from mtpipe.physics.camera import FloatArray
from mtpipe.physics.modes import SINGLE_MODE, Modes
from mtpipe.spectrum import Spectrum

COORDINATES = ("ln_stiffness", "ln_friction", "noise_variance")
# Half-width of the flat priors in ln k and ln γ about the start. Where noise explains everything
# the likelihood does not bound the stiffness from above; this keeps the posterior proper, and one
# that fills it is reported as not identified.
PRIOR_HALF_WIDTH = 5.0


@dataclass(frozen=True)
class TraceModel:
    """Everything known beforehand about one trace, and its spectrum.

    Attributes
    ----------
    spectrum : the data.
    exposure_s, thermal_energy_pN_nm : of camera and buffer.
    noise_variance_nm2 : known white tracking noise, or None where it is fitted.
    friction : prior mean and standard error in pN s/nm, or None.
    modes : relaxation modes of this axis.
    """

    spectrum: Spectrum
    exposure_s: float
    thermal_energy_pN_nm: float
    noise_variance_nm2: float | None = 0.0
    friction: tuple[float, float] | None = None
    modes: Modes = SINGLE_MODE

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the coordinates that are fitted."""
        return (0, 1) if self.noise_variance_nm2 is not None else (0, 1, 2)

    def expected(self, theta: FloatArray) -> FloatArray:
        """Expected binned periodogram, (n, n_bins) nm²/Hz, for coordinates (n, 3)."""
        stiffness, friction = np.exp(theta[:, 0]), np.exp(theta[:, 1])
        window = self.spectrum.window
        noise = 2 * window.frame_s * theta[:, 2, None] * window.white
        variance = self.thermal_energy_pN_nm / stiffness
        for share, rate in zip(self.modes.shares, self.modes.rates, strict=True):
            tau_s = friction / (stiffness * rate)
            noise = noise + window.expected(share * variance, tau_s, self.exposure_s)
        return noise

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Signed roots of the deviance per bin (and of the prior): their squares sum to −2 ln L.

        (n, n_bins) or (n, n_bins + 1); the deviance is that of the Gamma law of each bin.
        """
        u = self.spectrum.power / self.expected(theta)
        deviance = 2 * self.spectrum.ordinates * (u - 1 - np.log(u))
        signed = np.sign(u - 1) * np.sqrt(np.maximum(deviance, 0.0))
        return signed if self.friction is None else np.hstack([signed, self._pull(theta)])

    def log_posterior(self, theta: FloatArray) -> FloatArray:
        """ln of likelihood × prior, (n,), up to a constant; −inf for negative noise.

        Priors are flat in ln k and ln γ (to e^±5 about the start) and in ε² ≥ 0, times the
        Gaussian prior of the friction.
        """
        near = np.abs(theta[:, :2] - self.start[:2]) < PRIOR_HALF_WIDTH
        allowed = (theta[:, 2] >= 0) & near.all(axis=1)
        out = np.full(len(theta), -np.inf)
        if allowed.any():
            inside = theta[allowed]
            expected = self.expected(inside)
            per_bin = np.log(expected) + self.spectrum.power / expected
            value = -per_bin @ self.spectrum.ordinates
            if self.friction is not None:
                value = value - 0.5 * self._pull(inside)[:, 0] ** 2
            out[allowed] = value
        return out

    def information(self, theta: FloatArray) -> FloatArray:
        """Expected Fisher information of the free coordinates at one θ (3,), prior included."""
        steps = np.array([1e-4, 1e-4, 1e-4 * self.spectrum.variance_nm2])
        free = np.array(self.free)
        shift = np.zeros((len(free), 3))
        shift[np.arange(len(free)), free] = steps[free]
        # one-sided in the noise, which may not be negative
        low = np.maximum(theta - shift, np.array([-np.inf, -np.inf, 0.0]))
        high = theta + shift
        width = (high - low)[np.arange(len(free)), free][:, None]
        slope = (np.log(self.expected(high)) - np.log(self.expected(low))) / width
        information = (slope * self.spectrum.ordinates) @ slope.T
        if self.friction is not None:
            information[1, 1] += (np.exp(theta[1]) / self.friction[1]) ** 2
        return np.asarray(information)

    def p_value(self, deviance: float, fitted: int) -> tuple[float, float]:
        """Degrees of freedom and p-value of a fit's deviance, without the prior's part.

        The deviance of a mean of n exponentials is not χ²: its mean and variance are
        2n(ln n − ψ(n)) and 4n²ψ'(n) − 4n, which matters for the bins of one ordinate. The sum is
        taken as a Gamma law of matching mean and variance.
        """
        n = self.spectrum.ordinates
        mean = float(np.sum(2 * n * (np.log(n) - special.digamma(n)))) - fitted
        variance = float(np.sum(4 * n**2 * special.polygamma(1, n) - 4 * n)) - 2 * fitted
        return mean, float(stats.gamma.sf(deviance, mean**2 / variance, scale=variance / mean))

    def _pull(self, theta: FloatArray) -> FloatArray:
        value, stderr = self.friction or (0.0, np.inf)
        return np.asarray((np.exp(theta[:, 1:2]) - value) / stderr)

    @functools.cached_property
    def start(self) -> FloatArray:
        """A start (3,) that always exists: the best of a coarse grid, scale and noise profiled.

        For a fixed relaxation time and white share of the variance the best scale is the weighted
        mean of power over shape, so the grid has only these two dimensions.
        """
        window = self.spectrum.window
        rate = min(self.modes.rates)
        tau = np.geomspace(0.02 * window.frame_s, self.spectrum.duration_s, 40)
        theta = np.zeros((len(tau), 3))
        theta[:, 1] = np.log(tau * rate)
        theta[:, 0] = 0.0
        shape = self.expected(theta) / self.thermal_energy_pN_nm
        white = 2 * window.frame_s * window.white
        weight = self.spectrum.ordinates / self.spectrum.ordinates.sum()
        best, chosen = np.inf, theta[0]
        known = self.noise_variance_nm2
        floor = 0.0 if known is None else min(known, 0.9 * self.spectrum.variance_nm2)
        power = np.maximum(self.spectrum.power - floor * white, 0.02 * self.spectrum.power)
        for white_share in (0.0,) if known is not None else (0.0, 0.02, 0.1, 0.3, 0.6):
            mixed = (1 - white_share) * shape + white_share * white
            scale = (power / mixed) @ weight
            model = scale[:, None] * mixed
            loss = 2 * (np.log(model) + power / model) @ self.spectrum.ordinates
            stiffness = self.thermal_energy_pN_nm / ((1 - white_share) * scale)
            friction = stiffness * tau * rate
            if self.friction is not None:
                loss = loss + np.log(friction / self.friction[0]) ** 2 / (
                    (self.friction[1] / self.friction[0]) ** 2 + 0.01
                )
            i = int(np.argmin(loss))
            if loss[i] < best:
                best = float(loss[i])
                noise = known if known is not None else white_share * scale[i]
                chosen = np.array([np.log(stiffness[i]), np.log(friction[i]), noise])
        return np.asarray(chosen)
