"""A film of a moving and a fixed bead, and a focus scan of both, for the tests of tracking."""

import numpy as np
import pandas as pd
import tifffile

from mtpipe.tracking.scan import table_from_scan
from mtpipe.tracking.track import track
from tests.stack_images import draw, setup_text

SHAPE = (96, 150)
FIXED = (110.3, 50.6)
FOCUS_NM = np.repeat(np.arange(0.0, 640, 20), 2)


def write(path, frames):
    tifffile.imwrite(path, frames, photometric="minisblack", metadata=None)
    return path


def make_scan(folder):
    """A focus scan of two beads, its positions, and a table of each."""
    write(folder / "scan.tif", draw(SHAPE, [(40.2, 45.1, FOCUS_NM), (*FIXED, FOCUS_NM)], seed=5))
    pd.DataFrame({"z_nm": FOCUS_NM}).to_csv(folder / "z.csv", index=False)
    for bead in ("bead1", "bead2"):
        table = table_from_scan(
            folder / "scan.tif", folder / "z.csv", refractive_index_factor=1.0, bead=bead
        )
        table.save(folder / f"{bead}.npz")
    return folder


def wander(frames, seed=1):
    random = np.random.default_rng(seed)
    k = np.arange(frames)
    return (
        40 + 0.6 * random.normal(size=frames),
        45 + 0.03 * k,  # beyond a quarter of the region in 400 frames
        320 + 150 * np.sin(k / 30),
    )


def make_film(folder, scan):
    """A film of a moving and a fixed bead, tracked with tables."""
    truth = wander(400)
    write(folder / "film.tif", draw(SHAPE, [truth, (*FIXED, 200.0)]))
    pd.DataFrame({"frame": np.arange(400), "mm": np.repeat([3.0, 4.0], 200)}).to_csv(
        folder / "magnets.csv", index=False
    )
    (folder / "setup.toml").write_text(
        setup_text(
            f"""
            [tracking]
            look_up_table_of = {{ bead1 = "{scan}/bead1.npz", bead2 = "{scan}/bead2.npz" }}
            [tracking.magnet]
            file = "magnets.csv"
            column = "mm"
            header = true
            delimiter = "comma"
            row_by_row = true
            [plateaus]
            minimum_s = 1.0
            [source]
            z_zero.value_nm = 100.0
            """,
            reference='"bead2"',
        )
    )
    done = track(folder / "film.tif", folder / "recording.csv")
    return folder, truth, done
