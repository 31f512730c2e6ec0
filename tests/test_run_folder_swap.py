"""One folder is one run, whenever a process is killed: every moment of a change is tried."""

import os
import signal
import sys
from pathlib import Path

import pytest

from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.files import clear_leftovers, scratch_name
from mtpipe.report.run_folder import (
    RECORDING,
    RESULTS,
    RUN,
    finish,
    journal,
    new_run,
    refuse_to_erase,
)

FILES = (*RESULTS[:6], "details/a.parquet", "details/b.json", "report/index.html", RUN)
AT = ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir")
forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")


def write(out, told):
    """A run whose files all say the same."""
    with new_run(out) as fresh:
        for name in FILES:
            (fresh / name).parent.mkdir(exist_ok=True)
            (fresh / name).write_text(told)


def content(out):
    """What the files say that are not hidden."""
    return {
        path.relative_to(out).as_posix(): path.read_text()
        for path in out.rglob("*")
        if path.is_file() and not any(part.startswith(".mtpipe") for part in path.parts)
    }


def killed_at(moment, out):
    """Whether a process that writes a new run is killed at the k-th thing that it does in `out`."""
    child = os.fork()
    if child == 0:
        done = 0

        def count(event, arguments):
            nonlocal done
            if event in AT and isinstance(arguments[0], (str, os.PathLike)):
                done += str(arguments[0]).startswith(str(out))
                if done > moment:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        write(out, "new")
        os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


@pytest.mark.slow
@forks
def test_killed_at_any_moment_nothing_is_mixed_and_what_was_begun_is_finished(tmp_path):
    moment = 0
    ends = set()
    while True:
        out = tmp_path / str(moment)
        write(out, "old")
        (out / "recording.csv").write_text("old")  # may be the user's own, and stays
        if not killed_at(moment, out):
            break
        found = content(out)
        del found["recording.csv"]
        assert len(set(found.values())) <= 1, (moment, found)
        if RUN in found:
            assert set(found) == set(FILES), moment
        finish(out)
        after = content(out)
        assert after.pop("recording.csv") == "old"
        assert set(after) == set(FILES)
        (told,) = set(after.values())
        ends.add(told)
        write(out, "again")
        assert set(content(out).values()) == {"again", "old"}
        assert not [p for p in out.iterdir() if p.name.startswith(".")]
        moment += 1
    assert moment > 2 * len(FILES)
    assert ends == {"old", "new"}
    assert set(content(out).values()) == {"new", "old"}


def test_an_error_leaves_the_earlier_run_as_it_was(tmp_path):
    write(tmp_path, "old")

    def fail():
        with new_run(tmp_path) as fresh:
            (fresh / RUN).write_text("new")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert set(content(tmp_path).values()) == {"old"}
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]


@pytest.mark.parametrize("earlier", [False, True])
def test_a_film_that_was_tracked_is_not_lost_by_an_error_after_it(tmp_path, earlier):
    if earlier:
        write(tmp_path, "old")

    def fail():
        with journal(tmp_path, "content") as done:
            done.mkdir()
            (done / RECORDING).write_text("new")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert (tmp_path / RECORDING).exists() != earlier
    with journal(tmp_path, "content") as done:
        assert (done / RECORDING).exists()
    with journal(tmp_path, "other content"):
        assert not done.exists()


@forks
def test_what_killed_processes_left_is_cleared_and_what_others_fill_is_not(tmp_path):
    dead = os.fork()
    if dead == 0:
        os._exit(0)
    os.waitpid(dead, 0)
    kept = tmp_path / f".run-{os.getppid()}"
    for folder in (tmp_path / f".run-{dead}", tmp_path / scratch_name("run"), kept):
        folder.mkdir()
    others = [tmp_path / ".run-notes", tmp_path / f".runs.{dead}.rows", tmp_path / f"run-{dead}"]
    for file in (tmp_path / f".run.{dead}.rows.whole", tmp_path / f".run.{dead}.tmp", *others):
        file.touch()
    clear_leftovers(tmp_path, "run")
    assert set(tmp_path.iterdir()) == {kept, *others}


def test_a_cross_check_is_not_erased_in_silence(tmp_path):
    refuse_to_erase(tmp_path)
    for nothing in ("{", "[]", '{"beads": {}}'):
        (tmp_path / "mismatch.json").write_text(nothing)
        refuse_to_erase(tmp_path)
    (tmp_path / "mismatch.json").write_text('{"beads": {"b1": {}}}')
    with pytest.raises(MtpipeError, match=r"cross-check of an earlier run.*--overwrite"):
        refuse_to_erase(tmp_path)


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(MtpipeError, match="cannot be written"), new_run(Path(blocked) / "run"):
        pass
