"""One bead of a recording, made ready: its traces, its references, and the model to fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.crosschecking.starts import with_starts
from mtpipe.drift.combine import combined
from mtpipe.drift.largest_motion import LargestMotion, largest_motion
from mtpipe.drift.lowpass import coefficients
from mtpipe.experiment.changes import by_formula
from mtpipe.experiment.description import Experiment, Rest, Triple
from mtpipe.experiment.from_setup import experiment_of, pinned_noise_nm
from mtpipe.experiment.known_force import known_force
from mtpipe.experiment.parameter import noise_parameters
from mtpipe.ground.errors import FitError, RecordingError
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.data import plateau_data, whitening
from mtpipe.joint_fit.expectation import Subtraction
from mtpipe.joint_fit.fit import ConfiguredFit, fit_configured
from mtpipe.joint_fit.known_forces import known_force_nats
from mtpipe.joint_fit.model import ConfiguredModel
from mtpipe.joint_fit.parameters import (
    allowance_parameters,
    exposure_parameters,
    stated_parameters,
    z_zero_parameter,
)
from mtpipe.physics.tether import Formula
from mtpipe.recording.recording import Plateau, Recording, ReferenceUse, States
from mtpipe.recording.traces import traces_of
from mtpipe.states.focus import focus_numbers

# No reference bead shows the surface better than this: its bottom is not the tether's anchor.
Z_ZERO_STDERR_NM = 0.3
# Formulas of the chain that a setup may mean; it does not say, and the data choose.
FORMULAS: tuple[Formula, ...] = ("marko-siggia", "bouchiat")
# Nats by which another formula has to fit better than the first, which the baseline is stated with
# (te Velthuis et al. 2010). Formulas that differ by less cannot be told apart; where they differ by
# more, the wrong one makes a misfit.
OTHER_FORMULA_NATS = 3.0
FEWEST_FRAMES = 256
# The stage's motion is measured from 1/16 to 1/2 of the cutoff frequency of its subtraction.
STAGE_BELOW = 16.0


@dataclass(frozen=True, eq=False)
class PreparedBead:
    """A bead to be cross-checked.

    Attributes
    ----------
    plateaus : those that enter, in time order.
    positions_nm : per plateau (n, 3), drift subtracted, NaN where lost or mistracked.
    references_nm : per plateau (n, 3), what is left of the reference beads' mean once the drift
        that was subtracted is taken off; None without references.
    camera_offset_nm : per plateau (n, 3), what positions lack to the camera's own: the drift.
    starts : frame number at which each plateau starts.
    phi : per plateau, prewhitening of each axis.
    pixel_nm : size of a pixel, or None where the setup does not state it.
    lines_hz : narrow lines that have bins of their own (`lines`), strongest first.
    focus : per plateau, how many times the focus was moved before it.
    reference_loose : whether a reference bead in use moves on its own, as its own trace shows.
    reference_largest : how far the references' mean can move by itself; None without references.
    """

    bead: str
    plateaus: tuple[Plateau, ...]
    positions_nm: tuple[FloatArray, ...]
    references_nm: tuple[FloatArray, ...] | None
    camera_offset_nm: tuple[FloatArray, ...]
    starts: tuple[int, ...]
    phi: tuple[tuple[float, ...], ...]
    fit: ConfiguredFit
    pixel_nm: float | None = None
    lines_hz: tuple[float, ...] = ()
    focus: tuple[int, ...] = ()
    reference_loose: bool = False
    reference_largest: LargestMotion | None = None

    @property
    def heights_nm(self) -> tuple[float, ...]:
        """Per plateau, the mean of the recorded z."""
        return tuple(float(one.mean_nm[2]) for one in self.fit.model.data)

    @property
    def frame_s(self) -> float:
        """Frame interval."""
        return self.fit.model.experiment.camera.frame_s


def prepare(recording: Recording, bead: str) -> PreparedBead:
    """Reduce a bead's recording and fit the configured experiment to it.

    Parameters
    ----------
    recording : with the drift subtracted. Plateaus that are not one state do not enter.

    Raises
    ------
    SetupError : what it pins cannot be.
    RecordingError : drift was not subtracted, z was not recorded, or its zero is not the surface,
        or slow motion was removed by a high-pass.
    FitError : no plateau is long enough, or nothing fits.
    """
    if recording.drift is not None and recording.drift.method == "highpass":
        raise RecordingError(
            f"bead {bead} has lost its own slow motion with the drift",
            where=recording.name,
            mend='Subtract reference beads instead ([drift] method = "reference").',
        )
    if recording.drift is None and recording.setup.beads.reference:
        raise RecordingError(
            "the drift was not subtracted",
            where=recording.name,
            mend="Pass mtpipe.subtract_drift(recording).",
        )
    if math.isinf(recording.z_zero_stderr_nm.get(bead, 0.0)):
        raise RecordingError(f"bead {bead} has no heights above the surface", where=recording.name)
    rate = recording.setup.camera.frame_rate_hz.value
    states = recording.states if recording.states is not None else States()
    kept, positions, starts = [], [], []
    for trace in traces_of(recording, bead):
        if (bead, trace.plateau.number) in states.refused:
            continue
        there = np.asarray(np.isfinite(trace.position_nm).all(axis=1))
        successive = int((there[1:] & there[:-1]).sum())
        moves = bool(there.any()) and bool(np.all(np.ptp(trace.position_nm[there], axis=0) > 0))
        if int(there.sum()) >= FEWEST_FRAMES and 2 * successive >= FEWEST_FRAMES and moves:
            kept.append(trace.plateau)
            positions.append(trace.position_nm)
            starts.append(int(recording.frame[trace.plateau.start]))
    if not kept:
        raise FitError(f"bead {bead} has no plateau of {FEWEST_FRAMES} frames with x, y and z")
    forces = [1.0] * len(kept)
    pinned = pinned_noise_nm(recording.setup)
    base, _ = experiment_of(
        with_starts(recording.setup, positions),
        forces,
        FEWEST_FRAMES,
        noise_nm=pinned or (0.0, 0.0, 0.0),
        formula=FORMULAS[0],
    )
    frame_s = 1 / rate if rate else base.camera.frame_s
    phi = tuple(whitening(x, frame_s) for x in positions)
    data = tuple(plateau_data(x, frame_s, p) for x, p in zip(positions, phi, strict=True))
    rests = tuple(
        Rest(1.0, len(x), math.nan if p.magnet_mm is None else p.magnet_mm)
        for x, p in zip(positions, kept, strict=True)
    )
    noise = recording.setup.model.noisy and pinned is None
    zero = math.hypot(Z_ZERO_STDERR_NM, _origin_stderr_nm(recording, bead))
    parameters = (
        *stated_parameters(recording.setup),
        *exposure_parameters(recording.setup, base.camera),
        *(noise_parameters((2.0, 2.0, 3.0)) if noise else ()),
        z_zero_parameter(zero),
        *allowance_parameters(),
    )
    subtraction = subtraction_of(recording)
    reference = _reference_mean(recording)
    largest: LargestMotion | None = None
    if reference is not None:
        whole = [_on_grid(recording, reference, plateau) for plateau in kept]
        largest = largest_motion(whole, base.camera)
    loose = any(use.used and use.loose for use in _references(recording))
    # of a reference that moves on its own nobody knows how much is the stage's
    if reference is not None and not loose:
        walk = _stage(reference, kept, subtraction, 1 / frame_s)
        subtraction = replace(subtraction, stage_nm_per_root_s=walk)
    pixel = recording.setup.camera.pixel_size_nm
    begins_s = tuple((start - int(recording.frame[0])) * frame_s for start in starts)
    experiment = replace(base, rests=rests)
    known = tuple(
        None
        if plateau.number in states.unbelieved
        else known_force(recording.setup, plateau.magnet_mm)
        for plateau in kept
    )
    model = ConfiguredModel(
        data,
        experiment,
        parameters,
        subtraction,
        begins_s,
        known_forces=known if any(known) else (),
    )
    return PreparedBead(
        bead,
        tuple(kept),
        tuple(positions),
        None if reference is None else _left_of_reference(recording, reference, kept),
        _subtracted(recording, bead, kept),
        tuple(starts),
        phi,
        preferred_fit(model),
        None if pixel is None else pixel.value,
        focus=focus_numbers(recording, kept),
        reference_loose=loose,
        reference_largest=largest,
    )


def _origin_stderr_nm(recording: Recording, bead: str) -> float:
    """Standard error of z = 0: of the bead's touch, or of the start of the subtracted drift."""
    touched = recording.z_zero_stderr_nm.get(bead)
    if touched is not None:
        return touched
    return 0.0 if recording.drift is None else _finite(recording.drift.start_stderr_nm[2])


def preferred_fit(model: ConfiguredModel) -> ConfiguredFit:
    """The fit with the chain's formula that the data ask for.

    Raises
    ------
    FitError : nothing fits.
    """
    experiments = [by_formula(model.experiment, formula) for formula in FORMULAS]
    fits = [fit_configured(replace(model, experiment=one)) for one in experiments]
    return max(fits, key=preference)


def preference(fit: ConfiguredFit) -> float:
    """`support` of a fit, and for the usual formula of the chain the nats by which others have to
    be better.
    """
    usual = fit.model.experiment.chain.formula_without_stretching == FORMULAS[0]
    return support(fit) + (OTHER_FORMULA_NATS if usual else 0.0)


def support(fit: ConfiguredFit) -> float:
    """ln likelihood of spectra and heights plus that of the forces that the setup states (nats), by
    which the chain's formula is chosen.
    """
    return fit.log_likelihood + known_force_nats(fit)


def subtraction_of(recording: Recording) -> Subtraction:
    """Noise that drift subtraction put into the traces."""
    drift = recording.drift
    if drift is None or drift.method != "reference":
        return Subtraction((None, None, None), (0.0, 0.0, 0.0))
    x, y, z = (
        math.sqrt(
            sum(
                (use.weight[axis] * _finite(use.noise_nm[axis])) ** 2
                for use in drift.references
                if use.used
            )
        )
        for axis in range(3)
    )
    return Subtraction(drift.cutoff_hz, (x, y, z))


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def _references(recording: Recording) -> Sequence[ReferenceUse]:
    return () if recording.drift is None else recording.drift.references


def _reference_mean(recording: Recording) -> FloatArray | None:
    """(n, 3) weighted mean of the reference beads in use; None without."""
    used = [use for use in _references(recording) if use.used]
    if not used:
        return None
    rate = float(1 / np.median(np.diff(recording.time_s)))
    return np.column_stack(
        [
            combined(
                [recording.positions_nm[use.bead][:, axis] for use in used],
                np.array([max(use.weight[axis], 1e-6) for use in used]),
                rate,
            )
            for axis in range(3)
        ]
    )


def _left_of_reference(
    recording: Recording, mean: FloatArray, plateaus: list[Plateau]
) -> tuple[FloatArray, ...]:
    """Per plateau (n, 3), on the camera's grid: the references without what was subtracted."""
    subtracted = 0.0 if recording.drift is None else recording.drift.subtracted_nm
    return tuple(_on_grid(recording, mean - subtracted, plateau) for plateau in plateaus)


def _subtracted(recording: Recording, bead: str, plateaus: list[Plateau]) -> tuple[FloatArray, ...]:
    """Per plateau (n, 3), on the camera's grid: the drift that was subtracted from the bead."""
    drift = recording.drift
    taken = np.zeros((len(recording.time_s), 3)) if drift is None else drift.of_bead(bead)
    return tuple(_on_grid(recording, taken, plateau) for plateau in plateaus)


def _on_grid(recording: Recording, series: FloatArray, plateau: Plateau) -> FloatArray:
    """A plateau of a series (n, axes) on the camera's grid, NaN where no frame is."""
    rows = slice(plateau.start, plateau.stop)
    frame = recording.frame[rows] - recording.frame[plateau.start]
    grid = np.full((int(frame[-1]) + 1, series.shape[1]), np.nan)
    grid[frame] = series[rows]
    return grid


def _stage(
    mean_nm: FloatArray, plateaus: Sequence[Plateau], subtraction: Subtraction, rate_hz: float
) -> Triple:
    """Random walk of the stage in nm/√s per axis: the median of the plateaus.

    In others someone may have turned the focus, or a reference may have been lost for a while.
    """
    found = [0.0, 0.0, 0.0]
    for axis, cutoff in enumerate(subtraction.cutoff_hz):
        if cutoff is None:
            continue
        walks = [
            _walk_nm2_per_s(mean_nm[one.start : one.stop, axis], cutoff, rate_hz)
            for one in plateaus
        ]
        known = [walk - subtraction.noise_nm[axis] ** 2 * noise for walk, noise in walks if noise]
        found[axis] = math.sqrt(max(float(np.median(known)), 0.0)) if known else 0.0
    return found[0], found[1], found[2]


def _walk_nm2_per_s(
    reference_nm: FloatArray, cutoff_hz: float, rate_hz: float
) -> tuple[float, float]:
    """Square of a random walk in nm/√s, from a reference below its cutoff, and what 1 nm of noise
    adds to it; 0 where too little is known.

    Only there can it be told from tracking noise, and only about there is any of it left in the
    traces. A random walk of σ nm/√s has σ² rate/(2πf)² per cosine coefficient.
    """
    known = np.flatnonzero(np.isfinite(reference_nm))
    if len(known) < FEWEST_FRAMES:
        return 0.0, 0.0
    found = coefficients(reference_nm[known[0] : known[-1] + 1])
    frequency = np.arange(len(found)) * rate_hz / (2 * len(found))
    below = (frequency > cutoff_hz / STAGE_BELOW) & (frequency < cutoff_hz / 2)
    if not below.any():
        return 0.0, 0.0
    rises = (2 * np.pi * frequency[below]) ** 2 / rate_hz
    return float(np.mean(found[below] ** 2 * rises)), float(np.mean(rises))


def described(case: PreparedBead) -> Experiment:
    """The fitted experiment."""
    return case.fit.model.described(case.fit.theta)
