"""Calibration of a recording: every tethered bead, spread over the machine's cores.

What happens to one bead is `calibration.bead_calibration`'s matter; here are the conditions that
all beads share.
"""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import pandas as pd

from mtpipe.calibration.bead_calibration import Shared, calibrate_bead, measured_friction
from mtpipe.calibration.bead_results import BeadResult
from mtpipe.calibration.exposure_estimate import estimate_exposure
from mtpipe.calibration.friction_prior import viscosity_from_others
from mtpipe.calibration.noise_prior import expected_noise_nm
from mtpipe.calibration.recommended_force import BeadForces
from mtpipe.calibration.spectral_force import forces_of_spectra
from mtpipe.drift.uncorrected import extension_covariance_nm2
from mtpipe.ground.notice import Notice
from mtpipe.ground.processes import Workers, executor
from mtpipe.ground.progress import of_step
from mtpipe.ground.shown import Shown
from mtpipe.ground.steps import Steps, finished
from mtpipe.ground.types import FloatArray, Progress
from mtpipe.recording.recording import Recording
from mtpipe.recording.traces import Trace, traces_of
from mtpipe.setup.conditions import Conditions, conditions_of, usual_errors
from mtpipe.states import with_states

_Job = tuple[str, list[Trace], float, FloatArray | None]


@dataclass(frozen=True, repr=False)
class Calibration(Shown):
    """Calibration of a recording.

    Attributes
    ----------
    conditions : what is known of buffer, beads, field and camera (nm, s, pN).
    beads : results of every tethered bead, by plateau and axis.
    notices : what was assumed, or is wrong, in words.
    unbelieved : numbers of plateaus whose logged magnet position is not to be believed.
    """

    conditions: Conditions
    beads: tuple[BeadResult, ...]
    notices: tuple[Notice, ...]
    unbelieved: frozenset[int] = frozenset()

    def __repr__(self) -> str:
        usable = sum(len(one.usable_pN) for one in self.forces.values())
        plateaus = sum(len(bead.plateaus) for bead in self.beads)
        beads = f"{len(self.beads)} bead{'s' * (len(self.beads) != 1)}"
        return f"Calibration of {beads}: {usable} of {plateaus} forces to use"

    @property
    def table(self) -> pd.DataFrame:
        """A row per bead and plateau: extension (nm) and the force of the spectra (pN)."""
        forces = self.forces
        return pd.DataFrame(
            [
                {
                    "bead": bead.bead,
                    "plateau": one.plateau.number,
                    "magnet_mm": one.plateau.magnet_mm,
                    "extension_nm": one.extension_nm,
                    "extension_stderr_nm": one.extension_stderr_nm,
                    "force_pN": quoted.force.value,
                    "force_stderr_pN": quoted.force.stderr,
                    "force_low_pN": quoted.force.interval[0],
                    "force_high_pN": quoted.force.interval[1],
                    "force_source": quoted.source,
                    "force_status": quoted.force.status,
                }
                for bead in self.beads
                for one in bead.plateaus
                for quoted in [forces[bead.bead].recommended[one.plateau.number]]
            ]
        )

    @property
    def forces(self) -> dict[str, BeadForces]:
        """The forces to quote of each bead, as its spectra give them: nothing is cross-checked."""
        return {bead.bead: forces_of_spectra(bead) for bead in self.beads}


def calibrate(
    recording: Recording,
    *,
    seed: int = 0,
    workers: Workers = 1,
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate every tethered bead of a recording (after drift subtraction).

    Plateaus are tested first for being one state each (`mtpipe.states`).

    Parameters
    ----------
    recording : drift already subtracted, if it is to be.
    seed : of the posteriors; each bead's own seed derives from it and the bead's name.
    workers : processes, or an executor; beads are spread over them.
    progress : called with (beads done, beads); default: a bar in a notebook.

    Raises
    ------
    SetupError : the frame rate is not known.
    """
    with executor(workers, most=len(recording.tethered)) as pool:
        return finished(calibrating(recording, pool, seed=seed, progress=progress))


def calibrating(
    recording: Recording, pool: Executor, *, seed: int, progress: Progress | None
) -> Steps[Calibration]:
    """`calibrate` in steps; beads are spread over a pool."""
    recording = with_states(recording)
    conditions, notices = conditions_of(recording.setup)
    notices = (*notices, *usual_errors(recording.setup))
    beads = {bead: traces_of(recording, bead) for bead in recording.tethered}
    noise = _reference_noise(recording)
    if recording.setup.camera.exposure_s.value is None:
        lateral = None if noise[0] is None or noise[1] is None else (noise[0], noise[1])
        exposure, stderr, notice = estimate_exposure(beads, conditions, lateral)
        conditions = replace(conditions, exposure_s=exposure, exposure_stderr_s=stderr)
        notices = (*notices, notice)
    assert recording.states is not None
    shared = Shared(
        conditions,
        _lowest_frequencies(recording),
        noise,
        recording.setup.tether.contour_length_nm.value or 0.0,
        seed,
        {**recording.states.doubtful, **recording.states.refused},
    )
    jobs = [
        (
            bead,
            traces,
            recording.z_zero_stderr_nm.get(bead, 0.0),
            extension_covariance_nm2(recording, bead),
        )
        for bead, traces in beads.items()
    ]
    say = of_step(progress, "calibrating beads")
    say(0, len(jobs))
    conditions_by_bead = yield from _conditions_by_bead(jobs, shared, pool)
    done = itertools.count(1)
    futures = []
    for job, own in zip(jobs, conditions_by_bead, strict=True):
        expected = expected_noise_nm(recording, job[0], noise)
        known = replace(shared, conditions=own, noise_nm=expected)
        future = pool.submit(calibrate_bead, *job, known)
        future.add_done_callback(lambda _: say(next(done), len(jobs)))
        futures.append(future)
    yield futures
    results = tuple(future.result() for future in futures)
    notices = (
        *notices,
        *_estimated_radii(conditions, results),
        *_shared_viscosity(conditions, conditions_by_bead),
    )
    return Calibration(conditions, results, notices, recording.states.unbelieved)


def _shared_viscosity(conditions: Conditions, by_bead: Sequence[Conditions]) -> list[Notice]:
    """What the beads together say of a viscosity that the setup states with an error."""
    taken = [one.viscosity_mPa_s for one in by_bead]
    if all(one == conditions.viscosity_mPa_s for one in taken):
        return []
    stated = conditions.viscosity_mPa_s
    low, high = min(value for value, _ in taken), max(value for value, _ in taken)
    return [
        Notice(
            "viscosity_shared",
            "info",
            f"The viscosity, {stated[0]:.3f} ± {stated[1]:.3f} mPa s by the setup, was replaced "
            f"for each bead by what the friction of the other beads gives: {low:.3f} to "
            f"{high:.3f} ± {max(stderr for _, stderr in taken):.3f} mPa s. Frictions and "
            "effective radii are relative to that.",
        )
    ]


def _estimated_radii(conditions: Conditions, beads: Sequence[BeadResult]) -> list[Notice]:
    """What was found where the setup calls the radius unknown."""
    if conditions.radius_nm is not None:
        return []
    return [
        Notice(
            "radius_estimated",
            "info",
            f"Its radius, which the setup does not know, is {bead.radius.value:.0f} ± "
            f"{bead.radius.stderr:.0f} nm by its friction and by x against y.",
            bead.bead,
        )
        for bead in beads
        if bead.radius is not None
    ]


def _conditions_by_bead(
    jobs: Sequence[_Job], shared: Shared, pool: Executor
) -> Steps[list[Conditions]]:
    """The conditions of each bead: the buffer as the other beads show it, where it is uncertain."""
    conditions = shared.conditions
    if len(jobs) < 2 or not conditions.viscosity_mPa_s[1] > 0 or conditions.radius_nm is None:
        return [conditions] * len(jobs)
    asked = [pool.submit(measured_friction, *job[1:3], shared) for job in jobs]
    yield asked
    ratios = [future.result() for future in asked]
    return [
        replace(
            conditions,
            viscosity_mPa_s=viscosity_from_others(
                conditions.viscosity_mPa_s,
                [r for j, r in enumerate(ratios) if j != i and r is not None],
                conditions.friction_stderr_apart_from_viscosity,
            ),
        )
        for i in range(len(jobs))
    ]


def _reference_noise(recording: Recording) -> tuple[float | None, float | None, float | None]:
    """Per axis, the white tracking noise of the reference beads in use, in nm."""
    used = [one for one in recording.drift.references if one.used] if recording.drift else []
    if not used:
        return (None, None, None)
    x, y, z = (_median_positive([one.noise_nm[axis] for one in used]) for axis in range(3))
    return (x, y, z)


def _median_positive(values: list[float]) -> float | None:
    known = [value for value in values if value > 0]
    return statistics.median(known) if known else None


def _lowest_frequencies(recording: Recording) -> tuple[float, float, float]:
    drift = recording.drift
    if drift is None or drift.method != "highpass":
        return (0.0, 0.0, 0.0)
    x, y, z = (cutoff or 0.0 for cutoff in drift.cutoff_hz)
    return (x, y, z)
