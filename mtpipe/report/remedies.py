"""What to do about a cause that was named: how to confirm it, and what to change in the setup."""

from __future__ import annotations

from mtpipe.corrections.catalogue import REMEDIES
from mtpipe.effects.catalogue import catalogue

PHYSICS = "if you expect it of this experiment, list {effect} under [model] effects in the setup."


def remedy(effect: str) -> str:
    """What to do about an effect of the catalogue, or one that another package brought."""
    known = REMEDIES | {one.name: one.remedy for one in catalogue()}
    return known.get(effect) or PHYSICS.format(effect=effect)
