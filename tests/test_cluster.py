"""Works done by a Dask cluster on this machine, behind the seam that processes are behind."""

import sys
import time

import pytest

from mtpipe.ground import cluster
from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.processes import executor, tell

distributed = pytest.importorskip("distributed", reason="the extra mtpipe[cluster] is missing")
PATIENCE_S = 20.0
# what Dask and its web server warn of is theirs
pytestmark = pytest.mark.filterwarnings("ignore", "error:::mtpipe")


def twice(number):
    tell(f"at {number}")
    if number < 0:
        raise MtpipeError("no number")
    return 2 * number


@pytest.fixture(scope="module")
def address():
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as started:
        yield started.scheduler_address


def test_a_cluster_is_an_executor(address):
    heard = []
    with cluster.scheduler(address, heard.append) as pool, executor(pool) as same:
        assert same is pool
        futures = [pool.submit(twice, number) for number in (1, 1, 3)]
        assert [future.result() for future in futures] == [2, 2, 6]
        with pytest.raises(MtpipeError, match="no number"):
            pool.submit(twice, -1).result()
        end = time.monotonic() + PATIENCE_S
        while len(heard) < 4 and time.monotonic() < end:  # it comes by another way
            time.sleep(0.01)
    assert heard == ["at 1", "at 1", "at 3", "at -1"]


def test_workers_of_another_version_do_nothing(address):
    with cluster.scheduler(address, print) as pool:
        asked = pool._executor.submit(cluster._on_worker, "0.0.1", twice, 1)
        with pytest.raises(MtpipeError, match=r"a worker of the cluster has mtpipe .* 0\.0\.1"):
            asked.result()


def test_what_is_missing_is_told(monkeypatch):
    with pytest.raises(MtpipeError, match="no Dask scheduler answers"):
        cluster.scheduler("tcp://127.0.0.1:1", print, patience_s=1).__enter__()
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MtpipeError, match=r"\.\[cluster\]"):
        cluster.scheduler("tcp://127.0.0.1:1", print).__enter__()
