"""Draw the README's picture again: the report of a bundled recording in headless Chromium.

    python workflows/readme_picture/make.py

Needs the test extra (playwright) and a chromium on the PATH.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from mtpipe.pipeline.demo import recording_in, sample_data
from mtpipe.pipeline.run import run

PICTURE = Path(__file__).parents[2] / "docs" / "images" / "report.png"
# Of the demo, the recording whose setup is silent about something: there is a finding to see.
RECORDING = sample_data() / "concealed" / "recordings" / "r0000"
SIZE = {"width": 1180, "height": 640}


def main() -> None:
    """Run the recording and photograph the first screen of its bead's page."""
    with tempfile.TemporaryDirectory() as folder:
        run(recording_in(RECORDING), Path(folder))
        photograph(Path(folder))


def photograph(out: Path) -> None:
    """Take the picture of a run folder's report."""
    browser_path = shutil.which("chromium")
    if browser_path is None:
        raise SystemExit("chromium is not on the PATH")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=browser_path, args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport=SIZE)
        page.goto((out / "report" / "bead-b1.html").as_uri())
        page.locator("[data-figure=picture] .main-svg").first.wait_for()
        page.screenshot(path=PICTURE)
        browser.close()


if __name__ == "__main__":
    main()
