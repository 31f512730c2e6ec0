"""Work is done here or in other processes, its linear algebra in one thread."""

import multiprocessing.spawn

import pytest
import threadpoolctl
from scipy import linalg

from mtpipe.ground.enduring import enduring_executor
from mtpipe.ground.processes import executor, why_no_process_starts


def threads_of_linear_algebra():
    linalg.inv([[1.0]])
    return {
        one["num_threads"] for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"
    }


def test_linear_algebra_takes_one_thread_wherever_work_is_done():
    before = threads_of_linear_algebra()
    for workers in (1, 2):
        with executor(workers) as pool:
            assert pool.submit(threads_of_linear_algebra).result() == {1}
    assert threads_of_linear_algebra() == before


@pytest.mark.parametrize("spread", [executor, enduring_executor])
def test_where_no_process_may_be_started_this_one_does_all_and_says_so(spread, tmp_path):
    interpreter = multiprocessing.spawn.get_executable()
    (tmp_path / "python").write_text("of somebody else")  # which may not be run
    multiprocessing.spawn.set_executable(str(tmp_path / "python"))
    why_no_process_starts.cache_clear()
    heard = []
    try:
        with spread(2, hear=heard.append) as pool:
            assert pool.submit(abs, -3).result() == 3
    finally:
        multiprocessing.spawn.set_executable(interpreter)
        why_no_process_starts.cache_clear()
    assert heard == [
        "no worker can be started here, as the Python interpreter may not be run again: "
        "this process does all"
    ]
