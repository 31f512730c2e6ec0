"""Effects that the setup lists belong to the configured experiment: they are fitted from the start.

Three of them are part of the description itself (wall, rotation, tracking noise); the others come
from the catalogue, each with the hypothesis that suits the data best, whatever its strength.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mtpipe.battery import spectral
from mtpipe.battery.observed import Observed, whitened
from mtpipe.configured.courses import force_courses
from mtpipe.configured.hypotheses import best_of
from mtpipe.configured.pinned import with_pinned
from mtpipe.crosschecking.case import Case
from mtpipe.effects.catalogue import catalogue
from mtpipe.effects.effect import Evidence
from mtpipe.errors import SetupError
from mtpipe.experiment.from_setup import DESCRIBED
from mtpipe.setup import Setup


def with_listed(case: Case, setup: Setup) -> Case:
    """The case with the setup's further effects fitted along."""
    pinned = pinned_sizes(setup)
    listed = (set(setup.model.effects) | set(pinned)) - set(DESCRIBED)
    for known in catalogue():
        if known.name not in listed:
            continue
        effect = with_pinned(known, pinned.get(known.name, {}))
        forces = tuple(float(f) for f in case.fit.force_pN)
        evidence = Evidence((), forces)
        if effect.name == "vibration":
            evidence = replace(evidence, lines_hz=strongest_lines_hz(case))
        if effect.name == "force_drift":
            each, common = force_courses(case.fit, case.positions_nm, case.frame_s)
            evidence = replace(evidence, courses=each, common_course=common)
        tried = best_of(case.fit, effect, evidence)
        if tried is not None:
            case = replace(case, fit=tried.fit)
    return case


def pinned_sizes(setup: Setup) -> dict[str, dict[str, float]]:
    """Sizes that `[model.<effect>]` pins, by effect and name; those of tracking noise apart.

    Raises
    ------
    SetupError : one is no number.
    """
    tables = {k: v for k, v in (setup.model.model_extra or {}).items() if k != "tracking_noise"}
    for effect, table in tables.items():
        for name, size in table.items():
            if not isinstance(size, (int, float)):
                raise SetupError(
                    f"[model.{effect}] {name} = {size!r} is no number",
                    mend="Write one, or leave it out: it is fitted then.",
                )
        if table and effect in DESCRIBED:
            raise SetupError(f"[model.{effect}] {min(table)} is no size that can be pinned")
    return {k: {name: float(size) for name, size in v.items()} for k, v in tables.items()}


def strongest_lines_hz(case: Case) -> tuple[float, ...]:
    """The strongest narrow line of all axes and plateaus, be it chance or not."""
    seen = [
        Observed(position, None, offset, data, expected, case.frame_s)
        for position, offset, data, expected in zip(
            case.positions_nm,
            case.camera_offset_nm,
            case.fit.model.data,
            case.fit.expected,
            strict=True,
        )
    ]
    found = [
        (value, float(np.mean(look.band_hz)))
        for look, value in spectral.lines(seen, [whitened(one) for one in seen])
        if look.band_hz is not None and not look.pooled
    ]
    return (max(found)[1],) if found else ()
