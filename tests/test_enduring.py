"""Processes that are ended from outside: works are done again, what ends them is given up."""

import multiprocessing
import os
import signal
import time

import pytest

from mtpipe.ground.enduring import enduring_executor
from mtpipe.ground.errors import WorkerEndedError

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals as POSIX has them")


def kill(folder, number):
    """The first time it is done a process is killed by one work, and every time by another."""
    first = not (folder / str(number)).exists()
    (folder / str(number)).touch()
    time.sleep(0.2)  # so that others are under way
    if number == 3 or (number == 1 and first):
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 4:
        raise ValueError("its own")
    return 2 * number


@pytest.mark.slow
def test_works_of_processes_that_were_ended_are_done_again(tmp_path):
    told = []
    with enduring_executor(2, hear=told.append) as pool:
        futures = [pool.submit(kill, tmp_path, number) for number in range(7)]
        for number in (0, 1, 2, 5, 6):
            assert futures[number].result(timeout=60) == 2 * number
        with pytest.raises(WorkerEndedError, match="ended from outside"):
            futures[3].result(timeout=60)
        with pytest.raises(ValueError, match="its own"):
            futures[4].result(timeout=60)


def test_an_error_outside_ends_the_processes():
    def fail():
        with enduring_executor(2, hear=print) as pool:
            pool.submit(time.sleep, 600)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert not multiprocessing.active_children()
