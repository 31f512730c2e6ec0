"""The report's words: the index and the opening of each bead's page read as the golden files.

    pytest tests/test_report_golden.py --update-golden

writes them again; read the difference before committing it.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from mtpipe.report import write_report
from tests.report_folder import write_run_folder
from tests.report_page import Page

GOLDEN = Path(__file__).parent / "golden"
# After this heading come tables of numbers, which other tests read.
END = "Tether and geometry"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(write_run_folder(tmp_path_factory.mktemp("run") / "run", good=2)).parent


@pytest.mark.parametrize(
    "name", ["index", "bead-b-id-x-b-1-2", "bead-b2", "bead-b10", "bead-more0", "bead-more1"]
)
def test_a_page_reads_as_its_golden_file(
    report: Path, name: str, request: pytest.FixtureRequest
) -> None:
    lines = Page(report / f"{name}.html").lines
    text = "\n".join(lines[: lines.index(END)] if END in lines else lines) + "\n"
    golden = GOLDEN / f"report-{name}.txt"
    if request.config.getoption("--update-golden"):
        golden.parent.mkdir(exist_ok=True)
        golden.write_text(text, encoding="utf-8")
    assert text == golden.read_text(encoding="utf-8")
