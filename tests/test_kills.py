"""The study of killed runs: a few of its trials, and what it says of a folder that is wrong."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mtpipe.report.run_folder import RUN

CHECKOUT = Path(__file__).parents[1]
STUDY = CHECKOUT / "workflows" / "kills"
pytestmark = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="forks, and looks into /proc"
)


@pytest.mark.slow
def test_a_run_that_is_killed_or_has_no_room_leaves_a_whole_one():
    trials = ("--parts", "writes", "full", "--first", "20", "--each", "50")
    done = subprocess.run(
        [sys.executable, str(STUDY / "study.py"), *trials],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(CHECKOUT)},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    heading, _, *rows = done.stdout.partition("\n\n")[2].splitlines()
    columns = heading.split(" | ")
    for row in rows:
        trials, disturbed = (
            int(row.split(" | ")[columns.index(name)]) for name in ("trials", "disturbed")
        )
        assert trials == disturbed > 0
    assert len(rows) == 2


@pytest.fixture
def found(monkeypatch):
    monkeypatch.syspath_prepend(str(STUDY))
    from folders import found

    return found


NAMES = (RUN, "mismatch.json", "forces.csv")


def write(out, *names, run):
    out.mkdir(exist_ok=True)
    for name in names:
        text = f"force_pN\n{run}\n"
        if name.endswith(".json"):
            text = json.dumps({"run": run, "value": run})
        (out / name).write_text(text)


def test_the_study_tells_whole_from_torn_and_mixed(tmp_path, found):
    from folders import contents, leftovers

    runs = {}
    for run in ("old", "new"):
        write(tmp_path / run, *NAMES, run=run)
        runs[run] = contents(tmp_path / run)

    def seen(name, *writings):
        out = tmp_path / "trials" / name
        out.mkdir(parents=True)
        for names, options in writings:
            write(out, *names, **options)
        one = found(out, runs)
        return one.whole, one.torn, one.mixed

    later = {"run": "new"}
    assert seen("whole", (NAMES, later)) == ("new", False, False)
    assert seen("begun", (NAMES[1:], later)) == ("", False, False)
    assert seen("lacks", (NAMES[:2], later)) == ("", True, False)
    assert seen("half", (NAMES[:2], later), (NAMES[2:], {"run": "n"})) == ("", True, False)
    assert seen("mixed", (NAMES[:2], later), (NAMES[2:], {"run": "old"})) == ("", False, True)
    (tmp_path / "trials" / "half" / RUN).write_text('{"run": "ne')
    assert found(tmp_path / "trials" / "half", runs).torn
    left = {"begun", "lacks", "half", "mixed"}
    assert set(leftovers(tmp_path / "trials" / "whole")) == left
