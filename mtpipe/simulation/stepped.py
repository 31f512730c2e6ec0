"""Stretches at low force, step by step between stretches that are simulated mode by mode.

A stretch begins where the one before left the bead. Coordinates of both are the same but for the
sign of angles and the place of x = 0, which mode by mode is the bead's mean.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np

from mtpipe.experiment.description import Experiment
from mtpipe.experiment.recorded_modes import ACROSS, ALONG, ANGLE, UP, BeadState
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.physics.tether import Chain
from mtpipe.simulation.bead import BrownianBead, brownian_bead
from mtpipe.simulation.brownian import longest_time_step_s, simulate_bead
from mtpipe.simulation.chain_table import ChainTable, tabulate

# The lowest height at which a bead starts.
LEAST_START_NM = 0.1
# Time step over the longest that the simulator takes by itself, as recordings are simulated a
# hundred times. Tests compare expected spectra with this.
STRIDE = 2.0


def stepped(
    state: BeadState,
    experiment: Experiment,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
    position: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """(frames, 3) recorded x, y, z in nm, and the coordinates of the bead at their end.

    Parameters
    ----------
    position : coordinates at the start, as `state` counts them; None: equilibrium.
    """
    bead, step_s, table = _prepared(experiment, state.force_pN, camera)
    start = None if position is None else _to_steps(position, bead)
    trace = simulate_bead(
        bead, camera, frames, random, time_step_s=step_s, start=start, table=table
    )
    recorded = trace.position_nm
    recorded[:, bead.along] += _aside_nm(bead)
    softer = math.sqrt(experiment.allowance.upward_variance)
    recorded[:, 2] = state.extension_nm + softer * (recorded[:, 2] - state.extension_nm)
    return recorded, _from_steps(trace.end, bead, len(state.modes.tau_s))


@functools.lru_cache(maxsize=128)
def _prepared(
    experiment: Experiment, force_pN: float, camera: Camera
) -> tuple[BrownianBead, float, ChainTable]:
    bead = brownian_bead(experiment, force_pN)
    # slower by as much as it is softer
    slower = bead.upward_friction * experiment.allowance.upward_variance
    largest_pN = 2.0 ** math.ceil(math.log2(force_pN))
    return (
        replace(bead, upward_friction=slower),
        STRIDE * longest_time_step_s(bead, camera),
        _table(experiment.chain, largest_pN),
    )


@functools.lru_cache(maxsize=8)
def _table(chain: Chain, largest_force_pN: float) -> ChainTable:
    return tabulate(chain, largest_force_pN)


def _aside_nm(bead: BrownianBead) -> float:
    """How far beside its anchor a bead stands that is attached beside its lowest point."""
    return bead.radius_nm * math.sin(bead.attachment_angle_rad)


def _to_steps(position: FloatArray, bead: BrownianBead) -> FloatArray:
    phi = -float(position[ANGLE])
    psi = -float(position[-1]) if bead.alignment_pN_nm is not None else 0.0
    return np.array(
        [
            position[ALONG] - _aside_nm(bead),
            position[ACROSS],
            max(float(position[UP]), LEAST_START_NM),
            math.cos(phi),
            math.sin(phi),
            math.cos(psi),
            math.sin(psi),
        ]
    )


def _from_steps(end: FloatArray, bead: BrownianBead, coordinates: int) -> FloatArray:
    x, y, z, cos_phi, sin_phi, cos_psi, sin_psi = end
    position = np.zeros(coordinates)
    position[[ALONG, ACROSS, UP]] = x + _aside_nm(bead), y, z
    position[ANGLE] = -math.atan2(sin_phi, cos_phi)
    if bead.alignment_pN_nm is not None:
        position[-1] = -math.atan2(sin_psi, cos_psi)
    return position
