"""The command line as people meet it: exit codes, files that cannot be written, Ctrl-C.

And an argument of a function that is told in a sentence too.
"""

import errno
import multiprocessing
import os
import signal
import sys
import time

import emcee
import numpy as np
import pandas as pd
import pytest

from mtpipe.cli.entry import main
from mtpipe.design import figure, guide, show
from mtpipe.fit.trace import fit_trace
from mtpipe.ground.errors import MtpipeError, writing
from mtpipe.pipeline import run as pipeline
from tests.ingest_recordings import canonical_lines, motion, write
from tests.stack_images import setup_text


@pytest.fixture
def called(tmp_path, monkeypatch, capsys):
    """Call `mtpipe ...` beside a setup, a recording and an image; exit code and what it said."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    (tmp_path / "setup.toml").write_text(setup_text())
    (tmp_path / "alone").mkdir()
    for name in ("recording.csv", "alone/recording.csv"):
        write(tmp_path / name, canonical_lines(motion(200)))
    (tmp_path / "film.tif").write_bytes(b"II*\x00")
    (tmp_path / "z.csv").write_text("z_nm\n0\n1\n")

    def call(line):
        monkeypatch.setattr(sys, "argv", ["mtpipe", *line.split()])
        with pytest.raises(SystemExit) as stopped:
            main()
        out, err = capsys.readouterr()
        return stopped.value.code, out, err

    return call


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("run nope.csv --out o", "'nope.csv' does not exist"),
        ("run film_*.tif --out o", "no file has a name of the pattern 'film_*.tif'"),
        ("run recording.csv --out o --setup alone", "'alone' is a directory"),
        ("run alone/recording.csv --out o", "alone/setup.toml: there is no such setup file"),
        ("track nope.tif --out t.csv", "'nope.tif' does not exist"),
        ("track film.tif --out t.xyz", ".csv, .csv.gz or .parquet"),
        ("lut nope.tif --z z.csv --out l.npz", "'nope.tif' does not exist"),
        ("lut film.tif --z z.csv --out l.npy", "--out: a name that ends in .npz is needed"),
        ("lut film.tif --z z.csv --out l.npz --region 9,9,9", "at least 16 whole pixels"),
        ("design setup.toml --error -1", "--error: a share between 0 and 1"),
        ("design setup.toml --duration -1", "--duration: a time in s above 0 is needed, got -1"),
        ("design setup.toml --reach nan", "--reach: a force in pN above 0 is needed, got nan"),
        ("design setup.toml --figure x.jpg", "--figure: a name that ends in .html or .png"),
        (
            "simulate setup.toml --out o --force 1e9",
            "forces above 0 pN are needed, and none above 1000 pN",
        ),
        ("simulate setup.toml --out o --force 1,x", "'1,x': numbers are needed"),
    ],
)
def test_a_wrong_call_has_exit_code_2(called, line, said):
    code, _, err = called(line)
    assert code == 2
    assert said in err
    assert "defect" not in err


def test_data_that_cannot_be_processed_have_exit_code_1(called):
    code, _, err = called("run film.tif --out o")
    assert (code, "film.tif" in err, "defect" in err) == (1, True, False)


@pytest.mark.parametrize(("option", "name"), [("--csv", "no/a.csv"), ("--figure", "no/a.html"),
                                              ("--csv", "/dev/full")])  # fmt: skip
def test_a_design_that_cannot_be_written_says_so(called, monkeypatch, option, name):
    if name == "/dev/full" and not os.path.exists(name):
        pytest.skip("there is no /dev/full here")
    monkeypatch.setattr(guide, "measurable_forces", lambda *_, **__: None)
    monkeypatch.setattr(show, "print_design", lambda _: None)
    monkeypatch.setattr(show, "design_frame", lambda _: pd.DataFrame({"a": [1.0]}))
    monkeypatch.setattr(figure, "design_figure", lambda _: {"data": [], "layout": {}})
    code, _, err = called(f"design setup.toml {option} {name}")
    assert code == 1
    assert err.startswith(f"mtpipe: {name}: cannot be written (No ")
    assert err.endswith(f"choose another {option}.\n")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.EFBIG, "File too large"), "o: cannot be written (File too large). Make"),
        (OSError(errno.EIO, "Broken", "o/forces.csv"), "o: cannot be written (Broken). Make"),
        (OSError(errno.EIO, "Broken", "recording.csv"), "recording.csv: cannot be read or wri"),
        (PermissionError(errno.EACCES, "Denied", "r.csv"), "r.csv: no access (Denied)"),
        (OSError("of a library"), "a defect of mtpipe itself: OSError: of a library"),
    ],
)
def test_what_the_system_refuses_in_a_run_is_told(called, monkeypatch, error, said):
    def run(*_, **__):
        raise error

    monkeypatch.setattr(pipeline, "run", run)
    code, _, err = called("run recording.csv --out o")
    assert code == 1
    assert err.startswith(f"mtpipe: {said}")


def test_only_what_belongs_to_a_place_is_blamed_on_writing_it(tmp_path):
    place = tmp_path / "a.csv"
    with pytest.raises(MtpipeError, match=r"a\.csv: cannot be written \(Broken\)"), writing(place):
        raise OSError(errno.EIO, "Broken", str(tmp_path / ".a.csv.17.tmp"))
    with pytest.raises(FileNotFoundError), writing(place):
        (tmp_path / "b.csv").read_bytes()


def test_ctrl_c_within_a_posterior_ends_in_one_line(called, monkeypatch):
    workers = []

    def log_probability(_):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(5)
        return 0.0

    def run(*_, **__):
        worker = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60,))
        worker.start()
        workers.append(worker)
        emcee.EnsembleSampler(4, 1, log_probability).run_mcmc(np.arange(4.0)[:, None], 10)

    monkeypatch.setattr(pipeline, "run", run)
    before = signal.getsignal(signal.SIGINT)
    code, out, err = called("run recording.csv --out o")
    assert (code, out, err) == (130, "", "mtpipe: stopped by Ctrl-C\n")
    assert signal.getsignal(signal.SIGINT) is before
    workers[0].join(10)
    assert workers[0].exitcode == -signal.SIGTERM


@pytest.mark.parametrize("friction", [2.3e-5, (2.3e-5,), (2.3e-5, 0.0), ("a", "b"), "known"])
def test_a_friction_without_its_error_is_told_in_a_sentence(friction):
    x = np.random.default_rng(0).normal(size=500)
    with pytest.raises(ValueError, match="friction is a positive value and its standard error"):
        fit_trace(x, frame_rate_hz=100.0, exposure_s=0.01, temperature_K=298.0, friction=friction)
