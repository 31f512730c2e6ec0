"""Single values beside the columns of a file, such as `fps` or `info/frame_rate`: the frame rate.

A single value speaks of the columns of its group and of those within it; in a group that has no
columns it describes the group that this one is in.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from mtpipe.ingest.column_attributes import NOTHING, Stated, stated_by


def with_singles(
    names: Sequence[str], stated: Sequence[Stated], singles: Mapping[str, Any]
) -> list[Stated]:
    """What a file says of its columns, the rates in single values included.

    Parameters
    ----------
    names, stated : of the columns.
    singles : values by name; one may be a column as well, of one row.
    """
    longer = [name for name in names if name not in singles]
    in_groups = {group for name in longer for group in _upwards(_group(name))}
    said: dict[str, dict[str, Any]] = {}
    for name, value in singles.items():
        where = next(group for group in _upwards(_group(name)) if group in in_groups or not group)
        said.setdefault(where, {})[name] = value
    rates = {group: _rate_among(values) for group, values in said.items()}
    around = {g: next((rates[o] for o in _upwards(g) if o in rates), NOTHING) for g in in_groups}
    return [
        one.beside(around.get(_group(name), NOTHING))
        for name, one in zip(names, stated, strict=True)
    ]


def _rate_among(values: Mapping[str, Any]) -> Stated:
    """The rate that values by their names in a file give, if any does."""
    found = NOTHING
    for name, value in values.items():
        last = name.rpartition("/")[2]
        own = stated_by({last: value})
        if own.rate_hz is not None:
            words = own.rate_words.replace(last, name, 1)
            found = found.beside(Stated(rate_hz=own.rate_hz, rate_words=words))
    return found


def _group(name: str) -> str:
    return name.rpartition("/")[0]


def _upwards(group: str) -> Iterator[str]:
    """A group and all that it is in; the file is the last."""
    yield group
    while group:
        group = _group(group)
        yield group
