"""A motion of its own of one axis, which relaxes within one time: an extra Lorentzian."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, logarithm, variance
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import Place, Seen
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.physics.langevin import simulate_mode
from mtpipe.terms.term import AXES, grows, law, of_square, relative, set_to, typical_force_pN

# Where the corner is looked for, as shares of the frame rate.
STARTS = (0.002, 0.1)
START_NM, LARGEST_NM = 3.0, 1000.0


@dataclass(frozen=True)
class OwnMotion:
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

    def variance_nm2(self, force_pN: float) -> float:
        """At a force."""
        return float(self.size_nm**2 * relative(force_pN, self.at_pN, self.exponent))

    def tau_s(self, force_pN: float) -> float:
        """Relaxation time at a force."""
        corner = self.corner_hz * relative(force_pN, self.at_pN, self.corner_exponent)
        return float(1 / (2 * math.pi * corner))

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """One more mode."""
        covariance = np.zeros((1, 3, 3))
        covariance[0, self.axis, self.axis] = self.variance_nm2(force_pN)
        return seen.with_modes(np.array([self.tau_s(force_pN)]), covariance)

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """Begun anew in each stretch of one force."""
        moved = position_nm.copy()
        edges = [0, *(np.flatnonzero(np.diff(force_pN)) + 1).tolist(), len(force_pN)]
        for start, stop in itertools.pairwise(edges):
            force = float(force_pN[start])
            moved[start:stop, self.axis] += simulate_mode(
                self.variance_nm2(force), self.tau_s(force), camera, stop - start, random
            )
        return moved


def along(axis: int) -> Effect:
    """The term of one axis."""
    return Effect(
        f"lorentzian_{AXES[axis]}",
        partial(_hypotheses, axis),
        partial(_cause, axis),
        partial(_strengths, axis),
        form=OwnMotion.form,
        axes=(AXES[axis],),
    )


def _hypotheses(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if step_of(experiment, OwnMotion, axis) is not None:
        return []
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


def _cause(axis: int, experiment: Experiment) -> str:
    step = step_of(experiment, OwnMotion, axis)
    if step is None:
        return f"{AXES[axis]} has a motion of its own"
    return (
        f"{AXES[axis]} has a motion of its own, {step.size_nm**2:.3g} nm² with its corner at "
        f"{step.corner_hz:.3g} Hz at {step.at_pN:.2g} pN, {grows(step.exponent)}"
    )


def _strengths(axis: int, experiment: Experiment) -> list[tuple[str, float, str]]:
    step = step_of(experiment, OwnMotion, axis)
    if step is None:
        return []
    return [
        ("size_nm", step.size_nm, "nm"),
        ("corner_hz", step.corner_hz, "Hz"),
        ("exponent", step.exponent, ""),
        ("corner_exponent", step.corner_exponent, ""),
    ]
