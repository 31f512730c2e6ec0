"""Two-state telegraph motion of the tether's length, or of what is tracked (PHYSICS E19)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
from scipy.ndimage import uniform_filter1d

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, SingleEvents, logarithm, plain
from mtpipe.experiment.changed import changed
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import Change, Parameter
from mtpipe.experiment.step import Place, Seen
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.physics.langevin import simulate_mode

STEP_NM, RATE_HZ = 20.0, 3.0
# So fast that a frame sees the mean of both states.
UNSEEN_HZ = 1e9
# Heights are averaged over half a relaxation time before levels are looked for, and looked at where
# there are eight such blocks at least. What is slower than ten relaxation times is drift, and taken
# off. What is not of hops is one of these parts of the variance.
BLOCK, FEWEST_BLOCKS, SLOW_BLOCKS = 0.5, 8, 20
PARTS_BESIDE = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0)
# In simulations a state lasts at least this part of a frame.
PARTS = 24


@dataclass(frozen=True)
class Hopping:
    """Two states of the tether that differ by a step in length, the longer one at high force.

    Both are equally likely at `half_force_pN`, where each is left at `rate_hz`; if it is None they
    are so at all forces, as of a tracker that reads one of two heights. `smooth` : there is
    Gaussian motion with the power of the hops in their place.
    """

    place: ClassVar[Place] = "tether"
    step_nm: float
    half_force_pN: float | None
    rate_hz: float
    smooth: bool = False

    def moments(self, force_pN: float, thermal_energy_pN_nm: float) -> tuple[float, float, float]:
        """Variance (nm²), relaxation time (s) and mean (nm) at a force.

        The longer state gains F·step; both rates change by half of it (a barrier half-way).
        """
        apart_pN = 0.0 if self.half_force_pN is None else force_pN - self.half_force_pN
        half = apart_pN * self.step_nm / (2 * thermal_energy_pN_nm)
        half = min(max(half, -300.0), 300.0)
        share = 1 / (1 + math.exp(-2 * half))
        rate = 2 * self.rate_hz * math.cosh(half)
        return self.step_nm**2 * share * (1 - share), 1 / rate, self.step_nm * share

    def hops(self, force_pN: float, duration_s: float, thermal_energy_pN_nm: float) -> float:
        """How many are expected at a force."""
        variance, tau_s, _ = self.moments(force_pN, thermal_energy_pN_nm)
        return duration_s * 2 * variance / self.step_nm**2 / tau_s if self.step_nm else 0.0

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """One more mode of z, and the mean of the two lengths."""
        variance, tau_s, mean = self.moments(force_pN, thermal_energy_pN_nm)
        hops = seen.with_modes(np.array([tau_s]), np.diag([0.0, 0.0, variance])[None])
        return changed(hops, height_nm=seen.height_nm + mean)

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """z with the hops, or with their Gaussian motion, averaged over each exposure.

        The state is drawn at equal parts of each frame by the exact probability to have changed
        since the last, so that the rates may be anything; within a part it counts as constant.
        """
        frames = len(force_pN)
        exposed = max(1, round(PARTS * camera.exposure_s / camera.frame_s))
        part_s = camera.frame_s / PARTS
        stay = np.empty(frames)
        share = np.empty(frames)
        hopped = position_nm.copy()
        for force in np.unique(force_pN):
            here = force_pN == force
            variance, tau_s, mean = self.moments(float(force), thermal_energy_pN_nm)
            if self.smooth:
                motion = simulate_mode(variance, tau_s, camera, int(here.sum()), random)
                hopped[here, 2] += mean + motion
            stay[here] = math.exp(-part_s / tau_s)
            share[here] = mean / self.step_nm if self.step_nm else 0.0
        if self.smooth:
            return hopped
        keeps = random.random((frames, PARTS)) < stay[:, None]
        drawn = random.random((frames, PARTS)) < share[:, None]
        keeps[0, 0] = False
        # numba is loaded where there are hops only
        from mtpipe.physics.telegraph import mean_states

        hopped[:, 2] += self.step_nm * mean_states(keeps, drawn, exposed)
        return hopped


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if step_of(experiment, Hopping) is not None:
        return []
    forces = sorted(evidence.force_pN)
    step = plain("step", "nm", STEP_NM, (0.0, 400.0), 0.05, _set("step_nm"))
    rate = logarithm("rate there", "Hz", RATE_HZ, (0.01, 200.0), _set("rate_hz"))
    found = []
    for force in forces[1:-1:2] or forces:
        start = with_step(experiment, Hopping(STEP_NM, force, RATE_HZ))
        found.append(Hypothesis(start, (step, _half_force(force, forces), rate)))
    unmoved = with_step(experiment, Hopping(STEP_NM, None, RATE_HZ))
    return [*found, Hypothesis(unmoved, (step, rate))]


def _half_force(half_pN: float, forces: Sequence[float]) -> Parameter:
    bounds = (0.5 * min(forces), 2 * max(forces))
    return logarithm("force of equal states", "pN", half_pN, bounds, _set("half_force_pN"))


def _still(experiment: Experiment) -> Hypothesis:
    """A tether that is longer at high force, and not seen to change."""
    hopping = step_of(experiment, Hopping)
    if hopping is None or hopping.half_force_pN is None:
        # the same length at all forces is part of z = 0
        return Hypothesis(with_step(experiment, Hopping(0.0, None, UNSEEN_HZ)), ())
    forces = [rest.force_pN for rest in experiment.rests]
    step = plain("step", "nm", hopping.step_nm, (0.0, 400.0), 0.05, _set("step_nm"))
    start = with_step(experiment, replace(hopping, rate_hz=UNSEEN_HZ))
    return Hypothesis(start, (step, _half_force(hopping.half_force_pN, forces)))


def _hops(experiment: Experiment, force_pN: Sequence[float], duration_s: Sequence[float]) -> float:
    """How many hops are expected in all plateaus."""
    hopping, energy = step_of(experiment, Hopping), experiment.fluid.thermal_energy_pN_nm
    if hopping is None:
        return 0.0
    each = zip(force_pN, duration_s, strict=True)
    return sum(hopping.hops(force, duration, energy) for force, duration in each)


def _two_levels(
    experiment: Experiment,
    force_pN: Sequence[float],
    frame_s: float,
    height_nm: Sequence[FloatArray],
) -> float:
    """How much more heights are like two levels than like Gaussian motion of the same power."""
    hopping, energy = step_of(experiment, Hopping), experiment.fluid.thermal_energy_pN_nm
    if hopping is None:
        return 0.0
    from mtpipe.physics.telegraph import gaussian_nats, two_state_nats

    nats = 0.0
    for force, height in zip(force_pN, height_nm, strict=True):
        if hopping.hops(force, len(height) * frame_s, energy) < 1:
            continue
        variance, tau_s, mean = hopping.moments(force, energy)
        frames = max(1, round(tau_s * BLOCK / frame_s))
        blocks = height[: len(height) // frames * frames].reshape(-1, frames)
        whole = blocks[~np.isnan(blocks).any(axis=1)].mean(axis=1)
        if len(whole) < FEWEST_BLOCKS or np.ptp(whole) == 0:
            continue
        values = whole - uniform_filter1d(whole, min(SLOW_BLOCKS, len(whole)), mode="nearest")
        size, lasts = float(np.var(values)), frames * frame_s / tau_s
        # variance of a mean over a block of what is correlated as e^(-t/tau)
        of_hops = variance * 2 * (lasts - 1 + math.exp(-lasts)) / lasts**2
        low, high, keeps = -mean, hopping.step_nm - mean, math.exp(-lasts)
        share = mean / hopping.step_nm
        # how many hops there were is left to chance, and with it what is beside them
        noise = [part * size for part in PARTS_BESIDE]
        nats += max(two_state_nats(values, low, high, share, keeps, one) for one in noise)
        nats -= max(gaussian_nats(values, of_hops, keeps, one) for one in noise)
    return nats


def _smooth(experiment: Experiment) -> Experiment:
    hopping = step_of(experiment, Hopping)
    return experiment if hopping is None else with_step(experiment, replace(hopping, smooth=True))


def _set(field: str) -> Change:
    return partial(_change, field)


def _change(field: str, experiment: Experiment, value: float) -> Experiment:
    hopping = step_of(experiment, Hopping) or Hopping(STEP_NM, None, RATE_HZ)
    return with_step(experiment, changed(hopping, **{field: value}))


def _cause(experiment: Experiment) -> str:
    hopping = step_of(experiment, Hopping)
    if hopping is None:
        return "the tether hops"
    if hopping.half_force_pN is None:
        return (
            f"the recorded height hops between two levels {hopping.step_nm:.1f} nm apart, "
            f"{hopping.rate_hz:.2g} times a second at all forces, as if a tracker reads one of two "
            "heights or the tether is held by something that the force does not move"
        )
    return (
        f"the tether hops between two lengths {hopping.step_nm:.1f} nm apart, equally likely at "
        f"{hopping.half_force_pN:.2g} pN, {hopping.rate_hz:.2g} times a second there"
    )


def _power(experiment: Experiment) -> str:
    hopping = step_of(experiment, Hopping)
    rate_hz = 0.0 if hopping is None else hopping.rate_hz
    most = hopping is not None and hopping.half_force_pN is not None
    return (
        f"z has additional power around {rate_hz:.2g} Hz{', most at one force' if most else ''}, "
        "as of a tether that changes its length; jumps between two lengths are not seen in the "
        "heights"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    hopping = step_of(experiment, Hopping)
    if hopping is None:
        return []
    half_pN = hopping.half_force_pN
    return [
        ("step_nm", hopping.step_nm, "nm"),
        *([] if half_pN is None else [("half_force_pN", half_pN, "pN")]),
        ("rate_hz", hopping.rate_hz, "Hz"),
    ]


_REMEDY = (
    "expect it of a molecule that folds or binds; otherwise check what sticks to "
    "the tether or the bead."
)
EFFECT = Effect(
    "hopping",
    _hypotheses,
    _cause,
    _strengths,
    still=_still,
    events=_hops,
    single=SingleEvents(_two_levels, _smooth, _power),
    unnamed=("lorentzian", ("z",)),
    remedy=_REMEDY,
)
