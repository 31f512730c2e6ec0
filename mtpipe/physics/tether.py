"""A double-stranded DNA tether as a worm-like chain: force, extension, stiffness, mean extension.

Two relations between force and extension, which differ by about kT/F, are kept apart:

- the *curve* of the chain, F(L) (`force_pN`, `extension_nm`, `stiffness_pN_per_nm`): the formulas
  of the literature, for the mean extension of a very long chain at a constant force;
- the *mean height* of the tether's end over a surface (`mean_extension_nm`), where the chain is a
  potential A(r) with dA/dr = F(r) about its anchor, as in the baseline experiment of mtpipe. For
  forces above kT/Lp it lies below the curve by 7 kT/(4 F): kT/F because the end swings sideways at
  constant r, 3 kT/(4 F) because the chain is softer when shorter. 7 nm at 1 pN, for any contour.

Everything is vectorised over forces or extensions. Inside, y is the extension per contour length
of the chain without enthalpic stretching, in (-1, 1), and g(y) = F Lp/kT. All curves are odd.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import exprel

from mtpipe.ground.types import FloatArray
from mtpipe.physics.buffer import thermal_energy_pN_nm

Formula = Literal["marko-siggia", "bouchiat", "extensible", "extensible-marko-siggia"]


@dataclass(frozen=True)
class Validity:
    """Where a formula describes double-stranded DNA to about 1 % in extension, and why there."""

    force_range_pN: tuple[float, float]
    reason: str


VALIDITY: dict[Formula, Validity] = {
    "marko-siggia": Validity(
        (0.5, 10.0),
        "the interpolation is 1 % short of the exact worm-like chain at 0.5 pN and 7 % at 0.1 pN "
        "(Bouchiat et al. 1999); a stretch modulus of 1000 pN lengthens DNA by 1 % at 10 pN",
    ),
    "bouchiat": Validity(
        (0.0, 10.0),
        "within 0.01 % of the exact worm-like chain (Bouchiat et al. 1999); a stretch modulus of "
        "1000 pN lengthens DNA by 1 % at 10 pN (Wang et al. 1997)",
    ),
    "extensible": Validity(
        (0.0, 40.0),
        "linear stretching holds up to about 40 pN (Wang et al. 1997); above that, twist matters, "
        "and DNA overstretches at 65 pN",
    ),
    "extensible-marko-siggia": Validity(
        (0.5, 40.0),
        "as Marko and Siggia's below 10 pN; linear stretching holds up to about 40 pN (Wang et al. "
        "1997)",
    ),
}

# The formulas of chains that do not stretch, and of those that do.
STRETCHING: dict[Formula, Formula] = {
    "marko-siggia": "extensible-marko-siggia",
    "bouchiat": "extensible",
}

# Bouchiat et al. 1999, a_1 to a_7: what the exact chain adds to Marko and Siggia's interpolation.
_BOUCHIAT = (1.0, -0.5164228, -2.737418, 16.07497, -38.87607, 39.49944, -14.17718)
_MARKO_SIGGIA = (1.0,)

_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(80)


@dataclass(frozen=True)
class Chain:
    """A worm-like chain.

    Attributes
    ----------
    formula : "marko-siggia" (Marko & Siggia 1995, their eq 7), "bouchiat" (Bouchiat et al. 1999),
        "extensible": Bouchiat's with L/L0 - F/K0 in place of L/L0 (Wang et al. 1997), or
        "extensible-marko-siggia": the same of Marko and Siggia's.
    stretch_modulus_pN : K0; given if and only if the formula is an extensible one.
    """

    contour_length_nm: float
    persistence_length_nm: float
    temperature_K: float
    formula: Formula = "bouchiat"
    stretch_modulus_pN: float | None = None

    def __post_init__(self) -> None:
        for name in ("contour_length_nm", "persistence_length_nm", "temperature_K"):
            value = getattr(self, name)
            if not (value > 0 and np.isfinite(value)):
                raise ValueError(f"{name} = {value}: must be positive")
        if self.formula not in VALIDITY:
            raise ValueError(f"formula {self.formula!r}: one of {', '.join(VALIDITY)} is needed")
        if self.formula.startswith("extensible") != (self.stretch_modulus_pN is not None):
            raise ValueError("an extensible chain, and no other, needs a stretch modulus")
        if self.stretch_modulus_pN is not None and not self.stretch_modulus_pN > 0:
            raise ValueError(f"stretch_modulus_pN = {self.stretch_modulus_pN}: must be positive")

    @property
    def formula_without_stretching(self) -> Formula:
        """What its formula is for a chain that does not stretch."""
        stiff = (stiff for stiff, soft in STRETCHING.items() if soft == self.formula)
        return next(stiff, self.formula)

    @property
    def thermal_force_pN(self) -> float:
        """The force scale kT/Lp, 0.08 pN for DNA."""
        return float(thermal_energy_pN_nm(self.temperature_K)) / self.persistence_length_nm

    @property
    def compliance(self) -> float:
        """Stretch per contour length at the force kT/Lp; 0 for an inextensible chain."""
        if self.stretch_modulus_pN is None:
            return 0.0
        return self.thermal_force_pN / self.stretch_modulus_pN


def with_formula(chain: Chain, formula: Formula) -> Chain:
    """The chain by another formula; one that stretches does so still.

    Parameters
    ----------
    formula : of a chain that does not stretch.
    """
    stretches = chain.stretch_modulus_pN is not None
    return replace(chain, formula=STRETCHING[formula] if stretches else formula)


def force_pN(chain: Chain, extension_nm: ArrayLike) -> FloatArray:
    """Force of the chain at an extension; infinite at and beyond an inextensible contour length.

    Parameters
    ----------
    extension_nm : any shape; negative extensions give negative forces.
    """
    y = _backbone(chain, extension_nm)
    return np.sign(y) * chain.thermal_force_pN * _reduced_force(chain, np.abs(y))


def extension_nm(chain: Chain, force_pN: ArrayLike) -> FloatArray:
    """Extension at a force: the inverse of `force_pN`, to 1e-12 relative."""
    reduced = np.asarray(force_pN, dtype=np.float64) / chain.thermal_force_pN
    y = _solve(chain, np.abs(reduced), linear=0.0, weight=1.0)
    return chain.contour_length_nm * (np.sign(reduced) * y + chain.compliance * reduced)


def stiffness_pN_per_nm(chain: Chain, extension_nm: ArrayLike) -> FloatArray:
    """Axial stiffness dF/dL at an extension; infinite where the force is."""
    y = np.abs(_backbone(chain, extension_nm))
    with np.errstate(divide="ignore"):
        softness = 1 / _reduced_slope(chain, y) + chain.compliance
        return chain.thermal_force_pN / chain.contour_length_nm / softness


@dataclass(frozen=True, eq=False)
class Moments:
    """A chain under a constant force, the chain being a potential A(r); any shape.

    The distance of the ends is what fluctuates with the chain's own stiffness; the height is
    shorter by what the end swings sideways. The distance's variance is above kT over the slope of
    the formula, by 1.3 % for a contour of 2700 nm at 1 pN and 2.9 % for 1200 nm.

    Attributes
    ----------
    extension_nm : of the chain's curve, as `extension_nm` has it.
    height_nm : mean height of the end, as `mean_extension_nm` has it.
    height_variance_nm2 : of the end's height; over kT the slope of the mean height with the force.
    variance_nm2, skewness : of the end-to-end distance, exact averages like that of the height.
    """

    extension_nm: FloatArray
    height_nm: FloatArray
    height_variance_nm2: FloatArray
    variance_nm2: FloatArray
    skewness: FloatArray


def moments(chain: Chain, force_pN: ArrayLike) -> Moments:
    """A chain's extension, height and distance under a constant force, in one pass.

    Parameters
    ----------
    force_pN : any shape, at least 0.

    Raises
    ------
    ValueError : a force is negative.
    """
    curve, r, weight, pull = _distances(chain, force_pN)
    cosine, square_cosine = _mean_cosines(pull)
    height = np.sum(weight * r * cosine, axis=-1)
    away = r**2 * square_cosine - 2 * height[..., None] * r * cosine
    deviation = r - np.sum(weight * r, axis=-1, keepdims=True)
    variance = np.sum(weight * deviation**2, axis=-1)
    skewness = np.sum(weight * deviation**3, axis=-1) / variance**1.5
    length = chain.contour_length_nm
    return Moments(
        np.asarray(length * curve),
        np.asarray(length * height),
        np.asarray(length**2 * (height**2 + np.sum(weight * away, axis=-1))),
        np.asarray(length**2 * variance),
        np.asarray(skewness),
    )


def mean_extension_nm(chain: Chain, force_pN: ArrayLike) -> FloatArray:
    """Mean height of the tether's end under a constant force, the chain being a potential A(r).

    The exact average of z over exp(-(A(r) - F z)/kT) in the half space z > 0 above the surface to
    which the tether is anchored, by quadrature (1e-9 relative). Includes the sideways swing, the
    skewness of A and the exclusion by the surface of the tether's end, not that of the bead.

    Parameters
    ----------
    force_pN : any shape, at least 0; at 0 the mean is that of a chain left to itself.

    Raises
    ------
    ValueError : a force is negative.
    """
    return moments(chain, force_pN).height_nm


def log_distance_density(chain: Chain, force_pN: ArrayLike, distance_nm: ArrayLike) -> FloatArray:
    """ln of the density of the end-to-end distance r under a constant force, up to a constant.

    r² e^−A(r)/kT sinh(F r/kT)/(F r/kT), the directions of the half space above the anchor
    integrated out.

    Parameters
    ----------
    distance_nm : above 0 and, for an inextensible chain, below the contour length; any shape that
        goes with that of the force.
    """
    y = _backbone(chain, distance_nm)
    r = np.asarray(distance_nm, dtype=np.float64) / chain.contour_length_nm
    units = chain.contour_length_nm / chain.persistence_length_nm
    pull = units * np.asarray(force_pN, dtype=np.float64) / chain.thermal_force_pN * r
    g = _reduced_force(chain, y)
    work = units * (_reduced_work(chain, y) + chain.compliance * g**2 / 2)
    return np.asarray(2 * np.log(r) + np.log(exprel(-pull)) + pull - work)


def _distances(
    chain: Chain, force_pN: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Extension of the curve over the contour length; nodes of the distance over it, their weights
    (sum 1), and F r/kT there.
    """
    force = np.asarray(force_pN, dtype=np.float64)
    if np.any(force < 0):
        raise ValueError(f"force_pN = {force.min():g}: must not be negative")
    reduced = force[..., None] / chain.thermal_force_pN
    units = chain.contour_length_nm / chain.persistence_length_nm
    c = chain.compliance

    # Gauss-Legendre nodes over the peak of the weight, which is at g(y) = F Lp/kT.
    peak = _solve(chain, reduced, linear=0.0, weight=1.0)
    slope = _reduced_slope(chain, peak)
    width = 1 / np.sqrt(units * slope * (1 + c * slope))
    low, high = np.maximum(peak - 14 * width, 0.0), np.minimum(peak + 10 * width, 1.0)
    y = low + (high - low) * (_NODES + 1) / 2

    g = _reduced_force(chain, y)
    r = y + c * g
    pull = units * reduced * r
    log_weight = pull - units * (_reduced_work(chain, y) + c * g**2 / 2)
    # Over the half sphere e^(pull cos) integrates to e^pull (1 - e^-pull)/pull.
    density = r**2 * (1 + c * _reduced_slope(chain, y)) * exprel(-pull)
    weight = _NODE_WEIGHTS * density * np.exp(log_weight - log_weight.max(axis=-1, keepdims=True))
    curve = (peak + c * reduced)[..., 0]
    return curve, r, weight / np.sum(weight, axis=-1, keepdims=True), pull


def _mean_cosines(pull: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means of cos and cos² over the half sphere with weight e^(pull cos): 1/2 and 1/3 at 0."""
    large = np.maximum(pull, 1e-2)
    edge = -1 / np.expm1(-large)
    far = edge - 1 / large
    mean = np.where(pull > 1e-2, far, 0.5 + pull / 12 - pull**3 / 720)
    square = np.where(pull > 1e-2, edge - 2 * far / large, 1 / 3 + pull / 12 + pull**2 / 360)
    return mean, square


def _backbone(chain: Chain, extension_nm: ArrayLike) -> FloatArray:
    """The y at an extension, in [-1, 1]: solves y + c g(y) = L/L0."""
    x = np.asarray(extension_nm, dtype=np.float64) / chain.contour_length_nm
    if chain.compliance == 0:
        return np.clip(x, -1.0, 1.0)
    return np.sign(x) * _solve(chain, np.abs(x), linear=1.0, weight=chain.compliance)


def _solve(chain: Chain, target: FloatArray, *, linear: float, weight: float) -> FloatArray:
    """Solve linear y + weight g(y) = target >= 0 for y in [0, 1): Newton inside a bracket.

    The left side rises steadily, so a step that leaves the bracket is replaced by bisection.
    """
    low, high = np.zeros_like(target), np.ones_like(target)
    y = 1 - 0.5 / np.sqrt(target / weight + 0.25)
    if linear:
        y = np.minimum(y, target / linear)
    for _ in range(200):
        excess = linear * y + weight * _reduced_force(chain, y) - target
        high, low = np.where(excess > 0, y, high), np.where(excess > 0, low, y)
        step = y - excess / (linear + weight * _reduced_slope(chain, y))
        following = np.where((step >= low) & (step <= high), step, (low + high) / 2)
        if np.all(np.abs(following - y) <= 1e-15 * following):
            break
        y = following
    return following


def _terms(chain: Chain) -> tuple[float, ...]:
    return _MARKO_SIGGIA if chain.formula.endswith("marko-siggia") else _BOUCHIAT


def _reduced_force(chain: Chain, y: FloatArray) -> FloatArray:
    """The force g(y) = F Lp/kT, y in [0, 1]; infinite at 1."""
    with np.errstate(divide="ignore"):
        return np.asarray(0.25 * y * (2 - y) / (1 - y) ** 2 + y * _horner(_terms(chain), y))


def _reduced_slope(chain: Chain, y: FloatArray) -> FloatArray:
    """The slope dg/dy."""
    terms = [n * a for n, a in enumerate(_terms(chain), 1)]
    with np.errstate(divide="ignore"):
        return np.asarray(0.5 / (1 - y) ** 3 + _horner(terms, y))


def _reduced_work(chain: Chain, y: FloatArray) -> FloatArray:
    """The work, integral of g from 0 to y; y < 1."""
    terms = [a / (n + 1) for n, a in enumerate(_terms(chain), 1)]
    return np.asarray(0.25 * y**2 / (1 - y) + y**2 * _horner(terms, y))


def _horner(coefficients: Sequence[float], y: FloatArray) -> FloatArray:
    """Polynomial, the constant first; numpy's own classes cost ten times as much for scalars."""
    total = np.zeros_like(y)
    for a in reversed(coefficients):
        total = total * y + a
    return total
