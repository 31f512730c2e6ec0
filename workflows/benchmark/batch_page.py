"""How long a browser takes to open, sort and search the page of a batch.

    python workflows/benchmark/batch_page.py [--beads 1000]

Needs Chromium and playwright, which the extra `mtpipe[test]` has.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from mtpipe.pipeline.summary import DONE, Row
from mtpipe.report.batch_page import batch_page

REASON = "The recording differs from the setup: the camera exposes for 2.09 ms of each 11.4 ms."


def main() -> None:
    """Print the three times."""
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    options.add_argument("--beads", type=int, default=1000)
    beads = options.parse_args().beads
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as started:
        file = Path(folder) / "index.html"
        file.write_text(batch_page([asdict(row) for row in rows(beads)], []), encoding="utf-8")
        browser = started.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        times = {}
        for what, act in {
            "open": lambda: page.goto(file.as_uri()),
            "sort": lambda: page.get_by_role("button", name="largest force").click(),
            "search": lambda: page.get_by_role("searchbox").fill("r77"),
        }.items():
            began = time.perf_counter()
            act()
            # until it is drawn
            page.evaluate(
                "() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))"
            )
            times[what] = time.perf_counter() - began
        browser.close()
    kilobytes = len(batch_page([asdict(row) for row in rows(beads)], [])) / 1e3
    said = ", ".join(f"{what} {seconds:.2f} s" for what, seconds in times.items())
    print(f"{beads} beads, {kilobytes:.0f} kB: {said}")


def rows(beads: int) -> list[Row]:
    """A summary of so many beads."""
    random = np.random.default_rng(0)
    return [
        Row(
            recording=f"monday/r{k // 8}.csv",
            bead=f"b{k % 8}",
            status=DONE,
            verdict=("good", "caution", "refused")[k % 3],
            mismatch=("consistent", "explained", "unexplained")[k % 3],
            force_min_pN=float(random.uniform(0.1, 1)),
            force_max_pN=float(random.uniform(5, 20)),
            persistence_length_nm=float(random.normal(50, 2)),
            persistence_length_stderr_nm=1.0,
            contour_length_nm=float(random.normal(2700, 20)),
            contour_length_stderr_nm=5.0,
            reasons=REASON,
            report=f"monday/r{k // 8}.csv/report/bead-b{k % 8}.html",
        )
        for k in range(beads)
    ]


if __name__ == "__main__":
    main()
