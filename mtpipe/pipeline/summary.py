"""The summary of a batch: a row per bead, as a table and as a page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.files import write_atomically
from mtpipe.ground.spreadsheets import as_csv
from mtpipe.pipeline.growing import GROWS
from mtpipe.pipeline.results import CHECK_FAILED
from mtpipe.report.batch_page import batch_page
from mtpipe.report.marked import read_marked_run
from mtpipe.report.marks import read_marks
from mtpipe.report.pages import page_names

SUMMARY, PAGE = "summary.csv", "index.html"
# How far a bead is. Only `done` is all that can be known of it.
DONE, TO_COME, NOT_SIMULATED, FAILED = "done", "cross-check to come", "not simulated", "failed"
NOT_BEGUN, RECORDED = "calibration to come", "being recorded"
# Columns taken from `beads.parquet`.
OF_BEADS = (
    *("verdict", "mismatch", "force_min_pN", "force_max_pN"),
    *("persistence_length_nm", "persistence_length_stderr_nm"),
    *("contour_length_nm", "contour_length_stderr_nm"),
)
STATUS_OF = {"not_crosschecked": NOT_SIMULATED, CHECK_FAILED: FAILED, GROWS: RECORDED}


@dataclass(frozen=True)
class Row:
    """A bead in `summary.csv`; of a recording without any run a row without a bead.

    Attributes
    ----------
    recording : its path below the folder of the batch. report : path of the bead's page below DIR.
    Others : as in `beads.csv`; None where there is none.
    """

    recording: str
    bead: str
    status: str
    verdict: str = ""
    mismatch: str = ""
    force_min_pN: float | None = None
    force_max_pN: float | None = None
    persistence_length_nm: float | None = None
    persistence_length_stderr_nm: float | None = None
    contour_length_nm: float | None = None
    contour_length_stderr_nm: float | None = None
    reasons: str = ""
    report: str = ""


@dataclass(frozen=True)
class Summary:
    """What came of a batch.

    Attributes
    ----------
    out : its folder. rows : of all beads.
    aside : (file, why) of files that are no recordings. magnet : of the magnet's curve, a sentence.
    """

    out: Path
    rows: tuple[Row, ...]
    aside: tuple[tuple[str, str], ...]
    magnet: str = ""

    @property
    def failed(self) -> tuple[Row, ...]:
        """Rows of what could not be worked on."""
        return tuple(row for row in self.rows if row.status == FAILED)


def rows_of(name: str, folder: Path, run: Mapping[str, Any], failure: str) -> list[Row]:
    """The rows of a recording.

    Parameters
    ----------
    name : of the recording. folder : of its run. run : `run.json`; empty where there is none.
    failure : why the recording was not worked on to the end; empty where it was.
    """
    if not run:
        return [Row(name, "", FAILED if failure else NOT_BEGUN, reasons=failure)]
    beads, marked, fault = _as_marked(folder)
    pages = page_names(list(beads["bead"]))
    said = {n["bead"]: n for n in run["notices"] if n["code"] in STATUS_OF}
    rows = []
    for bead in beads.where(beads.notna(), None).to_dict("records"):
        notice = said.get(bead["bead"]) or said.get(None)
        status = DONE if run["complete"] else TO_COME
        status = STATUS_OF[notice["code"]] if notice else status
        reasons = [failure, fault, notice["message"] if notice else "", bead["reasons"] or ""]
        reasons += marked.get(bead["bead"], [])
        rows.append(
            Row(
                recording=name,
                bead=bead["bead"],
                status=FAILED if failure else status,
                **{key: bead[key] for key in OF_BEADS},
                reasons=" | ".join(reason for reason in reasons if reason),
                report=f"{name}/report/{pages[bead['bead']]}",
            )
        )
    return rows


def _as_marked(folder: Path) -> tuple[pd.DataFrame, dict[str, list[str]], str]:
    """Beads of a run as its marks leave them, what is left out of each, and what hindered it."""
    fault = ""
    try:
        if marks := read_marks(folder):
            beads = read_marked_run(folder).beads
            said: dict[str, list[str]] = {}
            for mark in marks:
                if mark.plateau is not None or mark.stretch_s is not None:
                    words = f"left out by hand: {mark.place} ({mark.reason})"
                    said.setdefault(mark.bead, []).append(words)
            return beads.astype(object), said, ""
    except MtpipeError as error:
        fault = f"its marks are not in this row: {error}"
    return pd.read_parquet(folder / "beads.parquet").astype(object), {}, fault


def is_done(run: Mapping[str, Any]) -> bool:
    """Whether nothing is left to do of a run, given its `run.json`."""
    failed = any(notice["code"] == CHECK_FAILED for notice in run.get("notices", ()))
    return bool(run.get("complete")) and not failed


def write_summary(summary: Summary) -> None:
    """Write `summary.csv` and `index.html`."""
    rows = [asdict(row) for row in summary.rows]
    write_atomically(summary.out / SUMMARY, as_csv(pd.DataFrame(rows)))
    write_atomically(summary.out / PAGE, batch_page(rows, summary.aside, summary.magnet))
