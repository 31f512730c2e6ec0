"""The site: `sphinx-build -W docs DIR` (CONTRIBUTING.md), pages in MyST, functions by autodoc."""

from __future__ import annotations

import re
from pathlib import Path

from docutils import nodes
from latex2mathml.converter import convert

from mtpipe.ground.version import VERSION

HERE = Path(__file__).parent
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


def without_links_to_the_repository(app, page, source):
    """A link that leaves docs/ works in the repository, but not on the site: its words stay."""
    folder = (HERE / page).parent

    def kept(link):
        target = (folder / link[2]).resolve()
        return link[0] if target.is_relative_to(HERE) else link[1]

    source[0] = _LINK.sub(kept, source[0])


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
    app.connect("source-read", without_links_to_the_repository)
