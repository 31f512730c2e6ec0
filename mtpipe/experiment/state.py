"""A tethered bead at one force: where it is on average, and the linear motion about it.

Coordinates, in this order: along the field, across it, away from the surface and, where the bead
turns, the angle about the field's axis. The bead hangs by its lowest point, so across the field it
is a pendulum of the tether (L) and the bead (R) (Daldrop et al. 2015); along the field the bead's
axis is held and the tether alone swings. L is the mean height of the tether's end: with it
kT L/F is the variance along the field exactly, for any chain (PHYSICS section 0).

The tether's end swings on a sphere, so lateral motion shortens z by a quadratic form of the lateral
coordinates (PHYSICS E20), and a little more because a tilted tether is pulled less. The tether's
own length moves in the chain's potential, which stiffens, and with the friction of each height
(`mtpipe.physics.axial`): the harmonic z among the coordinates is only its first approximation.
Where the force is so low that this does not hold, an experiment can ask for the whole motion
(`mtpipe.experiment.whole_motion`).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from mtpipe.errors import FitError
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.frictions import LEAST_HEIGHT_NM, frictions_at
from mtpipe.experiment.whole_motion import whole_motion
from mtpipe.physics.axial import AxialMotion
from mtpipe.physics.camera import FloatArray, power_spectrum
from mtpipe.physics.linear import LinearMotion, NormalModes, normal_modes, pair_modes
from mtpipe.physics.memory import memory_time_s, remembering
from mtpipe.physics.tether import Chain, log_distance_density, moments
from mtpipe.physics.tethered_bead import friction_pN_s_per_nm

ALONG, ACROSS, UP, ANGLE = range(4)
# Nodes and weights of the mean over a Gaussian distribution of heights.
_HEIGHTS, _HEIGHT_WEIGHTS = np.polynomial.hermite_e.hermegauss(7)
_HEIGHT_WEIGHTS = _HEIGHT_WEIGHTS / _HEIGHT_WEIGHTS.sum()
LEAST_SHARE = 0.05
# Grid of the tether's length: how far it reaches, in standard deviations and in kT of depth.
GRID_NODES, GRID_SPREADS, GRID_DEPTH = 96, 10.0, 30.0
# Below this share of an axis's variance a mode is rounding error.
ROUNDING = 1e-9
MOST_KNOWN = 8192
MOST_GIVING, LEAST_STRAIGHT = 0.1, 0.3
# Mean square tilts of the tether, kT/FL, between which motion through the whole potential takes
# over, where that is asked for. At the larger one slow power of z by expansion is too small by 5 %
# (contour 7 µm) to 14 % (0.3 µm).
WHOLE_TILT = (0.004, 0.006)


@dataclass(frozen=True, eq=False)
class RecordedModes:
    """Exponential covariances that sum up to the motion: τ (m,), covariance (m, 3, 3)."""

    tau_s: FloatArray
    covariance_nm2: FloatArray


@dataclass(frozen=True, eq=False)
class WholeMotion:
    """Motion through the whole potential: its modes, and the experiment, for those who follow it
    step by step.
    """

    experiment: Experiment
    modes: RecordedModes


@dataclass(frozen=True, eq=False)
class BeadState:
    """A bead at one force.

    Attributes
    ----------
    extension_nm : mean height of the bead's lowest point, the mean of z.
    motion : the linear motion about the mean; its readout is (x, y, z) of the camera.
    modes : its normal modes.
    bending : (d, d); z is ½ Xᵀ bending X above the linear motion, apart from its mean.
    axial : motion away from the surface, but for the swinging of the tether.
    whole : motion through the whole potential, which stands for all of these but the extension;
        None where they describe it.
    memory_s : time of hydrodynamic memory, which is in none of them; 0: none.
    """

    force_pN: float
    extension_nm: float
    motion: LinearMotion
    modes: NormalModes
    bending: FloatArray
    axial: AxialMotion
    whole: WholeMotion | None = None
    memory_s: float = 0.0

    @property
    def upward(self) -> int:
        """Which of the modes is the harmonic motion away from the surface."""
        return int(np.argmax(np.abs(self.modes.amplitude_nm[2])))


def bead_state(experiment: Experiment, force_pN: float) -> BeadState:
    """State of the experiment's bead at a force.

    Raises
    ------
    FitError : the force is too small to keep the bead off the surface.
    """
    energy, bead = experiment.fluid.thermal_energy_pN_nm, experiment.bead
    tether = _tether(experiment.chain, force_pN)
    end, variance = tether.end_nm, tether.variance_nm2
    # a tilted tether is pulled by F cos only, and gives way by so much where the tilt is slow; as
    # it is about as fast as the tether's own length, half of it is taken
    gives = min(0.5 * force_pN * variance / (end * energy), MOST_GIVING)
    stiffness, swing, turn = _lateral(experiment, force_pN, end)
    sideways = np.delete(np.arange(len(stiffness)), UP)
    covariance = energy * np.linalg.inv(stiffness[np.ix_(sideways, sideways)])
    sinks = float(np.sum((swing + turn)[np.ix_(sideways, sideways)] * covariance)) / 2
    # the chain's mean height has the swinging of a free end in it, kT/F; what this bead's swinging
    # and tilting lowers it by stands in its place. A tether that is attached beside the bead's
    # lowest point ends above it
    extension = end - (bead.radius_nm - bead.lever_nm) + energy / force_pN - sinks
    whole, share = None, _whole_share(experiment, energy / (force_pN * end))
    if share > 0:
        mean, whole = _whole(experiment, tether, force_pN)
        extension = mean if share == 1 else share * mean + (1 - share) * extension
    if not extension > 0:
        raise FitError(
            f"at {force_pN:g} pN the tether does not hold the bead off the surface "
            f"(mean extension {extension:.0f} nm)"
        )
    ways = np.array([1 + gives, 1 + gives])
    # each way of swinging scatters by ½ (kT/F)² in equilibrium, and that of a tilted chain's length
    # is in it: what they have beyond is not the straight chain's
    tilted = (energy / force_pN) ** 2 / 2 * float(np.sum(ways**2 - 1))
    straight = max(variance - tilted, LEAST_STRAIGHT * variance)
    stiffness[UP, UP] = energy / straight
    readout = np.zeros((3, len(stiffness)))
    readout[experiment.along, ALONG] = readout[1 - experiment.along, ACROSS] = readout[2, UP] = 1
    # heights where the bead spends its time; the outermost are not below the surface
    heights = np.maximum(extension + np.sqrt(variance) * _HEIGHTS, LEAST_SHARE * extension)
    motion = LinearMotion(stiffness, _friction(experiment, heights, len(stiffness)), readout)
    allowed = straight * experiment.allowance.upward_variance
    axial = _axial(experiment, tether, extension, allowed)
    bending = -(1 + gives) * swing - turn
    modes = normal_modes(motion, energy)
    # a share of memory is all of it with a shorter time
    fluid = experiment.fluid
    memory_s = fluid.memory**2 * memory_time_s(bead.radius_nm, fluid.viscosity_mPa_s)
    state = BeadState(force_pN, extension, motion, modes, bending, axial, None, memory_s)
    if whole is None:
        return state
    if share < 1:
        whole = _mixed(whole, share, _without_memory(state))
    return replace(state, whole=WholeMotion(experiment, whole))


def has_whole_motion(experiment: Experiment) -> bool:
    """Whether the experiment asks for motion through the whole potential, and has one.

    A bead that hangs stiffly on its tether is an approximation of one that turns, and has no
    potential; one that is attached beside its lowest point and may tilt leans, which the
    description leaves out.
    """
    leans = experiment.magnets.alignment_pN_nm is not None and experiment.bead.offset_nm > 0
    return experiment.anharmonic and experiment.bead.turns and not leans


def _whole_share(experiment: Experiment, tilt: float) -> float:
    """How much of the motion is that through the whole potential; the rest is by expansion."""
    low, high = WHOLE_TILT
    return min(max((tilt - low) / (high - low), 0.0), 1.0) if has_whole_motion(experiment) else 0.0


def _mixed(one: RecordedModes, share: float, other: RecordedModes) -> RecordedModes:
    return RecordedModes(
        np.concatenate([one.tau_s, other.tau_s]),
        np.concatenate([share * one.covariance_nm2, (1 - share) * other.covariance_nm2]),
    )


def _whole(experiment: Experiment, tether: _Tether, force_pN: float) -> tuple[float, RecordedModes]:
    """Mean height and motion through the whole potential."""
    mean, tau_s, covariance = whole_motion(experiment, force_pN, tether.distance_nm, tether.weight)
    # a motion that is larger on a softer spring is slower, too
    softer = experiment.allowance.upward_variance
    tau_s = np.where(covariance[:, 2, 2] > 0, softer * tau_s, tau_s)
    covariance[:, 2, 2] *= softer
    return mean, RecordedModes(tau_s, covariance)


@functools.lru_cache(maxsize=4096)
def recorded_modes(state: BeadState) -> RecordedModes:
    """Modes of the lateral motion, the pairs of them that bend z, and z's own modes.

    Hydrodynamic memory makes many decays of these, some of them with negative variance.
    """
    without = _without_memory(state) if state.whole is None else state.whole.modes
    if state.memory_s == 0:
        return without
    times, parts = [], []
    for axis in range(3):
        variance = without.covariance_nm2[:, axis, axis]
        there = variance > ROUNDING * variance.sum()
        tau_s, found = remembering(without.tau_s[there], variance[there], state.memory_s)
        of_axis = np.zeros((len(tau_s), 3, 3))
        of_axis[:, axis, axis] = found
        times.append(tau_s)
        parts.append(of_axis)
    return RecordedModes(np.concatenate(times), np.concatenate(parts))


def _without_memory(state: BeadState) -> RecordedModes:
    amplitude = state.modes.amplitude_nm.copy()
    amplitude[2] = 0.0
    linear = np.einsum("am,bm->mab", amplitude, amplitude)
    tau_s, variance = pair_modes(state.bending, state.modes)
    bent = np.zeros((len(tau_s), 3, 3))
    bent[:, 2, 2] = variance
    upward_s, of_z = state.axial.modes
    upward = np.zeros((len(upward_s), 3, 3))
    upward[:, 2, 2] = of_z
    return RecordedModes(
        np.concatenate([state.modes.tau_s, tau_s, upward_s]),
        np.concatenate([linear, bent, upward]),
    )


def expected_spectrum(
    frequency_hz: ArrayLike, state: BeadState, experiment: Experiment, axis: int
) -> FloatArray:
    """One-sided spectrum of a tethered bead's recorded motion along x, y or z, in nm²/Hz.

    With exposure, aliases and tracking noise; without the stage and what removes it.
    """
    camera, noise = experiment.camera, experiment.tracker.noise_nm[axis]
    parts = recorded_modes(state)
    frequency = np.asarray(frequency_hz, dtype=float)[..., None]
    power = power_spectrum(frequency, parts.covariance_nm2[:, axis, axis], parts.tau_s, camera)
    return np.asarray(power.sum(axis=-1) + 2 * camera.frame_s * noise**2)


@dataclass(frozen=True, eq=False)
class _Tether:
    """A chain at one force: mean height of its end, variance of its length, and the density of the
    length, on a uniform grid of distances: weights (sum 1) and deviations from the mean in standard
    deviations.
    """

    end_nm: float
    variance_nm2: float
    distance_nm: FloatArray
    weight: FloatArray
    deviation: FloatArray


# Tethers that are known, by chain and force.
_KNOWN: dict[tuple[Chain, float], _Tether] = {}


def know_tethers(chain: Chain, forces_pN: Sequence[float]) -> None:
    """Work out a tether at several forces, to be known when states are asked for.

    All at once costs hardly more than one.
    """
    missing = [force for force in forces_pN if (chain, force) not in _KNOWN]
    if missing:
        if len(_KNOWN) > MOST_KNOWN:
            _KNOWN.clear()
        found = _tethers(chain, np.array(missing))
        _KNOWN.update(((chain, force), one) for force, one in zip(missing, found, strict=True))


def _tether(chain: Chain, force_pN: float) -> _Tether:
    known = _KNOWN.get((chain, force_pN))
    if known is None:
        know_tethers(chain, [force_pN])
        known = _KNOWN[chain, force_pN]
    return known


def _tethers(chain: Chain, force_pN: FloatArray) -> list[_Tether]:
    found, force = moments(chain, force_pN), force_pN[:, None]
    middle, spread = found.extension_nm, np.sqrt(found.variance_nm2)
    low = np.maximum(middle - GRID_SPREADS * spread, 0.002 * chain.contour_length_nm)
    high = middle + GRID_SPREADS * spread
    if chain.compliance == 0:
        high = np.minimum(high, (1 - 1e-5) * chain.contour_length_nm)
    length = np.linspace(low, high, 4 * GRID_NODES, axis=-1)
    log_density = log_distance_density(chain, force, length)
    there = log_density > log_density.max(axis=-1, keepdims=True) - GRID_DEPTH
    first, last = there.argmax(axis=-1), there.shape[1] - 1 - there[:, ::-1].argmax(axis=-1)
    rows = np.arange(len(length))
    length = np.linspace(length[rows, first], length[rows, last], GRID_NODES, axis=-1)
    log_density = log_distance_density(chain, force, length)
    weight = np.exp(log_density - log_density.max(axis=-1, keepdims=True))
    weight /= weight.sum(axis=-1, keepdims=True)
    deviation = length - np.sum(weight * length, axis=-1, keepdims=True)
    deviation /= np.sqrt(np.sum(weight * deviation**2, axis=-1, keepdims=True))
    ends = zip(found.height_nm.tolist(), found.variance_nm2.tolist(), strict=True)
    return [
        _Tether(end, variance, *distribution)
        for (end, variance), *distribution in zip(ends, length, weight, deviation, strict=True)
    ]


def _axial(
    experiment: Experiment, tether: _Tether, extension_nm: float, variance_nm2: float
) -> AxialMotion:
    """Density of the straight tether's length, of this variance, and the friction there."""
    fluid = experiment.fluid
    height = extension_nm + np.sqrt(variance_nm2) * tether.deviation
    friction = friction_pN_s_per_nm(
        np.maximum(height, LEAST_HEIGHT_NM),
        experiment.bead.radius_nm,
        fluid.viscosity_mPa_s,
        wall=fluid.wall,
        upright=True,
    )
    friction = friction * experiment.allowance.upward_friction
    mobility = np.array(np.broadcast_to(1 / friction, height.shape))
    density = tether.weight / (height[1] - height[0])
    return AxialMotion(height, density, mobility, fluid.thermal_energy_pN_nm)


def _lateral(
    experiment: Experiment, force_pN: float, end_nm: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stiffness of x, y and the bead's angles (z's is 0), and how they lower the bead: twice the
    forms by which the tether's swinging does, and the bead's turning. PHYSICS section 2, E3, E15
    and E20.

    With an angle φ the tether's end is at y − aφ, a the bead's lever; bead and end sink by aφ²/2 +
    (y − aφ)²/2L. Without one the bead hangs stiffly on its tether (across) or keeps upright
    (along).
    """
    lever, magnets = experiment.bead.lever_nm, experiment.magnets
    turns, tilts = experiment.bead.turns, magnets.alignment_pN_nm is not None
    swing = np.zeros((3 + turns + tilts, 3 + turns + tilts))
    turn = np.zeros_like(swing)
    angles = {ACROSS: ANGLE} if turns else {}
    if tilts:
        angles[ALONG] = ANGLE + turns
    for sideways, length in ((ALONG, end_nm), (ACROSS, end_nm + lever)):
        if sideways not in angles:
            swing[sideways, sideways] = 1 / length
            continue
        both = np.ix_([sideways, angles[sideways]], [sideways, angles[sideways]])
        swing[both] = np.array([[1, -lever], [-lever, lever**2]]) / end_nm
        turn[both] = np.array([[0, 0], [0, lever]])
    stiffness = force_pN * (swing + turn)
    stiffness[ALONG, ALONG] += force_pN * magnets.sideways_per_nm
    stiffness[ACROSS, ACROSS] += force_pN * magnets.sideways_per_nm
    if magnets.alignment_pN_nm is not None:
        stiffness[angles[ALONG], angles[ALONG]] += magnets.alignment_pN_nm
    return stiffness, swing, turn


def _friction(experiment: Experiment, heights_nm: FloatArray, coordinates: int) -> FloatArray:
    """Friction matrix: the inverse of the mean mobility over the heights the bead visits.

    It is the mean mobility that sets how a correlation begins to fall (the first cumulant).
    """
    each = frictions_at(experiment, heights_nm, coordinates)
    return np.diag(1 / ((1 / each) @ _HEIGHT_WEIGHTS))
