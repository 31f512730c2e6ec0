"""exp of whole arrays, compiled so that the processor does several at once.

numba calls the C library for each number, which was most of what an expected spectrum cost. This is
the textbook's: the argument is reduced by a power of two, the rest is a polynomial (Muller 2016,
Elementary Functions, chapter 10). Right to 4e-16 of the value.
"""

from __future__ import annotations

import math

import numpy as np

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray

LOG2_E = 1 / math.log(2)
# ln 2 in two parts; the first has so few digits that its multiples are exact.
LN2_HIGH, LN2_LOW = 0.693147180369123816490, 1.90821492927058770002e-10
# Beyond, a power of two is no normal number.
LARGEST = 700.0
# Coefficients of exp(r) for |r| <= ln 2/2.
E = tuple(1 / math.factorial(j) for j in range(14))
EXPONENT_BITS, BIAS = 52, 1023


@compiled
def exponentials(x: FloatArray) -> None:
    """e^x of (n,) in place; of what is beyond ±700, e^±700."""
    powers = np.empty(len(x), dtype=np.int64)
    for i in range(len(x)):
        value = min(max(x[i], -LARGEST), LARGEST)
        power = np.floor(value * LOG2_E + 0.5)
        rest = (value - power * LN2_HIGH) - power * LN2_LOW
        # written out: a loop over coefficients would keep this one from being done several at once
        series = ((E[13] * rest + E[12]) * rest + E[11]) * rest + E[10]
        series = ((series * rest + E[9]) * rest + E[8]) * rest + E[7]
        series = ((series * rest + E[6]) * rest + E[5]) * rest + E[4]
        series = ((series * rest + E[3]) * rest + E[2]) * rest + E[1]
        x[i] = series * rest + E[0]
        powers[i] = (np.int64(power) + BIAS) << EXPONENT_BITS
    scale = powers.view(np.float64)
    for i in range(len(x)):
        x[i] *= scale[i]
