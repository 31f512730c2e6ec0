"""The force–extension curve of a bead: worm-like chains over the forces where each is valid.

Three chains are fitted (`mtpipe.physics.tether.VALIDITY` says over which forces and why) to the
plateaus that are far enough from the surface, and one is recommended by the data:

1. Bouchiat's chain or Marko and Siggia's interpolation, whichever fits the same points up to 10 pN
   better over all beads of a recording (`fit_curves`), so that beads can be compared. They have as
   many parameters, and persistence lengths 8 % apart. Where a bead's chi2 differs by less than 6
   (odds of 20) a notice names the other's. What the other formula makes of the lengths is in the
   errors of those recommended, with the weight that chi2 leaves it.
2. The extensible chain instead, when some force reaches above 8 pN, the stretch modulus is told
   from infinity by two standard errors, and BIC improves by more than 6 ("strong", Kass & Raftery
   1995) over the fit of Bouchiat's chain to the same points.

No priors. With fewer points than parameters plus one, or forces too much alike, nothing is
recommended and the notices say why.

Near the surface the relation between fluctuations and force fails, and kT <z>/<x²> is too high. In
units of kT/sigma, sigma² = 2 Lp L0/3 being the variance of a free chain's end per axis, that is by
11 % at a force of 1.5, 1 % at 2.5 and 0.1 % at 3.5 for contours from 1200 nm (1 % for 300 nm).
Points below 3.5 kT/sigma are left out: 0.05 pN for a contour of 2700 nm, 0.14 pN for 300 nm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import expit

from mtpipe.fit.points import Assay, ExtensionPoints, Relation
from mtpipe.fit.tether import TetherFit, fit_tether, parameters_of
from mtpipe.ground.notice import Notice
from mtpipe.ground.shown import Shown
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.tether import VALIDITY, Formula

_SURFACE_REDUCED_FORCE = 3.5
_DECISIVE_CHI2 = 6.0
DECISIVE_BIC = 6.0
_STRETCHING_FROM_PN = 8.0
_STRONG_CORRELATION = 0.98
POOR_P_VALUE = 1e-3
OUTLIER_SIGMAS = 5.0
# Chains that are fitted; the others only simulate.
FITTED: tuple[Formula, ...] = ("marko-siggia", "bouchiat", "extensible")


@dataclass(frozen=True, repr=False)
class ForceExtension(Shown):
    """Points and fits of one bead.

    Attributes
    ----------
    points : all points, usable or not.
    fits : one per chain that could be fitted; those that do not identify the chain included.
    recommended : the fit to quote, one of `fits`; None when the chain is not identified.
    other_relation : the recommended chain fitted with the other relation between force and
        mean height (`mtpipe.fit.tether.Relation`), to show how much that choice matters.
    interpolation_gain : chi2 by which Marko and Siggia's formula fits the same points better than
        Bouchiat's; 0 where either is not identified, or neither fits.
    surface_force_pN : points below were left out; 0 when the surface was not considered, for
        want of a fit.
    notices : what a user has to know, in words.
    assay : how extensions and forces came about.
    """

    bead: str
    points: ExtensionPoints
    fits: tuple[TetherFit, ...]
    recommended: TetherFit | None
    other_relation: TetherFit | None
    interpolation_gain: float
    surface_force_pN: float
    notices: tuple[Notice, ...]
    assay: Assay

    def __repr__(self) -> str:
        head = f"ForceExtension of {self.bead}: {len(self.points)} points"
        if self.recommended is None:
            return f"{head}, which do not determine the tether"
        return f"{head}; {self.recommended}"

    @property
    def table(self) -> pd.DataFrame:
        """A row for each point: plateau, force (pN) and mean extension (nm) with their errors."""
        points = self.points
        return pd.DataFrame(
            {
                "plateau": points.plateau,
                "force_pN": points.force_pN,
                "force_stderr_pN": points.force_stderr_pN,
                "extension_nm": points.extension_nm,
                "extension_stderr_nm": points.extension_stderr_nm,
            }
        )


def fit_curves(beads: Mapping[str, tuple[ExtensionPoints, Assay]]) -> dict[str, ForceExtension]:
    """Fit the curves of all beads of a recording, with one formula for the inextensible chain.

    What the other formula would make of the lengths is in the errors of those recommended, with the
    weight that it has by chi2 over all beads.
    """
    curves = {bead: fit_curve(bead, points, assay) for bead, (points, assay) in beads.items()}
    gain = sum(curve.interpolation_gain for curve in curves.values())
    if gain > 0:
        curves = {
            bead: fit_curve(bead, points, assay, inextensible="marko-siggia")
            for bead, (points, assay) in beads.items()
        }
    weight = float(expit(-abs(gain) / 2))
    return {bead: _with_other_formula(curve, weight) for bead, curve in curves.items()}


def fit_curve(
    bead: str, points: ExtensionPoints, assay: Assay, *, inextensible: Formula = "bouchiat"
) -> ForceExtension:
    """Fit every chain to a bead's points and choose one.

    Parameters
    ----------
    bead : its name, for the notices.
    points : one per plateau; unusable ones (no force, no extension) are left out.
    assay : temperature, and how extensions and forces came about.
    inextensible : formula recommended where stretching is not seen.

    Returns
    -------
    ForceExtension; never raises for want of data: `recommended` is then None.
    """
    usable = points.select(points.usable())
    surface_pN = surface_force_pN(usable, assay)
    far, outliers = without_outliers(usable.select(usable.force_pN >= surface_pN), assay)
    fits: dict[Formula, TetherFit] = {}
    for formula in FITTED:
        fit = _fit(far, formula, formula, assay)
        if fit is not None:
            fits[formula] = fit
    gain = _interpolation_gain(fits, far, assay)
    chosen, rival = _recommend(fits, far, assay, inextensible)
    if abs(gain) > _DECISIVE_CHI2:
        rival = None
    other = None
    if chosen is not None:
        opposite: Relation = "long-chain" if assay.relation == "potential" else "potential"
        other = _fit(far, chosen.model, chosen.model, replace(assay, relation=opposite))
    notices = []
    near = usable.select(usable.force_pN < surface_pN)
    if len(near) > 0:
        notices.append(_near_surface(near, len(usable), surface_pN))
    if outliers:
        notices.append(_off_the_curve(outliers, len(usable)))
    if chosen is None:
        notices.append(Notice("tether_not_identified", "caution", _why_not(len(far), assay)))
    else:
        notices.append(_chosen_because(chosen, fits, len(usable)))
        notices += [*_doubts(chosen), *_alternatives(chosen, rival, other)]
    return ForceExtension(
        bead,
        points,
        tuple(fits.values()),
        chosen,
        other,
        gain,
        surface_pN,
        tuple(replace(notice, bead=bead) for notice in notices),
        assay,
    )


def _with_other_formula(curve: ForceExtension, weight: float) -> ForceExtension:
    """The curve with what the inextensible chain's other formula would make of its lengths in the
    errors of the recommended ones; `weight` : of that formula.
    """
    chosen = curve.recommended
    if chosen is None:
        return curve
    formulas = {"bouchiat", "marko-siggia"}
    others = [fit for fit in curve.fits if {fit.model, chosen.model} == formulas]
    if not (others and others[0].identified):
        return curve
    (other,) = others
    lengths = {
        name: getattr(chosen, name).widened(
            math.sqrt(weight)
            * abs(math.log(getattr(other, name).value / getattr(chosen, name).value))
        )
        for name in ("contour_length_nm", "persistence_length_nm")
    }
    widened = replace(chosen, **lengths)
    fits = tuple(widened if fit is chosen else fit for fit in curve.fits)
    return replace(curve, fits=fits, recommended=widened)


def surface_force_pN(points: ExtensionPoints, assay: Assay) -> float:
    """The force below which the surface disturbs the bead, from a first fit; 0 without one."""
    fit = _fit(points, "bouchiat", "extensible", assay)
    if fit is None or not fit.identified:
        return 0.0
    variance = 2 * fit.persistence_length_nm.value * fit.contour_length_nm.value / 3
    kT = float(thermal_energy_pN_nm(assay.temperature_K))
    return float(_SURFACE_REDUCED_FORCE * kT / np.sqrt(variance))


def without_outliers(
    points: ExtensionPoints, assay: Assay
) -> tuple[ExtensionPoints, tuple[int, ...]]:
    """Leave out plateaus that lie far off the curve of the others, the worst first.

    A stretch in which the tracker lost its place or the focus moved spoils the whole curve. Points
    are left out only while the fit is bad (p < 0.001), the worst is more than five standard errors
    away, and no more than a quarter of them: a curve that is wrong throughout stays as it is.

    Returns
    -------
    The points kept, and the numbers of the plateaus left out.
    """
    kept, left_out = points, []
    for _ in range(len(points) // 4):
        # the most flexible chain, so that stretching is not taken for an outlier
        fit = _fit(kept, "extensible", "extensible", assay)
        if fit is None or fit.p_value > POOR_P_VALUE:
            break
        inside = np.flatnonzero(_valid(kept, "extensible"))
        worst = int(inside[np.argmax(np.abs(fit.residuals))])
        if np.max(np.abs(fit.residuals)) < OUTLIER_SIGMAS:
            break
        left_out.append(int(kept.plateau[worst]))
        kept = kept.select(np.arange(len(kept)) != worst)
    return kept, tuple(sorted(left_out))


def _off_the_curve(plateaus: tuple[int, ...], usable: int) -> Notice:
    numbers = ", ".join(str(plateau) for plateau in plateaus)
    return Notice(
        "off_the_curve",
        "caution",
        f"Left out of the tether's fit, for lying more than {OUTLIER_SIGMAS:.0f} standard errors "
        f"off the force–extension curve of the others: plateau {numbers} (of {usable}). Mistracked "
        "or out of focus, or another state of the tether.",
    )


def _valid(points: ExtensionPoints, formula: Formula) -> NDArray[np.bool_]:
    low, high = VALIDITY[formula].force_range_pN
    return (points.force_pN >= low) & (points.force_pN <= high)


def _fit(
    points: ExtensionPoints, formula: Formula, over: Formula, assay: Assay
) -> TetherFit | None:
    """The fit of a chain over the forces where the chain `over` is valid; None: too few."""
    within = points.select(_valid(points, over))
    if len(within) <= parameters_of(formula, assay):
        return None
    return fit_tether(within, formula, assay)


def _interpolation_gain(
    fits: dict[Formula, TetherFit], points: ExtensionPoints, assay: Assay
) -> float:
    exact, simple = fits.get("bouchiat"), _fit(points, "marko-siggia", "bouchiat", assay)
    if exact is None or simple is None or not (exact.identified and simple.identified):
        return 0.0
    if max(exact.p_value, simple.p_value) < POOR_P_VALUE:
        return 0.0
    return exact.chi2 - simple.chi2


def _recommend(
    fits: dict[Formula, TetherFit],
    points: ExtensionPoints,
    assay: Assay,
    inextensible: Formula,
) -> tuple[TetherFit | None, TetherFit | None]:
    """The choice described at the top of this module, and its rival among the formulas."""
    sound = {formula: fit for formula, fit in fits.items() if fit.identified}
    soft, rigid = sound.get("extensible"), _fit(points, "bouchiat", "extensible", assay)
    if (
        soft is not None
        and soft.stretch_modulus_pN is not None
        and soft.stretch_modulus_pN.status == "ok"
        and soft.force_range_pN[1] > _STRETCHING_FROM_PN
        and rigid is not None
        and rigid.bic - soft.bic > DECISIVE_BIC
    ):
        return soft, None
    exact, simple = sound.get("bouchiat"), sound.get("marko-siggia")
    choice, rival = (simple, exact) if inextensible == "marko-siggia" else (exact, simple)
    return (rival, None) if choice is None else (choice, rival)


def _chosen_because(chosen: TetherFit, fits: Mapping[Formula, TetherFit], usable: int) -> Notice:
    """Which chain was chosen, over which forces, by the rule at the top of this module."""
    low, high = chosen.force_range_pN
    if chosen.model == "extensible":
        why = (
            f"some force is above {_STRETCHING_FROM_PN:g} pN, the data determine the stretching, "
            f"and BIC is lower by more than {DECISIVE_BIC:g} than without it"
        )
    elif {"bouchiat", "marko-siggia"} <= fits.keys():
        why = "no stretching is seen, and it fits the forces of all beads at least as well as "
        why += "Marko and Siggia's formula" if chosen.model == "bouchiat" else "Bouchiat's formula"
    else:
        why = "there are too few forces for any other"
    return Notice(
        "tether_choice",
        "info",
        f"{_CHAINS[chosen.model]} was chosen, fitted to {chosen.points} of {usable} forces, "
        f"{low:.2g} to {high:.2g} pN: {why}.",
    )


def _near_surface(near: ExtensionPoints, usable: int, surface_pN: float) -> Notice:
    numbers = ", ".join(map(str, near.plateau))
    return Notice(
        "near_surface",
        "caution",
        f"Left out of the tether's fit, for a force below {surface_pN:.2g} pN: plateau {numbers} "
        f"(of {usable}). There the surface disturbs the bead, or it lies on it; such a force is "
        "not to be trusted.",
    )


def _doubts(fit: TetherFit) -> Iterator[Notice]:
    """What makes a fit's numbers less certain than they look."""
    if fit.p_value < POOR_P_VALUE:
        yield Notice(
            "tether_fit_poor",
            "caution",
            f"{_CHAINS[fit.model]} fits badly (chi2 {fit.chi2:.1f} for {fit.dof} degrees of "
            "freedom): contour and persistence length are less certain than their errors say.",
        )
    if fit.correlation is not None and abs(fit.correlation[2]) > _STRONG_CORRELATION:
        first, second, value = fit.correlation
        yield Notice(
            "tether_correlated",
            "caution",
            f"The {_WORDS[first]} and the {_WORDS[second]} can hardly be separated (correlation "
            f"{value:+.3f}); a wider range of forces would separate them.",
        )


def _alternatives(
    chosen: TetherFit, rival: TetherFit | None, other: TetherFit | None
) -> Iterator[Notice]:
    """Other readings of the same data that move the persistence length by over an error."""
    length = chosen.persistence_length_nm
    for fit, reading in ((rival, "formula"), (other, "relation")):
        if fit is None or not fit.identified:
            continue
        if abs(fit.persistence_length_nm.value - length.value) > length.stderr:
            taken = _CHAINS[fit.model] if reading == "formula" else _LENGTHS[fit.relation]
            yield Notice(
                f"tether_{reading}",
                "info",
                f"{taken} would have a persistence length of "
                f"{fit.persistence_length_nm.value:.1f} nm instead of {length.value:.1f} nm.",
            )


_CHAINS: Mapping[Formula, str] = {
    "marko-siggia": "The worm-like chain by Marko and Siggia's formula",
    "bouchiat": "The worm-like chain by Bouchiat's formula",
    "extensible": "The extensible worm-like chain",
    "extensible-marko-siggia": "The extensible worm-like chain by Marko and Siggia's formula",
}
_LENGTHS: Mapping[Relation, str] = {
    "potential": "With the formula for a chain of its length, the tether",
    "long-chain": "With the literature's usual formula, that of a very long chain, the tether",
}
_WORDS = {
    "ln_contour": "contour length",
    "ln_persistence": "persistence length",
    "compliance": "stretch modulus",
    "offset": "offset of z",
}


def _why_not(far: int, assay: Assay) -> str:
    needed = parameters_of("bouchiat", assay) + 1
    if far < needed:
        return (
            f"Contour and persistence length need at least {needed} plateaus with a force and an "
            f"extension; there are {far}."
        )
    return (
        "The forces are too much alike, or outside the range of the worm-like chain (up to 10 pN, "
        "40 pN if extensible), to determine contour and persistence length."
    )
