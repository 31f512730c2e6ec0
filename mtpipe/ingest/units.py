"""Units as files write them: `µm`, `[um]`, `micrometers`, `milliseconds since ...`."""

from __future__ import annotations

import re

from mtpipe.ingest.names import plain

SPELLINGS: dict[str, tuple[str, ...]] = {
    "nm": ("nm", "nanometer", "nanometre"),
    "um": ("um", "μm", "micron", "micrometer", "micrometre"),
    "mm": ("mm", "millimeter", "millimetre"),
    "cm": ("cm", "centimeter", "centimetre"),
    "m": ("m", "meter", "metre"),
    "angstrom": ("å", "angstrom", "ångström"),
    "pixel": ("px", "pix", "pxl", "pixel", "píxel", "píxeles"),
    "s": (
        "s", "sec", "second", "sekunde", "sekunden", "seconde", "seconden", "segundo", "secondo",
        "secondi",
    ),
    "ms": ("ms", "msec", "millisecond"),
    "us": ("us", "μs", "usec", "μsec", "microsecond"),
    "ns": ("ns", "nsec", "nanosecond"),
    "min": ("min", "minute"),
    "h": ("h", "hr", "hour"),
    "day": ("d", "day"),
    "turn": (
        "turn", "rev", "revolution", "rot", "rotation", "umdrehung", "umdrehungen", "tour",
        "vuelta", "giro", "giri", "omwenteling", "omwentelingen",
    ),
    "degree": ("°", "deg", "degree", "grad", "degré", "grado", "gradi", "graad", "graden"),
    "radian": ("rad", "radian"),
}  # fmt: skip
UNITS = {
    spelling: unit
    for unit, spellings in SPELLINGS.items()
    for one in spellings
    for spelling in (one, f"{one}s")
}
# Words that stand in a row of units beside those above, and say nothing that is compared.
OTHER_UNITS = {
    "", "-", "--", "1", "#", "a.u.", "au", "arb.", "arb. u.", "counts", "count", "index", "frame",
    "frames", "number", "none", "v", "volt", "mv", "a", "ma", "pn", "fn", "k", "c", "°c", "hz",
    "khz", "pa", "t", "mt", "g", "%", "bool", "nm²", "nm^2", "pn/nm",
}  # fmt: skip


def unit_of(text: str) -> str | None:
    """The unit as `[source]` calls it (`um`); None where the text is no unit of a column.

    `milliseconds since 2024-05-01 12:00` (netCDF) is milliseconds.
    """
    word = _bare(text).partition(" since ")[0].strip()
    return UNITS.get(word)


def is_row_of_units(cells: list[str]) -> bool:
    """Whether cells below the columns' names are their units: at least half known, no other."""
    words = [_bare(cell) for cell in cells]
    known = [word for word in words if word in UNITS]
    other = [word for word in words if word not in UNITS and word not in OTHER_UNITS]
    return bool(known) and len(other) <= len(words) // 4 and len(known) >= len(words) // 3


def unit_in_name(name: str) -> str:
    """The unit in brackets at the end of a column's name, "" without any."""
    match = re.search(r"[(\[{]\s*([^()\[\]{}]*?)\s*[)\]}]\s*$", name)
    return match[1] if match and unit_of(match[1]) else ""


def _bare(text: str) -> str:
    return plain(text).strip(" ()[]{}").casefold()
