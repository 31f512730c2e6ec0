"""What to do about a cause that was named: how to confirm it, and what to change in the setup."""

from __future__ import annotations

import re

from mtpipe.diagnosis.corrections.catalogue import REMEDIES
from mtpipe.effects.catalogue import catalogue
from mtpipe.setup.measured import Measured
from mtpipe.setup.setup import Setup

PHYSICS = "if you expect it of this experiment, list {effect} under [model] effects in the setup."


def remedy(effect: str) -> str:
    """What to do about an effect of the catalogue, or one that another package brought."""
    known = REMEDIES | {one.name: one.remedy for one in catalogue()}
    return known.get(effect) or PHYSICS.format(effect=effect)


def stated(effect: str, setup: Setup) -> str:
    """What the setup says of the value that a remedy tells to correct; else empty."""
    key = re.search(r"correct \[(\w+)\] (\w+)", remedy(effect))
    value = getattr(getattr(setup, key[1], None), key[2], None) if key else None
    if key is None or not isinstance(value, Measured) or value.value is None:
        return ""
    return f" The setup says {key[2]} = {value.value:.10g}."
