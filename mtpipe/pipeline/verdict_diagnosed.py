"""The verdict on a bead once it was cross-checked, in words about its forces."""

from __future__ import annotations

from dataclasses import replace

from mtpipe.calibration.recommended_force import BeadForces
from mtpipe.diagnosis.explanation import Explanation
from mtpipe.pipeline.verdict import BeadVerdict


def with_diagnosis(
    verdict: BeadVerdict,
    forces: BeadForces | None,
    found: Explanation | None,
    tolerance: float,
) -> BeadVerdict:
    """A bead's verdict with what the diagnosis found.

    What moves no force by more than the tolerance leaves a bead good, with a note.

    Parameters
    ----------
    verdict : without a cross-check. forces : None for a bead that was left out on reading.
    found : None where the bead was not simulated. tolerance : share of a force that matters.
    """
    if found is None or forces is None:
        return verdict
    material = forces.exceeds(tolerance)
    known = replace(
        verdict,
        mismatch=found.verdict,
        force_bound_percent=forces.bound_percent,
        material=material,
    )
    grade = verdict.verdict
    if grade == "unchecked":
        grade = "caution" if material else "good"
    if found.verdict == "consistent":
        return replace(known, verdict=grade)
    accounted_for = found.verdict in ("explained", "described")
    said = _explained(found, forces) if accounted_for else _left(found, forces)
    if not material:
        said += f", within the tolerance of {100 * tolerance:.3g} %"
    return replace(known, verdict=grade, reasons=(said, *verdict.reasons))


def _explained(found: Explanation, forces: BeadForces) -> str:
    return (
        f"it differs from the setup by {_names(found)}; the forces to quote include this, "
        f"which moved them by up to {forces.changed_percent:.2g} %"
    )


def _left(found: Explanation, forces: BeadForces) -> str:
    beside = f" also with {_names(found)}" if found.named else ""
    return (
        f"it differs from its simulation{beside} (p = {found.after.p_value:.0e}), and the cause is "
        f"not known; this may move its forces by up to {forces.bound_percent:.2g} %"
    )


def _names(found: Explanation) -> str:
    return " and ".join(" or ".join((one.name, *one.equivalent)) for one in found.named_once)
