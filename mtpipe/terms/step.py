"""A tracker that answers otherwise from some plateau on: another gain of an axis, or more scatter.

The image of a bead changes as it turns, or as the focus is moved, and with it what is recorded of
its motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain, variance
from mtpipe.experiment.changes import with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import Parameter
from mtpipe.experiment.step import NothingByItself, Place
from mtpipe.terms.mixing import LARGEST, Gain
from mtpipe.terms.term import (
    AXES,
    of_axis,
    of_square,
    set_to,
)
from mtpipe.terms.white import LARGEST_NM, START_NM, WhitePower


@dataclass(frozen=True)
class _FromPlateau(NothingByItself):
    """Something that is so from a plateau on (an index), and not before."""

    form: ClassVar[str] = "step"
    axis: int
    first: int


@dataclass(frozen=True)
class GainFrom(_FromPlateau):
    """From a plateau on, motion along an axis is recorded e^ln_gain times as large."""

    place: ClassVar[Place] = "optics"
    ln_gain: float = 0.0

    def in_plateau(self, plateau: int) -> Gain:
        """What it is in one plateau."""
        return Gain(self.axis, 1.0, self.ln_gain if plateau >= self.first else 0.0)

    @property
    def words(self) -> str:
        """Factor, and since when."""
        return (
            f"motion along {AXES[self.axis]} is recorded {math.exp(self.ln_gain):.3f} times as "
            f"large from plateau {self.first + 1} of those fitted on"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Factor, and the index of the plateau with which it begins."""
        return [("factor", math.exp(self.ln_gain), ""), ("first_plateau", self.first, "")]


@dataclass(frozen=True)
class ScatterFrom(_FromPlateau):
    """From a plateau on, the record scatters along an axis by `size_nm` more."""

    place: ClassVar[Place] = "tracker"
    size_nm: float = 0.0

    def in_plateau(self, plateau: int) -> WhitePower:
        """What it is in one plateau."""
        return WhitePower(self.axis, 1.0, self.size_nm if plateau >= self.first else 0.0)

    @property
    def words(self) -> str:
        """Scatter, and since when."""
        return (
            f"{AXES[self.axis]} scatters by {self.size_nm:.2g} nm more from frame to frame from "
            f"plateau {self.first + 1} of those fitted on"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Scatter, and the index of the plateau with which it begins."""
        return [("size_nm", self.size_nm, "nm"), ("first_plateau", self.first, "")]


def gain_along(axis: int) -> Effect:
    """Another gain of one axis."""
    return of_axis(f"gain_step_{AXES[axis]}", GainFrom, axis, partial(_gains, axis))


def scatter_along(axis: int) -> Effect:
    """More scatter of one axis."""
    return of_axis(f"scatter_step_{AXES[axis]}", ScatterFrom, axis, partial(_scatters, axis))


def _gains(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    name, change = f"ln of the later gain along {AXES[axis]}", set_to(GainFrom, axis, "ln_gain")
    size = plain(name, "", 0.0, (-LARGEST, LARGEST), 1e-3, change)
    return _each([with_step(experiment, GainFrom(axis, k)) for k in _later(evidence)], size)


def _scatters(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    change = of_square(ScatterFrom, axis, "size_nm")
    size = variance(f"later scatter along {AXES[axis]}", "nm", START_NM, LARGEST_NM, change)
    begun = [with_step(experiment, ScatterFrom(axis, k, START_NM)) for k in _later(evidence)]
    return _each(begun, size)


def _later(evidence: Evidence) -> range:
    """Plateaus with which something may begin."""
    return range(1, len(evidence.force_pN))


def _each(begun: list[Experiment], size: Parameter) -> list[Hypothesis]:
    return [Hypothesis(one, (size,), chosen_from=len(begun)) for one in begun]
