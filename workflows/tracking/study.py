"""How well beads are tracked: the tables of docs/tracking-accuracy.md.

    python workflows/tracking/study.py --write docs/tracking-accuracy.md

Rendered images, whose truth is known, each method beside trackpy, which gets an environment of its
own on first use; then from image to force; then real images from `../shared/recordings`, left out
visibly where there are none. The same seed gives the same numbers, but for the speeds.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

# one core; the libraries read this when they are loaded
os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")

sys.path.append(str(Path(__file__).parents[1] / "common"))
import accuracy
import forces
import pages
import peer
import real
import sizes

import mtpipe

CHECKOUT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Choice:
    """What was asked for on the command line."""

    images: int
    frames: int
    seed: int
    trackpy_env: Path
    recordings: Path

    @property
    def trackpy(self) -> Path:
        """trackpy's interpreter."""
        return peer.environment(self.trackpy_env)


PARTS: dict[str, Callable[[Choice], str]] = {
    "noise": lambda c: accuracy.noise_table(c.trackpy, c.images),
    "height": lambda c: accuracy.height_table(c.trackpy, c.images // 2),
    "phase": lambda c: accuracy.phase_table(c.trackpy, c.images // 4),
    "planes": lambda c: accuracy.planes_table(c.images),
    "precision": lambda c: accuracy.precision_table(2 * c.images),
    "sizes": lambda c: sizes.sizes_table(c.trackpy, c.images),
    "speed": lambda c: accuracy.speed_table(c.trackpy),
    "forces": lambda c: forces.forces_table(c.frames, c.seed),
    "scan": lambda c: real.scan_table(c.recordings),
    "lateral": lambda c: real.lateral_table(c.recordings),
    "others": lambda c: real.others_table(c.recordings),
}
OF_REAL_IMAGES = ("scan", "lateral", "others")


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(description="Tracking on images whose truth is known.")
    parser.add_argument("--images", type=int, default=400, help="per row")
    parser.add_argument("--frames", type=int, default=4000, help="of each stack")
    parser.add_argument("--seed", type=int, default=1, help="of the stacks")
    parser.add_argument("--only", choices=tuple(PARTS), nargs="+", default=tuple(PARTS))
    parser.add_argument("--write", type=Path, help="page to put the tables into")
    parser.add_argument(
        "--trackpy-env",
        type=Path,
        default=Path(tempfile.gettempdir()) / "mtpipe-study-trackpy",
        help="virtual environment for trackpy, made on first use",
    )
    parser.add_argument(
        "--recordings", type=Path, default=CHECKOUT.parent / "shared" / "recordings"
    )
    asked = parser.parse_args()
    choice = Choice(asked.images, asked.frames, asked.seed, asked.trackpy_env, asked.recordings)
    for part in asked.only:
        if part in OF_REAL_IMAGES and not choice.recordings.is_dir():
            print(f"\n{part}: skipped, there are no recordings in {choice.recordings}", flush=True)
            continue
        began = time.perf_counter()
        block = PARTS[part](choice)
        command = f"python workflows/tracking/study.py --only {part} {_options(part, choice)}"
        block += (
            f"\n\nPrinted {datetime.now(UTC):%Y-%m-%d} by mtpipe {mtpipe.__version__}: "
            f"`{command.strip()}` ({time.perf_counter() - began:.0f} s)."
        )
        print(f"\n{part}\n{'-' * len(part)}\n{block}", flush=True)
        if asked.write is not None:
            text = asked.write.read_text(encoding="utf-8")
            asked.write.write_text(pages.into_page(text, {part: block}), encoding="utf-8")


def _options(part: str, choice: Choice) -> str:
    """The options that this part's numbers depend on."""
    if part in OF_REAL_IMAGES or part == "speed":
        return ""
    if part == "forces":
        return f"--frames {choice.frames} --seed {choice.seed}"
    return f"--images {choice.images}"


if __name__ == "__main__":
    main()
