"""A tethered bead at one force: where it is on average, and the linear motion about it.

Coordinates, in this order: along the field, across it, away from the surface and, where the bead
turns, the angle about the field's axis. The bead hangs by its lowest point, so across the field it
is a pendulum of the tether (L) and the bead (R) (Daldrop et al. 2015); along the field the bead's
axis is held and the tether alone swings. L is the mean height of the tether's end: with it
kT L/F is the variance along the field exactly, for any chain (PHYSICS section 0).

The tether's end swings on a sphere, so lateral motion shortens z by a quadratic form of the lateral
coordinates (PHYSICS E20), and the tether's length follows it: z's spectrum is that of both together
(`mtpipe.physics.coupled_height`). By expansion about the mean they are apart: lateral motion
shortens z by a little more than it swings, the length moves in the chain's potential, which
stiffens, and with the friction of each height (`mtpipe.physics.axial`). A simulation follows those
two, and gives z the power that it has.

At low force the tether's restoring force is not linear any more, and the surface is a wall. An
experiment can ask for the whole motion there (`mtpipe.experiment.whole_motion`); one that does not
is described by expansion alone, which is what it leaves out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mtpipe.experiment.changed import changed
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.frictions import LEAST_HEIGHT_NM, frictions_at
from mtpipe.experiment.lateral import Lateral, lateral
from mtpipe.experiment.recorded_modes import (
    ACROSS,
    ALONG,
    ANGLE,
    UP,
    BeadState,
    RecordedModes,
    Rocking,
    by_expansion,
    joined,
    recorded_modes,
    with_rocking,
    with_turning,
)
from mtpipe.experiment.tethers import Tether, tethers_at
from mtpipe.experiment.whole_motion import whole_motion
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.physics.axial import AxialMotion
from mtpipe.physics.camera import power_spectrum
from mtpipe.physics.coupled_height import coupled_height_modes
from mtpipe.physics.linear import LinearMotion, NormalModes, normal_modes
from mtpipe.physics.memory import memory_time_s
from mtpipe.physics.tethered_bead import friction_pN_s_per_nm

# Nodes and weights of the mean over a Gaussian distribution of heights.
_HEIGHTS, _HEIGHT_WEIGHTS = np.polynomial.hermite_e.hermegauss(7)
_HEIGHT_WEIGHTS = _HEIGHT_WEIGHTS / _HEIGHT_WEIGHTS.sum()
LEAST_SHARE = 0.05
MOST_GIVING, LEAST_STRAIGHT = 0.1, 0.3
# Relative step of the force for numerical derivatives.
DIFFERENCE = 1e-3
# Mean square tilts of the tether, kT/FL, between which the model of a turning bead changes: the
# closed form below the first, at low force (above the second) the whole potential, or the expansion
# where the whole potential is not asked for; a mixture between.
LOW_TILT = (0.02, 0.025)
# The same for a bead without a whole potential: it keeps the closed form until the surface matters.
SLACK_TILT = (0.1, 0.2)


def bead_state(experiment: Experiment, force_pN: float) -> BeadState:
    """State of the experiment's bead at a force.

    Raises
    ------
    FitError : the force is too small to keep the bead off the surface.
    """
    return all_states(experiment, [force_pN])[0]


def all_states(experiment: Experiment, forces_pN: Sequence[float]) -> list[BeadState]:
    """States of the experiment's bead at several forces.

    Raises
    ------
    FitError : one of the forces is too small to keep the bead off the surface.
    """
    found = []
    for state in bead_states(experiment, forces_pN):
        if isinstance(state, FitError):
            raise state
        found.append(state)
    return found


def states_in(
    experiment: Experiment, forces_pN: Sequence[float], plateaus: Sequence[int]
) -> list[BeadState]:
    """As `all_states`, each as the bead is in a plateau (its index)."""
    alike: dict[Experiment, list[int]] = {}
    for i, plateau in enumerate(plateaus):
        # of what only the readout has, states know nothing
        here = changed(experiment.in_plateau(plateau), steps=())
        alike.setdefault(here, []).append(i)
    found: dict[int, BeadState] = {}
    for here, places in alike.items():
        states = all_states(here, [forces_pN[i] for i in places])
        found.update(zip(places, states, strict=True))
    return [found[i] for i in range(len(forces_pN))]


def bead_states(experiment: Experiment, forces_pN: Sequence[float]) -> list[BeadState | FitError]:
    """States of the experiment's bead at several forces, or why there is none at one.

    All at once cost little more than one.
    """
    tethers = tethers_at(experiment.chain, forces_pN)
    force, end = np.array(forces_pN), np.array([tether.end_nm for tether in tethers])
    holding = experiment.magnets.alignment_at(force)
    beside = lateral(experiment, force, end, experiment.magnets.sideways_at(force), holding)
    extension = _heights(experiment, force, end, beside)[0]
    whole: dict[int, RecordedModes] = {}
    found: dict[int, BeadState | FitError] = {}
    if experiment.anharmonic and has_whole_motion(experiment):
        for i, low in enumerate(_low_shares(experiment, force, end)):
            if low > 0:
                try:
                    mean, whole[i] = _whole(experiment, tethers[i], forces_pN[i])
                except FitError as error:
                    # its traceback would keep all that was worked out on the way
                    found[i] = error.with_traceback(None)
                    continue
                extension[i] = mean if low == 1 else low * mean + (1 - low) * extension[i]
    for i in np.flatnonzero(~(extension > 0)).tolist():
        message = (
            f"at {forces_pN[i]:g} pN the tether does not hold the bead off the surface "
            f"(mean extension {extension[i]:.0f} nm)"
        )
        found.setdefault(i, FitError(message))
    if experiment.rocks:
        for i in np.flatnonzero(~beside.stands).tolist():
            said = f"at {forces_pN[i]:g} pN the field does not hold the bead upright"
            found.setdefault(i, FitError(said))
    held = [i for i in range(len(forces_pN)) if i not in found]
    if held:
        states = _held(
            experiment,
            force[held],
            [tethers[i] for i in held],
            extension[held],
            beside.chosen(held),
            [whole.get(i) for i in held],
        )
        found.update(zip(held, states, strict=True))
    return [found[i] for i in range(len(forces_pN))]


def _held(
    experiment: Experiment,
    force_pN: FloatArray,
    tethers: Sequence[Tether],
    extension_nm: FloatArray,
    beside: Lateral,
    whole: Sequence[RecordedModes | None],
) -> list[BeadState]:
    """States at forces that hold the bead off the surface.

    Parameters
    ----------
    force_pN, tethers, extension_nm : n of each, the mean heights.
    beside : of the bead at the forces.
    whole : n, motion through the whole potential, None where that is not taken.
    """
    energy = experiment.fluid.thermal_energy_pN_nm
    end = np.array([tether.end_nm for tether in tethers])
    variance = np.array([tether.variance_nm2 for tether in tethers])
    # a tilted tether is pulled by F cos only. Slow tilts would soften it by all of this; as the
    # tilt is about as fast as the tether's own length, half of it is taken
    gives = 1 + np.minimum(0.5 * force_pN * variance / (end * energy), MOST_GIVING)
    # each way of swinging scatters by ½ (kT/F)² in equilibrium, and that of a tilted chain's length
    # is in it: what they have beyond is not the straight chain's
    tilted = (energy / force_pN) ** 2 * (gives**2 - 1)
    straight = np.maximum(variance - tilted, LEAST_STRAIGHT * variance)
    coordinates = beside.stiffness.shape[-1]
    readout = np.zeros((3, coordinates))
    readout[experiment.along, ALONG] = readout[1 - experiment.along, ACROSS] = readout[2, UP] = 1
    if experiment.bead.turns:
        readout[2, ANGLE] = experiment.bead.z_per_turn_nm
        readout[1 - experiment.along, ANGLE] = experiment.bead.aside_per_turn_nm
    # heights where the bead spends its time; the outermost are not below the surface
    spread, middle = np.sqrt(variance)[:, None], extension_nm[:, None]
    heights = np.maximum(middle + spread * _HEIGHTS, LEAST_SHARE * middle)
    friction = _friction(experiment, heights, coordinates)
    length = energy / straight
    motion = LinearMotion(beside.with_length(length), friction, readout)
    modes = apart = normal_modes(motion, energy)
    if experiment.rocks:
        upright = replace(motion, stiffness=beside.with_length(length, rocks=False))
        apart = normal_modes(upright, energy)
    allowed = straight * experiment.allowance.upward_variance
    axial = _axial(experiment, tethers, extension_nm, allowed)
    bending = -gives[:, None, None] * beside.swing - beside.turn
    closed = _closed(experiment, tethers, force_pN, extension_nm, apart)
    # a share of memory is all of it with a shorter time
    fluid = experiment.fluid
    memory_s = fluid.memory**2 * memory_time_s(experiment.bead.radius_nm, fluid.viscosity_mPa_s)
    found = []
    for i, low in enumerate(_low_shares(experiment, force_pN, end)):
        of_one, moved, by_itself = apart.of(i), closed.of(i), axial.of(i)
        if low > 0:
            lowest = by_expansion(of_one, bending[i], by_itself)
            if (moves := whole[i]) is not None:
                lowest = with_turning(moves, of_one, 1 - experiment.along)
            moved = lowest if low == 1 else _mixed(lowest, low, moved)
        if experiment.rocks:
            moved = with_rocking(moved, of_one, modes.of(i))
        stepped = None if whole[i] is None else experiment
        found.append(
            BeadState(
                float(force_pN[i]),
                float(extension_nm[i]),
                motion.of(i),
                modes.of(i),
                bending[i],
                by_itself,
                moved,
                stepped,
                memory_s,
                Rocking(of_one, beside.stretch[i]) if experiment.rocks else None,
            )
        )
    return found


def has_whole_motion(experiment: Experiment) -> bool:
    """Whether the experiment's bead has a whole potential to move through.

    A bead that hangs stiffly on its tether is an approximation of one that turns, and has no
    potential; one that rocks is only followed about its mean.
    """
    return experiment.bead.turns and not experiment.rocks


def low_share(experiment: Experiment, force_pN: float) -> float:
    """How low a force is: 0 where the closed form of z holds, 1 where it is not taken any more."""
    (tether,) = tethers_at(experiment.chain, [force_pN])
    return float(_low_shares(experiment, np.array([force_pN]), np.array([tether.end_nm]))[0])


def _low_shares(experiment: Experiment, force_pN: FloatArray, end_nm: FloatArray) -> FloatArray:
    tilt = experiment.fluid.thermal_energy_pN_nm / (force_pN * end_nm)
    least, most = LOW_TILT if has_whole_motion(experiment) else SLACK_TILT
    return np.clip((tilt - least) / (most - least), 0.0, 1.0)


def _mixed(one: RecordedModes, share: float, other: RecordedModes) -> RecordedModes:
    return RecordedModes(
        np.concatenate([one.tau_s, other.tau_s]),
        np.concatenate([share * one.covariance_nm2, (1 - share) * other.covariance_nm2]),
    )


def _whole(experiment: Experiment, tether: Tether, force_pN: float) -> tuple[float, RecordedModes]:
    """Mean height and motion through the whole potential."""
    mean, tau_s, covariance = whole_motion(experiment, force_pN, tether)
    return mean, _softer(RecordedModes(tau_s, covariance), experiment)


def _softer(modes: RecordedModes, experiment: Experiment) -> RecordedModes:
    """Modes of one axis each, with z as soft as it is allowed to be."""
    softer, covariance = experiment.allowance.upward_variance, modes.covariance_nm2.copy()
    # what z has of the bead's turning is of one mode with x or y, and no matter of the spring
    upward = (covariance[..., 0, 0] == 0) & (covariance[..., 1, 1] == 0)
    # a motion that is larger on a softer spring is slower, too
    tau_s = np.where(upward, softer * modes.tau_s, modes.tau_s)
    covariance[..., 2, 2] *= np.where(upward, softer, 1.0)
    return RecordedModes(tau_s, covariance)


def _closed(
    experiment: Experiment,
    tethers: Sequence[Tether],
    force_pN: FloatArray,
    extension_nm: FloatArray,
    modes: NormalModes,
) -> RecordedModes:
    """Modes of x, y and z at each force, the swinging and the length of the tether being one
    motion.

    What force does to a mean, times kT, is the covariance with the height it pulls at.
    """
    energy = experiment.fluid.thermal_energy_pN_nm
    aside, step = experiment.magnets.sideways_at(force_pN), DIFFERENCE * force_pN
    rises = np.array([tether.end_variance_nm2 for tether in tethers]) / energy
    end = np.array([tether.end_nm for tether in tethers])
    change = np.concatenate([step, -step])
    force, there = np.tile(force_pN, 2) + change, np.tile(end, 2) + np.tile(rises, 2) * change
    holding = experiment.magnets.alignment_at(np.tile(force_pN, 2))
    beside = lateral(experiment, force, there, np.tile(aside, 2), holding)
    (higher, lower), (more, less) = (
        np.split(one, 2) for one in _heights(experiment, force, there, beside)
    )
    # a force at which the surface holds the tether's end up changes its height by less than theory
    least = LEAST_STRAIGHT * np.array([tether.variance_nm2 for tether in tethers])
    variance = np.maximum(energy * (higher - lower) / (2 * step), least)
    with_height = energy * (more - less) / (2 * step)[:, None, None]
    height = _axial(experiment, tethers, extension_nm, variance)
    return _softer(joined(modes, *coupled_height_modes(height, modes, with_height)), experiment)


def _heights(
    experiment: Experiment,
    force_pN: FloatArray,
    end_nm: FloatArray,
    beside: Lateral,
) -> tuple[FloatArray, FloatArray]:
    """Mean height (n,) of the bead's lowest point, and (n, d, d) covariance of its lateral
    coordinates.

    Parameters
    ----------
    end_nm : (n,) mean heights of the tether's end. beside : of the bead there.
    """
    energy, stiffness = experiment.fluid.thermal_energy_pN_nm, beside.stiffness
    sideways = np.array([i for i in range(stiffness.shape[-1]) if i != UP])
    block = (slice(None), sideways[:, None], sideways)
    covariance = np.zeros_like(stiffness)
    covariance[block] = energy * np.linalg.inv(stiffness[block])
    sinks = np.sum((beside.swing + beside.turn) * covariance, axis=(1, 2)) / 2
    # the chain's mean height has the swinging of a free end in it, kT/F; what this bead's swinging
    # and tilting lowers it by stands in its place. A tether that is attached beside the bead's
    # lowest point ends above it
    below = experiment.bead.radius_nm - experiment.bead.lever_nm
    return end_nm - below + energy / force_pN - sinks, covariance


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


def _axial(
    experiment: Experiment,
    tethers: Sequence[Tether],
    extension_nm: FloatArray,
    variance_nm2: FloatArray,
) -> AxialMotion:
    """Heights of these variances (n,) that scatter as the tether's length does, and the friction
    there, (n, nodes)."""
    fluid = experiment.fluid
    deviation = np.array([tether.deviation for tether in tethers])
    height = extension_nm[:, None] + np.sqrt(variance_nm2)[:, None] * deviation
    friction = friction_pN_s_per_nm(
        np.maximum(height, LEAST_HEIGHT_NM),
        experiment.bead.radius_nm,
        fluid.viscosity_mPa_s,
        wall=fluid.wall,
        upright=True,
    )
    friction = friction * experiment.allowance.upward_friction
    mobility = np.array(np.broadcast_to(1 / friction, height.shape))
    weight = np.array([tether.weight for tether in tethers])
    density = weight / (height[:, 1] - height[:, 0])[:, None]
    return AxialMotion(height, density, mobility, fluid.thermal_energy_pN_nm)


def _friction(experiment: Experiment, heights_nm: FloatArray, coordinates: int) -> FloatArray:
    """Friction matrices (n, d, d): the inverse of the mean mobility over the heights (n, nodes)
    that the bead visits.

    It is the mean mobility that sets how a correlation begins to fall (the first cumulant).
    """
    each = frictions_at(experiment, heights_nm, coordinates)
    mean = 1 / ((1 / each) @ _HEIGHT_WEIGHTS)
    return np.asarray(mean.T[:, :, None] * np.eye(coordinates))
