"""Traces that are no tethered bead's: told by their motion, before any force is believed.

Each function looks at one kind and returns a sentence, or None. The limits are physical (a force at
which DNA is no longer double-stranded, a trace that never returns) or, where a shape is judged,
so far from a Gaussian tether that a chance refusal is rarer than one in ten thousand traces.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy import fft

from mtpipe.conditions import Conditions
from mtpipe.fit.trace import TraceFit
from mtpipe.physics.camera import FloatArray
from mtpipe.status import LEAST_RELAXATIONS

# DNA overstretches at 65 pN (Smith, Cui & Bustamante 1996); no calibration is meant beyond.
STRONGEST_TETHER_PN = 65.0
# No bead near a surface has this many times its Stokes friction with the wall's correction.
IMPLAUSIBLE_FRICTION = 5.0
LINE_SHARE = 0.75
LINE_LOWEST_ORDINATE = 3
CIRCLING_WINDOW = 2048
# A ring stays below; a disc, the motion of a tether without force, has 4/3.
RING_MOMENT = 1.25


def driven(lateral_nm: FloatArray, frame_s: float, relaxation_s: float) -> str | None:
    """Motion on a ring, as rotating magnets drive it.

    Parameters
    ----------
    lateral_nm : (n_frames, 2) x and y, NaN where lost.
    relaxation_s : fitted relaxation time, which sets how many independent positions there are.
    """
    present = np.all(np.isfinite(lateral_nm), axis=1)
    xy = lateral_nm[present] - lateral_nm[present].mean(axis=0)
    if len(xy) < 64:
        return None
    frequency = _circling_hz(lateral_nm, frame_s)
    if frequency is not None:
        return f"the bead circles at {frequency:.3g} Hz, as when rotating magnets drive it"
    whitened = np.linalg.solve(np.linalg.cholesky(np.cov(xy.T) + 1e-12 * np.eye(2)), xy.T)
    squared = np.sum(whitened**2, axis=0)
    moment = float(np.mean(squared**2) / np.mean(squared) ** 2)
    independent = len(lateral_nm) * frame_s / (2 * max(relaxation_s, frame_s / 2))
    # Gaussian positions have moment 2 ± 2/√n; a ring has 1
    if moment < RING_MOMENT and 2 - moment > 10 / math.sqrt(max(independent, 1.0)):
        return (
            "the bead's positions lie on a ring and not about a point (fourth moment "
            f"{moment:.2f}, a tether has 2): it is driven, or held by more than a tether"
        )
    return None


def _circling_hz(lateral_nm: FloatArray, frame_s: float) -> float | None:
    """Frequency at which a bead circles over the whole trace or a part of it; None: it does not.

    A part counts when two neighbouring windows show the same line.
    """
    whole = _circling_ordinate(lateral_nm)
    if whole is not None:
        return whole / (len(lateral_nm) * frame_s)
    before: int | None = None
    for start in range(0, len(lateral_nm) - CIRCLING_WINDOW + 1, CIRCLING_WINDOW):
        ordinate = _circling_ordinate(lateral_nm[start : start + CIRCLING_WINDOW])
        if ordinate is not None and before is not None and abs(ordinate - before) <= 1:
            return ordinate / (CIRCLING_WINDOW * frame_s)
        before = ordinate
    return None


def _circling_ordinate(lateral_nm: FloatArray) -> int | None:
    """The ordinate that holds most of the motion on both axes, a quarter turn apart."""
    present = np.all(np.isfinite(lateral_nm), axis=1)
    if 2 * present.sum() < len(lateral_nm):
        return None
    xy = np.where(present[:, None], lateral_nm - lateral_nm[present].mean(axis=0), 0.0)
    dft = fft.rfft(xy, axis=0)[1:-1]
    power = np.abs(dft) ** 2
    total = power.sum(axis=0)
    if len(power) < 16 or not np.all(total > 0):
        return None
    both = power.sum(axis=1)
    peak = int(np.argmax(both))
    if peak + 1 < LINE_LOWEST_ORDINATE:
        return None
    share = power[max(peak - 1, 0) : peak + 2].sum(axis=0) / total
    phase = np.angle(dft[peak, 1] / dft[peak, 0])
    quadrature = abs(abs(phase) - math.pi / 2) < math.radians(35)
    if np.all(share > LINE_SHARE) and quadrature:
        return peak + 1
    return None


def without_plateau(fit: TraceFit, expected_friction: float | None) -> str | None:
    """Free diffusion: the spectrum has no plateau within the length of the trace.

    Parameters
    ----------
    expected_friction : in pN s/nm, or None. A bead diffuses as fast as its friction lets it; slow
        motion that is much slower than that is drift under a tether's own, faster motion.
    """
    if fit.relaxations >= LEAST_RELAXATIONS:
        return None
    friction = math.exp(fit.theta[1])
    if expected_friction is not None and friction > IMPLAUSIBLE_FRICTION * expected_friction:
        return None
    return (
        "the spectrum has no plateau: the motion cannot be told from free diffusion or drift, "
        "which never return"
    )


def stuck(fit: TraceFit, conditions: Conditions, axis: int, tether_nm: float) -> str | None:
    """Motion smaller than that of a bead on any intact double-stranded DNA.

    At every frequency a stiffer tether moves less, so the power expected at the strongest force
    DNA bears is a lower bound; tracking noise only adds to it.

    Parameters
    ----------
    tether_nm : length of the tether: its extension or contour length, the larger.
    """
    if not tether_nm > 0:
        return None
    friction = conditions.friction_pN_s_per_nm(axis, tether_nm)
    if friction is None:
        return None
    spectrum = fit.spectrum
    stiffness = STRONGEST_TETHER_PN / tether_nm
    theta = np.array([[math.log(stiffness), math.log(friction), 0.0]])
    least = replace(fit.model, noise_variance_nm2=0.0).expected(theta)[0]
    # above 1 Hz, where drift that the reference left does not reach
    above = spectrum.frequency_hz > min(1.0, 0.1 / spectrum.window.frame_s)
    weight = spectrum.ordinates / spectrum.gain * above
    measured, least_power = float(weight @ spectrum.power), float(weight @ least)
    if measured > least_power:
        return None
    return (
        f"the bead moves less than any tether of {tether_nm:.0f} nm allows "
        f"({math.sqrt(measured / least_power):.2g} times the least amplitude, that at "
        f"{STRONGEST_TETHER_PN:.0f} pN where DNA overstretches): it is probably stuck"
    )
