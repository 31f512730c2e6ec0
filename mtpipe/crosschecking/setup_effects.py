"""Effects that the setup lists belong to the configured experiment: they are fitted from the start.

Some of them are part of the description itself (`setup.tables.DESCRIBED`); the others come
from the catalogue, each with the hypothesis that suits the data best, whatever its strength.
"""

from __future__ import annotations

from dataclasses import replace

from mtpipe.crosschecking.lines import distinct_lines, strongest_lines, with_line_bins
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.effects.catalogue import catalogue
from mtpipe.effects.effect import Evidence
from mtpipe.effects.setup_sizes import pinned_sizes, read_sizes, with_pinned
from mtpipe.joint_fit.courses import force_courses
from mtpipe.joint_fit.hypotheses import best_of
from mtpipe.setup.setup import Setup
from mtpipe.setup.tables import DESCRIBED


def with_listed(case: PreparedBead, setup: Setup) -> PreparedBead:
    """The case with the setup's further effects fitted along."""
    pinned = pinned_sizes(setup)
    listed = (set(setup.model.effects) | set(pinned)) - set(DESCRIBED)
    for known in catalogue():
        if known.name not in listed:
            continue
        forces = tuple(float(f) for f in case.fit.force_pN)
        evidence = Evidence((), forces, focus=case.focus, heights_nm=case.heights_nm)
        if known.read is not None:
            each, common = force_courses(case.fit, case.positions_nm, case.frame_s)
            lines_hz = tuple(line_hz for _, line_hz in strongest_lines(case)[:1])
            evidence = replace(evidence, lines_hz=lines_hz, courses=each, common_course=common)
        held, evidence = read_sizes(known, pinned.get(known.name, {}), evidence)
        case = with_line_bins(case, distinct_lines((*evidence.lines_hz, *case.lines_hz)))
        tried = best_of(case.fit, with_pinned(known, held), evidence)
        if tried is not None:
            case = replace(case, fit=tried.fit)
    return case
