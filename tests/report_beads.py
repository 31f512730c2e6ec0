"""The beads of the made-up run folder: names, sizes, and what is said of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NASTY = '../<b id="x">&b 1/2'
NO_Z, REFUSED = "b2", "b10"
RUN = "4f1c0b9ad2e84c5f9f0a5d3c7b6e8a90"
RADIUS_NM, RATE_HZ, CONTOUR_NM, PERSISTENCE_NM = 1400.0, 120.0, 2700.0, 50.0
KT = 4.114
STOKES = 6 * np.pi * 0.89e-9 * RADIUS_NM
FORCES_PN = np.array([0.3, 0.9, 2.6, 7.5, 11.0, 0.15, 4.0, 1.5, 5.5, 0.5])
PLATEAU_S = 60.0
LEFT_OUT = (NASTY, 2, "y")
SHARED = "series of spectra: x and y share the force, friction expected from the setup"
APART = "series of spectra: x and y apart, friction measured on this bead"
ALONE = "spectrum, friction expected from the setup"
# What the diagnosis says; beads that are not named are consistent, "" was not compared.
UNEXPLAINED = "more0"
MISMATCH = {NASTY: "explained", NO_Z: "", REFUSED: "unexplained", UNEXPLAINED: "unexplained"}
# Force to quote over the one as configured, of the bead of which a cause is named.
CHANGE = 1.02


@dataclass(frozen=True)
class Trace:
    bead: str
    plateau: int
    axis: str
    force_pN: float
    refused: bool
    measured: bool

    @property
    def method(self) -> str:
        if self.axis == "z" or (self.bead, self.plateau, self.axis) == LEFT_OUT:
            return ALONE
        return series(self.bead) or ALONE


def series(bead: str) -> str:
    return {NO_Z: "", REFUSED: "", "more0": APART}.get(bead, SHARED)


def estimate(quantity: str, unit: str, value: float, relative: float) -> dict[str, float]:
    error = abs(value) * relative
    names = (f"{quantity}{part}_{unit}" for part in ("", "_stderr", "_low", "_high"))
    return dict(zip(names, (value, error, value - error, value + error), strict=True))


def missing(quantity: str, unit: str) -> dict[str, float]:
    return estimate(quantity, unit, np.nan, np.nan)
