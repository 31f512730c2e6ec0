"""From simulated values of many statistics to p-values, one by one and all together.

Each statistic's simulated values give mean, spread, skewness and kurtosis. The tail is that of a
Pearson type III law with the first three, and of Student's law in the number of simulations,
because mean and spread are themselves only estimated. Statistics of cubes have longer tails on both
sides: kurtosis beyond that of the Pearson law leaves Student's law fewer degrees of freedom. Some
fifty values determine a skewness poorly, and the smallest of hundreds of p-values depends on it. So
the skewnesses of one statistic at its places are shrunk to their mean, and its kurtosis is the same
at all of them.
The p-value of all together is that of the smallest: with an effective number of statistics n it is
1 − (1 − p)^n, and n is what makes the simulations' own smallest p-values uniform, each simulation
being judged by the others (Westfall & Young 1993, min-p).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from mtpipe.ground.types import FloatArray

# Prior of skewnesses: standard deviation of a statistic's mean skewness about 0, that of its places
# about this mean, and the number of places that the second is worth as evidence.
OF_STATISTICS, OF_PLACES, PLACES_BEFOREHAND = 0.7, 0.2, 10
# Prior of the excess kurtosis that skewness leaves, of all places of a statistic: standard
# deviation about 0. Below the least a tail is a normal one.
OF_KURTOSES, LEAST_KURTOSIS = 1.0, 0.01
LEAST_SKEWNESS = 0.02
LARGEST_SKEWNESS = 1.9
SMALLEST_P = 1e-300
LEAST_OWN, MOST_ALIKE = 1e-6, 0.999
# Nodes and weights of a mean from 0 to 1.
_EVENLY, _EVENLY_WEIGHTS = np.polynomial.legendre.leggauss(64)
_EVENLY, _EVENLY_WEIGHTS = (_EVENLY + 1) / 2, _EVENLY_WEIGHTS / 2


@dataclass(frozen=True, eq=False)
class Nulls:
    """Simulated values of all statistics at their places.

    Attributes
    ----------
    values : (simulations, statistics). upper : (statistics,) only large values are odd.
    statistic : (statistics,) number of the statistic; its places have laws of similar shape.
    """

    values: FloatArray
    upper: NDArray[np.bool_]
    statistic: NDArray[np.int64]

    @property
    def simulations(self) -> int:
        """How many."""
        return len(self.values)

    def p_values(self, observed: FloatArray) -> FloatArray:
        """(statistics,) p-value of each, two-sided where both ways are odd."""
        mean = self.values.mean(axis=0)
        deviation = self.values - mean
        sums = [np.sum(deviation**k, axis=0) for k in (2, 3, 4)]
        return self._p_values(observed - mean, sums, self.simulations)

    def own_p_values(self) -> FloatArray:
        """(simulations, statistics) p-values of each simulation judged by all the others."""
        s = self.simulations
        deviation = self.values - self.values.mean(axis=0)
        square, cube, fourth = (np.sum(deviation**k, axis=0) for k in (2, 3, 4))
        # sums about the mean of the others, which is moved by −deviation/(s − 1)
        moved = deviation / (s - 1)
        square, cube, fourth = (
            total - deviation**k for k, total in ((2, square), (3, cube), (4, fourth))
        )
        others = [
            square - (s - 1) * moved**2,
            cube + 3 * moved * square - 2 * (s - 1) * moved**3,
            fourth + 4 * moved * cube + 6 * moved**2 * square - 3 * (s - 1) * moved**4,
        ]
        return self._p_values(deviation + moved, others, s - 1)

    def _p_values(self, deviation: FloatArray, sums: list[FloatArray], s: int) -> FloatArray:
        """p-values of deviations from the mean of s values, given the sums of their second, third
        and fourth powers.
        """
        square, cube, fourth = sums
        least = (1e-9 * (1 + np.abs(self.values).max(axis=0))) ** 2
        variance = np.maximum(square / (s - 1), least)
        by_itself = s * cube / ((s - 1) * (s - 2)) / variance**1.5
        skewness = self._skewness(by_itself, s)
        kurtosis = self._kurtosis(fourth / s / variance**2 - 3, by_itself, s)
        score = _normal_score(deviation / np.sqrt(variance), skewness) / np.sqrt(1 + 1 / s)
        score, freedom = _student_score(score, kurtosis, s)
        one = stats.t.sf(score, freedom)
        both = 2 * stats.t.sf(np.abs(score), freedom)
        return np.asarray(np.clip(np.where(self.upper, one, both), SMALLEST_P, 1.0))

    def _skewness(self, by_itself: FloatArray, s: int) -> FloatArray:
        """(…, statistics) skewnesses, each drawn to the mean of its places as far as they may
        differ by chance (empirical Bayes, Efron & Morris 1973).
        """
        # a place without values takes nothing from the others
        by_itself = np.clip(np.nan_to_num(by_itself), -LARGEST_SKEWNESS, LARGEST_SKEWNESS)
        member, index = self._places
        places = member.sum(axis=1)
        # variance of the skewness of s normal variates (Fisher 1930)
        chance = 6 * s * (s - 1) / ((s - 2) * (s + 1) * (s + 3))
        mean = (by_itself @ member.T / (places + chance / OF_STATISTICS**2))[..., index]
        square = (by_itself - mean) ** 2 @ member.T
        square += PLACES_BEFOREHAND * (OF_PLACES**2 + chance)
        between = np.maximum(square / (places + PLACES_BEFOREHAND) - chance, 0.0)[..., index]
        return np.asarray(mean + (by_itself - mean) * between / (between + chance))

    def _kurtosis(self, by_itself: FloatArray, skewness: FloatArray, s: int) -> FloatArray:
        """(…, statistics) excess kurtoses beyond that of a Pearson type III law, 3/2 of the squared
        skewness, at least 0: the mean over the places of each statistic, drawn to 0 as far as it
        may be by chance.
        """
        # in expectation the squared skewness of s normal variates is 6/s, their kurtosis −6/s
        beyond = np.nan_to_num(by_itself + 6 / s - 1.5 * (skewness**2 - 6 / s))
        member, index = self._places
        # variance of the kurtosis of s normal variates (Fisher 1930), to first order
        kurtosis = beyond @ member.T / (member.sum(axis=1) + 24 / s / OF_KURTOSES**2)
        return np.asarray(np.maximum(kurtosis, 0.0)[..., index])

    @functools.cached_property
    def _places(self) -> tuple[FloatArray, NDArray[np.int64]]:
        """(kinds, statistics) which statistics are places of one, and (statistics,) of which."""
        numbers, index = np.unique(self.statistic, return_inverse=True)
        return np.equal.outer(np.arange(len(numbers)), index).astype(float), index


def _student_score(
    score: FloatArray, kurtosis: FloatArray, s: int
) -> tuple[FloatArray, FloatArray]:
    """Student's scores and degrees of freedom of values of spread 1 with a long tail, spread and
    mean of which are known from s values: excess kurtoses, 6/(ν − 4) each, add up.
    """
    longer = kurtosis > LEAST_KURTOSIS
    freedom = 4 + 6 / np.where(longer, kurtosis, 1.0)
    together = 4 + 6 / (6 / max(s - 5, 1) + np.where(longer, kurtosis, 0.0))
    wider = np.where(longer, np.sqrt(freedom / (freedom - 2)), 1.0)
    return score * wider, together


def _normal_score(standardised: FloatArray, skewness: FloatArray) -> FloatArray:
    """Standard normal scores of values of mean 0, spread 1 and a skewness (Pearson type III).

    That law ends on its short side. Where it does is not known from few values, so on that side no
    score is larger than that of a normal law.
    """
    skewed = np.abs(skewness) > LEAST_SKEWNESS
    g = np.where(skewed, np.abs(skewness), 1.0)
    sign = np.where(skewness < 0, -1.0, 1.0)
    # Wilson & Hilferty 1931: the cube root of a gamma variate is nearly normal, far into the tails
    shape = 4 / g**2
    level = np.maximum(1 + sign * standardised * g / 2, 0.0)
    score = (np.cbrt(level) - 1 + 1 / (9 * shape)) * 3 * np.sqrt(shape)
    score = sign * np.maximum(score, np.minimum(sign * standardised, 0.0))
    return np.asarray(np.where(skewed, score, standardised))


@dataclass(frozen=True, eq=False)
class Together:
    """All statistics together.

    Attributes
    ----------
    p_value : of the recording.
    numbers : effective number of statistics in each family.
    extrapolated : the p-value is smaller than the simulations alone can support.
    own : (simulations,) p-value of each simulation judged by all the others.
    """

    p_value: float
    numbers: tuple[float, ...]
    extrapolated: bool
    own: FloatArray


def together(p_values: FloatArray, own: FloatArray, families: list[NDArray[np.bool_]]) -> Together:
    """One p-value for all statistics.

    Parameters
    ----------
    p_values : (statistics,) of the recording. own : (simulations, statistics) of the simulations.
    families : which statistics belong together; every family gets the same share, so that a
        few pooled ones are not drowned by many single ones.
    """
    numbers, observed, simulated = [], [], []
    for family in families:
        if not family.any():
            continue
        smallest = own[:, family].min(axis=1)
        n = _effective_number(smallest)
        numbers.append(n)
        observed.append(_adjusted(np.array([p_values[family].min()]), n)[0])
        simulated.append(_adjusted(smallest, n))
    best = np.min(np.array(simulated), axis=0)
    final = _effective_number(best)
    p = float(_adjusted(np.array([min(observed)]), final)[0])
    return Together(p, tuple(numbers), p < 1 / (len(own) + 1), _adjusted(best, final))


def second_round_p_value(p_value: float, below: float, correlation: float) -> float:
    """p-value of a second round, simulated only where the first one's p-value is below a limit.

    Recordings whose first p-value is above the limit have no second round, so second p-values just
    below the limit would be too rare. Returned is the probability that p₁ is below the limit and p₂
    below its observed value, for jointly normal scores. Among recordings that have a second round
    it is uniform below the limit.

    Parameters
    ----------
    p_value : of the second round. below : limit of the first's.
    correlation : of both rounds' normal scores.
    """
    smaller = p_value * _EVENLY
    score = stats.norm.ppf(below) - correlation * stats.norm.ppf(smaller)
    first_too = stats.norm.cdf(score / np.sqrt(1 - correlation**2))
    return float(p_value * (_EVENLY_WEIGHTS @ first_too))


def rounds_correlation(own: FloatArray, again: FloatArray) -> float:
    """Correlation of the normal scores of two rounds, for the same simulations, 0 to below 1."""
    scores = stats.norm.ppf(np.clip([own, again], LEAST_OWN, 1 - LEAST_OWN))
    spread = scores.std(axis=1)
    if not spread.all():
        return 0.0
    return float(np.clip(np.corrcoef(scores)[0, 1], 0.0, MOST_ALIKE))


def _effective_number(smallest: FloatArray) -> float:
    """Maximum likelihood of n where 1 − (1 − p)^n is uniform, at least 1."""
    return max(1.0, -len(smallest) / float(np.sum(np.log1p(-np.minimum(smallest, 1 - 1e-12)))))


def _adjusted(p: FloatArray, number: float) -> FloatArray:
    return np.asarray(-special.expm1(number * np.log1p(-np.minimum(p, 1 - 1e-15))))
