"""Fits traces with tweezepy; runs in tweezepy's own environment and knows nothing of mtpipe.

    python fit.py traces.npz answers.npz

Spectrum and Allan variance with their default binning. What its documentation lets a user say is
said: thermal energy, and radius and viscosity, from which the fit starts. There is no exposure to
be stated: it is taken to be the whole frame. What is asked depends on `task`:

- "free": stiffness and friction, from that start, and from the default one (a bead of 530 nm).
- "noisy": with `tracking_error`, the friction fixed at what is known of it, and free.
- "mcmc": as "free", then its sampler with default settings (32 walkers, 2000 steps).
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator

import numpy as np
from tweezepy import AV, PSD

ESTIMATORS = {"tweezepy spectrum": PSD, "tweezepy Allan": AV}
NOTHING = (math.nan, math.nan, math.nan)


def main() -> None:
    """Read the traces, write what tweezepy says of them."""
    asked = np.load(sys.argv[1])
    np.random.seed(int(asked["seed"]))  # noqa: NPY002, its sampler draws from here
    answers = [
        list(_fits(x, asked, float(friction)))
        for x, friction in zip(asked["x_nm"], asked["friction_pN_s_per_nm"], strict=True)
    ]
    np.savez(
        sys.argv[2],
        methods=[method for method, _, _ in answers[0]],
        estimates=[[estimates for _, estimates, _ in one] for one in answers],
        cpu_s=[[cpu_s for _, _, cpu_s in one] for one in answers],
    )


def _fits(
    x_nm: np.ndarray, asked: np.lib.npyio.NpzFile, friction: float
) -> Iterator[tuple[str, list[tuple[float, float, float]], float]]:
    """Name, (value, low, high) of stiffness and friction, and CPU seconds of every fit."""
    task = str(asked["task"])
    default = {"kT": float(asked["thermal_energy_pN_nm"])}
    known = default | {
        "radius": float(asked["radius_nm"]),
        "viscosity": float(asked["viscosity_pN_s_per_nm2"]),
    }
    options = {
        "free": {"": known, ", default start": default},
        "noisy": {
            "": known | {"tracking_error": True, "gamma": friction},
            ", friction free": known | {"tracking_error": True},
        },
        "mcmc": {", MCMC": known},
    }[task]
    for name, estimator in ESTIMATORS.items():
        for suffix, one in options.items():
            began = time.process_time()
            try:
                fit = estimator(x_nm, float(asked["frame_rate_hz"]))
                fit.mlefit(**one)
                if task == "mcmc":
                    fit.mcmc()
                estimates = [_estimate(fit, parameter, task) for parameter in "kg"]
            except (ArithmeticError, ValueError, RuntimeError, np.linalg.LinAlgError):
                estimates = [NOTHING, NOTHING]
            yield name + suffix, estimates, time.process_time() - began


def _estimate(fit: PSD | AV, parameter: str, task: str) -> tuple[float, float, float]:
    """Value and interval of one standard error; nan for a fit that says it failed."""
    if not fit.success or parameter not in fit.results:
        return NOTHING
    suffix = "_mcmc" if task == "mcmc" else ""
    value = float(fit.results[f"{parameter}{suffix}"])
    error = float(fit.results[f"{parameter}{suffix}_error"])
    return value, value - error, value + error


if __name__ == "__main__":
    main()
