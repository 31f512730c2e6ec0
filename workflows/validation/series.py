"""A bead's whole series: joint fits of exact simulated traces, compared with their truth.

The series of the joint Cramér–Rao bound that mtpipe is held to: eight plateaus from 0.3 to 20 pN,
noise of unknown size, wall friction, a radius known within 3 % whose stated value is drawn anew for
each repeat. Fitted with everything else as it is (`measure_joint`), as a recording with a drifting
stage and a reference bead through the whole pipeline (`measure_pipeline`), and with faults that
nobody told mtpipe of (`measure_choice`). Errors are those of logarithms; of noise, of its variance.
"""

from __future__ import annotations

import math
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

import mtpipe
from mtpipe.conditions import Conditions, conditions_of
from mtpipe.estimate import Estimate
from mtpipe.fit.series import SeriesFit, fit_series, sample_series
from mtpipe.fit.series_model import BeadPrior, SeriesModel
from mtpipe.free_fits import LATERAL, free_fit, friction_ratio
from mtpipe.friction_prior import FrictionPrior, MeasuredFriction
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera
from mtpipe.physics.friction import (
    parallel_wall_factor,
    perpendicular_wall_factor,
    rotation_wall_factor,
    stokes_pN_s_per_nm,
)
from mtpipe.physics.langevin import simulate_axis
from mtpipe.physics.modes import SINGLE_MODE, Modes, rotating_bead
from mtpipe.physics.tether import Chain, mean_extension_nm, stiffness_pN_per_nm
from mtpipe.plateaus import find_plateaus
from mtpipe.recording import AXES, Recording
from mtpipe.series_choice import FreeTrace, as_series_trace, choose_series
from mtpipe.setup import parse_setup
from mtpipe.traces import traces_of

RATE_HZ, TEMPERATURE_K, VISCOSITY_MPA_S = 120.0, 293.15, 1.0
RADIUS_NM, RADIUS_SCATTER = 500.0, 0.03
FRAMES, NOISE_NM = 8192, 3.0
FORCES_PN = np.geomspace(0.3, 20.0, 8)
CHAIN = Chain(1200.0, 50.0, TEMPERATURE_K)
EXTENSIONS_NM = mean_extension_nm(CHAIN, FORCES_PN)
THERMAL_ENERGY = float(thermal_energy_pN_nm(TEMPERATURE_K))
# Of the forces, as issue 3 states it, before any uncertainty of the friction but the radius's.
STATED_BOUND = (0.025, 0.019, 0.015, 0.012, 0.010, 0.011, 0.017, 0.040)
# Whole recordings: noise of the reference bead over that of the tethered, the factor that holds
# 68 %, and the stage's drift.
REFERENCE_NOISE_FACTOR, DRIFT_NM_PER_ROOT_S = 1.5, 1.0


@dataclass(frozen=True)
class Case:
    """A kind of series; what the setup does not say of it is a fault.

    Attributes
    ----------
    rotation : the bead turns about the field's axis, and the setup says so.
    friction : true over expected friction.
    across : true stiffness across the field over F/(L + R).
    odd_noise_nm, odd_drift_nm_per_s : in one plateau, drawn anew for each repeat.
    stated_radius : over the true one, apart from its scatter.
    """

    name: str
    rotation: bool = False
    friction: float = 1.0
    across: float = 1.0
    odd_noise_nm: float = NOISE_NM
    odd_drift_nm_per_s: float = 0.0
    stated_radius: float = 1.0

    @property
    def has_odd_plateau(self) -> bool:
        """Whether one plateau is unlike the others."""
        return self.odd_noise_nm != NOISE_NM or self.odd_drift_nm_per_s != 0


HELD, TURNS = Case("bead held"), Case("bead turns", rotation=True)
TRUE = (HELD, TURNS)
FAULTY = (
    Case("friction × 1.3", friction=1.3),
    Case("stiffness across × 0.9", across=0.9),
    Case("15 nm noise in one plateau", odd_noise_nm=15.0),
    Case("drift of 2 nm/s in one plateau", odd_drift_nm_per_s=2.0),
    Case("stated radius × 1.1", stated_radius=1.1),
)


@dataclass(frozen=True)
class Series:
    """One series drawn: setup, positions of bead and reference, the odd plateau, a generator."""

    setup: dict[str, object]
    bead_nm: np.ndarray
    reference_nm: np.ndarray
    odd: int
    random: np.random.Generator

    def recording(self, drift_nm_per_root_s: float = 0.0) -> Recording:
        """As `mtpipe.load` would give it, on a stage that drifts."""
        setup = parse_setup(self.setup)
        n = len(self.bead_nm)
        drift = np.cumsum(self.random.normal(size=(n, 3)), axis=0)
        drift *= drift_nm_per_root_s / math.sqrt(RATE_HZ)
        time_s = np.arange(n) / RATE_HZ
        magnet_mm = np.repeat(np.arange(len(FORCES_PN), dtype=float), FRAMES)
        return Recording(
            name="simulated",
            setup=setup,
            time_s=time_s,
            frame=np.arange(n),
            positions_nm={"b1": self.bead_nm + drift, "ref1": self.reference_nm + drift},
            magnet_mm=magnet_mm,
            plateaus=find_plateaus(time_s, magnet_mm, setup.plateaus),
        )


def draw(case: Case, seed: int, repeat: int) -> Series:
    """The series of a seed and repeat."""
    random = np.random.default_rng([seed, zlib.crc32(case.name.encode()), repeat])
    odd = int(random.integers(len(FORCES_PN)))
    plateaus = [_plateau_nm(case, i, odd=i == odd, random=random) for i in range(len(FORCES_PN))]
    stated = RADIUS_NM * case.stated_radius * (1 + RADIUS_SCATTER * random.normal())
    noise = NOISE_NM * math.exp(math.log(REFERENCE_NOISE_FACTOR) * random.normal())
    bead = np.vstack(plateaus)
    return Series(_setup(case, stated), bead, noise * random.normal(size=bead.shape), odd, random)


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
    low, high = np.quantile(posterior.chain.theta, [0.1587, 0.8413], axis=0)
    return [
        {
            "case": case.name,
            "repeat": repeat,
            "coordinate": name,
            "bound": bound[i],
            "error": fit.theta[i] - truth[i],
            "fit_holds": abs(fit.theta[i] - truth[i]) < stderr[i],
            "posterior_holds": low[i] < truth[i] < high[i],
            "supported_p": contradiction_p(fit, free),
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


def measure_choice(job: tuple[Case, int, int]) -> dict[str, object]:
    """What is chosen for a series without drift, by its traces' free fits, and its forces."""
    case, seed, repeat = job
    series = draw(case, seed, repeat)
    free, prior, contradicted = _free_fits(series)
    choice = choose_series(free, prior, friction_contradicted=contradicted)
    row: dict[str, object] = {"case": case.name, "chosen": "no joint fit"}
    if choice is None:
        return row
    model, fit = choice.fit.model, choice.fit
    along = [trace for trace in model.traces if trace.axis == prior.along]
    drives = [model.drive(trace) for trace in along]
    # levers along the field are extensions, which are exact here
    levers = [0.0 if model.force_shared else math.log(trace.extension_nm) for trace in along]
    ln_true = np.log([FORCES_PN[trace.plateau] for trace in along])
    errors = fit.theta[drives] + levers - ln_true
    return row | {
        "chosen": choice.words,
        "left_out": len(choice.left_out),
        "odd_left_out": {t.plateau for t in choice.left_out} == {series.odd},
        "mean_square_pull": np.mean(errors**2 / np.diag(fit.covariance)[drives]),
        "largest_error": np.abs(errors).max(),
    }


def contradiction_p(fit: SeriesFit, free: Sequence[FreeTrace]) -> float:
    """p-value of a joint fit against the free fits: what the choice goes by."""
    excess = float(np.sum(fit.deviances) - sum(one.fit.deviance for one in free))
    return float(stats.chi2.sf(excess, 3 * len(free) - len(fit.theta)))


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
    return free, _bead_prior(conditions), any(expectation.contradicted(axis) for axis in LATERAL)


def _bead_prior(conditions: Conditions) -> BeadPrior:
    """What the pipeline knows of the bead where there is no reference bead."""
    assert conditions.radius_nm is not None
    return BeadPrior(
        radius_nm=conditions.radius_nm,
        viscosity_mPa_s=conditions.viscosity_mPa_s[0],
        friction_ln_stderr=conditions.friction_stderr_apart_from_radius,
        noise_nm=(None, None),
        along=conditions.along,
        wall=conditions.wall,
        rotation=conditions.rotation,
    )


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


def _setup(case: Case, radius_nm: float) -> dict[str, object]:
    """Content of the setup.toml."""
    rotation = ["rotation_coupling"] * case.rotation
    return {
        "schema": 1,
        "camera": {"frame_rate_hz": RATE_HZ, "exposure_s": 1 / RATE_HZ},
        "beads": {
            "radius_nm": radius_nm,
            "radius_nm_stderr": RADIUS_SCATTER * RADIUS_NM,
            "reference": ["ref1"],
        },
        "tether": {
            "contour_length_nm": CHAIN.contour_length_nm,
            "persistence_length_nm": CHAIN.persistence_length_nm,
        },
        "buffer": {"temperature_K": TEMPERATURE_K, "viscosity_mPa_s": VISCOSITY_MPA_S},
        "field": {"direction": "x"},
        "model": {"effects": ["wall_drag", "tracking_noise", *rotation]},
    }


def _plateau_nm(
    case: Case, plateau: int, *, odd: bool, random: np.random.Generator
) -> np.ndarray:
    """(FRAMES, 3) positions of the bead in one plateau."""
    camera = Camera(1 / RATE_HZ, 1 / RATE_HZ)
    force, length = float(FORCES_PN[plateau]), float(EXTENSIONS_NM[plateau])
    height = length + RADIUS_NM
    stiffness = (
        force / length,
        case.across * force / height,
        float(stiffness_pN_per_nm(CHAIN, length)),
    )
    bulk = case.friction * float(stokes_pN_s_per_nm(RADIUS_NM, VISCOSITY_MPA_S))
    sideways = float(parallel_wall_factor(height, RADIUS_NM))
    walls = (sideways, sideways, float(perpendicular_wall_factor(height, RADIUS_NM)))
    across = SINGLE_MODE
    if case.rotation:
        ratio = 4 / 3 * RADIUS_NM**2 * float(rotation_wall_factor(height, RADIUS_NM)) / sideways
        across = rotating_bead(length, RADIUS_NM, ratio)
    modes: tuple[Modes, ...] = (SINGLE_MODE, across, SINGLE_MODE)
    motion = [
        simulate_axis(k, bulk * wall, THERMAL_ENERGY, camera, FRAMES, random, modes=mode)
        for k, wall, mode in zip(stiffness, walls, modes, strict=True)
    ]
    noise = case.odd_noise_nm if odd else NOISE_NM
    position = np.column_stack(motion) + noise * random.normal(size=(FRAMES, 3))
    position[:, 2] += length
    if odd:
        elapsed_s = np.arange(FRAMES) / RATE_HZ
        position[:, :2] += case.odd_drift_nm_per_s * elapsed_s[:, None]
    return position
