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
        f"x and y differ by {words.number(rms, 2)} combined standard errors (rms over "
        f"{words.count(plateaus, 'plateau')}; about 1 is chance)."
    )


def trace_captions(force: Mapping[str, Any], *, sampled: bool, shared: bool) -> dict[str, str]:
    """What stands below spectrum and posterior of a trace, given as a row of `forces`.

    Parameters
    ----------
    sampled : there is a posterior of it.
    shared : x and y have one force in this plateau.
    """
    status = words.text(force["status"])
    if status == "refused":
        refused = f"Refused: {words.text(force['refusal'])}"
        return {"spectrum": refused, "posterior": "No posterior: the trace was refused."}
    parts = []
    if words.is_number(force["force_pN"]):
        shown = words.with_error(force["force_pN"], force["force_stderr_pN"])
        parts.append(f"force {shown} pN{', common to x and y' if shared else ''}")
    if words.is_number(force["force_axis_pN"]) and joint_fit(force["method"]):
        shown = words.with_error(force["force_axis_pN"], force["force_axis_stderr_pN"])
        parts.append(f"{force['axis']} by itself tells {shown} pN")
    parts.append(f"fitted: {words.text(force['method'])}")
    if words.is_number(force["fit_deviance"]):
        parts.append(
            f"deviance {words.number(force['fit_deviance'], 4)} for "
            f"{words.number(force['fit_dof'], 4)} degrees of freedom, "
            f"p = {words.number(force['fit_p_value'], 2)}"
        )
    if status != "ok":
        meaning = words.STATUS_MEANING.get(status, "")
        parts.append(f"{words.STATUS.get(status, status)}: {meaning}")
    ratio = words.number(force["nyquist_ratio"], 2)
    parts.append(f"corner frequency {ratio} of the Nyquist frequency")
    text = "; ".join(parts) + "."
    return {
        "spectrum": text[0].upper() + text[1:],
        "posterior": _posterior_caption(force, sampled=sampled, shared=shared),
    }


def _posterior_caption(force: Mapping[str, Any], *, sampled: bool, shared: bool) -> str:
    if not sampled or not words.is_number(force["posterior_rhat"]):
        return "No posterior was sampled for this trace."
    if joint_fit(force["method"]):
        common = ", and the force that x and y share" if shared else ""
        of = (
            "Joint posterior of the bead's series, seen from this trace: its stiffness and "
            f"friction{common}"
        )
    else:
        of = "Posterior of this trace by itself"
    numbers = (
        f"R-hat {words.number(force['posterior_rhat'], 4)}, "
        f"{words.number(force['posterior_ess'], 3)} effective samples"
    )
    if not force["posterior_converged"]:
        return f"{of}. Not converged ({numbers}): this sample is not yet a posterior."
    return f"{of}. Converged: {numbers}."
