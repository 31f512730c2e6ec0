"""A folder of recordings at once: which there are, what is kept, what the summary says."""

import json
from concurrent.futures import Future

import numpy as np
import pandas as pd
import pytest

from mtpipe.diagnosis import mismatch
from mtpipe.ground import journal as journal_module
from mtpipe.ground.errors import FitError, MtpipeError
from mtpipe.ground.files import write_atomically
from mtpipe.ground.journal import Kept
from mtpipe.ground.processes import executor
from mtpipe.ground.steps import side_by_side
from mtpipe.ingest.kinds import is_prose
from mtpipe.pipeline import batch as batch_module
from mtpipe.pipeline.batch import batch
from mtpipe.pipeline.identity import Asked, identity
from mtpipe.pipeline.recordings_below import recordings_below
from mtpipe.report.run_folder import told
from tests.simulated import bead_nm, recording
from tests.test_pipeline import command, write

pytestmark = pytest.mark.slow

SERIES = '[source]\nfiles = ["trace*.csv"]\n'


class Silent:
    """Nobody watches; what was said is kept."""

    def __init__(self):
        self.said = []

    def aside(self, files):
        self.said += files

    def at(self, what):
        pass

    def counted(self, what, done, total, left_s):
        self.said.append((what, done, total))

    def failed(self, name, why):
        self.said.append((name, why))


@pytest.fixture(scope="module")
def day(tmp_path_factory):
    """Two recordings of two beads and of one, which share a setup, and a file that is damaged."""
    folder = tmp_path_factory.mktemp("day")
    random = np.random.default_rng(1)
    beads = {name: bead_nm(2.0, 1024, random) for name in ("b1", "b2")}
    for name, some in (("r1", beads), ("r2", {"b1": bead_nm(4.0, 1024, random)})):
        path = write(folder, recording((2.0,), 1024, beads=some))
        (folder / "morning").mkdir(exist_ok=True)
        path.rename(folder / "morning" / f"{name}.csv")
    (folder / "bad.csv").write_text("time_s,b1_x_nm\n0,1\n")
    (folder / "notes.md").write_text("of the day")
    return folder


def rows(out):
    return pd.read_csv(out / "summary.csv", keep_default_na=False)


def test_recordings_are_files_with_a_setup_beside_or_above_them(tmp_path):
    for name in ("a/setup.toml", "a/r1.csv", "a/r2.csv", "a/deep/r3.txt", "r4.csv", "a/old/f.csv"):
        write_atomically(tmp_path / name, "schema = 1\n" if name.endswith("toml") else "1 2\n")
    write_atomically(tmp_path / "a/r5.csv", b"\x89PNG and so on")
    write_atomically(tmp_path / "a/notes.txt", "9:30 bead 3 at 2.5 mm\nbetter, 3 times\n")
    write_atomically(tmp_path / "a/old/run.json", "{}")
    write_atomically(tmp_path / "out/r6.csv", "1")
    found, aside = recordings_below(tmp_path, tmp_path / "out")
    assert [one.name for one in found] == ["a/r1.csv", "a/r2.csv", "a/deep/r3.txt"]
    assert {one.setup for one in found} == {tmp_path / "a" / "setup.toml"}
    why = {one.name: one.why for one in aside}
    assert set(why) == {"r4.csv", "a/r5.csv", "a/old", "a/notes.txt"}
    assert "no row of numbers" in why["a/notes.txt"]
    assert "no setup.toml beside it or in a folder above" in why["r4.csv"]
    assert "is an image" in why["a/r5.csv"]
    assert "run of mtpipe" in why["a/old"]


@pytest.mark.parametrize(
    ("text", "prose"),
    [
        ("0.1\t2\tnan\n", False), ("time_s,b1_x_nm\n", False), ("1;2,5;3\n", False),
        ("# of today\n1\n", False), ("x" * 70_000, False), ("Monday\n\nof 3 beads\n", True),
        ("a,b,c\n", True),
    ],
)  # fmt: skip
def test_only_a_short_text_without_numbers_is_plainly_no_recording(tmp_path, text, prose):
    write_atomically(tmp_path / "r.txt", text)
    assert is_prose(tmp_path / "r.txt") == prose


def setup_text(folder):
    return (folder / "setup.toml").read_text()


def test_a_setup_that_names_files_makes_one_recording_of_them(tmp_path, day):
    write_atomically(tmp_path / "setup.toml", setup_text(day) + "\n" + SERIES)
    for name in ("x/trace1.csv", "x/trace2.csv", "x/log.csv", "y/trace1.csv", "z/other.csv"):
        write_atomically(tmp_path / name, "1")
    found, aside = recordings_below(tmp_path, tmp_path / "out")
    assert [one.name for one in found] == ["x", "y"]
    assert {one.name for one in aside} == {"x/log.csv", "z/other.csv"}
    assert all("does not name it" in one.why for one in aside)


def test_the_magnets_log_is_no_recording(tmp_path, day):
    source = """
[source]
time = { column = 1, unit = "s" }
units = { position = "nm" }
beads = { first_column = 2, order = "xyz" }
magnet = { file = "{name}_motors.txt", row_by_row = true, column = 1 }
"""
    write_atomically(tmp_path / "setup.toml", setup_text(day) + source)
    for name in ("r1.txt", "r1_motors.txt", "r2.txt", "r2_motors.txt"):
        write_atomically(tmp_path / name, "1")
    found, aside = recordings_below(tmp_path, tmp_path / "out")
    assert [one.name for one in found] == ["r1.txt", "r2.txt"]
    assert aside == []


def test_content_and_nothing_else_is_the_identity(tmp_path, day):
    for name in ("setup.toml", "morning/r1.csv"):
        write_atomically(tmp_path / name, (day / name).read_bytes())

    def of(**asked):
        path, setup = tmp_path / "morning" / "r1.csv", tmp_path / "setup.toml"
        return identity(Asked(path, tmp_path / "out", setup, **asked))

    first = of()
    assert of() == first != of(seed=1)
    write_atomically(tmp_path / "setup.toml", setup_text(day) + "\n# a remark\n")
    assert of() == first
    write_atomically(tmp_path / "setup.toml", setup_text(day).replace("1200.0", "1201.0"))
    assert of() != first
    write_atomically(tmp_path / "setup.toml", setup_text(day))
    with (tmp_path / "morning" / "r1.csv").open("a") as stream:
        stream.write("\n")
    assert of() != first


def test_what_is_kept_is_not_done_again_and_errors_are_not_kept(tmp_path):
    done = []

    def half(n):
        done.append(n)
        return n / 2 if n else 1 / n

    def ask():
        with executor(1) as pool:
            kept = Kept(pool, tmp_path)
            assert kept.there(2) == len(list(tmp_path.iterdir()))
            return [kept.submit(half, n).result() for n in (4, 3, 0)]

    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            ask()
    assert done == [4, 3, 0, 0]


def test_works_go_side_by_side_and_a_failure_is_its_own():
    waiting = {name: Future() for name in "abc"}
    begun = []

    def work(name):
        begun.append(name)
        yield [waiting[name]]
        return waiting[name].result()

    found = side_by_side(((name, work(name)) for name in "abc"), 2)
    waiting["b"].set_result(2)
    assert next(found) == ("b", 2)
    assert begun == ["a", "b"]
    waiting["a"].set_exception(FitError("no"))
    waiting["c"].set_result(3)
    left = dict(found)
    assert left["c"] == 3
    assert isinstance(left["a"], FitError)


def failing(say):
    """In place of the cross-check: data that are refused, or a fault of the program."""

    def explained(recording, bead, random, *, with_curves):
        say(recording.name, bead)
        if bead == "b2":
            raise ZeroDivisionError("of the program")
        raise FitError("of the data")

    return explained


def test_forces_come_first_and_what_fails_stops_nothing(day, tmp_path, monkeypatch):
    seen, first, forces, to_come = [], [], [], []

    def say(name, bead):
        seen.append((name, bead))
        if len(seen) == 1:
            first.extend(rows(tmp_path).status)
        for one in ("r1.csv", "r2.csv"):
            out = tmp_path / "morning" / one
            forces.append(pd.read_csv(out / "forces.csv").force_pN.notna().any())
            forces.append((out / "report" / "index.html").exists())
            to_come.append("crosscheck_to_come" in (out / "run.json").read_text())

    monkeypatch.setattr(mismatch, "explained_bead", failing(say))
    watch = Silent()
    summary = batch(day, tmp_path, watch=watch)
    assert seen == [("r1.csv", "b1"), ("r1.csv", "b2"), ("r2.csv", "b1")]
    # no bead is looked at before all forces can be read
    assert first == ["failed", *["cross-check to come"] * 3]
    assert all(forces)
    assert to_come == [True, True, True, True, False, True]
    table = rows(tmp_path).set_index(["recording", "bead"])
    one, two = "morning/r1.csv", "morning/r2.csv"
    assert table.status.to_dict() == {
        ("bad.csv", ""): "failed",
        (one, "b1"): "not simulated",
        (one, "b2"): "failed",
        (two, "b1"): "not simulated",
    }
    assert "one row" in table.reasons["bad.csv", ""]
    assert "of the data" in table.reasons[one, "b1"]
    assert "a defect of mtpipe, ZeroDivisionError: of the program" in table.reasons[one, "b2"]
    assert len(summary.failed) == 2
    assert ("beads cross-checked", 3, 3) in watch.said
    assert (tmp_path / table.report[two, "b1"]).exists()
    # the same again is done already, but for what failed
    before = told(tmp_path / two)["run"]
    assert [path.parent.name for path in tmp_path.rglob(".mtpipe*")] == ["r1.csv"]
    batch(day, tmp_path, watch=Silent())
    assert seen[3:] == [("r1.csv", "b2")]
    assert told(tmp_path / two)["run"] == before
    assert list(rows(tmp_path).status) == list(table.status)


class StoppedError(BaseException):
    """Someone ended the batch."""


def test_a_batch_that_was_stopped_goes_on_where_it_was(day, tmp_path, monkeypatch):
    undisturbed = tmp_path / "whole"
    monkeypatch.setattr(mismatch, "explained_bead", failing(lambda *_: None))
    batch(day, undisturbed, watch=Silent())
    seen, calibrated = [], []
    calibrate = batch_module.running

    def running(*args, **named):
        calibrated.append(named["only_forces"])
        return calibrate(*args, **named)

    def stop(name, bead):
        seen.append((name, bead))
        if len(seen) == 2:
            raise StoppedError

    monkeypatch.setattr(batch_module, "running", running)
    monkeypatch.setattr(mismatch, "explained_bead", failing(stop))
    out = tmp_path / "stopped"
    with pytest.raises(StoppedError):
        batch(day, out, watch=Silent())
    assert calibrated == [True, True, True, False]
    works = []
    pack = journal_module.packed

    def counted(work, *args, **named):
        works.append(work.__name__)
        return pack(work, *args, **named)

    monkeypatch.setattr(journal_module, "packed", counted)
    batch(day, out, watch=Silent())
    # of the first recording the second bead is left, of the second recording all
    assert seen[1:] == [("r1.csv", "b2"), ("r1.csv", "b2"), ("r2.csv", "b1")]
    assert "calibrate_bead" not in works
    for name in ("morning/r1.csv", "morning/r2.csv"):
        for table in ("forces.csv", "beads.csv"):
            assert (out / name / table).read_bytes() == (undisturbed / name / table).read_bytes()
    assert (out / "summary.csv").read_bytes() == (undisturbed / "summary.csv").read_bytes()


def test_another_setup_makes_another_result_and_never_half_of_one(day, tmp_path, monkeypatch):
    folder, out = tmp_path / "day", tmp_path / "out"
    for name in ("setup.toml", "morning/r2.csv"):
        write_atomically(folder / name, (day / name).read_bytes())
    monkeypatch.setattr(mismatch, "explained_bead", failing(lambda *_: None))
    batch(folder, out, watch=Silent())
    before = told(out / "morning/r2.csv")
    other = setup_text(day).replace("viscosity_mPa_s = 0.9", "viscosity_mPa_s = 1.0")
    write_atomically(folder / "setup.toml", other)
    batch(folder, out, watch=Silent())
    after = told(out / "morning/r2.csv")
    assert after["content"] != before["content"]
    assert after["setup"]["buffer"]["viscosity_mPa_s"]["value"] == 1.0
    assert json.loads((out / "morning/r2.csv/mismatch.json").read_text())["run"] == after["run"]


def test_a_batch_without_recordings_is_told(tmp_path):
    with pytest.raises(MtpipeError, match="there is no recording"):
        batch(tmp_path, tmp_path / "out", watch=Silent())
    with pytest.raises(MtpipeError, match="folder of the recordings"):
        batch(tmp_path, tmp_path, watch=Silent())


def test_the_command_says_what_failed_and_how_it_went_on(tmp_path, day):
    for name in ("setup.toml", "bad.csv"):
        write_atomically(tmp_path / "day" / name, (day / name).read_bytes())
    write_atomically(tmp_path / "day/film.csv", b"\xff\xd8\xff and so on")
    done = command("batch", tmp_path / "day", "--out", tmp_path / "out", "--workers", "1")
    assert done.returncode == 1
    assert "left aside: film.csv (is an image" in done.stderr
    assert "bad.csv: bad.csv: has one row of numbers" in done.stderr
    assert "1 of 1 recordings calibrated" in done.stderr
    said = done.stdout.splitlines()
    assert said[-2].startswith("bad.csv failed: bad.csv: has one row")
    assert said[-1] == f"Summary: {tmp_path / 'out' / 'index.html'}"
    assert (tmp_path / "out" / "index.html").exists()
    both = ("--scheduler", "tcp://127.0.0.1:1", "--slurm")
    wrong = command("batch", tmp_path / "day", "--out", tmp_path / "out", *both)
    assert wrong.returncode == 2
    assert "not both" in wrong.stderr
