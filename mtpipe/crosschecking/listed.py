"""Effects that the setup lists belong to the configured experiment: they are fitted from the start.

Some of them are part of the description itself (`from_setup.DESCRIBED`); the others come
from the catalogue, each with the hypothesis that suits the data best, whatever its strength.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mtpipe.battery import spectral
from mtpipe.battery.observed import Observed, whitened
from mtpipe.configured.courses import force_courses
from mtpipe.configured.hypotheses import best_of
from mtpipe.crosschecking.case import Case
from mtpipe.effects.catalogue import catalogue
from mtpipe.effects.effect import Evidence
from mtpipe.effects.pinned import pinned_sizes, read_sizes, with_pinned
from mtpipe.experiment.from_setup import DESCRIBED
from mtpipe.setup import Setup


def with_listed(case: Case, setup: Setup) -> Case:
    """The case with the setup's further effects fitted along."""
    pinned = pinned_sizes(setup)
    listed = (set(setup.model.effects) | set(pinned)) - set(DESCRIBED)
    for known in catalogue():
        if known.name not in listed:
            continue
        forces = tuple(float(f) for f in case.fit.force_pN)
        evidence = Evidence((), forces)
        if known.name == "vibration":
            evidence = replace(evidence, lines_hz=strongest_lines_hz(case))
        if known.name == "force_drift":
            each, common = force_courses(case.fit, case.positions_nm, case.frame_s)
            evidence = replace(evidence, courses=each, common_course=common)
        held, evidence = read_sizes(known.name, pinned.get(known.name, {}), evidence)
        tried = best_of(case.fit, with_pinned(known, held), evidence)
        if tried is not None:
            case = replace(case, fit=tried.fit)
    return case


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
