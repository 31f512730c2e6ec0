"""Works done by a Dask cluster, behind the same seam as processes: an executor.

Needs the extra `mtpipe[cluster]`. A worker does one work at a time, so it should have one thread
(`dask worker --nthreads 1`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.processes import Hear, heard_by, in_one_thread, undivided
from mtpipe.ground.version import VERSION

T = TypeVar("T")
P = ParamSpec("P")
# Topic under which workers report their progress.
TOPIC = "mtpipe"


@contextmanager
def scheduler(address: str, hear: Hear, *, patience_s: float = 10.0) -> Iterator[Executor]:
    """The workers of a scheduler that is running, and answers within some seconds.

    Raises
    ------
    MtpipeError : dask.distributed is not installed, or no scheduler answers.
    """
    distributed = _imported("distributed")
    try:
        client = distributed.Client(address, timeout=patience_s)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        raise MtpipeError(
            f"no Dask scheduler answers at {address!r} ({error})",
            mend='Give its address as "dask scheduler" prints it: tcp://HOST:8786.',
        ) from None
    with client:
        yield _OnCluster(client, hear)


@contextmanager
def slurm(jobs: int, hear: Hear) -> Iterator[Executor]:
    """Workers that are jobs of SLURM, as dask-jobqueue's own configuration describes them.

    Raises
    ------
    MtpipeError : dask-jobqueue is not installed, or its configuration is not complete.
    """
    jobqueue = _imported("dask_jobqueue")
    try:
        cluster = jobqueue.SLURMCluster()
    except (ValueError, TypeError) as error:
        raise MtpipeError(
            f"the jobs of SLURM cannot be described ({error})",
            mend="Give cores, memory and the like in ~/.config/dask/jobqueue.yaml, below "
            "jobqueue: slurm:.",
        ) from None
    with cluster:
        cluster.scale(jobs=jobs)
        with scheduler(cluster.scheduler_address, hear) as pool:
            yield pool


def _imported(name: str) -> Any:
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError:
        raise MtpipeError(
            f"{name.replace('_', '-')} is not installed",
            mend='In the folder of mtpipe: pip install ".[cluster]".',
        ) from None


class _OnCluster(Executor):
    def __init__(self, client: Any, hear: Hear) -> None:
        client.subscribe_topic(TOPIC, lambda event: hear(event[1]))
        # never the result of an earlier work that looks alike
        self._executor = client.get_executor(pure=False)

    def submit(self, work: Callable[P, T], /, *args: P.args, **named: P.kwargs) -> Future[T]:
        """Have a work done by one of the workers."""
        future: Future[T] = self._executor.submit(_on_worker, VERSION, work, *args, **named)
        return future


def _on_worker(version: str, work: Callable[..., T], /, *args: Any, **named: Any) -> T:
    if version != VERSION:
        raise MtpipeError(
            f"a worker of the cluster has mtpipe {VERSION}, and this is {version}",
            mend="Install the same version on all machines.",
        )
    worker = _imported("distributed").get_worker()
    # the cluster's workers are as many as there is room for
    with undivided(), heard_by(lambda what: worker.log_event(TOPIC, what)):
        return in_one_thread(work, *args, **named)
