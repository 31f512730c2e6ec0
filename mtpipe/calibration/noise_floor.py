"""The tracking noise that a bead's spectra show, beside the noise that its images explain.

A fit takes whatever is white in the spectrum for tracking noise; where the bead's own motion hides
it, the fit's noise is what was known beforehand, and is not compared. Of a recording that mtpipe
tracked itself the images say how much of it light and camera make (`recording.recording.Tracked`).
What the spectra show beyond that is something else, and worth a notice: vibration, errors of the
tracker, or motion that the model does not have.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator

from mtpipe.calibration.bead_results import AxisResult, BeadResult
from mtpipe.fit.estimates import NOT_IDENTIFIED_LN
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.notice import Notice
from mtpipe.recording.recording import AXES, Drift, Recording

# Ratio of the noise in spectra to the precision by images that is worth a notice. That precision is
# known to 15 % (looked at in three pieces of the film) and differs with the height; 1.5 is beyond.
FACTOR = 1.5
SIGMAS = 3.0


def noise_floor_nm(bead: BeadResult, axis: str) -> Estimate | None:
    """Tracking noise along an axis by the bead's spectra, in nm; None where they do not tell it.

    Of the joint fit, in which all its traces share it; without one, the median over the plateaus
    whose stiffness is identified, with the median of their errors.
    """
    fitted = [
        (one, one.estimates)
        for plateau in bead.plateaus
        for one in plateau.axes
        if one.axis == axis and one.estimates is not None
    ]
    joint = [(one, known) for one, known in fitted if one.method.startswith("series")]
    if joint:
        one, known = joint[0]
        return known.noise if _by_spectra(one, known.noise) else None
    alone = [
        known.noise
        for one, known in fitted
        if known.stiffness.status == "ok" and _by_spectra(one, known.noise)
    ]
    if not alone:
        return None
    value, stderr, low, high = (
        statistics.median(numbers)
        for numbers in zip(*((n.value, n.stderr, *n.interval) for n in alone), strict=True)
    )
    return Estimate(value, stderr, (low, high), "nm", f"median of {len(alone)} plateaus")


def _by_spectra(one: AxisResult, noise: Estimate) -> bool:
    """Whether the spectra tell a noise to a factor e, what was known beforehand left out.

    Informations about the logarithm add up: what is not the prior's is the spectra's.
    """
    low, high = noise.interval
    if noise.status == "not_converged" or not high > low > 0:
        return False
    information = (math.log(high / low) / 2) ** -2
    prior = None if one.free is None else one.free.model.noise_prior_nm
    if prior is not None:
        information -= math.log(prior[1]) ** -2
    return information > NOT_IDENTIFIED_LN**-2


def noise_notices(bead: BeadResult, recording: Recording) -> Iterator[Notice]:
    """Axes along which the spectra show more noise than the images explain.

    More: by half, and by three standard errors. None of a recording that mtpipe did not track.

    Parameters
    ----------
    recording : after drift subtraction. Where that was done frame by frame, the noise of the
        reference beads is in the trace and expected.
    """
    if recording.tracked is None:
        return
    precision = recording.tracked.precision_nm.get(bead.bead, (math.nan,) * 3)
    for i, axis in enumerate(AXES):
        floor = noise_floor_nm(bead, axis)
        carried = _carried_nm(recording.drift, i)
        explained = math.hypot(precision[i], carried)
        if floor is None or not floor.value > FACTOR * explained + SIGMAS * floor.stderr:
            continue
        also = " and the reference beads that were subtracted" if carried else ""
        yield Notice(
            "noise_above_images",
            "info" if axis == "z" else "caution",
            f"The spectra show a noise of {floor.value:.2g} ± {floor.stderr:.1g} nm. By the "
            f"images, light and camera{also} make {explained:.2g} nm. The rest is vibration, the "
            "tracker (pixel locking, a look-up table that is not the bead's) or motion that the "
            "model does not have; the fit takes it for white noise.",
            bead.bead,
            axis=axis,
        )


def _carried_nm(drift: Drift | None, axis: int) -> float:
    """White noise that subtraction frame by frame carried into the traces; slower, it is none."""
    if drift is None or drift.method != "reference" or drift.cutoff_hz[axis] is not None:
        return 0.0
    added = drift.noise_added_nm[axis]
    return added if added > 0 else 0.0
