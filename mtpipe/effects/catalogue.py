"""All effects: those of mtpipe, and those that other packages bring as `mtpipe.effects`."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import entry_points

from mtpipe.crosschecking.check import BeadCheck
from mtpipe.effects import (
    axial_scale,
    bead_radius,
    contour_length,
    drift,
    dropped_frames,
    exposure,
    extensible_tether,
    field_rotation,
    force_drift,
    hopping,
    lateral_magnet_stiffness,
    lateral_scale,
    magnetic_alignment,
    multiple_tethers,
    off_center_attachment,
    pixel_locking,
    reference_noise,
    rotation_coupling,
    surface_sticking,
    tracking_noise,
    vibration,
    viscosity,
    wall_drag,
)
from mtpipe.effects.correction import Correction
from mtpipe.effects.effect import Effect

GROUP = "mtpipe.effects"
OWN: tuple[Effect, ...] = tuple(
    module.EFFECT
    for module in (
        wall_drag,
        rotation_coupling,
        off_center_attachment,
        tracking_noise,
        exposure,
        drift,
        reference_noise,
        vibration,
        viscosity,
        bead_radius,
        lateral_scale,
        axial_scale,
        dropped_frames,
        field_rotation,
        magnetic_alignment,
        lateral_magnet_stiffness,
        extensible_tether,
        contour_length,
        multiple_tethers,
        hopping,
        force_drift,
    )
)

# Effects that are no change of a spectrum but are seen in the traces and taken off them; a stuck
# bead crowds places within the pixel, so sticking comes first.
CORRECTIONS: tuple[Callable[[BeadCheck], Correction | None], ...] = (
    surface_sticking.find,
    pixel_locking.find,
)


def catalogue() -> tuple[Effect, ...]:
    """Every effect that can be tried."""
    others = [entry.load() for entry in entry_points(group=GROUP)]
    return (*OWN, *others)
