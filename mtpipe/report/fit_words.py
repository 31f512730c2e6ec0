"""Which fit the forces of a bead come from, in words, and why not from a more informed one.

Read from `series` and `method` of the run folder, in the words of `mtpipe.series_choice`, and from
what the setup knows. The most informed fit: one of all spectra of the bead, in which x and y of a
plateau share the force and the friction is the one expected.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mtpipe.report import words

LEFT_OUT = "unlike_the_series"
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
class ForceSource:
    """Which fit the forces come from: in a few words, in one sentence, and why this one."""

    label: str
    sentence: str
    reasons: tuple[str, ...]


def joint_fit(method: Any) -> JointFit | None:
    """The joint fit that a cell of `series` or `method` names; None: fitted by itself."""
    found = _JOINT.fullmatch(words.text(method))
    if found is None:
        return None
    return JointFit(found[1].endswith("share the force"), found[2].startswith("expected"))


def force_source(
    bead: Mapping[str, Any], forces: Sequence[Mapping[str, Any]], *, radius_known: bool
) -> ForceSource | None:
    """Where a bead's forces come from; None where every trace was refused.

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
    return ForceSource(
        label="joint"
        + (", x and y apart" if len(axes) > 1 and not joint.force_shared else "")
        + ("" if joint.friction_expected else ", friction measured"),
        sentence=f"One joint fit of {words.count(len(members), 'spectrum', 'spectra')} gives the "
        f"forces: {_shared(joint, axes)}.",
        reasons=(
            *_why_apart(joint, axes),
            _friction(joint, bead, radius_known=radius_known),
            *_left_out(lateral),
        ),
    )


def _shared(joint: JointFit, axes: Sequence[str]) -> str:
    bead = "all plateaus share the bead's radius and friction, and each axis's tracking noise"
    if len(axes) == 1:
        return f"{bead}; only {axes[0]} is part of it"
    if joint.force_shared:
        return f"x and y of a plateau share one force; {bead}"
    return f"x and y have a force each; {bead}"


def _why_apart(joint: JointFit, axes: Sequence[str]) -> list[str]:
    if joint.force_shared or len(axes) == 1:
        return []
    return [
        "x and y do not share a force, because no joint fit in which they do describes the spectra "
        "(chance below 1 in 1000 if they did): extension, radius or the direction of the field may "
        "be wrong, or the tether is no single molecule"
    ]


def _friction(joint: JointFit, bead: Mapping[str, Any], *, radius_known: bool) -> str:
    if not radius_known:
        return "The setup does not know the bead's radius, so it was fitted along with the friction"
    if joint.friction_expected:
        return (
            "The friction is the one expected from radius, viscosity and height, within its error"
        )
    ratio = words.with_error(bead["friction_ratio"], bead["friction_ratio_stderr"])
    seen = f"; by themselves they show {ratio} times as much" if ratio != words.EMPTY else ""
    return (
        "The friction is measured on this bead, because the spectra contradict the one expected "
        f"from radius, viscosity and height{seen}"
    )


def _left_out(lateral: Sequence[Mapping[str, Any]]) -> list[str]:
    left = [
        words.place(int(row["plateau"]), row["axis"])
        for row in lateral
        if LEFT_OUT in words.flags(row["flags"])
    ]
    if not left:
        return []
    what = (
        "contradicts the others and was fitted by itself"
        if len(left) == 1
        else "contradict the others and were fitted by themselves"
    )
    return [f"{'; '.join(left).capitalize()} {what}"]


def _by_themselves(lateral: Sequence[Mapping[str, Any]]) -> ForceSource:
    known = any(words.is_number(row["extension_nm"]) and row["extension_nm"] > 0 for row in lateral)
    why = (
        "No joint fit was found that describes the spectra, even without the quarter of them that "
        "contradict the others most: bead or tether may have changed during the recording"
        if known
        else "A joint fit needs the extension, which is not known"
    )
    frictions = sorted({words.text(row["method"]).partition(", ")[2] for row in lateral} - {""})
    return ForceSource(
        label="each by itself",
        sentence=f"Each spectrum was fitted by itself ({' or '.join(frictions)}).",
        reasons=(why,),
    )
