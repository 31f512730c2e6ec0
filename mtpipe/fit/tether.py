"""Fit of one worm-like chain to one bead's forces and mean extensions, both with errors.

The true force of every point is profiled out (`mtpipe.fit.errors_in_both`), which leaves lmfit's
least squares one residual per point, and one per shape of the stage's motion where that is in the
extensions. Errors of forces are taken as relative: a force comes from a
stiffness whose logarithm is what is Gaussian. Parameters are fitted as logarithms and the stretch
modulus as its inverse, which is what the data determine linearly; intervals are symmetric there and
not in the value.

Which height of a tether belongs to a force is a choice (`Relation`):

- "potential" (default): the chain is a potential about its anchor, as in mtpipe's baseline
  experiment, so contour and persistence length mean what they mean in a setup. About 7 kT/(4F)
  below the formula, 7 nm at 1 pN (`mtpipe.physics.tether`).
- "long-chain": the formula itself, the mean height of an infinitely long chain, as the literature
  fits it. For strong forces a real chain of finite length lies kT/(2F) below it when its ends turn
  freely and kT/(2F) above when they are clamped along the force (from the partition function
  1/(omega sinh(omega L0)) or omega/sinh(omega L0), omega² = F/(kT Lp); end effects measured by Seol
  et al. 2007, Biophys J 93:4360). How the ends of DNA are held on a bead is seldom known.

Real DNA so lies between the two. Read as "long-chain" the persistence length comes out 4 % lower
for a contour of 2700 nm and 10 % for 1200 nm; `ForceExtension.other_relation` says what it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

from mtpipe.fit.curve_distances import curve_distances
from mtpipe.fit.points import Assay, ExtensionPoints, Relation
from mtpipe.ground.errors import FitError
from mtpipe.ground.estimate import Estimate, Status
from mtpipe.ground.types import FloatArray
from mtpipe.ground.written_numbers import number
from mtpipe.physics import tether
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.tether import Chain, Formula

_LARGEST_RELATIVE_ERROR = 0.5
_LEAST_COMPLIANCE_PER_PN = 1e-9
_STAGE = "stage_"


@dataclass(frozen=True, repr=False)
class TetherFit:
    """A chain fitted to the points of one bead.

    Attributes
    ----------
    force_range_pN : lowest and highest measured force that was fitted.
    stretch_modulus_pN : None for inextensible chains; "not_identified" with a lower limit where
        the data do not tell it from infinity by two standard errors.
    offset_nm : what has to be added to the extensions; None where the zero of z is exact.
    correlation : the most strongly correlated pair of parameters, and its coefficient.
    residuals : (points,) signed distances from the curve in standard errors.
    chi2, dof, p_value : of the residuals; a small p-value says that the errors are understated or
        the model is wrong.
    """

    model: Formula
    relation: Relation
    contour_length_nm: Estimate
    persistence_length_nm: Estimate
    stretch_modulus_pN: Estimate | None
    offset_nm: Estimate | None
    force_range_pN: tuple[float, float]
    points: int
    residuals: FloatArray
    chi2: float
    dof: int
    p_value: float
    correlation: tuple[str, str, float] | None
    chain: Chain

    def __repr__(self) -> str:
        told = [f"contour length {self.contour_length_nm}"]
        told.append(f"persistence length {self.persistence_length_nm}")
        if self.stretch_modulus_pN is not None:
            told.append(f"stretch modulus {self.stretch_modulus_pN}")
        return f"{self.model} chain: {', '.join(told)}; p = {number(self.p_value, 2)}"

    @property
    def identified(self) -> bool:
        """Whether contour and persistence length are determined."""
        return self.contour_length_nm.status == self.persistence_length_nm.status == "ok"

    @property
    def bic(self) -> float:
        """Bayesian information criterion; comparable between fits of the same points."""
        return self.chi2 + (self.points - self.dof) * math.log(self.points)


def expected_extension_nm(chain: Chain, force_pN: ArrayLike, assay: Assay) -> FloatArray:
    """Mean extension that the assay shows for a chain at true forces (any shape, positive)."""
    force = np.asarray(force_pN, dtype=np.float64)
    if assay.relation == "potential":
        height = tether.mean_extension_nm(chain, force)
    else:
        height = tether.extension_nm(chain, force)
    if assay.bead_turns:
        height = height - thermal_energy_pN_nm(assay.temperature_K) / (2 * force)
    return height


def parameters_of(formula: Formula, assay: Assay) -> int:
    """How many parameters the points alone must determine; a fit takes one point more."""
    return 2 + (formula == "extensible") + math.isinf(assay.zero_stderr_nm)


def fit_tether(points: ExtensionPoints, formula: Formula, assay: Assay) -> TetherFit:
    """Fit a chain to all the points given.

    Returns
    -------
    TetherFit; its estimates are "not_identified" where the fit does not determine them, for
    instance because all forces are alike.

    Raises
    ------
    FitError : a point is not usable, or there are no more points than parameters.
    """
    import lmfit

    if not np.all(points.usable()):
        raise FitError("a force or an extension, or the error of one, is not a positive number")
    if len(points) <= parameters_of(formula, assay):
        raise FitError(
            f"{len(points)} forces do not determine {parameters_of(formula, assay)} parameters"
        )
    contour, persistence = _start(points, assay)
    start = lmfit.Parameters()
    start.add("ln_contour", math.log(contour), min=0.0, max=math.log(1e6))
    start.add("ln_persistence", math.log(persistence), min=math.log(0.05), max=math.log(1e5))
    if formula == "extensible":
        start.add("compliance", 1e-3)
    if assay.zero_stderr_nm > 0:
        start.add("offset", 0.0)
    shapes_nm = points.stage_shapes_nm
    for i in range(shapes_nm.shape[1]):
        start.add(f"{_STAGE}{i}", 0.0)
    result: Any = lmfit.minimize(
        _residuals,
        start,
        args=(points, formula, assay, shapes_nm),
        scale_covar=False,
        max_nfev=500 * (1 + shapes_nm.shape[1]),
    )
    return _collect(result, points, formula, assay)


def _start(points: ExtensionPoints, assay: Assay) -> tuple[float, float]:
    """Contour and persistence length from L = L0 (1 - sqrt(kT/(4 F Lp))), true above 0.3 pN."""
    root = 1 / np.sqrt(points.force_pN)
    highest = points.extension_nm.max()
    if np.ptp(root) > 0:
        slope, contour = np.polyfit(root, points.extension_nm, 1)
        if slope < 0 and highest < contour < 2 * highest:
            kT = float(thermal_energy_pN_nm(assay.temperature_K))
            return float(contour), float(np.clip(kT * (contour / slope) ** 2 / 4, 5.0, 500.0))
    return 1.1 * float(highest), 50.0


def _chain(
    values: Mapping[str, float], formula: Formula, temperature_K: float, compliance: float | None
) -> Chain:
    contour, persistence = math.exp(values["ln_contour"]), math.exp(values["ln_persistence"])
    if compliance is None:
        return Chain(contour, persistence, temperature_K, formula)
    modulus = 1 / max(compliance, _LEAST_COMPLIANCE_PER_PN)
    return Chain(contour, persistence, temperature_K, formula, modulus)


def _heights(
    values: Mapping[str, float], force_pN: FloatArray, formula: Formula, assay: Assay
) -> FloatArray:
    """Expected extensions; a negative compliance shortens as much as a positive one lengthens.

    Noise may ask for one. Mirrored so, the fit has no limit to run into, and its standard error
    holds on either side of zero.
    """
    compliance = values.get("compliance")
    if compliance is None or compliance >= 0:
        chain = _chain(values, formula, assay.temperature_K, compliance)
        return expected_extension_nm(chain, force_pN, assay)
    rigid, soft = (_chain(values, formula, assay.temperature_K, c) for c in (0.0, -compliance))
    rigid_height = expected_extension_nm(rigid, force_pN, assay)
    return 2 * rigid_height - expected_extension_nm(soft, force_pN, assay)


def _residuals(
    parameters: Any,
    points: ExtensionPoints,
    formula: Formula,
    assay: Assay,
    shapes_nm: FloatArray,
) -> FloatArray:
    """Signed distances of the points from the curve, in standard errors; those of the stage's
    motion and of the offset last.

    Heights that may be off together are fitted as what they are off by, in shapes of unit variance:
    the least squares then are those of the whole covariance, and forces move with their levers.
    """
    values = parameters.valuesdict()
    zero = values.get("offset", 0.0)
    stage = np.array([values[f"{_STAGE}{i}"] for i in range(shapes_nm.shape[1])])
    distances = curve_distances(
        points,
        lambda force_pN: _heights(values, force_pN, formula, assay),
        zero + shapes_nm @ stage,
    )
    known = 0 < assay.zero_stderr_nm < math.inf
    return np.concatenate([distances, stage, [zero / assay.zero_stderr_nm] if known else []])


def _collect(result: Any, points: ExtensionPoints, formula: Formula, assay: Assay) -> TetherFit:
    values = result.params.valuesdict()
    dof = len(points) - parameters_of(formula, assay)
    chi2 = float(result.chisqr)
    done: Status = "ok" if result.success else "not_converged"
    method = f"{formula} chain, {assay.relation} relation, errors in both"
    error = {
        name: float(p.stderr) if result.errorbars and p.stderr is not None else math.inf
        for name, p in result.params.items()
    }
    return TetherFit(
        model=formula,
        relation=assay.relation,
        contour_length_nm=_exponential(
            values["ln_contour"], error["ln_contour"], "nm", method, done
        ),
        persistence_length_nm=_exponential(
            values["ln_persistence"], error["ln_persistence"], "nm", method, done
        ),
        stretch_modulus_pN=(
            _inverse(values["compliance"], error["compliance"], "pN", method, done)
            if formula == "extensible"
            else None
        ),
        offset_nm=(
            _linear(values["offset"], error["offset"], "nm", method, done)
            if assay.zero_stderr_nm > 0
            else None
        ),
        force_range_pN=(float(points.force_pN.min()), float(points.force_pN.max())),
        points=len(points),
        residuals=np.asarray(result.residual[: len(points)], dtype=np.float64),
        chi2=chi2,
        dof=dof,
        p_value=float(chdtrc(dof, chi2)),
        correlation=_strongest(result),
        chain=_chain(values, formula, assay.temperature_K, values.get("compliance")),
    )


def _exponential(mean: float, error: float, unit: str, method: str, status: Status) -> Estimate:
    """The estimate of exp(x); not identified when its relative error exceeds one half."""
    if not error < _LARGEST_RELATIVE_ERROR:
        return Estimate.missing(unit, method)
    value = math.exp(mean)
    interval = (math.exp(mean - error), math.exp(mean + error))
    return Estimate(value, value * error, interval, unit, method, status)


def _inverse(mean: float, error: float, unit: str, method: str, status: Status) -> Estimate:
    """The estimate of 1/x; only a lower limit when x is within two standard errors of zero."""
    if not math.isfinite(error):
        return Estimate.missing(unit, method)
    if not mean > 2 * error:
        limit = 1 / (max(mean, 0.0) + error)
        return Estimate(math.nan, math.nan, (limit, math.inf), unit, method, "not_identified")
    interval = (1 / (mean + error), 1 / (mean - error))
    return Estimate(1 / mean, error / mean**2, interval, unit, method, status)


def _linear(mean: float, error: float, unit: str, method: str, status: Status) -> Estimate:
    if not math.isfinite(error):
        return Estimate.missing(unit, method)
    return Estimate(mean, error, (mean - error, mean + error), unit, method, status)


def _strongest(result: Any) -> tuple[str, str, float] | None:
    """The pair of the tether's parameters with the largest correlation in magnitude."""
    names, covariance = result.var_names, getattr(result, "covar", None)
    if covariance is None:
        return None
    tether = [i for i, name in enumerate(names) if not name.startswith(_STAGE)]
    names, covariance = [names[i] for i in tether], covariance[np.ix_(tether, tether)]
    scale = np.sqrt(np.diag(covariance))
    correlation = np.triu(covariance / np.outer(scale, scale), 1)
    i, j = np.unravel_index(np.argmax(np.abs(correlation)), correlation.shape)
    return names[i], names[j], float(correlation[i, j])
