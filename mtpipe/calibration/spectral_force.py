"""The force that the spectra of x and y give, and whether they contradict themselves.

x and y are two measurements of one force, from two stiffnesses and two levers. Together with the
friction, which is known from radius and viscosity, and with the shape of each spectrum they can
contradict themselves in three ways, without any knowledge of the tether.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from mtpipe.calibration.bead_results import AxisResult, BeadResult, PlateauResult
from mtpipe.calibration.recommended_force import BeadForces, RecommendedForce, Source
from mtpipe.calibration.scatter import scatter_beyond_errors
from mtpipe.calibration.series_choice import CONTRADICTION_P
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.types import FloatArray

METHOD = "spectra of x and y"
# A force whose 68 % interval reaches from half to twice its value is no number to use.
NO_NUMBER_FACTOR = 2.0


@dataclass(frozen=True)
class Contradictions:
    """How the spectra of x and y contradict the bead, or one another.

    Attributes
    ----------
    shape_p : chance of spectra so unlike those of a tethered bead, all lateral traces together.
    friction_ln : ln of the measured friction over the expected one, where these contradict each
        other; 0 where they do not.
    axes_ln : standard deviation of ln F_y/F_x over plateaus beyond its errors, where x and y
        contradict each other; 0 where they do not.
    known_ln : how well it is known that neither friction nor x and y contradict anything: standard
        error of ln force; infinite where either is not known.
    """

    shape_p: float
    friction_ln: float
    axes_ln: float
    known_ln: float

    @property
    def shape(self) -> bool:
        """Whether the spectra are those of no tethered bead, and their error is not known."""
        return self.shape_p < CONTRADICTION_P

    @property
    def ln_error(self) -> float:
        """Standard error of ln force that stands for them, where a cross-check finds no cause.

        A friction that is wrong is a wrong radius or viscosity, which no force follows, or a wrong
        lateral scale, which force and friction follow alike: an interval has to reach both. Of x
        and y, whose mean is taken, either may be the wrong one: it reaches both, too.
        """
        return math.hypot(self.friction_ln, self.axes_ln / 2)


def contradictions_of(bead: BeadResult) -> Contradictions:
    """What speaks against the spectra of x and y of a bead."""
    friction, friction_stderr = 0.0, math.inf
    if bead.friction_ratio is not None:
        friction_stderr = bead.friction_ratio.stderr / bead.friction_ratio.value
        if bead.friction_contradicts:
            friction = math.log(bead.friction_ratio.value)
    axes, axes_stderr = _axes_apart(bead.plateaus)
    known = math.hypot(friction_stderr, axes_stderr / 2)
    return Contradictions(_shape_p(bead), friction, axes, known)


def _shape_p(bead: BeadResult) -> float:
    """Chance of the deviances of the free fits, of their sum and of the worst."""
    fits = [one.free for one in _lateral(bead.plateaus) if one.free is not None]
    if not fits:
        return 1.0
    total = float(stats.chi2.sf(sum(f.deviance for f in fits), sum(f.dof for f in fits)))
    worst = min(f.p_value for f in fits) * len(fits)
    return min(2 * min(total, worst), 1.0)


def _axes_apart(plateaus: Sequence[PlateauResult]) -> tuple[float, float]:
    """Standard deviation of ln F_y/F_x beyond its errors, 0 where x and y agree, and the standard
    error of its mean.
    """
    pairs = [(x, y) for x, y in map(_pair, plateaus) if x is not None and y is not None]
    if not pairs:
        return 0.0, math.inf
    ln_ratio = np.array([math.log(y.value / x.value) for x, y in pairs])
    stderr = np.array([math.hypot(y.stderr / y.value, x.stderr / x.value) for x, y in pairs])
    pulls = ln_ratio / stderr
    scattered = float(stats.chi2.sf(pulls @ pulls, len(pulls)))
    common = float(stats.chi2.sf(pulls.sum() ** 2 / len(pulls), 1))
    mean_stderr = float(np.sum(stderr**-2.0)) ** -0.5
    if min(scattered, common) > CONTRADICTION_P:
        return 0.0, mean_stderr
    return scatter_beyond_errors(ln_ratio, stderr), mean_stderr


def _pair(plateau: PlateauResult) -> tuple[Estimate | None, Estimate | None]:
    """What x and y say of the force, each by itself."""
    alone = {one.axis: one.force_alone for one in plateau.axes if _is_number(one.force_alone)}
    return alone.get("x"), alone.get("y")


def _is_number(force: Estimate | None) -> bool:
    """Whether a force can be compared with others, be it one to use or not."""
    return force is not None and force.status in ("ok", "unlike_model") and force.value > 0


def forces_of_spectra(bead: BeadResult) -> BeadForces:
    """The forces to quote of a bead that was not cross-checked."""
    return BeadForces(chosen_of(bead, {}, "none", spectral_forces(bead)))


def chosen_of(
    bead: BeadResult,
    first: Mapping[int, Estimate],
    source: Source,
    spectra: Mapping[int, Estimate],
) -> dict[int, RecommendedForce]:
    """Of each plateau the first choice where there is one, else what x and y tell."""
    chosen = {}
    plateaus = {one.plateau.number: one for one in bead.plateaus}
    for number in sorted({*plateaus, *first}):
        if number in first:
            one = RecommendedForce(first[number], source)
        elif number in spectra:
            one = RecommendedForce(spectra[number], "spectra")
        else:
            one = RecommendedForce(_no_force(plateaus[number]), "none")
        one = RecommendedForce(_number_or_none(one.force), one.source)
        if number in plateaus and plateaus[number].not_one_state and one.source != "named":
            one = RecommendedForce(replace(one.force, status="not_one_state"), one.source)
        chosen[number] = one
    return chosen


def _no_force(plateau: PlateauResult) -> Estimate:
    """Without a force, with the word of its traces; a stiffness may be good where z is unknown."""
    missing, word = Estimate.missing("pN", ""), plateau.force_status
    return missing if word == "ok" else replace(missing, status=word)


def _number_or_none(force: Estimate) -> Estimate:
    """The force; one that is not known to a factor is no number, and its interval what is known."""
    low, high = force.interval
    if force.status != "ok" or high < NO_NUMBER_FACTOR**2 * low:
        return force
    return Estimate.missing("pN", force.method, interval=force.interval)


def spectral_forces(bead: BeadResult) -> dict[int, Estimate]:
    """By plateau number, the force of x and y, with what these contradict one another by."""
    error = contradictions_of(bead).axes_ln / 2
    return {
        plateau.plateau.number: force.widened(error)
        for plateau in bead.plateaus
        if (force := spectral_force(plateau)) is not None
    }


def spectral_force(plateau: PlateauResult) -> Estimate | None:
    """The force from x and y together; None where neither has one.

    Where each has a force of its own it is their mean by ln, weighted by what each knows by itself;
    of forces that are not all to be used, of those that are.
    """
    numbers = [one for one in plateau.axes if one.axis != "z" and _is_number(one.force)]
    forces = [one for one in numbers if plateau.status(one) == "ok"] or numbers
    told = [one.force for one in forces if one.force is not None]
    if not told:
        force = next((one.force for one in plateau.axes if one.force is not None), None)
    elif len(told) == 1 or all(one.shares_force for one in forces):
        force = told[0]
    else:
        force = _mean(told, np.array([_own_ln_error(one) for one in forces]))
    return None if force is None else replace(force, status=plateau.force_status)


def _own_ln_error(one: AxisResult) -> float:
    """Relative error of the stiffness alone, which no other axis shares."""
    if one.posterior is None or one.force is None:
        return math.inf
    return one.posterior.stiffness.stderr / one.posterior.stiffness.value


def _mean(forces: Sequence[Estimate], own: FloatArray) -> Estimate:
    total = np.array([force.stderr / force.value for force in forces])
    # what both share (kT, z = 0, exposure) does not average out
    common = float(np.sqrt(np.maximum(total**2 - own**2, 0.0).min()))
    weight = own**-2.0 / np.sum(own**-2.0)
    ln = float(weight @ np.log([force.value for force in forces]))
    return of_ln(ln, math.hypot(float(np.sum(own**-2.0)) ** -0.5, common), METHOD)


def of_ln(ln_force: float, ln_stderr: float, method: str) -> Estimate:
    """A force from its ln and the standard error of that."""
    value = math.exp(ln_force)
    interval = (value * math.exp(-ln_stderr), value * math.exp(ln_stderr))
    return Estimate(value, value * ln_stderr, interval, "pN", method)


def _lateral(plateaus: Sequence[PlateauResult]) -> list[AxisResult]:
    return [one for plateau in plateaus for one in plateau.axes if one.axis != "z"]
