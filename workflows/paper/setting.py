"""The experiments of the paper: bead, tether, camera, and the traces simulated of them.

The paper's approximations are kept on purpose: Stokes friction far from any wall, no rotation of
the bead, the interpolation of Marko and Siggia for the chain, no tracking noise. With 293.15 K and
1.0 mPa·s its corner frequencies come out (32.5 Hz at 14 pN, 46 Hz at 20 pN). The simulators are
called here and nowhere else in this workflow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from quoted import TIME_STEP_S
from scipy import optimize

from mtpipe.ground.types import FloatArray
from mtpipe.physics import camera as cam
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera
from mtpipe.physics.friction import stokes_pN_s_per_nm
from mtpipe.physics.langevin import simulate_axis
from mtpipe.physics.tether import Chain, extension_nm, stiffness_pN_per_nm
from mtpipe.simulation.springs import LARGEST_BIAS, simulate_path, simulate_springs


@dataclass(frozen=True)
class Setting:
    """Bead, tether, buffer and camera; the exposure fills the frame (W = 1/f_s)."""

    radius_nm: float = 1400.0
    contour_length_nm: float = 2700.0
    persistence_length_nm: float = 50.0
    frame_rate_hz: float = 120.0
    viscosity_mPa_s: float = 1.0
    temperature_K: float = 293.15

    @property
    def chain(self) -> Chain:
        """The tether, by the formula the paper uses."""
        return Chain(
            self.contour_length_nm,
            self.persistence_length_nm,
            self.temperature_K,
            "marko-siggia",
        )

    @property
    def camera(self) -> Camera:
        """Frame interval and exposure."""
        return Camera(1 / self.frame_rate_hz, 1 / self.frame_rate_hz)

    @property
    def friction(self) -> float:
        """γ = 6πηR in pN s/nm."""
        return float(stokes_pN_s_per_nm(self.radius_nm, self.viscosity_mPa_s))

    @property
    def thermal_energy(self) -> float:
        """kT in pN nm."""
        return float(thermal_energy_pN_nm(self.temperature_K))

    def at(self, force_pN: float) -> Bead:
        """The bead at a force."""
        extension = float(extension_nm(self.chain, force_pN))
        along = float(stiffness_pN_per_nm(self.chain, extension))
        across = force_pN / extension, force_pN / (extension + self.radius_nm)
        return Bead(self, force_pN, extension, (*across, along))

    def force_at_corner(self, corner_hz: float) -> float:
        """The force in pN at which the bead's x relaxes with this corner frequency."""

        def excess(ln_force: float) -> float:
            return math.log(self.at(math.exp(ln_force)).corner_hz[0] / corner_hz)

        return math.exp(optimize.brentq(excess, math.log(1e-3), math.log(1e4), xtol=1e-10))


@dataclass(frozen=True)
class Bead:
    """A bead at one force.

    Attributes
    ----------
    stiffness : k_x = F/L, k_y = F/(L + R), k_z = dF/dL in pN/nm (the paper's Eqs 5–7).
    """

    setting: Setting
    force_pN: float
    extension_nm: float
    stiffness: tuple[float, float, float]

    @property
    def variance(self) -> FloatArray:
        """(3,) kT/k in nm²."""
        return self.setting.thermal_energy / np.array(self.stiffness)

    @property
    def tau_s(self) -> FloatArray:
        """(3,) relaxation times γ/k."""
        return self.setting.friction / np.array(self.stiffness)

    @property
    def corner_hz(self) -> FloatArray:
        """(3,) k/(2πγ)."""
        return np.asarray(1 / (2 * np.pi * self.tau_s))

    def frame_variance(self) -> FloatArray:
        """(3,) variance of what the camera records, in closed form."""
        return cam.frame_variance(self.variance, self.tau_s, self.setting.camera)

    def variance_stderr(self, frames: int) -> FloatArray:
        """(3,) relative standard error of the variance of so many correlated frames."""
        camera = self.setting.camera
        decay = np.exp(-camera.frame_s / self.tau_s)
        first = cam.lag_one_covariance(1.0, self.tau_s, camera)
        correlation = first / cam.frame_variance(1.0, self.tau_s, camera)
        return np.asarray(np.sqrt(2 / frames * (1 + 2 * correlation**2 / (1 - decay**2))))


def stepwise_traces(
    bead: Bead, frames: int, random: np.random.Generator, *, axes: Sequence[int] = (0, 1, 2)
) -> FloatArray:
    """(frames, axes) recorded x, y, z in nm by the paper's equations of motion, step by step.

    Its 5 µs, and less along z where that would make the variance more than 1 % too large.
    """
    setting = bead.setting
    recorded = [
        simulate_springs(
            bead.stiffness[axis],
            setting.friction,
            setting.thermal_energy,
            setting.camera,
            frames,
            random,
            time_step_s=min(TIME_STEP_S, 1.9 * LARGEST_BIAS * bead.tau_s[axis]),
        )
        for axis in axes
    ]
    return np.hstack(recorded)


def path(bead: Bead, duration_s: float, random: np.random.Generator) -> FloatArray:
    """(steps,) x in nm at every time step, before the camera."""
    setting = bead.setting
    steps = round(duration_s / TIME_STEP_S)
    x = simulate_path(
        bead.stiffness[0],
        setting.friction,
        setting.thermal_energy,
        steps,
        random,
        time_step_s=TIME_STEP_S,
    )
    return np.asarray(x[:, 0])


def exact_traces(bead: Bead, frames: int, repeats: int, random: np.random.Generator) -> FloatArray:
    """(repeats, frames) recorded x in nm by the exact simulator: any number at little cost."""
    setting = bead.setting
    return np.array(
        [
            simulate_axis(
                bead.stiffness[0],
                setting.friction,
                setting.thermal_energy,
                setting.camera,
                frames,
                random,
            )
            for _ in range(repeats)
        ]
    )
