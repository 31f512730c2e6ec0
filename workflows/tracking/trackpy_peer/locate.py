"""Locates beads with trackpy; runs in trackpy's own environment and knows nothing of mtpipe.

    python locate.py images.npz answers.npz

Every image is searched with bright and with dark features and with each of `diameters_px`; of the
features found the one nearest to the middle of the image is answered. What fits the images best is
for the asker to choose.
"""

from __future__ import annotations

import itertools
import sys
import time

import numpy as np
import trackpy


def main() -> None:
    """Read the images, write where trackpy finds the bead in them."""
    trackpy.quiet()
    with np.load(sys.argv[1]) as asked:
        images, diameters_px = asked["images"], asked["diameters_px"].tolist()
    middle = (images.shape[1] - 1) / 2
    answers, seconds, settings = [], [], []
    trackpy.locate(images[0], diameters_px[0], characterize=False)  # compiles
    for dark, diameter in itertools.product((False, True), diameters_px):
        began = time.process_time()
        answers.append([nearest(image, diameter, dark, middle) for image in images])
        seconds.append((time.process_time() - began) / len(images))
        settings.append((diameter, dark))
    np.savez(sys.argv[2], xy_px=answers, cpu_s=seconds, settings=settings)


def nearest(
    image: np.ndarray, diameter_px: int, dark: bool, middle_px: float
) -> tuple[float, float]:
    """x and y of the feature nearest to the middle; nan where there is none."""
    found = trackpy.locate(image, diameter_px, invert=dark, characterize=False)
    if not len(found):
        return np.nan, np.nan
    i = np.argmin((found.x - middle_px) ** 2 + (found.y - middle_px) ** 2)
    return float(found.x.iloc[i]), float(found.y.iloc[i])


if __name__ == "__main__":
    main()
