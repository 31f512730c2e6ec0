"""Whether mean heights are off by more than positions are seen to wander.

Drift, and motion of the reference, leave mean heights free to wander. What is wrong with heights
for another reason can then be taken for either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mtpipe.diagnosis.explanation import ALIKE_NATS
from mtpipe.effects import drift, reference_noise
from mtpipe.effects.effect import Evidence
from mtpipe.experiment.changes import with_stage
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit, exchanged, fit_configured
from mtpipe.joint_fit.hypotheses import TRIED_NATS, FittedEffect

# Errors of mean heights that are tried.
SCATTERS_NM = (1.0, 3.0, 10.0, 30.0)


def wanders(fit: ConfiguredFit) -> bool:
    """Whether the bead or its reference moves by itself up and down, so that heights are free."""
    stage = fit.model.described(fit.theta).stage
    return stage.unsubtracted_nm_per_root_s[2] > 0 or stage.reference_nm[2] > 0


def gained_by_scatter(fit: ConfiguredFit, named: Sequence[FittedEffect]) -> float:
    """ln likelihood gained were each plateau's mean height off by something of its own (nats).

    0 where heights are not free to wander, and about 0 where they are off by no more than
    positions are seen to wander within plateaus. Motion of the reference that is not seen to relax
    would free the heights by itself: where a walk and such heights fit as well, it is what the walk
    gains.

    Parameters
    ----------
    named : effects that the fit contains.
    """
    if not wanders(fit):
        return 0.0
    gained = _gained(fit)
    for one in named:
        walk = _as_a_walk(fit, one) if one.effect == reference_noise.EFFECT else None
        if walk is not None:
            beside = _gained(walk)
            if walk.log_likelihood + beside > fit.log_likelihood - ALIKE_NATS:
                gained = max(gained, beside)
    return gained


def _gained(fit: ConfiguredFit) -> float:
    gains = [0.0]
    for scatter_nm in SCATTERS_NM:
        model = replace(fit.model, height_scatter_nm=scatter_nm)
        try:
            found = fit_configured(model, fit.theta, arrived=TRIED_NATS)
        except (FitError, ValueError):
            continue
        gains.append(found.log_likelihood - fit.log_likelihood)
    return max(gains)


def _as_a_walk(fit: ConfiguredFit, one: FittedEffect) -> ConfiguredFit | None:
    """The fit with a walk of the bead's own in the place of the reference's motion."""
    model = fit.model
    still = with_stage(model.experiment, reference_nm=(0.0, 0.0, 0.0))
    walks = drift.EFFECT.hypotheses(still, Evidence((), tuple(fit.force_pN)))
    own = {parameter.name for parameter in one.hypothesis.parameters}
    own |= {parameter.name for walk in walks for parameter in walk.parameters}
    kept = [k for k, parameter in enumerate(model.parameters) if parameter.name not in own]
    added = [parameter for walk in walks for parameter in walk.parameters]
    try:
        return exchanged(fit, still, kept, added, arrived=TRIED_NATS)
    except (FitError, ValueError):
        return None
