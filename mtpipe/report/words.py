"""Numbers and codes in words: how an estimate, a status, a flag or a setup reads in the report.

Every function returns plain text; escaping is the templates' matter. A number that is missing is
"—" and never NaN.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import Any

from mtpipe.ground.written_numbers import EMPTY as EMPTY
from mtpipe.ground.written_numbers import is_number as is_number
from mtpipe.ground.written_numbers import number as number
from mtpipe.ground.written_numbers import with_arms as with_arms
from mtpipe.ground.written_numbers import with_error as with_error
from mtpipe.ground.written_numbers import with_minus
from mtpipe.setup.measured import Measured
from mtpipe.setup.setup import Setup

STATUS = {
    "ok": "ok",
    "fixed": "held fixed",
    "at_bound": "at a bound",
    "not_identified": "not identified",
    "not_converged": "fit not converged",
    "not_one_state": "mixed states",
    "unlike_model": "unlike the model",
    "zero_force": "may be zero",
    "refused": "refused",
    "excluded": "left out by hand",
}
STATUS_MEANING = {
    "at_bound": "the fit ended at a physical limit, so an interval is one-sided",
    "not_identified": "the data do not determine a parameter",
    "not_converged": "the fit found no minimum",
    "not_one_state": "bead or force change within the plateau, so it has no single force",
    "unlike_model": "the spectrum differs from the model's, so do not use the trace's numbers",
    "zero_force": "the force may be zero within its error",
}
# Where the force to quote comes from (docs/forces.md): in a few words, and what that means.
SOURCE = {
    "spectra": "spectra of x and y",
    "heights": "spectra and heights",
    "named": "with the causes found",
    "spectra_alone": "spectra of x and y only",
    "heights_alone": "mostly heights",
    "none": "none",
}
SOURCE_MEANING = {
    "spectra": "all spectra of x and y of the bead, fitted together",
    "heights": "spectra and mean heights fitted together as the setup states the experiment, which "
    "the cross-check does not contradict",
    "named": "spectra and mean heights fitted together, with the causes found",
    "spectra_alone": "spectra of x and y only: something is not explained, and mean heights do not "
    "agree with the forces",
    "heights_alone": "spectra and mean heights fitted together as the setup states the experiment: "
    "something is not explained, but mean heights agree with the forces",
}
MODEL = {
    "marko-siggia": "Marko–Siggia",
    "bouchiat": "Bouchiat",
    "extensible": "extensible worm-like chain",
}
VERDICT_MARK = {"good": "✓", "unchecked": "?", "caution": "△", "refused": "✕"}
# Codes of notices that are no words when their underscores are taken out.
LABELS = {
    "fx_fy": "forces from x and y differ",
    "above_nyquist": "corner near or above the Nyquist frequency",
    "poor_fit": "spectrum unlike the model",
    "unlike_the_series": "unlike the bead's other traces",
    "beyond_dna": "higher than DNA can bear",
    "zero_force": "force may be zero",
    "not_one_state": "mixed states",
    "not_crosschecked": "not cross-checked",
    "crosscheck_failed": "not cross-checked",
    "crosscheck_to_come": "cross-check to come",
    "left_out_by_hand": "left out by hand",
    "mark_of_nothing": "a mark that fits nothing",
    "tether_choice": "which chain was chosen",
    "tether_formula": "another formula of the chain",
    "tether_relation": "short or long chain",
}
# Below this the tail of a hundred simulations says no more than "very small".
SMALLEST_P = 1e-12
SEVERITY_ORDER = {"warning": 0, "caution": 1, "info": 2}
# Steps of a run, by their names in `run.json`.
STEPS = {
    "track": "tracking",
    "read": "reading",
    "drift": "subtracting drift",
    "states": "testing plateaus",
    "calibrate": "calibration",
    "crosscheck": "cross-check",
    "force-extension": "force–extension curves",
}


def text(value: Any) -> str:
    """A cell of text; empty where the table has none."""
    return value if isinstance(value, str) else ""


def flags(value: Any) -> list[str]:
    """The codes of a `flags` cell."""
    return [code.strip() for code in text(value).split(";") if code.strip()]


def label(code: str) -> str:
    """A code as words; without words of its own `lost_frames` becomes "lost frames"."""
    return LABELS.get(code, code.replace("_", " "))


def probability(p_value: float) -> str:
    """A p-value; where it is below what any tail can be followed to, as a limit."""
    if p_value < SMALLEST_P:
        return f"p < {number(SMALLEST_P, 1)}"
    return f"p = {number(p_value, 2)}"


def signed(value: float, decimals: int) -> str:
    """A number with its sign, also "+", rounded to some decimals."""
    return with_minus(f"{round(value, decimals) + 0.0:+.{decimals}f}")


def interval(low: Any, high: Any, unit: str) -> str:
    """The 68 % interval in words; empty where there is none."""
    if not (is_number(low) and is_number(high)):
        return ""
    return f"68 % interval {number(low, 4)} to {number(high, 4)} {unit}"


def span(low: Any, high: Any) -> str:
    """A range of a quantity; "—" where missing."""
    if not (is_number(low) and is_number(high)):
        return EMPTY
    return number(low) if number(low) == number(high) else f"{number(low)} – {number(high)}"


def change(ratio: float) -> str:
    """A ratio as a change in percent, or as a factor where it is 2 or more either way."""
    if 0.5 < ratio < 2:
        size = 100 * abs(ratio - 1)
        return f"{size:.{1 if size < 10 else 0}f} % {'more' if ratio >= 1 else 'less'}"
    return f"{number(ratio, 2)} times as large"


def sentence(phrase: str) -> str:
    """A phrase with a capital at its beginning, unless that is a symbol, and a full stop."""
    phrase = phrase.strip().rstrip(".")
    symbol = re.match(r"[xyzp]\b", phrase)
    return f"{phrase if symbol else phrase[:1].upper() + phrase[1:]}."


def unbroken(phrase: str) -> str:
    """A phrase whose numbers stay in one line with their unit and their error."""
    joined = re.sub(r"(?<=[0-9]) (?=(?:%|pN|nm|mm|Hz|s)\b|%)", "\u00a0", phrase)
    return joined.replace(" ± ", "\u00a0±\u00a0")


def few(names: Sequence[str], shown: int = 4) -> str:
    """A few names in full, of many the first and the number of the others."""
    if len(names) <= shown:
        return listed(names)
    return f"{', '.join(names[:shown])} and {len(names) - shown} more"


def measured(value: Measured, unit: str) -> str:
    """A value of the setup with its unit, or that it is unknown."""
    if value.value is None:
        return "unknown"
    # the digits the laboratory wrote, not a rounding of them
    shown = f"{value.value:.10g}"
    if value.usual:
        return f"{shown} {unit} (usual error, ± {number(value.stderr, 2)})"
    if value.stderr:
        shown = with_error(value.value, value.stderr)
    return f"{shown} {unit}"


def setup_in_words(setup: Setup) -> list[tuple[str, str]]:
    """The setup as pairs of a name and a phrase."""
    camera, along = setup.camera, setup.field.direction
    across = "y" if along == "x" else "x"
    exposure = measured(camera.exposure_s, "s")
    if camera.exposure_s.value is not None and camera.frame_rate_hz.value is not None:
        share = 100 * camera.exposure_s.value * camera.frame_rate_hz.value
        exposure += f" ({share:.4g} % of a frame)"
    known = "; ".join(
        f"{measured(m.force_pN, 'pN')} at {measured(m.position_mm, 'mm')}" for m in setup.magnet
    )
    effects = ", ".join(label(effect) for effect in setup.model.effects)
    return [
        ("Frame rate", measured(camera.frame_rate_hz, "Hz")),
        ("Exposure", exposure),
        ("Bead radius", measured(setup.beads.radius_nm, "nm")),
        ("Reference beads", ", ".join(setup.beads.reference) or "none named"),
        ("Contour length", measured(setup.tether.contour_length_nm, "nm")),
        ("Persistence length", measured(setup.tether.persistence_length_nm, "nm")),
        ("Temperature", measured(setup.buffer.temperature_K, "K")),
        ("Viscosity", measured(setup.buffer.viscosity_mPa_s, "mPa·s")),
        ("Magnetic field", f"along {along}; a bead that turns also moves along {across}"),
        ("Effects in the model", effects or "none beyond the baseline"),
        *([("Forces known from elsewhere", known)] if known else []),
    ]


def place(numbers: Collection[int], axes: Collection[str]) -> str:
    """Where in a bead something applies, as `plateaus 0 to 5 along x and y`; empty: all of it."""
    parts = [plateaus(numbers)] if numbers else []
    return " ".join([*parts, f"along {listed(sorted(axes))}"] if axes else parts)


def plateaus(numbers: Collection[int]) -> str:
    """`plateau 3`, `plateaus 2 to 5`, `plateaus 0, 1 and 4 to 9`."""
    return f"{'plateau' if len(numbers) == 1 else 'plateaus'} {ranges(numbers)}"


def ranges(numbers: Collection[int]) -> str:
    """`3`, `2 to 5`, `0, 1 and 4 to 9`."""
    runs: list[list[int]] = []
    for one in sorted(numbers):
        if runs and one == runs[-1][-1] + 1:
            runs[-1].append(one)
        else:
            runs.append([one])
    return listed([
        part
        for run in runs
        for part in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run))
    ])  # fmt: skip


def natural(name: str) -> list[tuple[int, int, str]]:
    """Sort key that puts bead 10 after bead 9."""
    parts = re.split(r"([0-9]+)", name)
    return [(0, int(p), "") if i % 2 else (1, 0, p.casefold()) for i, p in enumerate(parts)]


def count(amount: int, noun: str, plural: str = "") -> str:
    """`1 bead`, `2 beads`; `2 spectra`."""
    return f"{amount} {noun if amount == 1 else plural or f'{noun}s'}"


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))
