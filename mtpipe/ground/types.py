"""Types that many rooms share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
# Called with how many steps are done, of how many.
Progress = Callable[[int, int], None]
# The same, with what is being done.
NamedProgress = Callable[[str, int, int], None]
