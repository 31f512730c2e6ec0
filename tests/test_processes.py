"""Work is done here or in other processes, its linear algebra in one thread."""

import threadpoolctl
from scipy import linalg

from mtpipe.ground.processes import executor


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
