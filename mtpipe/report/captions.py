"""Captions of the bead's charts that depend on its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mtpipe.report import words
from mtpipe.report.fit_words import joint_fit
from mtpipe.report.plateau_forces import Comparison, rms_difference


def agreement_caption(compared: Sequence[Comparison]) -> str:
    """How far x and y differ overall, in words."""
    overall = rms_difference(compared)
    if overall is None:
        return ""
    rms, plateaus = overall
    return (
        f"x and y differ by {words.number(rms, 2)} combined standard errors (root mean square over "
        f"{words.count(plateaus, 'plateau')}; by chance it is about 1)."
    )


def trace_captions(fit: Mapping[str, Any], *, sampled: bool) -> dict[str, str]:
    """What stands below spectrum and posterior of a trace, given as a row of `forces`.

    Parameters
    ----------
    sampled : there is a posterior of it.
    """
    status = words.text(fit["status"])
    if status == "refused":
        refused = f"Refused: {words.text(fit['refusal'])}"
        return {"spectrum": refused, "posterior": "No posterior: the trace was refused."}
    parts = []
    if words.is_number(fit["force_axis_pN"]):
        shown = words.with_error(fit["force_axis_pN"], fit["force_axis_stderr_pN"])
        parts.append(f"force from {fit['axis']} alone: {shown} pN")
    parts.append(f"fit: {words.text(fit['method'])}")
    if words.is_number(fit["fit_deviance"]):
        parts.append(
            f"deviance {words.number(fit['fit_deviance'], 4)} for "
            f"{words.number(fit['fit_dof'], 4)} degrees of freedom, "
            f"p = {words.number(fit['fit_p_value'], 2)}"
        )
    if status != "ok":
        meaning = words.STATUS_MEANING.get(status, "")
        parts.append(f"{words.STATUS.get(status, status)}: {meaning}")
    ratio = words.number(fit["nyquist_ratio"], 2)
    parts.append(f"the corner frequency is {ratio} times the Nyquist frequency")
    return {
        "spectrum": words.sentence("; ".join(parts)),
        "posterior": _posterior_caption(fit, sampled=sampled),
    }


def _posterior_caption(fit: Mapping[str, Any], *, sampled: bool) -> str:
    if not sampled or not words.is_number(fit["posterior_rhat"]):
        return "No posterior was sampled for this trace."
    joint = joint_fit(fit["method"])
    of = "Posterior of this trace alone"
    if joint is not None:
        common = ", and the force that x and y share" if joint.force_shared else ", and its force"
        of = (
            "From the posterior of the joint fit of all the bead's spectra: stiffness and friction "
            f"of this trace{common}"
        )
    numbers = (
        f"R-hat {words.number(fit['posterior_rhat'], 4)}, "
        f"{words.number(fit['posterior_ess'], 3)} effective samples"
    )
    if not fit["posterior_converged"]:
        return f"{of}. Not converged ({numbers}): do not rely on this sample."
    return f"{of}. Converged: {numbers}."
