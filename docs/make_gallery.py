"""Writes docs/gallery.md and its pictures: `python -m docs.make_gallery`.

Each effect is shown as tests/test_effects.py has it, where its expectation is held to its
simulation: the expected record of one bead with and without it, at the force and axis at which it
shows most.
"""

from __future__ import annotations

import functools
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mtpipe.diagnosis.corrections.catalogue import REMEDIES
from mtpipe.diagnosis.size_words import capital
from mtpipe.report.remedies import remedy
from tests.test_effects import KNOWN, forces_of, model_of

DOCS = Path(__file__).parent
PAGE, PICTURES = DOCS / "gallery.md", DOCS / "images" / "gallery"
WIDTH, HEIGHT, LEFT, BOTTOM = 340, 200, 46, 36
HEAD = """# Gallery of mismatches

What does a missing effect look like? Each picture shows the power spectrum of one bead with the
effect (solid) and without it (dashed), at the force and along the axis where it shows most.

`mtpipe run` names these effects if a recording has them and its setup does not list them. The
sentence in italics is the one that the report prints; its numbers are those of the picture. The
name above it is the one to use in the setup. What each effect is: [catalogue](effects.md).

You have seen something in a spectrum? These effects show there:

{index}
"""

# What a reader sees first, and the effects that look so.
SEEN = {
    "lowest frequencies": ("drift", "reference_noise", "force_drift"),
    "around the corner frequency": ("wall_drag", "rotation_coupling", "viscosity", "bead_radius"),
    "high frequencies": ("tracking_noise", "exposure", "dropped_frames", "hydrodynamic_memory"),
    "one narrow line": ("vibration",),
    "x, y or both, but not z": (
        "lateral_scale", "field_rotation", "magnetic_alignment", "lateral_magnet_stiffness",
    ),
    "z, with mean heights that are wrong": (
        "axial_scale", "contour_length", "extensible_tether", "multiple_tethers",
        "off_center_attachment", "anharmonic_tether", "z_response", "hopping",
    ),
    "z, with mean heights that are right": ("z_crosstalk", "bead_turning", "bead_rocking"),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Panel:
    """Two spectra: without the effect, and with it."""

    frequency_hz: np.ndarray
    without: np.ndarray
    with_it: np.ndarray
    words: str


@functools.cache
def _model(base):
    return model_of(base, np.random.default_rng(1))[0]


def panel_of(known):
    """The spectrum in which an effect shows most."""
    model, largest, found = _model(known.base), 0.0, None
    for plateau, force in enumerate(forces_of(known.base)):
        spectrum = model.data[plateau].spectrum
        both = [model.expected(each, plateau, force) for each in (known.base, known.changed)]
        for axis in range(3):
            powers = [each.power[:, axis, axis] / spectrum.gain(axis) for each in both]
            size = float(np.max(np.abs(np.log(powers[1] / powers[0]))))
            if size > largest:
                words = f"power of {'xyz'[axis]} at {force:g} pN (nm²/Hz)"
                largest, found = size, Panel(spectrum.frequency_hz, *powers, words)
    return found


def svg(panel):
    """A small picture with logarithmic axes."""
    x = np.log10(panel.frequency_hz)
    curves = np.log10([panel.without, panel.with_it])
    low, high = float(curves.min()), float(curves.max())
    low, high = low - 0.06 * (high - low), high + 0.06 * (high - low)
    right, top = WIDTH - 10, 24

    def across(value):
        return LEFT + (value - x[0]) / (x[-1] - x[0]) * (right - LEFT)

    def up(value):
        return HEIGHT - BOTTOM - (value - low) / (high - low) * (HEIGHT - BOTTOM - top)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
        f'height="{HEIGHT}" font-family="sans-serif" font-size="11" fill="#333">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
        f'<path d="M{LEFT} {top}V{HEIGHT - BOTTOM}H{right}" stroke="#333" fill="none"/>',
        f'<text x="6" y="14">{panel.words}</text>',
        f'<text x="{right}" y="{HEIGHT - 6}" text-anchor="end">frequency (Hz)</text>',
    ]
    for value in _ticks(float(x[0]), float(x[-1])):
        at = f"{across(math.log10(value)):.1f}"
        parts.append(f'<text x="{at}" y="{HEIGHT - 22}" text-anchor="middle">{value:g}</text>')
    for value in _ticks(low, high):
        at = f"{up(math.log10(value)) + 4:.1f}"
        parts.append(f'<text x="{LEFT - 4}" y="{at}" text-anchor="end">{value:g}</text>')
    looks = ('stroke="#777" stroke-dasharray="5 3"', 'stroke="#c44e00"')
    for curve, look in zip(curves, looks, strict=True):
        points = " ".join(f"{across(a):.1f},{up(b):.1f}" for a, b in zip(x, curve, strict=True))
        parts.append(f'<polyline points="{points}" fill="none" stroke-width="1.5" {look}/>')
    return "\n".join([*parts, "</svg>", ""])


def _ticks(low, high):
    """Round numbers between two powers of ten: the fewest kinds of them that give at least two."""
    for kinds in ((1,), (1, 3), (1, 2, 5), range(1, 10)):
        found = [
            kind * 10.0**decade
            for decade in range(math.floor(low), math.ceil(high))
            for kind in kinds
            if low <= math.log10(kind) + decade <= high
        ]
        if len(found) >= 2:
            return found[:: len(found) // 4 + 1]
    return [float(f"{10**low:.3g}"), float(f"{10**high:.3g}")]


def _shows():
    """Of each effect where it shows: the table's fourth column in docs/effects.md."""
    rows = re.findall(r"^\| `(\w+)` \|(.+)\|$", (DOCS / "effects.md").read_text("utf-8"), re.M)
    return {name: cells.split(" | ")[2].strip() for name, cells in rows}


def entries():
    """Of each effect its name, and its first case in the tests."""
    first = {}
    for known in KNOWN:
        first.setdefault(known.name, known)
    return first


def page():
    """The page's text."""
    shows, parts = _shows(), [HEAD.format(index=_index())]
    for name, known in entries().items():
        parts += [
            f"## {name}\n",
            f"![{name}](images/gallery/{name}.svg)\n",
            f"*{_sentence(known.effect.cause(known.changed))}*\n",
            f"**Where it shows:** {shows[name]}.\n",
            f"**What to do:** {remedy(name).format(effect=name)}\n",
        ]
    parts.append("## Found in the traces\n")
    parts.append(
        "Two effects change no spectrum in a simple way. They are found in the traces over time, "
        "and corrected there. What to do about them:\n"
    )
    parts += [f"- `{name}`: {what}" for name, what in REMEDIES.items()]
    return "\n".join(parts) + "\n"


def _index():
    """Where something is seen, and which effects look so; each effect once."""
    named = sorted(name for names in SEEN.values() for name in names)
    assert named == sorted(entries()), "every effect has its place in SEEN"
    return "\n".join(
        f"- **{seen}**: {', '.join(f'[`{name}`](#{name})' for name in names)}"
        for seen, names in SEEN.items()
    )


def _sentence(cause):
    return f"{capital(cause)}."


def main():
    """Writes page and pictures."""
    PICTURES.mkdir(exist_ok=True, parents=True)
    for name, known in entries().items():
        (PICTURES / f"{name}.svg").write_text(svg(panel_of(known)), encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
