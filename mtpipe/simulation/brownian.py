"""A tethered bead step by step, with everything that is not linear.

Overdamped Langevin dynamics of a sphere of radius R on a worm-like chain whose end is fixed to the
surface at the origin:

- coordinates: the bead's centre, and two angles, each of which can be locked: φ, the turn about the
  bead's magnetic axis, which costs nothing, and ψ, the tilt of that axis out of the field's
  direction in the vertical plane, held by the torque -κ sin ψ;
- the chain pulls with its tension dA/dr along the line from the origin to its attachment on the
  bead, whatever the angles; the field pulls the centre upwards with the force F;
- the magnets can hold the centre sideways: in x and y they pull it to where it is with the tether
  upright and the bead as the field holds it, with F times a stiffness over force;
- near the surface (wall) each friction is that at the bead's present height: Faxén along the
  surface, Brenner towards it, Goldman et al. for the turns (`mtpipe.physics.friction`), with the
  drift kT d(1/γ)/dz that friction varying with height asks for (Itô);
- the bead's lowest point is reflected at z = 0, and with it the tether's end, wall or not.

The time step is in `mtpipe.simulation.dynamics`, the start, in equilibrium, in `equilibrium`.
Neglected: inertia, hydrodynamic memory, coupling of rotation and translation by the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.physics import friction, tether
from mtpipe.physics.camera import Camera
from mtpipe.simulation.bead import BrownianBead
from mtpipe.simulation.chain_table import ChainTable, reach_nm, tabulate
from mtpipe.simulation.dynamics import advance, friction_table
from mtpipe.simulation.equilibrium import draw_state
from mtpipe.simulation.steps import FrameSteps, divide_frame

__all__ = ["BrownianBead", "BrownianTrace", "longest_time_step_s", "simulate_bead"]


@dataclass(frozen=True, eq=False)
class BrownianTrace:
    """What the camera recorded.

    Attributes
    ----------
    position_nm : (frames, 3) averages over each exposure: x and y of the bead's centre from the
        anchor, and z, the height of the bead's lowest point above the surface.
    steps : how the frames were divided.
    end : the state after the last frame, as `equilibrium.draw_state` has it.
    """

    position_nm: FloatArray
    steps: FrameSteps
    end: FloatArray


def simulate_bead(
    bead: BrownianBead,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
    *,
    time_step_s: float | None = None,
    start: FloatArray | None = None,
    table: ChainTable | None = None,
) -> BrownianTrace:
    """A tethered bead as the camera records it.

    Parameters
    ----------
    start : the state at the first frame; None: drawn from equilibrium at the first force.
    table : of the chain for forces up to the largest at least; None: made.
    time_step_s : the longest step; None: `longest_time_step_s`. A frame is a whole number of equal
        ones (`divide_frame`).

    Raises
    ------
    ValueError : more than one force, but not as many as frames; a bead whose attachment is too far
        from its lowest point to stand above the surface on its tether; magnets that hold it
        sideways far more stiffly than the tether does.
    """
    forces = np.asarray(bead.force_pN, dtype=np.float64)
    if forces.ndim > 0 and forces.shape != (frames,):
        raise ValueError(f"{forces.size} forces for {frames} frames: one for each is needed")
    forces = np.ascontiguousarray(np.broadcast_to(forces, (frames,)))
    if time_step_s is None:
        time_step_s = longest_time_step_s(bead, camera)
    steps = divide_frame(camera, time_step_s)
    if table is None:
        table = tabulate(bead.chain, float(np.max(bead.force_pN)))
    if start is None:
        start = draw_state(bead, table, float(forces[0]), random)
    recorded, end = advance(
        start,
        forces,
        steps.per_frame,
        steps.exposed,
        bead.thermal_energy_pN_nm,
        bead.radius_nm,
        np.sin(bead.attachment_angle_rad),
        np.cos(bead.attachment_angle_rad),
        table.secant_pN_per_nm,
        1 / table.distance_nm[1],
        friction_table(bead, steps.time_step_s),
        bead.wall,
        bead.turns,
        bead.alignment_pN_nm is not None,
        np.ascontiguousarray(np.broadcast_to(bead.holding_pN_nm, (frames,))),
        bead.sideways_per_nm,
        bead.z_per_turn_nm,
        bead.aside_per_turn_nm,
        random,
    )
    order = [0, 1, 2] if bead.along == 0 else [1, 0, 2]
    return BrownianTrace(recorded[:, order], steps, end)


def longest_time_step_s(bead: BrownianBead, camera: Camera) -> float:
    """The time step taken where none is given: the shortest of

    - 0.8 of the fastest relaxation time (a bound: the sum of all rates), with the chain's stiffness
      where it is stretched 4 kT beyond its rest at the largest force, and the friction there; at
      twice that step no error of means and variances was found, to 0.3 % (contours 0.1-1.2 µm);
    - the time in which the bead diffuses R/40 (friction changes little), or turns by 0.1 rad;
    - a 50th of a frame and a 20th of the exposure (if that is not 0).
    """
    force, kT = float(np.max(bead.force_pN)), bead.thermal_energy_pN_nm
    stretched = reach_nm(bead.chain, force, 4.0)
    stiffness = float(tether.stiffness_pN_per_nm(bead.chain, stretched))
    tension = float(tether.force_pN(bead.chain, stretched))
    moves = 1 / float(friction.stokes_pN_s_per_nm(bead.radius_nm, bead.viscosity_mPa_s))
    turns = 1 / float(friction.rotational_stokes_pN_nm_s(bead.radius_nm, bead.viscosity_mPa_s))
    lever = bead.radius_nm
    upwards = along = moves
    if bead.wall:
        centre = stretched + lever
        upwards = moves / float(friction.perpendicular_wall_factor(centre, lever))
        along = moves / float(friction.parallel_wall_factor(centre, lever))
    fastest = stiffness * upwards + (tension / stretched + force * bead.sideways_per_nm) * along
    limits = [camera.frame_s / 50]
    if bead.turns or bead.alignment_pN_nm is not None:
        side = np.sin(bead.attachment_angle_rad) * lever
        torque = stiffness * side**2 + tension / stretched * lever**2 + tension * lever
        fastest += (torque + float(np.max(bead.holding_pN_nm))) * turns
        limits.append(0.005 / (kT * turns))
    limits.append(0.8 / fastest)
    if bead.wall:
        limits.append((bead.radius_nm / 40) ** 2 / (2 * kT * moves))
    if camera.exposure_s > 0:
        limits.append(camera.exposure_s / 20)
    return min(limits)
