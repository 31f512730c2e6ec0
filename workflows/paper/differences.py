"""Why the paper's limits differ from ours: candidate explanations, tried one by one.

Each candidate gives the corner frequency at which its "force" is 10 % off with every correction. A
candidate explains a limit if it ends within 2 Hz of it: what "32 Hz" leaves open, and the 2 Hz that
the paper gives with its 47 Hz.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pandas as pd
from output import COLOURS, LABELS, Part, markdown, panels, write_part
from quoted import (
    CORRECTED_LIMIT_HZ,
    CORRECTED_LIMIT_HZ_STDERR,
    LIMIT_ERROR,
    UNCORRECTED_LIMIT_HZ,
)
from readings import Reading, error
from recovery import CORRECTIONS, EXACT, expected, limit, recover, rms_limit
from scipy import optimize
from setting import Setting, exact_traces

from mtpipe.methods.integrated_spectrum import Correction

STATED_NOISE_NM = 5.0
CHECKED_FRAMES = (512, 1024, 4096, 16384)
# Slower motion scatters more again: looked at for the upper limit, over Nyquist.
SLOWEST = 0.2
CHECKED = ("arctangent", EXACT)
# A Hann window leaves this many times the variance of an ordinate averaged over its neighbours.
HANN = 35 / 18
_SCRIPT = Reading(rounds=20, raw_start=True, at_rest_ln=5e-4)


def part(seed: int, repeats: int) -> Part:
    """All candidates, and the scatter of so many short traces at 20 pN."""
    setting = Setting()
    table = candidates(setting)
    short = short_traces(setting, seed, repeats)
    frames = frames_for_quoted_limit(setting)
    slow = setting.camera.nyquist_hz * optimize.brentq(
        lambda ratio: expected("arctangent", ratio).rms(round(frames))[0] - LIMIT_ERROR, 0.02, 0.5
    )
    methods = list(CORRECTIONS)
    rows = [
        [row["candidate"], *(_shown(row[m], row[f"why {m}"]) for m in methods), row["explains"]]
        for _, row in table.iterrows()
    ]
    columns = ["candidate", *(f"{LABELS[m]} (Hz)" for m in methods), "within 2 Hz of"]
    checked = [
        [
            f"{row.frames}",
            LABELS[row.method],
            f"{100 * row.first_order:.1f} %",
            f"{100 * row.rms:.1f} ± {100 * row.rms / np.sqrt(2 * row.traces):.1f} %",
            f"{row.without_fit} of {row.traces}",
        ]
        for row in short.itertuples()
    ]
    text = f"""{markdown(columns, rows)}

Corner frequency at which the number called force is 10 % off; "–": it never is. The paper:
{UNCORRECTED_LIMIT_HZ:g} Hz uncorrected, {CORRECTED_LIMIT_HZ:g} ± {CORRECTED_LIMIT_HZ_STDERR:g} Hz
corrected. Limits are those of the expected spectrum. Rows that name a number of frames are of
traces, from {SLOWEST * setting.camera.nyquist_hz:.0f} Hz up. "No fit beyond": above this frequency
the repeated correction does not converge; mtpipe's own starts from another value and gets further.

Root-mean-square error of the force at {CORRECTED_LIMIT_HZ:g} Hz for short traces. With n = ±1
it is 10 % for traces of {frames:.0f} frames ({frames / setting.frame_rate_hz:.1f} s), or
{HANN * frames:.0f} frames under a Hann window. The same traces scatter by more than
10 % below {slow:.0f} Hz as well:

{markdown(["frames", "method", "first order", "simulated", "without a fit"], checked)}
"""
    return Part(text, _figure(setting, table), {"candidates": table, "short": short})


def candidates(setting: Setting) -> pd.DataFrame:
    """One row per candidate: the limit in Hz for every correction."""
    nyquist = setting.camera.nyquist_hz

    @functools.cache
    def deviation_nm(ratio: float) -> float:
        bead = setting.at(setting.force_at_corner(ratio * nyquist))
        return float(np.sqrt(bead.variance[0]))

    def noise(noise_nm: float) -> Callable[[float], float]:
        return lambda ratio: noise_nm / deviation_nm(ratio)

    readings = {
        "the recipe as written (plain repetition, started from the blur-corrected fit)": Reading(),
        "10 % in the variance, not in its inverse": Reading(number="inverse"),
        "10 % in the amplitude √⟨x²⟩": Reading(number="rms amplitude"),
        "force from the corner frequency, 2π fc γ L": Reading(number="corner"),
        "friction not fitted": Reading(fit="friction known"),
        "variance summed up to Nyquist, only fc fitted": Reading(fit="variance summed"),
        "logarithm of the integral fitted": Reading(fit="log integral"),
        "Lorentzian fitted to the spectrum": Reading(fit="spectrum"),
        "Lorentzian fitted to its logarithm": Reading(fit="log spectrum"),
        "fit up to half of Nyquist": Reading(upto=0.5),
        "aliases computed once": Reading(rounds=1),
        "aliases computed once, from the uncorrected fit": Reading(rounds=1, raw_start=True),
        "aliases computed twice": Reading(rounds=2),
        "the laboratory's later script: uncorrected start, 20 rounds, stop at 0.05 %": _SCRIPT,
        "half of the aliases taken off (one- and two-sided spectra mixed up)": Reading(
            alias_share=0.5
        ),
        "the same, 10 % in the variance": Reading(alias_share=0.5, number="inverse"),
        "twice the aliases taken off": Reading(alias_share=2.0),
        "exposure 0.86 of a frame, and known": Reading(exposure=0.86),
        "exposure 0.86 of a frame, taken for 1": Reading(exposure=0.86, assumed_exposure=1.0),
        f"tracking noise of {STATED_NOISE_NM:g} nm": Reading(noise=noise(STATED_NOISE_NM)),
        "tracking noise of 4.3 nm": Reading(noise=noise(4.3)),
    }
    rows = []
    for name, reading in readings.items():
        row: dict[str, object] = {"candidate": name}
        for method, correction in CORRECTIONS.items():
            found, why = limit(functools.partial(error, reading, correction))
            row[method], row[f"why {method}"] = found * nyquist, why
        rows.append(row)
    sideways: dict[str, object] = {"candidate": "force from y (lever L + R), frequency that of x"}
    for method, correction in CORRECTIONS.items():

        def of_y(ratio: float, correction: Correction = correction) -> float:
            bead = setting.at(setting.force_at_corner(ratio * nyquist))
            return error(Reading(), correction, float(bead.corner_hz[1]) / nyquist)

        found, why = limit(of_y)
        sideways[method], sideways[f"why {method}"] = found * nyquist, why
    rows.append(sideways)
    for frames in CHECKED_FRAMES:
        row = {"candidate": f"root mean square of bias and scatter, {frames} frames"}
        for method in CORRECTIONS:
            found = rms_limit(method, frames, above=SLOWEST)
            row[method] = found * nyquist
            row[f"why {method}"] = "below" if found < 1.01 * SLOWEST else ""
        rows.append(row)
    table = pd.DataFrame(rows)
    table["explains"] = [_explains(row) for _, row in table.iterrows()]
    return table


def frames_for_quoted_limit(setting: Setting) -> float:
    """Frames for which the corrected force is 10 % off at the paper's limit."""
    at = expected("arctangent", CORRECTED_LIMIT_HZ / setting.camera.nyquist_hz)
    return float(at.scatter[0] ** 2 / (LIMIT_ERROR**2 - at.bias[0] ** 2))


def short_traces(setting: Setting, seed: int, repeats: int) -> pd.DataFrame:
    """Error of force at the paper's corrected limit, for traces of several lengths."""
    bead = setting.at(setting.force_at_corner(CORRECTED_LIMIT_HZ))
    rows = []
    for frames in CHECKED_FRAMES:
        random = np.random.default_rng([seed, 7, frames])
        traces = exact_traces(bead, frames, repeats, random)
        for method in CHECKED:
            errors = np.array([recover(method, x, bead)[0] for x in traces])
            there = errors[np.isfinite(errors)]
            ratio = CORRECTED_LIMIT_HZ / setting.camera.nyquist_hz
            rows.append(
                {
                    "frames": frames,
                    "method": method,
                    "first_order": expected(method, ratio).rms(frames)[0],
                    "rms": np.sqrt(np.mean(there**2)),
                    "without_fit": len(errors) - len(there),
                    "traces": len(errors),
                }
            )
    return pd.DataFrame(rows)


def _explains(row: pd.Series) -> str:
    """Which of the paper's limits a candidate's columns come within 2 Hz of."""
    quoted = {
        UNCORRECTED_LIMIT_HZ: ("arctangent-uncorrected", "arctangent-blur-only"),
        CORRECTED_LIMIT_HZ: ("arctangent-one-alias", "arctangent"),
    }
    found = [
        f"{hertz:g} ({LABELS[method]})"
        for hertz, methods in quoted.items()
        for method in methods
        if abs(row[method] - hertz) <= CORRECTED_LIMIT_HZ_STDERR
    ]
    return ", ".join(found) or "neither"


def _shown(hertz: float, why: str) -> str:
    return "–" if hertz == np.inf else f"{why} {hertz:.1f}".strip()


def _figure(setting: Setting, table: pd.DataFrame):
    figure, (axis,) = panels(1, width=9.5, height=6.0)
    places = np.arange(len(table))[::-1]
    for method in CORRECTIONS:
        shown = table[method].clip(upper=130)
        axis.plot(shown, places, "o", ms=5, color=COLOURS[method], label=LABELS[method])
    for quoted in (UNCORRECTED_LIMIT_HZ, CORRECTED_LIMIT_HZ):
        low, high = quoted - CORRECTED_LIMIT_HZ_STDERR, quoted + CORRECTED_LIMIT_HZ_STDERR
        axis.axvspan(low, high, color="#DDDDDD", zorder=0)
    axis.set_yticks(places, [name.split(" (")[0] for name in table.candidate], fontsize=7)
    axis.set(
        xscale="log",
        xlabel="corner frequency (Hz) at 10 %; grey: the paper's limits; at 130: further or never",
    )
    axis.xaxis.label.set_fontsize(8)
    axis.legend(frameon=False, fontsize=7, loc="lower left")
    return figure


if __name__ == "__main__":
    write_part("differences", part, repeats=200, unit="short traces per length")
