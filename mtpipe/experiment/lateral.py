"""A bead that hangs in the field: the stiffness of its swinging and turning (PHYSICS 8.1).

Coordinates: along the field, across it, away from the surface; then angles, those that are free:
about the field's axis where the bead turns, the tilt of its axis where the field holds it with a
finite torque, and about the vertical where it turns and tilts and is attached beside its lowest
point. In rest the tether's end is `offset_nm` beside the vertical through the bead's centre, along
the field (a uniform field has no torque about itself), and `lever_nm` below the centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtpipe.experiment.description import Experiment
from mtpipe.experiment.recorded_modes import ACROSS, ALONG, ANGLE, UP
from mtpipe.ground.types import FloatArray


@dataclass(frozen=True, eq=False)
class Lateral:
    """Swinging and turning of a bead at n forces, d coordinates.

    Attributes
    ----------
    stiffness : (n, d, d); that of z, which is the tether's own, is not in it.
    swing, turn : (n, d, d) twice the forms by which the tether's swinging and the bead's turning
        lower the bead.
    stretch : (n, d) how much each coordinate stretches the tether: z by 1, a tilt by what it lifts
        the attachment.
    """

    stiffness: FloatArray
    swing: FloatArray
    turn: FloatArray
    stretch: FloatArray

    @property
    def stands(self) -> NDArray[np.bool_]:
        """(n,) whether all but the tether's length is held: a bead whose attachment is far aside
        turns about the vertical where the field is weak."""
        return np.asarray(
            np.linalg.eigvalsh(self.with_length(np.ones(len(self.stretch))))[:, 0] > 0
        )

    def with_length(self, stiffness_pN_per_nm: FloatArray, *, rocks: bool = True) -> FloatArray:
        """(n, d, d) stiffness with that of the tether's length (n,); without what tilts stretch."""
        stretch = self.stretch if rocks else np.eye(self.stretch.shape[1])[[UP]]
        return self.stiffness + stiffness_pN_per_nm[:, None, None] * _square(stretch)

    def chosen(self, which: list[int]) -> Lateral:
        """Some of the forces, by their indices."""
        parts = self.stiffness[which], self.swing[which], self.turn[which], self.stretch[which]
        return Lateral(*parts)


def lateral(
    experiment: Experiment,
    force_pN: FloatArray,
    end_nm: FloatArray,
    aside_pN_per_nm: FloatArray,
    holding_pN_nm: FloatArray | None,
) -> Lateral:
    """Stiffness and forms of a bead (PHYSICS section 2, E3, E4, E15, E20 and 8.1).

    With angles φ about the field, ψ of the tilt and χ about the vertical the tether's end is at
    x − aψ and y − aφ + dχ, and ζ = z − dψ is its height, a the bead's lever and d the offset. Bead
    and end sink by a(φ² + ψ²)/2 − dφχ/2 and by the end's square distance over 2L. Without an angle
    the bead hangs stiffly on its tether (across) or keeps upright (along).

    Parameters
    ----------
    force_pN, end_nm : (n,), the mean heights of the tether's end.
    aside_pN_per_nm : (n,) lateral stiffness that the magnets add.
    holding_pN_nm : (n,) stiffness with which the field holds the bead's axis against tilting, and
        about the vertical; None: rigidly.
    """
    lever, offset = experiment.bead.lever_nm, experiment.bead.offset_nm
    turns, tilts = experiment.bead.turns, holding_pN_nm is not None
    angles = [*(["turn"] if turns else []), *(["tilt"] if tilts else [])]
    if turns and experiment.rocks:
        angles.append("yaw")
    at = {name: ANGLE + i for i, name in enumerate(angles)}
    n, coordinates = len(force_pN), ANGLE + len(angles)
    along, across, stretch = (np.zeros((n, coordinates)) for _ in range(3))
    along[:, ALONG] = across[:, ACROSS] = stretch[:, UP] = 1
    turn, held = np.zeros((2, n, coordinates, coordinates))
    if turns:
        across[:, at["turn"]] = -lever
        turn[:, at["turn"], at["turn"]] = lever
    if holding_pN_nm is not None:
        tilt = at["tilt"]
        along[:, tilt], stretch[:, tilt] = -lever, -offset
        turn[:, tilt, tilt] = lever
        held[:, tilt, tilt] = holding_pN_nm
    if "yaw" in at:
        yaw, about = at["yaw"], at["turn"]
        across[:, yaw] = offset
        turn[:, about, yaw] = turn[:, yaw, about] = -offset / 2
        held[:, yaw, yaw] = holding_pN_nm
        # the axis, tilted by the pull, asks for as much again as the attachment's own sinking
        held[:, about, yaw] = held[:, yaw, about] = -force_pN * offset / 2
    end = end_nm if turns else end_nm + lever
    swing = _square(along) / end_nm[:, None, None] + _square(across) / end[:, None, None]
    stiffness = force_pN[:, None, None] * (swing + turn) + held
    stiffness[:, ALONG, ALONG] += aside_pN_per_nm
    stiffness[:, ACROSS, ACROSS] += aside_pN_per_nm
    return Lateral(stiffness, swing, turn, stretch)


def _square(row: FloatArray) -> FloatArray:
    """(n, d, d) outer products of (n, d)."""
    return np.asarray(row[:, :, None] * row[:, None, :])
