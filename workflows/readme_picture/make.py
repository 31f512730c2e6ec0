"""Draw the README's picture again: the report of a bundled recording in headless Chromium.

    python workflows/readme_picture/make.py

Needs the test extra (playwright) and a chromium on the PATH.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from mtpipe.demo import recording_in, sample_data
from mtpipe.pipeline import run

PICTURE = Path(__file__).parents[2] / "docs" / "images" / "report.png"
SIZE = {"width": 1180, "height": 640}


def main() -> None:
    """Run one bundled recording and photograph the first screen of its bead's page."""
    browser_path = shutil.which("chromium")
    if browser_path is None:
        raise SystemExit("chromium is not on the PATH")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        out = Path(folder)
        run(recording_in(sample_data() / "clean_short_tether"), out)
        browser = playwright.chromium.launch(
            executable_path=browser_path, args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport=SIZE)
        page.goto((out / "report" / "bead-b1.html").as_uri())
        page.wait_for_timeout(3000)
        page.screenshot(path=PICTURE)
        browser.close()


if __name__ == "__main__":
    main()
