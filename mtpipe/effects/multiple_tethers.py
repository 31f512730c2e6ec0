"""More than one molecule holds the bead: n equal chains pull like one of Lp/n (PHYSICS E17)."""

from __future__ import annotations

from functools import partial

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, logarithm
from mtpipe.experiment.changes import with_chain
from mtpipe.experiment.description import Experiment

FEWEST, MOST = 1.4, 6.0


def _change(single_nm: float, experiment: Experiment, number: float) -> Experiment:
    return with_chain(experiment, persistence_length_nm=single_nm / number)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    change = partial(_change, experiment.chain.persistence_length_nm)
    number = logarithm("number of tethers", "", 2.0, (FEWEST, MOST), change)
    return [Hypothesis(experiment, (number,))]


def _cause(experiment: Experiment) -> str:
    return (
        "more than one molecule holds the bead: the tether is as stiff as if its persistence "
        f"length were {experiment.chain.persistence_length_nm:.1f} nm"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("equivalent_persistence_length_nm", experiment.chain.persistence_length_nm, "nm")]


_REMEDY = (
    "turn the magnets: the extension of a bead on two tethers drops with the turns. "
    "Leave the bead out if it does."
)
EFFECT = Effect("multiple_tethers", _hypotheses, _cause, _strengths, remedy=_REMEDY)
