"""What can be changed in an experiment, by how much, and what it costs.

Cost is an order of kinds, cheapest first: a setting of the camera (exposure), the camera's read-out
(frame rate), the time at the instrument (duration), another buffer (viscosity), another tether,
another bead. Within a kind the smallest factor is the cheapest. Nothing else changes with it:
tracking noise stays what it is (a shorter exposure needs more light), and forces are taken as
given (a smaller bead needs stronger magnets).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from mtpipe.design.limits import ForceRange, force_range
from mtpipe.design.methods import METHODS
from mtpipe.design.plan import Plan

# Factors between which a change that reaches a force is sought.
FACTOR_STEP = 2**0.5


@dataclass(frozen=True)
class Kind:
    """A kind of change.

    Attributes
    ----------
    apply : the plan with the quantity multiplied by a factor.
    value : the quantity in words, of a plan.
    steps : factors that are shown. furthest : smallest and largest factor that makes sense.
    """

    name: str
    apply: Callable[[Plan, float], Plan]
    value: Callable[[Plan], str]
    steps: tuple[float, ...]
    furthest: tuple[float, float]

    @property
    def factors(self) -> list[float]:
        """Factors to try, the smallest changes first; more before less."""
        low, high = self.furthest
        tried = [FACTOR_STEP**i for i in range(-20, 21) if i]
        inside = [f for f in tried if low * 0.999 <= f <= high * 1.001]
        return sorted(inside, key=lambda f: (round(max(f, 1 / f), 6), f < 1))


@dataclass(frozen=True)
class Change:
    """A kind of change by a factor, and the plan it makes."""

    kind: str
    factor: float
    plan: Plan

    @property
    def words(self) -> str:
        """The new value and the factor."""
        return f"{self.kind} {KINDS[self.kind].value(self.plan)} (×{self.factor:.3g})"


@dataclass(frozen=True)
class Variant:
    """What a change does to the ranges of the methods on their first axis."""

    change: Change
    ranges: tuple[ForceRange, ...]


@dataclass(frozen=True)
class Reach:
    """What lets a method measure a force.

    Attributes
    ----------
    error : of the plan as it is, at that force.
    changes : cheapest first, the smallest of each kind that brings the error within the limit.
    """

    method: str
    axis: str
    error: float
    within: bool
    changes: tuple[Change, ...]


def change(plan: Plan, kind: str, factor: float) -> Change:
    """One change of a plan."""
    return Change(kind, factor, KINDS[kind].apply(plan, factor))


def variants(plan: Plan, error: float) -> tuple[Variant, ...]:
    """The ranges after each of the steps of each kind."""
    made = [change(plan, kind.name, factor) for kind in KINDS.values() for factor in kind.steps]
    return tuple(
        Variant(one, tuple(force_range(one.plan, m, m.axes[0], error) for m in METHODS.values()))
        for one in made
    )


def reaches(plan: Plan, force_pN: float, error: float) -> tuple[Reach, ...]:
    """For each method, what brings a force within the error."""
    found = []
    for method in METHODS.values():
        axis = method.axes[0]
        now = method.error(plan, force_pN, axis).total

        def enough(one: Plan, method: str = method.name, axis: str = axis) -> bool:
            return METHODS[method].error(one, force_pN, axis).total <= error

        changes = [] if now <= error else _smallest(plan, enough)
        found.append(Reach(method.name, axis, now, now <= error, tuple(changes)))
    return tuple(found)


def _smallest(plan: Plan, enough: Callable[[Plan], bool]) -> Iterable[Change]:
    for kind in KINDS.values():
        for factor in kind.factors:
            one = change(plan, kind.name, factor)
            if enough(one.plan):
                yield one
                break


def _exposure(plan: Plan, factor: float) -> Plan:
    camera = plan.experiment.camera
    exposure = min(factor * camera.exposure_s, camera.frame_s)
    return _with(plan, camera=replace(camera, exposure_s=exposure))


def _frame_rate(plan: Plan, factor: float) -> Plan:
    """In the same time; the exposure stays if it fits into the frame."""
    camera = plan.experiment.camera
    frame_s = camera.frame_s / factor
    faster = replace(camera, frame_s=frame_s, exposure_s=min(camera.exposure_s, frame_s))
    return _with(plan, camera=faster).with_frames(round(plan.frames * factor))


def _duration(plan: Plan, factor: float) -> Plan:
    return plan.with_frames(round(plan.frames * factor))


def _viscosity(plan: Plan, factor: float) -> Plan:
    fluid = plan.experiment.fluid
    return _with(plan, fluid=replace(fluid, viscosity_mPa_s=factor * fluid.viscosity_mPa_s))


def _contour(plan: Plan, factor: float) -> Plan:
    chain = plan.experiment.chain
    return _with(plan, chain=replace(chain, contour_length_nm=factor * chain.contour_length_nm))


def _radius(plan: Plan, factor: float) -> Plan:
    bead = plan.experiment.bead
    return _with(plan, bead=replace(bead, radius_nm=factor * bead.radius_nm))


def _with(plan: Plan, **parts: object) -> Plan:
    return replace(plan, experiment=replace(plan.experiment, **parts))  # type: ignore[arg-type]


# Viscosity: up to half glycerol by weight (6 times water: Cheng 2008, Ind Eng Chem Res 47:3285).
KINDS = {
    kind.name: kind
    for kind in (
        Kind(
            "exposure",
            _exposure,
            lambda p: f"{1e3 * p.experiment.camera.exposure_s:.3g} ms",
            (0.5, 0.25),
            (1 / 16, 1.0),
        ),
        Kind(
            "frame rate",
            _frame_rate,
            lambda p: f"{1 / p.experiment.camera.frame_s:.4g} Hz",
            (2.0, 4.0),
            (1.0, 16.0),
        ),
        Kind("duration", _duration, lambda p: f"{p.duration_s:.3g} s", (2.0, 4.0), (1.0, 16.0)),
        Kind(
            "viscosity",
            _viscosity,
            lambda p: f"{p.experiment.fluid.viscosity_mPa_s:.3g} mPa s",
            (2.0, 4.0),
            (1.0, 6.0),
        ),
        Kind(
            "contour length",
            _contour,
            lambda p: f"{p.experiment.chain.contour_length_nm:.4g} nm",
            (0.5, 2.0),
            (0.25, 8.0),
        ),
        Kind(
            "bead radius",
            _radius,
            lambda p: f"{p.experiment.bead.radius_nm:.4g} nm",
            (0.5, 2.0),
            (0.25, 2.0),
        ),
    )
}
