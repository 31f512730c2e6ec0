"""Look-up table whose answer to height is a curve of its own (PHYSICS E28).

Recorded is G(z − f) with the focus f, own to each bead, so that heights are off and z is too large
or too small by as much as the curve is steeper or flatter than it should be: another at each height
and at each position of the focus. The curve is unknown but smooth. Seen it is where the focus is
moved, as a line that is wrong all along is a wrong scale (`axial_scale`).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mtpipe.effects.drift import along
from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.changed import changed
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import Parameter
from mtpipe.experiment.step import NothingByItself, Place, Seen
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera

# Prior standard deviation of the slope of a table's error (nm per nm): real ones reach a third.
SLOPE = 0.15
# Correlation lengths of the error in height that are tried (nm).
LENGTHS_NM = (60.0, 150.0, 400.0, 1000.0)
# Prior standard deviation of the error common to all heights of one focus (nm): the reference beads
# have errors of their own.
COMMON_NM = 100.0
# Independent errors of mean (nm) and slope in one plateau: the curve bends over the bead's range.
BENT_NM, BENT_SLOPE = 3.0, 0.02
# Least errors of mean (nm) and slope that matter: those of a plateau are not known better.
LEAST_NM, LEAST_SLOPE = 0.5, 0.005
# Bound of each coefficient, in standard deviations of its prior.
BOUND = 6.0


@dataclass(frozen=True)
class OnePlateau:
    """z of a plateau is recorded `scale` times as large about its mean, which is off."""

    place: ClassVar[Place] = "optics"
    offset_nm: float
    scale: float

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """Power of z, what it has in common with x and y, and its mean."""
        scaled = seen.through(np.diag([1.0, 1.0, self.scale]))
        return changed(scaled, height_nm=seen.height_nm + self.offset_nm)

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """z about its mean."""
        scaled = position_nm.copy()
        mean = position_nm[:, 2].mean()
        scaled[:, 2] = mean + self.offset_nm + self.scale * (position_nm[:, 2] - mean)
        return scaled


@dataclass(frozen=True)
class Response(NothingByItself):
    """Errors of heights and of their slopes in all plateaus.

    Attributes
    ----------
    shapes : offset and slope of each plateau in turn, in each of the independent forms that a
        smooth curve has there. sizes : of these forms.
    """

    place: ClassVar[Place] = "optics"
    shapes: tuple[tuple[float, ...], ...]
    sizes: tuple[float, ...]

    def in_plateau(self, plateau: int) -> OnePlateau:
        """What it is in one plateau."""
        offset, slope = np.asarray(self.shapes[2 * plateau : 2 * plateau + 2]) @ self.sizes
        return OnePlateau(float(offset), 1.0 + float(slope))

    @property
    def each(self) -> list[OnePlateau]:
        """Steps of all plateaus."""
        return [self.in_plateau(i) for i in range(len(self.shapes) // 2)]


def _sized(experiment: Experiment, value: float, *, form: int) -> Experiment:
    step = step_of(experiment, Response)
    assert step is not None
    sizes = (*step.sizes[:form], value, *step.sizes[form + 1 :])
    return with_step(experiment, changed(step, sizes=sizes))


def smooth_curves(heights_nm: FloatArray, focus: tuple[int, ...], length_nm: float) -> FloatArray:
    """(2n, 2n) covariance of offset (nm) and slope of a smooth curve in each of n plateaus, a curve
    of its own for each focus.

    A Gaussian process with e^(−d²/2ℓ²); slopes are its derivative (Rasmussen & Williams 2006,
    section 9.4).
    """
    apart = (heights_nm[:, None] - heights_nm) / length_nm
    alike = SLOPE**2 * np.exp(-(apart**2) / 2) * np.equal.outer(focus, focus)
    n = len(heights_nm)
    found = np.empty((n, 2, n, 2))
    found[:, 0, :, 0] = length_nm**2 * alike + COMMON_NM**2 * np.equal.outer(focus, focus)
    found[:, 0, :, 1] = length_nm * apart * alike
    found[:, 1, :, 0] = -length_nm * apart * alike
    found[:, 1, :, 1] = (1 - apart**2) * alike
    return found.reshape(2 * n, 2 * n)


def _hypotheses(experiment: Experiment, evidence: Evidence | None) -> list[Hypothesis]:
    if evidence is None or len(set(evidence.focus)) < 2 or step_of(experiment, Response):
        return []
    return [_hypothesis(experiment, evidence, length_nm) for length_nm in LENGTHS_NM]


def _hypothesis(experiment: Experiment, evidence: Evidence, length_nm: float) -> Hypothesis:
    heights = np.array(evidence.heights_nm)
    unit = np.tile([LEAST_NM, LEAST_SLOPE], len(heights))
    bent = np.diag(np.tile([BENT_NM, BENT_SLOPE], len(heights)) ** 2)
    covariance = smooth_curves(heights, evidence.focus, length_nm) + bent
    covariance /= np.outer(unit, unit)
    spread, forms = np.linalg.eigh(covariance)
    there = spread > 1
    shapes = unit[:, None] * forms[:, there] * np.sqrt(spread[there])
    count = int(there.sum())
    step = Response(tuple(map(tuple, shapes.tolist())), (0.0,) * count)
    parameters = tuple(
        Parameter(
            f"z response, number {k + 1}", "", 0.0, -BOUND, BOUND, 1e-3, (0.0, 1.0),
            functools.partial(_sized, form=k),
        )
        for k in range(count)
    )  # fmt: skip
    return Hypothesis(
        with_step(experiment, step),
        # the stage's motion is subtracted with another slope than it is recorded with: some is left
        (*parameters, along(2, "z")),
        chosen_from=len(LENGTHS_NM),
        given=count,
        learned_nats=0.5 * float(np.log(spread[there]).sum()),
    )


def _cause(experiment: Experiment) -> str:
    off, steepest = _largest(experiment)
    return (
        "the look-up table does not follow the height in a straight line, and differently at each "
        f"position of the focus: heights are off by up to {off:.0f} nm, and z is recorded "
        f"too large or too small by up to {100 * steepest:.0f} %"
    )


def _largest(experiment: Experiment) -> tuple[float, float]:
    step = step_of(experiment, Response)
    each = [] if step is None else step.each
    off = max((abs(one.offset_nm) for one in each), default=0.0)
    return off, max((abs(one.scale - 1) for one in each), default=0.0)


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    off, steepest = _largest(experiment)
    return [("offset_nm", off, "nm"), ("slope_error", steepest, "")]


_REMEDY = (
    "make a look-up table for each bead, at the focus that is used, and leave the focus alone; "
    "forces of x and y stand without z."
)
EFFECT = Effect("z_response", _hypotheses, _cause, _strengths, remedy=_REMEDY)
