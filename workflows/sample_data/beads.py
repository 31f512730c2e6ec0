"""Beads as they move before a camera records them: tethered, free, stuck.

Positions are in nm about the bead's place on the surface, z from the surface to the bead's lowest
point, averaged over each exposure. A tethered bead is mtpipe's baseline with the wall's drag and
the bead's rotation: linear and Gaussian along each axis, k = F/L along the field (x), F/(L + R)
across with two modes, dF/dL away from the surface. Close to the surface nothing is linear: there
heights are stepped in time, with a reflecting surface and friction that depends on the height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.physics import friction, tether
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera
from mtpipe.physics.langevin import simulate_axis
from mtpipe.physics.modes import rotating_bead

STEPS_PER_FRAME = 20


@dataclass(frozen=True)
class Fluid:
    """The buffer."""

    temperature_K: float
    viscosity_mPa_s: float

    @property
    def thermal_energy_pN_nm(self) -> float:
        """kT."""
        return float(thermal_energy_pN_nm(self.temperature_K))


@dataclass(frozen=True)
class Tethered:
    """A bead on a tether.

    `force_ratio` is the magnets' force on it over that on the average bead. Two equal tethers side
    by side are one of half the persistence length: the chain's energy is proportional to kT/Lp.
    """

    radius_nm: float
    contour_nm: float
    persistence_nm: float
    force_ratio: float = 1.0


@dataclass(frozen=True)
class State:
    """What a tethered bead is like at one force."""

    force_pN: float
    extension_nm: float
    friction_along_surface_pN_s_per_nm: float
    friction_from_surface_pN_s_per_nm: float


def state(bead: Tethered, force_pN: float, fluid: Fluid) -> State:
    """Mean extension and friction of a bead at a force that acts on it.

    The bead turns about the field's axis, which lowers it by kT/(2F) below the tether's end.
    """
    chain = _chain(bead, fluid)
    end = float(tether.mean_extension_nm(chain, force_pN))
    extension = end - fluid.thermal_energy_pN_nm / (2 * force_pN)
    bulk = float(friction.stokes_pN_s_per_nm(bead.radius_nm, fluid.viscosity_mPa_s))
    height = extension + bead.radius_nm
    return State(
        force_pN,
        extension,
        bulk * float(friction.parallel_wall_factor(height, bead.radius_nm)),
        bulk * float(friction.perpendicular_wall_factor(height, bead.radius_nm)),
    )


def tethered_trace(
    bead: Tethered,
    force_pN: FloatArray,
    fluid: Fluid,
    camera: Camera,
    random: np.random.Generator,
) -> FloatArray:
    """(n, 3) positions of a bead under the forces of n frames.

    The mean extension follows the force frame by frame; the fluctuations are those of the
    geometric mean force, so the force should be constant or change little and fast.
    """
    frames = len(force_pN)
    here = state(bead, math.exp(float(np.mean(np.log(force_pN)))), fluid)
    energy, force, extension = fluid.thermal_energy_pN_nm, here.force_pN, here.extension_nm
    radius, height = bead.radius_nm, here.extension_nm + bead.radius_nm
    chain = _chain(bead, fluid)
    ratio = 4 / 3 * radius**2 * float(friction.rotation_wall_factor(height, radius))
    ratio /= float(friction.parallel_wall_factor(height, radius))
    # exact for any chain: var x = kT <z of the tether's end>/F (PHYSICS section 0)
    end = extension + energy / (2 * force)
    axial = float(tether.stiffness_pN_per_nm(chain, tether.extension_nm(chain, force)))
    slow, fast = here.friction_along_surface_pN_s_per_nm, here.friction_from_surface_pN_s_per_nm
    modes = rotating_bead(extension, radius, ratio)
    x = simulate_axis(force / end, slow, energy, camera, frames, random)
    y = simulate_axis(force / height, slow, energy, camera, frames, random, modes=modes)
    z = simulate_axis(axial, fast, energy, camera, frames, random)
    means = tether.mean_extension_nm(chain, force_pN) - energy / (2 * force_pN)
    return np.column_stack([x, y, z + means])


def resting_trace(
    bead: Tethered,
    weight_pN: float,
    fluid: Fluid,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
) -> FloatArray:
    """(frames, 3) positions of a tethered bead that its weight holds to the surface."""
    chain = _chain(bead, fluid)
    slack = 3 * chain.thermal_force_pN / (2 * bead.contour_nm)
    heights = _heights(bead.radius_nm, slack, weight_pN, fluid, camera, frames, random)
    z = _exposed(heights, camera)
    bulk = float(friction.stokes_pN_s_per_nm(bead.radius_nm, fluid.viscosity_mPa_s))
    centre = float(np.mean(heights)) + bead.radius_nm
    drag = bulk * float(friction.parallel_wall_factor(centre, bead.radius_nm))
    energy = fluid.thermal_energy_pN_nm
    x, y = (simulate_axis(slack, drag, energy, camera, frames, random) for _ in range(2))
    return np.column_stack([x, y, z])


def free_trace(
    radius_nm: float,
    weight_pN: float,
    fluid: Fluid,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
) -> FloatArray:
    """(frames, 3) positions of a bead that nothing holds, over the surface on which it settled."""
    heights = _heights(radius_nm, 0.0, weight_pN, fluid, camera, frames, random)
    bulk = float(friction.stokes_pN_s_per_nm(radius_nm, fluid.viscosity_mPa_s))
    drag = bulk * friction.parallel_wall_factor(heights + radius_nm, radius_nm)
    step_s = camera.frame_s / STEPS_PER_FRAME
    spread = np.sqrt(2 * fluid.thermal_energy_pN_nm * step_s / drag)
    x, y = (np.cumsum(spread * random.normal(size=len(heights))) for _ in range(2))
    return np.column_stack([_exposed(x, camera), _exposed(y, camera), _exposed(heights, camera)])


def _chain(bead: Tethered, fluid: Fluid) -> tether.Chain:
    return tether.Chain(bead.contour_nm, bead.persistence_nm, fluid.temperature_K)


def _heights(
    radius_nm: float,
    stiffness_pN_per_nm: float,
    weight_pN: float,
    fluid: Fluid,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
) -> FloatArray:
    """(frames · STEPS_PER_FRAME,) heights of a bead close to the surface, in small steps.

    Itô steps with the drift kT dμ/dz of a mobility μ that changes with height, without which the
    heights would not follow Boltzmann's law; the surface reflects.
    """
    energy, step_s = fluid.thermal_energy_pN_nm, camera.frame_s / STEPS_PER_FRAME
    grid_nm = 2.0
    table = np.arange(grid_nm / 2, 6 * radius_nm, grid_nm)
    bulk = float(friction.stokes_pN_s_per_nm(radius_nm, fluid.viscosity_mPa_s))
    mobility = 1 / (bulk * friction.perpendicular_wall_factor(table + radius_nm, radius_nm))
    drift = (energy * np.gradient(mobility, grid_nm) * step_s).tolist()
    response = (mobility * step_s).tolist()
    spread = np.sqrt(2 * energy * mobility * step_s).tolist()
    kicks = random.normal(size=frames * STEPS_PER_FRAME).tolist()
    height, heights, last = energy / weight_pN, [], len(table) - 1
    for kick in kicks:
        at = min(int(height / grid_nm), last)
        force = -weight_pN - stiffness_pN_per_nm * height
        height = abs(height + response[at] * force + drift[at] + spread[at] * kick)
        heights.append(height)
    return np.array(heights)


def _exposed(path_nm: FloatArray, camera: Camera) -> FloatArray:
    """Mean over the exposure at the start of each frame."""
    open_steps = max(1, round(STEPS_PER_FRAME * camera.exposure_s / camera.frame_s))
    return np.asarray(path_nm.reshape(-1, STEPS_PER_FRAME)[:, :open_steps].mean(axis=1))
