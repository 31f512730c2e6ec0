"""The site: `sphinx-build -W docs DIR` (CONTRIBUTING.md), pages in MyST, functions by autodoc."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from docutils import nodes
from latex2mathml.converter import convert

from mtpipe.ground.version import VERSION

HERE = Path(__file__).parent
PACKAGE = HERE.parent / "mtpipe"
project = "mtpipe"
author = "the mtpipe developers"
copyright = author  # noqa: A001 (Sphinx's own name)
version = release = VERSION

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]

# Pages link to headings of others as GitHub names them.
myst_heading_anchors = 4
# formulas: $x$ and $$ on lines of their own, as GitHub shows them; browsers show MathML without
# a script from elsewhere, so that the site can be read where there is no network
myst_enable_extensions = ["dollarmath"]
html_math_renderer = "mathml"
nb_execution_mode = "auto"
nb_execution_raise_on_error = True
# A cell takes seconds; CI and laboratories share their machines.
nb_execution_timeout = 600

autodoc_typehints = "none"
napoleon_use_ivar = True

html_theme = "pydata_sphinx_theme"
html_title = f"mtpipe {VERSION}"
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["formulas.css"]
# All pages stand in the sidebar, under the captions of docs/index.md.
html_sidebars = {"**": ["globaltoc.html"]}
html_theme_options = {"navbar_center": []}

_ATTRIBUTE = re.compile(r"(\w[\w, ]*) : (.+)")
# a function's name, which TeX would set apart from the letter that follows: cos x
_FUNCTION = re.compile(r"(<mi>[a-z]{2,}</mi>)(?=<mi>|<mfrac>)")
_LINK = re.compile(r"\[([^\]]+)\]\((\.\./[^)]+)\)")


def links_to_the_repository(app, page, source):
    """A link that leaves docs/ works in the repository, but not on the site.

    One to mtpipe's code leads to a page with it, at the line of what the link names; of others the
    words stay.
    """
    folder = (HERE / page).parent

    def kept(link):
        target = (folder / link[2]).resolve()
        if target.is_relative_to(HERE):
            return link[0]
        if target.suffix != ".py" or not target.is_relative_to(PACKAGE):
            return link[1]
        module = _module(target)
        names = link[1].strip("`").removeprefix(f"{module}.").split(".")
        up = "../" * page.count("/")
        url = f"{up}code/{module}.html#line-{_line_of(target, names)}"
        return f'<a href="{url}"><code>{link[1].strip("`")}</code></a>'

    source[0] = _LINK.sub(kept, source[0])


def pages_of_code(app):
    """A page for each file of the package."""
    if app.builder.format != "html":
        return
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        body = app.builder.highlighter.highlight_block(text, "python", lineanchors="line")
        name = _module(path)
        yield f"code/{name}", {"title": name, "body": f"<h1>{name}</h1>{body}"}, "page.html"


def _module(path):
    return ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)


def _line_of(path, names):
    """Where a name of a file is defined; of what is not found, where the class around it is."""
    line, body = 1, ast.parse(path.read_text(encoding="utf-8")).body
    for name in names:
        for node in body:
            targets = [*getattr(node, "targets", []), getattr(node, "target", None), node]
            if name in {getattr(one, "name", getattr(one, "id", None)) for one in targets}:
                line, body = node.lineno, getattr(node, "body", [])
                break
    return line


def as_napoleon_reads(app, what, name, obj, options, lines):
    """Docstrings here say `name : words`, and napoleon takes for a type what is behind a colon."""
    if what == "module":
        lines.clear()
    lines[:] = [part for line in lines for part in _parted(line)]


def _parted(line):
    found = _ATTRIBUTE.fullmatch(line)
    return (found[1], f"    {found[2]}") if found else (line,)


def mathml(translator, node):
    """A formula as MathML, made when the site is built."""
    display = "block" if isinstance(node, nodes.math_block) else "inline"
    formula = convert(node.astext(), display=display)
    if "\\" in formula:
        raise ValueError(f"MathML has no word for a command of {node.astext()!r}")
    formula = _FUNCTION.sub(r'\1<mspace width="0.17em"/>', formula)
    translator.body.append(f"<div>{formula}</div>" if display == "block" else formula)
    raise nodes.SkipNode


def setup(app):
    """Sphinx's hook."""
    app.add_html_math_renderer("mathml", (mathml, None), (mathml, None))
    app.connect("autodoc-process-docstring", as_napoleon_reads, priority=400)
    app.connect("source-read", links_to_the_repository)
    app.connect("html-collect-pages", pages_of_code)
