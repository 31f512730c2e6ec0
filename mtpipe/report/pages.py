"""Filling the templates: `report/index.html` and a page for every bead, whole or not at all.

plotly.js, style and script are copied beside the pages once; nothing is loaded from a network.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from importlib.resources import files as resources
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from mtpipe.ground.files import folder_written_whole
from mtpipe.ground.types import Progress
from mtpipe.report import rows, rows_crosscheck, rows_drift, rows_methods, rows_plateaus, words
from mtpipe.report.captions import agreement_caption, trace_captions
from mtpipe.report.figures_agreement import agreement_figure
from mtpipe.report.figures_bead import (
    force_extension_figure,
    traces_figure,
    valid_range,
)
from mtpipe.report.figures_before_after import residuals_figure, spectra_figure
from mtpipe.report.figures_crosscheck import curves_figure, map_figure
from mtpipe.report.figures_finding import picture
from mtpipe.report.figures_geometry import Means, geometry_figure, plateau_means
from mtpipe.report.figures_run import UNSURE, drift_figure, forces_figure, has_legend
from mtpipe.report.figures_trace import posterior_figure, spectrum_figure
from mtpipe.report.figures_unexplained import (
    left_panels,
    left_shapes,
    shapes_figure,
    unexplained_figure,
)
from mtpipe.report.findings import VERDICT_BEADS, mixed_plateaus, overall_forces, overview
from mtpipe.report.folder import RunFolder, records
from mtpipe.report.marked import read_marked_run, write_csv
from mtpipe.report.marks import HEAD, Mark, read_marks
from mtpipe.report.notices import notice_groups
from mtpipe.report.plateau_forces import comparisons, quoted
from mtpipe.report.plotly_json import DARK, Arrays

PlateauMeans = Mapping[tuple[str, str], Means]
# Of the notice that says which chain was chosen, and why.
CHOICE = "tether_choice"
STATIC = ("report.css", "publication.js", "charts.js", "lists.js", "marks.js")
DRIFT_METHOD = {
    "reference": "The motion of the reference beads was subtracted from every trace.",
    "highpass": "All motion slower than the cutoff was removed from every trace (high-pass).",
    "none": "Nothing was subtracted: the traces are as recorded.",
}


def write_report(folder: Path, *, progress: Progress | None = None) -> Path:
    """Write the report of a run into `folder/report/`, and its `forces.csv` and `beads.csv`.

    All of it is as the marks beside the run leave it (`mtpipe.report.marks`).

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

    run = read_marked_run(folder)
    beads = rows.bead_rows(run)
    means = plateau_means(run)
    pages = page_names([row.bead for row in beads])
    shared = {"run": run.run, "pages": pages, "beads": beads, "words": words}
    environment = templates()
    with folder_written_whole(folder / "report") as target:
        (target / "plotly.min.js").write_text(get_plotlyjs(), encoding="utf-8")
        for name in STATIC:
            text = (resources("mtpipe.report") / "static" / name).read_text(encoding="utf-8")
            (target / name).write_text(text, encoding="utf-8")
        for number, row in enumerate(beads):
            page = environment.get_template("bead.html.j2").render(
                **shared, **_bead_page(run, row, means), position=number
            )
            (target / pages[row.bead]).write_text(page, encoding="utf-8")
            if progress is not None:
                progress(number + 1, len(beads) + 1)
        index = environment.get_template("index.html.j2").render(
            **shared, **_index_page(run, beads, means), **_marks(run, read_marks(folder))
        )
        (target / "index.html").write_text(index, encoding="utf-8")
    write_csv(folder, run)
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


def templates() -> Environment:
    """The templates of pages."""
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


def _index_page(run: RunFolder, beads: list[rows.BeadRow], means: PlateauMeans) -> dict[str, Any]:
    arrays = Arrays()
    names = [row.bead for row in beads]
    usable = [row.bead for row in beads if row.verdict != "refused"]
    figures = {
        "forces": forces_figure(arrays, quoted(run.forces), names),
        "geometry": geometry_figure(arrays, means, usable),
        "drift": drift_figure(arrays, run),
    }
    pictures = {name: picture(arrays, run, name) for name in names}
    figures |= {f"picture-{i}": one.figure for i, one in enumerate(pictures.values()) if one}
    figures = {name: figure for name, figure in figures.items() if figure["data"]}
    drift: Mapping[str, Any] = run.run["drift"] or {"method": "none"}
    method = str(drift["method"])
    groups = notice_groups(run.notices, set(run.beads["bead"]))
    general = [group for group in groups if group.general]
    return {
        "overview": overview(run.beads["verdict"]),
        "overall_forces": overall_forces(run),
        "counts": {v: sum(row.verdict == v for row in beads) for v in VERDICT_BEADS},
        "mixed": mixed_plateaus(run),
        "worries": [group for group in general if group.foremost],
        "remarks": [group for group in general if not group.foremost],
        "single": [group for group in groups if not group.general],
        "captions": {name: one.caption if one else "" for name, one in pictures.items()},
        "legend": has_legend(list(quoted(run.forces)["bead"].unique())),
        "open_points": quoted(run.forces)["force_source"].isin(UNSURE).any(),
        "setup": words.setup_in_words(run.setup),
        "source": run.run["setup"].get("source"),
        "drift_words": DRIFT_METHOD.get(method, method),
        "drift_rows": rows_drift.drift_rows(drift),
        "references": rows_drift.reference_rows(run),
        "started": _date(run.run.get("started")),
        "charts": {"arrays": arrays.packed(), "figures": figures, "dark": DARK},
        "drawn": figures,
    }


def _marks(run: RunFolder, marks: Sequence[Mark]) -> dict[str, Any]:
    """What is left out by hand, and what can be."""
    numbers = run.forces.groupby("bead", sort=False)["plateau"].unique()
    plateaus = {str(bead): sorted(map(int, there)) for bead, there in numbers.items()}
    data = {"marks": [asdict(mark) for mark in marks], "beads": plateaus, "head": HEAD}
    return {"marks": marks, "bead_plateaus": plateaus, "marks_data": data}


def _bead_page(run: RunFolder, row: rows.BeadRow, means: PlateauMeans) -> dict[str, Any]:
    arrays, bead = Arrays(), row.bead
    fits = rows_plateaus.axis_fits(run, bead)
    methods, by_method = rows_methods.method_rows(run, bead, fits)
    forces = run.forces[run.forces["bead"] == bead]
    traces = {f"{int(one['plateau'])}/{one['axis']}": one for one in records(forces)}
    compared = comparisons(forces)
    checked = rows_crosscheck.crosscheck_rows(
        run.crosscheck[run.crosscheck["bead"] == bead], run.notices_of(bead)
    )
    shown = picture(arrays, run, bead)
    figures = _bead_figures(arrays, run, bead, means)
    if shown is not None:
        figures["picture"] = shown.figure
    if checked.done:
        figures["crosscheck"] = map_figure(checked)
    choices = _choices(arrays, run, bead)
    usable = [key for key, one in traces.items() if one["status"] != "refused"]
    sources = forces["force_source"].unique()
    return {
        "row": row,
        "caption": shown.caption if shown else "",
        "checked": checked,
        "left": run.unexplained.get(bead, {"sentence": ""})["sentence"],
        "forces": rows_plateaus.force_table(run, bead),
        "fits": rows_plateaus.fit_blocks(fits),
        "methods": methods,
        "by_method": by_method,
        "agreement": agreement_caption(compared),
        "sources": [
            f"“{words.SOURCE[source].capitalize()}”: {meaning}."
            for source, meaning in words.SOURCE_MEANING.items()
            if source in sources
        ],
        "statuses": [
            f"“{words.STATUS[status]}”: {meaning}."
            for status, meaning in words.STATUS_MEANING.items()
            if (forces["status"] == status).any()
        ],
        "choice": next((n.message for n in run.notices_of(bead) if n.code == CHOICE), ""),
        "models": rows.model_rows(run, bead),
        "valid": {words.MODEL[name]: valid_range(name) for name in words.MODEL},
        "groups": notice_groups(run.notices_of(bead), {bead}),
        "charts": {
            "arrays": arrays.packed(),
            "figures": figures,
            "choices": choices,
            "captions": {
                key: trace_captions(one, sampled=key in choices["posterior"])
                for key, one in traces.items()
            },
            "first": (usable or list(traces) or [""])[0],
            "dark": DARK,
        },
        "drawn": figures,
        "axes": [axis for axis in "xyz" if any(key.endswith(axis) for key in traces)],
    }


def _bead_figures(arrays: Arrays, run: RunFolder, bead: str, means: PlateauMeans) -> dict[str, Any]:
    """The bead's charts that show all of it at once; those without anything to draw left out."""
    forces = run.forces[run.forces["bead"] == bead]
    fits = run.force_extension[run.force_extension["bead"] == bead]
    figures = {
        "force_extension": force_extension_figure(arrays, quoted(forces), fits, run.assay),
        "agreement": agreement_figure(arrays, comparisons(forces)),
        "geometry": geometry_figure(arrays, means, [bead]),
        "traces": traces_figure(
            arrays, run.traces[run.traces["bead"] == bead], forces.drop_duplicates("plateau")
        ),
    }
    if named := run.before_after.get(bead):
        figures["before_after"] = spectra_figure(arrays, named)
        figures["residuals"] = residuals_figure(named)
    if panels := left_panels(run, bead):
        figures["unexplained"] = unexplained_figure(arrays, panels)
    if shapes := left_shapes(run, bead):
        figures["shapes"] = shapes_figure(arrays, shapes)
    return {name: figure for name, figure in figures.items() if figure["data"]}


def _choices(arrays: Arrays, run: RunFolder, bead: str) -> dict[str, dict[str, Any]]:
    """The charts of single traces, by kind and by plateau and axis."""
    return {
        "spectrum": {
            key: spectrum_figure(arrays, table, key[-1])
            for key, table in _by_trace(run.spectra, bead).items()
        },
        "posterior": {
            key: posterior_figure(arrays, table, key[-1])
            for key, table in _by_trace(run.posteriors, bead).items()
        },
        "crosscheck": _crosscheck_curves(arrays, run, bead),
    }


def _by_trace(table: pd.DataFrame, bead: str) -> dict[str, pd.DataFrame]:
    """Rows of a bead by plateau and axis, as in `3/x`."""
    mine = table[table["bead"] == bead]
    return {
        f"{plateau}/{axis}": part for (plateau, axis), part in mine.groupby(["plateau", "axis"])
    }


def _crosscheck_curves(arrays: Arrays, run: RunFolder, bead: str) -> dict[str, Any]:
    """Recorded and simulated curves, by plateau and axis."""
    parts = [
        _by_trace(whole, bead)
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
