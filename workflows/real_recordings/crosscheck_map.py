"""What the cross-check's map shows of cmaddry-run2 to someone who was told nothing.

The setup names no vibration, no frequency and no bad bead. Drift and reference noise are taken off
its list of effects: a listed effect belongs to the configured experiment and would not be odd. Each
stretch is cut out of the recording with its reference beads, so that the stage is measured there.

Every function returns lines of Markdown; nothing is written to disk.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pandas as pd
from published import ROTATION
from staircase import ROWS, chosen, untold

from mtpipe.crosschecking.battery.temporal import WINDOWS
from mtpipe.crosschecking.crosscheck import crosscheck
from mtpipe.drift import subtract_drift
from mtpipe.recording.recording import Plateau, Recording
from mtpipe.recording.traces import traces_of
from mtpipe.report.rows_crosscheck import LISTED_BELOW
from mtpipe.setup.tables import DriftChoice

# Rows in the rest before the staircase's first half, in that on another part of the look-up tables,
# and in the rests before and after the turns.
FIRST, OFF_FOCUS, BEFORE_TURNS, AFTER_TURNS = 50_000, 114_500, 264_800, 340_000
LONG_DWELLS = (FIRST, AFTER_TURNS)
SERIES = ROWS["cmaddry-run2"]
LINES = ("line", "second_line")
MEANS = ("mean_trend", "mean_step", "mean_excursion")
TIMED = ("variance_step", "mean_excursion", "mean_step")


def cut_out(recording: Recording, plateaus: Sequence[Plateau]) -> Recording:
    """The rows from the first of the plateaus to the last; plateaus are numbered from 0.

    Heights stay as they are: the rows that tell z = 0 need not be among these.
    """
    start, stop = plateaus[0].start, plateaus[-1].stop
    rows = slice(start, stop)
    moved = tuple(
        dataclasses.replace(p, number=i, start=p.start - start, stop=p.stop - start)
        for i, p in enumerate(plateaus)
    )
    drift = recording.drift
    if drift is not None:
        drift = dataclasses.replace(
            drift,
            subtracted_nm=drift.subtracted_nm[rows],
            beyond_nm={bead: z_nm[rows] for bead, z_nm in drift.beyond_nm.items()},
        )
    return dataclasses.replace(
        recording,
        setup=recording.setup.model_copy(update={"source": None}),
        time_s=recording.time_s[rows],
        frame=recording.frame[rows],
        positions_nm={bead: xyz[rows] for bead, xyz in recording.positions_nm.items()},
        magnet_mm=None if recording.magnet_mm is None else recording.magnet_mm[rows],
        plateaus=moved,
        drift=drift,
    )


def raw_stretch(recording: Recording, subtracted: Recording) -> Recording:
    """A stretch before the subtraction, but for one constant per axis.

    Parameters
    ----------
    recording : as read, cut out. subtracted : the same stretch with the drift subtracted. Its mean
        is kept: where the stage stood before the stretch is no motion in it, and z needs its zero.
    """
    assert subtracted.drift is not None
    moved = np.nanmean(subtracted.drift.subtracted_nm, axis=0)
    positions = {
        bead: xyz - moved if bead in recording.tethered else xyz
        for bead, xyz in recording.positions_nm.items()
    }
    untouched = dataclasses.replace(recording, positions_nm=positions)
    return subtract_drift(untouched, choice=DriftChoice(method="none"))


def dwells(raw: Recording, subtracted: Recording, workers: int) -> list[str]:
    """Lines and wander in the two long dwells at constant force, raw and subtracted.

    `blanked` are frames that mtpipe takes for mistracked, and that no look sees.
    """
    lines = [
        "| bead | stretch | trace | narrow lines (Hz, p) | slow wander (p) | blanked | p of all "
        "| odd |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in LONG_DWELLS:
        here = [p for p in subtracted.plateaus if p.start <= row < p.stop]
        without = cut_out(subtracted, here)
        duration_s = len(without.time_s) / _rate_hz(raw)
        both = {"raw": raw_stretch(cut_out(raw, here), without), "subtracted": without}
        tables = {trace: map_of(recording, workers) for trace, recording in both.items()}
        for bead in raw.tethered:
            for trace, table in tables.items():
                own = table[table["bead"] == bead]
                (blanked,) = (t.mistracked for t in traces_of(both[trace], bead))
                lines.append(
                    f"| {bead} | plateau {here[0].number}, {duration_s:.0f} s | {trace} "
                    f"| {narrow_lines(own, duration_s)} | {slow_wander(own, duration_s)} "
                    f"| {blanked} | {_overall(own)} | {_odd(own)} |"
                )
    return lines


def map_of(recording: Recording, workers: int = 1) -> pd.DataFrame:
    """Table of the cross-check of all beads, of a setup that tells nothing of the stage."""
    found = crosscheck(untold(recording), workers=workers)
    for bead, reason in found.refused.items():
        print(f"{bead} is not cross-checked: {reason}")
    return found.table


def narrow_lines(table: pd.DataFrame, duration_s: float) -> str:
    """Lines that stand out, strongest first; a few cycles per stretch are no vibration."""
    middle = (table["band_low_hz"] + table["band_high_hz"]) / 2
    found = table[
        table["statistic"].isin(LINES)
        & (table["p_value"] < LISTED_BELOW)
        & (middle >= WINDOWS / duration_s)
    ].sort_values("p_value")
    said = [
        f"{row.axis} {(row.band_low_hz + row.band_high_hz) / 2:.2f} ({row.p_value:.0e})"
        for row in found.itertuples()
    ]
    return ", ".join(said) or "–"


def slow_wander(table: pd.DataFrame, duration_s: float) -> str:
    """Per axis the oddest look at what is slower than the sixteenth part of the stretch.

    Moves of the mean, and more power in the lowest bands than simulated.
    """
    slow = (table["statistic"] == "psd_band") & (table["band_low_hz"] < WINDOWS / duration_s / 2)
    slow &= table["value"] > table["simulated_median"]
    found = table[(table["statistic"].isin(MEANS) | slow) & (table["p_value"] < LISTED_BELOW)]
    said = []
    for axis, own in found.groupby("axis"):
        first = own.sort_values("p_value").iloc[0]
        what = first["statistic"].replace("_", " ")
        if first["statistic"] == "psd_band":
            what = f"power {first['band_low_hz']:.2g}–{first['band_high_hz']:.2g} Hz"
        said.append(f"{axis} {what} ({first['p_value']:.0e})")
    return ", ".join(said) or "–"


def turns(subtracted: Recording, workers: int) -> list[str]:
    """The stretch with the turns as one plateau: what a file without a rotation column looks like.

    mtpipe makes no plateau while the magnets turn, and there is all the mistracking that is left
    after the subtraction.
    """
    before, after = (
        next(p for p in subtracted.plateaus if p.start <= row < p.stop)
        for row in (BEFORE_TURNS, AFTER_TURNS)
    )
    length = before.stop - before.start
    whole = Plateau(0, before.start, after.start + length, before.magnet_mm)
    recording = cut_out(subtracted, [whole])
    table = map_of(recording, workers)
    rate = _rate_hz(recording)
    began, ended = ((row - whole.start) / rate for row in (before.stop, after.start))
    turning = (ROTATION[0] - whole.start) / rate, (ROTATION[1] - whole.start) / rate
    lines = [
        f"The magnets turn from {began:.0f} to {ended:.0f} s of this stretch (steadily at least "
        f"from {turning[0]:.0f} to {turning[1]:.0f} s).",
        "",
        "| bead | narrow lines (Hz, p) | oddest in time: look, s, p | before lost frames (p) |",
        "| --- | --- | --- | --- |",
    ]
    for bead in recording.tethered:
        own = table[table["bead"] == bead]
        timed = own[own["statistic"].isin(TIMED)].sort_values("p_value").head(3)
        when = ", ".join(
            f"{row.axis} {row.statistic.replace('_', ' ')} "
            f"{row.time_low_s:.0f}–{row.time_high_s:.0f} ({row.p_value:.0e})"
            for row in timed.itertuples()
        )
        lost = own[own["statistic"] == "lost_frames"]
        least = "–" if lost.empty else f"{lost['p_value'].min():.0e}"
        duration_s = len(recording.time_s) / rate
        lines.append(f"| {bead} | {narrow_lines(own, duration_s)} | {when} | {least} |")
    return lines


def series(subtracted: Recording, workers: int) -> list[str]:
    """Heights and friction of several plateaus together: with and without a rest off the focus.

    Values of the statistics, with the simulated 95 % in brackets. `subtracted` : whose states are
    known.
    """
    lines = [
        "| bead | rest off the focus | extension there | in the first rest | in the last "
        "| friction x, y | p of all | odd |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for rows in (SERIES, (OFF_FOCUS, *SERIES)):
        table = map_of(chosen(subtracted, rows), workers)
        for bead in subtracted.tethered:
            own = table[table["bead"] == bead]
            heights = [
                _value(own, "extension", "z", rows.index(row)) if row in rows else "–"
                for row in (OFF_FOCUS, SERIES[0], SERIES[-1])
            ]
            friction = ", ".join(_value(own, "friction", axis, None) for axis in "xy")
            with_it = "with" if OFF_FOCUS in rows else "without"
            lines.append(
                f"| {bead} | {with_it} | {' | '.join(heights)} | {friction} "
                f"| {_overall(own)} | {_odd(own)} |"
            )
    return lines


def _value(table: pd.DataFrame, statistic: str, axis: str, plateau: int | None) -> str:
    rows = table[(table["statistic"] == statistic) & (table["axis"] == axis)]
    rows = rows[rows["plateau"].isna() if plateau is None else rows["plateau"] == plateau]
    if rows.empty:
        return "–"
    row = rows.iloc[0]
    spread = f"{row['simulated_low']:.2g} to {row['simulated_high']:.2g}"
    return f"{row['value']:.2g} ({spread})"


def _overall(table: pd.DataFrame) -> str:
    return "–" if table.empty else f"{table['bead_p_value'].iloc[0]:.0e}"


def _odd(table: pd.DataFrame) -> str:
    """How many looks have p < 0.001."""
    return f"{int((table['p_value'] < LISTED_BELOW).sum())} of {len(table)}"


def _rate_hz(recording: Recording) -> float:
    rate = recording.setup.camera.frame_rate_hz.value
    assert rate is not None
    return rate
