"""What the name of a column says of it, in the words that laboratories use.

A name is cut into words and numbers: `Kugel1 X (µm)` is kugel, 1, x. What a word begins with tells
time, frame number, magnet and rotation; a letter x, y or z by itself is an axis, and what is left
of the name says whose.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from mtpipe.ingest.names import plain
from mtpipe.ingest.units import unit_of

Role = Literal["time", "frame", "magnet", "rotation", "other"]
# In this order: a magnet's rotation is a rotation, a magnet's z is no bead's.
ROLES: tuple[tuple[Role, re.Pattern[str]], ...] = (
    (
        "rotation",
        re.compile(
            r"rot|turn|dreh|winkel|angle|revol|windung|gir[oi]|vuelta|draai|omwent|theta$|phi$"
        ),
    ),
    (
        "magnet",
        re.compile(
            r"z?mag(?!nif|nit|scope|track)|motor|mot$|aimant|im[aá]n|translation|actuator|aktuator"
        ),
    ),
    (
        "time",
        re.compile(
            r"time|zeit|t$|ts$|temps|tiempo|tijd|tempo$|h?ora$|heure|stamp|clock|uhr|second|sekund|"
            r"segundo|elapsed|dat"
        ),
    ),
    (
        "frame",
        re.compile(
            r"frame|bild|img|image|index|idx|nr$|no$|number|nummer|imagen|cuadro|beeld|fotogr|"
            r"immagin"
        ),
    ),
    (
        "other",
        re.compile(
            r"focus|fokus|objecti|objekti|piezo|stage|tisch|temp|intens|amplit|qual|error|fehler|"
            r"sigma|std|stderr|force|kraft|forza|fuerza|kracht|status|state|valid|score|corr|laser|"
            r"length|current|curve"
        ),
    ),
)
AXIS = re.compile(r"(?:pos|position|coord|centroid|cent(?:er|re)|c)?([xyz])(?:pos|position|coord)?")
HEIGHT = re.compile(r"height|höhe|hoehe|hauteur|altura|altezza|hoogte")
# Words beside an axis that say nothing of whose it is.
FILLERS = {
    "pos", "position", "posición", "posizione", "positie", "coord", "coordinate", "koordinate",
    "of", "axis", "achse",
}  # fmt: skip
REFERENCE = re.compile(r"ref\w*|r|rif\w*|fid\w*|fix\w*|fij\w*|fiss\w*|stuck\w*|surface|fest\w*")
PIECES = re.compile(r"[A-Z]+(?![a-zà-ÿ])|[^\W\d_]?[^\W\d_A-Z]+|[^\W\d_]+|\d+")
BRACKETED = re.compile(r"[(\[{]\s*([^()\[\]{}]*?)\s*[)\]}]")


@dataclass(frozen=True)
class Said:
    """What a name says: a role, or an axis of whatever `owner` (words and numbers) is."""

    role: Role | None = None
    axis: str | None = None
    owner: tuple[str, ...] = ()


def said_by(name: str) -> Said:
    """What the name of a column says of it; nothing where no word is known."""
    words = words_of(name)
    # of a path only the last part is the column's own, but for whose it is
    own = words_of(name.rpartition("/")[2]) or words
    for candidates in (own, words):
        for role, pattern in ROLES:
            # `frame/x` is a position all the same, `magnet/z` none of a bead
            if _is_axis_alone(own) and role in ("time", "frame"):
                continue
            if any(pattern.match(word) for word in candidates):
                return Said(role=role)
    places = [k for k, word in enumerate(words) if AXIS.fullmatch(word)]
    if not places:
        height = [k for k, word in enumerate(words) if HEIGHT.match(word)]
        if len(height) != 1:
            return Said()
        owner = (*words[: height[0]], *words[height[0] + 1 :])
        return Said(axis="z", owner=_owner(owner))
    at = places[-1]
    match = AXIS.fullmatch(words[at])
    assert match is not None
    return Said(axis=match[1], owner=_owner((*words[:at], *words[at + 1 :])))


def words_of(name: str) -> tuple[str, ...]:
    """Words and numbers of a name in lower case, without its unit."""
    text = BRACKETED.sub(lambda m: " " if unit_of(m[1]) else m[0], plain(name))
    words = [piece.casefold() for piece in PIECES.findall(text)]
    if len(words) > 1 and unit_of(words[-1]) not in (None, "m", "min", "day", "h"):
        words.pop()
    return tuple(words)


def unit_said(name: str) -> str:
    """The unit at the end of a name, as in `b1_x_nm`; "" without any."""
    last = plain(name).replace("_", " ").split()
    return last[-1] if len(last) > 1 and unit_of(last[-1]) else ""


def is_reference(bead: str) -> bool:
    """Whether a bead's name says that it is fixed to the surface."""
    words = words_of(bead)
    return bool(words) and REFERENCE.fullmatch(words[0]) is not None


def owner_of(name: str) -> tuple[str, ...]:
    """Words and numbers of a name that say whose it is."""
    return _owner(words_of(name))


def _is_axis_alone(own: tuple[str, ...]) -> bool:
    """Whether the column's own part of a path is an axis and no more, whatever is around it."""
    return len(own) == 1 and AXIS.fullmatch(own[0]) is not None


def _owner(words: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(word for word in words if word not in FILLERS)
