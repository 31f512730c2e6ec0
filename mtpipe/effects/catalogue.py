"""All effects: those of mtpipe, and those that other packages bring as `mtpipe.effects`."""

from __future__ import annotations

from importlib.metadata import entry_points

from mtpipe.effects import (
    anharmonic_tether,
    axial_scale,
    bead_radius,
    bead_rocking,
    bead_turning,
    contour_length,
    drift,
    dropped_frames,
    exposure,
    extensible_tether,
    field_rotation,
    force_drift,
    hopping,
    hydrodynamic_memory,
    lateral_magnet_stiffness,
    lateral_scale,
    magnetic_alignment,
    multiple_tethers,
    off_center_attachment,
    reference_noise,
    rotation_coupling,
    tracking_noise,
    vibration,
    viscosity,
    wall_drag,
    z_crosstalk,
    z_response,
)
from mtpipe.effects.effect import Effect
from mtpipe.setup.tables import EFFECTS_GROUP

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
        anharmonic_tether,
        hydrodynamic_memory,
        z_crosstalk,
        bead_turning,
        bead_rocking,
        z_response,
    )
)


def catalogue() -> tuple[Effect, ...]:
    """Every effect that can be tried."""
    others = [entry.load() for entry in entry_points(group=EFFECTS_GROUP)]
    return (*OWN, *others)
