"""exp and ln of whole arrays, compiled so that the processor does several at once.

numba calls the C library for each number, which was most of what an expected spectrum cost. These
are the textbook's: the argument is reduced by a power of two, the rest is a polynomial (Muller
2016, Elementary Functions, chapters 10 and 11). Right to 4e-16 of the value, ln to 4e-16 of the
larger of the value and 1.
"""

from __future__ import annotations

import math

import numpy as np

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray

LOG2_E = 1 / math.log(2)
# ln 2 in two parts; the first is short enough in bits for its multiples to be exact.
LN2_HIGH, LN2_LOW = 0.693147180369123816490, 1.90821492927058770002e-10
# Beyond, a power of two is no normal number.
LARGEST = 700.0
# Coefficients of exp(r) for |r| <= ln 2/2, and of ln((1 + s)/(1 − s))/s in s² for |s| < 0.172.
E = tuple(1 / math.factorial(j) for j in range(14))
L = tuple(2 / (2 * j + 1) for j in range(12))
# Of a number of 64 bits: where its exponent begins, the exponent of 1, and the fraction.
EXPONENT_BITS, BIAS, FRACTION = 52, 1023, (1 << 52) - 1
ONE = BIAS << EXPONENT_BITS
SQRT2 = math.sqrt(2)


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


@compiled
def logarithms(x: FloatArray, out: FloatArray) -> None:
    """ln of (n,) positive normal numbers, into `out` (n,)."""
    fractions = np.empty(len(x))
    bits, kept = x.view(np.int64), fractions.view(np.int64)
    for i in range(len(x)):
        kept[i] = (bits[i] & FRACTION) | ONE
    for i in range(len(x)):
        power = float((bits[i] >> EXPONENT_BITS) - BIAS)
        fraction = fractions[i]
        halved = fraction > SQRT2
        fraction = 0.5 * fraction if halved else fraction
        power = power + 1.0 if halved else power
        s = (fraction - 1.0) / (fraction + 1.0)
        square = s * s
        series = ((L[11] * square + L[10]) * square + L[9]) * square + L[8]
        series = ((series * square + L[7]) * square + L[6]) * square + L[5]
        series = ((series * square + L[4]) * square + L[3]) * square + L[2]
        series = (series * square + L[1]) * square + L[0]
        out[i] = power * LN2_HIGH + (s * series + power * LN2_LOW)
