"""Maximum likelihood of the configured experiment, by Fisher scoring.

A force moves its own plateau alone, so the information is an arrow: one row per force and a few for
what all plateaus share. Steps are damped (Levenberg and Marquardt) until the likelihood rises, and
coordinates at a bound that the step would leave are held there.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import Parameter
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.ground.written_numbers import with_error
from mtpipe.joint_fit.data import PlateauData
from mtpipe.joint_fit.expectation import (
    Expectation,
    know_states,
)
from mtpipe.joint_fit.height_course import Course, CourseSlopes
from mtpipe.joint_fit.information import gradient_of, information_of
from mtpipe.joint_fit.model import ConfiguredModel, spectral_log_likelihood
from mtpipe.joint_fit.random_walk import line_of
from mtpipe.joint_fit.slopes import Slopes, height_slopes, slopes

MOST_ROUNDS = 15
# ln likelihood (nats). The fit has converged when a step leaves less than the first, or gains less
# and predicted hardly more; a failed step that predicts less than the second is not shortened
# any more.
ARRIVED, NOTHING_NATS = 1e-3, 1e-6
# Largest change of ln power in one step, and largest correlation of two axes after it.
MOST_MOVED, MOST_CORRELATED = 2.0, 0.999
# After a failed step the next one tried predicts at most this share of its rise, as one that is
# hardly shorter would fail too.
SHORTER = 0.8
# A step's gain is foretold by the quadratic form to no better than this share: its curvature may be
# off by as much in directions other than the step's.
LEAST_MISJUDGED = 0.2
# The fit ends after 3 steps in a row that gain next to nothing, or where no step succeeds. It has
# converged if the last one predicted less than 0.1 nats.
STUCK, NEARLY_NATS = 3, 0.1
# A step that raises ln likelihood by less than this share of what its slope promises (a half where
# the curvature is as expected) has gone too far.
OVERSHOT = 0.25
FORCE_GRID_PN, GRID_STRIDE = np.geomspace(0.01, 150.0, 45), 3


@dataclass(frozen=True, eq=False, repr=False)
class ConfiguredFit:
    """The configured experiment at its most likely.

    Attributes
    ----------
    theta : coordinates.
    expected : of each plateau, at θ.
    """

    model: ConfiguredModel
    theta: FloatArray
    expected: list[Expectation]
    log_likelihood: float
    converged: bool

    def __repr__(self) -> str:
        pairs = zip(self.force_pN, self.force_stderr_pN, strict=True)
        forces = ", ".join(with_error(force, stderr, brief=False) for force, stderr in pairs)
        return f"ConfiguredFit of {len(self.expected)} plateaus: forces {forces} pN"

    @functools.cached_property
    def slopes(self) -> list[Slopes]:
        """Slopes of each plateau's expectation, at θ."""
        return slopes(self.model, self.theta, self.expected)

    @functools.cached_property
    def information(self) -> FloatArray:
        """Expected Fisher information about θ, priors included."""
        return information_of(self.model, self.theta, self.expected, self.slopes)

    @property
    def height_pulls(self) -> FloatArray:
        """(plateaus,) missed mean heights, independent and in standard errors."""
        return self.model.heights(self.model.data, self.expected, self.theta).pulls

    @property
    def height_pull_slopes(self) -> FloatArray:
        """(plateaus, coordinates) derivatives of `height_pulls` by θ at a fixed random walk."""
        heights = self.model.heights(self.model.data, self.expected, self.theta)
        return np.asarray(-heights.whitening @ height_slopes(self.slopes, len(self.theta)))

    @property
    def covariance(self) -> FloatArray:
        """Covariance of θ."""
        return _inverse(self.information)

    @property
    def force_pN(self) -> FloatArray:
        """(plateaus,) forces."""
        return np.exp(self.theta[: self.model.plateaus])

    @property
    def force_stderr_pN(self) -> FloatArray:
        """(plateaus,) their standard errors."""
        relative = np.sqrt(np.diag(self.covariance)[: self.model.plateaus])
        return np.asarray(self.force_pN * relative)


def fit_configured(
    model: ConfiguredModel,
    start: FloatArray | None = None,
    *,
    rounds: int = MOST_ROUNDS,
    arrived: float = ARRIVED,
) -> ConfiguredFit:
    """Fit.

    Parameters
    ----------
    start : θ to begin from; None: the forces that suit each plateau best by themselves.
    rounds : largest number of steps.
    arrived : the fit ends where a step leaves, or gains, less ln likelihood (nats).

    Raises
    ------
    FitError : no force makes any sense of the data.
    """
    theta = first_guess(model) if start is None else np.clip(start, model.lower, model.upper)
    expected = model.all_expected(theta)
    value = model.log_likelihood(expected, theta)
    damping, converged, idle = 1e-3, False, 0
    for _ in range(rounds):
        derivatives = slopes(model, theta, expected)
        gradient = gradient_of(model, model.data, theta, expected, derivatives)
        information = information_of(model, theta, expected, derivatives)
        free = ~(
            ((theta <= model.lower) & (gradient < 0)) | ((theta >= model.upper) & (gradient > 0))
        )
        moved, failed = False, np.inf
        for _ in range(12):
            step = _step(gradient, information, free, damping)
            trial = np.clip(theta + step, model.lower, model.upper)
            rise = float(gradient @ (trial - theta))
            if 0 < SHORTER * failed < rise:
                damping = max(damping, 1e-4) * 8
                continue
            following, there = _found_at(model, trial)
            if there > value - 1e-9:
                moved = True
                break
            if abs(rise) < NOTHING_NATS:
                break
            failed = rise
            damping = max(damping, 1e-4) * 8
        if not moved:
            converged = rise < NEARLY_NATS
            break
        gained = there - value
        left = _left(gradient, information, free, trial - theta, gained)
        if gained < OVERSHOT * rise:
            # the likelihood curves more than predicted, so that its maximum lies before this step
            before = theta + 0.5 * rise / (rise - gained) * (trial - theta)
            found, height = _found_at(model, before)
            if height > there:
                trial, following, there = before, found, height
                gained = there - value
        theta, expected, value = trial, following, there
        damping = damping / 6 if damping > 1e-9 else 0.0
        idle = idle + 1 if gained < arrived else 0
        if left < arrived or (gained < arrived and rise < 2 * arrived + 1e-2):
            converged = True
            break
        if idle == STUCK:
            converged = rise < NEARLY_NATS
            break
    return ConfiguredFit(model, theta, expected, value, converged)


def _left(
    gradient: FloatArray,
    information: FloatArray,
    free: NDArray[np.bool_],
    change: FloatArray,
    gained: float,
) -> float:
    """Gain that a change of θ leaves for later ones, in nats.

    The quadratic form foretells this change's gain, and that of the whole step of Fisher scoring,
    of which it may be a damped or clipped part. Where the change gains more than foretold by a
    share e, the curvature is smaller by it, and e²/(1 − e) of the foretold gain is left.
    """
    foretold = float(gradient @ change - change @ information @ change / 2)
    more = gained / foretold - 1 if foretold > 0 else np.inf
    if abs(more) < LEAST_MISJUDGED:
        more = LEAST_MISJUDGED
    if more >= 1:
        return np.inf
    whole = float(gradient @ _step(gradient, information, free, 0.0)) / 2
    return more**2 / (1 - more) * foretold + whole - foretold


def _found_at(model: ConfiguredModel, theta: FloatArray) -> tuple[list[Expectation], float]:
    """Expectations and ln likelihood at θ; −inf where it makes no sense."""
    try:
        expected = model.all_expected(theta)
        return expected, model.log_likelihood(expected, theta)
    except (FitError, ValueError):
        return [], -np.inf


def exchanged(
    fit: ConfiguredFit,
    experiment: Experiment,
    kept: Sequence[int],
    added: Sequence[Parameter] = (),
    *,
    arrived: float = ARRIVED,
) -> ConfiguredFit:
    """Fit another experiment with some of a fit's parameters, from where these are, and others.

    Parameters
    ----------
    kept : which of the model's parameters. added : behind them, from their starts.

    Raises
    ------
    FitError : the experiment at the start makes no sense of the data.
    """
    model, first = fit.model, fit.model.plateaus
    parameters = (*(model.parameters[k] for k in kept), *added)
    start = [
        *fit.theta[:first],
        *(fit.theta[first + k] for k in kept),
        *(parameter.start for parameter in added),
    ]
    model = replace(model, experiment=experiment, parameters=parameters)
    return fit_configured(model, np.array(start), arrived=arrived)


def first_guess(model: ConfiguredModel) -> FloatArray:
    """θ with each plateau's best force of a coarse grid, the parameters at their starts."""
    shared = np.array([p.start for p in model.parameters])
    theta = np.concatenate([np.zeros(model.plateaus), shared])
    experiment = model.described(theta)
    know_states(model.data, experiment, [FORCE_GRID_PN.tolist()] * model.plateaus)
    for i in range(model.plateaus):
        theta[i] = np.log(_best_of_grid(model, experiment, i))
    return theta


def _best_of_grid(model: ConfiguredModel, experiment: Experiment, plateau: int) -> float:
    """The force of the grid that suits a plateau best, in pN: first of a part of the grid, then of
    what is left out about it.

    Heights are known far better than they change from one force of the grid to the next, so they
    count only as exactly as that.
    """
    data = model.data[plateau]
    found: dict[int, Expectation] = {}
    best = 0
    for tried in (range(0, len(FORCE_GRID_PN), GRID_STRIDE), range(1 - GRID_STRIDE, GRID_STRIDE)):
        open_yet = [best + step for step in tried]
        open_yet = [i for i in open_yet if i not in found and 0 <= i < len(FORCE_GRID_PN)]
        those = [model.asked(experiment, plateau, float(FORCE_GRID_PN[i])) for i in open_yet]
        answers = zip(open_yet, model.expectations(those), strict=True)
        found |= {i: there for i, there in answers if isinstance(there, Expectation)}
        places = sorted(found)
        if len(places) < 2:
            break
        heights = np.array([found[i].extension_nm for i in places])
        stderr = np.array([found[i].extension_stderr_nm for i in places])
        coarse = np.hypot(stderr, np.gradient(heights, places))
        spectral = [spectral_log_likelihood(data, found[i]) for i in places]
        value = np.array(spectral) - 0.5 * ((data.mean_nm[2] - heights) / coarse) ** 2
        value -= np.log(coarse)
        if not np.any(np.isfinite(value)):
            break
        best = places[int(np.nanargmax(value))]
    else:
        return float(FORCE_GRID_PN[best])
    raise FitError("no force makes the configured experiment agree with this recording at all")


@dataclass(frozen=True, eq=False)
class NearbyFit:
    """What data are expected to be, plateau by plateau, and (plateaus,) forces."""

    expected: list[Expectation]
    force_pN: FloatArray


def nearby_fit(fit: ConfiguredFit, data: Sequence[PlateauData]) -> NearbyFit:
    """A fitted experiment's θ fitted to data drawn from it.

    One step of Fisher scoring from the θ the data were drawn at, which is what a fit changes to
    first order; bounds are kept.
    """
    model, theta = fit.model, fit.theta
    gradient = gradient_of(model, data, theta, fit.expected, fit.slopes)
    free = np.ones(len(theta), dtype=bool)
    held = np.zeros(len(theta))
    for _ in range(len(theta)):
        change = held + _step(gradient - fit.information @ held, fit.information, free, 0.0)
        within = np.clip(theta + change, model.lower, model.upper) - theta
        outside = free & (np.abs(within - change) > 1e-12)
        if not outside.any():
            break
        held[outside] = within[outside]
        free &= ~outside
    expected = [
        replace(
            here,
            random_power=_moved(here.random_power, np.tensordot(change[s.rows], s.power, 1)),
            extension_nm=here.extension_nm + float(change[s.rows] @ s.extension_nm),
            course=_moved_course(here.course, s.course, change[s.rows]),
            walked_nm2=np.maximum(here.walked_nm2 + change[s.rows] @ s.walked, 0.0),
            line_power=line_of(one).power if s.walked.any() else None,
        )
        for one, here, s in zip(data, fit.expected, fit.slopes, strict=True)
    ]
    return NearbyFit(expected, np.exp((theta + change)[: model.plateaus]))


def _moved_course(
    course: Course | None, slopes: CourseSlopes | None, change: FloatArray
) -> Course | None:
    return course if course is None or slopes is None else slopes.moved(course, change)


def _moved(power: FloatArray, change: FloatArray) -> FloatArray:
    """Power matrices (n_bins, 3, 3) and a change of them, to first order, and positive."""
    moved = power + change
    axes = np.arange(power.shape[1])
    before = power[:, axes, axes]
    ratio = change[:, axes, axes] / before
    moved[:, axes, axes] = before * np.exp(np.clip(ratio, -MOST_MOVED, MOST_MOVED))
    size = np.sqrt(moved[:, axes, axes])
    most = MOST_CORRELATED * size[:, :, None] * size[:, None, :]
    moved = np.clip(moved, -most, most)
    moved[:, axes, axes] = size**2
    return np.asarray(moved)


def _step(
    gradient: FloatArray, information: FloatArray, free: NDArray[np.bool_], damping: float
) -> FloatArray:
    step = np.zeros_like(gradient)
    index = np.flatnonzero(free)
    inner = information[np.ix_(index, index)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    scaled = inner / np.outer(scale, scale) + damping * np.eye(len(index))
    step[index] = np.linalg.lstsq(scaled, gradient[index] / scale, rcond=1e-12)[0] / scale
    return step


def _inverse(information: FloatArray) -> FloatArray:
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.asarray(np.linalg.pinv(information / np.outer(scale, scale), hermitian=True)
                      / np.outer(scale, scale))  # fmt: skip
