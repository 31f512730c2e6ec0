"""How far a fitted parameter may lie, from the likelihood itself.

Where the bead relaxes within a frame, successive frames hardly correlate, and the likelihood is no
parabola: one side of it may be open though the curvature at its maximum looks sharp. There its
profile is followed (Cox & Hinkley 1974, Theoretical Statistics, section 9.3): a parameter is moved
away, all others adapt, and the interval of 68 % ends where −2 ln L has risen by 1. The likelihood
of traces of few relaxation times is no parabola either, but intervals by its curvature cover there
(docs/validation.md).
"""

from __future__ import annotations

import numpy as np

from mtpipe.fit.model import PRIOR_HALF_WIDTH, TraceModel
from mtpipe.physics.camera import FloatArray

# Below this standard error of a logarithm its likelihood is a parabola for all purposes.
SMALL_LN = 0.1
# One standard error off, −2 ln L of a parabola has risen by 1; it may be so much more or less.
PARABOLA = 1.5
# Distances that are tried, how often all else is moved for each, and by how much for a slope.
NEAREST, POINTS = 0.02, 18
ITERATIONS = 5
STEP = 1e-6


def is_parabola(model: TraceModel, theta: FloatArray, covariance: FloatArray) -> bool:
    """Whether covariance (free, free) at a maximum θ (3,) tells how far stiffness and friction lie.

    It is taken to where the bead does not relax within a frame, or both are known well, or −2 ln L
    rises by 1 one standard error off in the one that is known worse.
    """
    sigma = np.sqrt(np.maximum(np.diag(covariance)[:2], 0.0))
    worse = int(np.argmax(sigma))
    within_frame = np.exp(theta[1] - theta[0]) < model.spectrum.window.frame_s
    if not within_frame or not sigma[worse] > SMALL_LN:
        return True
    if not sigma[worse] < PRIOR_HALF_WIDTH:
        return False
    along = covariance[:, worse] / sigma[worse]
    moved = np.tile(theta, (3, 1))
    moved[0, list(model.free)] += along
    moved[1, list(model.free)] -= along
    _bound(model, moved)
    up, down, least = np.sum(model.residuals(moved) ** 2, axis=1)
    rise = np.array([up, down]) - least
    return bool(np.all((rise > 1 / PARABOLA) & (rise < PARABOLA)))


def profile_reach(
    model: TraceModel, theta: FloatArray, covariance: FloatArray, along: tuple[float, float]
) -> tuple[float, float]:
    """How far down and up a combination of ln stiffness and ln friction may lie (68 %).

    Parameters
    ----------
    theta : (3,) the maximum. covariance : (free, free) there, for the way to start on.
    along : weights of ln stiffness and ln friction.

    Returns
    -------
    Both distances; inf where the likelihood does not fall enough within a factor of e^5.
    """
    free = list(model.free)
    weights = np.zeros(len(free))
    weights[:2] = along
    unit = np.ones(len(free))
    if len(free) > 2 and not model.noise_is_log:
        unit[2] = model.spectrum.variance_nm2
    # all of the coordinates that do not change the combination
    others = np.linalg.svd(weights[None])[2][1:] * unit
    way = covariance @ weights
    spread = float(weights @ way)
    way = way / spread if 0 < spread < np.inf else weights / float(weights @ weights)
    distance = np.concatenate([-_distances(), _distances()])
    moved = np.tile(theta, (len(distance), 1))
    moved[:, free] += distance[:, None] * way
    _bound(model, moved)
    most = theta[:2] + 3 * PRIOR_HALF_WIDTH * np.array([[-1.0], [1.0]])
    for _ in range(ITERATIONS):
        here = model.residuals(moved)
        shifted = np.repeat(moved[None], len(others), axis=0)
        shifted[:, :, free] += STEP * others[:, None]
        slopes = np.stack([(model.residuals(one) - here) / STEP for one in shifted], axis=-1)
        normal = np.einsum("nbi,nbj->nij", slopes, slopes)
        # where nothing else matters any more, nothing else moves
        ridge = 1e-9 * np.trace(normal, axis1=1, axis2=2) + 1e-12
        normal += ridge[:, None, None] * np.eye(len(others))
        wanted = -np.linalg.solve(normal, np.einsum("nbi,nb->ni", slopes, here)[..., None])[..., 0]
        moved[:, free] += np.clip(wanted, -1.0, 1.0) @ others
        moved[:, :2] = np.clip(moved[:, :2], *most)
        _bound(model, moved)
    rise = np.sum(model.residuals(moved) ** 2, axis=1)
    rise -= float(np.sum(model.residuals(theta[None]) ** 2))
    return _crossing(rise[:POINTS]), _crossing(rise[POINTS:])


def _distances() -> FloatArray:
    return np.geomspace(NEAREST, PRIOR_HALF_WIDTH, POINTS)


def _bound(model: TraceModel, theta: FloatArray) -> None:
    if not model.noise_is_log and model.noise_variance_nm2 is None:
        theta[:, 2] = np.maximum(theta[:, 2], 0.0)


def _crossing(rise: FloatArray) -> float:
    """Where −2 ln L has risen by 1; its root is nearly straight."""
    beyond = np.flatnonzero(~(rise < 1.0))
    if not len(beyond):
        return float("inf")
    i = int(beyond[0])
    root = np.sqrt(np.maximum(np.concatenate([[0.0], rise[: i + 1]]), 0.0))
    distance = np.concatenate([[0.0], _distances()[: i + 1]])
    share = (1.0 - root[-2]) / (root[-1] - root[-2])
    return float(distance[-2] + share * (distance[-1] - distance[-2]))
