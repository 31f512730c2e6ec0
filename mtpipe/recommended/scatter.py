"""Scatter beyond stated errors, of determinations of one quantity.

Metrologists call it dark uncertainty (Thompson & Ellison 2011, Accred. Qual. Assur. 16, 483).
"""

from __future__ import annotations

import numpy as np
from scipy import optimize

from mtpipe.physics.camera import FloatArray


def scatter_beyond_errors(off: FloatArray, stderr: FloatArray) -> float:
    """Standard deviation that has to be added to the errors for differences to be about none.

    The estimator of Mandel and Paule (1970, Anal. Chem. 42, 1194) about a known mean of 0: the
    τ ≥ 0 with Σ off²/(stderr² + τ²) = n.

    Parameters
    ----------
    off, stderr : (n,) differences that should be 0, and their standard errors.
    """

    def excess(variance: float) -> float:
        return float(np.sum(off**2 / (stderr**2 + variance))) - len(off)

    if not len(off) or excess(0.0) <= 0:
        return 0.0
    most = float(np.sum(off**2))
    return float(np.sqrt(optimize.brentq(excess, 0.0, most)))
