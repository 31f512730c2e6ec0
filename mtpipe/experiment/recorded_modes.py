"""Relaxation modes of the recorded motion: times, variances and what axes share."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from mtpipe.experiment.description import Experiment
from mtpipe.ground.types import FloatArray
from mtpipe.physics.axial import AxialMotion
from mtpipe.physics.linear import LinearMotion, NormalModes, pair_modes
from mtpipe.physics.memory import remembering

ALONG, ACROSS, UP, ANGLE = range(4)

# Below this share of an axis's variance a mode is rounding error.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class BeadState:
    """A bead at one force.

    Attributes
    ----------
    extension_nm : mean height of the bead's lowest point, the mean of z.
    motion : the linear motion about the mean; its readout is (x, y, z) of the camera.
    modes : its normal modes.
    bending : (d, d); z by expansion is ½ Xᵀ bending X above the linear motion, apart from its mean.
    axial : motion away from the surface by expansion, but for the swinging of the tether.
    moved : modes of x, y and z.
    stepped : the experiment, where the motion is followed step by step through the whole potential;
        None where it is followed by expansion.
    memory_s : time of hydrodynamic memory, which is in none of them; 0: none.
    rocking : of a bead whose tilt moves its height; None: none does.
    """

    force_pN: float
    extension_nm: float
    motion: LinearMotion
    modes: NormalModes
    bending: FloatArray
    axial: AxialMotion
    moved: RecordedModes
    stepped: Experiment | None = None
    memory_s: float = 0.0
    rocking: Rocking | None = None

    @property
    def upward(self) -> int:
        """Which of the modes is the harmonic motion away from the surface."""
        return int(np.argmax(np.abs(self.modes.shape[UP])))


@dataclass(frozen=True, eq=False)
class Rocking:
    """Modes of a bead as if its tilt did not stretch the tether, and (d,) how much each coordinate
    stretches it.
    """

    apart: NormalModes
    stretch: FloatArray


@dataclass(frozen=True, eq=False)
class RecordedModes:
    """Exponential covariances that sum up to the motion: τ (m,), covariance (m, 3, 3); of many
    beads with a first dimension more.
    """

    tau_s: FloatArray
    covariance_nm2: FloatArray

    def of(self, i: int) -> RecordedModes:
        """One of many."""
        return RecordedModes(self.tau_s[i], self.covariance_nm2[i])


@functools.lru_cache(maxsize=4096)
def recorded_modes(state: BeadState) -> RecordedModes:
    """Modes of x, y and z.

    Hydrodynamic memory makes many decays of these, some of them with negative variance.
    """
    if state.memory_s == 0:
        return state.moved
    times, parts = [], []
    for axis in range(3):
        variance = state.moved.covariance_nm2[:, axis, axis]
        there = np.abs(variance) > ROUNDING * np.abs(variance).sum()
        tau_s, found = remembering(state.moved.tau_s[there], variance[there], state.memory_s)
        of_axis = np.zeros((len(tau_s), 3, 3))
        of_axis[:, axis, axis] = found
        times.append(tau_s)
        parts.append(of_axis)
    return RecordedModes(np.concatenate(times), np.concatenate(parts))


def followed_modes(state: BeadState) -> RecordedModes:
    """Modes of x, y and z as a simulation follows them; without memory."""
    if state.stepped is not None:
        return state.moved
    if state.rocking is not None:
        apart = state.rocking.apart
        return with_rocking(by_expansion(apart, state.bending, state.axial), apart, state.modes)
    return by_expansion(state.modes, state.bending, state.axial)


def by_expansion(modes: NormalModes, bending: FloatArray, axial: AxialMotion) -> RecordedModes:
    """Modes of x, y and z, the swinging of the tether and its length apart."""
    of_z = zip(pair_modes(bending, modes), axial.modes, strict=True)
    return joined(modes, *(np.concatenate(each) for each in of_z))


def turned_nm(modes: NormalModes) -> FloatArray:
    """(…, d) what one standard deviation of each mode adds to the recorded height by the bead's
    rotation, its image turning with it (PHYSICS E25)."""
    return np.asarray(modes.amplitude_nm[..., 2, :] - modes.shape[..., UP, :])


def with_turning(moved: RecordedModes, modes: NormalModes, across: int) -> RecordedModes:
    """Motion through the whole potential with what the bead's rotation adds to recorded positions,
    that as in the linear motion.

    Parameters
    ----------
    across : the camera's axis across the field.
    """
    turned = turned_nm(modes)
    aside = modes.amplitude_nm[across] - modes.shape[ACROSS]
    there = np.flatnonzero((turned != 0) | (aside != 0))
    if len(there) == 0:
        return moved
    amplitude = modes.amplitude_nm.T[there]
    amplitude[:, 2] = turned[there]
    added = amplitude[:, :, None] * amplitude[:, None, :]
    # x and y are those of the whole potential: what these modes have of them is taken off again, by
    # modes of their own, as the power of two axes is looked for where both have some
    amplitude[:, across], amplitude[:, 2] = modes.shape[ACROSS][there], 0.0
    sideways = amplitude[:, :, None] * amplitude[:, None, :]
    tau_s = modes.tau_s[there]
    return RecordedModes(
        np.concatenate([moved.tau_s, tau_s, tau_s]),
        np.concatenate([moved.covariance_nm2, added, -sideways]),
    )


def _linear(modes: NormalModes) -> RecordedModes:
    """The linear motion, z with it."""
    amplitude = modes.amplitude_nm.T
    return RecordedModes(modes.tau_s, amplitude[:, :, None] * amplitude[:, None, :])


def with_rocking(moved: RecordedModes, apart: NormalModes, rocking: NormalModes) -> RecordedModes:
    """Motion of a bead whose tilt moves its height (PHYSICS E26): the motion as if it did not, and
    what the linear motion changes by it.

    Parameters
    ----------
    apart, rocking : modes of the linear motion without and with it.
    """
    less, more = _linear(apart), _linear(rocking)
    return RecordedModes(
        np.concatenate([moved.tau_s, more.tau_s, less.tau_s]),
        np.concatenate([moved.covariance_nm2, more.covariance_nm2, -less.covariance_nm2]),
    )


def joined(modes: NormalModes, tau_s: FloatArray, variance_nm2: FloatArray) -> RecordedModes:
    """Modes of the lateral motion, and relaxation times and variances (…, k) of z."""
    amplitude = np.swapaxes(modes.amplitude_nm, -1, -2).copy()
    amplitude[..., 2] = turned_nm(modes)
    linear = amplitude[..., :, None] * amplitude[..., None, :]
    upward = np.zeros((*tau_s.shape, 3, 3))
    upward[..., 2, 2] = variance_nm2
    return RecordedModes(
        np.concatenate([modes.tau_s, tau_s], axis=-1), np.concatenate([linear, upward], axis=-3)
    )
