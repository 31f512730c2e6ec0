"""The relative error of a force, by its causes."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields


@dataclass(frozen=True)
class ForceError:
    """Relative errors of a force, each positive but the first two; inf: the method gives no force.

    Attributes
    ----------
    bias : of the method, expected stiffness over the truth minus 1.
    tilt : of the lever; where the bead tilts, the mean of z is short of the tether's end.
    statistics : the trace's length, if friction were known exactly and nothing else disturbed.
    friction : what not knowing the friction, or not exactly, adds.
    noise : what tracking noise adds.
    exposure : from the exposure's standard error.
    lever : from the mean extension and the radius, by which stiffness becomes force.
    temperature : from the temperature's standard error.
    """

    bias: float = 0.0
    tilt: float = 0.0
    statistics: float = 0.0
    friction: float = 0.0
    noise: float = 0.0
    exposure: float = 0.0
    lever: float = 0.0
    temperature: float = 0.0

    @property
    def scatter(self) -> float:
        """Standard error: all but the biases."""
        return math.hypot(*(getattr(self, part.name) for part in fields(self)[2:]))

    @property
    def shift(self) -> float:
        """Expected force over the truth, minus 1."""
        return (1 + self.bias) * (1 + self.tilt) - 1

    @property
    def total(self) -> float:
        """Root-mean-square error."""
        return math.hypot(self.shift, self.scatter)

    @property
    def largest(self) -> str:
        """The largest cause."""
        return max((part.name for part in fields(self)), key=lambda name: abs(getattr(self, name)))


NO_FORCE = ForceError(bias=math.inf)


def left_in_quadrature(whole: float, part: float) -> float:
    """The error that makes the whole of a part, in quadrature."""
    return math.sqrt(max(whole**2 - part**2, 0.0))
