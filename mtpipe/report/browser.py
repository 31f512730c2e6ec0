"""A browser without a window, which draws what the report's pages draw."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from urllib.parse import quote

from mtpipe.ground.errors import MtpipeError

NAMES = (
    *("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"),
    "msedge",
)
QUIET = (
    *("--headless", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--hide-scrollbars"),
    # waits until the page's work is done, at most this number of the page's own milliseconds
    *("--run-all-compositor-stages-before-draw", "--virtual-time-budget=600000"),
)
# A page with some hundred figures takes about a minute.
LONGEST_S = 600.0


def find_browser() -> str:
    """Path of a chromium or one of its kin.

    Raises
    ------
    MtpipeError : there is none.
    """
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        raise MtpipeError(
            "figures and PDF are drawn by a browser, and there is no chromium or Chrome here",
            mend="Install chromium, or save figures and print the page from your own browser.",
        )
    return found


def body_of(page: Path) -> str:
    """The text that a page holds after its scripts have run."""
    done = _run("--dump-dom", page.as_uri())
    match = re.search(r'<body[^>]*data-done="yes"[^>]*>(.*?)</body>', done, re.DOTALL)
    if match is None:
        raise MtpipeError("the browser did not draw the figures", where=str(page))
    return html.unescape(match[1])


def figures_of(page: Path, script: str) -> dict[str, str]:
    """All figures of a page of the report as SVG, by name.

    Parameters
    ----------
    script : run after the page's own; leaves them in the page as JSON.
    """
    text = page.read_text(encoding="utf-8")
    base = f'<base href="{page.parent.as_uri()}/">'
    drawn = text.replace("<head>", f"<head>{base}", 1)
    last = f"<script defer src='data:text/javascript,{quote(script, safe='')}'></script>"
    drawn = drawn.replace("</head>", f"{last}</head>", 1)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "page.html"
        copy.write_text(drawn, encoding="utf-8")
        return dict(json.loads(body_of(copy)))


def print_pdf(page: Path, out: Path) -> None:
    """Print a page as a PDF file."""
    _run("--no-pdf-header-footer", f"--print-to-pdf={out}", page.as_uri())
    if not out.is_file():
        raise MtpipeError("the browser did not print the page", where=str(page))


def _run(*arguments: str) -> str:
    # root has no sandbox, as in a container
    sandbox = ["--no-sandbox"] if hasattr(os, "getuid") and os.getuid() == 0 else []
    with tempfile.TemporaryDirectory() as profile:
        command = [find_browser(), *QUIET, *sandbox, f"--user-data-dir={profile}", *arguments]
        try:
            done = subprocess.run(command, capture_output=True, timeout=LONGEST_S, check=False)
        except subprocess.TimeoutExpired:
            raise MtpipeError(
                f"the browser took longer than {LONGEST_S:.0f} s and was stopped"
            ) from None
    return done.stdout.decode("utf-8", "replace")
