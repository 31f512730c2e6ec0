"""The time step of a tethered bead: the inner loop of `mtpipe.simulation.brownian`.

The step is that of Leimkuhler & Matthews 2013 (Appl. Math. Res. Express 2013:34) in the form of
Vilmart 2015 (SIAM J. Sci. Comput. 37:A201): half the random kick, then the force there, then a
whole step with the same kick; the half-way positions are the ones recorded. On a spring their
variance is exact for any stable step and the error in general is of second order, where Euler's is
of first; the spectrum of a mode much faster than the exposure is exact at low frequency. Friction
is taken at the start of the step; the error of first order this leaves is bounded by the rule for
the step (`longest_time_step_s`), since friction changes over distances that are long for a step.

What is compiled calls only what is in the same file: numba's cache does not notice changes in
other files.
"""

from __future__ import annotations

import numpy as np

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray
from mtpipe.physics import friction
from mtpipe.simulation.bead import BrownianBead

_HEIGHTS = 4096


def friction_table(bead: BrownianBead, time_step_s: float) -> FloatArray:
    """What friction makes of one step, on a uniform grid of u = R/h from 0 to 1, h the centre's.

    (heights, 4): half the random kick along the surface and away from it, nm, and of a turn, rad;
    the Itô drift upwards, nm. The response to a force is 2 kick²/kT. Without the wall the bulk's.
    """
    radius, kT = bead.radius_nm, bead.thermal_energy_pN_nm
    moves = 1 / friction.stokes_pN_s_per_nm(radius, bead.viscosity_mPa_s)
    turns = 1 / friction.rotational_stokes_pN_nm_s(radius, bead.viscosity_mPa_s)
    u = np.linspace(0.0, 1.0, _HEIGHTS)
    along, away, turning = np.ones((3, _HEIGHTS))
    if bead.wall:
        with np.errstate(divide="ignore"):
            height = radius / np.minimum(u, 1 - 1e-12)
        along = 1 / friction.parallel_wall_factor(height, radius)
        away = 1 / friction.perpendicular_wall_factor(height, radius)
        away[-1] = 0.0  # at contact
        turning = 1 / friction.rotation_wall_factor(height, radius)
    away = away / bead.upward_friction
    slope = -np.gradient(away, u, edge_order=2) * u**2 / radius
    spread = kT * time_step_s / 2
    return np.stack(
        [
            np.sqrt(spread * moves * along),
            np.sqrt(spread * moves * away),
            np.sqrt(spread * turns * turning),
            kT * time_step_s * moves * slope,
        ],
        axis=1,
    )


@compiled
def attachment(
    sine: float, cosine: float, cos_phi: float, sin_phi: float, cos_psi: float, sin_psi: float
) -> tuple[float, float, float]:
    """Unit vector from the bead's centre to the attachment, the field along x."""
    return (
        sine * cos_psi + cosine * cos_phi * sin_psi,
        cosine * sin_phi,
        sine * sin_psi - cosine * cos_phi * cos_psi,
    )


@compiled
def _turned(cosine: float, sine: float, angle: float) -> tuple[float, float]:
    """Cosine and sine after a turn by 2 arctan(angle/2), which is the angle to angle³/12."""
    half = angle / 2
    scale = 1 / (1 + half * half)
    c, s = (1 - half * half) * scale, angle * scale
    return cosine * c - sine * s, sine * c + cosine * s


@compiled
def advance(
    start: FloatArray,
    forces: FloatArray,
    per_frame: int,
    exposed: int,
    kT: float,
    radius: float,
    sine: float,
    cosine: float,
    secant: FloatArray,
    nodes_per_nm: float,
    frictions: FloatArray,
    wall: bool,
    turns: bool,
    tilts: bool,
    holds: FloatArray,
    sideways: float,
    z_per_turn: float,
    aside_per_turn: float,
    random: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Recorded positions, (frames, 3), from a start (`equilibrium.draw_state`), and the end.

    Parameters
    ----------
    forces : (frames,) pN. per_frame, exposed : steps. sine, cosine : of the attachment's angle.
    secant, nodes_per_nm : the chain's tension over distance, and how dense its table is.
    frictions : `friction_table` for the time step.
    holds : (frames,) torque stiffness of the field, pN nm, where the bead tilts.
    sideways : lateral stiffness of the magnets over their force, per nm.
    z_per_turn, aside_per_turn : nm of recorded height, and of recorded position across the field,
        per radian of the bead's turn about the field.
    """
    x, y, z, cos_phi, sin_phi, cos_psi, sin_psi = start
    cells = len(frictions) - 1
    last_node = len(secant) - 1
    step_along, step_away, step_turning, drift = frictions[0]
    kick_phi = kick_psi = 0.0
    recorded = np.zeros((len(forces), 3))
    for frame in range(len(forces)):
        force = forces[frame]
        held = force * sideways
        hold = holds[frame]
        for step in range(per_frame):
            if wall:
                place = cells * radius / (radius + z)
                cell = min(int(place), cells - 1)
                part = place - cell
                low, high = frictions[cell], frictions[cell + 1]
                step_along = low[0] + part * (high[0] - low[0])
                step_away = low[1] + part * (high[1] - low[1])
                step_turning = low[2] + part * (high[2] - low[2])
                drift = low[3] + part * (high[3] - low[3])

            # half the kick, where the force is taken and the position recorded
            kick_x = step_along * random.standard_normal()
            kick_y = step_along * random.standard_normal()
            kick_z = step_away * random.standard_normal()
            half_x, half_y, half_z = x + kick_x, y + kick_y, abs(z + kick_z)
            half_cos_phi, half_sin_phi, half_cos_psi, half_sin_psi = 1.0, 0.0, 1.0, 0.0
            if turns:
                kick_phi = step_turning * random.standard_normal()
                half_cos_phi, half_sin_phi = _turned(cos_phi, sin_phi, kick_phi)
            if tilts:
                kick_psi = step_turning * random.standard_normal()
                half_cos_psi, half_sin_psi = _turned(cos_psi, sin_psi, kick_psi)
            if step < exposed:
                recorded[frame, 0] += half_x
                recorded[frame, 1] += half_y - aside_per_turn * half_sin_phi
                recorded[frame, 2] += half_z - z_per_turn * half_sin_phi

            arm_x, arm_y, arm_z = attachment(
                sine, cosine, half_cos_phi, half_sin_phi, half_cos_psi, half_sin_psi
            )
            end_x = half_x + radius * arm_x
            end_y = half_y + radius * arm_y
            end_z = half_z + radius + radius * arm_z
            place = nodes_per_nm * np.sqrt(end_x * end_x + end_y * end_y + end_z * end_z)
            if place < last_node:
                node = int(place)
                spring = secant[node] + (place - node) * (secant[node + 1] - secant[node])
            else:
                spring = secant[last_node]
            pull_x, pull_y, pull_z = -spring * end_x, -spring * end_y, -spring * end_z

            response = 2 / kT * step_along * step_along
            x += 2 * kick_x + response * (pull_x - held * (half_x + radius * sine))
            y += 2 * kick_y + response * (pull_y - held * half_y)
            response = 2 / kT * step_away * step_away
            z = abs(z + 2 * kick_z + response * (force + pull_z) + drift)
            response = 2 / kT * step_turning * step_turning
            if turns:
                torque = (
                    -half_sin_phi * half_sin_psi * pull_x
                    + half_cos_phi * pull_y
                    + half_sin_phi * half_cos_psi * pull_z
                )
                torque *= radius * cosine
                cos_phi, sin_phi = _turned(cos_phi, sin_phi, 2 * kick_phi + response * torque)
            if tilts:
                torque = radius * (arm_x * pull_z - arm_z * pull_x) - hold * half_sin_psi
                cos_psi, sin_psi = _turned(cos_psi, sin_psi, 2 * kick_psi + response * torque)
        recorded[frame] /= exposed
    return recorded, np.array([x, y, z, cos_phi, sin_phi, cos_psi, sin_psi])
