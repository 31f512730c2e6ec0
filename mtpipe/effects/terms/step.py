"""What is otherwise from some plateau on: the gain of an axis, a share of one in another, its
scatter, or how it wanders.

The image of a bead changes as it turns, or as the focus is moved, and with it what is recorded of
its motion. A stage settles, and beads in one field do not follow it alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain, variance
from mtpipe.effects.terms.mixing import LARGEST, Gain, Share
from mtpipe.effects.terms.power_law import LARGEST_NM as MOST_WANDERED_NM
from mtpipe.effects.terms.power_law import START_SLOPE, PowerLaw, times_of
from mtpipe.effects.terms.term import AXES, OneOrPair, axis_name, of_axis, of_square, set_to
from mtpipe.effects.terms.white import LARGEST_NM, START_NM, WhitePower
from mtpipe.experiment.changes import with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import Parameter
from mtpipe.experiment.step import NothingByItself, Place

# Bounds of a wander's power of the frequency: 2 is that of a random walk.
STEEPNESS = 0.3, 2.0


@dataclass(frozen=True)
class _FromPlateau(NothingByItself):
    """Something that is so from a plateau on (an index), and not before."""

    form: ClassVar[str] = "step"
    axis: OneOrPair
    first: int


@dataclass(frozen=True)
class GainFrom(_FromPlateau):
    """From a plateau on, motion along an axis is recorded e^ln_gain times as large."""

    place: ClassVar[Place] = "optics"
    axis: int
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
class ShareFrom(_FromPlateau):
    """From a plateau on, along an axis a share of the motion along another is recorded."""

    place: ClassVar[Place] = "optics"
    axis: tuple[int, int]
    share: float = 0.0

    def in_plateau(self, plateau: int) -> Share:
        """What it is in one plateau."""
        return Share(self.axis, 1.0, self.share if plateau >= self.first else 0.0)

    @property
    def words(self) -> str:
        """Share, and since when."""
        into, other = (AXES[i] for i in self.axis)
        return (
            f"{into} contains {self.share:+.3f} more of the motion along {other} from plateau "
            f"{self.first + 1} of those fitted on"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Share, and the index of the plateau with which it begins."""
        return [("share", self.share, ""), ("first_plateau", self.first, "")]


@dataclass(frozen=True)
class ScatterFrom(_FromPlateau):
    """From a plateau on, the record scatters along an axis by `size_nm` more."""

    place: ClassVar[Place] = "tracker"
    axis: int
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


@dataclass(frozen=True)
class WanderFrom(_FromPlateau):
    """From a plateau on, or up to it, an axis wanders more: power that goes as f^−slope.

    `size_nm` : as of `PowerLaw`.
    """

    place: ClassVar[Place] = "tether"
    axis: int
    times_s: tuple[float, ...] = ()
    size_nm: float = 0.0
    slope: float = START_SLOPE
    later: bool = True

    def in_plateau(self, plateau: int) -> PowerLaw:
        """What it is in one plateau."""
        size_nm = self.size_nm if (plateau >= self.first) == self.later else 0.0
        return PowerLaw(self.axis, 1.0, size_nm, self.times_s, self.slope)

    @property
    def words(self) -> str:
        """Size, and since or until when."""
        place = (
            f"from plateau {self.first + 1} of those fitted on"
            if self.later
            else f"up to plateau {self.first} of those fitted"
        )
        return (
            f"{AXES[self.axis]} wanders more {place}: by {self.size_nm:.2g} nm around 1 Hz, its "
            f"power going as f^−{self.slope:.1f}"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Size, power of the frequency, and the first or the last plateau that has it."""
        place = ("first_plateau", self.first) if self.later else ("last_plateau", self.first - 1)
        return [("size_nm", self.size_nm, "nm"), ("slope", self.slope, ""), (*place, "")]


def gain_along(axis: int) -> Effect:
    """Another gain of one axis."""
    return of_axis(f"gain_step_{AXES[axis]}", GainFrom, axis, partial(_gains, axis))


def share_in(into: int, other: int) -> Effect:
    """Another share of one axis in another."""
    pair = (into, other)
    name = f"share_step_{AXES[other]}_in_{AXES[into]}"
    return of_axis(name, ShareFrom, pair, partial(_shares, pair))


def scatter_along(axis: int) -> Effect:
    """More scatter of one axis."""
    return of_axis(f"scatter_step_{AXES[axis]}", ScatterFrom, axis, partial(_scatters, axis))


def wander_along(axis: int) -> Effect:
    """More wandering of one axis."""
    return of_axis(f"wander_step_{AXES[axis]}", WanderFrom, axis, partial(_wanders, axis))


def _gains(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    name, change = f"ln of the later gain along {AXES[axis]}", set_to(GainFrom, axis, "ln_gain")
    size = plain(name, "", 0.0, (-LARGEST, LARGEST), 1e-3, change)
    return _each([with_step(experiment, GainFrom(axis, k)) for k in _later(evidence)], size)


def _shares(pair: tuple[int, int], experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    name, change = f"later share of {axis_name(pair)}", set_to(ShareFrom, pair, "share")
    size = plain(name, "", 0.0, (-LARGEST, LARGEST), 1e-3, change)
    return _each([with_step(experiment, ShareFrom(pair, k)) for k in _later(evidence)], size)


def _scatters(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    change = of_square(ScatterFrom, axis, "size_nm")
    size = variance(f"later scatter along {AXES[axis]}", "nm", START_NM, LARGEST_NM, change)
    begun = [with_step(experiment, ScatterFrom(axis, k, START_NM)) for k in _later(evidence)]
    return _each(begun, size)


def _wanders(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    name, times_s = f"later wandering along {AXES[axis]}", times_of(experiment)
    size = variance(name, "nm", START_NM, MOST_WANDERED_NM, of_square(WanderFrom, axis, "size_nm"))
    change = set_to(WanderFrom, axis, "slope")
    slope = plain(f"slope of {name}", "", START_SLOPE, STEEPNESS, 1e-3, change)
    begun = [
        with_step(experiment, WanderFrom(axis, k, times_s, START_NM, later=later))
        for later in (True, False)
        for k in _later(evidence)
    ]
    return _each(begun, size, slope)


def _later(evidence: Evidence) -> range:
    """Plateaus with which something may begin."""
    return range(1, len(evidence.force_pN))


def _each(begun: list[Experiment], *sizes: Parameter) -> list[Hypothesis]:
    return [Hypothesis(one, sizes, chosen_from=len(begun)) for one in begun]
