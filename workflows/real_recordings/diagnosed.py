"""What the diagnosis makes of real recordings, where nature conceals the effects.

The setup is told nothing of the stage's motion (`staircase.untold`). Of the plateaus those of the
series are taken, which one tether and one bead should describe.

Every function returns lines of Markdown; nothing is written to disk.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from staircase import alone

from mtpipe.diagnosis.explanation import Explanation
from mtpipe.diagnosis.mismatch import Mismatch, diagnose
from mtpipe.diagnosis.unexplained_content import content_of
from mtpipe.recording.recording import Recording

HEAD = (
    "| bead | verdict | named | p before → after | held out (nats) "
    "| forces before (pN) | after (pN) |",
    "| --- | --- | --- | --- | --- | --- | --- |",
)


def series(recording: Recording, beads: Sequence[str]) -> list[str]:
    """Of each bead, what is named, p before and after, and forces before and after; then what is
    left.

    Parameters
    ----------
    recording : of `staircase.series_of`. beads : empty: all that are tethered.
    """
    rows, left = [], []
    for bead in beads or recording.tethered:
        found = diagnose(alone(recording, bead))
        for name, content in found.as_dict()["beads"].items():
            parts = [content["verdict"], *_of_bead(content, found.beads[name])]
            rows.append(f"| {name} | {' | '.join(parts)} |")
        rows += [f"| {name} | refused: {why} | | | | | |" for name, why in found.refused.items()]
        left += _left(found)
    return [*HEAD, *rows, "", *left]


def _of_bead(content: dict[str, Any], bead: Explanation) -> list[str]:
    effects = [*content["effects"], *content["terms"]]
    named = "; ".join(f"{_name(one)} ({_sizes(one)})" for one in effects)
    p_values = f"{bead.before.p_value:.0e} → {bead.after.p_value:.1g}" if effects else "–"
    gains = [one["heldout_gain_nats"] for one in effects]
    return [
        named or "nothing",
        p_values,
        ", ".join("–" if gain is None else f"{gain:.0f}" for gain in gains) or "–",
        _forces(content, "force_before_pN", "stderr_before_pN"),
        _forces(content, "force_pN", "stderr_pN"),
    ]


def _name(one: dict[str, Any]) -> str:
    if "form" in one:
        return f"*{one['form']}* {' from '.join(one['axes'])}"
    names = " or ".join((one["effect"], *one["equivalent"]))
    return f"{names} {100 * one['probability']:.0f} %"


def _sizes(effect: dict[str, Any]) -> str:
    return ", ".join(
        f"{name} {one['value']:.3g} ± {one['stderr']:.1g} {one['unit']}".rstrip()
        for name, one in effect["parameters"].items()
    )


def _forces(content: dict[str, Any], value: str, stderr: str) -> str:
    return ", ".join(
        "–" if one[value] is None else f"{one[value]:.3g} ± {one[stderr]:.1g}"
        for one in content["forces"]
    )


def _left(found: Mismatch) -> list[str]:
    """What is left, in words, and the forces with the smooth correction of the spectra free."""
    lines = []
    for bead, one in found.beads.items():
        if one.unexplained is None:
            continue
        correction = content_of(one.unexplained)["correction"]
        freed = "" if correction is None else f" Forces with it free: {_freed(correction)} pN."
        lines.append(f"- {bead}: {one.unexplained.sentence}{freed}")
    return lines


def _freed(correction: dict[str, Any]) -> str:
    return ", ".join(
        f"{one['corrected_pN']:.3g} ± {one['corrected_stderr_pN']:.1g}"
        for one in correction["forces"]
    )
