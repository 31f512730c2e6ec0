"""Which fit describes the spectra of a bead, in words, and why not a more informed one.

Read from `series` and `method` of the run folder, in the words of `calibration.series_choice`, and
from what the setup knows. The most informed fit: one of all spectra of the bead, in which x and y
of a plateau share the force and the friction is the one expected.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mtpipe.report import words

LEFT_OUT = "unlike_the_series"
# A friction of single traces is told beside the one of the joint fit if it differs by more than
# these: standard errors, and share.
CLEARLY, LEAST_TOLD = 2, 0.05
_JOINT = re.compile(
    "series of spectra: (x and y share the force|x and y apart), "
    "friction (expected from the setup|measured on this bead)"
)


@dataclass(frozen=True)
class JointFit:
    """A fit of a bead's whole series: what its traces share, and where its friction is from."""

    force_shared: bool
    friction_expected: bool


@dataclass(frozen=True)
class FitSource:
    """Which fit describes the spectra: in a few words, in one sentence, and why this one."""

    label: str
    sentence: str
    reasons: tuple[str, ...]


def joint_fit(method: Any) -> JointFit | None:
    """The joint fit that a cell of `series` or `method` names; None: fitted by itself."""
    found = _JOINT.fullmatch(words.text(method))
    if found is None:
        return None
    return JointFit(found[1].endswith("share the force"), found[2].startswith("expected"))


def fit_source(
    bead: Mapping[str, Any], forces: Sequence[Mapping[str, Any]], *, radius_known: bool
) -> FitSource | None:
    """Which fit describes a bead's spectra; None where every trace was refused.

    Parameters
    ----------
    bead : row of `beads`.
    forces : rows of `forces` of this bead.
    radius_known : whether the setup knows the bead's radius.
    """
    lateral = [
        row
        for row in forces
        if row["axis"] in ("x", "y") and words.text(row["status"]) != "refused"
    ]
    if not lateral:
        return None
    joint = joint_fit(bead["series"])
    if joint is None:
        return _by_themselves(lateral)
    members = [row for row in lateral if joint_fit(row["method"])]
    axes = sorted({row["axis"] for row in members})
    return FitSource(
        label="joint"
        + (", x and y apart" if len(axes) > 1 and not joint.force_shared else "")
        + ("" if joint.friction_expected else ", friction measured"),
        sentence="One joint fit describes "
        f"{words.count(len(members), 'spectrum', 'spectra')} of x and y: {_shared(joint, axes)}.",
        reasons=(
            *_why_apart(joint, axes),
            _friction(joint, bead, radius_known=radius_known),
            *_left_out(lateral),
        ),
    )


def _shared(joint: JointFit, axes: Sequence[str]) -> str:
    bead = "radius, friction and the tracking noise of each axis are the same in all plateaus"
    if len(axes) == 1:
        return f"{bead}; only {axes[0]} could be used"
    if joint.force_shared:
        return f"x and y of a plateau have the same force; {bead}"
    return f"x and y each have their own force; {bead}"


def _why_apart(joint: JointFit, axes: Sequence[str]) -> list[str]:
    if joint.force_shared or len(axes) == 1:
        return []
    return [
        "x and y have their own forces because no fit with one force for both describes the "
        "spectra (p below 0.001): extension, radius or the direction of the field may be wrong, or "
        "the tether is not a single molecule"
    ]


def _friction(joint: JointFit, bead: Mapping[str, Any], *, radius_known: bool) -> str:
    if not radius_known:
        return (
            "The bead's radius is unknown in the setup, so it was fitted together with the friction"
        )
    if joint.friction_expected:
        return (
            "The friction is the one expected from radius, viscosity and height, which fits "
            f"the spectra together{_unlike_alone(bead)}"
        )
    ratio = words.with_error(bead["friction_ratio"], bead["friction_ratio_stderr"])
    seen = f"; spectra fitted one by one have {ratio} times as much" if ratio != words.EMPTY else ""
    return (
        "The friction was measured on this bead, because its spectra contradict the one expected "
        f"from radius, viscosity and height{seen}"
    )


def _unlike_alone(bead: Mapping[str, Any]) -> str:
    """What single traces give, where that is clearly another friction."""
    ratio, stderr = bead["friction_ratio"], bead["friction_ratio_stderr"]
    if not (words.is_number(ratio) and words.is_number(stderr)):
        return ""
    if abs(ratio - 1) < max(CLEARLY * stderr, LEAST_TOLD):
        return ""
    return f"; spectra fitted one by one have {words.with_error(ratio, stderr)} times as much"


def _left_out(lateral: Sequence[Mapping[str, Any]]) -> list[str]:
    left = [
        words.place([int(row["plateau"])], [row["axis"]])
        for row in lateral
        if LEFT_OUT in words.flags(row["flags"])
    ]
    if not left:
        return []
    what = (
        "contradicts the others and was fitted separately"
        if len(left) == 1
        else "contradict the others and were fitted separately"
    )
    return [f"{'; '.join(left).capitalize()} {what}"]


def _by_themselves(lateral: Sequence[Mapping[str, Any]]) -> FitSource:
    known = any(words.is_number(row["extension_nm"]) and row["extension_nm"] > 0 for row in lateral)
    why = (
        "No joint fit describes the spectra, even without the quarter of them that differ most "
        "from the others: bead or tether may have changed during the recording"
        if known
        else "A joint fit needs the extension, which is not known"
    )
    frictions = sorted({words.text(row["method"]).partition(", ")[2] for row in lateral} - {""})
    return FitSource(
        label="each separately",
        sentence=f"Each spectrum was fitted separately ({' or '.join(frictions)}).",
        reasons=(why,),
    )
