"""Markdown tables, and their places in a page."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence


def table(header: str, lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table; header cells separated by |."""
    names = header.split(" | ")
    rule = "|" + " --- |" * len(names)
    return "\n".join([f"| {header} |", rule, *("| " + " | ".join(line) + " |" for line in lines)])


def into_page(page: str, blocks: Mapping[str, str]) -> str:
    """A page whose blocks between `<!-- study: name -->` and `<!-- end -->` are replaced.

    Raises
    ------
    ValueError : the page has no place for a block.
    """
    for name, block in blocks.items():
        place = re.compile(rf"(<!-- study: {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        page, found = place.subn(lambda m, b=block: f"{m[1]}{b}\n{m[2]}", page)
        if found != 1:
            raise ValueError(f"the page needs one place <!-- study: {name} -->, has {found}")
    return page
