"""Whether traces show the single events of an effect, or only motion that has its power."""

from __future__ import annotations

from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.diagnosis.causes import Causes
from mtpipe.diagnosis.explanation import ALIKE_NATS
from mtpipe.effects.effect import Effect
from mtpipe.joint_fit.fit import ConfiguredFit


def unseen(case: PreparedBead, effect: Effect, fit: ConfiguredFit) -> bool:
    """Whether Gaussian motion with the power of an effect's events is clearly likelier than these.

    Parameters
    ----------
    case : whose traces they are. fit : with the effect.
    """
    if effect.single is None:
        return False
    experiment = fit.model.described(fit.theta)
    heights = [position[:, 2] for position in case.positions_nm]
    return effect.single(experiment, fit.force_pN.tolist(), case.frame_s, heights) < -ALIKE_NATS


def unseen_member(case: PreparedBead, causes: Causes) -> str:
    """The name of a member of a set whose events the traces do not show; empty: none."""
    unseen_ones = (
        one.effect.name for one in causes.members if unseen(case, one.effect, causes.fit)
    )
    return next(unseen_ones, "")
