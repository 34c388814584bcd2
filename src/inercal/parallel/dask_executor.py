"""Tasks on a Dask cluster: of this machine, or of others by the address of its scheduler."""

import logging
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from importlib.metadata import version
from typing import Any

from inercal.errors import InercalError, InputError, require_installed
from inercal.parallel import Settled, Task, TolerantExecutor, WorkerLost, available_cores

_LOGGERS = ("distributed", "distributed.client", "distributed.utils", "distributed.core")
_TIMEOUT = 10.0  # s, for the answer of a scheduler
_SETTINGS = {
    # A task whose worker died is not tried again: who submitted it decides.
    "distributed.scheduler.allowed-failures": 0,
    # A worker holds one task more than it computes: few are lost with it.
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.profile.enabled": False,
}


def open_dask(address: str, workers: int | None = None) -> "DaskExecutor":
    """Return an executor on the cluster at an address, or on a new one of this machine.

    Parameters
    ----------
    address : str
        "tcp://host:8786", "tls://host:8786", or "local".
    workers : int, optional
        Of a new cluster, one for each core by default.

    Raises
    ------
    InputError
        No scheduler at the address, workers of another version of inercal, or a number of workers
        for a cluster that has its own.
    MissingExtra
        Dask is not installed.
    """
    require_installed("fleet", "a Dask cluster needs distributed", ("distributed",))
    dask: Any = import_module("dask.config")
    distributed: Any = import_module("distributed")
    for name in _LOGGERS:  # who submitted a task reports its loss, once
        logging.getLogger(name).setLevel(logging.CRITICAL)
    if address == "local":
        with dask.set(_SETTINGS):
            cluster = distributed.LocalCluster(
                n_workers=workers or available_cores(),
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                silence_logs="CRITICAL",
            )
            return DaskExecutor(distributed.Client(cluster), cluster)
    if not address.startswith(("tcp://", "tls://")):
        raise InputError(
            f"--scheduler {address}: give tcp://HOST:PORT, tls://HOST:PORT or local",
            key="--scheduler",
        )
    if workers is not None:
        raise InputError(
            f"--workers {workers}: the cluster at {address} has its own workers; leave one of "
            "--workers and --scheduler out",
            key="--workers",
        )
    try:
        with dask.set(_SETTINGS):
            client = distributed.Client(address, timeout=_TIMEOUT, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers ({type(error).__name__}); start one "
            "by `dask scheduler`",
            key="--scheduler",
        ) from None
    executor = DaskExecutor(client, None)
    try:
        executor.require_same_version()
    except InputError:
        executor.close()
        raise
    return executor


class SchedulerLost(InercalError):
    """The scheduler of a cluster has ended."""


class DaskExecutor(TolerantExecutor):
    """Runs tasks on the workers of a Dask cluster.

    Parameters
    ----------
    client : distributed.Client
    cluster : distributed.LocalCluster or None
        A cluster that ends with this executor.
    """

    def __init__(self, client: Any, cluster: Any):
        distributed: Any = import_module("distributed")
        self._client, self._cluster = client, cluster
        self._address = client.scheduler.address
        self._futures = distributed.as_completed(loop=client.loop, raise_errors=False)
        self._indices: dict[str, int] = {}  # by key of the future
        self._open: dict[int, Any] = {}
        self._waiting: list[Task] = []  # accepted, and not sent yet
        self._count = 0
        self.dashboard = str(client.dashboard_link)

    @property
    def workers(self) -> int:
        """Workers that the cluster has now, at least one."""
        return max(len(self._client.scheduler_info()["workers"]), 1)

    def require_same_version(self) -> None:
        """Refuse workers of another version of inercal, and a cluster without workers.

        Raises
        ------
        InputError
            With the versions.
        """
        own = version("inercal")
        found: dict[str, str] = self._client.run(version, "inercal")
        address = self._address
        if not found:
            raise InputError(
                f"--scheduler {address}: the cluster has no worker; start one by `dask worker "
                f"{address}`",
                key="--scheduler",
            )
        if other := sorted(set(found.values()) - {own}):
            raise InputError(
                f"--scheduler {address}: its workers have inercal {', '.join(other)}, this is "
                f"{own}; install the same version on all",
                key="--scheduler",
            )

    def submit(self, function: Callable[..., Any], *arguments: Any) -> int:
        """Accept a task; return its index."""
        self._count += 1
        self._waiting.append(Task(self._count - 1, function, arguments))
        return self._count - 1

    def _send(self) -> None:
        """Send the tasks that were accepted since, all in one message."""
        tasks, self._waiting = self._waiting, []
        if not tasks:
            return
        try:
            futures = self._client.map(Task.__call__, tasks, key="task", pure=False)
        except Exception as error:  # of a client that is closed, of more than one type
            if self._client.status == "running":
                raise
            raise self._scheduler_lost() from error
        for task, future in zip(tasks, futures, strict=True):
            self._indices[future.key] = task.index
            self._open[task.index] = future
        self._futures.update(futures)

    def forget_after(self, index: int) -> None:
        """Drop the tasks of larger index."""
        self._waiting = [task for task in self._waiting if task.index <= index]
        for other in [k for k in self._open if k > index]:
            self._open.pop(other).cancel()

    def settled(self) -> Iterator[Settled]:
        """Yield each task as it ends."""
        # Those that have ended meanwhile are fetched at once: short tasks cost less than a request.
        self._send()
        while self._futures.count():
            batch = self._futures.next_batch()
            results = self._fetch([one for one in batch if one.status == "finished"])
            for future in batch:
                index = self._indices.pop(future.key)
                if self._open.pop(index, None) is None:
                    continue  # forgotten
                if future.status in ("cancelled", "lost") and self._client.status != "running":
                    raise self._scheduler_lost()
                error = None if future.key in results else _error_of(future)
                # A future that is held is computed again when its worker dies.
                future.release()
                yield Settled(index, results.pop(future.key, None), error)
            self._send()

    def _fetch(self, finished: list[Any]) -> dict[str, Any]:
        """Return the results of futures by their keys."""
        try:
            results = self._client.gather(finished)
        except OSError as lost:  # the tasks themselves have ended well
            raise self._scheduler_lost() from lost
        return {one.key: result for one, result in zip(finished, results, strict=True)}

    def _scheduler_lost(self) -> SchedulerLost:
        return SchedulerLost(
            f"the scheduler at {self._address} has ended; results that are there are kept: start "
            "it again and run the same command"
        )

    def close(self) -> None:
        """Drop what still runs, and end a cluster of its own."""
        with suppress(Exception):  # of a scheduler that is gone
            for future in self._open.values():
                future.cancel()
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()


def _error_of(future: Any) -> BaseException:
    if future.status != "error":
        return WorkerLost(f"the scheduler has dropped the task ({future.status})")
    error: BaseException = future.exception()
    killed: Any = import_module("distributed").KilledWorker
    return WorkerLost("the worker died") if isinstance(error, killed) else error
