"""The reference of `setup.toml`: every key with type, unit, default, meaning and an example.

All of it is read from the models, where each key says what it means; `mtpipe explain` shows it, and
docs/setup-reference.md is the same as a page.
"""

from __future__ import annotations

import difflib
import json
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from mtpipe.ground.errors import MtpipeError
from mtpipe.setup.measured import UNKNOWN, Measured
from mtpipe.setup.setup import Setup
from mtpipe.setup.source_parts import Column, Rows
from mtpipe.setup.usual_errors import USUAL_RELATIVE, USUAL_TEMPERATURE_K

# Endings of keys, and the units they stand for; a longer one comes before its own ending.
UNITS = {
    "_mPa_s": "mPa s", "_hz": "Hz", "_nm": "nm", "_mm": "mm", "_s": "s", "_K": "K", "_pN": "pN",
    "_px": "pixels", "_turns": "turns", "_kA_per_m": "kA/m", "_mT": "mT", "_T": "T",
}  # fmt: skip
LIMITS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
WORDS = {float: "number", int: "whole number", str: "text", bool: "true or false"}
REPEATED = "<bead>"


class NoSuchKeyError(MtpipeError):
    """The setup has no such key."""

    exit_code = 2


@dataclass(frozen=True)
class Key:
    """One key of the setup, or one table.

    Attributes
    ----------
    path : as in `camera.exposure_s`.
    kind : what can stand there, in words; "table" or "list of tables" for a table.
    default : as it would be written; "required" or "none".
    example : a line of TOML; empty for a table.
    """

    path: str
    kind: str
    unit: str
    default: str
    meaning: str
    example: str

    @property
    def is_table(self) -> bool:
        """Whether it holds keys of its own."""
        return "table" in self.kind

    @property
    def table(self) -> str:
        """Path of the table that it stands in; empty at the top."""
        return self.path.rpartition(".")[0]


def keys() -> tuple[Key, ...]:
    """Every table and key of the setup, each table before its keys."""
    return tuple(_keys(Setup, ""))


def find_key(path: str) -> Key:
    """The key of a path; that of a value also for its `_stderr`.

    Raises
    ------
    NoSuchKeyError : there is none; names the nearest.
    """
    known = {key.path: key for key in keys()}
    asked = path.strip().strip("[]").removesuffix("_stderr")
    if asked in known:
        return known[asked]
    ends = [one for one in known if one.rpartition(".")[2] == asked]
    if len(ends) == 1:
        return known[ends[0]]
    last = {one.rpartition(".")[2]: one for one in known}
    close = difflib.get_close_matches(asked, known, n=3, cutoff=0.6) or [
        last[one]
        for one in difflib.get_close_matches(asked.rpartition(".")[2], last, n=3, cutoff=0.6)
    ]
    near = ends or close
    mend = f"Nearest: {', '.join(near)}." if near else "Say mtpipe explain for all tables."
    raise NoSuchKeyError(f"there is no key {path!r} in a setup", mend=mend)


def of_table(path: str) -> tuple[Key, ...]:
    """The keys that stand in a table; "": the tables of the setup and its first key."""
    return tuple(key for key in keys() if key.table == path)


def _keys(model: type[BaseModel], prefix: str) -> Iterator[Key]:
    for name, field in model.model_fields.items():
        path = prefix + (field.alias or name)
        inner, repeated = _inner(field.annotation)
        yield Key(
            path,
            _kind(field, inner, repeated),
            next((unit for end, unit in UNITS.items() if name.endswith(end)), ""),
            _default(field, name),
            field.description or "",
            "" if inner else f"{field.alias or name} = {as_toml((field.examples or [None])[0])}",
        )
        if inner is not None:
            step = f".{REPEATED}." if repeated is dict else "."
            yield from _keys(inner, path + step)


def _inner(annotation: Any) -> tuple[type[BaseModel] | None, type | None]:
    """The table that a field holds, and whether it holds several: a tuple or a dict of them."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return (None if annotation is Measured else annotation), None
    for part in get_args(annotation):
        found, repeated = _inner(part)
        if found is not None:
            origin = get_origin(annotation)
            return found, origin if origin in (tuple, dict) else repeated
    return None, None


def _kind(field: FieldInfo, inner: type[BaseModel] | None, repeated: type | None) -> str:
    if inner is not None:
        several = "table of tables" if repeated is dict else "list of tables"
        return "table" if repeated is None else several
    limits = [
        f"{words} {limit:g}"
        for part in field.metadata
        for name, words in LIMITS.items()
        if isinstance(limit := getattr(part, name, None), (int, float))
    ]
    return ", ".join([_words(field.annotation), *limits])


def _words(annotation: Any) -> str:
    """A type as people call it."""
    if annotation in (Column, int | str):
        return "name or number of a column"
    if annotation == Rows:
        return "pair of whole numbers"
    if annotation is Measured:
        return f'number or "{UNKNOWN}"'
    if annotation in WORDS:
        return WORDS[annotation]
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _words(parts[0])
    if origin is Literal:
        return " or ".join(as_toml(choice) for choice in parts)
    if origin in (Union, types.UnionType):
        return " or ".join(_words(part) for part in parts if part is not type(None))
    if origin is tuple and parts[-1] is Ellipsis:
        return f"list of {_words(parts[0])}s".replace("pair of whole numbers", "pair")
    if origin is tuple:
        return f"pair of {_words(parts[0])}s"
    if origin is dict:
        return f"{_words(parts[1])} for each bead"
    raise TypeError(f"no words for {annotation}")


def _default(field: FieldInfo, name: str) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    empty = value is None or isinstance(value, BaseModel) or value in ((), {})
    return "none" if empty else as_toml(value)


def usual_error(path: str) -> str:
    """The standard error that a value has where the setup states none, in words; empty: none."""
    name = path.rpartition(".")[2]
    if name == "temperature_K":
        return f"{USUAL_TEMPERATURE_K:g} K"
    return f"{100 * USUAL_RELATIVE[name]:g} %" if name in USUAL_RELATIVE else ""


def as_toml(value: Any) -> str:
    """A value as it is written in a setup."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(as_toml(one) for one in value)}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {as_toml(one)}' for key, one in value.items())} }}"
    return json.dumps(value, ensure_ascii=False)
