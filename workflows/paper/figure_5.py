"""Figure 5: measured against corrected spectra and their integrals.

Traces of the stepwise simulator at the two forces the paper quotes as limits, 14 and 20 pN on
2.7 µm. The corrections take the aliases from the arctangent fit itself, as the paper does, repeated
until fit and correction agree.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from output import COLOURS, LABELS, Part, markdown, panels, percent, write_part
from quoted import CORRECTED_LIMIT_PN, NOT_PUBLIC, UNCORRECTED_LIMIT_PN
from recovery import CORRECTIONS
from setting import Bead, Setting, stepwise_traces

from mtpipe.ground.types import FloatArray
from mtpipe.methods.integrated_spectrum import fit_spectrum, lorentzian

FORCES_PN = (UNCORRECTED_LIMIT_PN, CORRECTED_LIMIT_PN)
FRAMES = 16384
SHOWN_FROM_HZ = 1.0
BANDS_HZ = ((1.0, 5.0), (5.0, 20.0), (20.0, 40.0), (40.0, 60.0))


def part(seed: int, repeats: int) -> Part:
    """Mean spectra of so many traces of 16384 frames, corrected each way."""
    setting = Setting()
    tables = []
    spectra = {}
    for force in FORCES_PN:
        bead = setting.at(force)
        random = np.random.default_rng([seed, 5, int(force)])
        frequency, power = mean_spectrum(bead, repeats, random)
        spectra[force] = frequency, corrected(bead, frequency, power)
        tables.append(compare(bead, *spectra[force], repeats))
    table = pd.concat(tables)
    columns = [
        "F (pN)",
        "spectrum",
        *(f"{low:g}–{high:g} Hz" for low, high in BANDS_HZ),
        "integral to Nyquist",
        "paper",
    ]
    rows = [
        [
            f"{row.force_pN:g}",
            LABELS[row.method],
            *(percent(row[f"band_{i}"]) for i in range(len(BANDS_HZ))),
            percent(row.integral, row.stderr),
            NOT_PUBLIC,
        ]
        for _, row in table.iterrows()
    ]
    text = f"""{markdown(columns, rows)}

Deviation from the Lorentzian of the bead's motion, mean over {repeats} traces of {FRAMES} frames
each. "no correction" is the spectrum as measured; "blur only" leaves the aliases in and amplifies
them; with n = ±1 what is left is the statistical error.
"""
    return Part(text, _figure(setting, spectra), {"bands": table})


def mean_spectrum(
    bead: Bead, repeats: int, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Frequencies below Nyquist and the mean one-sided periodogram of traces of x."""
    frame_s = bead.setting.camera.frame_s
    power = np.zeros(FRAMES // 2 - 1)
    for _ in range(repeats):
        x = stepwise_traces(bead, FRAMES, random, axes=(0,))[:, 0]
        ordinates = 2 * frame_s / FRAMES * np.abs(np.fft.rfft(x - x.mean())) ** 2
        power += ordinates[1:-1] / repeats
    return np.arange(1, FRAMES // 2) / (FRAMES * frame_s), power


def corrected(bead: Bead, frequency: FloatArray, power: FloatArray) -> dict[str, FloatArray]:
    """The spectrum after each correction."""
    camera = bead.setting.camera
    spectra = {}
    for method, correction in CORRECTIONS.items():
        fit = fit_spectrum(frequency, power, camera.frame_s, camera.exposure_s, correction)
        if fit is None:
            raise ValueError(f"no arctangent fits the spectrum at {bead.force_pN:g} pN")
        aliased = correction.aliased(frequency, fit.fit, camera.frame_s, camera.exposure_s)
        spectra[method] = (power - aliased) / correction.gain(frequency, camera.exposure_s)
    return spectra


def compare(
    bead: Bead, frequency: FloatArray, spectra: dict[str, FloatArray], repeats: int
) -> pd.DataFrame:
    """One row per correction: deviation from the Lorentzian in bands and of the whole integral."""
    truth = lorentzian(frequency, np.log([bead.variance[0], bead.corner_hz[0]]))
    rows = []
    for method, power in spectra.items():
        row = {
            "force_pN": bead.force_pN,
            "method": method,
            "integral": power.sum() / truth.sum() - 1,
            "stderr": np.sqrt(np.sum(power**2) / repeats) / truth.sum(),
        }
        for i, (low, high) in enumerate(BANDS_HZ):
            band = (frequency >= low) & (frequency < high)
            row[f"band_{i}"] = power[band].sum() / truth[band].sum() - 1
        rows.append(row)
    return pd.DataFrame(rows)


def _figure(setting: Setting, spectra: dict[float, tuple[FloatArray, dict[str, FloatArray]]]):
    figure, axes = panels(2, rows=2, width=9, height=5.6)
    for row, (force, (frequency, powers)) in enumerate(spectra.items()):
        bead = setting.at(force)
        truth = lorentzian(frequency, np.log([bead.variance[0], bead.corner_hz[0]]))
        first = int(np.searchsorted(frequency, SHOWN_FROM_HZ))
        edges = np.unique(np.geomspace(first, len(frequency), 30).astype(int))
        spectrum, integral = axes[2 * row : 2 * row + 2]
        for method, power in powers.items():
            binned = np.add.reduceat(power[: edges[-1]], edges[:-1]) / np.diff(edges)
            at = np.add.reduceat(frequency[: edges[-1]], edges[:-1]) / np.diff(edges)
            style = {"color": COLOURS[method], "lw": 1, "label": LABELS[method]}
            spectrum.plot(at, binned, **style)
            integral.plot(frequency, np.cumsum(power) * frequency[0], **style)
        spectrum.plot(
            frequency[first:], truth[first:], color="black", lw=0.8, ls="--", label="bead's motion"
        )
        integral.plot(frequency, np.cumsum(truth) * frequency[0], color="black", lw=0.8, ls="--")
        spectrum.set(xscale="log", yscale="log", ylabel="nm²/Hz", title=f"{force:g} pN: spectrum")
        integral.set(ylabel="nm²", title=f"{force:g} pN: integral")
    axes[0].legend(frameon=False, fontsize=7)
    for axis in axes[2:]:
        axis.set_xlabel("frequency (Hz)")
    return figure


if __name__ == "__main__":
    write_part("figure-5", part, repeats=8, unit="traces per force")
