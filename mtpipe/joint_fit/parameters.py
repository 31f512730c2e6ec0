"""What of a configured experiment is free: values stated with an error, or not known."""

from __future__ import annotations

import math

from mtpipe.experiment.changed import changed
from mtpipe.experiment.changes import (
    scaled_contour_length,
    scaled_exposure,
    scaled_persistence_length,
    scaled_radius,
    scaled_temperature,
    scaled_viscosity,
    scaled_x_and_y,
    with_optics,
)
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import EXPOSURE, SHORTEST_EXPOSURE, Change, Parameter
from mtpipe.physics.camera import Camera
from mtpipe.setup.conditions import conditions_of
from mtpipe.setup.measured import Measured
from mtpipe.setup.setup import Setup

# Half-width, in ln, within which a value that is not known is looked for.
UNKNOWN_LN = 1.5
STATED_SIGMAS = 6.0

# Relative standard errors of theory for z's own motion: its friction and its variance. Simulations
# draw them for each plateau.
UPWARD_FRICTION_STDERR, UPWARD_VARIANCE_STDERR = 0.03, 0.02


def stated_parameters(setup: Setup) -> tuple[Parameter, ...]:
    """What the setup states of buffer, bead, tether and pixels, as far as it is not exact.

    An unknown temperature is what `conditions_of` makes of it; a pixel's size is no matter of
    positions in nm, but its error is.
    """
    conditions, _ = conditions_of(setup)
    warmth = Measured(value=1.0, stderr=conditions.temperature_relative_stderr)
    pixel = setup.camera.pixel_size_nm
    if pixel is None or not pixel.known:
        pixel = Measured(value=1.0)
    found = [
        scaled("temperature", warmth, scaled_temperature),
        scaled("scale of x and y", pixel, scaled_x_and_y),
        scaled("bead radius", setup.beads.radius_nm, scaled_radius),
        scaled("viscosity", setup.buffer.viscosity_mPa_s, scaled_viscosity),
        scaled("contour length", setup.tether.contour_length_nm, scaled_contour_length),
        scaled("persistence length", setup.tether.persistence_length_nm, scaled_persistence_length),
    ]
    return tuple(parameter for parameter in found if parameter is not None)


def exposure_parameters(setup: Setup, camera: Camera) -> tuple[Parameter, ...]:
    """The exposure, as far as it is not exact; never longer than a frame.

    Parameters
    ----------
    camera : of the experiment; where the exposure is unknown, that of a whole frame.
    """
    stated, most = setup.camera.exposure_s, math.log(camera.frame_s / camera.exposure_s)
    if stated.value is None:
        lower = most + math.log(SHORTEST_EXPOSURE)
        return (Parameter(EXPOSURE, "", -0.3, lower, most, 1e-3, None, scaled_exposure),)
    error = stated.relative_stderr
    if not error > 0:
        return ()
    low, high = -STATED_SIGMAS * error, min(STATED_SIGMAS * error, max(most, 0.0))
    return (
        Parameter("ln exposure", "", 0.0, low, high, 1e-3, (0.0, error), scaled_exposure, True),
    )


def scaled(name: str, stated: Measured, change: Change) -> Parameter | None:
    """A factor, in ln, on a stated value; None where the value is exact."""
    if stated.value is None:
        return Parameter(f"ln {name}", "", 0.0, -UNKNOWN_LN, UNKNOWN_LN, 1e-3, None, change)
    error = stated.relative_stderr
    if not error > 0:
        return None
    width = STATED_SIGMAS * error
    return Parameter(f"ln {name}", "", 0.0, -width, width, 1e-3, (0.0, error), change, True)


def z_zero_parameter(stderr_nm: float) -> Parameter:
    """Error of the height's zero, common to all plateaus."""

    return Parameter(
        "z zero", "nm", 0.0, -10 * stderr_nm, 10 * stderr_nm, 0.1, (0.0, stderr_nm), _z_zero
    )


def _z_zero(experiment: Experiment, value: float) -> Experiment:
    return with_optics(experiment, z_zero_nm=value)


def _upward_friction(experiment: Experiment, ln_factor: float) -> Experiment:
    allowance = changed(experiment.allowance, upward_friction=math.exp(ln_factor))
    return changed(experiment, allowance=allowance)


def _upward_variance(experiment: Experiment, ln_factor: float) -> Experiment:
    allowance = changed(experiment.allowance, upward_variance=math.exp(ln_factor))
    return changed(experiment, allowance=allowance)


def allowance_parameters() -> tuple[Parameter, ...]:
    """How far z may be from theory (`Allowance`)."""
    return tuple(
        Parameter(name, "", 0.0, -6 * error, 6 * error, 1e-3, (0.0, error), change)
        for name, error, change in (
            ("allowed friction of z", UPWARD_FRICTION_STDERR, _upward_friction),
            ("allowed variance of z", UPWARD_VARIANCE_STDERR, _upward_variance),
        )
    )
