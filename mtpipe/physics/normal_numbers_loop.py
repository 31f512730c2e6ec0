"""The loop of `mtpipe.physics.normal_numbers`, compiled."""

from __future__ import annotations

import numpy as np

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray


@compiled
def fill(random: np.random.Generator, numbers: FloatArray) -> None:
    """Overwrite (n,) numbers by standard normal ones."""
    for i in range(len(numbers)):
        numbers[i] = random.standard_normal()
