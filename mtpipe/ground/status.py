"""Whether a number of one trace is one to use, in one word: decided here, and asked here by all.

A fit may be exact and its number still none to use: the spectrum is not the model's, or the motion
shows no return, so that the stiffness may as well be zero. `calibration.bead_results` adds what
is known of a trace beyond its spectrum, that it was refused or mixes several states.
"""

from __future__ import annotations

import math

from mtpipe.ground.estimate import Estimate, Status

# A spectrum of the model's own is this unlike it in one trace of a thousand.
P_POOR = 1e-3
# A random walk fitted as a tether shows at least this many relaxation times in one trace of a
# hundred, however long it is (Dickey & Fuller 1979: 1 % value of T/τ, mean subtracted; two of a
# hundred by the fits of this package). Below it nought is within what a stiffness may be, whatever
# the curvature of its likelihood says.
LEAST_RELAXATIONS = 20.7


def status_of(
    estimate: Estimate, *, p_value: float = math.nan, relaxations: float = math.inf
) -> Status:
    """The word of a stiffness, of a force or of a corner frequency.

    Parameters
    ----------
    p_value : of the fit of the spectrum; nan for a method that has none.
    relaxations : length of the trace in relaxation times; infinite for what does not rest on the
        motion's return, such as friction and noise.

    Returns
    -------
    The estimate's own word where that is not "ok"; "zero_force" where nought is within what it may
    be; "unlike_model" where the spectrum is not the model's; else "ok".
    """
    if estimate.status != "ok":
        return estimate.status
    if estimate.interval[0] <= 0 or relaxations < LEAST_RELAXATIONS:
        return "zero_force"
    return "unlike_model" if p_value < P_POOR else "ok"
