"""Tables of the cross-check: p-values, and curves beside those of simulations."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from mtpipe.crosschecking.crosscheck import CrossCheck
from mtpipe.crosschecking.curves import Kind
from mtpipe.recording.recording import AXES


def crosscheck_table(checked: CrossCheck | None) -> pd.DataFrame:
    """`crosscheck`: a row per statistic × bead × plateau × axis; none without a cross-check."""
    return (checked or CrossCheck("", {}, {})).table


# Per kind of curve: what it runs over, and what is recorded and simulated.
CURVES: Mapping[Kind, tuple[str, str, str]] = {
    "spectrum": ("frequency_hz", "power", "nm2_per_hz"),
    "histogram": ("deviation_nm", "density", "per_nm"),
    "allan": ("averaged_s", "variance", "nm2"),
}


def crosscheck_curves(checked: CrossCheck | None) -> dict[Kind, pd.DataFrame]:
    """`details/crosscheck_…`: recorded curves, and the median and 95 % of the simulated ones."""
    tables: dict[Kind, pd.DataFrame] = {}
    for kind, (over, quantity, unit) in CURVES.items():
        parts = [
            pd.DataFrame(
                {
                    "bead": bead,
                    "plateau": check.case.plateaus[curve.plateau].number,
                    "axis": AXES[curve.axis],
                    over: curve.at,
                    f"{quantity}_{unit}": curve.recorded,
                    f"simulated_{unit}": curve.median,
                    f"simulated_low_{unit}": curve.low,
                    f"simulated_high_{unit}": curve.high,
                }
            )
            for bead, check in (checked.beads if checked else {}).items()
            for curve in check.curves
            if curve.kind == kind
        ]
        columns = [
            "bead", "plateau", "axis", over, f"{quantity}_{unit}", f"simulated_{unit}",
            f"simulated_low_{unit}", f"simulated_high_{unit}",
        ]  # fmt: skip
        tables[kind] = (
            pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns)
        )
    return tables
