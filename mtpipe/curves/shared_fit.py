"""Curves of several beads fitted together by a model that a user composed.

Which points are fitted follows the rules of `extension_curve`: those with a force and an extension,
above the force at which the surface disturbs the bead, within the forces for which the model holds,
and not more than five standard errors off the curve of the others. Between models the one with
fewer parameters is chosen, unless BIC is lower by more than 6 over the same points.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy.special import chdtrc

from mtpipe.curves.chain_models import name_of, valid_for
from mtpipe.curves.extension_curve import (
    DECISIVE_BIC,
    OUTLIER_SIGMAS,
    POOR_P_VALUE,
    ForceExtension,
)
from mtpipe.fit.curve_distances import curve_distances
from mtpipe.fit.points import ExtensionPoints
from mtpipe.ground.errors import FitError, MtpipeError
from mtpipe.ground.estimate import Estimate, Status
from mtpipe.ground.shown import Shown
from mtpipe.ground.types import FloatArray
from mtpipe.ground.written_numbers import number
from mtpipe.physics.buffer import thermal_energy_pN_nm

if TYPE_CHECKING:
    import lmfit

METHOD = "curves together, errors in both"
OFFSET = "offset_nm"
# Relative standard error from which a parameter counts as not identified.
LARGEST_RELATIVE_ERROR = 0.5
# Start of a contour length that has none, over the largest extension.
ABOVE_LARGEST = 1.1


@dataclass(frozen=True, repr=False)
class SharedFit(Shown):
    """A model fitted to the curves of several beads.

    Attributes
    ----------
    shared : estimates of what the beads have in common, by the model's names. own : of the rest,
        by bead.
    points : those that were fitted, by bead.
    sentence : what was fitted, over which forces, and why not the others.
    bic : comparable between fits of the same points.
    result : lmfit's own.
    """

    model: lmfit.Model
    shared: Mapping[str, Estimate]
    own: Mapping[str, Mapping[str, Estimate]]
    points: Mapping[str, ExtensionPoints]
    curves: Mapping[str, ForceExtension]
    sentence: str
    chi2: float
    dof: int
    bic: float
    result: Any

    @property
    def p_value(self) -> float:
        """Chance of a fit that is as bad, were the model true."""
        return float(chdtrc(self.dof, self.chi2))

    def __repr__(self) -> str:
        told = [f"{name.removesuffix(f'_{one.unit}')} {one}" for name, one in self.shared.items()]
        beads = f"{len(self.points)} bead{'s' * (len(self.points) != 1)}"
        head = f"SharedFit of {beads}: {name_of(self.model)}; p = {number(self.p_value, 2)}"
        return "; ".join([head, *told])

    @property
    def table(self) -> pd.DataFrame:
        """A row per parameter: bead ("all" for what is shared), value, stderr, unit, status."""
        found = [("all", name, one) for name, one in self.shared.items()]
        found += [(bead, name, one) for bead, own in self.own.items() for name, one in own.items()]
        return pd.DataFrame(
            [
                {
                    "bead": bead,
                    "parameter": name,
                    "value": one.value,
                    "stderr": one.stderr,
                    "unit": one.unit,
                    "status": one.status,
                }
                for bead, name, one in found
            ]
        )

    def extension_nm(self, bead: str, force_pN: FloatArray) -> FloatArray:
        """Measured mean extension (n,) that the fit expects of a bead at true forces (n,)."""
        values = {name: one.value for name, one in {**self.shared, **self.own[bead]}.items()}
        height = _height_nm(self.model, values, self.curves[bead], force_pN)
        return np.asarray(height - values.get(OFFSET, 0.0))


def fit_together(
    model: lmfit.Model, curves: Mapping[str, ForceExtension], *, shared: Sequence[str] = ()
) -> SharedFit:
    """Fit a model to the curves of one or several beads.

    Parameters
    ----------
    model : of `mtpipe.curves.chain_models`, or composed of those.
    curves : by bead, as of `mtpipe.force_extension`.
    shared : names of parameters that all beads have in common; the others are each bead's own.

    Raises
    ------
    MtpipeError : no parameter of a name; z = 0 of a bead is uncertain, and the model has no offset.
    FitError : there are no more points than parameters.
    """
    _check(model, curves, shared)
    low, high = valid_for(model).force_range_pN
    usable = {bead: one.points.select(one.points.usable()) for bead, one in curves.items()}
    far = {
        bead: one.select(one.force_pN >= curves[bead].surface_force_pN)
        for bead, one in usable.items()
    }
    valid = {
        bead: one.select((one.force_pN >= low) & (one.force_pN <= high))
        for bead, one in far.items()
    }
    kept, total = dict(valid), sum(len(one) for one in valid.values())
    result, residuals = _fit(model, kept, curves, shared)
    for _ in range(total // 4):
        worst = max(residuals, key=lambda bead: float(np.abs(residuals[bead]).max(initial=0)))
        place = int(np.argmax(np.abs(residuals[worst])))
        bad = float(chdtrc(max(result.nfree, 1), result.chisqr)) < POOR_P_VALUE
        if not bad or abs(residuals[worst][place]) < OUTLIER_SIGMAS:
            break
        kept[worst] = kept[worst].select(np.arange(len(kept[worst])) != place)
        result, residuals = _fit(model, kept, curves, shared)
    counts = [sum(len(one) for one in points.values()) for points in (usable, far, valid, kept)]
    return SharedFit(
        model=model,
        shared={name: _estimate(result, f"all_{name}", name) for name in shared},
        own={
            bead: {
                name: _estimate(result, f"bead{i}_{name}", name)
                for name in model.param_names
                if name not in shared
            }
            for i, bead in enumerate(kept)
        },
        points=kept,
        curves=curves,
        sentence=_sentence(model, curves, kept, counts),
        chi2=float(result.chisqr),
        dof=int(result.nfree),
        bic=_bic(result, kept),
        result=result,
    )


def choose_model(
    models: Sequence[lmfit.Model],
    curves: Mapping[str, ForceExtension],
    *,
    shared: Sequence[str] = (),
) -> tuple[SharedFit, str]:
    """Fit several models and choose one by the rule at the top of this module.

    Parameters
    ----------
    shared : names of parameters that all beads have in common, as far as a model has them.

    Returns
    -------
    The fit chosen, over all forces for which its model holds, and a sentence that says why.

    Raises
    ------
    MtpipeError, FitError : as `fit_together`; also where models have no forces in common.
    """
    ranges = [valid_for(model).force_range_pN for model in models]
    low, high = max(r[0] for r in ranges), min(r[1] for r in ranges)
    same = {bead: _between(one, low, high) for bead, one in curves.items()}
    each = [[name for name in shared if name in model.param_names] for model in models]
    pairs = list(zip(models, each, strict=True))
    # a model that describes the points leaves out those that none does, and no more
    tried = [fit_together(model, same, shared=common) for model, common in pairs]
    points = max(tried, key=lambda fit: (sum(map(len, fit.points.values())), -fit.chi2)).points
    bics = [_bic(_fit(model, points, same, common)[0], points) for model, common in pairs]
    order = sorted(range(len(models)), key=lambda i: tried[i].result.nvarys)
    best = order[0]
    for i in order[1:]:
        if bics[best] - bics[i] > DECISIVE_BIC:
            best = i
    others = ", ".join(
        f"{name_of(models[i])}: {number(bics[i] - bics[best], 2)}" for i in order if i != best
    )
    why = (
        f"{name_of(models[best])} was chosen: fewer parameters win unless BIC is lower by more "
        f"than {DECISIVE_BIC:g} over the same forces ({number(low)} to {number(high)} pN); BIC of "
        f"the others above it: {others}."
    )
    return fit_together(models[best], curves, shared=each[best]), why


def _bic(result: Any, points: Mapping[str, ExtensionPoints]) -> float:
    total = sum(map(len, points.values()))
    return float(result.chisqr) + (total - int(result.nfree)) * math.log(total)


def _between(curve: ForceExtension, low_pN: float, high_pN: float) -> ForceExtension:
    forces = curve.points.force_pN
    return replace(curve, points=curve.points.select((forces >= low_pN) & (forces <= high_pN)))


def _check(model: lmfit.Model, curves: Mapping[str, ForceExtension], shared: Sequence[str]) -> None:
    names = model.param_names
    for name in shared:
        if name not in names:
            raise MtpipeError(
                f"the model has no parameter {name!r} to share", mend=f"It has {', '.join(names)}."
            )
    for bead, curve in curves.items():
        if curve.assay.zero_stderr_nm > 0 and OFFSET not in names:
            raise MtpipeError(
                f"z = 0 of bead {bead} is uncertain, and the model has no offset",
                mend="Add mtpipe.extension_offset() to it.",
            )


def _fit(
    model: lmfit.Model,
    points: Mapping[str, ExtensionPoints],
    curves: Mapping[str, ForceExtension],
    shared: Sequence[str],
) -> tuple[Any, dict[str, FloatArray]]:
    """lmfit's result, and the points' own residuals by bead."""
    import lmfit

    shapes = {bead: one.stage_shapes_nm for bead, one in points.items()}
    start = lmfit.Parameters()
    hints = model.make_params()
    largest = max((float(one.extension_nm.max(initial=0)) for one in points.values()), default=0.0)
    contours = sum(name.endswith("contour_length_nm") for name in model.param_names)
    for i, bead in enumerate(points):
        for name in model.param_names:
            known = hints[name]
            common = name in shared
            if common and i:
                continue
            given = math.isfinite(known.value)
            value = known.value if given else ABOVE_LARGEST * largest / contours
            start.add(
                f"{'all' if common else f'bead{i}'}_{name}",
                value=value, vary=known.vary, min=known.min, max=known.max,
            )  # fmt: skip
        for k in range(shapes[bead].shape[1]):
            start.add(f"bead{i}_stage{k}", value=0.0)
    free = sum(one.vary for name, one in start.items() if "_stage" not in name)
    total = sum(map(len, points.values()))
    if total <= free:
        low, high = valid_for(model).force_range_pN
        raise FitError(
            f"{total} forces do not determine {free} parameters: the model ({name_of(model)}) "
            f"holds from {number(low)} to {number(high)} pN"
        )

    def split(parameters: Any) -> tuple[dict[str, FloatArray], list[FloatArray]]:
        values = parameters.valuesdict()
        own: dict[str, FloatArray] = {}
        beside: list[FloatArray] = []
        for i, (bead, here) in enumerate(points.items()):
            mine = {
                name: values[f"{'all' if name in shared else f'bead{i}'}_{name}"]
                for name in model.param_names
            }
            stage = np.array([values[f"bead{i}_stage{k}"] for k in range(shapes[bead].shape[1])])
            zero, curve = mine.get(OFFSET, 0.0), curves[bead]
            height = partial(_height_nm, model, mine, curve)
            own[bead] = curve_distances(here, height, zero + shapes[bead] @ stage)
            beside.append(stage)
            if 0 < curve.assay.zero_stderr_nm < math.inf:
                beside.append(np.array([zero / curve.assay.zero_stderr_nm]))
        return own, beside

    def residuals(parameters: Any) -> FloatArray:
        own, beside = split(parameters)
        return np.concatenate([*own.values(), *beside])

    result = lmfit.minimize(residuals, start, scale_covar=False)
    return result, split(result.params)[0]


def _height_nm(
    model: lmfit.Model, values: Mapping[str, float], curve: ForceExtension, force_pN: FloatArray
) -> FloatArray:
    """Mean height of the chain (n,), the offset left to the measured extensions."""
    height = np.asarray(model.eval(force_pN=force_pN, **{**values, OFFSET: 0.0}))
    if curve.assay.bead_turns:
        height = height - thermal_energy_pN_nm(curve.assay.temperature_K) / (2 * force_pN)
    return height


def _estimate(result: Any, key: str, name: str) -> Estimate:
    parameter = result.params[key]
    unit = name.rpartition("_")[2]
    value = float(parameter.value)
    if not parameter.vary:
        return Estimate(value, 0.0, (value, value), unit, METHOD, "fixed")
    error = parameter.stderr if result.errorbars and parameter.stderr is not None else math.inf
    positive = not name.endswith(OFFSET)
    if not math.isfinite(error) or (positive and not error < LARGEST_RELATIVE_ERROR * value):
        return Estimate.missing(unit, METHOD)
    interval = (value - error, value + error)
    status: Status = "ok" if result.success else "not_converged"
    return Estimate(value, float(error), interval, unit, METHOD, status)


def _sentence(
    model: lmfit.Model,
    curves: Mapping[str, ForceExtension],
    kept: Mapping[str, ExtensionPoints],
    counts: Sequence[int],
) -> str:
    usable, far, valid, fitted = counts
    forces = np.concatenate([one.force_pN for one in kept.values()])
    parts = []
    if usable > far:
        below = max(one.surface_force_pN for one in curves.values())
        parts.append(f"{usable - far} below {number(below, 2)} pN, where the surface disturbs")
    if far > valid:
        parts.append(f"{far - valid} where the model does not hold ({valid_for(model).reason})")
    if valid > fitted:
        parts.append(f"{valid - fitted} more than {OUTLIER_SIGMAS:g} standard errors off the curve")
    left = f"; left out: {', '.join(parts)}" if parts else ""
    beads = f"{len(kept)} bead{'s' * (len(kept) != 1)}"
    span = f"{number(forces.min())} to {number(forces.max())} pN"
    return f"{name_of(model)}, fitted to {fitted} of {usable} forces of {beads}, {span}{left}."
