"""What no file tells and a person knows: questions with the field's usual values, and answers.

An answer is a number, a word of the setup, or `unknown`. Answers come from a terminal, or from a
TOML file that is a part of a setup, in which the tables may be left out: `radius_nm = 500.0`.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel

from mtpipe.ground.errors import SetupError
from mtpipe.proposal.draft import NOT_KNOWN, USUAL, Draft
from mtpipe.setup.measured import UNKNOWN
from mtpipe.setup.setup import Setup
from mtpipe.setup.source_parts import PositionUnit
from mtpipe.setup.source_table import Source
from mtpipe.setup.tables import (
    NOISE,
    ROTATION,
    WALL_DRAG,
    Beads,
    Buffer,
    Camera,
    FieldAxis,
    Model,
    Plateaus,
    Tether,
)

USUAL_EFFECTS = [WALL_DRAG, ROTATION, NOISE]
USUAL_PIXEL_NM = 100.0
NUMBER = r"([-+]?\d*[.,]?\d+(?:[eE][-+]?\d+)?)"
# Units in which people answer, by the unit of the key: factor and what is added.
UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "s": {"s": (1.0, 0.0), "ms": (1e-3, 0.0), "us": (1e-6, 0.0), "µs": (1e-6, 0.0)},
    "nm": {"nm": (1.0, 0.0), "um": (1e3, 0.0), "µm": (1e3, 0.0)},
    "hz": {"Hz": (1.0, 0.0), "fps": (1.0, 0.0), "kHz": (1e3, 0.0)},
    "K": {"K": (1.0, 0.0), "C": (1.0, 273.15), "°C": (1.0, 273.15)},
}
# Tables whose keys have names of their own, so that an answer needs no table.
SECTIONS: dict[str, type[BaseModel]] = {
    "camera": Camera, "beads": Beads, "tether": Tether, "buffer": Buffer, "field": FieldAxis,
    "model": Model, "plateaus": Plateaus,
}  # fmt: skip


@dataclass(frozen=True)
class Question:
    """A key of the setup that is asked for; `usual` is what is taken where nobody answers."""

    key: str
    text: str
    usual: Any
    why: str


ALWAYS = (
    Question(
        "camera.exposure_s",
        "How long is the shutter open in each frame, in s?",
        UNKNOWN,
        NOT_KNOWN,
    ),
    Question(
        "beads.radius_nm",
        "Radius of the magnetic beads in nm? Usual: 1400 (Dynabeads M-280), 525 (MyOne), 2250 "
        "(M-450)",
        UNKNOWN,
        "not known: forces near the camera's Nyquist frequency are less certain; write it here",
    ),
    Question(
        "tether.contour_length_nm",
        "Contour length of the tether in nm? DNA has 0.34 nm per base pair",
        UNKNOWN,
        NOT_KNOWN,
    ),
    Question(
        "tether.persistence_length_nm",
        "Its persistence length in nm? Usual: 50 for double-stranded DNA",
        50.0,
        f"double-stranded DNA; {USUAL}",
    ),
    Question(
        "buffer.temperature_K",
        "Temperature of the buffer in K? Usual: 296",
        UNKNOWN,
        "not known: 296 ± 3 K is assumed",
    ),
    Question(
        "buffer.viscosity_mPa_s",
        "Viscosity of the buffer in mPa s? Usual: 0.93 for water at 296 K",
        UNKNOWN,
        "not known: that of water is assumed",
    ),
)


# What a person is asked about keys that the files may leave open.
ASKED = {
    "camera.frame_rate_hz": "How many frames did the camera take per second?",
    "camera.pixel_size_nm": "Size of a pixel in the sample, in nm? Usual: 50 to 200",
    "field.direction": "Along which axis of the camera do the magnets' field lines run? x or y",
    "source.scale.z": "Factor on z? 1 if heights are corrected for refraction, 0.88 if not "
    "(oil objective, bead in water)",
    "beads.reference": "Which beads are fixed to the surface? Names with commas, or none",
}


def parsed(key: str, text: str) -> Any:
    """An answer as the setup has it.

    Raises
    ------
    SetupError : it is no answer to this question.
    """
    word = text.strip()
    if key == "beads.reference":
        none = word.casefold() in ("", "none", "no", "-", "[]", "keine")
        return [] if none else [one.strip(" \"'[]") for one in word.split(",") if one.strip()]
    if key == "field.direction" or key.startswith("source.units"):
        words = get_args(FieldAxis.model_fields["direction"].annotation)
        if key.startswith("source.units"):
            words = get_args(get_args(PositionUnit)[0])
        plain = {"µm": "um", "μm": "um", "px": "pixel"}.get(word, word)
        if plain not in words:
            raise SetupError(f"{word!r} is none of {', '.join(words)}")
        return plain
    if word.casefold() in (UNKNOWN, "?", ""):
        return UNKNOWN
    match = re.fullmatch(rf"{NUMBER}\s*(.*)", word)
    units = UNITS.get(key.rpartition("_")[2], {})
    if match is None or match[2] not in ("", *units):
        raise SetupError(f'a number or "{UNKNOWN}" is needed, got {word!r}')
    factor, added = units.get(match[2], (1.0, 0.0))
    return float(f"{float(match[1].replace(',', '.')) * factor + added:.10g}")


def read_answers(path: Path) -> dict[str, Any]:
    """Answers from a file, as a part of a setup.

    Raises
    ------
    SetupError : it is no TOML, or has a key that no setup has.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise SetupError(f"cannot be read ({error})", where=str(path)) from None
    return as_setup_part(content, str(path))


def as_setup_part(content: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Answers with every key in its table.

    Raises
    ------
    SetupError : a key that no setup has.
    """
    homes = {
        f"{name}{end}": table
        for table, section in SECTIONS.items()
        for name in section.model_fields
        for end in ("", "_stderr")
    }
    tables = {field.alias or name for name, field in Setup.model_fields.items()}
    part: dict[str, Any] = {}
    for key, told in content.items():
        value = _in_its_unit(key, told, where)
        if key in tables and (isinstance(value, (Mapping, list)) or key == "schema"):
            if key in SECTIONS and isinstance(value, Mapping):
                values = {name: _in_its_unit(name, one, where) for name, one in value.items()}
                part.setdefault(key, {}).update(values)
            else:
                part[key] = value
        elif key in homes:
            part.setdefault(homes[key], {})[key] = value
        elif key in Source.model_fields:
            part.setdefault("source", {})[key] = value
        else:
            raise _no_key(key, [*homes, *tables], where)
    for table, values in part.items():
        for key in values if table in SECTIONS and table != "model" else ():
            if homes.get(key) != table:
                raise _no_key(key, [one for one, home in homes.items() if home == table], where)
    return part


def _in_its_unit(key: str, value: Any, where: str) -> Any:
    """An answer as the setup has it: `"22 °C"` of a temperature in K is 295.15."""
    if not isinstance(value, str) or key.removesuffix("_stderr").rpartition("_")[2] not in UNITS:
        return value
    try:
        return parsed(key.removesuffix("_stderr"), value)
    except SetupError as error:
        raise SetupError(f"{key}: {error.message}", where=where) from None


def _no_key(key: str, known: Sequence[str], where: str) -> SetupError:
    near = difflib.get_close_matches(key, known, n=1)
    hint = f"Did you mean {near[0]}?" if near else "Answers are keys of a setup."
    return SetupError(f"{key!r} is no key of a setup", where=where, mend=hint)


def put_usual(draft: Draft) -> None:
    """Fill what nobody answered with the usual values, each with the word that it is one."""
    for question in ALWAYS:
        if draft.get(question.key) is None:
            draft.put(question.key, question.usual, question.why)
    if draft.get("model.effects") is None:
        draft.put("model.effects", list(USUAL_EFFECTS), "what every bead near a surface has")
