"""Whether traces show the single events of an effect, or only motion that has its power."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from mtpipe.crosschecking.prepared_bead import PreparedBead, described
from mtpipe.crosschecking.twin import TwinMaker
from mtpipe.diagnosis.causes import Causes
from mtpipe.diagnosis.explanation import ALIKE_NATS
from mtpipe.diagnosis.prior import CAUSE_NATS, TERM_NATS
from mtpipe.diagnosis.probability import weight
from mtpipe.effects.effect import SingleEvents
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import FittedEffect

# Simulations with events, and as many with Gaussian motion of their power: means and spreads of
# what distinguishes them are known to a fifth.
SIMULATIONS = 24
# Nats by which Gaussian motion has to be likelier for events to count as unseen: traces that cannot
# tell the two apart give about 0.
UNSEEN_NATS = 1.0


def unseen_member(
    case: PreparedBead,
    causes: Causes,
    weighed: Iterable[Causes],
    random: np.random.Generator,
) -> str:
    """The name of a member of a set whose events the traces do not show; empty: none.

    Events that traces do not clearly show fit as many recordings as a term does, and have to cost
    as much: a set with a term in their place is preferred if it is likelier at equal cost.

    Parameters
    ----------
    case : of the bead, with any fit. weighed : other sets. random : of the simulations.
    """
    for one in causes.members:
        single = one.effect.single
        if single is None:
            continue
        try:
            nats = seen_nats(replace(case, fit=causes.fit), single, random)
        except (FitError, ValueError):
            continue
        if nats < -UNSEEN_NATS or (nats < ALIKE_NATS and _formed(one, causes, weighed)):
            return one.effect.name
    return ""


def _formed(one: FittedEffect, causes: Causes, weighed: Iterable[Causes]) -> bool:
    """Whether a set with a term in a member's place is likelier if the member costs as much as the
    term.
    """
    rest = causes.names - {one.effect.name}
    dearer = causes.score - (TERM_NATS - CAUSE_NATS)
    return any(
        other.score > dearer
        and rest < other.names
        and one.effect.name not in other.names
        and all(member.effect.form for member in other.members if member.effect.name not in rest)
        for other in weighed
    )


def odds_of_smooth(
    case: PreparedBead, fit: ConfiguredFit, one: FittedEffect, random: np.random.Generator
) -> float:
    """Weight of Gaussian motion that has the power of an effect's events, over that of the events:
    where traces do not clearly show these, they have cost as much as a term, and are as likely.

    Parameters
    ----------
    case : of the bead, with any fit. fit : with all that is named.
    """
    if one.effect.single is None:
        return 0.0
    try:
        nats = seen_nats(replace(case, fit=fit), one.effect.single, random)
    except (FitError, ValueError):
        return 0.0
    return weight(-nats) if nats < ALIKE_NATS else 0.0


def seen_nats(case: PreparedBead, single: SingleEvents, random: np.random.Generator) -> float:
    """By how much events are likelier than Gaussian motion that has their power, as their
    simulations say.

    Parameters
    ----------
    case : with the fit of the events.

    Raises
    ------
    FitError, ValueError : the bead cannot be simulated.
    """
    model = case.fit.model
    smooth = replace(model, experiment=single.smooth(model.experiment))
    seen = _nats(case, single, case.positions_nm)
    found = []
    for one in (case, replace(case, fit=replace(case.fit, model=smooth))):
        maker = TwinMaker(one)
        twins = [maker.draw(random).positions_nm for _ in range(SIMULATIONS)]
        values = [_nats(case, single, twin) for twin in twins]
        # both are 0 if hops are not looked for
        spread = max(float(np.std(values, ddof=1)), 1e-6)
        found.append(stats.t.logpdf((seen - np.mean(values)) / spread, SIMULATIONS - 1))
        found[-1] -= np.log(spread)
    return float(found[0] - found[1])


def _nats(case: PreparedBead, single: SingleEvents, positions: Sequence[FloatArray]) -> float:
    heights = [position[:, 2] for position in positions]
    return single.nats(described(case), case.fit.force_pN.tolist(), case.frame_s, heights)
