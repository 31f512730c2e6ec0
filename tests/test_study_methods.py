"""The study of every method: its functions on two traces, the form of its tables, its page."""

import importlib
import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mtpipe.methods import METHODS

CHECKOUT = Path(__file__).parents[1]
STUDY = CHECKOUT / "workflows" / "validation"
PAGE = CHECKOUT / "docs" / "methods.md"


@pytest.fixture(scope="module")
def study():
    """name → module of the study."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(STUDY))
        yield importlib.import_module


@pytest.fixture(scope="module")
def cases(study):
    case = study("traces").Case
    return [
        case("free", 0.4),
        case("free", 0.4, exposure=0.5),
        case("noisy", 0.5, noise_nm=5.0, friction_known=0.03),
    ]


@pytest.fixture(scope="module")
def rows(study, cases):
    run = lambda what, jobs: [what(job) for job in jobs]  # noqa: E731
    return pd.DataFrame(study("methods").own_rows(run, cases, seed=1, repeats=2))


def cells(block):
    """Header and lines of a Markdown table."""
    header, rule, *lines = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()
    ]
    assert set(rule) == {"---"}
    assert all(len(line) == len(header) for line in [rule, *lines])
    return header, lines


def test_every_method_is_asked_about_every_trace(rows, study, cases):
    tables = study("method_tables")
    methods = [tables.LIKELIHOOD, tables.POSTERIOR, *METHODS]
    assert len(set(methods)) == len(methods)
    assert list(rows.method) == methods * (2 * len(cases))
    assert (rows.cpu_s > 0).all()


def test_errors_are_of_the_size_of_the_bound(rows, study):
    """A bound of 1 to 2 %: what is off by 5 times that is compared with the wrong truth."""
    tables = study("method_tables")
    own = rows[rows.method.isin([tables.LIKELIHOOD, tables.POSTERIOR])]
    assert own.k_bound.between(0.005, 0.03).all()
    assert (own.k_error.abs() < 5 * own.k_bound).all()
    assert (own.friction_error.abs() < 5 * own.friction_bound).all()


def test_tables_have_a_row_for_every_method(rows, study, cases):
    tables = study("method_tables")
    methods = [tables.LIKELIHOOD, tables.POSTERIOR, *METHODS]
    for name, block in tables.blocks(cases, rows).items():
        header, lines = cells(block)
        assert [line[0] for line in lines if line[0] != "bound"] == methods
        if name not in ("summary", "time"):
            corner = "0.5" if name.startswith("noisy") else "0.4"
            assert header == ["corner / Nyquist", corner]


def test_what_gives_no_result_is_counted_and_not_averaged(rows, study, cases):
    """tweezepy's kinds of answer, made up: a good one, a negative one, one without an interval."""
    tables, methods = study("method_tables"), study("methods")
    case, bound = cases[0], np.array([0.01, 0.02])
    k, friction = case.stiffness_pN_per_nm, math.exp(case.truth[1])
    good, negative, bare = (
        methods._row(case, bound, "peer", stiffness, (friction, 0.9 * friction, 0.95 * friction), 1)
        for stiffness in (
            (1.01 * k, 0.99 * k, 1.02 * k),
            (-k, -1.1 * k, -0.9 * k),
            (0.99 * k, math.nan, math.nan),
        )
    )
    answers = pd.DataFrame([good, negative, bare])
    assert tables.missing(answers) == "33.3"
    assert tables.over_bound(answers) == "1.00"
    assert tables.coverage(answers) == "100.0, 0.0"
    assert tables.within_ten_percent(answers) == "66.7"


def test_variants_stand_where_they_belong(rows, study, cases):
    """A default start is judged by how often it fails, a sampler by its time alone."""
    tables = study("method_tables")
    more = [rows[rows.method == tables.LIKELIHOOD].assign(method=name)
            for name in ("peer", "peer, default start", "peer, MCMC")]  # fmt: skip
    blocks = tables.blocks(cases, pd.concat([rows, *more]))
    in_table = {name: [line[0] for line in cells(blocks[name])[1]] for name in blocks}
    assert in_table["rms whole"][-1] == "peer"
    assert in_table["missing whole"][-2:] == ["peer", "peer, default start"]
    assert in_table["time"][-1] == "peer, MCMC"


def test_page_has_a_place_for_every_table(rows, study, cases):
    blocks = study("method_tables").blocks(cases, rows) | {"run": "printed"}
    page = PAGE.read_text(encoding="utf-8")
    assert set(re.findall(r"<!-- study: (.*) -->", page)) == set(blocks)
    written = study("pages").into_page(page, blocks)
    assert all(block in written for block in blocks.values())


def test_page_is_filled_by_the_command():
    page = PAGE.read_text(encoding="utf-8")
    places = re.findall(r"<!-- study: ([\w ]+) -->\n(.*?)<!-- end -->", page, re.DOTALL)
    assert len(places) == page.count("<!-- study:")
    assert all(content.strip() for _, content in places)
    assert "python workflows/validation/methods.py --repeats" in dict(places)["run"]
    assert "tweezepy spectrum" in dict(places)["summary"]
