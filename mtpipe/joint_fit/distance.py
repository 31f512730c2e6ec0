"""How far a fit is from the data."""

from __future__ import annotations

import numpy as np
from scipy import special

from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.model import random_part


def missing_nats(fit: ConfiguredFit) -> float:
    """ln likelihood that is missing to a spectrum that fits as well as chance allows."""
    heights = fit.model.heights(fit.model.data, fit.expected, fit.theta)
    total = 0.5 * float(np.sum(heights.pulls**2 - 1))
    for data, model, ends in zip(fit.model.data, fit.expected, heights.ends, strict=True):
        n, expected = data.spectrum.ordinates[:, None], model.random_power
        recorded = random_part(data, model, ends)
        power = np.diagonal(recorded, axis1=1, axis2=2)
        ratio = power / np.diagonal(expected, axis1=1, axis2=2)
        missing = n * (ratio - 1 - np.log(np.maximum(ratio, 1e-12)))
        total += float(np.sum(missing - n * (np.log(n) - special.digamma(n))))
        cross = recorded - expected
        for a, b in ((0, 1), (0, 2), (1, 2)):
            size = expected[:, a, a] * expected[:, b, b]
            total += float(np.sum(n[:, 0] * cross[:, a, b] ** 2 / size - 0.5))
    return total
