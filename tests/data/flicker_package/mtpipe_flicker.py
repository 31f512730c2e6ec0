"""Tracking noise that goes as 1/f, as with a lamp that flickers (Dutta and Horn 1981)."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from mtpipe.effects.effect import Effect, Hypothesis, variance
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.physics.langevin import simulate_mode

# Modes of one variance, three in each decade of relaxation times: their sum goes as 1/f.
TAU_S = np.geomspace(0.01, 100.0, 13)


@dataclass(frozen=True)
class Flicker:
    """`nm2` : variance of each mode along x, y and z."""

    nm2: tuple[float, float, float]
    place = "tracker"

    def expected(self, seen, force_pN, thermal_energy_pN_nm):
        """Modes besides those of the bead."""
        return seen.with_modes(TAU_S, np.tile(np.diag(self.nm2), (len(TAU_S), 1, 1)))

    def played(self, position_nm, force_pN, camera, thermal_energy_pN_nm, random):
        """Positions with the noise."""
        noisy = position_nm.copy()
        for axis, size in enumerate(self.nm2):
            for tau in TAU_S if size > 0 else ():
                noisy[:, axis] += simulate_mode(size, tau, camera, len(noisy), random)
        return noisy


def _change(axis, experiment, value):
    sizes = list(_sizes(experiment))
    sizes[axis] = value
    return with_step(experiment, Flicker(tuple(sizes)))


def _sizes(experiment):
    step = step_of(experiment, Flicker)
    return (0.0, 0.0, 0.0) if step is None else step.nm2


def _hypotheses(experiment, evidence):
    parameters = [
        variance(f"flicker of {name} per mode", "nm", 1.0, 100.0, partial(_change, axis))
        for axis, name in enumerate("xyz")
    ]
    return [Hypothesis(experiment, tuple(parameters))]


def _cause(experiment):
    x, y, z = np.sqrt(_sizes(experiment))
    return f"the tracker's noise goes as 1/f, {x:.2f}, {y:.2f}, {z:.2f} nm a mode in x, y, z"


def _strengths(experiment):
    sizes = zip("xyz", np.sqrt(_sizes(experiment)), strict=True)
    return [(f"flicker_{name}_nm", float(size), "nm") for name, size in sizes]


EFFECT = Effect("flicker_noise", _hypotheses, _cause, _strengths)
