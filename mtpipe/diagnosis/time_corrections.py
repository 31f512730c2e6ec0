"""What is seen in time and not in spectra, taken off the traces before and beside effects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mtpipe.crosschecking.check import BeadCheck, check_bead, comparable_p_values, foreseen_p_value
from mtpipe.diagnosis.corrections.catalogue import CORRECTIONS, LATE_CORRECTIONS, Find
from mtpipe.diagnosis.corrections.correction import Correction
from mtpipe.diagnosis.corrections.retraced import with_positions
from mtpipe.diagnosis.explanation import ALARM_P, Named

# A correction is kept where it halves ln p; one that a test of its own has seen, where it does not
# double ln p. One of the first kind is simulated only if, beside the simulations of the
# uncorrected traces, ln p falls to 0.8 of what it was.
MOST_OF_THE_ODDITY, HARDLY_LESS_ODD = 0.5, 0.8


def corrected(
    check: BeadCheck, random: np.random.Generator, finds: Sequence[Find] = CORRECTIONS
) -> tuple[list[Named], BeadCheck]:
    """Take off what is seen in time and not in spectra, as far as the battery objects less then.

    What is found has passed a test of its own, so the battery need not have objected before.

    Parameters
    ----------
    finds : corrections that are looked for.
    """
    named = []
    for find in finds:
        found = find(check)
        if found is None or (found.chance_p is None and _hardly_helps(check, found)):
            continue
        after = check_bead(found.case, random)
        p_before, p_after = comparable_p_values(check, after)
        most = MOST_OF_THE_ODDITY if found.chance_p is None else 1 / MOST_OF_THE_ODDITY
        if after.p_value >= ALARM_P or p_after > p_before**most:
            named.append(Named(found, (), check, after, float("nan")))
            check = after
    return named, check


def _hardly_helps(check: BeadCheck, found: Correction) -> bool:
    lost = [
        [np.isnan(position) for position in case.positions_nm] for case in (check.case, found.case)
    ]
    if any(not np.array_equal(here, there) for here, there in zip(*lost, strict=True)):
        # simulations lose what the recording has lost
        return False
    foreseen = foreseen_p_value(check, found.case)
    return foreseen < min(ALARM_P, math.pow(check.p_value, HARDLY_LESS_ODD))


def late_corrections(
    check: BeadCheck,
    corrections: Sequence[Named],
    begun: BeadCheck,
    random: np.random.Generator,
    finds: Sequence[Find] = (),
    curves: bool = True,
) -> list[Named]:
    """Corrections that are of use once effects are there, as they are without these.

    Parameters
    ----------
    check : with effects. corrections : taken off already. begun : with these, without effects.
    finds : corrections that are looked for. curves : also those that are only seen beside effects.
    """
    taken = {one.name for one in corrections}
    late = [partial(find, random=random) for find in LATE_CORRECTIONS if curves]
    found = [one for one in corrected(check, random, [*finds, *late])[0] if one.name not in taken]
    named: list[Named] = []
    for one in found:
        before = named[-1].after if named else begun
        without = with_positions(begun.case, one.after.case.positions_nm)
        named.append(replace(one, before=before, after=check_bead(without, random)))
    return named


def hold_by_themselves(corrections: Sequence[Named]) -> bool:
    """Whether corrections may be named beside a rest that is unexplained: a test of its own tells
    one from all else, and with them the recording is no further from its simulation, as it would be
    if the rest were what that test has seen.
    """
    tested = any(
        isinstance(one.found, Correction) and one.found.chance_p is not None and not one.form
        for one in corrections
    )
    return tested and corrections[-1].after.p_value >= corrections[0].before.p_value
