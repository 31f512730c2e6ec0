"""Fits traces with pylake; runs in pylake's own environment and knows nothing of mtpipe.

    python fit.py traces.npz answers.npz

Passive calibration with the friction of the bead stated, which pylake needs: its stiffness is
2π · friction · corner frequency. "pylake" is `calibrate_force` as documented for a sensor without a
filter of its own, fitted below the Nyquist frequency. "pylake, blur and aliases" adds both to its
model, with private methods of pylake, which it does not document.
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np
from lumicks import pylake
from lumicks.pylake.force_calibration.power_spectrum_calibration import (
    calculate_power_spectrum,
    fit_power_spectrum,
)

# Ordinates per block: 80 points of the 8192 of a trace; the default is for 78 kHz.
BLOCK = 100
ALIASES = 10
UM_PER_NM, M_PER_UM = 1e-3, 1e-6
KG_PER_S = 1e-3  # in 1 pN s/nm


def main() -> None:
    """Read the traces, write what pylake says of them."""
    asked = np.load(sys.argv[1])
    friction, temperature = float(asked["friction_pN_s_per_nm"]), float(asked["temperature_K"])
    rate, exposure = float(asked["frame_rate_hz"]), float(asked["exposure_s"])
    diameter = 2 * float(asked["radius_nm"]) * UM_PER_NM
    # the viscosity that gives this friction by Stokes' law
    viscosity = friction * KG_PER_S / (3 * math.pi * diameter * M_PER_UM)
    known = {
        "temperature": temperature - 273.15,
        "viscosity": viscosity,
        "fast_sensor": True,
    }
    band = (rate / len(asked["x_nm"][0]), rate / 2)

    def plain(x_um: np.ndarray) -> float:
        found = pylake.calibrate_force(
            x_um, diameter, sample_rate=rate, num_points_per_block=BLOCK, fit_range=band, **known
        )
        return float(found["kappa"].value)

    def seen_by_a_camera(x_um: np.ndarray) -> float:
        model = pylake.PassiveCalibrationModel(diameter, **known)
        model = model._motion_blur(exposure)._alias_model(rate, ALIASES)
        spectrum = calculate_power_spectrum(x_um, rate, band, BLOCK)
        return float(fit_power_spectrum(spectrum, model)["kappa"].value)

    stiffness, seconds = [], []
    methods = {"pylake": plain, "pylake, blur and aliases": seen_by_a_camera}
    for x in asked["x_nm"]:
        for calibrate in methods.values():
            began = time.process_time()
            try:
                stiffness.append(calibrate(x * UM_PER_NM))
            except (ArithmeticError, ValueError, RuntimeError):
                stiffness.append(math.nan)
            seconds.append(time.process_time() - began)
    shape = (len(asked["x_nm"]), len(methods))
    np.savez(
        sys.argv[2],
        methods=list(methods),
        stiffness=np.reshape(stiffness, shape),
        cpu_s=np.reshape(seconds, shape),
    )


if __name__ == "__main__":
    main()
