"""The rule by which the force to quote is chosen (docs/forces.md).

Without a cross-check it is the force of the spectra of x and y. With one it is that of the
configured experiment, with what was named, if recording and simulation then agree. If they do not,
it is that of the configured experiment where its heights stand and the spectra either agree with
it or are those of no tethered bead; else that of the spectra. What a determination contradicts
itself by is in its error.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from mtpipe.calibration.bead_results import BeadResult
from mtpipe.calibration.calibration import Calibration, calibrate
from mtpipe.calibration.recommended_force import BeadForces
from mtpipe.calibration.scatter import scatter_beyond_errors
from mtpipe.calibration.series_choice import CONTRADICTION_P
from mtpipe.calibration.spectral_force import (
    chosen_of,
    contradictions_of,
    forces_of_spectra,
    spectral_forces,
)
from mtpipe.diagnosis.explanation import Explanation
from mtpipe.diagnosis.forces_from_heights import heights_of, lever_ln_errors, stated_chain
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import Recording

CONFIGURED = "configured experiment, fitted to all axes and heights"
# A limit of a factor e² and beyond is told as that.
LARGEST_LN = 2.0


def recommended_forces(
    calibration: Calibration, found: Mapping[str, Explanation]
) -> dict[str, BeadForces]:
    """The forces to quote of every bead.

    Parameters
    ----------
    found : what the diagnosis found about beads; of others the forces are those of the spectra.
    """
    return {bead.bead: bead_forces(bead, found.get(bead.bead)) for bead in calibration.beads}


def diagnosed_forces(
    recording: Recording, found: Mapping[str, Explanation], *, seed: int
) -> dict[str, BeadForces]:
    """The forces to quote of the beads that were diagnosed, in the plateaus that were.

    The spectra of x and y are fitted by themselves only where a bead is unexplained: else no force
    comes from them.
    """
    if any(one.verdict == "unexplained" for one in found.values()):
        forces = recommended_forces(calibrate(recording, seed=seed), found)
        return {bead: forces[bead] for bead in found}
    nothing = {bead: BeadResult(bead, (), 0.0, None, False) for bead in found}
    return {bead: bead_forces(nothing[bead], one) for bead, one in found.items()}


def bead_forces(bead: BeadResult, found: Explanation | None) -> BeadForces:
    """The forces to quote of one bead.

    Parameters
    ----------
    found : what the diagnosis found; None: not cross-checked.
    """
    if found is None:
        return forces_of_spectra(bead)
    spectra = spectral_forces(bead)
    best = _of_plateaus(found, found.force_pN, found.force_stderr_pN)
    named = best if found.named else {}
    configured = best
    if found.named:
        before = found.before.case.fit
        # the chain's formula is the same in both: they differ by what is named
        force_pN = before.force_pN * found.force_pN / found.fit.force_pN
        configured = _of_plateaus(found, force_pN, before.force_stderr_pN)
    forces = BeadForces(
        {}, configured, named, found.verdict, 0.0, _changed_percent(configured, named)
    )
    if found.verdict == "consistent":
        return replace(forces, recommended=chosen_of(bead, configured, "heights", spectra))
    if found.verdict in ("explained", "described"):
        return replace(forces, recommended=chosen_of(bead, named or configured, "named", spectra))
    return _of_unexplained(bead, found, forces, spectra)


def _of_plateaus(
    found: Explanation, force_pN: FloatArray, stderr_pN: FloatArray
) -> dict[int, Estimate]:
    return {
        plateau.number: Estimate(
            float(force), float(error), (float(force - error), float(force + error)),
            "pN", CONFIGURED,
        )
        for plateau, force, error in zip(
            found.before.case.plateaus, force_pN, stderr_pN, strict=True
        )
    }  # fmt: skip


def _changed_percent(before: Mapping[int, Estimate], after: Mapping[int, Estimate]) -> float:
    return max(
        (100 * abs(after[n].value / before[n].value - 1) for n in after if n in before), default=0.0
    )


def _of_unexplained(
    bead: BeadResult, found: Explanation, forces: BeadForces, spectra: Mapping[int, Estimate]
) -> BeadForces:
    """Forces of a bead that differs from its simulation for a reason that is not known."""
    against, heights = contradictions_of(bead), heights_of(found)
    spectra = {n: force.widened(abs(against.friction_ln)) for n, force in spectra.items()}
    apart = _Apart.of(spectra, heights.force, against.ln_error)
    stand = heights.sound and apart.agree
    if against.shape:
        # of spectra of x and y, heights, and their joint fit, two agree or none
        stand = heights.sound or median_of(heights.ln_missed.values()) < apart.typical_ln / 2
    if stand:
        errors = {n: math.hypot(own, apart.ln_error) for n, own in heights.ln_error.items()}
        widened = {n: force.widened(errors[n]) for n, force in heights.force.items()}
        recommended = chosen_of(bead, widened, "heights_alone", spectra)
    else:
        levers = lever_ln_errors(bead, stated_chain(found), spectra)
        shared = math.hypot(against.ln_error, against.known_ln)
        errors = {n: math.hypot(shared, levers.get(n, 0.0)) for n in spectra}
        widened = {n: force.widened(levers.get(n, 0.0)) for n, force in spectra.items()}
        recommended = chosen_of(bead, widened, "spectra_alone", spectra)
    bound = 100 * math.expm1(min(max(errors.values(), default=math.inf), LARGEST_LN))
    return replace(forces, recommended=recommended, bound_percent=bound)


@dataclass(frozen=True)
class _Apart:
    """How far the forces of the spectra and those of the heights differ.

    `agree` : by no more than their errors. `ln_error` : what one may be off by as the other tells:
    their scatter beyond statistical errors, and the error of their mean difference. `typical_ln` :
    median of their distance in ln force.
    """

    agree: bool
    ln_error: float
    typical_ln: float

    @classmethod
    def of(
        cls, spectra: Mapping[int, Estimate], heights: Mapping[int, Estimate], systematic: float
    ) -> _Apart:
        """Compare them; `systematic` is the part of the spectra's ln errors that all share."""
        both = [n for n in heights if n in spectra and spectra[n].value > 0]
        if not both:
            return cls(False, math.inf, math.nan)
        off = np.array([math.log(spectra[n].value / heights[n].value) for n in both])
        total = np.array([
            math.hypot(*(f.stderr / f.value for f in (spectra[n], heights[n]))) for n in both
        ])  # fmt: skip
        agree = float(stats.chi2.sf(np.sum((off / total) ** 2), len(both))) > CONTRADICTION_P
        statistical = np.sqrt(np.maximum(total**2 - systematic**2, 1e-12))
        mean_error = float(np.sum(statistical**-2.0)) ** -0.5
        beyond = scatter_beyond_errors(off, statistical)
        return cls(agree, math.hypot(beyond, mean_error), float(np.median(np.abs(off))))


def median_of(distances: Iterable[float]) -> float:
    """Median of the absolute values."""
    return float(np.median([abs(one) for one in distances]))
