"""A motion of its own of one axis, which relaxes within one time: an extra Lorentzian."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, logarithm, variance
from mtpipe.effects.terms.term import (
    AXES,
    Modes,
    grows,
    law,
    of_axis,
    of_square,
    relative,
    set_to,
    typical_force_pN,
)
from mtpipe.experiment.changes import with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import Place
from mtpipe.ground.types import FloatArray

# Where the corner is looked for, as shares of the frame rate.
STARTS = (0.002, 0.1)
START_NM, LARGEST_NM = 3.0, 1000.0


@dataclass(frozen=True)
class OwnMotion(Modes):
    """Along an axis the record moves by `size_nm` (F/F₀)^(exponent/2), with a corner of
    `corner_hz` (F/F₀)^corner_exponent.
    """

    place: ClassVar[Place] = "tether"
    form: ClassVar[str] = "lorentzian"
    axis: int
    at_pN: float
    size_nm: float
    corner_hz: float
    exponent: float = 0.0
    corner_exponent: float = 0.0

    def modes(self, force_pN: float) -> tuple[FloatArray, FloatArray]:
        """One."""
        corner_hz = self.corner_hz * relative(force_pN, self.at_pN, self.corner_exponent)
        variance_nm2 = self.size_nm**2 * relative(force_pN, self.at_pN, self.exponent)
        return np.atleast_1d(1 / (2 * math.pi * corner_hz)), np.atleast_1d(variance_nm2)

    @property
    def words(self) -> str:
        """Variance, corner, and how it goes with the force."""
        return (
            f"{AXES[self.axis]} has a motion of its own, {self.size_nm**2:.3g} nm² with its corner "
            f"at {self.corner_hz:.3g} Hz at {self.at_pN:.2g} pN, {grows(self.exponent)}"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Size and corner at F₀, and their laws."""
        return [
            ("size_nm", self.size_nm, "nm"),
            ("corner_hz", self.corner_hz, "Hz"),
            ("exponent", self.exponent, ""),
            ("corner_exponent", self.corner_exponent, ""),
        ]


def along(axis: int) -> Effect:
    """The term of one axis."""
    return of_axis(f"lorentzian_{AXES[axis]}", OwnMotion, axis, partial(_begun, axis))


def _begun(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    at, rate_hz = typical_force_pN(evidence), 1 / experiment.camera.frame_s
    name = f"motion of its own along {AXES[axis]}"
    corner = set_to(OwnMotion, axis, "corner_hz")
    size = of_square(OwnMotion, axis, "size_nm")
    return [
        Hypothesis(
            with_step(experiment, OwnMotion(axis, at, START_NM, share * rate_hz)),
            (
                variance(name, "nm", START_NM, LARGEST_NM, size),
                logarithm(
                    f"corner of {name}", "Hz", share * rate_hz, (1e-4 * rate_hz, rate_hz), corner
                ),
                law(OwnMotion, axis),
                law(OwnMotion, axis, "corner_exponent", "law of the corner"),
            ),
        )
        for share in STARTS
    ]
