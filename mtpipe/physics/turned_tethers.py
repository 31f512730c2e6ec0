"""Extension of DNA whose end is turned, at constant force: one molecule, and two side by side.

One molecule with both strands whole takes up twist until its torque buckles it; from there each
turn goes into plectonemes, and the extension falls in a straight line (Marko, Phys. Rev. E 76,
021926, 2007; the slope as measured by Neukirch & Marko, Phys. Rev. Lett. 106, 138104, 2011, is
within 20 % of it). Two molecules cross after half a turn (Charvin et al., Biophys. J. 89, 4124,
2005) and wind about each other from then on, at the radius that entropy and force agree on (Marko &
Siggia, Science 265, 506, 1994; Marko, Phys. Rev. E 55, 1758, 1997).

Forces in pN, lengths in nm, torques in pN nm. Turns count from the relaxed molecule.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray

# Of DNA: twist per length of the relaxed helix (10.5 base pairs of 0.34 nm a turn), twist stiffness
# of the stretched molecule and of the plectoneme as lengths (Marko 2007).
TWIST_PER_NM = 2 * np.pi / (10.5 * 0.34)
TWIST_LENGTH_NM, PLECTONEME_LENGTH_NM = 100.0, 24.0
# Half the distance of two molecules' axes (nm) at their closest.
CLOSEST_NM = 2.0
# Least share of the twist stiffness that is left in a chain that bends: that of DNA at the least
# force. Chains that bend more easily are outside the theory, and their twist is not known.
LEAST_STIFFNESS = 0.5
# Least force in kT/Lp: below, the expansion of a stretched molecule in kT/(F Lp) has no meaning.
LEAST_REDUCED_FORCE = 1.0


@dataclass(frozen=True)
class Supercoiling:
    """How one molecule answers turns.

    Attributes
    ----------
    buckling_turns : from there on it is partly plectoneme. torque_pN_nm : at and beyond it.
    slope_nm : by which each further turn shortens it. sag_nm : what it lost until then.
    """

    buckling_turns: float
    torque_pN_nm: float
    slope_nm: float
    sag_nm: float


def supercoiling(
    force_pN: float, contour_nm: float, persistence_nm: float, kT_pN_nm: float
) -> Supercoiling:
    """Buckling of a supercoilable molecule by Marko's two states (2007, eqs. 3 to 16).

    Parameters
    ----------
    force_pN : lower ones than kT/Lp are taken for that.
    """
    least_pN = LEAST_REDUCED_FORCE * kT_pN_nm / persistence_nm
    force_pN = max(force_pN, least_pN)
    softening = (kT_pN_nm / (persistence_nm * force_pN)) ** 0.5
    twist = kT_pN_nm * TWIST_LENGTH_NM * TWIST_PER_NM**2
    left = max(1 - TWIST_LENGTH_NM / (4 * persistence_nm) * softening, LEAST_STIFFNESS)
    stretched = twist * left
    plectoneme = kT_pN_nm * PLECTONEME_LENGTH_NM * TWIST_PER_NM**2
    gained = force_pN * (1 - softening)
    gained = max(gained, 0.1 * force_pN)  # near the least force, where the expansion ends
    root = np.sqrt(2 * plectoneme * gained / (1 - plectoneme / stretched))
    first, last = root / stretched, root / plectoneme
    turns = TWIST_PER_NM * contour_nm / (2 * np.pi)
    softer = twist * TWIST_LENGTH_NM / (8 * persistence_nm) * softening / force_pN
    sag = 0.5 * softer * first**2
    length = 1 - 0.5 * softening - sag
    return Supercoiling(
        buckling_turns=float(first * turns),
        torque_pN_nm=float(root / TWIST_PER_NM),
        slope_nm=float(length * contour_nm / ((last - first) * turns)),
        sag_nm=float(sag * contour_nm),
    )


def shortened_by_coiling_nm(turns: FloatArray, coiling: Supercoiling) -> FloatArray:
    """By how much turns, (n,), to either side, shorten one molecule, (n,)."""
    beyond = np.maximum(np.abs(turns) - coiling.buckling_turns, 0)
    share = np.minimum(np.abs(turns) / coiling.buckling_turns, 1)
    return np.asarray(coiling.sag_nm * share**2 + coiling.slope_nm * beyond)


def shortened_by_braiding_nm(
    turns: FloatArray,
    force_pN: float,
    extension_nm: float,
    spacing_nm: float,
    persistence_nm: float,
    kT_pN_nm: float,
) -> FloatArray:
    """By how much turns, (n,), to either side, shorten two molecules of one length, (n,).

    Parameters
    ----------
    force_pN : on both together. extension_nm : at no turn.
    spacing_nm : of their ends, at the surface as at the bead; smaller than the extension.
    """
    turned = np.abs(turns)
    swung = spacing_nm * np.sin(np.pi * np.minimum(turned, 0.5))
    crossed = extension_nm - np.sqrt(extension_nm**2 - swung**2)
    wave = 2 * np.pi * np.maximum(turned - 0.5, 0) / extension_nm
    # radius r at which F q² r, of a helix of wave number q, is the force of confinement
    confined = 2 / 3 * kT_pN_nm / (persistence_nm ** (1 / 3) * force_pN)
    wound = confined**0.75 * wave**0.5 + (CLOSEST_NM * wave) ** 2
    return np.asarray(crossed + 0.5 * extension_nm * wound)
