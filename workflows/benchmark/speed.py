"""This working tree against an older commit: CPU seconds of the same work, in one run, on one core.

    python workflows/benchmark/speed.py --base 52e64af --write docs/speed.md

The older commit is unpacked into a temporary folder. Each tree has a process of its own, and they
take turns with each recording, so that whatever else the machine does slows both alike. What is
compiled is compiled before the first measurement. CPU seconds, not the clock's, are compared.
Memory is the largest resident set of the process less what it was before, and less the recording's
arrays.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from worker_of_tree import CONSISTENT_FORCES_PN

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
CHALLENGE = ROOT.parent / "shared" / "challenge" / "cases"
BLOCK = "<!-- speed -->\n"
END = "<!-- end -->\n"
ONE_CORE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
FRAMES, PLATEAUS = 8192, 8
CONCEALED = ROOT / "sample_data" / "concealed" / "recordings"
WORKS = ("series", "field", "crosscheck", "diagnosis")


def main() -> None:
    """Time both trees and print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--base", default="52e64af", help="the older commit")
    parser.add_argument("--recordings", type=int, default=36, help="of the series, at most")
    parser.add_argument("--beads", type=int, default=40, help="simulated in one field of view")
    parser.add_argument("--works", nargs="+", choices=WORKS, default=WORKS)
    parser.add_argument("--write", type=Path, help="page to put the table into")
    options = parser.parse_args()
    with unpacked(options.base) as base, tree(base) as older, tree(ROOT) as newer:
        both = (older, newer)
        rows = [table_row(what, both, options) for what in options.works]
    lines = [
        f"Printed by `python workflows/benchmark/speed.py --base {options.base}"
        f" --recordings {options.recordings} --beads {options.beads}"
        f" --works {' '.join(options.works)}`, Python {platform.python_version()} on "
        f"{platform.machine()}.",
        "",
        f"| CPU seconds on one core | {options.base} | now | ratio | MiB beyond arrays |",
        "| --- | --- | --- | --- | --- |",
        *rows,
    ]
    text = "\n".join(lines) + "\n"
    print(text)
    if options.write is not None:
        page = options.write.read_text(encoding="utf-8")
        before, _, rest = page.partition(BLOCK)
        after = rest.partition(END)[2]
        options.write.write_text(f"{before}{BLOCK}{text}{END}{after}", encoding="utf-8")


def recordings(most: int) -> list[Path]:
    """Recordings of one bead: the challenge's if they are there, else the bundled ones."""
    found = sorted(CHALLENGE.glob("*/recording.csv.gz"))
    found = found or sorted((ROOT / "sample_data").glob("c*/recording.csv.gz"))
    return found[:most]


def compared(both: tuple[Any, Any], work: dict[str, Any]) -> tuple[dict[str, Any], ...]:
    """What each tree measures of one work."""
    answers = tuple(asked(process, work) for process in both)
    said = " → ".join(f"{answer['cpu_s']:.2f}" for answer in answers)
    print(work["what"], work.get("path", ""), said, "s", file=sys.stderr, flush=True)
    return answers


def table_row(what: str, both: tuple[Any, Any], options: argparse.Namespace) -> str:
    """A line of the table: the means of both trees, their ratio, and the most memory."""
    work: dict[str, Any] = {"what": what, "frames": FRAMES}
    if what == "series":
        paths = recordings(options.recordings)
        name = f"a bead's series, mean of {len(paths)} recordings"
        measured = [compared(both, work | {"path": str(path)}) for path in paths]
    elif what == "field":
        name = f"{options.beads} beads × {PLATEAUS} plateaus × {FRAMES} frames"
        measured = [compared(both, work | {"beads": options.beads, "plateaus": PLATEAUS})]
    elif what == "diagnosis":
        paths = sorted(CONCEALED.glob("*/recording.csv.gz"))
        name = f"a bead, diagnosed, mean of {len(paths)} recordings"
        measured = [compared(both, work | {"path": str(path)}) for path in paths]
    else:
        name = f"a consistent bead, cross-checked, {len(CONSISTENT_FORCES_PN)} × {FRAMES} frames"
        measured = [compared(both, work)]
    then, now = (sum(one[i]["cpu_s"] for one in measured) / len(measured) for i in range(2))
    memory = (max(one[i]["beyond_arrays_MiB"] for one in measured) for i in range(2))
    numbers = f"{then:.2f} | {now:.2f} | {then / now:.1f}"
    return f"| {name} | {numbers} | {', '.join(f'{one:.0f}' for one in memory)} |"


def asked(process: subprocess.Popen[str], work: dict[str, Any]) -> dict[str, Any]:
    """A worker's answer."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(json.dumps(work) + "\n")
    process.stdin.flush()
    answer = process.stdout.readline()
    if not answer:
        raise SystemExit(f"the worker of {work['what']} ended; what it said is above")
    found: dict[str, Any] = json.loads(answer)
    return found


@contextmanager
def tree(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that works with the mtpipe of a folder."""
    process = subprocess.Popen(
        [sys.executable, str(HERE / "worker_of_tree.py")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | ONE_CORE | {"PYTHONPATH": str(folder)},
        cwd=folder,
    )
    with process:
        yield process
        assert process.stdin is not None
        process.stdin.close()


@contextmanager
def unpacked(commit: str) -> Iterator[Path]:
    """A folder with the files of a commit; an existing folder is taken as it is."""
    given = Path(commit)
    with nullcontext(commit) if given.is_dir() else tempfile.TemporaryDirectory() as folder:
        if not given.is_dir():
            packed = subprocess.run(
                ["git", "archive", commit], cwd=ROOT, check=True, stdout=subprocess.PIPE
            )
            subprocess.run(["tar", "-x", "-C", folder], input=packed.stdout, check=True)
        yield Path(folder)


if __name__ == "__main__":
    main()
