"""The bead that the step-by-step simulator moves: numbers only.

The bead's orientation is two angles: φ, the turn about the bead's magnetic axis, and ψ, the tilt of
that axis out of the field's direction in the vertical plane. Both are 0 where the field holds the
bead in its rest. Inside, the field always lies along x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtpipe.experiment.description import Experiment
from mtpipe.ground.types import FloatArray
from mtpipe.physics import tether
from mtpipe.physics.buffer import thermal_energy_pN_nm


@dataclass(frozen=True, eq=False)
class BrownianBead:
    """A bead on its tether in the field.

    Attributes
    ----------
    chain : the tether, any formula; its temperature is that of the buffer too.
    force_pN : at least 0; a number, or (frames,) a force for each frame.
    along : 0 or 1, the axis (x or y) of the field.
    wall : friction depends on the height above the surface.
    turns : the bead turns freely about the field's axis, and its attachment swings with it.
    alignment_pN_nm : torque stiffness κ that holds the bead's axis along the field, a number or one
        for each frame; None: locked.
    sideways_per_nm : stiffness over force with which the magnets hold the bead's centre along x and
        y, about where it is with the tether upright and the bead as the field holds it.
    attachment_angle_rad : polar angle of the attachment from the lowest point, towards the
        positive axis of the field, where the field holds the bead; less than pi/2.
    upward_friction : factor on the friction away from the surface.
    z_per_turn_nm, aside_per_turn_nm : nm of recorded height, and of recorded position across the
        field, per radian of the turn about the field.
    """

    chain: tether.Chain
    force_pN: float | FloatArray
    radius_nm: float
    viscosity_mPa_s: float
    along: int = 0
    wall: bool = True
    turns: bool = True
    alignment_pN_nm: float | FloatArray | None = None
    sideways_per_nm: float = 0.0
    attachment_angle_rad: float = 0.0
    upward_friction: float = 1.0
    z_per_turn_nm: float = 0.0
    aside_per_turn_nm: float = 0.0

    def __post_init__(self) -> None:
        for name in ("radius_nm", "viscosity_mPa_s", "upward_friction"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} = {getattr(self, name)}: must be positive")
        if np.size(self.force_pN) == 0 or not np.all(np.asarray(self.force_pN) >= 0):
            raise ValueError("force_pN must not be negative")
        if self.along not in (0, 1):
            raise ValueError(f"along = {self.along}: the field lies along axis 0 (x) or 1 (y)")
        if self.alignment_pN_nm is not None and not np.all(np.asarray(self.alignment_pN_nm) > 0):
            raise ValueError(f"alignment_pN_nm = {self.alignment_pN_nm}: must be positive")
        if not self.sideways_per_nm >= 0:
            raise ValueError(f"sideways_per_nm = {self.sideways_per_nm}: must not be negative")
        if not abs(self.attachment_angle_rad) < np.pi / 2:
            raise ValueError("attachment_angle_rad must be between -pi/2 and pi/2")

    @property
    def holding_pN_nm(self) -> float | FloatArray:
        """Torque stiffness of the field; 0 where the bead's axis is locked."""
        return 0.0 if self.alignment_pN_nm is None else self.alignment_pN_nm

    @property
    def thermal_energy_pN_nm(self) -> float:
        """The thermal energy kT."""
        return float(thermal_energy_pN_nm(self.chain.temperature_K))


def brownian_bead(experiment: Experiment, force_pN: float | FloatArray) -> BrownianBead:
    """The bead of a described experiment, at a force or a force for each frame.

    One that rocks is turned by the force, and rests as described at the mean of the forces.
    """
    bead, magnets = experiment.bead, experiment.magnets
    angle = math.asin(bead.offset_nm / bead.radius_nm)
    held = magnets.alignment_at(np.asarray(force_pN))
    if held is not None:
        # where the pull on the attachment has turned the bead, M sin δ = F d, it is held by M cos δ
        turned = np.arctan2(force_pN * bead.offset_nm, held)
        angle, held = angle + float(np.mean(turned)), held / np.cos(turned)
    return BrownianBead(
        experiment.chain,
        force_pN,
        bead.radius_nm,
        experiment.fluid.viscosity_mPa_s,
        along=experiment.along,
        wall=experiment.fluid.wall,
        turns=bead.turns,
        alignment_pN_nm=held,
        sideways_per_nm=magnets.sideways_per_nm,
        attachment_angle_rad=angle,
        upward_friction=experiment.allowance.upward_friction,
        z_per_turn_nm=bead.z_per_turn_nm,
        aside_per_turn_nm=bead.aside_per_turn_nm,
    )
