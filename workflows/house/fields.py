"""How many files know what is an effect's own: fields of the description that only it changes.

    python workflows/house/fields.py

Each effect of the catalogue is given to an experiment; what it changes there are its fields.
Counted are the files of mtpipe, apart from the effect's and the description's own, that name one as
a field of the description: `fluid.memory`, `with_fluid(…, memory=…)`, `Fluid(…, memory=…)` or
`replace(….fluid, memory=…)`. Setups, plans of a measurement and traces have some of the same name;
a file without the word `experiment` has no description.
"""

from __future__ import annotations

import math
import re
from dataclasses import fields, is_dataclass
from pathlib import Path
from statistics import median
from typing import Any

import mtpipe
from mtpipe.effects.catalogue import OWN
from mtpipe.effects.effect import Evidence
from mtpipe.experiment.description import Experiment, ForceCourse
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.setup.setup import parse_setup

PACKAGE = Path(mtpipe.__file__).parent
DESCRIPTION = ("experiment/description.py", "physics/tether.py", "physics/camera.py")
FORCES_PN = (0.05, 1.0, 5.0, 10.0)
SETUP = {
    "schema": 1,
    "camera": {"frame_rate_hz": 4000.0, "exposure_s": 1 / 5000},
    "beads": {"radius_nm": 1400.0, "reference": ["ref1"]},
    "tether": {"contour_length_nm": 2700.0, "persistence_length_nm": 50.0},
    "buffer": {"temperature_K": 298.15, "viscosity_mPa_s": 0.9},
    "field": {"direction": "x"},
}


def main() -> None:
    """Print each effect's fields and the files that know them."""
    texts = {
        path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8")
        for path in PACKAGE.rglob("*.py")
    }
    counts = []
    for effect in OWN:
        own = sorted(set().union(*(fields_of(*pair) for pair in given(effect))))
        known = sorted(
            name
            for name, text in texts.items()
            if name not in (f"effects/{effect.name}.py", *DESCRIPTION) and "experiment" in text
            if any(re.search(_use(*one), text) for one in own)
        )
        counts.append(len(known))
        names = ", ".join(field for _, field in own) or "–"
        print(f"{effect.name:26} {names:44} {len(known):2} {', '.join(known)}")
    print(f"median {median(counts):g}")


def given(effect: Any) -> list[tuple[Experiment, Experiment]]:
    """The experiment without and with an effect, one pair for each hypothesis."""
    listed = {"wall_drag", "rotation_coupling", "anharmonic_tether", "tracking_noise"}
    content = SETUP | {"model": {"effects": sorted(listed - {effect.name})}}
    experiment, _ = experiment_of(parse_setup(content), list(FORCES_PN), 4096)
    courses = tuple(ForceCourse(0.1 * (i + 1)) for i in range(len(FORCES_PN)))
    evidence = Evidence((50.0,), FORCES_PN, courses=courses, common_course=ForceCourse(0.2))
    pairs = []
    for hypothesis in effect.hypotheses(experiment, evidence):
        changed = hypothesis.experiment
        for parameter in hypothesis.parameters:
            moved = parameter.start + 0.3 * (parameter.upper - parameter.start)
            changed = parameter.change(changed, moved)
        pairs.append((experiment, changed))
    return pairs


def fields_of(one: Any, other: Any, part: str = "experiment") -> set[tuple[str, str]]:
    """The innermost fields in which two descriptions differ: part of the description, and name."""
    found: set[tuple[str, str]] = set()
    for field in fields(one):
        here, there = getattr(one, field.name), getattr(other, field.name)
        if _same(here, there):
            continue
        if is_dataclass(here) and type(here) is type(there):
            found |= fields_of(here, there, field.name)
        elif field.name != "steps":  # a step is in the effect's own file
            found.add((part, field.name))
    return found


def _use(part: str, field: str) -> str:
    """Pattern of a field of a part of the description, read or changed."""
    inside = r"(?:[^()]|\([^()]*\))*"
    changed = rf"(?:with_{part}\(|{part.capitalize()}\(|replace\([\w.]*\b{part},)"
    return rf"\b{part}\.{field}\b|\b{changed}{inside}\b{field}="


def _same(here: Any, there: Any) -> bool:
    both = isinstance(here, float) and isinstance(there, float)
    return here == there or (both and math.isclose(here, there, rel_tol=1e-12))


if __name__ == "__main__":
    main()
