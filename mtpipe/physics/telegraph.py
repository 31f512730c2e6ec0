"""Telegraph motion between two states, averaged over exposures: the loop in time, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray


@compiled
def mean_states(keeps: NDArray[np.bool_], drawn: NDArray[np.bool_], exposed: int) -> FloatArray:
    """(frames,) share of the first `exposed` parts of each frame in the longer state.

    Parameters
    ----------
    keeps : (frames, parts) whether a part is in the state of the one before; the first does not.
    drawn : (frames, parts) whether it is in the longer one where it does not keep it.
    """
    frames, parts = keeps.shape
    found = np.empty(frames)
    longer = False
    for frame in range(frames):
        count = 0
        for part in range(parts):
            if not keeps[frame, part]:
                longer = drawn[frame, part]
            if longer and part < exposed:
                count += 1
        found[frame] = count / exposed
    return found
