"""The site: every page in the toctree, every link to a file that is there, code that runs."""

import ast
import re
import tomllib
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from docs import make_gallery
from mtpipe.ground.version import VERSION
from mtpipe.pipeline.verdict import Verdict
from mtpipe.report.contents import Verdict as Mismatch

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = {path.relative_to(DOCS).with_suffix("").as_posix(): path for path in DOCS.rglob("*.md")}
# Pages beside the site's, whose links GitHub shows.
FRONT = {name: ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "VISION", "CHANGELOG")}
LINK = re.compile(r"\]\((?!https?:|mailto:)([^)\s#]*)(#[^)\s]*)?\)")
TOCTREE = re.compile(r"```\{toctree\}\n(.*?)```", re.S)
INCLUDE = re.compile(r'```\{include\} (\S+)\n:start-after: "(.+)"\n:end-before: "(.+)"\n```')
CELL = re.compile(r"```\{code-cell\}\n(.*?)```", re.S)
FORMULA = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+)\$", re.S)
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]\d+)?")


def text_of(path):
    return path.read_text(encoding="utf-8")


def anchors_of(path):
    """Headings as GitHub and MyST name them."""
    without_code = re.sub(r"^```.*?^```", "", text_of(path), flags=re.S | re.M)
    headings = re.findall(r"^#+ (.+)$", without_code, re.M)
    return {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}


@pytest.mark.parametrize("page", [*PAGES, *FRONT])
def test_links_lead_somewhere(page):
    path = (PAGES | FRONT)[page]
    for target, anchor in LINK.findall(text_of(path)):
        there = (path.parent / target).resolve() if target else path
        assert there.exists(), f"{page}: {target}"
        if anchor and there.suffix == ".md":
            assert anchor[1:] in anchors_of(there), f"{page}: {target}{anchor}"


def test_every_page_is_in_a_toctree_once():
    entries = []
    for page, path in PAGES.items():
        for body in TOCTREE.findall(text_of(path)):
            names = [line for line in body.splitlines() if line and not line.startswith(":")]
            entries += [(Path(page).parent / name).as_posix() for name in names]
    assert sorted([*entries, "index"]) == sorted(PAGES)


def test_tables_that_pages_share_are_there():
    shared = [(path, *found) for path in PAGES.values() for found in INCLUDE.findall(text_of(path))]
    assert len(shared) >= 6
    for path, source, begin, end in shared:
        part = text_of(path.parent / source).partition(begin)[2].partition(end)
        assert part[1], f"{path.name}: {source} has no {begin} … {end}"
        assert len(part[0].split()) > 10


def test_verdicts_are_defined_on_one_page():
    """Words that were explained on five pages were explained in five ways."""
    defining = re.compile(
        r"^\| `?(?:verdict|mismatch|result)`? \| (?:meaning|what it means) \|$", re.M
    )
    pages = [page for page, path in (PAGES | FRONT).items() if defining.search(text_of(path))]
    assert pages == ["verdicts"]
    defined = re.findall(r"^\| `(\w+)` \| ", text_of(PAGES["verdicts"]), re.M)
    bead, compared = (
        defined[1 : defined.index("mismatch")],
        defined[defined.index("mismatch") + 1 :],
    )
    assert sorted(bead) == sorted(get_args(Verdict))
    assert sorted(compared) == sorted(get_args(Mismatch))


def test_the_gallery_is_up_to_date():
    """`python -m docs.make_gallery` writes it."""
    assert text_of(make_gallery.PAGE) == make_gallery.page()
    pictures = {path.stem for path in make_gallery.PICTURES.iterdir()}
    assert pictures == set(make_gallery.entries())
    for name in ("exposure", "vibration", "contour_length"):
        drawn = make_gallery.svg(make_gallery.panel_of(make_gallery.entries()[name]))
        kept = text_of(make_gallery.PICTURES / f"{name}.svg")
        assert NUMBER.sub("", drawn) == NUMBER.sub("", kept)
        # another processor's last digits move a point by less than a pixel
        numbers = [[float(each) for each in NUMBER.findall(one)] for one in (drawn, kept)]
        np.testing.assert_allclose(*numbers, atol=0.5)


def test_formulas_stand_as_the_site_can_show_them():
    """A command that is unknown is left in the page as it is written, and stops the site."""
    convert = pytest.importorskip("latex2mathml.converter").convert
    assert "\\" in convert(r"\unheard x")
    for path in PAGES.values():
        for shown, inline in FORMULA.findall(text_of(path)):
            assert "\\" not in convert((shown or inline).strip()), shown or inline


def test_formulas_lead_to_the_line_of_the_function_that_holds_them():
    """On the site, which has a page for each file of the package."""
    pytest.importorskip("latex2mathml")
    from docs import conf

    source = ["in [`mtpipe.physics.camera.Camera.nyquist_hz`](../mtpipe/physics/camera.py) it is"]
    conf.links_to_the_repository(None, "physics", source)
    (line,) = re.findall(r'href="code/mtpipe\.physics\.camera\.html#line-(\d+)"', source[0])
    code = text_of(ROOT / "mtpipe" / "physics" / "camera.py").splitlines()
    assert code[int(line) - 1].strip().startswith("def nyquist_hz")


NOTEBOOKS = [path.stem for path in (DOCS / "notebooks").glob("*.md") if path.stem != "index"]


@pytest.mark.slow
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebooks_run(name, monkeypatch, tmp_path):
    """From any folder, as a copy of the cells would be."""
    monkeypatch.chdir(tmp_path)
    names = {}
    cells = CELL.findall(text_of(DOCS / "notebooks" / f"{name}.md"))
    for cell in cells:
        exec(compile(ast.parse(cell), name, "exec"), names)
    assert len(cells) >= 3
    if name == "concealed":
        assert names["bead"].verdict == "explained"


def test_the_citation_is_of_this_version():
    assert f"\nversion: {VERSION}\n" in text_of(ROOT / "CITATION.cff")
    project = tomllib.loads(text_of(ROOT / "pyproject.toml"))["project"]
    assert f"license: {project['license']}" in text_of(ROOT / "CITATION.cff")
