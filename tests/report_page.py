"""A page of the report as the tests read it: text, tables, links and charts."""

from __future__ import annotations

import base64
import json
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np

CELLS = ("td", "th")
BLOCKS = ("p", "li", "h1", "h2", "h3", "tr", "dt", "dd", "figcaption", "summary", "section", "nav",
          "article", "form", "footer", "label", "legend", "title")  # fmt: skip


class Page(HTMLParser):
    """Tables as rows of text, links and sources, visible text, and the charts of a page.

    `lines` is the text block by block, cells of a row parted by "|".
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.loads: list[str] = []
        self.lines: list[str] = []
        self.text = self.charts_json = self._line = ""
        self._inside: str | None = None
        self.feed(path.read_text(encoding="utf-8"))
        self.charts: dict[str, Any] = json.loads(self.charts_json)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.loads += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag == "tr":
            self.rows.append([])
        elif tag in CELLS:
            if self.rows[-1]:
                self._line += " | "
            self.rows[-1].append("")
        self._inside = tag if tag in (*CELLS, "script") else self._inside
        if tag in BLOCKS:
            self._end_line()

    def handle_endtag(self, tag: str) -> None:
        if tag in (*CELLS, "script"):
            self._inside = None
        if tag in BLOCKS:
            self._end_line()

    def handle_data(self, data: str) -> None:
        if self._inside == "script":
            self.charts_json += data
            return
        self.text += data
        self._line += data
        if self._inside in CELLS:
            self.rows[-1][-1] = " ".join((self.rows[-1][-1] + data).split())

    def _end_line(self) -> None:
        line = " ".join(self._line.split())
        self.lines += [line] if line else []
        self._line = ""

    @property
    def words(self) -> str:
        """All text with single spaces."""
        return " ".join(self.text.split())


def resolved(part: Any, arrays: list[np.ndarray]) -> Any:
    """What charts.js does: put the page's arrays where the figures say."""
    if isinstance(part, list):
        return [resolved(one, arrays) for one in part]
    if not isinstance(part, dict):
        return part
    if set(part) == {"array"} and isinstance(part["array"], int):
        return arrays[part["array"]]
    return {key: resolved(value, arrays) for key, value in part.items()}


def unpacked(packed: list[str]) -> list[np.ndarray]:
    """The page's arrays."""
    return [np.frombuffer(base64.b64decode(one), "<f4") for one in packed]


def figure(page: Page, name: str) -> Any:
    """A figure of the page with its arrays in place."""
    return resolved(page.charts["figures"][name], unpacked(page.charts["arrays"]))
