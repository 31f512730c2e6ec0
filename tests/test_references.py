"""What code and documents cite of docs/physics.md and docs/formats.md stands there, and what
docs/physics.md names of the code is there.
"""

import importlib
import inspect
import re
from pathlib import Path

import numpy as np
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
    headings = re.findall(r"^#+ (E?\d+(?:\.[0-9A-C])?)", text, re.MULTILINE)
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


CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", sorted(set(re.findall(r"`([\w/]+\.py)`", CONTRIBUTING))))
def test_files_of_the_recipes_are_there(path):
    assert "NAME" in path or (ROOT / path).exists() or (ROOT / "mtpipe" / path).exists()


def test_what_the_recipes_call_by_name_is_in_the_code():
    code = "\n".join(path.read_text(encoding="utf-8") for path in CITING if path.suffix == ".py")
    named = set(re.findall(r"`(?:mtpipe\.)?(\w*[A-Z_]\w*)`", CONTRIBUTING)) - {"NAME"}
    assert len(named) > 20
    assert not named - set(re.findall(r"\w+", code))


PHYSICS = (ROOT / "docs" / "physics.md").read_text(encoding="utf-8")
# a link to the file, and in it the name of what holds the formula
HOLDER = re.compile(r"\[`(mtpipe(?:\.\w+)+)`\]\(\.\./(mtpipe/[\w/]+\.py)\)")
NUMBER = re.compile(r"-?\d+\.?\d*")
SAYS_WHERE = re.compile(r"^(In the code|Not in the code): ", re.MULTILINE)


def sections(text):
    """Parts of a page below each heading, by the heading."""
    parts = re.split(r"^(#+ .+)\n", text, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def without_code(text):
    """Headings of sections with a displayed formula, and of effects, that do not say where in the
    code that is."""
    return [
        heading
        for heading, body in sections(text).items()
        if ("$$" in body or re.match(r"#+ E\d", heading)) and not SAYS_WHERE.search(body)
    ]


def held(name):
    """What a name stands for: of a module, a class or an instance's field."""
    parts = name.split(".")
    for cut in range(len(parts) - 1, 1, -1):
        try:
            found = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        file = found.__file__
        for part in parts[cut:]:
            found = inspect.getattr_static(found, part)
        return found, file
    raise LookupError(name)


@pytest.mark.parametrize(("name", "file"), sorted(set(HOLDER.findall(PHYSICS))))
def test_formulas_are_held_by_what_is_named(name, file):
    found, home = held(name)
    assert found is not None
    assert not inspect.ismodule(found)
    assert Path(home) == ROOT / file


def test_every_formula_says_where_in_the_code_it_is():
    assert not without_code(PHYSICS)
    for line in PHYSICS.splitlines():
        if line.startswith("In the code: "):
            assert HOLDER.search(line), line


def test_the_table_of_biases_is_what_its_command_prints(monkeypatch):
    """Some of its rows: one mode, two, aliases."""
    folder = ROOT / "workflows" / "physics"
    monkeypatch.syspath_prepend(str(folder))
    biases = importlib.import_module("biases")
    names = [name for name in biases.EFFECTS if name.startswith(("y rotation", "x exposure"))]
    rows = biases.biases({name: biases.EFFECTS[name] for name in names}).splitlines()[2:6]
    for name, row in zip(names, rows, strict=True):
        (printed,) = [line for line in PHYSICS.splitlines() if line.startswith(f"| {name} |")]
        found, kept = (
            [float(n) for n in NUMBER.findall(one.replace("−", "-"))] for one in (row, printed)
        )
        np.testing.assert_allclose(found, kept, atol=0.11)


def test_the_tables_of_closed_forms_are_what_their_command_prints(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "workflows" / "physics"))
    blocks = importlib.import_module("closed_forms").blocks()
    assert set(blocks) == {"interpolation", "stretching", "aliases", "averages"}
    for name, block in blocks.items():
        assert f"<!-- study: {name} -->\n{block}\n<!-- end -->" in PHYSICS


def test_a_formula_without_code_is_noticed():
    page = "## 1. One\n\n$$\nx\n$$\n\n### E1 Two\n\nwords\n\n## 3. Three\n\nIn the code: it\n\n$$\n"
    assert without_code(page) == ["## 1. One", "### E1 Two"]
    with pytest.raises(AttributeError):
        held("mtpipe.physics.camera.gone")
