"""Figure 4: time-averaged variance and extension against force, 2.7 µm of DNA.

The variance of x, y and z as it is and as the camera records it, the force that equipartition makes
of the recorded one (the paper's Eq 8), and the extension by Marko and Siggia's formula beside the
exact mean of the tether's end, which the paper's linear springs leave out.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from output import COLOURS, Part, markdown, panels, percent, write_part
from quoted import LIMIT_ERROR, NOT_PUBLIC
from scipy import optimize
from setting import Setting, stepwise_traces

from mtpipe.physics.camera import blur_factor
from mtpipe.physics.tether import mean_extension_nm

FORCES_PN = (0.1, 0.3, 1.0, 3.0, 7.0, 14.0, 20.0)
AXES = "xyz"


def part(seed: int, repeats: int) -> Part:
    """Variances of so many frames at each force."""
    setting = Setting()
    table = variances(setting, repeats, np.random.default_rng([seed, 4]))
    rows = [
        [
            f"{row.force_pN:g}",
            f"{row.extension_nm:.0f}",
            percent(row.mean_extension_nm / row.extension_nm - 1),
            *(
                f"{getattr(row, f'true_{a}'):.3g} → {getattr(row, f'recorded_{a}'):.3g} "
                f"({getattr(row, f'deviation_{a}'):+.1f})"
                for a in AXES
            ),
            percent(row.force_from_x / row.force_pN - 1, row.force_stderr),
            NOT_PUBLIC,
        ]
        for row in table.itertuples()
    ]
    columns = [
        "F (pN)",
        "L (nm)",
        "exact mean − L",
        *(f"variance {a}: kT/k → recorded (nm²)" for a in AXES),
        "force from the recorded x",
        "paper",
    ]
    ratio = optimize.brentq(lambda at: 1 / blur_factor(2 * np.pi * at) - 1 - LIMIT_ERROR, 1e-3, 1)
    corner = ratio * setting.frame_rate_hz
    scatter = table[[f"deviation_{a}" for a in AXES]].to_numpy()
    text = f"""{markdown(columns, rows)}

{repeats} frames ({repeats / setting.frame_rate_hz:.0f} s) per force. In brackets: the recorded
variance's deviation from its closed form in standard errors; root mean square
{np.sqrt(np.mean(scatter**2)):.2f} over {scatter.size} of them
(1 ± {1 / np.sqrt(2 * scatter.size):.2f} expected). Equipartition with the variance as
recorded overstates the force by 10 % from a corner frequency of {corner:.1f} Hz on.
"""
    return Part(text, _figure(setting, table), {"variances": table})


def variances(setting: Setting, frames: int, random: np.random.Generator) -> pd.DataFrame:
    """One row per force."""
    rows = []
    for force in FORCES_PN:
        bead = setting.at(force)
        recorded = np.mean(stepwise_traces(bead, frames, random) ** 2, axis=0)
        stderr, expected = bead.variance_stderr(frames), bead.frame_variance()
        row = {
            "force_pN": force,
            "extension_nm": bead.extension_nm,
            "mean_extension_nm": float(mean_extension_nm(setting.chain, force)),
            "force_from_x": setting.thermal_energy * bead.extension_nm / recorded[0],
            "force_stderr": stderr[0],
        }
        for i, axis in enumerate(AXES):
            row[f"true_{axis}"] = bead.variance[i]
            row[f"expected_{axis}"] = expected[i]
            row[f"recorded_{axis}"] = recorded[i]
            row[f"deviation_{axis}"] = (recorded[i] / expected[i] - 1) / stderr[i]
        rows.append(row)
    return pd.DataFrame(rows)


def _figure(setting: Setting, table: pd.DataFrame):
    figure, (variance, extension) = panels(2)
    fine = np.geomspace(FORCES_PN[0], FORCES_PN[-1], 60)
    beads = [setting.at(force) for force in fine]
    for i, (axis, colour) in enumerate(zip(AXES, ("#0072B2", "#009E73", "#D55E00"), strict=True)):
        variance.plot(fine, [b.variance[i] for b in beads], color=colour, lw=0.8, ls="--")
        variance.plot(fine, [b.frame_variance()[i] for b in beads], color=colour, lw=1.2)
        variance.plot(
            table.force_pN, table[f"recorded_{axis}"], "o", ms=4, color=colour, label=axis
        )
    variance.set(
        xscale="log",
        yscale="log",
        xlabel="force (pN)",
        ylabel="variance (nm²)",
        title="dashed: kT/k; line: closed form; points: simulated",
    )
    variance.legend(frameon=False, fontsize=8)
    extension.plot(
        fine, [b.extension_nm for b in beads], color=COLOURS["truth"], label="Marko & Siggia"
    )
    extension.plot(
        table.force_pN,
        table.mean_extension_nm,
        "o",
        ms=4,
        color=COLOURS["arctangent"],
        label="exact mean",
    )
    extension.set(xscale="log", xlabel="force (pN)", ylabel="extension (nm)", title="extension")
    extension.legend(frameon=False, fontsize=8)
    for axis in (variance, extension):
        axis.title.set_fontsize(9)
    return figure


if __name__ == "__main__":
    write_part("figure-4", part, repeats=24000, unit="frames per force")
