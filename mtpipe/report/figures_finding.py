"""The one small picture that shows what was found about a bead, and its caption.

Of a bead whose recording differs from the setup: what naming the cause changes, or what is left. Of
one that agrees: recorded power among the simulated. Without a cross-check: the fit of a spectrum.
Of a bead that is refused: its motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from mtpipe.ground.types import FloatArray
from mtpipe.report.figures_crosscheck import PER_UM
from mtpipe.report.figures_unexplained import SHAPE_WORDS, left_panels, left_shapes
from mtpipe.report.findings import clearest_place
from mtpipe.report.folder import RunFolder, records
from mtpipe.report.plotly_json import (
    AXIS_COLOUR,
    GREY,
    INK,
    PALE,
    Arrays,
    Figure,
    axis,
    band,
    bars,
    layout,
    log_axis,
)

HEIGHT_PX = 230
# Bins of a spectrum in a picture of this size, at most.
BINS = 24
RATIO = "recorded / expected"


@dataclass(frozen=True)
class Picture:
    """A figure with what it shows in one sentence."""

    figure: Figure
    caption: str


def picture(arrays: Arrays, run: RunFolder, bead: str) -> Picture | None:
    """The picture of a bead's finding; None where nothing of it was kept."""
    if (run.beads.loc[run.beads["bead"] == bead, "verdict"] == "refused").any():
        return _moved(arrays, run, bead)
    found = run.mismatch["beads"].get(bead, {"verdict": "", "located": ()})
    if found["verdict"] == "unexplained" and found["located"]:
        made = _unexplained(arrays, run, bead, found["located"][0])
    elif named := run.before_after.get(bead):
        made = _named(arrays, named)
    else:
        made = _power(arrays, run, bead)
    return made or _fitted(arrays, run, bead) or _moved(arrays, run, bead)


def _unexplained(
    arrays: Arrays, run: RunFolder, bead: str, located: Mapping[str, Any]
) -> Picture | None:
    """The most significant difference: in a spectrum, over time, or in another curve."""
    if place := clearest_place(run, bead):
        axis_name, one = place
        panels = [panel for panel in left_panels(run, bead) if panel["axis"] == axis_name]
        same = [panel for panel in panels if panel["plateau"] == one["plateau"]]
        if panels:
            return _left(arrays, (same or panels)[0])
    kind = "mean" if located["statistic"].startswith("mean") else "variance"
    of_time = [shape for shape in left_shapes(run, bead) if shape["kind"] == kind]
    if located["statistic"].startswith(("mean", "variance", "quietest")) and of_time:
        return _over_time(arrays, of_time[0])
    plateau = located["plateaus"][0] if located["plateaus"] else 0
    if located["statistic"] in ("skewness", "kurtosis"):
        return _distribution(arrays, run, bead, located["axis"], plateau)
    return _spectrum_simulated(arrays, run, bead, located["axis"], plateau) or _power(
        arrays, run, bead
    )


def _named(arrays: Arrays, named: Mapping[str, Any]) -> Picture | None:
    """Mean heights or the spectrum of an axis before and after: whichever changes more."""
    before, after = named["residuals"]["before"], named["residuals"]["after"]
    gain = {name: _squares(before[name]) - _squares(after[name]) for name in before}
    best = max(gain, key=lambda name: gain[name])
    if best == "height":
        return _heights(arrays, named)
    one = next((one for one in named["spectra"] if one["axis"] == best), None)
    if one is None:
        return None
    data = []
    for stage, colour, symbol, name in (
        ("before", GREY, "circle-open", "as configured"),
        ("after", AXIS_COLOUR[best], "circle", "with the causes found"),
    ):
        ratio = np.array(one[stage]["ratio"])
        error = bars(arrays, ratio / np.sqrt(one["ordinates"]), colour)
        data.append(_points(arrays, one["frequency_hz"], ratio, error, colour, symbol, name))
    ratios = [*one["before"]["ratio"], *one["after"]["ratio"], 0.9, 1.1]
    return Picture(
        _over_frequency(data, one["frequency_hz"], ratios),
        f"Recorded power along {best}, divided by the expected: plateau {one['plateau']}, whose "
        "spectrum changes most.",
    )


def _heights(arrays: Arrays, named: Mapping[str, Any]) -> Picture:
    plateaus = np.array(named["plateaus"], dtype=float)
    data = []
    for stage, colour, symbol, name in (
        ("before", GREY, "circle-open", "as configured"),
        ("after", AXIS_COLOUR["z"], "circle", "with the causes found"),
    ):
        height = named["residuals"][stage]["height"]
        values = np.array([np.nan if one is None else one for one in height], dtype=float)
        data.append(_points(arrays, plateaus, values, None, colour, symbol, name))
    made = _layout(
        xaxis=axis("plateau", dtick=1 if len(plateaus) <= 12 else None),
        yaxis=axis("standard errors"),
    )
    made["shapes"] = [_level(0)]
    return Picture(
        {"data": data, "layout": made}, "Mean height of each plateau: recorded minus expected."
    )


def _left(arrays: Arrays, panel: Mapping[str, Any]) -> Picture:
    """Recorded over expected power, and where there is one the correction that is left."""
    colour, f = AXIS_COLOUR[panel["axis"]], panel["frequency_hz"]
    error = bars(arrays, panel["ratio_stderr"], colour)
    data = [_points(arrays, f, panel["ratio"], error, colour, "circle", RATIO)]
    where = "all plateaus" if panel["plateau"] is None else f"plateau {panel['plateau']}"
    return Picture(
        _over_frequency(data, f, [*panel["ratio"], 0.9, 1.1]),
        f"Recorded power along {panel['axis']}, divided by the expected: {where}.",
    )


def _over_time(arrays: Arrays, shape: Mapping[str, Any]) -> Picture:
    """Mean or variance over the time of a plateau."""
    colour, value = AXIS_COLOUR[shape["axis"]], np.array(shape["value"], dtype=float)
    above = np.array(shape["value_high"], dtype=float) - value
    below = value - np.array(shape["value_low"], dtype=float)
    error = bars(arrays, above, colour, below=below)
    across, along, _ = SHAPE_WORDS[shape["kind"]]
    made = _layout(xaxis=axis(across), yaxis=axis(along))
    made["shapes"] = [_level(0 if shape["kind"] == "mean" else 1)]
    data = [_points(arrays, shape["at"], value, error, colour, "circle", "recorded")]
    what = "Mean position" if shape["kind"] == "mean" else "Variance"
    return Picture(
        {"data": data, "layout": made},
        f"{what} along {shape['axis']} within plateau {shape['plateau']}.",
    )


def _distribution(
    arrays: Arrays, run: RunFolder, bead: str, name: str, plateau: int
) -> Picture | None:
    """Recorded positions among the simulated."""
    table = _of_trace(run.crosscheck_histogram, bead, name, plateau)
    if table.empty:
        return None
    at, seen, low, high = _columns(
        table, "deviation_nm", "density_per_nm", "simulated_low_per_nm", "simulated_high_per_nm"
    )
    seen, low, high = (PER_UM * column for column in (seen, low, high))
    made = _layout(xaxis=axis("deviation from the mean / nm"), yaxis=axis("density / (1/µm)"))
    data = _among_simulated(arrays, at, seen, low, high, AXIS_COLOUR[name])
    return Picture(
        {"data": data, "layout": made},
        f"Distribution of positions along {name}, plateau {plateau}.",
    )


def _power(arrays: Arrays, run: RunFolder, bead: str) -> Picture | None:
    """Recorded power among the simulated where they differ most, be it by chance."""
    compared = run.crosscheck[
        (run.crosscheck["bead"] == bead)
        & (run.crosscheck["statistic"] == "psd_band")
        & run.crosscheck["plateau"].notna()
    ]
    if compared.empty:
        return None
    first = records(compared.sort_values("p_value", kind="stable").head(1))[0]
    return _spectrum_simulated(arrays, run, bead, first["axis"], int(first["plateau"]))


def _spectrum_simulated(
    arrays: Arrays, run: RunFolder, bead: str, name: str, plateau: int
) -> Picture | None:
    """Power over the median of simulations."""
    table = _of_trace(run.crosscheck_spectrum, bead, name, plateau)
    if table.empty:
        return None
    f, power, middle, low, high = _columns(
        table,
        "frequency_hz",
        "power_nm2_per_hz",
        "simulated_nm2_per_hz",
        "simulated_low_nm2_per_hz",
        "simulated_high_nm2_per_hz",
    )
    ratio = power / middle
    data = _among_simulated(arrays, f, ratio, low / middle, high / middle, AXIS_COLOUR[name])
    return Picture(
        _over_frequency(data, f, [*ratio, 0.9, 1.1], "recorded / simulated"),
        f"Recorded power along {name}, divided by the median of simulations: plateau {plateau}.",
    )


def _among_simulated(
    arrays: Arrays,
    at: FloatArray,
    seen: FloatArray,
    low: FloatArray,
    high: FloatArray,
    colour: str,
) -> list[dict[str, Any]]:
    return [
        band(arrays, at, low, high, PALE, name="95 % of simulations"),
        _points(arrays, at, seen, None, colour, "circle", "recorded"),
    ]


def _of_trace(table: pd.DataFrame, bead: str, name: str, plateau: int) -> pd.DataFrame:
    return table[(table["bead"] == bead) & (table["axis"] == name) & (table["plateau"] == plateau)]


def _columns(table: pd.DataFrame, *names: str) -> list[FloatArray]:
    return [table[name].to_numpy(np.float64) for name in names]


def _fitted(arrays: Arrays, run: RunFolder, bead: str) -> Picture | None:
    """The first spectrum along x, else y, with its fit."""
    mine = run.spectra[(run.spectra["bead"] == bead) & run.spectra["model_nm2_per_hz"].notna()]
    for name in ("x", "y"):
        table = mine[mine["axis"] == name]
        if len(table):
            plateau = int(table["plateau"].min())
            return _spectrum(arrays, table[table["plateau"] == plateau], name, plateau)
    return None


def _spectrum(arrays: Arrays, table: pd.DataFrame, name: str, plateau: int) -> Picture:
    frequency, n = table["frequency_hz"].to_numpy(), table["ordinates"].to_numpy(np.float64)
    ratio = (table["power_nm2_per_hz"] / table["model_nm2_per_hz"]).to_numpy()
    edges = np.geomspace(frequency.min(), frequency.max() * 1.001, BINS + 1)
    which = np.digitize(frequency, edges)
    inside = [which == bin_ for bin_ in np.unique(which)]
    f = np.array([np.average(frequency[one], weights=n[one]) for one in inside])
    mean = np.array([np.average(ratio[one], weights=n[one]) for one in inside])
    ordinates = np.array([n[one].sum() for one in inside])
    colour = AXIS_COLOUR[name]
    error = bars(arrays, mean / np.sqrt(ordinates), colour)
    data = [_points(arrays, f, mean, error, colour, "circle", "recorded / fitted")]
    return Picture(
        _over_frequency(data, f, [*mean, 0.9, 1.1], "recorded / fitted"),
        f"Recorded power along {name}, divided by the fitted: plateau {plateau}.",
    )


def _moved(arrays: Arrays, run: RunFolder, bead: str) -> Picture | None:
    """The motion along x, else y, after drift subtraction."""
    mine = run.traces[(run.traces["bead"] == bead) & (run.traces["stage"] == "subtracted")]
    for name in ("x", "y"):
        table = mine[mine["axis"] == name].sort_values("time_s")
        if table.empty:
            continue
        t, low, high = (
            table[column].to_numpy(np.float64) for column in ("time_s", "low_nm", "high_nm")
        )
        made = _layout(xaxis=axis("time / s"), yaxis=axis(f"{name} / nm"))
        data = [band(arrays, t, low, high, AXIS_COLOUR[name])]
        return Picture({"data": data, "layout": made}, f"Motion along {name} after drift "
                       "subtraction.")  # fmt: skip
    return None


def _points(
    arrays: Arrays,
    x: ArrayLike,
    y: ArrayLike,
    error: dict[str, Any] | None,
    colour: str,
    symbol: str,
    name: str,
) -> dict[str, Any]:
    made = {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "x": arrays.add(x),
        "y": arrays.add(y),
        "marker": {"color": colour, "size": 5, "symbol": symbol},
        "hovertemplate": f"{name}: %{{y:.3g}}<extra></extra>",
    }
    return made | ({} if error is None else {"error_y": error})


def _over_frequency(
    data: list[dict[str, Any]], frequency_hz: ArrayLike, seen: ArrayLike, title: str = RATIO
) -> Figure:
    made = _layout(
        xaxis=log_axis("frequency / Hz", frequency_hz, dense=20), yaxis=log_axis(title, seen)
    )
    made["shapes"] = [_level(1)]
    return {"data": data, "layout": made}


def _layout(**axes: Any) -> dict[str, Any]:
    made = layout(HEIGHT_PX, **axes)
    made["margin"] = {"l": 56, "r": 8, "t": 26, "b": 44}
    return made


def _level(y: float) -> dict[str, Any]:
    """A line where recorded and expected are equal."""
    line = {"color": INK, "width": 1}
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": y, "y1": y, "line": line}


def _squares(residuals: Any) -> float:
    """Sum of squares of nested lists of numbers, None left out."""
    if isinstance(residuals, list):
        return sum(map(_squares, residuals))
    return 0.0 if residuals is None else float(residuals) ** 2
