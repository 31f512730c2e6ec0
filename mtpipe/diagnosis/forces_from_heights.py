"""What mean heights and the tether say of the forces of a bead that nothing explains."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from mtpipe.calibration.bead_results import BeadResult
from mtpipe.calibration.series_choice import CONTRADICTION_P
from mtpipe.crosschecking.prepared_bead import described
from mtpipe.diagnosis.explanation import Explanation
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.physics.tether import Chain, mean_extension_nm

# A height that asks for a force e² times another is told as that.
FARTHEST_LN = 2.0


@dataclass(frozen=True)
class Heights:
    """The configured experiment, whose forces rest on heights before all.

    Attributes
    ----------
    sound : its mean heights are those of the tether at the forces fitted.
    ln_missed : by plateau, ln of the force that the mean height asks for, less that of the fit.
    ln_error : by plateau, systematic error of ln force: `ln_missed`, and how far the force moves
        when what spectra differ by is left open (`mtpipe.diagnosis.smooth_correction`).
    """

    sound: bool
    force: Mapping[int, Estimate]
    ln_missed: Mapping[int, float]
    ln_error: Mapping[int, float]


def heights_of(found: Explanation) -> Heights:
    """Whether the heights of a bead agree with the forces that were fitted to them, and these."""
    fit = found.fit
    pulls = fit.height_pulls
    sound = fit.converged and float(stats.chi2.sf(pulls @ pulls, len(pulls))) > CONTRADICTION_P
    left = found.unexplained
    correction = None if left is None else left.correction
    numbers = [plateau.number for plateau in found.after.case.plateaus]
    missed = ln_missed(fit)
    error = np.abs(missed)
    if correction is not None:
        error = np.hypot(error, np.hypot(correction.ln_force_shift, correction.ln_force_stderr))
    forces = {
        number: Estimate(
            float(force), float(error), (float(force - error), float(force + error)), "pN", ""
        )
        for number, force, error in zip(numbers, found.force_pN, found.force_stderr_pN, strict=True)
    }
    return Heights(
        sound,
        forces,
        dict(zip(numbers, missed.tolist(), strict=True)),
        dict(zip(numbers, error.tolist(), strict=True)),
    )


def ln_missed(fit: ConfiguredFit) -> FloatArray:
    """(plateaus,) ln of the force that each mean height asks for, less that of the fit.

    To first order, as far as `FARTHEST_LN`.
    """
    missed = fit.model.heights(fit.model.data, fit.expected, fit.theta).missed_nm
    # the first coordinate of a plateau is ln of its force
    per_ln_force = np.array([slope.extension_nm[0] for slope in fit.slopes])
    return np.asarray(np.clip(missed / per_ln_force, -FARTHEST_LN, FARTHEST_LN))


def lever_ln_errors(
    bead: BeadResult, chain: Chain | None, forces: Mapping[int, Estimate]
) -> dict[int, float]:
    """Standard error of ln force, by plateau, for a lever that the tether contradicts.

    The force of a stiffness is in proportion to the extension. At that force a tether as the setup
    states it has an extension of its own; where it is another than the recorded one, z or the
    tether is not what it is taken for: an interval has to reach both.

    Parameters
    ----------
    chain : the tether as stated; None where its length is not known: then nothing is contradicted.
    """
    if chain is None:
        return {}
    errors = {}
    for plateau in bead.plateaus:
        number, recorded = plateau.plateau.number, plateau.extension_nm
        force = forces.get(number)
        if force is None or not force.value > 0 or not recorded > 0:
            continue
        low, middle, high = (
            float(mean_extension_nm(chain, value)) for value in
            (max(force.interval[0], 1e-3), force.value, max(force.interval[1], 1e-3))
        )  # fmt: skip
        off, error = math.log(middle / recorded), 0.5 * math.log(high / low)
        errors[number] = math.sqrt(max(off**2 - error**2, 0.0))
    return errors


def stated_chain(found: Explanation) -> Chain | None:
    """The tether as the setup states it; None where it does not know the length."""
    case = found.before.case
    parameters = case.fit.model.parameters
    if any(one.name == "ln contour length" and one.prior is None for one in parameters):
        return None
    return described(case).chain
