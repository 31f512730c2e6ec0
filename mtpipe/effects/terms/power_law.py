"""Power that goes as a power of the frequency, as flicker noise does: of one axis, or of all.

Of one axis it may go with the force, as what the tether or the optics do does. What all axes have
with one power of the frequency is the instrument's, and is the same at all forces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain, variance
from mtpipe.effects.terms.term import (
    AXES,
    ByStretches,
    Modes,
    grows,
    law,
    of_axis,
    of_square,
    relative,
    set_to,
    typical_force_pN,
)
from mtpipe.experiment.changed import changed, with_root
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment, Triple
from mtpipe.experiment.step import Place, Seen
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera

START_NM, LARGEST_NM = 2.0, 300.0
# Steeper is a random walk, an effect of its own; flatter is white.
SLOPES, START_SLOPE = (0.3, 1.7), 1.0
# Ratio of the times of neighbouring modes: their sum is a power law to 3 %.
RATIO = 4.0
# Least relaxation time of the slowest mode, over the longest plateau.
SLOWEST = 3.0


@dataclass(frozen=True)
class PowerLaw(Modes):
    """Along an axis the power goes as f^−slope, from modes of all times between two.

    `size_nm` is the standard deviation within one factor e of relaxation times around a second.
    """

    place: ClassVar[Place] = "tether"
    form: ClassVar[str] = "power_law"
    axis: int
    at_pN: float
    size_nm: float
    times_s: tuple[float, ...]
    slope: float = START_SLOPE
    exponent: float = 0.0

    def modes(self, force_pN: float) -> tuple[FloatArray, FloatArray]:
        """One of each time."""
        times_s = np.asarray(self.times_s)
        at_force = self.size_nm**2 * math.log(RATIO) * times_s ** (self.slope - 1)
        return times_s, float(relative(force_pN, self.at_pN, self.exponent)) * at_force

    @property
    def words(self) -> str:
        """Power of the frequency, size, and how it goes with the force."""
        return (
            f"{AXES[self.axis]} has power that goes as f^−{self.slope:.1f}, {self.size_nm:.2g} nm "
            f"around 1 Hz at {self.at_pN:.2g} pN, {grows(self.exponent)}"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Size at F₀, and both powers."""
        return [
            ("size_nm", self.size_nm, "nm"),
            ("slope", self.slope, ""),
            ("exponent", self.exponent, ""),
        ]


@dataclass(frozen=True)
class PowerLawOfAll(ByStretches):
    """As `PowerLaw` along each axis, `size_nm` of each, with one slope and at all forces."""

    place: ClassVar[Place] = "tether"
    form: ClassVar[str] = "power_law"
    axis: ClassVar[None] = None
    size_nm: Triple
    times_s: tuple[float, ...]
    slope: float = START_SLOPE

    @property
    def _each(self) -> list[PowerLaw]:
        return [
            PowerLaw(axis, 1.0, size_nm, self.times_s, self.slope)
            for axis, size_nm in enumerate(self.size_nm)
        ]

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """The modes of all axes besides."""
        for one in self._each:
            seen = one.expected(seen, force_pN, thermal_energy_pN_nm)
        return seen

    def in_stretch(
        self, position_nm: FloatArray, force_pN: float, camera: Camera, random: np.random.Generator
    ) -> FloatArray:
        """One axis after the other."""
        for one in self._each:
            position_nm = one.in_stretch(position_nm, force_pN, camera, random)
        return position_nm

    @property
    def words(self) -> str:
        """Power of the frequency, and the sizes."""
        x, y, z = self.size_nm
        return (
            f"x, y and z have power that goes as f^−{self.slope:.1f}, {x:.2g}, {y:.2g} and "
            f"{z:.2g} nm around 1 Hz at all forces"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Size of each axis, and the power."""
        each = [(f"size_{a}_nm", size, "nm") for a, size in zip(AXES, self.size_nm, strict=True)]
        return [*each, ("slope", self.slope, "")]


def along(axis: int) -> Effect:
    """The term of one axis."""
    return of_axis(f"power_law_{AXES[axis]}", PowerLaw, axis, partial(_begun, axis))


def of_all() -> Effect:
    """The term of all axes."""
    return of_axis("power_law", PowerLawOfAll, None, _begun_of_all)


def times_of(experiment: Experiment) -> tuple[float, ...]:
    """Relaxation times of the modes: from a frame's to a few of the longest plateau's."""
    frame_s = experiment.camera.frame_s
    longest_s = frame_s * max((rest.frames for rest in experiment.rests), default=1)
    fastest_s, slowest_s = frame_s / (2 * math.pi), SLOWEST * max(longest_s, 10 * frame_s)
    count = math.ceil(math.log(slowest_s / fastest_s) / math.log(RATIO))
    return tuple(fastest_s * RATIO**k for k in range(count + 1))


def _begun(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    start = PowerLaw(axis, typical_force_pN(evidence), START_NM, times_of(experiment))
    size = of_square(PowerLaw, axis, "size_nm")
    name = f"power law along {AXES[axis]}"
    slope = set_to(PowerLaw, axis, "slope")
    return [
        Hypothesis(
            with_step(experiment, start),
            (
                variance(name, "nm", START_NM, LARGEST_NM, size),
                plain(f"slope of {name}", "", START_SLOPE, SLOPES, 1e-3, slope),
                law(PowerLaw, axis),
            ),
        )
    ]


def _begun_of_all(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    start = PowerLawOfAll((START_NM,) * 3, times_of(experiment))
    name, slope = "flicker along", set_to(PowerLawOfAll, None, "slope")
    return [
        Hypothesis(
            with_step(experiment, start),
            (
                *(
                    variance(f"{name} {a}", "nm", START_NM, LARGEST_NM, partial(_sized, axis))
                    for axis, a in enumerate(AXES)
                ),
                plain(f"slope of {name} all axes", "", START_SLOPE, SLOPES, 1e-3, slope),
            ),
        )
    ]


def _sized(axis: int, experiment: Experiment, square: float) -> Experiment:
    step = step_of(experiment, PowerLawOfAll, None)
    assert step is not None
    sizes = with_root(step.size_nm, axis, square)
    return with_step(experiment, changed(step, size_nm=sizes))
