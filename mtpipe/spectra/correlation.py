"""How alike successive frames of a trace with gaps are."""

from __future__ import annotations

import numpy as np

from mtpipe.ground.types import FloatArray


def lag_one_correlation(deviation_nm: FloatArray) -> float:
    """Correlation of successive frames, between −1 and 1; 0 of a trace that never moves.

    Products and squares are summed over the same frames. Otherwise, where frames are lost or the
    trace is a few relaxations long, the ratio of a slow trace may come out above 1.

    Parameters
    ----------
    deviation_nm : (n,) from the mean, NaN where lost.
    """
    earlier, later = deviation_nm[:-1], deviation_nm[1:]
    products = earlier * later
    both = np.isfinite(products)
    squares = float(np.sum(earlier[both] ** 2) + np.sum(later[both] ** 2))
    return 2 * float(np.sum(products[both])) / squares if squares > 0 else 0.0
