"""Reading a run folder (docs/run-folder.md): checked once, so that whatever passes can be drawn.

`contents` says what the JSON files hold, `columns` what the tables do. All files have to be of one
run: each carries its identity.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow.fs import LocalFileSystem
from pydantic import ValidationError

from mtpipe.fit.points import Assay
from mtpipe.ground.errors import MtpipeError, SetupError
from mtpipe.ground.notice import Notice
from mtpipe.ingest.announced import check_fits
from mtpipe.methods import METHODS
from mtpipe.recording.recording import AXES
from mtpipe.report.columns import check
from mtpipe.report.contents import (
    BeforeAfterContent,
    Content,
    MismatchContent,
    RunContent,
    UnexplainedContent,
)
from mtpipe.report.run_folder import finish
from mtpipe.setup.setup import Setup, parse_setup

# Decimal digits that always fit into an int64.
MOST_DIGITS = 18


class RunFolderError(MtpipeError):
    """The folder is no run folder, or a file is missing, damaged, of another version or run."""


def _four(quantity: str, unit: str) -> tuple[str, ...]:
    return tuple(f"{quantity}{part}_{unit}" for part in ("", "_stderr", "_low", "_high"))


COLUMNS: Mapping[str, tuple[str, ...]] = {
    "forces.parquet": (
        *("bead", "plateau", "axis", "magnet_mm", "start_s", "duration_s", "frames"),
        *("lost_frames", "extension_nm", "extension_stderr_nm"),
        *_four("force", "pN"),
        *("force_source", "force_status"),
        *_four("force_axis", "pN"),
        *("force_configured_pN", "force_configured_stderr_pN"),
        *("force_named_pN", "force_named_stderr_pN"),
        *_four("stiffness", "pN_per_nm"),
        *_four("friction", "pN_s_per_nm"),
        *_four("corner_frequency", "hz"),
        *_four("effective_radius", "nm"),
        *_four("noise", "nm"),
        *("status", "tied_to", "method", "fit_deviance", "fit_dof", "fit_p_value"),
        *("posterior_rhat", "posterior_ess", "posterior_converged", "nyquist_ratio"),
        *("flags", "refusal"),
    ),
    "beads.parquet": (
        *("bead", "verdict", "reasons", "mismatch", "force_bound_percent", "material"),
        *("plateaus", "plateaus_used"),
        *("force_min_pN", "force_max_pN", "tether_model"),
        *_four("contour_length", "nm"),
        *_four("persistence_length", "nm"),
        *_four("stretch_modulus", "pN"),
        *_four("radius", "nm"),
        *("series", "friction_ratio", "friction_ratio_stderr"),
        *(name for axis in AXES for name in _four(f"noise_floor_{axis}", "nm")),
        *(f"image_precision_{axis}_nm" for axis in AXES),
    ),
    "details/spectra.parquet": (
        *("bead", "plateau", "axis", "frequency_hz", "ordinates"),
        *("power_nm2_per_hz", "model_nm2_per_hz"),
    ),
    "details/traces.parquet": (
        *("bead", "axis", "stage", "time_s", "low_nm", "mean_nm", "high_nm"),
    ),
    "details/drift.parquet": ("time_s", "axis", "drift_nm"),
    "details/references.parquet": (
        *("bead", "used", "reason", "weight_x", "weight_y", "weight_z"),
        *("noise_x_nm", "noise_y_nm", "noise_z_nm"),
    ),
    "details/posteriors.parquet": (
        *("bead", "plateau", "axis", "force_pN", "stiffness_pN_per_nm"),
        *("friction_pN_s_per_nm", "noise_nm"),
    ),
    "details/force_extension.parquet": (
        *("bead", "model"),
        *_four("contour_length", "nm"),
        *_four("persistence_length", "nm"),
        *_four("stretch_modulus", "pN"),
        *("offset_nm", "force_low_pN", "force_high_pN"),
        *("points", "chi2", "dof", "p_value", "recommended"),
    ),
    "details/curve_points.parquet": (
        *("bead", "plateau", "force_pN", "force_stderr_pN", "extension_nm", "extension_stderr_nm"),
        *("lever_nm", "zero_stderr_nm"),
    ),
    "details/curve_stage.parquet": ("bead", "plateau", "other_plateau", "covariance_nm2"),
    "crosscheck.parquet": (
        *("bead", "statistic", "axis", "plateau", "magnet_mm", "band_low_hz", "band_high_hz"),
        *("time_low_s", "time_high_s", "value"),
        *("simulated_median", "simulated_low", "simulated_high"),
        *("p_value", "extrapolated", "simulations", "bead_p_value"),
    ),
    "details/crosscheck_spectrum.parquet": (
        *("bead", "plateau", "axis", "frequency_hz", "power_nm2_per_hz"),
        *("simulated_nm2_per_hz", "simulated_low_nm2_per_hz", "simulated_high_nm2_per_hz"),
    ),
    "details/crosscheck_histogram.parquet": (
        *("bead", "plateau", "axis", "deviation_nm", "density_per_nm"),
        *("simulated_per_nm", "simulated_low_per_nm", "simulated_high_per_nm"),
    ),
    "details/crosscheck_allan.parquet": (
        *("bead", "plateau", "axis", "averaged_s", "variance_nm2"),
        *("simulated_nm2", "simulated_low_nm2", "simulated_high_nm2"),
    ),
}  # fmt: skip


JSON_FILES: Mapping[str, type[Content]] = {
    "mismatch.json": MismatchContent,
    "details/before_after.json": BeforeAfterContent,
    "details/unexplained.json": UnexplainedContent,
}


@dataclass(frozen=True)
class RunFolder:
    """Everything a report is drawn from; tables with the columns of docs/run-folder.md.

    `forces` are mtpipe's own, a row per trace; `others` those by other methods of the field.
    `mismatch` is the diagnosis (FORMATS section 4), `before_after` by bead what is drawn of what it
    names, `unexplained` what it leaves.
    """

    run: Mapping[str, Any]
    mismatch: Mapping[str, Any]
    before_after: Mapping[str, Any]
    unexplained: Mapping[str, Any]
    setup: Setup
    notices: tuple[Notice, ...]
    forces: pd.DataFrame
    others: pd.DataFrame
    beads: pd.DataFrame
    spectra: pd.DataFrame
    traces: pd.DataFrame
    drift: pd.DataFrame
    references: pd.DataFrame
    posteriors: pd.DataFrame
    force_extension: pd.DataFrame
    curve_points: pd.DataFrame
    curve_stage: pd.DataFrame
    crosscheck: pd.DataFrame
    crosscheck_spectrum: pd.DataFrame
    crosscheck_histogram: pd.DataFrame
    crosscheck_allan: pd.DataFrame

    @property
    def assay(self) -> Assay:
        """How extensions and forces of its curves came about."""
        turns = self.setup.model.turns
        return Assay(self.run["conditions"]["temperature_K"], bead_turns=turns)

    def notices_of(self, bead: str) -> tuple[Notice, ...]:
        """The notices that concern one bead."""
        return tuple(n for n in self.notices if n.bead == bead)


def read_run_folder(folder: Path) -> RunFolder:
    """Read a run folder.

    Raises
    ------
    RunFolderError : a file is missing, damaged, of another run, or holds something else than it
        should; names file and place.
    """
    finish(folder)
    run = _read_json(folder / "run.json", RunContent)
    contents = {name: _read_json(folder / name, model) for name, model in JSON_FILES.items()}
    tables = {name: _read_table(folder / name, columns) for name, columns in COLUMNS.items()}
    runs = {name: content["run"] for name, content in contents.items()}
    runs |= {name: table.attrs.get("run") for name, table in tables.items()}
    for name, its_run in runs.items():
        if its_run != run["run"]:
            text = f"belongs to another run than {folder / 'run.json'}"
            raise RunFolderError(text, where=str(folder / name), mend=_AGAIN)
    _check_beads(folder, tables, contents["mismatch.json"]["beads"])
    by_others = tables["forces.parquet"]["method"].isin(METHODS)
    others = tables["forces.parquet"][by_others]
    tables["forces.parquet"] = tables["forces.parquet"][~by_others]
    return RunFolder(
        others=others,
        run=run,
        mismatch=contents["mismatch.json"],
        before_after=contents["details/before_after.json"]["beads"],
        unexplained=contents["details/unexplained.json"]["beads"],
        setup=_setup(run["setup"], folder / "run.json"),
        notices=tuple(Notice(**notice) for notice in run["notices"]),
        **{Path(name).stem: table for name, table in tables.items()},
    )


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table as dictionaries by column name."""
    return [{str(key): value for key, value in row.items()} for row in table.to_dict("records")]


def _read_json(path: Path, model: type[Content]) -> dict[str, Any]:
    try:
        data = path.read_bytes()
        model.model_validate_json(data)
        return dict(json.loads(data, parse_int=_whole))
    except FileNotFoundError:
        raise RunFolderError(
            "there is no such file, so this is no folder that mtpipe run has written",
            where=str(path),
        ) from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        said = f"is damaged, edited or of another version ({place}: {first['msg']})"
        raise RunFolderError(said, where=str(path), mend=_AGAIN) from None
    except (OSError, ValueError) as error:
        raise RunFolderError(f"cannot be read ({error}).", where=str(path), mend=_AGAIN) from None


def _whole(digits: str) -> int | float:
    """A whole number of JSON, which numpy takes for an object where it has too many digits."""
    return int(digits) if len(digits) <= MOST_DIGITS else float(digits)


def _read_table(path: Path, columns: tuple[str, ...]) -> pd.DataFrame:
    try:
        content = pq.read_metadata(path, filesystem=LocalFileSystem())
        check_fits(content.num_rows * content.num_columns, path.name)
        # a file opened in Python could still be held by a thread of pyarrow's as the process ends
        table = pd.read_parquet(path, filesystem=LocalFileSystem(), page_checksum_verification=True)
        table = table.reset_index(drop=True)  # damage can make an index of a column
        _check_text(table)
    except FileNotFoundError:
        raise RunFolderError("is missing.", where=str(path), mend=_AGAIN) from None
    except Exception as error:  # pyarrow and pandas raise anything on a damaged file
        reason = " ".join(str(error).split())[:200]
        raise RunFolderError(f"cannot be read ({reason}).", where=str(path), mend=_AGAIN) from None
    try:
        check(table, columns, several_axes=path.name == "crosscheck.parquet")
    except ValueError as error:
        raise RunFolderError(f"{error}.", where=str(path), mend=_AGAIN) from None
    return table


def _check_text(table: pd.DataFrame) -> None:
    """Raise ArrowInvalid if text is no UTF-8, which pandas takes as it is."""
    for name in table.columns:
        if isinstance(table[name].dtype, pd.StringDtype):
            pa.array(table[name]).validate(full=True)


def _check_beads(
    folder: Path, tables: Mapping[str, pd.DataFrame], diagnosed: Mapping[str, Any]
) -> None:
    """Raise RunFolderError if files contradict each other on which beads there are, and what of.

    A trace is there once and of a bead in table `beads`, which says the same of each as the
    diagnosis.
    """
    known = tables["beads.parquet"]["bead"]
    forces = tables["forces.parquet"]
    where = str(folder / "forces.parquet")
    if not known.is_unique or not forces["bead"].isin(known).all():
        raise RunFolderError("has other beads than beads.parquet.", where=where, mend=_AGAIN)
    if forces.duplicated(["bead", "plateau", "axis", "method"]).any():
        raise RunFolderError("has a trace twice.", where=where, mend=_AGAIN)
    for row in records(tables["beads.parquet"]):
        verdict = diagnosed.get(row["bead"], {"verdict": ""})["verdict"]
        if (row["mismatch"] or "") != verdict:
            where = str(folder / "mismatch.json")
            text = f"says of bead {row['bead']} something else than beads.parquet."
            raise RunFolderError(text, where=where, mend=_AGAIN)


def _setup(content: Mapping[str, Any], where: Path) -> Setup:
    try:
        return parse_setup(_experiment(content), where=f"{where}, setup")
    except SetupError as error:
        raise RunFolderError(error.message, where=error.where, mend=_AGAIN) from None


def _experiment(setup: Mapping[str, Any]) -> dict[str, Any]:
    """The setup without the layout of its files, and without the nulls of what it leaves out."""
    return {
        name: {k: v for k, v in table.items() if v is not None}
        if isinstance(table, dict)
        else table
        for name, table in setup.items()
        if name != "source"
    }


_AGAIN = "Analyse the recording again with this version of mtpipe."
