"""The model of one trace's spectrum and its likelihood, in the coordinates that are fitted.

Coordinates θ = (ln stiffness, ln friction, noise): k in pN/nm, γ in pN s/nm. The logarithms make
both scale parameters unbounded and the likelihood close to Gaussian. The noise enters as variance
ε² ≥ 0 in nm², in which the likelihood is regular at the limit zero, or as ln ε² where its size is
known beforehand. Everything works on many θ at once: shape (n, 3) in, (n, …) out.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
from scipy import special, stats

from mtpipe.ground.types import FloatArray
from mtpipe.physics.modes import SINGLE_MODE, Modes
from mtpipe.spectra.spectrum import Spectrum

COORDINATES = ("ln_stiffness", "ln_friction", "noise")
# Half-width of the flat priors in ln k and ln γ about the start. Where noise explains everything
# the likelihood does not bound the stiffness from above; this keeps the posterior proper, and one
# that fills it is reported as not identified.
PRIOR_HALF_WIDTH = 5.0
LARGEST_LN_NOISE = 50.0


@dataclass(frozen=True)
class TraceModel:
    """Everything known beforehand about one trace, and its spectrum.

    Attributes
    ----------
    spectrum : the data.
    exposure_s, thermal_energy_pN_nm : of camera and buffer.
    noise_variance_nm2 : known white tracking noise, or None where it is fitted.
    friction : prior mean and standard error in pN s/nm, or None.
    noise_prior_nm : where the noise is fitted, its prior median in nm and the factor that holds
        68 % of it (ln ε is Gaussian), or None: flat in ε² ≥ 0.
    modes : relaxation modes of this axis.
    """

    spectrum: Spectrum
    exposure_s: float
    thermal_energy_pN_nm: float
    noise_variance_nm2: float | None = 0.0
    friction: tuple[float, float] | None = None
    noise_prior_nm: tuple[float, float] | None = None
    modes: Modes = SINGLE_MODE

    @functools.cached_property
    def ordinates(self) -> FloatArray:
        """(n_bins,) weight of each bin in the likelihood."""
        return self.spectrum.ordinates * self.spectrum.share

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the coordinates that are fitted."""
        return (0, 1) if self.noise_variance_nm2 is not None else (0, 1, 2)

    @property
    def noise_is_log(self) -> bool:
        """Whether the third coordinate is ln ε² and not ε²."""
        return self.noise_variance_nm2 is None and self.noise_prior_nm is not None

    def noise_nm2(self, theta: FloatArray) -> FloatArray:
        """Variance ε² of the tracking noise, (n,) nm², for coordinates (n, 3)."""
        return np.exp(theta[:, 2]) if self.noise_is_log else theta[:, 2]

    def expected(self, theta: FloatArray, modes: Modes | None = None) -> FloatArray:
        """Expected binned periodogram, (n, n_bins) nm²/Hz, for coordinates (n, 3).

        `modes`: instead of the model's own, e.g. one set for each of the n.
        """
        motions = self._motions(theta, modes or self.modes)
        return self.spectrum.window.expected_of(*motions, self.exposure_s)

    def log_likelihood(self, theta: FloatArray, modes: Modes | None = None) -> FloatArray:
        """(n,) ln of the likelihood of coordinates (n, 3), up to a constant (as `expected`)."""
        motions = self._motions(theta, modes or self.modes)
        window, power = self.spectrum.window, self.spectrum.power
        return window.log_likelihood(power, self.ordinates, *motions, self.exposure_s)

    def _motions(
        self, theta: FloatArray, modes: Modes
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n, modes) variances in nm² and relaxation times in s, and (n,) noise in nm²."""
        stiffness, friction = np.exp(theta[:, 0]), np.exp(theta[:, 1])
        variance = np.empty((len(theta), len(modes.shares)))
        tau_s = np.empty_like(variance)
        for i, (share, rate) in enumerate(zip(modes.shares, modes.rates, strict=True)):
            variance[:, i] = share * self.thermal_energy_pN_nm / stiffness
            tau_s[:, i] = friction / (stiffness * rate)
        return variance, tau_s, np.ascontiguousarray(self.noise_nm2(theta))

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Signed roots of the deviance per bin (and of the prior): their squares sum to −2 ln L.

        (n, n_bins + number of priors); the deviance is that of the Gamma law of each bin.
        """
        return np.hstack([self.deviance_roots(self.expected(theta)), self._pulls(theta)])

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """(n_bins + number of priors, free) slopes of the residuals at one θ (3,), the third one in
        the trace's variance where the noise is no logarithm."""
        unit = 1.0 if self.noise_is_log else self.spectrum.variance_nm2
        step = 1e-6 * np.array([1.0, 1.0, unit])
        free = np.array(self.free)
        moved = np.tile(theta, (len(free) + 1, 1))
        moved[np.arange(len(free)), free] += step[free]
        rows = self.residuals(moved)
        return np.asarray((rows[:-1] - rows[-1]).T / 1e-6)

    def deviance_roots(self, expected: FloatArray) -> FloatArray:
        """Signed roots of each bin's deviance from an expectation (n, n_bins), same shape."""
        u = self.spectrum.power / expected
        deviance = 2 * self.ordinates * (u - 1 - np.log(u))
        return np.asarray(np.sign(u - 1) * np.sqrt(np.maximum(deviance, 0.0)))

    def log_posterior(self, theta: FloatArray) -> FloatArray:
        """ln of likelihood × prior, (n,), up to a constant; −inf for negative noise.

        Priors are flat in ln k and ln γ (to e^±5 about the start) and in ε² ≥ 0, unless friction
        or noise have a prior of their own.
        """
        near = np.abs(theta[:, :2] - self.start[:2]) < PRIOR_HALF_WIDTH
        possible = np.abs(theta[:, 2]) < LARGEST_LN_NOISE if self.noise_is_log else theta[:, 2] >= 0
        allowed = possible & near.all(axis=1)
        out = np.full(len(theta), -np.inf)
        if allowed.any():
            inside = theta[allowed]
            value = self.log_likelihood(inside) + self.log_reference_prior(inside)
            out[allowed] = value - 0.5 * np.sum(self._pulls(inside) ** 2, axis=1)
        return out

    def log_reference_prior(self, theta: FloatArray) -> FloatArray:
        """(n,) ln of Jeffreys's prior in ln k, where the trace alone has to tell it.

        The root of the information's determinant, in two cases. Friction free: for a trace without
        noise it is a function of the relaxation time alone. Friction known and noise of any size:
        a function of the stiffness, at that friction and for the power that was measured. It keeps
        the posterior from running away where k and γ, or k and noise, are known only together (far
        beyond Nyquist, or with a relaxation time of the trace's length), and makes its intervals
        cover (Jeffreys 1946; Welch & Peers 1963).
        """
        knots, values = self._reference_prior
        return np.interp(theta[:, 1] - theta[:, 0], knots, values)

    @functools.cached_property
    def _reference_prior(self) -> tuple[FloatArray, FloatArray]:
        """ln τ, and ln of the prior there."""
        window = self.spectrum.window
        ln_tau = np.arange(
            np.log(1e-3 * window.frame_s), np.log(20 * self.spectrum.duration_s), 0.2
        )
        n = self.ordinates
        bare = replace(self, noise_variance_nm2=0.0)
        theta = np.zeros((len(ln_tau), 3))
        if self.friction is None:
            theta[:, 1] = ln_tau
            one = np.gradient(np.log(bare.expected(theta)), ln_tau, axis=0)
            other = np.ones_like(one)
        elif self.noise_variance_nm2 is None and not self.noise_is_log:
            theta[:, 1] = np.log(self.friction[0])
            theta[:, 0] = theta[:, 1] - ln_tau
            measured = self.expected(self.start[None])
            one = np.gradient(bare.expected(theta), ln_tau, axis=0) / measured
            other = np.tile(window.white / measured, (len(ln_tau), 1))
        else:
            return ln_tau, np.zeros_like(ln_tau)
        determinant = (one**2 @ n) * (other**2 @ n) - ((one * other) @ n) ** 2
        smallest = 1e-14 * np.max(determinant)
        return ln_tau, 0.5 * np.log(np.maximum(determinant, smallest))

    def slopes(self, theta: FloatArray) -> FloatArray:
        """(free, n_bins) derivatives of ln expected power in the free coordinates at one θ (3,)."""
        unit = 1.0 if self.noise_is_log else self.spectrum.variance_nm2
        steps = 1e-4 * np.array([1.0, 1.0, unit])
        free = np.array(self.free)
        shift = np.zeros((len(free), 3))
        shift[np.arange(len(free)), free] = steps[free]
        low = theta - shift
        if not self.noise_is_log:
            low[:, 2] = np.maximum(low[:, 2], 0.0)
        high = theta + shift
        width = (high - low)[np.arange(len(free)), free][:, None]
        return np.asarray((np.log(self.expected(high)) - np.log(self.expected(low))) / width)

    def information(self, theta: FloatArray) -> FloatArray:
        """Expected Fisher information of the free coordinates at one θ (3,), prior included."""
        slope = self.slopes(theta)
        information = (slope * self.ordinates) @ slope.T
        if self.friction is not None:
            information[1, 1] += (np.exp(theta[1]) / self.friction[1]) ** 2
        if self.noise_is_log and self.noise_prior_nm is not None:
            information[2, 2] += (2 * np.log(self.noise_prior_nm[1])) ** -2
        return np.asarray(information)

    def exposure_slope(self, theta: FloatArray) -> FloatArray:
        """(n_bins,) change of ln expected power per second of exposure, at one θ (3,)."""
        step = 1e-3 * self.exposure_s
        shorter = replace(self, exposure_s=self.exposure_s - step)
        change = self.expected(theta[None]) / shorter.expected(theta[None])
        return np.asarray(np.log(change[0]) / step)

    def p_value(self, deviance: float, fitted: float) -> tuple[float, float]:
        """Degrees of freedom and p-value of a fit's deviance, without the prior's part.

        The deviance of a mean of n exponentials is not χ²: its mean and variance are
        2n(ln n − ψ(n)) and 4n²ψ'(n) − 4n, which matters for the bins of one ordinate. The sum is
        taken as a Gamma law of matching mean and variance.
        """
        n = self.spectrum.ordinates
        deviance = deviance / self.spectrum.share
        mean = float(np.sum(2 * n * (np.log(n) - special.digamma(n)))) - fitted
        variance = float(np.sum(4 * n**2 * special.polygamma(1, n) - 4 * n)) - 2 * fitted
        return mean, float(stats.gamma.sf(deviance, mean**2 / variance, scale=variance / mean))

    def _pulls(self, theta: FloatArray) -> FloatArray:
        """(n, number of priors) distances from the priors in their standard errors."""
        pulls = []
        if self.friction is not None:
            pulls.append((np.exp(theta[:, 1]) - self.friction[0]) / self.friction[1])
        if self.noise_is_log:
            pulls.append(self.noise_pull(theta))
        return np.column_stack(pulls) if pulls else np.empty((len(theta), 0))

    def noise_pull(self, theta: FloatArray) -> FloatArray:
        """(n,) distance of the noise from its prior in standard errors; zero without a prior."""
        if self.noise_prior_nm is None:
            return np.zeros(len(theta))
        median, factor = self.noise_prior_nm
        return np.asarray((theta[:, 2] / 2 - np.log(median)) / np.log(factor))

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
        bare = replace(self, noise_variance_nm2=0.0)
        shape = bare.expected(theta) / self.thermal_energy_pN_nm
        white = 2 * window.frame_s * window.white
        weight = self.ordinates / self.ordinates.sum()
        best, chosen = np.inf, theta[0]
        known = self.noise_variance_nm2
        floor = 0.0 if known is None else min(known, 0.9 * self.spectrum.variance_nm2)
        power = np.maximum(self.spectrum.power - floor * white, 0.02 * self.spectrum.power)
        for white_share in (0.0,) if known is not None else (0.0, 0.02, 0.1, 0.3, 0.6):
            mixed = (1 - white_share) * shape + white_share * white
            scale = (power / mixed) @ weight
            model = scale[:, None] * mixed
            loss = 2 * (np.log(model) + power / model) @ self.ordinates
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
        if self.noise_is_log and self.noise_prior_nm is not None:
            chosen[2] = np.log(max(chosen[2], self.noise_prior_nm[0] ** 2))
        return np.asarray(chosen)
