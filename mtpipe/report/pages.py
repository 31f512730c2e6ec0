"""Filling the templates: `report/index.html` and a page for every bead, whole or not at all.

plotly.js, style and script are copied beside the pages once; nothing is loaded from a network.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from datetime import datetime
from importlib.resources import files as resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from mtpipe.files import folder_written_whole
from mtpipe.report import rows, rows_crosscheck, rows_diagnosis, rows_drift, rows_methods, words
from mtpipe.report.captions import agreement_caption, trace_captions
from mtpipe.report.figures_agreement import agreement_figure
from mtpipe.report.figures_bead import (
    force_extension_figure,
    traces_figure,
    valid_range,
)
from mtpipe.report.figures_before_after import residuals_figure, spectra_figure
from mtpipe.report.figures_crosscheck import curves_figure, map_figure
from mtpipe.report.figures_run import drift_figure, forces_figure
from mtpipe.report.figures_trace import posterior_figure, spectrum_figure
from mtpipe.report.figures_unexplained import (
    left_panels,
    left_shapes,
    shapes_figure,
    unexplained_figure,
)
from mtpipe.report.folder import RunFolder, read_run_folder, records
from mtpipe.report.notices import notice_groups
from mtpipe.report.plateau_forces import comparisons
from mtpipe.report.plotly_json import Arrays

Progress = Callable[[int, int], None]
STATIC = ("report.css", "report.js")
DRIFT_METHOD = {
    "reference": "The motion of the reference beads was subtracted from every trace.",
    "highpass": "All motion slower than the cutoff was removed from every trace (high-pass).",
    "none": "Nothing was subtracted: the traces are as recorded.",
}


def write_report(folder: Path, *, progress: Progress | None = None) -> Path:
    """Write the report of a run into `folder/report/`, replacing one that is there.

    Parameters
    ----------
    folder : a run folder as in docs/run-folder.md.
    progress : called with the pages written and their total after each page.

    Returns
    -------
    Path of `report/index.html`.

    Raises
    ------
    RunFolderError : a file of the run folder is missing, damaged or lacks a column.
    """
    from plotly.offline import get_plotlyjs

    run = read_run_folder(folder)
    beads = rows.bead_rows(run)
    pages = page_names([row.bead for row in beads])
    shared = {"run": run.run, "pages": pages, "beads": beads, "words": words}
    environment = _environment()
    with folder_written_whole(folder / "report") as target:
        (target / "plotly.min.js").write_text(get_plotlyjs(), encoding="utf-8")
        for name in STATIC:
            text = (resources("mtpipe.report") / "static" / name).read_text(encoding="utf-8")
            (target / name).write_text(text, encoding="utf-8")
        for number, row in enumerate(beads):
            page = environment.get_template("bead.html.j2").render(
                **shared, **_bead_page(run, row), position=number
            )
            (target / pages[row.bead]).write_text(page, encoding="utf-8")
            if progress is not None:
                progress(number + 1, len(beads) + 1)
        index = environment.get_template("index.html.j2").render(
            **shared, **_index_page(run, beads)
        )
        (target / "index.html").write_text(index, encoding="utf-8")
    if progress is not None:
        progress(len(beads) + 1, len(beads) + 1)
    return folder / "report" / "index.html"


def page_names(beads: list[str]) -> dict[str, str]:
    """File name of each bead's page: letters, digits, "-" and "_" only, all different.

    Different also where a file system does not tell capitals from small letters.
    """
    names: dict[str, str] = {}
    taken: set[str] = set()
    for bead in beads:
        stem = "bead-" + (re.sub(r"[^A-Za-z0-9_-]+", "-", bead).strip("-")[:60] or "unnamed")
        name, number = stem, 1
        while name.casefold() in taken:
            number += 1
            name = f"{stem}-{number}"
        taken.add(name.casefold())
        names[bead] = f"{name}.html"
    return names


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("mtpipe.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # NaN is no JSON: the browser would refuse the whole page
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return environment


def _index_page(run: RunFolder, beads: list[rows.BeadRow]) -> dict[str, Any]:
    arrays = Arrays()
    figures: dict[str, Any] = {"forces": forces_figure(arrays, run, [row.bead for row in beads])}
    if not figures["forces"]["data"]:
        figures = {}
    if len(run.drift):
        figures["drift"] = drift_figure(arrays, run)
    drift: Mapping[str, Any] = run.run["drift"] or {"method": "none"}
    method = str(drift["method"])
    best = next((v for v in rows.VERDICTS if any(row.verdict == v for row in beads)), "")
    chosen = [row.bead for row in beads if row.verdict == best]
    forces = run.forces.loc[run.forces["bead"].isin(chosen), "force_pN"].dropna()
    return {
        "counts": {v: sum(row.verdict == v for row in beads) for v in rows.VERDICTS},
        "best": best,
        "best_forces": words.span(forces.min(), forces.max()) if len(forces) else "",
        "groups": notice_groups(run.notices, set(run.beads["bead"])),
        "setup": words.setup_in_words(run.setup),
        "source": run.run["setup"].get("source"),
        "drift_words": DRIFT_METHOD.get(method, method),
        "drift_rows": rows_drift.drift_rows(drift),
        "references": rows_drift.reference_rows(run),
        "started": _date(run.run.get("started")),
        "charts": {"arrays": arrays.packed(), "figures": figures},
        "drawn": figures,
    }


def _bead_page(run: RunFolder, row: rows.BeadRow) -> dict[str, Any]:
    arrays, bead = Arrays(), row.bead
    plateaus = rows.plateau_rows(run, bead)
    methods, by_method = rows_methods.method_rows(run, bead, plateaus)
    forces = {
        f"{int(force['plateau'])}/{force['axis']}": force
        for force in records(run.forces[run.forces["bead"] == bead])
    }
    compared = comparisons(run.forces[run.forces["bead"] == bead])
    figures = {
        "force_extension": force_extension_figure(arrays, run, bead),
        "agreement": agreement_figure(arrays, compared),
        "traces": traces_figure(arrays, run, bead),
    }
    spectra = {
        f"{plateau}/{axis}": spectrum_figure(arrays, table, str(axis))
        for (plateau, axis), table in run.spectra[run.spectra["bead"] == bead].groupby(
            ["plateau", "axis"]
        )
    }
    posteriors = {
        key: posterior_figure(arrays, table, forces[key])
        for (plateau, axis), table in run.posteriors[run.posteriors["bead"] == bead].groupby(
            ["plateau", "axis"]
        )
        if (key := f"{plateau}/{axis}") in forces
    }
    checked = rows_crosscheck.crosscheck_rows(run, bead)
    if checked.done:
        figures["crosscheck"] = map_figure(checked)
    if named := run.before_after.get(bead):
        figures["before_after"] = spectra_figure(arrays, named)
        figures["residuals"] = residuals_figure(named)
    if panels := left_panels(run, bead):
        figures["unexplained"] = unexplained_figure(arrays, panels)
    if shapes := left_shapes(run, bead):
        figures["shapes"] = shapes_figure(arrays, shapes)
    curves = _crosscheck_curves(arrays, run, bead)
    usable = [key for key, force in forces.items() if force["status"] != "refused"]
    figures = {name: figure for name, figure in figures.items() if figure["data"]}
    return {
        "row": row,
        "checked": checked,
        "diagnosis": rows_diagnosis.diagnosis_rows(run, bead),
        "plateaus": plateaus,
        "methods": methods,
        "by_method": by_method,
        "agreement": agreement_caption(compared),
        "statuses": [
            f"“{words.STATUS[status]}”: {meaning}."
            for status, meaning in words.STATUS_MEANING.items()
            if any(force["status"] == status for force in forces.values())
        ],
        "models": rows.model_rows(run, bead),
        "valid": {words.MODEL[name]: valid_range(name) for name in words.MODEL},
        "groups": notice_groups(run.notices_of(bead), {bead}),
        "charts": {
            "arrays": arrays.packed(),
            "figures": figures,
            "choices": {
                "spectrum": spectra,
                "posterior": posteriors,
                "crosscheck": curves,
            },
            "captions": {
                f"{p.plateau}/{a.axis}": trace_captions(
                    forces[f"{p.plateau}/{a.axis}"],
                    sampled=f"{p.plateau}/{a.axis}" in posteriors,
                    shared=p.force_shared and a.axis != "z",
                )
                for p in plateaus
                for a in p.axes
            },
            "first": (usable or list(forces) or [""])[0],
        },
        "drawn": figures,
        "axes": [axis for axis in "xyz" if any(key.endswith(axis) for key in forces)],
    }


def _crosscheck_curves(arrays: Arrays, run: RunFolder, bead: str) -> dict[str, Any]:
    """Recorded and simulated curves, by plateau and axis."""
    parts = [
        {
            f"{plateau}/{axis}": table
            for (plateau, axis), table in whole[whole["bead"] == bead].groupby(["plateau", "axis"])
        }
        for whole in (run.crosscheck_spectrum, run.crosscheck_histogram, run.crosscheck_allan)
    ]
    return {
        key: curves_figure(arrays, [part[key] for part in parts], key.split("/")[1])
        for key in parts[0]
        if all(key in part for part in parts)
    }


def _date(started: Any) -> str:
    try:
        return datetime.fromisoformat(started).strftime("%d %B %Y, %H:%M %Z").strip()
    except (TypeError, ValueError):
        return words.text(started)
