"""Probability of a named effect: its weight over that of everything that was weighed.

In an effect's place, and in that of a whole set of causes, may be others, nothing at all, or
something that has no name: a smooth factor on the spectra, with the marginal likelihood that it has
(`smooth_correction`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from mtpipe.crosschecking.check import BeadCheck
from mtpipe.diagnosis.corrections.correction import Correction
from mtpipe.diagnosis.explanation import IMITATED, TEMPERATURE
from mtpipe.diagnosis.prior import CAUSE_NATS, TERM_NATS, UNKNOWN
from mtpipe.diagnosis.smooth_correction import smooth_correction, spectra_of
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import FittedEffect


def odds_against(
    one: FittedEffect,
    tried: Sequence[FittedEffect],
    named: Collection[str],
    without: ConfiguredFit,
    left_smooth: float,
) -> float:
    """Weight of all that is in this effect's place and not named, over the effect's.

    Parameters
    ----------
    one : the effect, beside the others that are named. tried : all in its place.
    named : names of those that are. without : fit without the effect, with the others.
    left_smooth : what a smooth factor gains beside all of them (`smooth_gain`), nats.
    """
    others = [
        other.net - one.net - (TERM_NATS - CAUSE_NATS if other.effect.form else 0.0)
        for other in tried
        if other.effect.name not in named
    ]
    unnamed = unknown_nats(without, left_smooth, one.net)
    nothing = CAUSE_NATS - one.net
    return IMITATED + sum(weight(nats) for nats in (*others, unnamed, nothing))


def unknown_nats(without: ConfiguredFit, left_smooth: float, worth: float) -> float:
    """By how many nats something smooth that has no name is likelier than causes.

    Parameters
    ----------
    without : fit without the causes. left_smooth : what a smooth factor gains beside them.
    worth : what they gain, less their price.
    """
    return smooth_gain(without) - left_smooth - worth + math.log(UNKNOWN)


def odds_against_correction(found: Correction, before: BeadCheck) -> float:
    """Of an effect that is seen in time: the bound on the odds that its p-value, or else that of
    the bead's check, leaves to chance.

    −e p ln p (Sellke, Bayarri & Berger 2001, Am. Stat. 55, 62).
    """
    p_value = before.p_value if found.chance_p is None else found.chance_p
    p = min(max(p_value, 1e-300), 1 / math.e)
    return IMITATED - math.e * p * math.log(p)


def weight(nats: float) -> float:
    """Weight of something, beside a weight of 1, from the difference of their ln likelihoods."""
    return math.exp(min(max(nats / TEMPERATURE, -300.0), 300.0))


def smooth_gain(fit: ConfiguredFit) -> float:
    """ln of the marginal likelihood that a smooth factor on the spectra gains, in nats."""
    correction = smooth_correction(spectra_of(fit))
    return 0.0 if correction is None else correction.gain_nats
