"""Why a fitted effect is not named, in words that continue "it …"."""

from __future__ import annotations

from mtpipe.diagnosis.explanation import Named
from mtpipe.diagnosis.heldout import explained_share
from mtpipe.joint_fit.hypotheses import FittedEffect


def gains_in_words(one: FittedEffect) -> str:
    """What a fitted effect gains, in words."""
    return f"gains {one.gain:.0f} in ln likelihood"


def too_little(one: FittedEffect, needed: float) -> str:
    """Why an effect's gain does not pay for its numbers, in words.

    Parameters
    ----------
    needed : of nats.
    """
    numbers = one.hypothesis.numbers
    gains = f"gains {one.gain:.1f} in ln likelihood" if one.gain >= 0.05 else "gains nothing"
    what = "parameter" if numbers == 1 else f"{numbers} parameters"
    return f"{gains}, too little for its {what} ({needed:.1f} are needed)"


def heights_off(one: Named, scatter: float) -> str:
    """How far mean heights are off after a fitted effect, in words."""
    return (
        f"explains {max(explained_share(one.before, one.after), 0.0):.0%} of the misfit, but mean "
        "heights scatter by more than positions wander within plateaus (ln likelihood is higher by "
        f"{scatter:.0f} if each height has an error of its own)"
    )
