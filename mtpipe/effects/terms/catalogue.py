"""All terms that can be tried."""

from __future__ import annotations

import itertools

from mtpipe.effects.effect import Effect
from mtpipe.effects.terms import by_plateau, course, lorentzian, power_law, step, turning, white
from mtpipe.effects.terms.mixing import gain_along, share_in

TERMS: tuple[Effect, ...] = (
    *(lorentzian.along(axis) for axis in range(3)),
    *(power_law.along(axis) for axis in range(3)),
    power_law.of_all(),
    *(white.along(axis) for axis in range(3)),
    *(gain_along(axis) for axis in range(3)),
    *(step.gain_along(axis) for axis in range(3)),
    *(step.share_in(2, other) for other in (0, 1)),
    *(step.scatter_along(axis) for axis in range(3)),
    *(step.wander_along(axis) for axis in range(3)),
    by_plateau.wander_along(2),
    by_plateau.gain_along(2),
    *(share_in(*pair) for pair in itertools.permutations(range(3), 2)),
    turning.aside(),
    course.of_friction(),
    course.of_length(),
)
