"""Error of a number if one of several models holds and the data do not decide which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp, ndtr

from mtpipe.ground.types import FloatArray

# Share of a normal distribution within one standard error.
WITHIN_ONE = float(ndtr(1) - ndtr(-1))
# Halvings of the bracket in which the width lies: to 1e-12 of it.
HALVINGS = 40


@dataclass(frozen=True, eq=False)
class Mixture:
    """Normal distributions about several models' values of a few numbers.

    Attributes
    ----------
    nats : (models,) ln weight of each, up to a constant.
    shift : (models, numbers) each one's value less that of the model taken, in any unit.
    stderr : (models, numbers) standard errors, same unit.
    """

    nats: FloatArray
    shift: FloatArray
    stderr: FloatArray

    @classmethod
    def of_one(cls, stderr: FloatArray) -> Mixture:
        """The model taken alone: standard errors (numbers,)."""
        return cls(np.zeros(1), np.zeros((1, stderr.size)), stderr[None])

    def or_else(self, others: Sequence[tuple[float, FloatArray, FloatArray]]) -> Mixture:
        """A choice between the model taken and others, independent of the choices so far.

        Parameters
        ----------
        others : of each how many nats it is the likelier, its values less the taken one's
            (numbers,), and its standard errors (numbers,), the taken one's where they are nan.
            Shifts of several choices add; each changes the standard error by a factor.
        """
        own = self.stderr[0]
        choice = [(0.0, np.zeros_like(own), own), *others]
        return Mixture(
            np.concatenate([self.nats + nats for nats, _, _ in choice]),
            np.concatenate([self.shift + shift for _, shift, _ in choice]),
            np.concatenate(
                [
                    self.stderr * np.where(np.isfinite(stderr), stderr / own, 1.0)
                    for _, _, stderr in choice
                ]
            ),
        )

    def mean_shift(self) -> FloatArray:
        """(numbers,) mean of all models' values, less the taken model's."""
        return np.asarray(np.exp(self.nats - logsumexp(self.nats)) @ self.shift)

    def about(self, shift: FloatArray) -> Mixture:
        """The same about other values (numbers,), that much above the taken model's."""
        return replace(self, shift=self.shift - shift)

    def half_width(self) -> FloatArray:
        """(numbers,) half widths of the intervals about the taken model's values that hold 68 %.

        Of one model its standard errors; nan where a standard error is.
        """
        weight = np.exp(self.nats - logsumexp(self.nats))[:, None]
        low = np.zeros(self.shift.shape[1])
        high = np.max(np.abs(self.shift) + 2 * self.stderr, axis=0)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            held = ndtr((middle - self.shift) / self.stderr)
            held -= ndtr((-middle - self.shift) / self.stderr)
            enough = (weight * held).sum(axis=0) >= WITHIN_ONE
            low, high = np.where(enough, low, middle), np.where(enough, middle, high)
        return np.asarray(np.where(np.isfinite(self.stderr).all(axis=0), high, np.nan))
