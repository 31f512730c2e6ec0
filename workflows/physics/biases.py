"""How far one effect moves a force: the table of section 3.B of docs/physics.md.

    python workflows/physics/biases.py --write docs/physics.md

The exact expected spectrum of one axis with one effect is fitted, by Whittle likelihood and over
all ordinates below the Nyquist frequency, with the spectrum of a single mode without the effect.
No trace is simulated.
"""

from __future__ import annotations

import argparse
import functools
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy import optimize

from mtpipe.ground.types import FloatArray
from mtpipe.ground.version import VERSION
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera, blur_factor, frame_variance, lag_one_covariance
from mtpipe.physics.camera import power_spectrum as recorded
from mtpipe.physics.friction import (
    parallel_wall_factor,
    rotation_wall_factor,
    rotational_stokes_pN_nm_s,
    stokes_pN_s_per_nm,
)
from mtpipe.physics.linear import LinearMotion, normal_modes
from mtpipe.physics.memory import memory_time_s, power_with_memory
from mtpipe.physics.tether import Chain, extension_nm

sys.path.append(str(Path(__file__).parents[1] / "common"))
from pages import into_page, table

FRAMES, KELVIN, VISCOSITY = 16384, 293.15, 1.0
FILMED = Camera(1 / 120, 1 / 120)
HZ = np.arange(1, FRAMES // 2) / (FRAMES * FILMED.frame_s)
# A fit is kept within this factor of the truth, and has collapsed if it leaves so little.
FARTHEST, COLLAPSED = 1e5, -0.99
TILT = math.radians(30)
Spectrum = Callable[[float, float], FloatArray]  # of stiffness and friction


@dataclass(frozen=True)
class Rest:
    """A bead at a force."""

    radius_nm: float
    contour_nm: float
    force_pN: float

    @property
    def length_nm(self) -> float:
        """Extension of the tether."""
        return float(extension_nm(Chain(self.contour_nm, 50.0, KELVIN), self.force_pN))

    @property
    def across_nm(self) -> float:
        """The lever across the field."""
        return self.length_nm + self.radius_nm

    @property
    def friction(self) -> float:
        """Of the bead far from any surface, which the analysis takes for the bead's."""
        return float(stokes_pN_s_per_nm(self.radius_nm, VISCOSITY))


RESTS = {
    f"{name} {force:g} pN": Rest(radius, contour, force)
    for name, radius, contour in (("A", 1400.0, 2700.0), ("B", 500.0, 1200.0))
    for force in (1.0, 5.0, 10.0)
}


@dataclass(frozen=True, eq=False)
class Seen:
    """An expected spectrum, and what its analysis assumes: a lever and a spectrum to fit."""

    power: FloatArray
    lever_nm: float
    model: Spectrum


def kT(kelvin: float = KELVIN) -> float:
    """Thermal energy, pN nm."""
    return float(thermal_energy_pN_nm(kelvin))


def mode(stiffness: float, friction: float, *, kelvin: float = KELVIN) -> FloatArray:
    """Recorded spectrum of one mode, exposed for the whole frame."""
    return recorded(HZ, kT(kelvin) / stiffness, friction / stiffness, FILMED)


def along(rest: Rest, **changes: float) -> FloatArray:
    """Spectrum along the field."""
    return mode(rest.force_pN / rest.length_nm, **{"friction": rest.friction, **changes})


def across(rest: Rest) -> FloatArray:
    """Spectrum across the field of a bead without friction of its rotation."""
    return mode(rest.force_pN / rest.across_nm, rest.friction)


def turning(rest: Rest, *, lever_nm: float, kappa: float = 0.0, wall: bool = False) -> FloatArray:
    """Spectrum of a bead that turns against kappa (pN nm/rad) and its attachment's lever."""
    swing = rest.force_pN / rest.length_nm
    held = rest.force_pN * lever_nm * (1 + lever_nm / rest.length_nm) + kappa
    friction = [rest.friction, float(rotational_stokes_pN_nm_s(rest.radius_nm, VISCOSITY))]
    if wall:
        friction[0] *= float(parallel_wall_factor(rest.across_nm, rest.radius_nm))
        friction[1] *= float(rotation_wall_factor(rest.across_nm, rest.radius_nm))
    stiffness = np.array([[swing, -swing * lever_nm], [-swing * lever_nm, held]])
    modes = normal_modes(LinearMotion(stiffness, np.diag(friction), np.array([[1.0, 0.0]])), kT())
    gains, taus = modes.amplitude_nm[0] ** 2, modes.tau_s
    return np.asarray(sum(recorded(HZ, g, t, FILMED) for g, t in zip(gains, taus, strict=True)))


def series(c0: float, c1: float, q: float) -> FloatArray:
    """Spectrum of frames with these covariances, of which each is q times the one before."""
    cosine = np.cos(2 * np.pi * HZ * FILMED.frame_s)
    falling = (cosine - q) / (1 - 2 * q * cosine + q**2)
    return np.asarray(2 * FILMED.frame_s * (c0 + 2 * c1 * falling))


def covariances(rest: Rest) -> tuple[float, float, float, float]:
    """Relaxation time, c0, c1 and q of motion along the field."""
    stiffness = rest.force_pN / rest.length_nm
    tau = rest.friction / stiffness
    c0, c1 = (float(one(kT() / stiffness, tau, FILMED)) for one in (frame_variance,
                                                                   lag_one_covariance))  # fmt: skip
    return tau, c0, c1, math.exp(-FILMED.frame_s / tau)


def dropped(rest: Rest, share: float) -> FloatArray:
    """Frames lost at random, the others taken to follow one another."""
    _, c0, c1, q = covariances(rest)
    step = (1 - share) / (1 - share * q)
    return series(c0, c1 * step, q * step)


def jittered(rest: Rest, rms_s: float) -> FloatArray:
    """Frames that begin at random early or late."""
    tau, c0, c1, q = covariances(rest)
    return series(c0, c1 * math.exp((rms_s / tau) ** 2), q)


def periodogram(traces: FloatArray) -> FloatArray:
    """Mean periodogram of traces (n, FRAMES)."""
    power = np.abs(np.fft.rfft(traces - traces.mean(axis=1, keepdims=True))) ** 2
    return np.asarray(2 * FILMED.frame_s / FRAMES * power.mean(axis=0)[1 : FRAMES // 2])


def drifting(nm_per_s: float) -> FloatArray:
    """A straight line."""
    return periodogram(nm_per_s * FILMED.frame_s * np.arange(FRAMES)[None])


def walking(nm2_per_s: float) -> FloatArray:
    """A random walk; as much again as its own spectrum leaks in, since it ends elsewhere."""
    gain = np.sin(np.pi * HZ * FILMED.frame_s) ** 2
    return np.asarray(nm2_per_s * FILMED.frame_s**2 / gain)


def shaking(hz: float, rms_nm: float) -> FloatArray:
    """A vibration, at any phase."""
    blurred = math.sqrt(2) * rms_nm * np.sinc(hz * FILMED.exposure_s)
    turn = 2 * np.pi * hz * FILMED.frame_s * np.arange(FRAMES)
    return periodogram(blurred * np.array([np.sin(turn), np.cos(turn)]))


def remembered(rest: Rest) -> FloatArray:
    """Motion along the field in water that is set in motion; aliases up to 200 frame rates."""
    variance = kT() * rest.length_nm / rest.force_pN
    tau = rest.friction * rest.length_nm / rest.force_pN
    memory = memory_time_s(rest.radius_nm, VISCOSITY)
    power = np.zeros_like(HZ)
    for n in range(-200, 201):
        at = np.abs(HZ + n / FILMED.frame_s)
        moving = power_with_memory(2 * np.pi * at, np.array([tau]), np.array([variance]), memory)
        power += moving * np.sinc(at * FILMED.exposure_s) ** 2
    return power


def truncated(stiffness: float, friction: float, *, aliases: int) -> FloatArray:
    """Spectrum of one mode with blur and the nearest aliases."""
    variance, tau = kT() / stiffness, friction / stiffness
    power = np.zeros_like(HZ)
    for n in range(-aliases, aliases + 1):
        at = HZ + n / FILMED.frame_s
        moving = 4 * variance * tau / (1 + (2 * np.pi * at * tau) ** 2)
        power += moving * np.sinc(at * FILMED.exposure_s) ** 2
    return power


def seen(rest: Rest, power: FloatArray, lever_nm: float | None = None) -> Seen:
    """Taken for motion along the field unless a lever is given."""
    return Seen(power, rest.length_nm if lever_nm is None else lever_nm, mode)


def white(rest: Rest, nm: float) -> Seen:
    """Tracking noise."""
    return seen(rest, along(rest) + 2 * FILMED.frame_s * nm**2)


def exposed(rest: Rest, share: float) -> Seen:
    """A shorter exposure than the whole frame."""
    stiffness = rest.force_pN / rest.length_nm
    camera = replace(FILMED, exposure_s=share * FILMED.frame_s)
    return seen(rest, recorded(HZ, kT() / stiffness, rest.friction / stiffness, camera))


def forces(rest: Rest, shares: FloatArray) -> Seen:
    """Parts of the recording at other forces."""
    each = [along(replace(rest, force_pN=rest.force_pN * one)) for one in shares]
    return seen(rest, np.mean(each, axis=0))


def stretched(rest: Rest) -> Seen:
    """A chain that stretches, and the length of one that does not."""
    soft = Chain(rest.contour_nm, 50.0, KELVIN, "extensible", 1000.0)
    length = float(extension_nm(soft, rest.force_pN))
    return seen(rest, mode(rest.force_pN / length, rest.friction))


def near_wall(rest: Rest) -> float:
    """Friction along the surface."""
    return rest.friction * float(parallel_wall_factor(rest.across_nm, rest.radius_nm))


def larger(rest: Rest) -> Seen:
    """Across the field: a bead of a radius that is 5 % larger than it is taken for."""
    big = replace(rest, radius_nm=1.05 * rest.radius_nm)
    return seen(rest, across(big), rest.across_nm)


def uneven(rest: Rest, degrees: float) -> Seen:
    """Axes that are turned against the field."""
    part = math.sin(math.radians(degrees)) ** 2
    return seen(rest, (1 - part) * along(rest) + part * across(rest))


EFFECTS: dict[str, Callable[[Rest], Seen]] = {
    "x wall drag": lambda r: seen(r, along(r, friction=near_wall(r))),
    "y rotation coupling, bulk drag": lambda r: seen(
        r, turning(r, lever_nm=r.radius_nm), r.across_nm
    ),
    "y rotation coupling + wall drag": lambda r: seen(
        r, turning(r, lever_nm=r.radius_nm, wall=True), r.across_nm
    ),
    "x alignment κ = 10⁴ pN nm/rad": lambda r: seen(r, turning(r, lever_nm=r.radius_nm, kappa=1e4)),
    "x alignment κ = 10⁵ pN nm/rad": lambda r: seen(r, turning(r, lever_nm=r.radius_nm, kappa=1e5)),
    "x noise 2 nm": lambda r: white(r, 2),
    "x noise 5 nm": lambda r: white(r, 5),
    "x noise 10 nm": lambda r: white(r, 10),
    "x exposure D/2, fitted as D": lambda r: exposed(r, 0.5),
    "x exposure 0.9 D, fitted as D": lambda r: exposed(r, 0.9),
    "x linear drift 1 nm/s": lambda r: seen(r, along(r) + drifting(1)),
    "x linear drift 0.1 nm/s": lambda r: seen(r, along(r) + drifting(0.1)),
    "x random walk of 10 nm²/s": lambda r: seen(r, along(r) + walking(10)),
    "x 5 K warmer (η 1.00 → 0.89 mPa s)": lambda r: seen(
        r, along(r, friction=0.89 * r.friction, kelvin=KELVIN + 5)
    ),
    "x radius 5 % larger": lambda r: seen(r, along(r, friction=1.05 * r.friction)),
    "y radius 5 % larger": larger,
    "x pixels 2 % smaller": lambda r: seen(r, 1.02**2 * along(r)),
    "x z scale 0.878 left out": lambda r: seen(r, along(r), r.length_nm / 0.878),
    "y z scale 0.878 left out": lambda r: seen(r, across(r), r.length_nm / 0.878 + r.radius_nm),
    "axes swapped: y taken for x": lambda r: seen(r, across(r)),
    "axes swapped: x taken for y": lambda r: seen(r, along(r), r.across_nm),
    "x axes turned by 20°": lambda r: uneven(r, 20),
    "x magnets' stiffness F/(1 mm)": lambda r: seen(
        r, mode(r.force_pN * (1 / r.length_nm + 1e-6), r.friction)
    ),
    "x hopping by ±10 nm, 2/s each way": lambda r: seen(
        r, along(r) + recorded(HZ, 100.0, 1 / 4, FILMED)
    ),
    "x 50 Hz line of 5 nm rms, not left out": lambda r: seen(r, along(r) + shaking(50, 5)),
    "x 2 % of frames dropped": lambda r: seen(r, dropped(r, 0.02)),
    "x 10 % of frames dropped": lambda r: seen(r, dropped(r, 0.1)),
    "x trigger jitter 1 ms rms": lambda r: seen(r, jittered(r, 1e-3)),
    "x hydrodynamic memory (bulk)": lambda r: seen(r, remembered(r)),
    "x L from a chain that does not stretch, K₀ = 1000 pN": stretched,
    "x L from a contour length 5 % too long": lambda r: seen(r, along(r), 1.05 * r.length_nm),
    "x off-centre by 30°, z as recorded": lambda r: seen(
        r, along(r), r.length_nm - r.radius_nm * (1 - math.cos(TILT))
    ),
    "y off-centre by 30°, true L, bulk drag": lambda r: seen(
        r, turning(r, lever_nm=r.radius_nm * math.cos(TILT)), r.across_nm
    ),
    "x force ramp ±10 %": lambda r: forces(r, np.linspace(0.9, 1.1, 41)),
    "x force step 0.8 F → 1.2 F half-way": lambda r: forces(r, np.array([0.8, 1.2])),
    "analysis with aliases n = −1, 0, 1": lambda r: Seen(
        along(r), r.length_nm, functools.partial(truncated, aliases=1)
    ),
    "analysis with blur and no alias": lambda r: Seen(
        along(r), r.length_nm, functools.partial(truncated, aliases=0)
    ),
}


@dataclass(frozen=True)
class Bias:
    """Of the force with friction free and fixed, the friction over the nominal one, and Λ."""

    free: float
    fixed: float
    friction: float
    lost: float


def bias_of(rest: Rest, what: Seen) -> Bias:
    """Fit an expected spectrum.

    Λ is twice the ln likelihood that the best fit is expected to lose against the spectrum itself.
    """
    start = rest.force_pN / what.lever_nm

    def deviance(stiffness: float, friction: float) -> float:
        ratio = what.power / what.model(start * math.exp(stiffness), friction)
        return float(2 * np.sum(ratio - 1 - np.log(ratio)))

    def of_both(logs: FloatArray) -> float:
        return deviance(logs[0], rest.friction * math.exp(logs[1]))

    farthest = math.log(FARTHEST)
    choice = {"xatol": 1e-6, "fatol": 1e-6, "maxiter": 2000}
    both = optimize.minimize(
        of_both,
        [0.0, 0.0],
        method="Nelder-Mead",
        options=choice,
        bounds=[(-farthest, farthest)] * 2,
    )
    one = optimize.minimize_scalar(
        deviance, args=(rest.friction,), bounds=(-farthest, farthest), method="bounded"
    )
    return Bias(math.expm1(both.x[0]), math.expm1(one.x), math.exp(both.x[1]), float(both.fun))


def cell(bias: Bias) -> str:
    """As the table has it."""
    free, fixed = (f"{100 * one:+.1f}".replace("-", "−") for one in (bias.free, bias.fixed))
    free = "−100" if bias.free < COLLAPSED else free
    return f"{free} / {fixed} ({bias.friction:.2f})"


def biases(effects: Mapping[str, Callable[[Rest], Seen]] = EFFECTS) -> str:
    """The table, and what a variance alone gives."""
    lines = []
    for name, effect in effects.items():
        found = [bias_of(rest, effect(rest)) for rest in RESTS.values()]
        lost = "/".join(f"{one.lost:.0f}" for one in found)
        lines.append([name, *map(cell, found), lost])
    header = " | ".join(["effect", *RESTS, "Λ, friction free"])
    shares = [blur_factor(FILMED.exposure_s / covariances(rest)[0]) for rest in RESTS.values()]
    too_high = [f"{100 * (1 / float(share) - 1):.0f}" for share in shares]
    alone = (
        "A force from the variance alone, without the blur factor of section 1, is too high by "
        f"{', '.join(too_high[:3])} % (A) and {', '.join(too_high[3:])} % (B) at 1, 5 and 10 pN."
    )
    return f"{table(header, lines)}\n\n{alone}"


def main() -> None:
    """Print the table, or write it into its page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, help="page to put the table into")
    page = parser.parse_args().write
    said = (
        f"Printed {datetime.now(UTC):%Y-%m-%d} by mtpipe {VERSION} with\n\n"
        f"    python workflows/physics/biases.py --write docs/physics.md\n\n{biases()}"
    )
    print(said)
    if page is not None:
        text = into_page(page.read_text(encoding="utf-8"), {"biases": said})
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
