"""From a bead's motion to what is recorded of it: the later steps of a recording, as covariances.

Motion passes the camera's exposure, and with it what steps of the tether add; optics scale and
turn; what subtraction left of the stage is added, in recorded nm; the tracker adds white noise; the
clock loses frames. Each takes sums of exponential covariances to such sums, so that spectra stay
closed forms (PHYSICS section 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtpipe.experiment.changed import changed
from mtpipe.experiment.description import Experiment, ForceCourse
from mtpipe.experiment.recorded_modes import BeadState, recorded_modes
from mtpipe.experiment.step import Place, Seen, nothing_seen
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera, frame_variance, lag_one_covariance
from mtpipe.physics.lost_frames import between_rows

# Number of forces at which heights are computed where the force changes; others are interpolated.
COURSE_POINTS = 5
# Relaxation time of the mode that stands for a random walk, in durations of the trace.
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
    seen = _behind_optics(experiment, state)
    walks = any(experiment.stage.unsubtracted_nm_per_root_s)
    if walks:
        walk = np.square(experiment.stage.unsubtracted_nm_per_root_s)
        walk_s = WALK_DURATIONS * duration_s
        # a mode of variance D τ/2 and relaxation τ spreads like a random walk of D per second
        seen = seen.with_modes(np.array([walk_s]), np.diag(walk * walk_s / 2)[None])
    noise = np.diag(np.square(experiment.tracker.noise_nm))
    before = len(seen.tau_s)
    seen = _behind(
        changed(seen, white_nm2=seen.white_nm2 + noise), "tracker", state.force_pN, experiment
    )
    if walks and len(seen.tau_s) > before:
        # the walk stays the last of all modes
        order = [*range(before - 1), *range(before, len(seen.tau_s)), before - 1]
        seen = changed(seen, tau_s=seen.tau_s[order], covariance_nm2=seen.covariance_nm2[order])
    tau_s, covariance, white = seen.tau_s, seen.covariance_nm2, seen.white_nm2
    if experiment.clock.dropped_share > 0:
        tau_s, covariance, lost = _with_dropped_frames(
            tau_s, covariance, experiment.camera, experiment.clock.dropped_share
        )
        white = white + lost
    return Readout(tau_s, covariance, white, seen.height_nm + experiment.optics.z_zero_nm, walks)


def recorded_height_nm(experiment: Experiment, state: BeadState) -> float:
    """Mean of the recorded z of a bead at one force."""
    seen = _behind_optics(experiment, state)
    behind = _behind(seen, "tracker", state.force_pN, experiment)
    return behind.height_nm + experiment.optics.z_zero_nm


def _behind_optics(experiment: Experiment, state: BeadState) -> Seen:
    motion = recorded_modes(state)
    seen = Seen(motion.tau_s, motion.covariance_nm2, np.zeros((3, 3)), state.extension_nm)
    seen = _behind(seen, "tether", state.force_pN, experiment)
    seen = seen.through(experiment.optics.matrix)
    return _behind(seen, "optics", state.force_pN, experiment)


def _behind(seen: Seen, place: Place, force_pN: float, experiment: Experiment) -> Seen:
    """What is seen behind all steps of one place."""
    for step in experiment.steps:
        if step.place == place:
            seen = step.expected(seen, force_pN, experiment.fluid.thermal_energy_pN_nm)
    return seen


def height_by_tether_nm(experiment: Experiment, force_pN: float) -> float:
    """What steps of the tether add to the mean height at a force."""
    return _behind(nothing_seen(), "tether", force_pN, experiment).height_nm


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


def _with_dropped_frames(
    tau_s: FloatArray, covariance: FloatArray, camera: Camera, share: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Modes when frames are lost and the file counts on, and the white part that appears.

    PHYSICS E13: q → (1 − p) q/(1 − p q), c₁ → c₁ (1 − p)/(1 − p q), c₀ unchanged; written as a mode
    of the new relaxation time.
    """
    q = np.exp(-camera.frame_s / tau_s)
    slower = between_rows(q, share)
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
