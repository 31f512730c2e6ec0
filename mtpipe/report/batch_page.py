"""The page of a batch: every bead of every recording, to be sorted and searched."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import files as resources
from typing import Any
from urllib.parse import quote

from mtpipe.ground.version import VERSION
from mtpipe.report import words
from mtpipe.report.pages import templates


def batch_page(
    beads: Sequence[Mapping[str, Any]], aside: Sequence[tuple[str, str]], magnet: str = ""
) -> str:
    """`index.html` of a batch, in one file that loads nothing.

    Parameters
    ----------
    beads : rows of `summary.csv`. aside : (file, why) of files that are no recordings.
    magnet : what is said of the magnet's curve, if anything.
    """
    static = resources("mtpipe.report") / "static"
    page: str = (
        templates()
        .get_template("batch.html.j2")
        .render(
            beads=beads,
            recordings=len({bead["recording"] for bead in beads}),
            statuses=Counter(bead["status"] for bead in beads),
            verdicts=Counter(bead["verdict"] or "none" for bead in beads),
            aside=aside,
            magnet=magnet,
            words=words,
            version=VERSION,
            link=quote,
            style=(static / "report.css").read_text(encoding="utf-8"),
            script=(static / "lists.js").read_text(encoding="utf-8"),
            filters=(static / "batch.js").read_text(encoding="utf-8"),
        )
    )
    return page
