"""Which kind of tether a curve of extension against turns is of, with its probability.

Of each kind the evidence is taken by Laplace's approximation about its best fit, the scatter of the
points about it being free. Points that follow one another are not independent: their scatter
counts as often as its correlation lets it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from mtpipe.curves.rotation.kinds import KINDS, Kind, Known, Shapes
from mtpipe.curves.rotation.turned import Turned
from mtpipe.ground.types import FloatArray

CANNOT_TELL = "cannot tell"
# A kind is named from this probability on.
SURE = 0.95
# Scatter about the best fit, as a share of the tether's length, beyond which none of them fits.
MOST_SCATTER = 0.1
# Fall of the extension, as a share of the tether's length, that drift may also make.
LEAST_FALL = 0.05
# Least error of heights, as a share of the tether's length, however smooth they are: they drift.
LEAST_SCATTER = 0.01
# Starts of the fit for the relaxed place, in prior standard deviations.
STARTS = (-1.5, -0.5, 0.0, 0.5, 1.5)
ROUNDS = 4
STEP = 1e-4


@dataclass(frozen=True)
class Verdict:
    """What turning a bead says of its tether.

    Attributes
    ----------
    verdict : a kind, or "cannot tell". reason : in words.
    probability : of each kind, these three being all there are.
    buckling_turns, buckling_stderr : of a supercoilable one, from where it is relaxed; else nan.
    relaxed_turns : where the magnets are then; nan of a nicked one.
    scatter_nm : of the points about the best fit. fitted_nm : (n,) the best fit.
    """

    verdict: str
    reason: str
    probability: Mapping[Kind, float]
    buckling_turns: float
    buckling_stderr: float
    relaxed_turns: float
    scatter_nm: float
    fitted_nm: FloatArray


@dataclass(frozen=True)
class _Fit:
    numbers: FloatArray
    fitted_nm: FloatArray
    scatter_nm: float
    information: FloatArray


def verdict_of(turned: Turned, known: Known) -> Verdict:
    """Weigh the kinds of tether that a bead may have, each as likely as another beforehand."""
    heights = turned.extension_nm
    top, bottom = float(np.quantile(heights, 0.95)), float(heights.min())
    shapes = Shapes(known, turned.turns, top, top - bottom)
    fits = {kind: _fit(shapes, kind, heights) for kind in KINDS}
    closest = min(fits.values(), key=lambda fit: fit.scatter_nm)
    repeats = _correlation(heights - closest.fitted_nm)
    log = {kind: _log_evidence(fit, heights, repeats) for kind, fit in fits.items()}
    flat = log["nicked"]
    log["supercoilable"] = np.logaddexp(
        log["supercoilable"] + np.log(max(known.falls, 1e-300)),
        flat + np.log(max(1 - known.falls, 1e-300)),
    )
    weights = np.exp(np.array([log[kind] for kind in KINDS]) - max(log.values()))
    shares = dict(zip(KINDS, (weights / weights.sum()).tolist(), strict=True))
    best = max(KINDS, key=lambda kind: shares[kind])
    fit = fits[best]
    relaxed = buckling = stderr = np.nan
    if best != "nicked":
        relaxed = shapes.relaxed(float(fit.numbers[1]))
    if best == "supercoilable":
        buckling, stderr = _buckling(shapes, fit)
    named, reason = _named(best, shares, fit, known)
    return Verdict(named, reason, shares, buckling, stderr, relaxed, fit.scatter_nm, fit.fitted_nm)


def _fit(shapes: Shapes, kind: Kind, heights: FloatArray) -> _Fit:
    """Most likely numbers of a kind, and the scatter that it leaves, in turn."""
    shape, count = shapes.of(kind)
    least_nm = LEAST_SCATTER * shapes.known.contour_nm
    ends = []
    for start in STARTS if count > 1 else STARTS[:1]:
        x = np.zeros(count)
        x[1:2] = start
        scatter = max(float(np.std(heights)), least_nm)
        for _ in range(ROUNDS):

            def residuals(x: FloatArray, scatter: float = scatter) -> FloatArray:
                return np.concatenate([(heights - shape(x)) / scatter, x])

            x = least_squares(residuals, x, max_nfev=60).x
            left = heights - shape(x)
            scatter = max(float(np.sqrt(np.mean(left**2))), least_nm)
        ends.append((len(heights) * np.log(scatter) + 0.5 * float(x @ x), x, scatter))
    _, x, scatter = min(ends, key=lambda end: end[0])
    steps = STEP * np.eye(count)
    slopes = np.array([(shape(x + step) - shape(x - step)) / (2 * STEP) for step in steps])
    return _Fit(x, shape(x), scatter, slopes @ slopes.T / scatter**2)


def _log_evidence(fit: _Fit, heights: FloatArray, repeats: float) -> float:
    left = heights - fit.fitted_nm
    fitted = len(left) * np.log(fit.scatter_nm) + 0.5 * float(left @ left) / fit.scatter_nm**2
    _, volume = np.linalg.slogdet(np.eye(len(fit.numbers)) + fit.information / repeats)
    prior = 0.5 * float(fit.numbers @ fit.numbers)
    return float(-fitted / repeats - prior - 0.5 * volume)


def _correlation(left: FloatArray) -> float:
    """How many neighbouring points tell as much as one: 1 where each has its own error."""
    left = left - left.mean()
    power = float(left @ left)
    if power == 0:
        return 1.0
    total = 1.0
    for lag in range(1, len(left) // 2):
        share = float(left[lag:] @ left[:-lag]) / power
        if share <= 0:
            break
        total += 2 * share
    return total


def _buckling(shapes: Shapes, fit: _Fit) -> tuple[float, float]:
    x = fit.numbers
    covariance = np.linalg.inv(np.eye(len(x)) + fit.information)
    steps = STEP * np.eye(len(x))
    at = [[shapes.coiling(x + s * step).buckling_turns for step in steps] for s in (1, -1)]
    slope = (np.array(at[0]) - np.array(at[1])) / (2 * STEP)
    return shapes.coiling(x).buckling_turns, float(np.sqrt(slope @ covariance @ slope))


def _named(best: Kind, shares: Mapping[Kind, float], fit: _Fit, known: Known) -> tuple[str, str]:
    if fit.scatter_nm > MOST_SCATTER * known.contour_nm:
        said = f"the extension scatters by {fit.scatter_nm:.0f} nm about every one of the kinds"
        return CANNOT_TELL, said
    fall = float(np.ptp(fit.fitted_nm))
    if best != "nicked" and fall < LEAST_FALL * known.contour_nm:
        return CANNOT_TELL, f"the extension changes by {fall:.0f} nm, as it may do by drift"
    if shares[best] >= SURE:
        return best, {
            "nicked": "turns do not change the extension",
            "supercoilable": "the extension stays, and falls beyond buckling",
            "several tethers": "the extension falls from the first turn on",
        }[best]
    left = [kind for kind in KINDS if shares[kind] > 1 - SURE]
    said = f"it may be {' or '.join(left)}"
    if best == "nicked" or "nicked" in left:
        high = known.falls < SURE
        said += (
            ": at such a force turns need not shorten a supercoilable one"
            if high
            else ": so few turns need not shorten a supercoilable one"
        )
    return CANNOT_TELL, said
