"""The text of a proposed setup: TOML with a sentence at each key that was guessed or is open."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from mtpipe.proposal.draft import Draft
from mtpipe.setup.source_table import Source
from mtpipe.setup.tables import (
    Beads,
    Buffer,
    Camera,
    DriftChoice,
    FieldAxis,
    Model,
    Plateaus,
    ReportChoice,
    Tether,
)
from mtpipe.setup.tracking_table import Tracking

MODELS: dict[str, type[BaseModel]] = {
    "camera": Camera, "beads": Beads, "tether": Tether, "buffer": Buffer, "field": FieldAxis,
    "model": Model, "plateaus": Plateaus, "drift": DriftChoice, "source": Source,
    "tracking": Tracking, "report": ReportChoice,
}  # fmt: skip
# Where comments begin, if the line leaves room.
COLUMN = 36
INLINE = 90


def setup_text(draft: Draft, head: str) -> str:
    """A whole setup file; `head` is its first remark."""
    lines = [*(f"# {line}" for line in head.splitlines()), "schema = 1"]
    rest = [table for table in draft.content if table not in (*MODELS, "schema")]
    for table in (*MODELS, *rest):
        content = draft.content.get(table)
        if content is None:
            continue
        if not isinstance(content, Mapping):  # [[magnet]]
            lines += [line for one in content for line in ("", f"[[{table}]]", *_pairs(one))]
            continue
        lines += ["", f"[{table}]"]
        order = list(MODELS[table].model_fields) if table in MODELS else []
        place = {name: k for k, name in enumerate(order)}
        for key in sorted(content, key=lambda one: place.get(one.removesuffix("_stderr"), 0)):
            value = content[key]
            lines += _line(key, value, _reason(draft, f"{table}.{key}", value))
    return "\n".join(lines) + "\n"


def said(draft: Draft) -> list[str]:
    """Each guess in one line, as it stands in the setup."""
    return [
        f"{key} = {toml_value(draft.get(key))}: {draft.why[key]}"
        for key in draft.guessed
        if draft.get(key) is not None
    ]


def toml_value(value: Any) -> str:
    """A value as TOML writes it, tables inline."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON's escapes are TOML's, but for DEL; what is no Unicode cannot stand in a file
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, float):
        if not math.isfinite(value):
            return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")
        shown = repr(value)
        return shown if any(mark in shown for mark in ".en") else f"{shown}.0"
    if isinstance(value, Mapping):
        inner = ", ".join(f"{_key(k)} = {toml_value(v)}" for k, v in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(one) for one in value)}]"
    return str(value)


def _reason(draft: Draft, key: str, value: Any) -> str:
    """The sentence of a key, with those of the keys within it."""
    found = [draft.why[key]] if draft.why.get(key) else []
    if isinstance(value, Mapping):
        inner = {k: why for k, why in draft.why.items() if k.startswith(f"{key}.") and why}
        for path, why in inner.items():
            name = path.removeprefix(f"{key}.")
            sentence = f"{name}: {why}" if len(inner) > 1 else why
            if why not in " ".join(found):
                found.append(sentence)
    return "; ".join(found)


def _line(key: str, value: Any, reason: str) -> list[str]:
    shown = f"{_key(key)} = {toml_value(value)}"
    tables = isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value)
    if tables and len(shown) > INLINE:
        return [
            *([f"# {reason}"] if reason else []),
            f"{_key(key)} = [",
            *(f"    {toml_value(one)}," for one in value),
            "]",
        ]
    if not reason:
        return [shown]
    if len(shown) < COLUMN and len(reason) <= INLINE:
        return [f"{shown:<{COLUMN}}# {reason}"]
    return [f"# {reason}", shown]


def _pairs(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(key)} = {toml_value(value)}" for key, value in table.items()]


def _key(key: str) -> str:
    bare = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if bare else json.dumps(key, ensure_ascii=False)
