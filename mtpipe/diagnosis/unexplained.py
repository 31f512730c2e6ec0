"""What is left where no effect of the catalogue explains a recording: place, size and shape.

Four things are said. Of spectra, the smooth factor that the recording asks for
(`mtpipe.diagnosis.smooth_correction`), and what it does to the forces when it is free: a force then
lies between the fit and the corrected fit, give or take the error. Of what is no matter of
frequency (a distribution, a course of time, a narrow line), the statistics that show it,
with the recorded value beside the simulated ones, and of courses and distributions a smooth curve
and what it leaves open about the force (`left_in_time`, `left_in_distribution`). Of heights,
whether they are as if z's scale changed at one (`bent_scale`). Of the catalogue, the effect that
came nearest, and why it was rejected; in words only where it would be most of the answer, since
what explains a part is seldom what is there.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from mtpipe.crosschecking.battery.catalogue import KINDS
from mtpipe.crosschecking.check import BeadCheck
from mtpipe.diagnosis.bent_scale import Bend, Beside, bend_beside
from mtpipe.diagnosis.heldout import MOST_OF_IT, share_gone
from mtpipe.diagnosis.left_in_distribution import LeftInDistribution, left_in_distribution
from mtpipe.diagnosis.left_in_time import LeftInTime, left_in_time
from mtpipe.diagnosis.size_words import capital, compared
from mtpipe.diagnosis.smooth_correction import (
    AxisCorrection,
    Place,
    SmoothCorrection,
    smooth_correction,
    spectra_of,
)
from mtpipe.diagnosis.smooth_fit import Spectra
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.hypotheses import FittedEffect
from mtpipe.recording.recording import AXES

# Statistics that a smooth correction of the spectrum is about.
SPECTRAL = (
    "psd_band", "allan_variance", "stiffness", "friction", "stiffness_along_series",
    "friction_along_series",
)  # fmt: skip
ODD_P, MOST_SAID = 1e-3, 2
# Distance from none, in standard errors, from which a plateau's own correction is mentioned.
CLEAR = 3.0
INTERVAL_95 = (0.025, 0.975)


@dataclass(frozen=True, eq=False, repr=False)
class Rejected:
    """An effect of the catalogue that is not named, and why, in words that continue "which …".

    `instead` : a bend of z's scale that does as well.
    """

    tried: FittedEffect
    reason: str
    instead: Bend | None = None

    def __repr__(self) -> str:
        return f"Rejected {self.tried.effect.name}, which {self.reason}"


@dataclass(frozen=True, eq=False, repr=False)
class Unexplained:
    """What is left of a bead's mismatch.

    Attributes
    ----------
    check : with all that is named. beside : whether anything is.
    nearest : the effect that came nearest; None if none could be tried.
    spectra : recorded beside expected power. correction : of the spectra; None if none is needed.
    bend : of z's scale, where that would explain most of it, or as much as an effect that
        does.
    """

    check: BeadCheck
    beside: bool
    nearest: Rejected | None
    spectra: Spectra
    correction: SmoothCorrection | None
    bend: Beside | None = None

    def __repr__(self) -> str:
        return f"Unexplained of {self.check.case.bead}: {self.sentence}"

    @functools.cached_property
    def contradicting(self) -> tuple[int, ...]:
        """Indices of the statistics that differ most and that the correction is not about, the most
        significant first; of each kind one.
        """
        kinds: dict[tuple[str, str], int] = {}
        for i in np.argsort(self.check.p_values, kind="stable").tolist():
            statistic = self.check.statistics[i]
            if self.correction is None or statistic.kind not in SPECTRAL:
                odd = self.check.p_values[i] < ODD_P
                if odd or (self.correction is None and not kinds):
                    kinds.setdefault((statistic.kind, statistic.axis), i)
        return tuple(kinds.values())[:MOST_SAID]

    @functools.cached_property
    def shapes(self) -> tuple[LeftInTime | LeftInDistribution, ...]:
        """Courses of time and distributions that the statistics are about, each once."""
        found: dict[tuple[str, int, int], LeftInTime | LeftInDistribution] = {}
        for i in self.contradicting:
            statistic = self.check.statistics[i]
            one = left_in_time(self.check, statistic) or left_in_distribution(self.check, statistic)
            if one is not None:
                found.setdefault((one.kind, one.axis, one.plateau), one)
        return tuple(found.values())

    @property
    def sentence(self) -> str:
        """All of it in words."""
        opening = (
            "The causes found do not explain all of the difference from the simulation."
            if self.beside
            else "No effect in the catalogue explains the difference from the simulation."
        )
        spectral = [] if self.correction is None else self._of_spectra(self.correction)
        said = [capital(self._of_statistic(i)) + "." for i in self.contradicting]
        said += [
            f"In plateau {self.number(one.plateau)}, along {AXES[one.axis]}, {one.words}."
            for one in self.shapes
        ]
        first = int(np.argmin(self.check.p_values))
        inner = said + spectral if first in self.contradicting else spectral + said
        if self.bend is not None:
            inner.insert(0, self._of_heights(self.bend))
        closing = [] if self.nearest or self.beside else ["No effect could be tried."]
        if self.nearest is not None and self.nearest_share >= MOST_OF_IT:
            name = self.nearest.tried.effect.name
            closing = [f"Nearest, but not named, is {name}: it {self.nearest.reason}."]
        return " ".join([opening, *inner, *closing])

    @functools.cached_property
    def nearest_share(self) -> float:
        """Share of the misfit that the nearest effect would explain; 0 without any."""
        if self.nearest is None:
            return 0.0
        return max(share_gone(self.check.case.fit, self.nearest.tried.fit), 0.0)

    def _of_heights(self, beside: Beside) -> str:
        fit = beside.bend.fit
        shift = np.log(fit.force_pN / self.check.case.fit.force_pN)
        stderr = fit.force_stderr_pN / fit.force_pN
        worst = int(np.argmax(np.abs(shift)))
        changed = compared(float(shift[worst]), float(stderr[worst]), "higher", "lower")
        return (
            f"Heights fit better with {beside.bend.words} (ln likelihood higher by "
            f"{beside.gain:.0f}); forces would then be up to {changed} "
            f"(plateau {self.number(worst)})."
        )

    def _of_spectra(self, correction: SmoothCorrection) -> list[str]:
        sentences = []
        for one in correction.axes:
            number, place = strongest(correction, one)
            where = "at all forces"
            if not one.common:
                clear = [self.number(k) for k in also_deviating(correction, one)]
                where = f"in plateau{'s' if len(clear) > 1 else ''} {', '.join(map(str, clear))}"
                if len(clear) > 1:
                    where += f" (most clearly in {self.number(number)})"
            sentences.append(
                f"Between {place.band_hz[0]:.3g} and {place.band_hz[1]:.3g} Hz along "
                f"{AXES[one.axis]} the recorded power is {_size(place)} what is simulated, {where}."
            )
        shift, stderr = correction.ln_force_shift, correction.ln_force_stderr
        worst = int(np.argmax(np.abs(shift) + stderr))
        if abs(shift[worst]) + stderr[worst] < 0.005:
            sentences.append("A fit that allows for it gives the same forces within 0.5 %.")
        else:
            sentences.append(
                f"In a fit that allows for it, forces are up to "
                f"{compared(float(shift[worst]), float(stderr[worst]), 'higher', 'lower')} "
                f"(plateau {self.number(worst)})."
            )
        return sentences

    def simulated(self, i: int) -> tuple[float, float, float]:
        """Median and central 95 % of a statistic's simulated values."""
        low, median, high = np.quantile(
            self.check.simulated[:, i], [INTERVAL_95[0], 0.5, INTERVAL_95[1]]
        )
        return float(median), float(low), float(high)

    def number(self, plateau: int) -> int:
        """Of a plateau, by its index."""
        return self.check.case.plateaus[plateau].number

    def _of_statistic(self, i: int) -> str:
        statistic, value = self.check.statistics[i], float(self.check.observed[i])
        what = KINDS[statistic.kind].words
        parts = [f"along {' and '.join(statistic.axis)}"] if statistic.axis else []
        parts.append(
            "over all plateaus"
            if statistic.pooled
            else f"in plateau {self.number(statistic.plateaus[0])}"
        )
        if statistic.band_hz is not None:
            parts.append(f"at {statistic.band_hz[0]:.3g} to {statistic.band_hz[1]:.3g} Hz")
        if statistic.time_s is not None:
            parts.append(f"from {statistic.time_s[0]:.3g} to {statistic.time_s[1]:.3g} s")
        median, low, high = self.simulated(i)
        return (
            f"{what} {' '.join(parts)} is {value:.3g}; simulations give {median:.3g} "
            f"(95 % of them {low:.3g} to {high:.3g})"
        )


def unexplained(check: BeadCheck, nearest: Rejected | None, *, beside: bool) -> Unexplained:
    """Fit the smooth correction, and a bend of z's scale, to what a check leaves.

    Parameters
    ----------
    check : with all that is named. beside : whether anything is.
    """
    spectra = spectra_of(check.case.fit)
    rival = None if nearest is None else nearest.instead
    bend = bend_beside(check.case.fit, rival)
    told = bend if bend is not None and (rival is not None or bend.explains_most) else None
    return Unexplained(check, beside, nearest, spectra, smooth_correction(spectra), told)


def strongest(correction: SmoothCorrection, one: AxisCorrection) -> tuple[int, Place]:
    """The curve of an axis that is farthest from none in standard errors, and where."""
    places = [correction.place(one, k) for k in range(len(one.coefficients))]
    k = int(np.argmax([abs(place.ln) / max(place.stderr, 1e-12) for place in places]))
    return k, places[k]


def also_deviating(correction: SmoothCorrection, one: AxisCorrection) -> list[int]:
    """Plateaus that clearly differ where the strongest curve does, and to the same side."""
    number, place = strongest(correction, one)
    found = []
    for k in range(len(one.coefficients)):
        ln, stderr = correction.mean(one, k, place.band_hz)
        if k == number or ln * np.sign(place.ln) > CLEAR * stderr:
            found.append(k)
    return found


def ln_force_bounds(correction: SmoothCorrection) -> tuple[FloatArray, FloatArray]:
    """(plateaus,) lowest and highest ln of a force over the fitted one: from the fit to the
    corrected fit, and one standard error of the latter beyond.
    """
    shift, stderr = correction.ln_force_shift, correction.ln_force_stderr
    return np.minimum(shift, 0.0) - stderr, np.maximum(shift, 0.0) + stderr


def _size(place: Place) -> str:
    return compared(place.ln, place.stderr, "above", "below", much="times")
