"""What the magnets' field predicts, beside what was measured, and where the two differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mtpipe.curves.magnet_curve.curve import MagnetCurve
from mtpipe.curves.magnet_curve.field import predicted_pN
from mtpipe.ground.types import FloatArray
from mtpipe.setup.measured import Measured
from mtpipe.setup.tables import Magnets

# Confidence level for a difference of prediction and curve, given the errors of both.
TOLD = 0.95
# A difference is the same all along if its extremes are within this share of one another.
SAME = 0.1


@dataclass(frozen=True)
class Prediction:
    """Forces of `[magnets]` at positions, (n,) each, in pN; `sentence` compares them."""

    position_mm: FloatArray
    force_pN: FloatArray
    stderr_pN: FloatArray
    sentence: str


def beside(
    curve: MagnetCurve, magnets: Magnets, radius_nm: Measured, position_mm: FloatArray
) -> Prediction:
    """Predict forces where a curve was measured, and compare them.

    They differ where the logarithm of their ratio is beyond what a new bead, the curve's own error
    and the errors of the setup's numbers leave to chance.

    Raises
    ------
    MtpipeError : as `field.predicted_pN`.
    """
    force, stderr = predicted_pN(position_mm, magnets, radius_nm)
    if (force <= 0).any():
        at = float(position_mm[int(np.argmax(force <= 0))])
        said = (
            f"The field of [magnets] pulls no bead up at {at:.3g} mm, where forces were measured."
        )
        return Prediction(position_mm, force, stderr, said)
    measured = curve.new_bead(position_mm)
    ratio = force / measured.force_pN
    error = np.hypot(stderr / force, measured.stderr_pN / measured.force_pN)
    beads = int(curve.kept.sum())
    most = float(stats.t.ppf((1 + TOLD) / 2, beads - 1))
    differs = np.abs(np.log(ratio)) > most * error
    return Prediction(position_mm, force, stderr, _sentence(position_mm, ratio, differs, curve))


def _sentence(
    position_mm: FloatArray, ratio: FloatArray, differs: NDArray[np.bool_], curve: MagnetCurve
) -> str:
    spread = f"{curve.fit.spread:.0%}"
    if not differs.any():
        return (
            "The field of [magnets] predicts the curve within what beads differ by "
            f"({spread}) and the errors of the setup's numbers."
        )
    least, most = int(np.argmin(ratio)), int(np.argmax(ratio))
    if ratio[most] < (1 + SAME) * ratio[least]:
        middle = float(np.exp(np.mean(np.log(ratio))))
        return (
            f"The field of [magnets] predicts {middle:.3g} times the measured forces all along, "
            f"and beads differ by {spread} only: the shape is right, and the magnetisation of the "
            "beads, their radius or the remanence is not."
        )
    ends = sorted({least, most}, key=lambda n: float(position_mm[n]))
    where = " and ".join(f"{ratio[n]:.3g} times at {position_mm[n]:.3g} mm" for n in ends)
    return (
        f"The field of [magnets] predicts other forces than were measured, {where}, and beads "
        f"differ by {spread} only: the gap, the size or touching_mm is not right."
    )
