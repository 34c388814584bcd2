"""Run tasks on a Dask cluster, given the address of its scheduler."""

import logging
import re
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any

from inercal.basics.closeable import on_failure
from inercal.basics.errors import InercalError, InputError, require_installed
from inercal.basics.parallel.executor import (
    LOOK,
    AwakeClock,
    Settled,
    Task,
    TimeExceeded,
    TolerantExecutor,
    WorkerLost,
    reported_steps,
)

_LOGGERS = ("distributed", "distributed.client", "distributed.utils", "distributed.core")
_ADDRESS = re.compile(r"(tcp|tls)://([^\s/:@\[\]]+|\[[0-9a-fA-F:.%]+\]):(?P<port>\d{1,5})")
_TIMEOUT = 10.0  # s, for a scheduler to answer
_RESTART = 60.0  # s, of a worker
_SETTINGS = {
    # A task whose worker died is not retried, because the submitter decides this.
    "distributed.scheduler.allowed-failures": 0,
    # A worker holds only one more task than it computes, so few tasks are lost with it.
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.profile.enabled": False,
}


def open_dask(address: str, workers: int | None = None) -> "DaskExecutor":
    """Return an executor for the cluster at an address.

    Parameters
    ----------
    address : str
        Address, "tcp://host:8786" or "tls://host:8786".
    workers : int, optional
        Must be None, because the cluster has its own workers.

    Raises
    ------
    InputError
        There is no scheduler at the address, certificates for "tls://" are missing, the cluster has
        no worker or workers with a different version of inercal, or a number of workers was given.
    SchedulerLost
        The scheduler has stopped since then.
    MissingExtra
        Dask is not installed.
    """
    if (found := _ADDRESS.fullmatch(address)) is None or not 0 < int(found["port"]) < 1 << 16:
        raise _refused(address, "give tcp://HOST:PORT, tls://HOST:PORT or local")
    if workers is not None:
        raise InputError(
            f"--workers {workers}: the cluster at {address} has its own workers; give only one "
            "of --workers and --scheduler",
            key="--workers",
        )
    require_installed("fleet", "a Dask cluster needs distributed", ("distributed",))
    try:
        dask: Any = import_module("dask.config")
        distributed: Any = import_module("distributed")
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"Dask's settings cannot be read: {reason}", key="--scheduler") from None
    for name in _LOGGERS:  # the submitter of a task reports its loss, once
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with dask.set(_SETTINGS):
        client = _connected_client(distributed, address)
    with on_failure(client.close):
        executor = DaskExecutor(client)
    with on_failure(executor.close):
        executor.require_same_version()
    return executor


def _connected_client(distributed: Any, address: str) -> Any:
    """Return a client that is connected to a scheduler.

    Raises
    ------
    InputError
        No scheduler answers, or its certificates are missing or wrong.
    """
    security = distributed.Security()  # certificates from Dask's settings
    if address.startswith("tls://"):
        _require_certificates(security, address)
    found: SimpleQueue[Any] = SimpleQueue()
    # If a client could not connect, deleting it would wait for its end and log an error.
    kind: Any = type("Client", (distributed.Client,), {"__del__": lambda _self: None})  # pyright: ignore[reportUnknownLambdaType]

    def connect() -> None:
        try:
            options = {"timeout": _TIMEOUT, "set_as_default": False, "security": security}
            found.put(kind(address, **options))
        except Exception as error:  # wrong certificates raise several types
            found.put(error)

    # This runs in a thread, because Dask waits forever for a scheduler that accepts a connection
    # but does not answer.
    Thread(target=connect, daemon=True).start()
    try:
        client = found.get(timeout=2 * _TIMEOUT)
    except Empty:
        client = TimeoutError()
    if isinstance(client, Exception):
        raise _refused(
            address,
            f"no Dask scheduler answers ({type(client).__name__}); start one with `dask "
            "scheduler`, and check address and certificates",
        )
    return client


def _require_certificates(security: Any, address: str) -> None:
    stated: dict[str, Any] = security.get_tls_config_for_role("client")
    names = {"ca_file": "ca-file", "cert": "client.cert", "key": "client.key"}
    if missing := [setting for key, setting in names.items() if not stated.get(key)]:
        settings = ", ".join(f"distributed.comm.tls.{name}" for name in missing)
        raise _refused(
            address,
            f"tls needs certificates; state {settings} in Dask's settings "
            "(~/.config/dask/*.yaml, or DASK_DISTRIBUTED__COMM__TLS__…)",
        )


def _refused(address: str, reason: str) -> InputError:
    return InputError(f"--scheduler {address}: {reason}", key="--scheduler")


class SchedulerLost(InercalError):
    """The scheduler of a cluster has stopped."""


@dataclass(frozen=True)
class _Step:
    """A step that has started, with the worker that computes it."""

    task: int
    number: int
    worker: str


class DaskExecutor(TolerantExecutor):
    """Executor that runs tasks on the workers of a Dask cluster.

    Parameters
    ----------
    client : distributed.Client
    """

    def __init__(self, client: Any):
        super().__init__()
        self._client = client
        self._address = client.scheduler.address
        self._topic = f"inercal-{client.id}"
        self._news: SimpleQueue[Any] = SimpleQueue()  # finished futures and starting steps
        self._open: dict[int, Any] = {}
        self._tasks: dict[int, Task] = {}  # open futures
        self._indices: dict[str, int] = {}  # keyed by future
        self._steps: dict[int, tuple[_Step, float]] = {}
        self._stopped_workers: set[str] = set()
        self._clock = AwakeClock()
        with self._lost_scheduler_named():
            client.subscribe_topic(self._topic, self._note_step)
            self.dashboard = self._dashboard_link()

    @property
    def workers(self) -> int:
        """Current number of workers in the cluster, but at least one."""
        with self._lost_scheduler_named():
            known: dict[str, Any] | None = self._client.scheduler_info().get("workers")
        if known is None:
            raise self._scheduler_lost()
        return max(len(known), 1)

    def _dashboard_link(self) -> str:
        """Return the address of the cluster's dashboard, or "" if Dask's settings give none."""
        try:
            return str(self._client.dashboard_link)
        except (KeyError, ValueError):  # for a template that contains unknown names
            return ""

    @contextmanager
    def _lost_scheduler_named(self) -> Generator[None]:
        """Convert the errors of a client whose scheduler has stopped to `SchedulerLost`."""
        try:
            yield
        except Exception as error:  # several types of errors
            if self._client.status == "running" and not isinstance(error, OSError):
                raise
            raise self._scheduler_lost() from error

    def require_same_version(self) -> None:
        """Raise an error if the cluster has no workers or workers with a different version.

        Raises
        ------
        InputError
            The message states the versions.
        SchedulerLost
            The scheduler has stopped since then.
        """
        own, address = version("inercal"), self._address
        with self._lost_scheduler_named():
            found: dict[str, Any] = self._client.run(version, "inercal", on_error="return")
        if not found:
            raise _refused(
                address, f"the cluster has no worker; start one with `dask worker {address}`"
            )
        # A worker that ends during this check is treated like a worker that ends later.
        answers = [one for one in found.values() if not isinstance(one, OSError)]
        texts = {one if isinstance(one, str) else "none" for one in answers}
        if other := sorted(texts - {own}):
            raise _refused(
                address,
                f"its workers run inercal {', '.join(other)}, but this program is version {own}; "
                "install the same version on all",
            )

    def _note_step(self, event: tuple[Any, tuple[int, int, str]]) -> None:
        """Record a step of a task; the client calls this in its own thread."""
        self._news.put(_Step(*event[1]))

    def _send(self) -> None:
        """Send all newly accepted tasks in one message."""
        tasks = list(self._waiting)
        self._waiting.clear()
        if not tasks:
            return
        try:
            futures = self._client.map(
                _run_reporting, tasks, topic=self._topic, key="task", pure=False
            )
        except Exception as error:  # a closed client raises several types of errors
            if self._client.status == "running":
                raise
            raise self._scheduler_lost() from error
        for task, future in zip(tasks, futures, strict=True):
            self._indices[future.key] = task.index
            self._open[task.index], self._tasks[task.index] = future, task
            future.add_done_callback(self._news.put)

    def forget_after(self, index: int) -> None:
        """Drop the tasks with a larger index."""
        super().forget_after(index)
        for other in [k for k in self._open if k > index]:
            self._forget(other).cancel()

    def settled(self) -> Iterator[Settled]:
        """Yield each task as it ends."""
        self._send()
        while self._open:
            # The results of all finished tasks are fetched together, because a request may take
            # longer than a short task.
            ended = self._ended_futures()
            results = self._fetch([one for one in ended if one.status == "finished"])
            for future in ended:
                settled = self._settle(future, results)
                if settled is not None:
                    yield settled
            yield from self._stop_late_tasks()
            self._send()

    def _ended_futures(self) -> list[Any]:
        """Return the futures that finish within a short wait, and record the steps that begin."""
        ended: list[Any] = []
        wait = LOOK
        while True:
            try:
                one = self._news.get(timeout=wait) if wait else self._news.get_nowait()
            except Empty:
                break
            wait = 0.0
            if not isinstance(one, _Step):
                ended.append(one)
            elif one.task in self._open:
                self._steps[one.task] = one, self._clock()
        self._clock()
        return [one for one in ended if self._indices.get(one.key) in self._open]

    def _settle(self, future: Any, results: dict[str, Any]) -> Settled | None:
        """Return the outcome of a finished future, or None if its task was sent again."""
        index = self._indices[future.key]
        if index not in self._open:
            return None  # dropped in the meantime
        if future.status in ("cancelled", "lost") and self._client.status != "running":
            raise self._scheduler_lost()
        error = None if future.key in results else self._error_of(future)
        task = self._tasks[index]
        # Dask would compute a future again if its worker died while we keep the future.
        self._forget(index).release()
        if error is _NOT_ITS_FAULT:
            self._waiting.append(task)
            return None
        return Settled(index, results.pop(future.key, None), error)

    def _forget(self, index: int) -> Any:
        """Drop a task and return its future."""
        future = self._open.pop(index)
        self._indices.pop(future.key)
        self._steps.pop(index, None)
        del self._tasks[index]
        return future

    def _stop_late_tasks(self) -> Iterator[Settled]:
        """Yield the tasks whose step exceeds its time limit, and restart their workers."""
        if self.limit is None:
            return
        now = self._clock()
        for index, (step, since) in list(self._steps.items()):
            limit = self.limit(index, step.number)
            if now - since > limit:
                self._forget(index).cancel()
                self._restart(step.worker)
                yield Settled(index, None, TimeExceeded.of(step.number, limit))

    def _restart(self, worker: str) -> None:
        self._stopped_workers.add(worker)
        with suppress(Exception):  # several types of errors: the worker is already gone
            try:
                self._client.restart_workers([worker], _RESTART, raise_for_error=False)
            except ValueError:  # the worker has no nanny process that would restart it
                self._client.retire_workers([worker], close_workers=True)

    def _fetch(self, finished: list[Any]) -> dict[str, Any]:
        """Return the results of futures, by key."""
        try:
            results = self._client.gather(finished)
        except OSError as lost:  # the tasks themselves finished successfully
            raise self._scheduler_lost() from lost
        return {one.key: result for one, result in zip(finished, results, strict=True)}

    def _scheduler_lost(self) -> SchedulerLost:
        return SchedulerLost(
            f"the scheduler at {self._address} has stopped; existing results are kept: start it "
            "again and run the same command"
        )

    def _error_of(self, future: Any) -> BaseException:
        if future.status != "error":
            return WorkerLost(f"the scheduler dropped the task ({future.status})")
        error: BaseException = future.exception()
        killed: Any = import_module("distributed").KilledWorker
        if not isinstance(error, killed):
            return error
        last = getattr(error, "last_worker", None)
        ours = getattr(last, "address", None) in self._stopped_workers
        return _NOT_ITS_FAULT if ours else WorkerLost("the worker died")

    def close(self) -> None:
        """Drop all running tasks."""
        with suppress(Exception):  # the scheduler is gone
            for future in self._open.values():
                future.cancel()
        self._client.close()


_NOT_ITS_FAULT = WorkerLost("its worker was killed because of another task")


def _run_reporting(task: Task, topic: str) -> Any:
    """Compute a task on a worker and report its steps."""
    distributed: Any = import_module("distributed")
    worker: Any = distributed.get_worker()
    sync: Any = distributed.utils.sync

    def report(step: int) -> None:
        # The step only begins after the scheduler has received the report, because a task that
        # hangs may block all threads of this process.
        message = [task.index, step, worker.address]
        sync(worker.loop, worker.scheduler.log_event, topic=topic, msg=message)

    with reported_steps(report):
        return task()
