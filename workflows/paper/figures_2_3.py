"""Figures 2 and 3: traces before and after the camera at 1 and 10 pN, and the variance it takes.

R = 1.4 µm on 7 µm of DNA. The bead is stepped through the paper's equations of motion; averaged
over a frame its position varies less, the more so the faster it relaxes. The paper states no number
for these figures in its text; the closed form of the loss (Wong & Halvorsen 2006) is the referee.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from output import COLOURS, Part, markdown, panels, percent, write_part
from quoted import NOT_PUBLIC, TIME_STEP_S
from setting import Setting, path, stepwise_traces

from mtpipe.physics.camera import blur_factor
from mtpipe.simulation.steps import divide_frame

SHOWN_PN = (1.0, 10.0)
LOSS_PN = (0.3, 1.0, 3.0, 10.0, 20.0)
CONTOUR_NM = 7000.0
SHOWN_S = 1.0
PICTURE_STEPS = 50


def part(seed: int, repeats: int) -> Part:
    """Loss of variance at several forces from so many frames each, and two traces to look at."""
    setting = Setting(contour_length_nm=CONTOUR_NM)
    losses = variance_losses(setting, repeats, np.random.default_rng([seed, 23]))
    rows = [
        [
            f"{row.force_pN:g}",
            row.axis,
            f"{row.corner_hz:.2f}",
            f"{row.variance_nm2:.0f}",
            f"{row.measured_nm2:.0f}",
            percent(-row.measured_loss, row.stderr),
            percent(-row.expected_loss),
            f"{row.deviation:+.1f}",
            NOT_PUBLIC,
        ]
        for row in losses.itertuples()
        if row.force_pN in SHOWN_PN
    ]
    columns = [
        "F (pN)",
        "axis",
        "fc (Hz)",
        "kT/k (nm²)",
        "recorded (nm²)",
        "change by the camera",
        "closed form",
        "deviation (standard errors)",
        "paper",
    ]
    text = f"""{markdown(columns, rows)}

{repeats} frames ({repeats / setting.frame_rate_hz:.0f} s) per force, time step {TIME_STEP_S:g} s.
Over all {len(losses)} forces and axes the deviation from the closed form is
{losses.deviation.mean():+.2f} ± {1 / np.sqrt(len(losses)):.2f} standard errors on average, and its
root mean square is {np.sqrt(np.mean(losses.deviation**2)):.2f}
(1 ± {1 / np.sqrt(2 * len(losses)):.2f} expected).
"""
    return Part(text, _figure(setting, losses, seed), {"losses": losses})


def variance_losses(setting: Setting, frames: int, random: np.random.Generator) -> pd.DataFrame:
    """One row per force and axis: what the camera leaves of the variance."""
    rows = []
    for force in LOSS_PN:
        bead = setting.at(force)
        recorded = stepwise_traces(bead, frames, random)
        measured = np.mean(recorded**2, axis=0)
        expected = bead.frame_variance() / bead.variance
        stderr = bead.variance_stderr(frames) * expected
        for i, axis in enumerate("xyz"):
            share = measured[i] / bead.variance[i]
            rows.append(
                {
                    "force_pN": force,
                    "axis": axis,
                    "corner_hz": bead.corner_hz[i],
                    "variance_nm2": bead.variance[i],
                    "measured_nm2": measured[i],
                    "measured_loss": 1 - share,
                    "expected_loss": 1 - expected[i],
                    "stderr": stderr[i],
                    "deviation": (share - expected[i]) / stderr[i],
                }
            )
    return pd.DataFrame(rows)


def _figure(setting: Setting, losses: pd.DataFrame, seed: int):
    figure, (one, ten, loss) = panels(3, width=10.5, height=3.2)
    steps = divide_frame(setting.camera, TIME_STEP_S)
    for axis, force in zip((one, ten), SHOWN_PN, strict=True):
        x = path(setting.at(force), SHOWN_S, np.random.default_rng([seed, 2, int(force)]))
        frames = len(x) // steps.per_frame
        recorded = x[: frames * steps.per_frame].reshape(frames, -1).mean(axis=1)
        time = np.arange(len(x)) * TIME_STEP_S
        centres = (np.arange(frames) + 0.5) * setting.camera.frame_s
        axis.plot(time[::PICTURE_STEPS], x[::PICTURE_STEPS], lw=0.4, color="#BBBBBB")
        axis.plot(centres, recorded, lw=0.9, color=COLOURS["arctangent"])
        axis.set(title=f"{force:g} pN: motion and frames", xlabel="time (s)", ylabel="x (nm)")
    ratio = np.geomspace(1e-3, 10, 200)
    loss.plot(ratio, 100 * (1 - blur_factor(2 * np.pi * ratio)), color="black", lw=1)
    shown = losses.corner_hz / setting.frame_rate_hz
    loss.errorbar(shown, 100 * losses.measured_loss, 100 * losses.stderr, fmt="o", ms=3, lw=1)
    loss.set(
        xscale="log",
        title="variance lost to the exposure",
        xlabel="corner frequency / frame rate",
        ylabel="loss (%)",
    )
    return figure


if __name__ == "__main__":
    write_part("figures-2-3", part, repeats=24000, unit="frames per force")
