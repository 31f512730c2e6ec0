"""Units by what the file says, else by what is plausible of beads, cameras and magnets.

Fast motion tells the unit of a position: a tethered bead trembles by some 2 to 500 nm from frame to
frame. A number between 0.02 and 5 may be pixels as well as micrometres; pixels are told by their
place in the image. What is decided so is a guess.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.ingest.units import unit_of
from mtpipe.proposal.look import Column
from mtpipe.proposal.name_words import unit_said
from mtpipe.setup.source_parts import NM_PER_UNIT, SECONDS_PER_UNIT, TURNS_PER_UNIT

# Frames per second of most recordings; a unit that makes a rate near it is the likeliest.
LIKELY_HZ = 100.0
# From frame to frame, nm: the geometric middle of what tethered beads do, laterally and along z.
LIKELY_TREMBLE_NM = 30.0
# Farther from the corner of an image than this is no place in µm: fields of view are smaller.
WIDEST_FIELD_UM = 300.0
# Trembling of beads on images whose pixels are some 100 nm.
PIXEL_TREMBLE = (0.005, 4.0)
# No bead that is followed moves more or less from frame to frame; files say wrong units at times.
POSSIBLE_NM = (0.02, 5000.0)
LONGEST_MAGNET_MM = 60.0
MOST_TURNS = 400.0
LENGTHS = ("nm", "um", "mm", "m")


def stated_unit(columns: Sequence[Column]) -> str | None:
    """The unit that the file gives for columns, in its attributes or their names; None if none."""
    units = {unit_of(c.stated.unit) or unit_of(unit_said(c.name)) for c in columns}
    unit = units.pop() if len(units) == 1 else None
    return unit


def is_plausible(columns: Sequence[Column], unit: str) -> bool:
    """Whether beads tremble in a stated unit as beads can."""
    tremble = float(np.median([_tremble(c.seconds) for c in columns]))
    nm = tremble * NM_PER_UNIT.get(unit, 100.0)
    return tremble == 0 or POSSIBLE_NM[0] < nm < POSSIBLE_NM[1]


def position_unit(columns: Sequence[Column], axis: str) -> tuple[str, str]:
    """Unit of the positions along an axis and why, if the file does not say it.

    Parameters
    ----------
    columns : of all beads.
    """
    tremble = float(np.median([_tremble(c.seconds) for c in columns]))
    place = max(float(np.nanmax(np.abs(c.seconds), initial=0.0)) for c in columns)
    said = f"positions change by {_short(tremble)}"
    if axis != "z" and tremble < PIXEL_TREMBLE[1]:
        if tremble > PIXEL_TREMBLE[0] and place > WIDEST_FIELD_UM:
            return "pixel", f"{said} from frame to frame and reach {_short(place)}, as pixels do"
        if tremble > 0.5:
            return "pixel", f"{said} from frame to frame, likely pixels"
    unit = min(
        LENGTHS,
        key=lambda one: abs(math.log(max(tremble, 1e-12) * NM_PER_UNIT[one] / LIKELY_TREMBLE_NM)),
    )
    return unit, f"{said} {unit} from frame to frame, as tethered beads do"


def time_unit(stamps: FloatArray) -> tuple[str, str]:
    """Unit of time stamps (n,) by the frame rate that it makes, and why."""
    known = stamps[np.isfinite(stamps)]
    step = (known[-1] - known[0]) / max(len(known) - 1, 1)
    rates = {unit: 1 / (step * seconds) for unit, seconds in SECONDS_PER_UNIT.items()}
    unit = min(rates, key=lambda one: abs(math.log(rates[one] / LIKELY_HZ)))
    return unit, f"a guess: with it there are {rates[unit]:.4g} rows per second"


def magnet_unit(values: FloatArray) -> tuple[str, str]:
    """Unit of a magnet's positions by their size, and why."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    unit = "mm"
    if largest > LONGEST_MAGNET_MM:
        unit = "um" if largest < 1e3 * LONGEST_MAGNET_MM else "nm"
    elif 0 < largest < 1e-3 * LONGEST_MAGNET_MM and largest < 0.02:
        unit = "m"
    return unit, f"its unit is a guess: values are up to {_short(largest)}"


def rotation_unit(name: str, values: FloatArray) -> tuple[str, str]:
    """Unit of a rotation by its name and size, and why."""
    if any(word in name.casefold() for word in ("deg", "winkel", "angle", "°")):
        return "degree", "unit by its name"
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    unit = "degree" if largest > MOST_TURNS else "turn"
    assert unit in TURNS_PER_UNIT
    return unit, f"its unit is a guess: values are up to {_short(largest)}"


def _tremble(values: FloatArray) -> float:
    """Median step from row to row; 0 without any."""
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps)]
    moving = steps[steps > 0]
    return float(np.median(moving)) if len(moving) else 0.0


def _short(value: float) -> str:
    return f"{value:.3g}"
