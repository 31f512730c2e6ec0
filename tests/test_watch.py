"""A folder in which recordings arrive: what grows, what is complete, what waits."""

import signal
import subprocess
import sys
import time

import pandas as pd
import pytest

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.processes import executor
from mtpipe.ground.steps import side_by_side
from mtpipe.pipeline import watch as watch_module
from mtpipe.pipeline.batch import Day
from mtpipe.pipeline.growing import load_growing
from mtpipe.pipeline.watch import _Arrivals
from mtpipe.report.run_folder import told
from tests.simulated import recording
from tests.test_batch import Silent, rows
from tests.test_pipeline import command, write

pytestmark = pytest.mark.slow

FRAMES = 1024


class Told(Silent):
    def calibrated(self, name, plateaus, *, complete):
        self.said.append((name, plateaus, complete))

    def at(self, what):
        if "waits" in what:
            self.said.append(what)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Lines of a recording of three plateaus, and its setup."""
    path = write(tmp_path_factory.mktemp("whole"), recording((1.0, 2.0, 4.0), FRAMES))
    return path.read_bytes().splitlines(keepends=True), path.with_name("setup.toml").read_bytes()


@pytest.fixture
def folder(tmp_path, whole):
    (tmp_path / "day").mkdir()
    (tmp_path / "day" / "setup.toml").write_bytes(whole[1])
    return tmp_path / "day"


def grown(folder, lines, rows_, *, half=b""):
    """The recording's header and so many rows, and the half of another."""
    path = folder / "r.csv"
    path.write_bytes(b"".join(lines[: 1 + rows_]) + half)
    return path


def test_what_grows_is_taken_up_to_its_last_plateau_that_has_ended(folder, whole):
    lines, setup = whole[0], folder / "setup.toml"
    for some in (1, 10, FRAMES, FRAMES + 1):
        with pytest.raises(RecordingError):
            load_growing(grown(folder, lines, some), setup)
    first = load_growing(grown(folder, lines, FRAMES + 2), setup)
    assert len(first.plateaus) == 1
    assert len(first.time_s) == FRAMES
    # whenever it is looked at, and wherever its last row is cut off
    for some in (FRAMES + 40, 2 * FRAMES - 1, 2 * FRAMES):
        for length in range(1, len(lines[1 + some]), 7):
            path = grown(folder, lines, some, half=lines[1 + some][:length])
            again = load_growing(path, setup)
            assert [one.stop for one in again.plateaus] == [FRAMES]
            assert (again.positions_nm["b1"] == first.positions_nm["b1"]).all()
    assert [notice.code for notice in again.notices].count("being_recorded") == 1
    # a magnet position that lost its end is no move of the magnets
    cut = load_growing(grown(folder, lines, 2 * FRAMES + 5, half=b"17.1,"), setup)
    assert [one.stop for one in cut.plateaus] == [FRAMES, 2 * FRAMES]


def test_forces_come_plateau_by_plateau_and_a_batch_would_go_on(folder, tmp_path, whole):
    lines, tell, out = whole[0], Told(), tmp_path / "out"
    arrivals = _Arrivals(folder, Day(out, [], [], 0, tell), tell, 3600.0)

    def round_():
        tell.said.clear()
        arrivals.look()
        with executor(1) as pool:
            for one, result in side_by_side(arrivals.works(pool, 1), 2):
                arrivals.ended(one, result)
        return [said for said in tell.said if said[0] != "recordings calibrated"]

    (folder / "r.csv").touch()
    assert round_() == []
    assert arrivals.idle_for(1e9) < 0  # an empty file is not called none while it may grow
    grown(folder, lines, FRAMES - 100)
    assert round_() == ["r.csv waits: r.csv: no plateau has ended yet"]
    grown(folder, lines, FRAMES + 100, half=b"12,")
    assert round_() == [("r.csv", 1, False)]
    assert set(rows(out).status) == {"being recorded"}
    assert "still being written" in rows(out).reasons[0]
    first = pd.read_csv(out / "r.csv" / "forces.csv")
    assert set(first.plateau) == {0}
    grown(folder, lines, FRAMES + 200)
    assert round_() == []  # no other plateau has ended
    grown(folder, lines, 3 * FRAMES)
    assert round_() == [("r.csv", 2, False)]
    assert set(pd.read_csv(out / "r.csv" / "forces.csv").plateau) == {0, 1}
    assert arrivals.idle_for(1e9) < 0
    arrivals.settled_s = 0.0
    assert round_() == [("r.csv", 3, True)]
    assert set(rows(out).status) == {"cross-check to come"}
    assert arrivals.idle_for(1e9) > 0
    before = told(out / "r.csv")
    day = Day(out, arrivals.day.there, [], 0, tell)  # of a batch that comes later
    assert list(day.calibrations(None, 1)) == []
    assert told(out / "r.csv") == before


def test_a_file_that_stays_wrong_is_said_once_it_is_complete(folder, tmp_path):
    (folder / "r.csv").write_text("time_s,b1_x_nm\n0,1\n")
    tell = Told()
    arrivals = _Arrivals(folder, Day(tmp_path / "out", [], [], 0, tell), tell, 3600.0)
    for settled_s in (3600.0, 0.0):
        arrivals.settled_s = settled_s
        arrivals.look()
        with executor(1) as pool:
            for one, result in side_by_side(arrivals.works(pool, 1), 2):
                arrivals.ended(one, result)
    assert "waits" in tell.said[0]
    assert [why for name, why in tell.said[1:2] if name == "r.csv" and "has one row" in why]
    assert list(rows(tmp_path / "out").status) == ["failed"]


def test_the_command_ends_when_nothing_comes_any_more(folder, tmp_path, whole):
    grown(folder, whole[0], 3 * FRAMES)
    out = tmp_path / "out"
    asked = ("--out", out, "--workers", "1", "--settled", "0.01", "--idle", "0")
    done = command("watch", folder, *asked)
    assert done.returncode == 0, done.stderr
    assert "r.csv: 3 plateaus calibrated, complete" in done.stderr
    assert done.stdout.splitlines()[-1] == f"Summary: {out / 'index.html'}"
    assert command("watch", folder, "--out", folder).returncode == 1
    assert watch_module.EVERY_S <= watch_module.SETTLED_S


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT is sent otherwise there")
def test_ctrl_c_ends_it_in_one_line(folder, tmp_path):
    out = tmp_path / "out"
    asked = [sys.executable, "-m", "mtpipe", "watch", str(folder), "--out", str(out)]
    watching = subprocess.Popen([*asked, "--workers", "1"], stderr=subprocess.PIPE, text=True)
    while watching.poll() is None and not out.exists():
        time.sleep(0.1)
    watching.send_signal(signal.SIGINT)
    _, said = watching.communicate()
    assert watching.returncode == 128 + signal.SIGINT
    assert said.splitlines() == ["mtpipe: stopped by Ctrl-C"]
