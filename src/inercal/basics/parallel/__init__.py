"""Independent tasks, run in one process or several with the same results.

A task is a function call with its arguments. An executor decides only where and when a task runs.
Results do not depend on the number of workers, because a task gets its random stream from its
arguments, and the work is always divided into the same tasks.

A task may run in another process if its function and arguments can be pickled. Otherwise it runs in
this process.
"""

import os
import sys
from collections.abc import Sequence

from inercal.basics.errors import InputError
from inercal.basics.parallel.executor import (
    Executor,
    SerialExecutor,
    Settled,
    Task,
    TimeExceeded,
    TolerantExecutor,
    WorkerLost,
    in_order,
)

LOCAL = "local"
"""The word that selects this machine instead of a scheduler's address."""
_MOST = {"win32": 61}  # largest number of processes that Windows can wait for at once


def available_cores() -> int:
    """Return the number of CPU cores that this process may use."""
    if sys.version_info >= (3, 13):
        return os.process_cpu_count() or 1
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def open_executor(
    workers: int | None = None, scheduler: str | None = None, modules: Sequence[str] = ()
) -> Executor:
    """Return an executor that runs tasks on this machine or on a Dask cluster.

    Parameters
    ----------
    workers : int, optional
        Number of workers, including this process. By default, there is one worker for each core
        that this process may use, if the work is long enough.
    scheduler : str, optional
        Address of a Dask scheduler, "tcp://host:8786" or "tls://host:8786". "local" means the same
        as no argument: the tasks run on this machine, and no port is opened.
    modules : sequence of str, optional
        Modules of the work; processes on this machine load them while the tasks are prepared.

    Raises
    ------
    InputError
        The number of workers is below 1, a number is given although the scheduler has its own
        workers, or there is no scheduler at the address.
    MissingExtra
        Dask is not installed.
    """
    _require_worker(workers)
    if scheduler is not None and scheduler != LOCAL:
        return _open_cluster(scheduler, workers)
    if (number := _processes(workers)) == 1:
        return SerialExecutor()
    from inercal.basics.parallel.isolated_executor import ProcessExecutor

    return ProcessExecutor(number, at_once=workers is not None, modules=modules)


def open_tolerant_executor(
    workers: int | None = None, scheduler: str | None = None, modules: Sequence[str] = ()
) -> TolerantExecutor:
    """Return an executor that continues if a worker process ends; all tasks run in workers.

    Parameters
    ----------
    workers, scheduler, modules
        See `open_executor`.

    Raises
    ------
    InputError, MissingExtra
        See `open_executor`.
    """
    _require_worker(workers)
    if scheduler is not None and scheduler != LOCAL:
        return _open_cluster(scheduler, workers)
    from inercal.basics.parallel.isolated_executor import IsolatedExecutor

    return IsolatedExecutor(_processes(workers), modules)


def _open_cluster(scheduler: str, workers: int | None) -> TolerantExecutor:
    from inercal.basics.parallel.dask_executor import open_dask

    return open_dask(scheduler, workers)


def _require_worker(workers: int | None) -> None:
    if workers is not None and workers < 1:
        raise InputError(f"--workers {workers}: give 1 or more", key="--workers")


def _processes(workers: int | None) -> int:
    wanted = available_cores() if workers is None else workers
    return min(wanted, _MOST.get(sys.platform, wanted))


__all__ = [
    "LOCAL",
    "Executor",
    "SerialExecutor",
    "Settled",
    "Task",
    "TimeExceeded",
    "TolerantExecutor",
    "WorkerLost",
    "available_cores",
    "in_order",
    "open_executor",
    "open_tolerant_executor",
]
