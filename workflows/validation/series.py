"""A bead's whole series: joint fits of exact simulated traces, compared with their truth.

The series of `series_cases`: fitted with all of it as stated (`measure_joint`), as a recording on a
drifting stage through the whole pipeline (`measure_pipeline`), and with faults that nobody told
mtpipe of (`measure_choice`). Errors are those of logarithms; of noise, of its variance in nm².
"""

from __future__ import annotations

import math
import time

import numpy as np
from series_cases import EXTENSIONS_NM, FORCES_PN, NOISE_NM, RADIUS_NM, Case, Series, draw

import mtpipe
from mtpipe.calibration.bead_prior import bead_prior
from mtpipe.calibration.free_fits import LATERAL, free_fit, friction_ratio
from mtpipe.calibration.friction_prior import FrictionPrior, MeasuredFriction
from mtpipe.calibration.series_choice import FreeTrace, as_series_trace, choose_series
from mtpipe.fit.series import fit_series
from mtpipe.fit.series_model import BeadPrior, SeriesModel
from mtpipe.fit.series_posterior import sample_series
from mtpipe.ground.estimate import CENTRAL_68, Estimate
from mtpipe.recording.recording import AXES
from mtpipe.recording.traces import traces_of
from mtpipe.setup.conditions import conditions_of

# Of the forces, as issue 3 states it, before any uncertainty of the friction but the radius's.
STATED_BOUND = (0.025, 0.019, 0.015, 0.012, 0.010, 0.011, 0.017, 0.040)
DRIFT_NM_PER_ROOT_S = 1.0


def measure_joint(job: tuple[Case, int, int]) -> list[dict[str, object]]:
    """A row per coordinate of the true joint fit of a series without drift."""
    case, seed, repeat = job
    series = draw(case, seed, repeat)
    free, prior, _ = _free_fits(series)
    model = SeriesModel(tuple(one.trace for one in free), prior, force_shared=True)
    began = time.process_time()
    fit = fit_series(model)
    fitted = time.process_time()
    posterior = sample_series(fit, seed=series.random)
    sampled = time.process_time()
    truth = np.array([_truth(name) for name in model.names])
    bound = error_bound(model)
    stderr = np.sqrt(np.diag(fit.covariance))
    low, high = np.quantile(posterior.chain.theta, CENTRAL_68, axis=0)
    return [
        {
            "case": case.name,
            "repeat": repeat,
            "coordinate": name,
            "bound": bound[i],
            "error": fit.theta[i] - truth[i],
            "fit_holds": abs(fit.theta[i] - truth[i]) < stderr[i],
            "posterior_holds": low[i] < truth[i] < high[i],
            "converged": posterior.chain.converged,
            "fit_s": fitted - began,
            "posterior_s": sampled - fitted,
        }
        for i, name in enumerate(model.names)
    ]


def measure_pipeline(job: tuple[Case, int, int]) -> list[dict[str, object]]:
    """A row per plateau of a series recorded on a drifting stage: the steps of `mtpipe run`."""
    case, seed, repeat = job
    raw = draw(case, seed, repeat).recording(DRIFT_NM_PER_ROOT_S)
    (bead,) = mtpipe.calibrate(mtpipe.subtract_drift(raw), seed=repeat).beads
    rows = []
    for plateau, true in zip(bead.plateaus, FORCES_PN, strict=True):
        row: dict[str, object] = {
            "repeat": repeat,
            "plateau": plateau.plateau.number,
            "chosen": bead.series,
            "left_out": bool(bead.left_out),
        }
        x = plateau.axes[0]
        for name, force in (("force", x.force), ("alone", x.force_alone)):
            row |= {f"{name}_{key}": value for key, value in _against(force, true).items()}
        rows.append(row)
    return rows


def measure_choice(job: tuple[Case, int, int]) -> list[dict[str, object]]:
    """One row: what is chosen for a series without drift, and how far its forces are off."""
    case, seed, repeat = job
    series = draw(case, seed, repeat)
    free, prior, contradicted = _free_fits(series)
    choice = choose_series(free, prior, friction_contradicted=contradicted)
    row: dict[str, object] = {"case": case.name, "chosen": "no joint fit"}
    if choice is None:
        return [row]
    model, fit = choice.fit.model, choice.fit
    along = [trace for trace in model.traces if trace.axis == prior.along]
    drives = [model.drive(trace) for trace in along]
    # levers along the field are extensions, which are exact here
    levers = [0.0 if model.force_shared else math.log(trace.extension_nm) for trace in along]
    ln_true = np.log([FORCES_PN[trace.plateau] for trace in along])
    errors = fit.theta[drives] + levers - ln_true
    row |= {
        "chosen": choice.words,
        "left_out": len(choice.left_out),
        "odd_left_out": {t.plateau for t in choice.left_out} == {series.odd},
        "mean_square_pull": np.mean(errors**2 / np.diag(fit.covariance)[drives]),
        "largest_error": np.abs(errors).max(),
    }
    return [row]


def error_bound(model: SeriesModel) -> np.ndarray:
    """(dimensions,) joint Cramér–Rao bound of the standard errors, priors included."""
    truth = np.array([_truth(name) for name in model.names])
    return np.sqrt(np.diag(np.linalg.inv(model.information(truth))))


def _truth(name: str) -> float:
    """True value of a coordinate of a series without faults that shares the force."""
    if name.startswith("ln_force_"):
        return math.log(FORCES_PN[int(name.removeprefix("ln_force_"))])
    values = {"ln_radius": math.log(RADIUS_NM), "ln_friction_scale": 0.0}
    return values.get(name, NOISE_NM**2)


def _free_fits(series: Series) -> tuple[list[FreeTrace], BeadPrior, bool]:
    """Free fits of the lateral traces at their true extensions, as the pipeline makes them.

    Also what is known of the bead, and whether the free fits contradict the friction expected.
    """
    recording = series.recording()
    conditions, _ = conditions_of(recording.setup)
    free, measured = [], []
    for i, (trace, length) in enumerate(
        zip(traces_of(recording, "b1"), EXTENSIONS_NM.tolist(), strict=True)
    ):
        for axis in LATERAL:
            fit = free_fit(trace, axis, conditions, length, 0.0, None)
            if isinstance(fit, str):
                raise RuntimeError(f"plateau {i}, {AXES[axis]}: {fit}")
            free.append(as_series_trace(i, axis, length, fit))
            ratio = friction_ratio(fit, conditions, axis, length)
            if ratio is not None:
                measured.append(MeasuredFriction(i, axis, *ratio))
    expectation = FrictionPrior(tuple(measured), conditions.friction_relative_stderr)
    # no reference bead tells the noise
    prior = bead_prior(conditions, (None, None), free)
    return free, prior, any(expectation.contradicted(axis) for axis in LATERAL)


def _against(force: Estimate | None, true: float) -> dict[str, object]:
    """An estimate of a force against its truth."""
    if force is None or not math.isfinite(force.value):
        return {"told": False, "converged": False, "holds": False, "error": math.nan}
    low, high = force.interval
    return {
        "told": True,
        "converged": force.status == "ok",
        "holds": low < true < high,
        "error": math.log(force.value / true),
    }
