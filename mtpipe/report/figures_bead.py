"""The charts of one bead: spectra, posteriors, force–extension, agreement of x and y, traces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import gamma

from mtpipe.physics.tether import VALIDITY, Chain, extension_nm
from mtpipe.report import words
from mtpipe.report.folder import RunFolder, records
from mtpipe.report.plotly_json import (
    AXIS_COLOUR,
    AXIS_SYMBOL,
    GREY,
    INK,
    PALE,
    PALER,
    Arrays,
    Figure,
    axis,
    band,
    layout,
    log_axis,
    positive,
    with_gaps,
)

FloatArray = NDArray[np.float64]
POSTERIOR_DRAWN = 400  # points in a scatter; more only overlap
MODEL_DASH = {"marko-siggia": "dash", "bouchiat": "solid", "extensible": "dashdot"}
MODEL_COLOUR = {"marko-siggia": "#cc79a7", "bouchiat": INK, "extensible": "#009e73"}


def spectrum_figure(arrays: Arrays, table: pd.DataFrame, axis_name: str) -> Figure:
    """Spectrum and model of one trace above, data over model below.

    A bin that averages n ordinates of a periodogram scatters about the model as a Gamma variable
    of shape n and mean 1; the bands are its central 68 and 95 %.
    """
    table = table.sort_values("frequency_hz")
    f, n, power, model = (
        table[name].to_numpy(np.float64)
        for name in ("frequency_hz", "ordinates", "power_nm2_per_hz", "model_nm2_per_hz")
    )
    ratio = power / model
    edge = {
        q: np.where(np.isfinite(model), gamma.ppf(q, n, scale=1 / n), np.nan)
        for q in (0.025, 0.16, 0.84, 0.975)
    }
    colour = AXIS_COLOUR[axis_name]
    points = {
        "type": "scatter",
        "mode": "markers",
        "x": arrays.add(f),
        "customdata": arrays.add(n),
        "marker": {"color": colour, "size": 5, "symbol": AXIS_SYMBOL[axis_name]},
    }
    lower: dict[str, Any] = {"yaxis": "y2", "showlegend": False}
    data: list[dict[str, Any]] = [
        band(arrays, f, model * edge[0.025], model * edge[0.975], PALER, name="95 % of bins"),
        band(arrays, f, model * edge[0.16], model * edge[0.84], PALE, name="68 % of bins"),
        points
        | {
            "y": arrays.add(power),
            "name": "data",
            "hovertemplate": "%{x:.3g} Hz: %{y:.3g} nm²/Hz<br>mean of %{customdata} ordinates"
            "<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": arrays.add(f),
            "y": arrays.add(model),
            "name": "fitted model",
            "line": {"color": INK, "width": 1.5},
            "hovertemplate": "model %{y:.3g} nm²/Hz<extra></extra>",
        },
        band(arrays, f, edge[0.025], edge[0.975], PALER, **lower),
        band(arrays, f, edge[0.16], edge[0.84], PALE, **lower),
        points
        | lower
        | {
            "y": arrays.add(ratio),
            "hovertemplate": "%{x:.3g} Hz: data/model %{y:.3g}<br>mean of %{customdata} ordinates"
            "<extra></extra>",
        },
    ]
    one = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": "y2", "y0": 1, "y1": 1}
    return {
        "data": data,
        "layout": layout(
            460,
            xaxis=log_axis("frequency / Hz", f, anchor="y2"),
            yaxis=log_axis("power density / (nm²/Hz)", power, domain=[0.36, 1]),
            yaxis2=log_axis("data / model", ratio, domain=[0, 0.28]),
            shapes=[one | {"line": {"color": INK, "width": 1}}],
            annotations=[] if np.isfinite(model).any() else [_note("no model: trace refused")],
        ),
    }


def posterior_figure(arrays: Arrays, table: pd.DataFrame, row: dict[str, Any]) -> Figure:
    """Posterior of one trace: stiffness against friction with marginals, and the force."""
    table = table.iloc[:: max(1, -(-len(table) // POSTERIOR_DRAWN))]
    colour = AXIS_COLOUR[row["axis"]]
    columns = {
        "stiffness": (table["stiffness_pN_per_nm"].to_numpy(np.float64) * 1e3, "10⁻³ pN/nm"),
        "friction": (table["friction_pN_s_per_nm"].to_numpy(np.float64) * 1e6, "10⁻⁶ pN·s/nm"),
        "force": (table["force_pN"].to_numpy(np.float64), "pN"),
    }
    kept = {name: arrays.add(values) for name, (values, _) in columns.items()}
    bars: dict[str, Any] = {"type": "histogram", "marker": {"color": colour}, "opacity": 0.75}
    bars |= {"showlegend": False, "nbinsx": 30, "nbinsy": 30}
    counts: dict[str, Any] = {
        "showticklabels": False,
        "ticks": "",
        "showgrid": False,
        "fixedrange": True,
    }
    has_force = bool(np.isfinite(columns["force"][0]).any())
    right = 0.56 if has_force else 1.0
    split = right - 0.1
    data: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "markers",
            "x": kept["friction"],
            "y": kept["stiffness"],
            "marker": {"color": colour, "size": 4, "opacity": 0.5},
            "showlegend": False,
            "hovertemplate": "friction %{x:.4g} × 10⁻⁶ pN·s/nm<br>stiffness %{y:.4g} × 10⁻³ pN/nm"
            "<extra></extra>",
        },
        bars | {"x": kept["friction"], "yaxis": "y2", "hovertemplate": "%{x}: %{y}<extra></extra>"},
        bars
        | {"y": kept["stiffness"], "xaxis": "x2", "hovertemplate": "%{y}: %{x}<extra></extra>"},
    ]
    made = layout(
        360,
        bargap=0.04,
        xaxis=axis(f"friction / ({columns['friction'][1]})", domain=[0, split], nticks=5),
        yaxis=axis(f"stiffness / ({columns['stiffness'][1]})", domain=[0, 0.78]),
        yaxis2=axis(domain=[0.82, 1], anchor="x", **counts),
        xaxis2=axis(domain=[split + 0.02, right], anchor="y", **counts),
        shapes=[],
    )
    if has_force:
        data.append(
            bars
            | {"x": kept["force"], "xaxis": "x3", "yaxis": "y3"}
            | {"hovertemplate": "%{x} pN: %{y} of the sample<extra></extra>"}
        )
        made["xaxis3"] = axis("force / pN", domain=[0.66, 1], anchor="y3", nticks=5)
        made["yaxis3"] = axis(domain=[0, 1], anchor="x3", **counts)
        made["shapes"] = _force_lines(row)
    return {"data": data, "layout": made}


def force_extension_figure(arrays: Arrays, folder: RunFolder, bead: str) -> Figure:
    """Force against extension, x and y, with every model: solid where fitted, thin elsewhere."""
    forces = folder.forces[(folder.forces["bead"] == bead) & folder.forces["force_pN"].notna()]
    data: list[dict[str, Any]] = []
    for name, table in forces.groupby("axis"):
        colour = AXIS_COLOUR[str(name)]
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": f"force from {name}",
                "x": arrays.add(table["extension_nm"]),
                "y": arrays.add(table["force_pN"]),
                "error_x": _errors(arrays, table["extension_stderr_nm"], colour),
                "error_y": _errors(arrays, table["force_stderr_pN"], colour),
                "customdata": arrays.add(table["plateau"]),
                "marker": {"color": colour, "size": 8, "symbol": AXIS_SYMBOL[str(name)]},
                "hovertemplate": f"plateau %{{customdata}}, {name}<br>%{{x:.1f}} nm, %{{y:.3g}} pN"
                "<extra></extra>",
            }
        )
    temperature = folder.setup.buffer.temperature_K.value
    fits = folder.force_extension[folder.force_extension["bead"] == bead]
    seen = positive(forces["force_pN"])
    if temperature is not None and len(seen):
        grid = np.geomspace(seen.min() / 1.5, seen.max() * 1.5, 200)
        for fit in records(fits):
            data += _model_lines(arrays, fit, temperature, grid)
    return {
        "data": data,
        "layout": layout(
            380,
            xaxis=axis("mean extension / nm"),
            yaxis=log_axis("force / pN", seen),
        ),
    }


def agreement_figure(arrays: Arrays, folder: RunFolder, bead: str) -> Figure:
    """F_y over F_x for each plateau; 1 where the geometry and the extension are right."""
    forces = folder.forces[folder.forces["bead"] == bead]
    wide = forces.pivot_table(
        index="plateau", columns="axis", values=["force_pN", "force_stderr_pN"]
    ).dropna()
    if not {"x", "y"} <= set(wide["force_pN"].columns if len(wide) else ()):
        return {"data": [], "layout": layout(380)}
    x, y = (wide["force_pN"][name].to_numpy(np.float64) for name in "xy")
    relative = np.hypot(*(wide["force_stderr_pN"][a] / wide["force_pN"][a] for a in "xy"))
    one = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1}
    return {
        "data": [
            {
                "type": "scatter",
                "mode": "markers",
                "x": arrays.add(x),
                "y": arrays.add(y / x),
                "error_y": _errors(arrays, y / x * relative, INK),
                "customdata": arrays.add(wide.index.to_numpy(np.float64)),
                "marker": {"color": INK, "size": 8},
                "showlegend": False,
                "hovertemplate": "plateau %{customdata}<br>F<sub>x</sub> %{x:.3g} pN, "
                "F<sub>y</sub>/F<sub>x</sub> %{y:.3f}<extra></extra>",
            }
        ],
        "layout": layout(
            380,
            xaxis=log_axis("F<sub>x</sub> / pN", x),
            yaxis=axis("F<sub>y</sub> / F<sub>x</sub>"),
            shapes=[one | {"line": {"color": GREY, "width": 1, "dash": "dash"}}],
        ),
    }


def traces_figure(arrays: Arrays, folder: RunFolder, bead: str) -> Figure:
    """Traces before (left) and after drift subtraction (right), on the same scales."""
    table = folder.traces[folder.traces["bead"] == bead]
    stages = [s for s in ("raw", "subtracted") if (table["stage"] == s).any()]
    width = 1 / max(len(stages), 1)
    made = layout(640, showlegend=False, shapes=[], annotations=[])
    made["margin"]["t"] = 48
    data: list[dict[str, Any]] = []
    plateaus = folder.forces[folder.forces["bead"] == bead].drop_duplicates("plateau")
    for column, stage in enumerate(stages):
        left, right = column * width + 0.02 * column, (column + 1) * width - 0.02 * (1 - column)
        for line, name in enumerate("xyz"):
            number = 3 * column + line + 1
            suffix = "" if number == 1 else str(number)
            trace = table[(table["stage"] == stage) & (table["axis"] == name)]
            trace = trace.sort_values("time_s")
            t, low, mean, high = with_gaps(
                *(trace[c].to_numpy(np.float64) for c in ("time_s", "low_nm", "mean_nm", "high_nm"))
            )
            on = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
            colour = AXIS_COLOUR[name]
            data += [
                band(arrays, t, low, high, _pale(colour), **on),
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": arrays.add(t),
                    "y": arrays.add(mean),
                    "line": {"color": colour, "width": 1},
                    "hovertemplate": f"%{{x:.2f}} s: mean {name} %{{y:.1f}} nm<extra></extra>",
                    **on,
                },
            ]
            top = 1 - line * 0.345
            ties = {} if number == 1 else {"matches": "x"}
            made[f"xaxis{suffix}"] = axis(
                "time / s" if line == 2 else "",
                domain=[left, right],
                anchor=f"y{suffix}",
                showticklabels=line == 2,
                **ties,
            )
            made[f"yaxis{suffix}"] = axis(
                f"{name} / nm" if column == 0 else "",
                domain=[top - 0.31, top],
                anchor=f"x{suffix}",
                showticklabels=column == 0 and bool(np.isfinite(mean).any()),
                **({"matches": f"y{line + 1 if line else ''}"} if column else {}),
            )
            if not np.isfinite(mean).any():
                made["annotations"].append(
                    _note(
                        f"{name} was not recorded",
                        xref=f"x{suffix} domain",
                        yref=f"y{suffix} domain",
                    )
                )
        title = {"raw": "as recorded", "subtracted": "after drift subtraction"}[stage]
        made["annotations"].append(
            {"text": title, "xref": "paper", "yref": "paper", "x": left, "y": 1.0}
            | {"showarrow": False, "xanchor": "left", "yanchor": "bottom", "yshift": 18}
        )
    made["shapes"] = [
        {"type": "rect", "layer": "below", "line": {"width": 0}, "fillcolor": "#f4f5f7"}
        | {"xref": f"x{4 if column else ''}", "yref": "paper", "y0": 0, "y1": 1}
        | {"x0": row["start_s"], "x1": row["start_s"] + row["duration_s"]}
        | {
            "label": {
                "text": str(int(row["plateau"])),
                "textposition": "top center",
                "yanchor": "bottom",
            }
        }
        for column in range(len(stages))
        for row in records(plateaus)
    ]
    return {"data": data, "layout": made}


def _model_lines(
    arrays: Arrays, fit: dict[str, Any], temperature_K: float, grid: FloatArray
) -> list[dict[str, Any]]:
    model = fit["model"]
    if not (
        words.is_number(fit["contour_length_nm"]) and words.is_number(fit["persistence_length_nm"])
    ):
        return []
    modulus = fit["stretch_modulus_pN"] if model == "extensible" else None
    chain = Chain(
        fit["contour_length_nm"], fit["persistence_length_nm"], temperature_K, model, modulus
    )
    name = words.MODEL[model] + (" (recommended)" if fit["recommended"] else "")
    fitted = np.linspace(0, 1, 120)
    low, high = fit["force_low_pN"], fit["force_high_pN"]
    inside = low * (high / low) ** fitted
    line = {"color": MODEL_COLOUR[model], "dash": MODEL_DASH[model]}
    common = {"type": "scatter", "mode": "lines", "legendgroup": model}
    hover = f"{words.MODEL[model]}: %{{x:.1f}} nm, %{{y:.3g}} pN<extra></extra>"
    return [
        common
        | {
            "name": name,
            "x": arrays.add(extension_nm(chain, inside)),
            "y": arrays.add(inside),
            "line": line | {"width": 2.2 if fit["recommended"] else 1.6},
            "hovertemplate": hover,
        },
        common
        | {
            "showlegend": False,
            "x": arrays.add(extension_nm(chain, grid)),
            "y": arrays.add(grid),
            "line": line | {"width": 0.6},
            "hovertemplate": hover,
        },
    ]


def valid_range(model: str) -> tuple[str, str]:
    """Forces for which a model describes DNA, and the reason."""
    valid = VALIDITY[model]  # type: ignore[index]
    low, high = valid.force_range_pN
    shown = f"up to {words.number(high)}" if low == 0 else words.span(low, high)
    return shown, valid.reason


def _force_lines(row: dict[str, Any]) -> list[dict[str, Any]]:
    lines: list[dict[str, Any]] = []
    base = {"xref": "x3", "yref": "y3 domain", "y0": 0, "y1": 1}
    low, high = row["force_low_pN"], row["force_high_pN"]
    if words.is_number(low) and words.is_number(high):
        lines.append(
            base
            | {"type": "rect", "x0": low, "x1": high, "fillcolor": PALE, "layer": "below"}
            | {"line": {"width": 0}}
        )
    if words.is_number(row["force_pN"]):
        lines.append(
            base
            | {"type": "line", "x0": row["force_pN"], "x1": row["force_pN"]}
            | {"line": {"color": INK, "width": 1.5, "dash": "dash"}}
        )
    return lines


def _errors(arrays: Arrays, values: Any, colour: str) -> dict[str, Any]:
    return {
        "type": "data",
        "array": arrays.add(values),
        "color": colour,
        "thickness": 1.2,
        "width": 3,
    }


def _note(text: str, **where: str) -> dict[str, Any]:
    at = {"xref": "paper", "yref": "paper"} | where
    return at | {"text": text, "x": 0.5, "y": 0.5, "showarrow": False, "font": {"color": GREY}}


def _pale(colour: str) -> str:
    return f"rgba({int(colour[1:3], 16)},{int(colour[3:5], 16)},{int(colour[5:7], 16)},0.28)"
