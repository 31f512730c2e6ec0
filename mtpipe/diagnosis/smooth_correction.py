"""A smooth factor on expected spectra, fitted together with the forces: the shape of what is left.

ln S → ln S + Σ cⱼ Bⱼ(ln f), cubic B-splines over the recorded band, for each axis none, one common
to all plateaus or one of each plateau. Which axes have any, and how wide and how bent, is
decided by the marginal likelihood (MacKay 1992, Neural Comput. 4, 415). What else is fitted
(forces, noise, whatever is shared) follows, and the heights hold the forces as they do in the fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtpipe.diagnosis.smooth_fit import Spectra, Term, best_solution, spline_basis, terms_of
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.fit import ConfiguredFit

# Least gain in ln marginal likelihood of an axis's correction.
WORTH_NATS = 3.0
GRID = 121
# ln of a factor beyond which nothing is drawn or written.
FARTHEST = 30.0


@dataclass(frozen=True, eq=False)
class AxisCorrection:
    """The correction of one axis.

    Attributes
    ----------
    axis : 0 to 2. common : one curve for all plateaus, else one for each.
    coefficients : (curves, splines). covariance : (curves, splines, splines), θ unknown as well.
    """

    axis: int
    common: bool
    coefficients: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class SmoothCorrection:
    """Factors on expected spectra that the recording asks for, and what they do to the forces.

    Attributes
    ----------
    axes : those that need one. band_hz : on which the splines live.
    gain_nats : ln of the marginal likelihood gained.
    ln_force_shift : (plateaus,) of ln F, the corrections being free. ln_force_stderr : (plateaus,)
        standard errors of ln F then.
    left : (rows,) recorded power over what is expected with the forces shifted.
    """

    axes: tuple[AxisCorrection, ...]
    band_hz: tuple[float, float]
    gain_nats: float
    ln_force_shift: FloatArray
    ln_force_stderr: FloatArray
    left: FloatArray

    @property
    def frequency_hz(self) -> FloatArray:
        """(GRID,) frequencies to look at a curve at, logarithmic."""
        return np.geomspace(*self.band_hz, GRID)

    def curve(self, one: AxisCorrection, number: int) -> tuple[FloatArray, FloatArray]:
        """(GRID,) ln of the factor and its standard error; `number` : of the curve."""
        basis = spline_basis(self.frequency_hz, self.band_hz)
        variance = np.einsum("gi,ij,gj->g", basis, one.covariance[number], basis)
        return basis @ one.coefficients[number], np.sqrt(np.maximum(variance, 0.0))

    def place(self, one: AxisCorrection, number: int) -> Place:
        """Where a curve is clearest, and how large there."""
        ln, stderr = self.curve(one, number)
        at = int(np.argmax(np.abs(ln) / np.maximum(stderr, 1e-12)))
        large = ln * np.sign(ln[at]) >= 0.5 * abs(ln[at])
        first = last = at
        while first > 0 and large[first - 1]:
            first -= 1
        while last < GRID - 1 and large[last + 1]:
            last += 1
        band = float(self.frequency_hz[first]), float(self.frequency_hz[last])
        return Place(
            band, *self.mean(one, number, band), float(np.sqrt(np.mean(np.expm1(ln) ** 2)))
        )

    def mean(
        self, one: AxisCorrection, number: int, band_hz: tuple[float, float]
    ) -> tuple[float, float]:
        """Mean ln of the factor in a band, over ln f, and its standard error."""
        mean = spline_basis(np.geomspace(*band_hz, GRID), self.band_hz).mean(axis=0)
        variance = float(mean @ one.covariance[number] @ mean)
        return float(mean @ one.coefficients[number]), float(np.sqrt(max(variance, 0.0)))


@dataclass(frozen=True)
class Place:
    """Band of a curve, mean ln of the factor in it with its standard error, and the root mean
    square of (factor − 1) over all of the recorded band.
    """

    band_hz: tuple[float, float]
    ln: float
    stderr: float
    rms: float


def spectra_of(fit: ConfiguredFit) -> Spectra:
    """A fit's data and its responses at θ."""
    model, size = fit.model, len(fit.theta)
    parts: list[tuple[FloatArray, ...]] = []
    pulls, pull_responses = list(fit.height_pulls), list(fit.height_pull_slopes)
    for i, (data, here, slope) in enumerate(zip(model.data, fit.expected, fit.slopes, strict=True)):
        spectrum = data.spectrum
        bins = len(spectrum.frequency_hz)
        for along in range(3):
            expected = here.power[:, along, along]
            response = np.zeros((bins, size))
            response[:, slope.rows] = (slope.power[:, :, along, along] / expected).T
            ratio = spectrum.power[:, along, along] / expected
            of = np.full(bins, along), np.full(bins, i)
            parts.append((*of, spectrum.frequency_hz, spectrum.ordinates, ratio, response))
    for k, (pull, parameter) in enumerate(
        zip(model.pulls(fit.theta), model.parameters, strict=True)
    ):
        if parameter.prior is not None:
            pulls.append(float(pull))
            pull_responses.append(np.eye(size)[model.plateaus + k] / parameter.prior[1])
    room = np.array([model.lower - fit.theta, model.upper - fit.theta])
    axis, plateau, frequency, ordinates, ratio, response = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    return Spectra(
        axis, plateau, frequency, ordinates, ratio, response,
        np.array(pulls), np.array(pull_responses), room,
    )  # fmt: skip


def smooth_correction(spectra: Spectra) -> SmoothCorrection | None:
    """The corrections that earn their coefficients, axis after axis; None if none does."""
    band = float(spectra.frequency_hz.min()), float(spectra.frequency_hz.max())
    basis = spline_basis(spectra.frequency_hz, band)
    without = best_solution(spectra, None, [])
    best, taken = without, list[Term]()
    while True:
        tried = [
            best_solution(spectra, best, terms_of(spectra, basis, band, axis, common))
            for axis in sorted(set(spectra.axis.tolist()) - {term.axis for term in taken})
            for common in ((True, False) if spectra.plateaus > 1 else (True,))
        ]
        following = max(tried, key=lambda one: one.ln_evidence, default=best)
        if following.ln_evidence < best.ln_evidence + WORTH_NATS:
            break
        best, taken = following, following.terms
    if not taken:
        return None
    plateaus, free = spectra.plateaus, spectra.response.shape[1]
    axes, first, uncertain = [], free, best.covariance
    for term in taken:
        places = first + np.arange(term.columns.shape[1]).reshape(-1, basis.shape[1])
        covariance = np.array([uncertain[np.ix_(at, at)] for at in places])
        axes.append(AxisCorrection(term.axis, term.common, best.z[places], covariance))
        first += places.size
    return SmoothCorrection(
        tuple(axes),
        band,
        best.ln_evidence - without.ln_evidence,
        (best.z - np.pad(without.z, (0, len(best.z) - free)))[:plateaus],
        np.sqrt(np.maximum(np.diag(uncertain)[:plateaus], 0.0)),
        spectra.ratio * np.exp(np.clip(-spectra.response @ best.z[:free], -FARTHEST, FARTHEST)),
    )
