"""Finding beads in the first frames of a stack.

A bead in bright field is a set of rings, so brightness changes along the radius and not around it.
With the gradient g of the image, T(c) = Σ w (g_r² − g_t²) about a centre c, radial less tangential,
is the generalised structure tensor for circles (Bigün, Bigun and Nilsson 2004, IEEE Trans. Pattern
Anal. 26, 1590): a convolution, whatever the focus and the number of rings. T over the whole energy
of the gradient is 1 at the centre of a bead and about 0 elsewhere. The mean image shows beads at
rest, the standard deviation over the frames those that move; both are searched together. magtrack
finds no beads, it takes regions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, signal, special

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.types import FloatArray
from mtpipe.tracking.measured import MIN_SIZE_PX

SMOOTHING_PX = 1.0
# Radii of the discs that are searched, pixels; each √2 times the last.
RADII_PX = tuple(5 * math.sqrt(2) ** k for k in range(9))
SYMMETRIC = 0.8  # T over all gradient energy in a bead's core; lone beads have 0.95 and more
ALONE = 0.85  # the same out to its last ring: what is left is another bead, or dirt
CORE = 0.6  # the part of a bead's radius within which a bead that touches another is symmetric
SIGNIFICANT = 8.0  # standard deviations of T in noise alone
FAINTEST = 0.1  # of the strongest bead's T
SMALLEST = 0.55  # of the usual radius: less is another kind of bead, or dirt
ENERGY_SHARE = 0.95
REGION_RADII = 1.5  # half a region, in radii of the bead: room to move


@dataclass(frozen=True)
class Region:
    """A square of pixels that is tracked: centre and side; `x_px`, `y_px` count from 0."""

    name: str
    x_px: float
    y_px: float
    size_px: int


@dataclass(frozen=True)
class Refused:
    """A bead that was seen and is not tracked, and why."""

    x_px: float
    y_px: float
    reason: str


@dataclass(frozen=True)
class FoundBeads:
    """Beads of a film in reading order, and what else was seen.

    `radius_px` is that of the outermost ring that counts, the same for all.
    `fainter` is the number of ring patterns that are much smaller or weaker than the beads.
    """

    regions: tuple[Region, ...]
    refused: tuple[Refused, ...]
    radius_px: float
    fainter: int


def find_beads(frames: FloatArray, *, size_px: int | None = None) -> FoundBeads:
    """Find the beads of a film.

    Parameters
    ----------
    frames : (n, height, width), the first frames, at least two. Those with pixels that are no
        numbers are left out.
    size_px : side of a region; default: 3 times the beads' radius, less at the border, which is
        enough to locate them (`mtpipe.tracking.region_sizes`).

    Raises
    ------
    RecordingError : no bead is there, or the frames are such that none can be found.
    """
    height, width = frames.shape[1:]
    if min(height, width) < MIN_SIZE_PX:
        raise RecordingError(
            f"the images have {width} x {height} pixels, and a bead takes {MIN_SIZE_PX} x "
            f"{MIN_SIZE_PX}"
        )
    finite = np.isfinite(frames).all(axis=(1, 2))
    if finite.sum() < 2:
        raise RecordingError(
            "pixels of the first frames are no numbers (NaN or infinite)",
            mend="Replace them, or save the camera's raw images.",
        )
    frames = frames[finite]
    seen = moments(frames)
    structure = _structure(seen.mean) + _structure(seen.motion)
    together = _beads_of(structure, seen.noise / math.sqrt(len(frames)), size_px)
    # beads that move by more than a ring's width are smeared in both, and clear in one frame
    alone = _beads_of(_structure(seen.first), seen.noise, size_px)
    found = max((together, alone), key=lambda f: -1 if f is None else len(f.regions))
    if found is None:
        raise RecordingError(
            "no bead was found: there is no pattern of rings that stands alone",
            mend="Give the beads as [[tracking.regions]] in the setup.",
        )
    return found


@dataclass(frozen=True, eq=False)
class Moments:
    """First frames in short: (height, width) each, and the noise of a pixel in one frame.

    `motion` is the standard deviation where it is significantly more than noise, else 0.
    """

    first: FloatArray
    mean: FloatArray
    motion: FloatArray
    noise: float


def moments(frames: FloatArray) -> Moments:
    """First frame, mean and motion of some frames, (n, height, width).

    Frames are divided by their own brightness, so that a flickering lamp is no motion. Noise is
    the lower quartile of the deviations: beads fill less than three quarters of the image.
    """
    n = len(frames)
    level = frames.mean(axis=(1, 2), keepdims=True, dtype=float)
    level[level == 0] = 1
    scaled = frames * (level.mean() / level)
    variance = scaled.var(axis=0, ddof=1)
    usual = float(np.quantile(variance, 0.25)) * (n - 1) / float(special.chdtri(n - 1, 0.75))
    by_chance = 3 * math.sqrt(2 / (n - 1))
    motion = np.sqrt(np.maximum(variance - usual * (1 + by_chance), 0))
    return Moments(scaled[0], scaled.mean(axis=0), motion, math.sqrt(usual))


def _beads_of(tensor: FloatArray, noise: float, size_px: int | None) -> FoundBeads | None:
    """Beads by the structure of an image, whose pixels have this noise; None if there is none."""
    # of a Gaussian's derivative, both components together
    noise_energy = noise**2 / (4 * math.pi * SMOOTHING_PX**4)
    radii = [r for r in RADII_PX if 2 * r < min(tensor.shape[1:])]
    best: tuple[float, float, FloatArray] | None = None
    for radius in radii:
        lone = _beads_among(_peaks(tensor, radius, noise_energy))
        worth = float(np.sum(lone[:, 2])) / radius
        if len(lone) and (best is None or worth > best[0]):
            best = (worth, radius, lone)
    if best is None:
        return None
    _, scale, lone = best
    own = [_bead_radius(tensor, x, y, 2 * scale) for x, y, *_ in lone]
    radius_px = float(np.median(own))  # the rings of a neighbour make some too large
    cores = _peaks(tensor, CORE * radius_px, noise_energy)
    if not len(_beads_among(cores)):
        return None
    _, share = _symmetry(tensor, radius_px, noise_energy)
    return _sorted_out(cores, share, tensor, radius_px, size_px)


def _structure(image: FloatArray) -> FloatArray:
    """(3, height, width): g_x² − g_y², 2 g_x g_y and g² of the smoothed image's gradient."""
    gx = ndimage.gaussian_filter(image, SMOOTHING_PX, order=(0, 1))
    gy = ndimage.gaussian_filter(image, SMOOTHING_PX, order=(1, 0))
    return np.stack([gx**2 - gy**2, 2 * gx * gy, gx**2 + gy**2])


def _kernels(radius: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """cos 2φ, sin 2φ and 1 in a disc with a soft edge, without its centre."""
    reach = math.ceil(1.3 * radius)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(float)
    r = np.hypot(x, y)
    weight = 1 / (1 + np.exp((r - radius) / (0.08 * radius)))
    weight[reach, reach] = 0
    phi = np.arctan2(y, x)
    return weight * np.cos(2 * phi), weight * np.sin(2 * phi), weight


def _symmetry(tensor: FloatArray, radius: float, noise: float) -> tuple[FloatArray, FloatArray]:
    """T at every pixel, and T over the energy of the gradient beyond noise."""
    even, odd, disc = _kernels(radius)

    def over(image: FloatArray, kernel: FloatArray) -> FloatArray:
        # all three kernels are their own mirror image: correlation is convolution
        return np.asarray(signal.fftconvolve(image, kernel, mode="same"))

    t = over(tensor[0], even) + over(tensor[1], odd)
    energy = over(tensor[2], disc) - noise * disc.sum()
    floor = noise * disc.sum() + 1e-9 * float(tensor[2].max()) + np.finfo(float).tiny
    return t, t / np.maximum(energy, np.maximum(np.abs(t), floor))


def _peaks(tensor: FloatArray, radius: float, noise: float) -> FloatArray:
    """(n, 4) x, y, T, share of the places where T is largest within a radius, and significant."""
    t, share = _symmetry(tensor, radius, noise)
    *_, disc = _kernels(radius)
    # variance of g_r² − g_t² is noise², and of a sum of them that times the pixels that the
    # smoothing makes alike, ∫ρ² = 2π s² for the gradient's autocorrelation ρ
    alike = 2 * math.pi * SMOOTHING_PX**2
    enough = SIGNIFICANT * noise * math.sqrt(alike * float((disc**2).sum()))
    highest = ndimage.maximum_filter(t, size=2 * round(radius) + 1) == t
    ys, xs = np.nonzero(highest & (t > max(enough, 1e-9 * float(t.max()))))
    found: FloatArray = np.column_stack([xs, ys, t[ys, xs], share[ys, xs]]).astype(np.float64)
    return found


def _beads_among(peaks: FloatArray) -> FloatArray:
    """Peaks that are symmetric and not much fainter than the strongest of all."""
    if not len(peaks):
        return peaks
    is_bead = (peaks[:, 3] >= SYMMETRIC) & (peaks[:, 2] >= FAINTEST * float(peaks[:, 2].max()))
    return np.asarray(peaks[is_bead], dtype=np.float64)


def _bead_radius(tensor: FloatArray, x: float, y: float, reach: float) -> float:
    """Radius that holds 95 % of what T is made of, about one centre, out to `reach`."""
    top, left = max(0, round(y - reach)), max(0, round(x - reach))
    piece = tensor[:, top : round(y + reach) + 1, left : round(x + reach) + 1]
    rows, columns = np.mgrid[top : top + piece.shape[1], left : left + piece.shape[2]]
    dx, dy = columns - x, rows - y
    r, phi = np.hypot(dx, dy), np.arctan2(dy, dx)
    radial = piece[0] * np.cos(2 * phi) + piece[1] * np.sin(2 * phi)
    within = (r <= reach) & (r > 0)
    by_radius = np.bincount(np.rint(r[within]).astype(int), weights=radial[within])
    grown = np.cumsum(np.maximum(by_radius, 0))
    return float(np.searchsorted(grown, ENERGY_SHARE * grown[-1]))


def _sorted_out(
    cores: FloatArray,
    share: FloatArray,
    tensor: FloatArray,
    radius: float,
    size_px: int | None,
) -> FoundBeads:
    """Which of the centres are beads alone, which are refused and why."""
    height, width = share.shape
    symmetric = cores[cores[:, 3] >= SYMMETRIC]
    own = np.array([_bead_radius(tensor, x, y, radius) for x, y, *_ in symmetric])
    is_bead = (symmetric[:, 2] >= FAINTEST * cores[:, 2].max()) & (own >= SMALLEST * radius)
    places = symmetric[is_bead, :2]
    sizes: dict[tuple[float, float], int] = {}
    refused: list[Refused] = []
    for x, y in places.tolist():
        distance = np.hypot(*(places - (x, y)).T)
        distance[distance == 0] = np.inf
        border = int(min(x, y, width - 1 - x, height - 1 - y))
        if border < (max(radius, MIN_SIZE_PX // 2) if size_px is None else size_px // 2):
            refused.append(Refused(x, y, "is cut by the border of the image"))
        elif distance.min() < 2 * radius:
            other = places[np.argmin(distance)]
            reason = f"overlaps with the bead at x = {other[0]:.0f}, y = {other[1]:.0f}"
            refused.append(Refused(x, y, reason))
        elif share[int(y), int(x)] < ALONE:
            reason = "is not round: it overlaps with another pattern, or is in focus"
            refused.append(Refused(x, y, reason))
        else:
            roomy = 2 * math.ceil(REGION_RADII * radius) + 1
            sizes[x, y] = size_px or min(roomy, 2 * border + 1)
    named = tuple(
        Region(f"bead{k + 1}", *place, sizes[place])
        for k, place in enumerate(in_reading_order(list(sizes), radius))
    )
    return FoundBeads(named, tuple(refused), radius, len(symmetric) - len(places))


def in_reading_order(places: list[tuple[float, float]], line: float) -> list[tuple[float, float]]:
    """Places (x, y) line by line from the top and in each line from the left.

    A line begins with the highest place left and takes those less than `line` below it.
    """
    left = sorted(places, key=lambda place: place[1])
    ordered: list[tuple[float, float]] = []
    while left:
        below = left[0][1] + line
        this = [place for place in left if place[1] < below]
        ordered += sorted(this)
        left = left[len(this) :]
    return ordered
