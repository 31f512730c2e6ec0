"""Weights with which autocovariances enter the expected matrices of a window."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from mtpipe.ground.types import FloatArray


class LagWeights:
    """(1/n) Σ_segments E|Σ_t m_t (x_t − x̄) e^{−iθt}|², binned, for given covariances of x, which is
    prewhitened already.
    """

    def __init__(self, masks: NDArray[np.bool_], edges: NDArray[np.int64]) -> None:
        self.edges, self.length, self.n = edges, masks.shape[1], float(masks.sum())
        self.padding = fft.next_fast_len(2 * self.length)
        pairs = np.zeros(self.padding // 2 + 1)
        for mask in masks:
            pairs += np.abs(fft.rfft(mask.astype(float), self.padding)) ** 2
        weights = fft.irfft(pairs, self.padding)[: self.length] / self.n
        self.weights = np.maximum(weights, 0.0)
        # with several segments relaxation is short against each, and what subtracting a segment's
        # mean over its gaps changes is far below the statistical error, as it is for few gaps
        mean_matters = len(masks) == 1 and self.n < MEAN_MATTERS_BELOW * self.length
        self.gaps = masks[0].astype(float) if mean_matters else None

    def expected(self, covariance: FloatArray) -> FloatArray:
        """(k, n_bins) for covariances (k, length) at lags 0 … length − 1."""
        weighted = covariance * self.weights
        # at the Fourier frequencies lag m − N is the same phase as lag m
        folded = weighted.copy()
        folded[:, 1:] += weighted[:, :0:-1]
        power = fft.rfft(folded).real
        if self.gaps is not None:
            power = power + self._mean_subtraction(covariance, self.gaps)
        inside, first = power[:, : self.edges[-1]], self.edges[:-1]
        return np.asarray(np.add.reduceat(inside, first, axis=1) / np.diff(self.edges))

    def _mean_subtraction(self, covariance: FloatArray, mask: FloatArray) -> FloatArray:
        """The change that subtracting the mean of the frames present makes (none without gaps)."""
        of_mask, padded = fft.rfft(mask), fft.rfft(mask, self.padding)
        symmetric = np.zeros((len(covariance), self.padding))
        symmetric[:, : self.length] = covariance
        symmetric[:, -self.length + 1 :] += covariance[:, :0:-1]
        spectrum = fft.rfft(symmetric).real * padded
        smooth = mask * fft.irfft(spectrum, self.padding)[:, : self.length]
        cross = -2 * np.real(fft.rfft(smooth) / self.n * np.conj(of_mask))
        variance = smooth.sum(axis=1, keepdims=True) / self.n**2
        return np.asarray((cross + variance * np.abs(of_mask) ** 2) / self.n)


MEAN_MATTERS_BELOW = 0.95
