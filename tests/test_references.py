"""What code and documents cite of docs/physics.md and docs/formats.md stands there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CITING = [
    path
    for folder in ("mtpipe", "docs", "tests", "workflows")
    for kind in ("*.py", "*.md")
    for path in sorted((ROOT / folder).rglob(kind))
]
# a citation may be broken by the end of its line, and by the mark of a comment on the next
CITATION = re.compile(r"\b(PHYSICS|FORMATS)[\s#]+(?:sections?[\s#]+)?(E\d+|\d+(?:\.[0-9A-C])?)")


def places(page):
    """Numbers of headings (8.1, 3.B), and of effects (E12), that a page has."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    headings = re.findall(r"^#+ (\d+(?:\.[0-9A-C])?)", text, re.MULTILINE)
    effects = re.findall(r"^(?:\*\*|- \*\*)(E\d+)", text, re.MULTILINE)
    shared = re.findall(r"^(?:\*\*|- \*\*)[^*]*?, (E\d+)", text, re.MULTILINE)
    return {*headings, *effects, *shared}


PLACES = {"PHYSICS": places("physics.md"), "FORMATS": places("formats.md")}


def missing(text):
    """Citations of a text that lead nowhere."""
    return [
        f"{page} {place}" for page, place in CITATION.findall(text) if place not in PLACES[page]
    ]


def test_every_citation_leads_somewhere():
    lost = {
        str(path.relative_to(ROOT)): gone
        for path in CITING
        if path != Path(__file__) and (gone := missing(path.read_text(encoding="utf-8")))
    }
    assert not lost


def test_citations_are_found():
    cited = {
        place for path in CITING for _, place in CITATION.findall(path.read_text(encoding="utf-8"))
    }
    assert {"E12", "E20", "8.8", "3.B", "2"} <= cited


@pytest.mark.parametrize("text", ["PHYSICS E99", "(FORMATS section 12)", "PHYSICS\n# 9.4"])
def test_a_citation_of_nothing_is_noticed(text):
    assert missing(text)


LINK = re.compile(r"\]\((?!https?:|mailto:|#)([^)#\s]+)")


def test_links_between_documents_lead_to_files():
    pages = [*sorted((ROOT / "docs").glob("*.md")), *sorted(ROOT.glob("*.md"))]
    lost = [
        f"{page.name}: {target}"
        for page in pages
        for target in LINK.findall(page.read_text(encoding="utf-8"))
        if not (page.parent / target).exists()
    ]
    assert not lost
