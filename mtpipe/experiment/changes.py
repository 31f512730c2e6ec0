"""Changes of a description that fits and effects have in common."""

from __future__ import annotations

import math
from typing import TypeVar

from mtpipe.experiment.changed import changed
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import Step
from mtpipe.physics.camera import Camera
from mtpipe.physics.tether import Formula, with_formula


def with_fluid(experiment: Experiment, **changes: object) -> Experiment:
    """The experiment with another fluid."""
    return changed(experiment, fluid=changed(experiment.fluid, **changes))


def with_bead(experiment: Experiment, **changes: object) -> Experiment:
    """The experiment with another bead."""
    return changed(experiment, bead=changed(experiment.bead, **changes))


def with_chain(experiment: Experiment, **changes: object) -> Experiment:
    """The experiment with another tether."""
    return changed(experiment, chain=changed(experiment.chain, **changes))


def by_formula(experiment: Experiment, formula: Formula) -> Experiment:
    """The experiment with a tether by another formula, as stretchable as it is."""
    return changed(experiment, chain=with_formula(experiment.chain, formula))


def with_optics(experiment: Experiment, **changes: object) -> Experiment:
    """The experiment with other optics."""
    return changed(experiment, optics=changed(experiment.optics, **changes))


def with_magnets(experiment: Experiment, **changes: object) -> Experiment:
    """The experiment with other magnets."""
    return changed(
        experiment,
        magnets=changed(experiment.magnets, **changes),
    )


def with_stage(experiment: Experiment, **changes: object) -> Experiment:
    """The experiment with another stage."""
    return changed(experiment, stage=changed(experiment.stage, **changes))


Kind = TypeVar("Kind", bound=Step)


def step_of(
    experiment: Experiment, kind: type[Kind], axis: int | tuple[int, int] | None = None
) -> Kind | None:
    """The experiment's step of a kind, and of an axis where it has one for each; None where it has
    none.
    """
    steps = (step for step in experiment.steps if isinstance(step, kind))
    return next((step for step in steps if axis is None or _axis(step) == axis), None)


def with_step(experiment: Experiment, step: Step) -> Experiment:
    """The experiment with a step, in the place of one of its kind (and axis) if it has one."""
    kind = type(step), _axis(step)
    steps = tuple(step if (type(one), _axis(one)) == kind else one for one in experiment.steps)
    return changed(experiment, steps=steps if step in steps else (*steps, step))


def _axis(step: object) -> int | tuple[int, int] | None:
    return getattr(step, "axis", None)


def scaled_radius(experiment: Experiment, ln_factor: float) -> Experiment:
    """With another bead radius."""
    return with_bead(experiment, radius_nm=experiment.bead.radius_nm * math.exp(ln_factor))


def scaled_temperature(experiment: Experiment, ln_factor: float) -> Experiment:
    """At another temperature, the viscosity being what it is."""
    kelvin = experiment.fluid.temperature_K * math.exp(ln_factor)
    return with_fluid(with_chain(experiment, temperature_K=kelvin), temperature_K=kelvin)


def scaled_x_and_y(experiment: Experiment, ln_factor: float) -> Experiment:
    """With x and y recorded larger by a factor."""
    scale = experiment.optics.lateral_scale * math.exp(ln_factor)
    return with_optics(experiment, lateral_scale=scale)


def scaled_viscosity(experiment: Experiment, ln_factor: float) -> Experiment:
    """With another viscosity."""
    value = experiment.fluid.viscosity_mPa_s * math.exp(ln_factor)
    return with_fluid(experiment, viscosity_mPa_s=value)


def scaled_contour_length(experiment: Experiment, ln_factor: float) -> Experiment:
    """With another contour length."""
    length = experiment.chain.contour_length_nm * math.exp(ln_factor)
    return with_chain(experiment, contour_length_nm=length)


def scaled_persistence_length(experiment: Experiment, ln_factor: float) -> Experiment:
    """With another persistence length."""
    length = experiment.chain.persistence_length_nm * math.exp(ln_factor)
    return with_chain(experiment, persistence_length_nm=length)


def scaled_exposure(experiment: Experiment, ln_factor: float) -> Experiment:
    """With another exposure, at most a frame."""
    camera = experiment.camera
    exposure = min(camera.exposure_s * math.exp(ln_factor), camera.frame_s)
    return changed(experiment, camera=Camera(camera.frame_s, exposure))
