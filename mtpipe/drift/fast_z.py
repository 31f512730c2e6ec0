"""How much of the stage's fast motion along z a bead's own z shows.

Every bead has a look-up table of its own, whose slope at the present height need not be that of
the references' tables: on cmaddry-run2 (docs/real-recordings.md) tethered beads show 0.8 to 1.4
times a vibration of the stage, in phase, and the factor changes when the focus moves, while moves
of a micrometre are shown alike by all within 4 %. So the share is measured in stretches of time,
where bead and references move together, and holds for fast motion only.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm, t

from mtpipe.drift.grid import Grid
from mtpipe.drift.lowpass import coefficients, low_pass
from mtpipe.drift.noise import OWN_MOTION_HZ
from mtpipe.ground.types import FloatArray

# Length of a stretch (s), short against moves of the focus, and coefficients per cell of frequency:
# with 20, independent motions reach the coherence asked for in one of 10⁹ cells.
STRETCH_S = 10.0
CELL = 20
FEWEST_CELLS = 4
COHERENT = 0.9
# p-value below which the share is not 1: beyond doubt for every bead of a large recording.
DOUBT = 1e-6
# Allowed relative scatter of the share over frequencies: one slope of a table gives one share.
ALIKE = 0.05
ALIKE_P = 1e-4


@dataclass(frozen=True)
class FastShare:
    """What share of the stage's fast motion along z a bead shows, in stretches of time.

    Attributes
    ----------
    middle : (n_stretches,) place on the grid, increasing.
    share, stderr : (n_stretches,).
    """

    middle: FloatArray
    share: FloatArray
    stderr: FloatArray


def fast_share(
    bead_nm: FloatArray,
    stage_nm: FloatArray,
    noise_nm: float,
    grid: Grid,
    cutoff_hz: float | None,
) -> FastShare | None:
    """Share of the stage's motion above 0.5 Hz in a bead's z, where it is beyond doubt not 1.

    In cells of frequency in which bead and stage are coherent the true share lies between the
    regression of the bead on the stage, which noise of the references lowers, and the inverse of
    the reverse one, which the bead's own motion raises (Frisch 1934, Statistical Confluence
    Analysis). Only if 1 is outside both beyond the errors of all stretches together is there a
    share. It is the regression without the references' white noise.

    Parameters
    ----------
    bead_nm, stage_nm : (grid.size,) z of the bead and of the combined references, NaN where lost.
    noise_nm : white tracking noise of the combined references.
    cutoff_hz : what was faster is not subtracted, so that its share does not matter.

    Returns
    -------
    None where nothing moves both enough, or 1 is within the errors.
    """
    highest_hz = math.inf if cutoff_hz is None else cutoff_hz / 2
    found = [
        (middle, one)
        for middle, bead, stage in _stretches(bead_nm, stage_nm, grid)
        if (one := _stretch(bead, stage, noise_nm, grid.rate_hz, highest_hz)) is not None
    ]
    if not found:
        return None
    away = np.array([one.away for _, one in found])
    if chi2.sf(np.sum(away**2), len(away)) > DOUBT:
        return None
    return FastShare(
        np.array([middle for middle, _ in found]),
        np.array([one.share for _, one in found]),
        np.array([one.stderr for _, one in found]),
    )


def beyond_shared_nm(found: FastShare, drift_nm: FloatArray, grid: Grid) -> FloatArray:
    """What a bead shows of the drift beyond the drift itself: (share - 1) times its fast part.

    A share holds in its plateau, and between its stretches by interpolation; elsewhere it is 1.

    Parameters
    ----------
    drift_nm : (grid.size,) the drift along z that is subtracted from every bead.

    Returns
    -------
    (grid.size,) nm, NaN where the drift is.
    """
    beyond = np.zeros(grid.size)
    for start, stop in grid.pieces:
        here = (found.middle > start) & (found.middle < stop)
        if here.any():
            rows = np.arange(start, stop)
            beyond[rows] = np.interp(rows, found.middle[here], found.share[here]) - 1
    return np.asarray(beyond * (drift_nm - low_pass(drift_nm, grid.rate_hz, OWN_MOTION_HZ)))


@dataclass(frozen=True)
class _Stretch:
    """`away` is how far 1 is from the share, in standard deviations of a normal law."""

    share: float
    stderr: float
    away: float


def _stretches(
    bead_nm: FloatArray, stage_nm: FloatArray, grid: Grid
) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Middle of each stretch of the plateaus, and the coefficients of bead and stage in it."""
    known = np.isfinite(bead_nm) & np.isfinite(stage_nm)
    for start, stop in grid.known_pieces(known):
        number = max(1, round((stop - start) / (STRETCH_S * grid.rate_hz)))
        for a, b in itertools.pairwise(np.linspace(start, stop, number + 1).round().astype(int)):
            here = known[a:b]
            pair = [np.where(here, y[a:b], np.nan) for y in (bead_nm, stage_nm)]
            if here.sum() > 2:
                yield (a + b) / 2, coefficients(pair[0]), coefficients(pair[1])


def _stretch(
    bead: FloatArray, stage: FloatArray, noise_nm: float, rate_hz: float, highest_hz: float
) -> _Stretch | None:
    """The share in one stretch, from cosine coefficients (n,) nm; None where nothing is coherent
    or frequencies disagree."""
    first = max(1, math.ceil(OWN_MOTION_HZ * 2 * len(bead) / rate_hz))
    last = min(len(bead), int(min(highest_hz, rate_hz) * 2 * len(bead) / rate_hz))
    cells = (last - first) // CELL
    if cells < FEWEST_CELLS:
        return None
    x, r = (c[first : first + cells * CELL].reshape(cells, CELL) for c in (bead, stage))
    xx, rr, xr = (np.sum(p, axis=1) for p in (x * x, r * r, x * r))
    seen = rr > 2 * CELL * noise_nm**2
    together = seen & (xr > 0) & (xr**2 > COHERENT * xx * rr)
    xx, rr, xr = xx[together], rr[together], xr[together]
    if not len(xx):
        return None
    own = (xx - xr**2 / rr) / (CELL - 1)
    if not (own > 0).all():
        return None
    moved = rr - CELL * noise_nm**2
    weight = float(np.sum(moved / own))
    share = float(np.sum(xr / own)) / weight
    stderr = math.sqrt(float(np.sum(rr / own))) / weight
    each = xr / moved
    spread = own * rr / moved**2 + (share * (1 - xr**2 / (xx * rr))) ** 2 + (share * ALIKE) ** 2
    if chi2.sf(np.sum((each - share) ** 2 / spread), max(1, len(each) - 1)) < ALIKE_P:
        return None
    least = float(np.sum(xr / own) / np.sum(rr / own))
    most = float(np.sum(xx / own) / np.sum(xr / own))
    outside = max(least - 1, 1 - most, 0.0) / stderr
    away = norm.isf(t.sf(outside, len(own) * (CELL - 1)))
    return _Stretch(share, stderr, max(0.0, float(away)))
