"""Small made-up recordings and setups for the tests of reading."""

from pathlib import Path

import numpy as np

from mtpipe.setup import Setup, parse_setup

RATE = 100.0


def setup_of(source=None, *, rate=RATE, reference=("ref1",), minimum_s=1.0, **plateaus) -> Setup:
    content = {
        "schema": 1,
        "camera": {"frame_rate_hz": rate, "exposure_s": "unknown"},
        "beads": {"radius_nm": 500.0, "reference": list(reference)},
        "tether": {"contour_length_nm": 1000.0, "persistence_length_nm": 50.0},
        "buffer": {"temperature_K": 298.0, "viscosity_mPa_s": 0.9},
        "field": {"direction": "x"},
        "plateaus": {"minimum_s": minimum_s, **plateaus},
    }
    if source is not None:
        content["source"] = source
    return parse_setup(content)


def motion(n=400, beads=("b1", "ref1"), seed=0) -> dict[str, np.ndarray]:
    """Tethered beads that fluctuate by 30 nm, references by 2 nm, far from the origin."""
    rng = np.random.default_rng(seed)
    return {
        bead: np.round(
            rng.normal(0, 2 if bead.startswith("ref") else 30, (n, 3)) + 1000 * (k + 1), 3
        )
        for k, bead in enumerate(beads)
    }


def canonical_lines(positions, time=None, magnet=None) -> list[str]:
    n = len(next(iter(positions.values())))
    time = [f"{i / RATE:.4f}" for i in range(n)] if time is None else time
    header = ["time_s"] + (["magnet_mm"] if magnet is not None else [])
    header += [f"{bead}_{axis}_nm" for bead in positions for axis in "xyz"]
    lines = [",".join(header)]
    for i in range(n):
        cells = [time[i]] + ([str(magnet[i])] if magnet is not None else [])
        cells += ["" if np.isnan(v) else repr(float(v)) for p in positions.values() for v in p[i]]
        lines.append(",".join(cells))
    return lines


def write(path: Path, lines: list[str], encoding="utf-8") -> Path:
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    return path


def codes(recording) -> set[str]:
    return {notice.code for notice in recording.notices}
