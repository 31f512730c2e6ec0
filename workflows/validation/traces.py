"""Single traces: simulated exactly, fitted, sampled, and compared with their truth.

One `Case` is one row of a table. The simulator (`mtpipe.physics.langevin`) works in time and shares
no formula with the spectra that are fitted. Errors are those of ln stiffness and ln friction.
"""

from __future__ import annotations

import math
import time
import zlib
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

import mtpipe
from mtpipe.fit.model import TraceModel
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera
from mtpipe.physics.langevin import simulate_axis

RATE_HZ, TEMPERATURE_K = 120.0, 298.15
FRICTION = 2.3e-5  # pN s/nm: a bead of 1.4 µm radius in water
THERMAL_ENERGY = float(thermal_energy_pN_nm(TEMPERATURE_K))
NYQUIST_RATIOS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.0, 2.0)
NOISY_RATIOS = (0.1, 0.2, 0.5, 0.8, 1.0, 1.5, 2.0, 3.0)
GAP_RATIOS = (0.02, 0.1, 0.4, 1.0)
LOST_SHARE = 0.1
Lost = Literal["none", "scattered", "one gap", "both"]
SHORT_FRAMES = 1024
RELAXATION_OVER_TRACE = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2)


@dataclass(frozen=True)
class Case:
    """One kind of trace.

    `corner` is the corner frequency over the Nyquist frequency, `exposure` in frames.
    `friction_known` is the relative standard error of prior knowledge of the friction, whose centre
    is drawn anew for each trace; None: free. Noise that is not 0 is fitted, its size unknown.
    `lost`: a tenth of the frames lost one by one ("scattered"), in one piece ("one gap"), or both.
    """

    part: str
    corner: float
    exposure: float = 1.0
    frames: int = 16384
    noise_nm: float = 0.0
    friction_known: float | None = None
    lost: Lost = "none"

    @property
    def stiffness_pN_per_nm(self) -> float:
        """Truth."""
        return 2 * math.pi * self.corner * RATE_HZ / 2 * FRICTION

    @property
    def truth(self) -> np.ndarray:
        """(3,) ln stiffness, ln friction and noise variance, as in `mtpipe.fit.model`."""
        return np.array([math.log(self.stiffness_pN_per_nm), math.log(FRICTION), self.noise_nm**2])

    @property
    def name(self) -> str:
        """Identifies the case in tables, and seeds it."""
        return repr(self)


def cases() -> list[Case]:
    """All of them, in the order of the tables."""
    free = [Case("free", c, exposure) for exposure in (1.0, 0.5) for c in NYQUIST_RATIOS]
    noisy = [Case("noisy", c, noise_nm=5.0, friction_known=0.03) for c in NOISY_RATIOS]
    gaps = [Case("gaps", c, lost=lost) for c in GAP_RATIOS for lost in get_args(Lost)]
    short = [
        Case("short", 1 / (math.pi * share * SHORT_FRAMES), frames=SHORT_FRAMES)
        for share in RELAXATION_OVER_TRACE
    ]
    return free + noisy + gaps + short


def measure(job: tuple[Case, int, int]) -> dict[str, object]:
    """One trace of a case from (case, seed, repeat); a row for a pandas table."""
    case, seed, repeat = job
    x, known, random = draw(case, seed, repeat)
    began = time.perf_counter()
    fit = mtpipe.fit_trace(
        x,
        frame_rate_hz=RATE_HZ,
        exposure_s=case.exposure / RATE_HZ,
        temperature_K=TEMPERATURE_K,
        tracking_noise_nm="fit" if case.noise_nm else 0.0,
        friction=known,
    )
    fitted = time.perf_counter()
    posterior = mtpipe.sample_posterior(fit, seed=random)
    sampled = time.perf_counter()
    truth, bound = case.truth, error_bound(case, fit.model)
    row: dict[str, object] = {
        "case": case.name,
        "p_value": fit.p_value,
        "identified": fit.stiffness.status == "ok",
        "posterior_identified": posterior.stiffness.status != "not_identified",
        "converged": posterior.converged,
        "fit_s": fitted - began,
        "posterior_s": sampled - fitted,
    }
    estimates = (
        ("k", fit.stiffness, posterior.stiffness),
        ("friction", fit.friction, posterior.friction),
    )
    for i, (name, of_fit, of_posterior) in enumerate(estimates):
        row[f"{name}_error"] = fit.theta[i] - truth[i]
        row[f"{name}_posterior_error"] = np.median(posterior.theta[:, i]) - truth[i]
        row[f"{name}_bound"] = bound[i]
        row[f"{name}_fit_holds"] = holds(of_fit.interval, truth[i])
        row[f"{name}_posterior_holds"] = holds(of_posterior.interval, truth[i])
    return row


def draw(
    case: Case, seed: int, repeat: int
) -> tuple[np.ndarray, tuple[float, float] | None, np.random.Generator]:
    """Positions in nm, prior of the friction in pN s/nm, and the generator for what follows.

    Whoever asks for the same seed and repeat gets the same trace.
    """
    random = np.random.default_rng([seed, zlib.crc32(case.name.encode()), repeat])
    known = None
    if case.friction_known is not None:
        centre = FRICTION * (1 + case.friction_known * random.normal())
        known = (centre, case.friction_known * FRICTION)
    return _simulate(case, random), known, random


def error_bound(case: Case, model: TraceModel) -> np.ndarray:
    """Cramér–Rao bound of the standard errors of what is fitted, at the truth of a case."""
    return np.sqrt(np.diag(np.linalg.inv(model.information(case.truth))))


def holds(interval: tuple[float, float], ln_truth: float) -> bool:
    """Whether an interval of a positive number holds its truth."""
    return interval[0] < math.exp(ln_truth) < interval[1]


def _simulate(case: Case, random: np.random.Generator) -> np.ndarray:
    camera = Camera(1 / RATE_HZ, case.exposure / RATE_HZ)
    x = simulate_axis(
        case.stiffness_pN_per_nm, FRICTION, THERMAL_ENERGY, camera, case.frames, random
    )
    x += case.noise_nm * random.normal(size=case.frames)
    if case.lost in ("scattered", "both"):
        x[random.random(case.frames) < LOST_SHARE] = np.nan
    if case.lost in ("one gap", "both"):
        length = int(LOST_SHARE * case.frames)
        start = random.integers(case.frames - length)
        x[start : start + length] = np.nan
    return x
