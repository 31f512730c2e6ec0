"""From a bead's motion to what is recorded of it: the later steps of a recording, as covariances.

Motion and hopping pass the camera's exposure; optics scale and turn; what subtraction left of the
stage is added, in recorded nm; the tracker adds white noise; the clock loses frames. Each step
takes sums of exponential covariances to such sums, so that spectra stay closed forms (PHYSICS
section 3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtpipe.experiment.description import Experiment, ForceCourse, Hopping
from mtpipe.experiment.recorded_modes import BeadState, recorded_modes
from mtpipe.physics.camera import Camera, FloatArray, frame_variance, lag_one_covariance

# Heights along a force's course follow from those at so many forces.
COURSE_POINTS = 5
# A random walk is a mode that relaxes within so many durations of the trace.
WALK_DURATIONS = 20.0


@dataclass(frozen=True, eq=False)
class Readout:
    """Covariances of the recorded x, y, z of a plateau.

    Attributes
    ----------
    tau_s : (m,) relaxation times of modes that pass the exposure; covariance_nm2 : (m, 3, 3).
    white_nm2 : (3, 3) covariance of what is independent from frame to frame; may be negative where
        lost frames take correlation away.
    extension_nm : mean of the recorded z.
    walks : whether the last mode is a random walk, of which only this plateau's part is in it.
    """

    tau_s: FloatArray
    covariance_nm2: FloatArray
    white_nm2: FloatArray
    extension_nm: float
    walks: bool


def readout(experiment: Experiment, state: BeadState, duration_s: float) -> Readout:
    """What is recorded of a bead at one force, without vibration lines."""
    motion = recorded_modes(state)
    tau_s, covariance = motion.tau_s, motion.covariance_nm2
    if experiment.hopping is not None:
        energy = experiment.fluid.thermal_energy_pN_nm
        variance, hop_s, _ = hopping_moments(experiment.hopping, state.force_pN, energy)
        extra = np.zeros((1, 3, 3))
        extra[0, 2, 2] = variance
        tau_s, covariance = np.append(tau_s, hop_s), np.concatenate([covariance, extra])
    optics = experiment.optics.matrix
    covariance = optics @ covariance @ optics.T
    if experiment.optics.bend != 0:
        gain = np.ones(3)
        gain[2] = _bent(experiment, state)[1]
        covariance = covariance * np.outer(gain, gain)
    walks = any(experiment.stage.unsubtracted_nm_per_root_s)
    if walks:
        walk = np.square(experiment.stage.unsubtracted_nm_per_root_s)
        walk_s = WALK_DURATIONS * duration_s
        # a mode of variance D τ/2 and relaxation τ spreads like a random walk of D per second
        tau_s = np.append(tau_s, walk_s)
        covariance = np.concatenate([covariance, np.diag(walk * walk_s / 2)[None]])
    white = np.diag(np.square(experiment.tracker.noise_nm))
    if experiment.clock.dropped_share > 0:
        tau_s, covariance, lost = _with_dropped_frames(
            tau_s, covariance, experiment.camera, experiment.clock.dropped_share
        )
        white = white + lost
    height = recorded_height_nm(experiment, state)
    return Readout(tau_s, covariance, white, height, walks)


def recorded_height_nm(experiment: Experiment, state: BeadState) -> float:
    """Mean of the recorded z of a bead at one force."""
    if experiment.optics.bend != 0:
        return _bent(experiment, state)[0] + experiment.optics.z_zero_nm
    return _scaled_height_nm(experiment, state) + experiment.optics.z_zero_nm


def _scaled_height_nm(experiment: Experiment, state: BeadState) -> float:
    """Mean height as scaled alike everywhere."""
    extension = state.extension_nm
    if experiment.hopping is not None:
        energy = experiment.fluid.thermal_energy_pN_nm
        extension += hopping_moments(experiment.hopping, state.force_pN, energy)[2]
    return experiment.optics.axial_scale * extension


def _bent(experiment: Experiment, state: BeadState) -> tuple[float, float]:
    """Mean height where z's scale changes at some height, and what small motion is scaled by.

    Of Gaussian z, with u its mean's distance from the bend in standard deviations σ: the mean of
    max(z − bend, 0) is σ (φ(u) + u Φ(u)), and it goes with z by Φ(u) (Booton 1954, statistical
    linearization).
    """
    optics, height = experiment.optics, _scaled_height_nm(experiment, state)
    variance = float(recorded_modes(state).covariance_nm2[:, 2, 2].sum())
    if experiment.hopping is not None:
        energy = experiment.fluid.thermal_energy_pN_nm
        variance += hopping_moments(experiment.hopping, state.force_pN, energy)[0]
    sigma = optics.axial_scale * math.sqrt(variance)
    u = (height - optics.bend_from_nm) / sigma
    above = 0.5 * math.erfc(-u / math.sqrt(2))
    density = math.exp(-(u**2) / 2) / math.sqrt(2 * math.pi)
    return height + optics.bend * sigma * (density + u * above), 1 + optics.bend * above


def force_course(course: ForceCourse, points: int) -> FloatArray:
    """(points,) force along a plateau over its mean, less 1; the change itself sums up to 0."""
    time = (np.arange(points) + 0.5) / points
    if course.kind == "ramp":
        shape = time
    elif course.kind == "settling":
        shape = -np.exp(-time / course.at)
    else:
        # a point that the step lies in has a part of it
        shape = np.clip(points * (time - course.at) + 0.5, 0.0, 1.0)
    return np.asarray(course.relative_change * (shape - shape.mean()))


def height_weights(nodes: FloatArray, relative: FloatArray) -> FloatArray:
    """(nodes, places) weights that heights at some forces have in those at others: of the
    polynomial of ln of the force through them. Heights bend with it far less than they rise with
    it.

    Parameters
    ----------
    nodes, relative : forces over one of them, less 1.
    """
    at, places = np.log1p(nodes), np.log1p(relative)
    others = ~np.eye(len(at), dtype=bool)
    above = np.where(others[:, :, None], places - at[:, None], 1.0)
    below = np.where(others, at[:, None] - at, 1.0)
    return np.asarray(np.prod(above, axis=1) / np.prod(below, axis=1)[:, None])


def hopping_moments(
    hopping: Hopping, force_pN: float, thermal_energy_pN_nm: float
) -> tuple[float, float, float]:
    """Variance (nm²), relaxation time (s) and mean (nm) of hopping at a force (PHYSICS E19).

    The longer state gains F·step; both rates change by half of it (a barrier half-way).
    """
    half = (force_pN - hopping.half_force_pN) * hopping.step_nm / (2 * thermal_energy_pN_nm)
    half = min(max(half, -300.0), 300.0)
    share = 1 / (1 + math.exp(-2 * half))
    rate = 2 * hopping.rate_hz * math.cosh(half)
    return hopping.step_nm**2 * share * (1 - share), 1 / rate, hopping.step_nm * share


def _with_dropped_frames(
    tau_s: FloatArray, covariance: FloatArray, camera: Camera, share: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Modes when frames are lost and the file counts on, and the white part that appears.

    PHYSICS E13: q → (1 − p) q/(1 − p q), c₁ → c₁ (1 − p)/(1 − p q), c₀ unchanged; written as a mode
    of the new relaxation time.
    """
    q = np.exp(-camera.frame_s / tau_s)
    slower = (1 - share) * q / (1 - share * q)
    changed_s = -camera.frame_s / np.log(np.maximum(slower, 1e-300))
    unit = np.ones_like(tau_s)
    lag_one = lag_one_covariance(unit, tau_s, camera) * (1 - share) / (1 - share * q)
    gain = lag_one / lag_one_covariance(unit, changed_s, camera)
    left = frame_variance(unit, tau_s, camera) - gain * frame_variance(unit, changed_s, camera)
    return (
        np.asarray(changed_s),
        np.asarray(gain[:, None, None] * covariance),
        np.asarray(np.einsum("m,mab->ab", left, covariance)),
    )
