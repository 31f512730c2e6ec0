"""Known effects put into real recordings: are they named on top of what nature put there?

    python workflows/injections/study.py --results runs/injections --count 12 --seed 1
    python workflows/injections/study.py --results runs/injections --beads cmaddry-run2/b1

Each bead is diagnosed as it was recorded, and with one effect of `injections.py` at one of three
strengths. Named rightly is one whose name is there and was not before, or whose size has changed by
what was put in. A name that is new and was not put in is a wrong one. Answers are written beside
the recordings' (`RESULTS/*.json`); what is there is not done again. Needs ../shared/recordings;
nothing of these is kept but names and numbers.
"""

from __future__ import annotations

import argparse
import functools
import json
import math
import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from injections import INJECTIONS, Injection, injected

CHECKOUT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CHECKOUT / "workflows" / "real_recordings"))
os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")

from staircase import alone, series_of  # noqa: E402

from mtpipe.diagnosis.mismatch import diagnose  # noqa: E402
from mtpipe.recording.recording import Recording  # noqa: E402

# Tethers that are described as they were recorded (docs/real-recordings.md), and so have names to
# which one may be added; their recordings have setups in the repository.
BEADS = (
    "cmaddry-run2/b1", "cmaddry-run1/b1", "cmaddry-run1/b2", "cmaddry-march/b1", "cmaddry-march/b2",
    "cmaddry-march/b3",
)  # fmt: skip
STRENGTHS = ("weak", "moderate", "strong")
# Sizes this many standard errors from what was put in are not recovered.
NEAR = 2.0


def main() -> None:
    """Run what is missing, and print."""
    parser = argparse.ArgumentParser(description="Known effects put into real recordings.")
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--count", type=int, default=12, help="injections, drawn by the seed")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--beads", nargs="+", choices=BEADS, default=BEADS)
    parser.add_argument("--strengths", nargs="+", choices=STRENGTHS, default=STRENGTHS)
    shared = CHECKOUT.parent / "shared" / "recordings"
    parser.add_argument("--recordings", type=Path, default=shared)
    choice = parser.parse_args()
    choice.results.mkdir(parents=True, exist_ok=True)
    drawn = list(_drawn(choice.seed, choice.count, choice.beads, choice.strengths))
    unchanged = [(bead, "", 0.0) for bead in dict.fromkeys(bead for bead, _, _ in drawn)]
    for of_recording, kind, strength in [*unchanged, *drawn]:
        path = _path(choice.results, of_recording, kind, strength)
        if path.exists():
            continue
        name, bead = of_recording.split("/")
        recording = _recorded(name, choice.recordings)
        changed = injected(recording, bead, kind, strength, choice.seed) if kind else recording
        found = diagnose(alone(changed, bead))
        path.write_text(json.dumps(found.as_dict()["beads"].get(bead, {"effects": []})))
    print("\n".join(_table(choice.results, drawn)))


@functools.lru_cache(maxsize=1)
def _recorded(name: str, recordings: Path) -> Recording:
    return series_of(name, recordings)


def _drawn(
    seed: int, count: int, beads: Sequence[str], strengths: Sequence[str]
) -> Iterator[tuple[str, str, float]]:
    every = [
        (bead, kind, one.strengths[STRENGTHS.index(strength)])
        for kind, one in INJECTIONS.items()
        for strength in strengths
        for bead in beads
    ]
    for i in np.random.default_rng(seed).permutation(len(every))[:count]:
        yield every[i]


def _path(results: Path, bead: str, kind: str, strength: float) -> Path:
    return results / f"{bead.replace('/', '_')}_{kind or 'as_recorded'}_{strength:g}.json"


def _table(results: Path, drawn: list[tuple[str, str, float]]) -> list[str]:
    """Of each injection, what became of it; then how many of each strength are named."""
    lines = [
        "| bead | put in | strength | verdict | named | size (pull) | new names not put in |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    named, asked, wrong = Counter[int](), Counter[int](), 0
    for bead, kind, strength in drawn:
        before = _read(_path(results, bead, "", 0.0))
        after = _read(_path(results, bead, kind, strength))
        one, level = INJECTIONS[kind], INJECTIONS[kind].strengths.index(strength)
        names = _names(after)
        new = sorted(set(names) - set(_names(before)) - {one.effect})
        wrong += bool(new)
        size, right = "–", not one.effect
        if one.effect:
            asked[level] += 1
            if one.effect in names:
                pull = _pull(one, strength, _names(before).get(one.effect), names[one.effect])
                right = one.effect not in _names(before) or abs(pull) < NEAR
                size = f"{pull:+.1f}"
            named[level] += right
        lines.append(
            f"| {bead} | {one.effect or 'tracking noise (listed)'} | {strength:g} "
            f"| {after.get('verdict', 'refused')} | {'yes' if right else 'no'} | {size} "
            f"| {', '.join(new) or '–'} |"
        )
    shares = ", ".join(f"{STRENGTHS[k]} {named[k]} of {asked[k]}" for k in sorted(asked))
    return [*lines, "", f"Named: {shares}. With a new name that was not put in: {wrong}."]


def _read(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text())
    return content


def _names(content: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {
        name: one["parameters"]
        for one in content["effects"]
        for name in (one["effect"], *one["equivalent"])
    }


def _pull(
    one: Injection, strength: float, own: dict[str, Any] | None, found: dict[str, Any]
) -> float:
    """How far the size is from nature's own and the injected together, in standard errors."""
    value, stderr = _size(found, one.size)
    if not stderr:
        return math.nan
    natural, unsure = (one.none, 0.0) if own is None else _size(own, one.size)
    if math.isnan(natural):
        natural, unsure = one.none, 0.0
    return float((value - one.together(natural, strength)) / math.hypot(stderr, unsure))


def _size(found: dict[str, Any], name: str) -> tuple[float, float]:
    """Value and standard error of a parameter; of the scale along y, that over the one along x, as
    an injected scale is seen by their ratio alone. nan and 0 where it is not there.
    """
    size = found.get(name)
    if size is None:
        return math.nan, 0.0
    if name != "factor_y":
        return size["value"], size["stderr"]
    other = found["factor_x"]
    ratio = size["value"] / other["value"]
    return ratio, ratio * math.hypot(
        size["stderr"] / size["value"], other["stderr"] / other["value"]
    )


if __name__ == "__main__":
    main()
