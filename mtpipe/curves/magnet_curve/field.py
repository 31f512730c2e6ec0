"""Forces that follow from the magnets' size and gap and from the bead's magnetisation.

The field of the two magnets is that of magpylib's cuboids. A bead's moment m is along the field and
saturates as a Langevin function of it, so the force along the axis of the gap is m(B) dB/dz (te
Velthuis et al., Biophys. J. 99, 1292, 2010, eq. 1; Lipfert et al., Biophys. J. 96, 5040, 2009).
Where m is proportional to B that is half the gradient of m B, as it is often written; a saturated
bead feels twice as much as that form says.
"""

from __future__ import annotations

import math

import numpy as np

from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.types import FloatArray
from mtpipe.setup.measured import Measured
from mtpipe.setup.tables import Magnets

# Step (mm) of the field's numerical derivative along the axis.
STEP_MM = 1e-3
# T m/m is pN per 1e-12 A m²: from A/m times nm³ and T/mm.
PN = 1e-9 * 1e-9 * 1e-9 * 1e3 * 1e12
KA_PER_M = 1e3


def predicted_pN(
    position_mm: FloatArray, magnets: Magnets, radius_nm: Measured
) -> tuple[FloatArray, FloatArray]:
    """Force on a bead in the middle of the gap, and its standard error by what is stated.

    Parameters
    ----------
    position_mm : (n,) of the magnets.

    Returns
    -------
    (n,), (n,) pN

    Raises
    ------
    MtpipeError : magpylib is not installed, the radius is not known, or a position is one in which
        the beads would be inside the magnets.
    """
    if radius_nm.value is None:
        raise MtpipeError("forces cannot be predicted of beads whose radius is not known")
    names = [name for name in Magnets.model_fields if name != "magnetised"]
    values = {name: getattr(magnets, name) for name in names} | {"radius_nm": radius_nm}
    best = {name: float(value.value) for name, value in values.items()}
    if (np.abs(position_mm - best["touching_mm"]) < STEP_MM).any():
        raise MtpipeError(
            f"the magnets would touch the beads at {best['touching_mm']:g} mm, where forces are",
            mend="Correct [magnets] touching_mm.",
        )
    force = _force_pN(position_mm, best, magnets.magnetised)
    variance = np.zeros_like(force)
    for name, value in values.items():
        if value.stderr > 0:
            moved = best | {name: best[name] + value.stderr}
            variance += (_force_pN(position_mm, moved, magnets.magnetised) - force) ** 2
    return force, np.sqrt(variance)


def field_T(distance_mm: FloatArray, of: dict[str, float], magnetised: str) -> FloatArray:
    """Size of the field below the gap, (n,), at distances from the magnets' lower faces.

    Raises
    ------
    MtpipeError : magpylib is not installed.
    """
    try:
        import magpylib
    except ImportError:
        raise MtpipeError(
            "forces of [magnets] need magpylib",
            mend='In the folder of mtpipe: pip install ".[magnets]".',
        ) from None
    edges = [of[name] / 1e3 for name in ("width_mm", "length_mm", "height_mm")]
    aside = (of["gap_mm"] / 1e3 + edges[0]) / 2
    pair = []
    for side in (-1, 1):
        along = [of["remanence_T"], 0, 0]
        up = [0, 0, side * of["remanence_T"]]
        pair.append(
            magpylib.magnet.Cuboid(
                polarization=up if magnetised == "vertical" else along,
                dimension=edges,
                position=(side * aside, 0, edges[2] / 2),
            )
        )
    places = np.zeros((len(distance_mm), 3))
    places[:, 2] = -distance_mm / 1e3
    field = magpylib.getB(pair, places, sumup=True)
    return np.asarray(np.linalg.norm(np.reshape(field, (-1, 3)), axis=1))


def moment_share(field_mT: FloatArray, saturating_mT: float) -> FloatArray:
    """Langevin's function coth x − 1/x of x = B/B0, (n,)."""
    x = np.asarray(field_mT) / saturating_mT
    large = np.maximum(x, 1e-2)
    return np.asarray(np.where(x < large, x / 3, 1 / np.tanh(large) - 1 / large))


def _force_pN(position_mm: FloatArray, of: dict[str, float], magnetised: str) -> FloatArray:
    distance = np.abs(np.asarray(position_mm, dtype=np.float64) - of["touching_mm"])
    field = field_T(distance, of, magnetised)
    ends = [field_T(distance + step, of, magnetised) for step in (-STEP_MM / 2, STEP_MM / 2)]
    gradient = (ends[0] - ends[1]) / STEP_MM
    moment = of["saturation_kA_per_m"] * KA_PER_M * 4 / 3 * math.pi * of["radius_nm"] ** 3
    share = moment_share(1e3 * field, of["saturating_field_mT"])
    return np.asarray(moment * share * gradient * PN)
