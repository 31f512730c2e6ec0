"""Traces that are no tethered bead's: told by their motion, before any force is believed.

Each function looks at one kind and returns a sentence, or None. The limits are physical (a force at
which DNA is no longer double-stranded, a trace that never returns) or, where a shape is judged,
so far from a Gaussian tether that a chance refusal is rarer than one in ten thousand traces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, stats

from mtpipe.fit.trace import TraceFit
from mtpipe.ground.status import LEAST_RELAXATIONS
from mtpipe.ground.types import FloatArray
from mtpipe.setup.conditions import Conditions

# DNA overstretches at 65 pN (Smith, Cui & Bustamante 1996); no calibration is meant beyond.
STRONGEST_TETHER_PN = 65.0
# No bead near a surface has this many times its Stokes friction with the wall's correction.
IMPLAUSIBLE_FRICTION = 5.0
# Least shares of the motion at one frequency for a driven bead. On a circle it is over half of x
# and of y, a quarter period apart, which no vibrating table does. Along a line, as tables vibrate,
# more is asked. A line of less than three periods in the trace is drift.
CIRCLE_SHARE, LINE_SHARE = 0.5, 0.75
LINE_LOWEST_ORDINATE = 3
# A line is looked for at four frequencies per ordinate, and held against 16 ordinates about it,
# from where its own leakage is below a hundredth. By chance one trace in a million shows one.
BETWEEN_ORDINATES, LINE_NEIGHBOURS, LINE_LEAKAGE, LINE_CHANCE = 4, 16, 4, 1e-6
CIRCLING_WINDOW = 2048
# Largest ⟨r⁴⟩/⟨r²⟩² of positions on a ring, which has 1; a disc (a tether without force) has 4/3.
RING_MOMENT = 1.25


def driven(lateral_nm: FloatArray, frame_s: float, relaxation_s: float) -> str | None:
    """Motion on a ring or along a line, as rotating magnets drive it.

    Parameters
    ----------
    lateral_nm : (n_frames, 2) x and y, NaN where lost.
    relaxation_s : fitted relaxation time, which sets how many independent positions there are.
    """
    present = np.all(np.isfinite(lateral_nm), axis=1)
    xy = lateral_nm[present] - lateral_nm[present].mean(axis=0)
    if len(xy) < 64:
        return None
    line = _driven_line(lateral_nm, frame_s)
    if line is not None:
        how = "circles" if line.circles else "swings to and fro"
        return f"the bead {how} at {line.frequency_hz:.3g} Hz, as when rotating magnets drive it"
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


@dataclass(frozen=True)
class _Line:
    """A line that stands out of a trace's spectrum: its frequency, and whether it is a circle."""

    frequency_hz: float
    circles: bool


def _driven_line(lateral_nm: FloatArray, frame_s: float) -> _Line | None:
    """The line at which a bead is driven over the whole trace or a part of it; None: it is not.

    A part counts when two neighbouring windows show the same line.
    """
    whole = _line(lateral_nm, frame_s)
    if whole is not None:
        return whole
    before: _Line | None = None
    for start in range(0, len(lateral_nm) - CIRCLING_WINDOW + 1, CIRCLING_WINDOW):
        found = _line(lateral_nm[start : start + CIRCLING_WINDOW], frame_s)
        apart_hz = 1 / (CIRCLING_WINDOW * frame_s)
        if (
            found is not None
            and before is not None
            and found.circles == before.circles
            and abs(found.frequency_hz - before.frequency_hz) <= apart_hz
        ):
            return found
        before = found
    return None


def _line(lateral_nm: FloatArray, frame_s: float) -> _Line | None:
    """The line that holds most of the motion, and stands out of its neighbours beyond chance.

    Power at an ordinate over the mean of those about it has Fisher and Snedecor's distribution
    where the spectrum is smooth; all ordinates are tried, and frequencies between them.
    """
    present = np.all(np.isfinite(lateral_nm), axis=1)
    if 2 * present.sum() < len(lateral_nm):
        return None
    xy = np.where(present[:, None], lateral_nm - lateral_nm[present].mean(axis=0), 0.0)
    frames = len(xy)
    fine = fft.rfft(xy, BETWEEN_ORDINATES * frames, axis=0)
    both = np.sum(np.abs(fine) ** 2, axis=1)
    lowest = BETWEEN_ORDINATES * LINE_LOWEST_ORDINATE
    highest = len(both) - BETWEEN_ORDINATES
    if highest - lowest < BETWEEN_ORDINATES * LINE_NEIGHBOURS:
        return None
    peak = lowest + int(np.argmax(both[lowest:highest]))
    # neighbours at whole ordinates from the peak, beyond its own leakage
    offsets = np.arange(LINE_LEAKAGE, LINE_LEAKAGE + LINE_NEIGHBOURS // 2)
    about = peak + BETWEEN_ORDINATES * np.concatenate([-offsets, offsets])
    about = about[(about > 0) & (about < len(both))]
    # what a line leaks far away is no background
    ratio = both[peak] / max(float(np.mean(both[about])), 1e-300)
    tried = BETWEEN_ORDINATES * frames / 2
    if tried * float(stats.f.sf(ratio, 4, 4 * len(about))) > LINE_CHANCE:
        return None
    share = 2 * np.abs(fine[peak]) ** 2 / (present.sum() * np.sum(xy**2, axis=0))
    frequency = peak / (BETWEEN_ORDINATES * frames * frame_s)
    phase = float(np.angle(fine[peak, 1] / fine[peak, 0]))
    quadrature = abs(abs(phase) - math.pi / 2) < math.radians(35)
    if quadrature and float(share.min()) > CIRCLE_SHARE:
        return _Line(frequency, circles=True)
    along = 2 * both[peak] / (present.sum() * np.sum(xy**2))
    if float(along) > LINE_SHARE:
        return _Line(frequency, circles=False)
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
        "the spectrum does not level off at low frequencies, as that of a tethered bead does: this "
        "is how free diffusion or drift looks"
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
        f"the bead is probably stuck: it moves only {math.sqrt(measured / least_power):.2g} times "
        f"as much as on a tether of {tether_nm:.0f} nm at {STRONGEST_TETHER_PN:.0f} pN, the most "
        "that DNA bears"
    )
