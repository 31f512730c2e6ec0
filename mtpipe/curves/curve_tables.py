"""Curves as tables: what was fitted, and the points, from which it can be fitted again."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from mtpipe.curves.extension_curve import ForceExtension
from mtpipe.fit.points import Assay, ExtensionPoints
from mtpipe.fit.tether import TetherFit
from mtpipe.ground.estimate_columns import four


def tether_columns(fit: TetherFit | None) -> dict[str, float]:
    """Four columns for each parameter of a tether's fit; nan where there is none."""
    return {
        **four("contour_length", "nm", fit.contour_length_nm if fit else None),
        **four("persistence_length", "nm", fit.persistence_length_nm if fit else None),
        **four("stretch_modulus", "pN", fit.stretch_modulus_pN if fit else None),
    }


def force_extension_table(curves: Mapping[str, ForceExtension]) -> pd.DataFrame:
    """`details/force_extension`: a row per bead × model."""
    columns = [
        "bead", "model", *tether_columns(None), "offset_nm", "force_low_pN",
        "force_high_pN", "points", "chi2", "dof", "p_value", "recommended",
    ]  # fmt: skip
    rows = [
        {
            "bead": bead,
            "model": fit.model,
            **tether_columns(fit),
            "offset_nm": 0.0 if fit.offset_nm is None else fit.offset_nm.value,
            "force_low_pN": fit.force_range_pN[0],
            "force_high_pN": fit.force_range_pN[1],
            "points": fit.points,
            "chi2": fit.chi2,
            "dof": fit.dof,
            "p_value": fit.p_value,
            "recommended": fit is curve.recommended,
        }
        for bead, curve in curves.items()
        for fit in curve.fits
    ]
    return pd.DataFrame(rows, columns=columns)


def points_table(curves: Mapping[str, ForceExtension]) -> pd.DataFrame:
    """`details/curve_points`: a row per bead × plateau, as the curves were fitted to."""
    columns = [
        "bead", "plateau", "force_pN", "force_stderr_pN", "extension_nm", "extension_stderr_nm",
        "lever_nm", "zero_stderr_nm",
    ]  # fmt: skip
    parts = [
        curve.table.assign(
            bead=bead,
            lever_nm=np.nan if curve.points.lever_nm is None else curve.points.lever_nm,
            zero_stderr_nm=curve.assay.zero_stderr_nm,
        )[columns]
        for bead, curve in curves.items()
    ]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns)


def stage_table(curves: Mapping[str, ForceExtension]) -> pd.DataFrame:
    """`details/curve_stage`: covariance of a bead's extensions by the stage's motion, if any."""
    rows = [
        {"bead": bead, "plateau": one, "other_plateau": other, "covariance_nm2": covariance[i, j]}
        for bead, curve in curves.items()
        if (covariance := curve.points.stage_nm2) is not None
        for i, one in enumerate(curve.points.plateau)
        for j, other in enumerate(curve.points.plateau)
    ]
    return pd.DataFrame(rows, columns=["bead", "plateau", "other_plateau", "covariance_nm2"])


def curves_of_tables(
    points: pd.DataFrame, stage: pd.DataFrame, assay: Assay
) -> dict[str, tuple[ExtensionPoints, Assay]]:
    """What `fit_curves` takes, from the two tables.

    Parameters
    ----------
    assay : of all beads, but for the error of z = 0.
    """
    found = {}
    for bead, mine in points.groupby("bead", sort=False):
        moved = stage[stage["bead"] == bead]
        plateau = mine["plateau"].to_numpy(np.int64)
        force, force_error, extension, extension_error, lever = (
            mine[name].to_numpy(np.float64)
            for name in (
                "force_pN", "force_stderr_pN", "extension_nm", "extension_stderr_nm", "lever_nm"
            )
        )  # fmt: skip
        square = None
        if len(moved):
            wide = moved.pivot_table("covariance_nm2", "plateau", "other_plateau")
            square = wide.loc[plateau, plateau].to_numpy(np.float64)
        found[str(bead)] = (
            ExtensionPoints(
                plateau, force, force_error, extension, extension_error,
                None if np.isnan(lever).all() else lever, square,
            ),
            Assay(
                assay.temperature_K, assay.relation, assay.bead_turns,
                float(mine["zero_stderr_nm"].iloc[0]),
            ),
        )  # fmt: skip
    return found
