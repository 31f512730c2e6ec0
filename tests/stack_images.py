"""Images of ring patterns for the tests of tracking, and setups that go with them.

A bead is drawn by a formula of its own, not by the optical model of `mtpipe.simulation.images`:
rings under a Gaussian, whose phase turns with the height.
"""

import numpy as np

SETUP = """
schema = 1
[camera]
frame_rate_hz = 100.0
exposure_s = 0.01
pixel_size_nm = 100.0
[beads]
radius_nm = 500.0
reference = [{reference}]
[tether]
contour_length_nm = 1000.0
persistence_length_nm = 50.0
[buffer]
temperature_K = 298.15
viscosity_mPa_s = 0.89
[field]
direction = "x"
{more}
"""


def setup_text(more="", reference=""):
    return SETUP.format(more=more, reference=reference)


def draw(shape, beads, *, noise=1.5, seed=0, level=100.0, dtype=np.uint8):
    """A frame for each position: beads are (x_px, y_px, z_nm) of (n,) arrays or numbers.

    Returns
    -------
    (n, height, width) of dtype.
    """
    random = np.random.default_rng(seed)
    places = [tuple(np.broadcast_arrays(*map(np.asarray, bead))) for bead in beads]
    frames = max((p[0].size for p in places), default=1)
    y, x = np.mgrid[: shape[0], : shape[1]]
    out = np.empty((frames, *shape), dtype)
    for k in range(frames):
        image = np.full(shape, level)
        for place in places:
            bx, by, bz = (np.broadcast_to(p, frames)[k] for p in place)
            r = np.hypot(x - bx, y - by)
            image += (
                0.5 * level * np.cos(r * (1.1 - bz * 1e-4) + bz / 700) * np.exp(-((r / 8) ** 2))
            )
        image += noise * random.normal(size=shape)
        out[k] = np.clip(np.rint(image), 0, np.iinfo(dtype).max)
    return out
