"""Where in its region a bead is: x and y by magtrack, each way under a name.

Every way starts from the centre of mass. Auto-convolution then seeks the point about which a line
through the bead is its own mirror image (Gosse and Croquette 2002), to a fraction of a pixel by a
parabola through the peak; with several lines averaged it uses more of the light. The peak is
weighted about the last centre, so it is sought again until that no longer matters. It can only lie
in the middle half of a region.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.tracking.library import from_device, magtrack, stack_of

CENTRES = ("center_of_mass", "auto_conv", "auto_conv_multiline")
# What is left of a wrong start falls to 6 % with each repetition (measured on rendered beads).
REPETITIONS = 5


def centres(images: FloatArray, method: str) -> tuple[FloatArray, FloatArray]:
    """x and y, (n,) each, in pixels of images (n, size, size); NaN where there is no centre.

    Parameters
    ----------
    images : none of them flat. method : one of `CENTRES`.
    """
    library, stack = magtrack(), stack_of(images)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = library.center_of_mass(stack)
        if method != "center_of_mass":
            x, y = library.auto_conv(stack, x, y)
            refine = {
                "auto_conv": library.auto_conv_sub_pixel,
                "auto_conv_multiline": library.auto_conv_multiline_sub_pixel,
            }[method]
            for _ in range(REPETITIONS):
                x, y = refine(stack, *_inside(x, y, images.shape[1]))
    return from_device(x), from_device(y)


def _inside(x: Any, y: Any, size: int) -> tuple[Any, Any]:
    """The middle of the region as the next start where no centre was found."""
    lost = (x != x) | (y != y)
    x[lost], y[lost] = (size - 1) / 2, (size - 1) / 2
    return x, y
