"""What the surroundings do to a run: streams, signals, killed processes, folders without room."""

import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from mtpipe.ground.errors import MtpipeError, unforeseen
from mtpipe.ground.processes import executor
from mtpipe.ground.script_guard import check_guard
from mtpipe.ground.spreadsheets import as_csv
from mtpipe.ground.streams import visible

pytestmark = pytest.mark.slow

posix = pytest.mark.skipif(os.name == "nt", reason="signals and descriptors as POSIX has them")
PRINTS = """
import sys
from mtpipe.ground.streams import open_streams, say
open_streams()
for _ in range(20_000):
    say("1.0 ± 0.1")
print("done", file=sys.stderr)
"""
WORKS = """
import os, sys, time
from mtpipe.cli.entry import main
from mtpipe.ground.processes import executor
from mtpipe.cli import commands

def busy(_):
    # one write: two workers' lines may not mix
    os.write(1, f"{os.getpid()}\\n".encode())
    time.sleep(60)

@commands.app.command()
def work():
    with executor(2) as pool:
        list(pool.map(busy, range(2)))

if __name__ == "__main__":
    main()
"""


def python(*arguments, **options):
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        check=False,
        **options,
    )


@pytest.mark.parametrize("encoding", ["ascii", "cp437", "koi8-r", "utf-8"])
def test_any_encoding_of_a_terminal_will_do(encoding):
    done = python("-c", PRINTS, env=os.environ | {"PYTHONIOENCODING": encoding})
    assert done.returncode == 0
    assert done.stdout.splitlines()[0].startswith(b"1.0 ")


@posix
@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&- <&-"])
def test_closed_streams_are_no_error(tmp_path, closed):
    script = tmp_path / "script.py"
    script.write_text(PRINTS + "open('made', 'w').write('whole')")
    done = subprocess.run(
        f"{sys.executable} {script} {closed}", shell=True, cwd=tmp_path, check=False
    )
    assert done.returncode == 0
    assert (tmp_path / "made").read_text() == "whole"


@posix
def test_a_reader_that_goes_away_is_no_error():
    with subprocess.Popen(
        [sys.executable, "-c", PRINTS], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b"done\n"
    assert process.returncode == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk_below_what_is_said_is_told_and_no_error():
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-c", PRINTS], stdout=full, stderr=subprocess.PIPE, check=False
        )
    assert done.returncode == 0
    assert done.stderr.splitlines()[0].startswith(b"mtpipe: what it says cannot be written")


def test_names_are_never_codes_of_a_terminal():
    assert visible("tether[/] \x1b[31m\x07 \u202eabc µ\n") == (
        "tether[/] \\x1b[31m\\x07 \\u202eabc µ\n"
    )


def is_alive(pid):
    """Whether a process runs; one that has ended and waits to be asked for does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state not in "ZX"


@pytest.fixture
def at_work(tmp_path):
    """A process with two workers, and their numbers."""
    script = tmp_path / "work.py"
    script.write_text(WORKS)
    with subprocess.Popen(
        [sys.executable, str(script), "work"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=_hear_signals,
    ) as process:
        workers = [int(process.stdout.readline()) for _ in range(2)]
        yield process, workers
        process.kill()


def _hear_signals():
    """Under nohup tests inherit an ignored SIGHUP, which mtpipe leaves ignored, as it should."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        signal.signal(getattr(signal, name), signal.SIG_DFL)


def gone(workers, patience_s=20.0):
    end = time.monotonic() + patience_s
    while any(is_alive(pid) for pid in workers) and time.monotonic() < end:
        time.sleep(0.1)
    return not any(is_alive(pid) for pid in workers)


linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc")


@linux
@pytest.mark.parametrize(
    ("number", "said"),
    [
        (signal.SIGINT, b"stopped by Ctrl-C"),
        (signal.SIGTERM, b"stopped by SIGTERM"),
        (signal.SIGHUP, b"stopped by the end of its terminal"),
    ],
)
def test_signals_end_a_run_and_its_workers_in_one_line(at_work, number, said):
    process, workers = at_work
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert errors == b"mtpipe: " + said + b"\n"
    assert gone(workers)


@linux
def test_a_process_that_is_killed_leaves_no_worker(at_work):
    process, workers = at_work
    process.kill()
    assert gone(workers)


@linux
@pytest.mark.parametrize("which", ["first", "last"])
def test_a_worker_that_is_killed_is_told_as_that(at_work, which):
    process, workers = at_work
    os.kill(min(workers) if which == "first" else max(workers), signal.SIGKILL)
    # less than the other worker needs: it is not waited for
    _, errors = process.communicate(timeout=50)
    assert process.returncode == 1
    assert b"worker process was ended from outside, most likely by" in errors
    assert b"defect" not in errors
    assert b"Traceback" not in errors


CALLS = """from mtpipe.ground.processes import executor

def work():
    with executor(2) as pool:
        return pool.submit(abs, -3).result()
"""


def test_a_script_without_a_guard_is_told_and_one_with_is_not(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(f"{CALLS}\nprint(work())\n")
    done = python(script, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)})
    assert done.returncode == 1
    last = done.stderr.decode().strip().splitlines()[-1]
    assert "script.py, line 7" in last
    assert 'if __name__ == "__main__":' in last
    script.write_text(f'{CALLS}\nif __name__ == "__main__":\n    print(work())\n')
    done = python(script, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)})
    assert (done.returncode, done.stdout) == (0, b"3\n")
    check_guard(2)  # the tests themselves are no script


def test_too_little_memory_is_one_sentence():
    said = unforeseen(MemoryError("Unable to allocate 7.45 GiB for an array"))
    assert "Unable to allocate 7.45 GiB" in said
    assert "defect" not in said
    with executor(1) as pool, pytest.raises(MemoryError):
        pool.submit(lambda: bytearray(1 << 62)).result()


def test_code_is_compiled_where_it_cannot_be_kept(tmp_path):
    module = tmp_path / "loop.py"
    module.write_text(
        "import numba.core.caching as caching\n"
        "caching.FunctionCache._impl_class._locator_classes = []\n"
        "from mtpipe.ground.compiled import compiled\n"
        "@compiled\n"
        "def twice(x):\n    return 2 * x\n"
        "print(twice(21))\n"
    )
    done = python(module)
    assert (done.returncode, done.stdout) == (0, b"42\n"), done.stderr


@posix
def test_code_of_a_user_without_a_home_is_not_kept_in_the_folder_of_the_call(tmp_path):
    module = tmp_path / "loop.py"
    module.write_text(
        "import pwd\n"
        "import numba.core.caching as caching\n"
        "def unknown(_):\n    raise KeyError\n"
        "pwd.getpwuid = unknown\n"
        "kind = caching.FunctionCache._impl_class\n"
        "users = [c for c in kind._locator_classes if 'UserWide' in c.__name__]\n"
        "assert users\n"
        "kind._locator_classes = users\n"
        "from mtpipe.ground.compiled import compiled\n"
        "@compiled\n"
        "def twice(x):\n    return 2 * x\n"
        "print(twice(21))\n"
    )
    unset = ("HOME", "XDG_CACHE_HOME")
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    done = python(module, cwd=tmp_path, env=environment)
    assert (done.returncode, done.stdout) == (0, b"42\n"), done.stderr
    assert list(tmp_path.iterdir()) == [module]


def test_code_is_compiled_where_the_disc_is_full(tmp_path):
    module = tmp_path / "loop.py"
    module.write_text(
        "import numba.core.caching as caching\n"
        "def full(*_):\n    raise OSError(28, 'No space left on device')\n"
        "caching.IndexDataCacheFile.save = full\n"
        "from mtpipe.ground.compiled import compiled\n"
        "@compiled\n"
        "def twice(x):\n    return 2 * x\n"
        "print(twice(21))\n"
    )
    done = python(module)
    assert (done.returncode, done.stdout) == (0, b"42\n"), done.stderr


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_kept_code_that_is_damaged_is_compiled_again_and_kept(tmp_path, kind):
    module = tmp_path / "loop.py"
    module.write_text(
        "from mtpipe.ground.compiled import compiled\n"
        "@compiled\n"
        "def twice(x):\n    return 2 * x\n"
        "print(twice(21))\n"
        "print(sum(twice.stats.cache_hits.values()))\n"
    )
    kept = tmp_path / "kept"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(kept)}

    def hits():
        done = python(module, env=environment)
        assert done.stdout.splitlines()[:1] == [b"42"], done.stderr
        return int(done.stdout.splitlines()[1])

    assert hits() == 0
    (file,) = kept.rglob(f"*.{kind}")
    file.write_bytes(bytes(file.stat().st_size))
    assert (hits(), hits()) == (0, 1)


@pytest.mark.parametrize("name", ["=1+1", "+b", "-b", "@b", "\tb"])
def test_a_spreadsheet_executes_no_name(name):
    table = pd.DataFrame({"bead": [name, "b2"], "force_pN": [-1.5, 2.0], "ok": [True, False]})
    read = pd.read_csv(io.StringIO(as_csv(table)))
    assert list(read.bead) == [f"'{name}", "b2"]
    assert list(read.force_pN) == [-1.5, 2.0]
    assert table.bead[0] == name


def test_an_error_of_another_kind_passes_the_pool():
    with pytest.raises(MtpipeError, match="as it was"), executor(2):
        raise MtpipeError("as it was")
