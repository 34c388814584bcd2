"""A process that computes tasks: with one thread, deaf to the keyboard, ended with its parent."""

import os
import signal
import sys
from collections.abc import Generator
from contextlib import contextmanager
from multiprocessing import parent_process
from multiprocessing.connection import wait
from multiprocessing.context import SpawnContext, SpawnProcess
from threading import Thread
from typing import Any

from inercal.basics.process_settings import prepare_process

# As many processes as cores: threads of linear algebra would only wait for one another.
_THREAD_VARIABLES = (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
)


class WorkerProcess(SpawnProcess):
    """A process that is not stopped by the keyboard but by `terminate`, or by its parent's end.

    A terminal sends the interrupt to all processes of a command. The parent answers it; a worker
    that did so too would print a traceback of its own.
    """

    def start(self) -> None:
        """Start the process, with the interrupt blocked from its first instruction on."""
        with _interrupt_blocked(), _one_thread():
            super().start()

    def run(self) -> None:
        """Compute until the parent ends."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # where signals cannot be blocked
        prepare_process()
        Thread(target=_end_with_parent, daemon=True).start()
        super().run()


class WorkerContext(SpawnContext):
    """Starts worker processes, and can terminate all of them."""

    def __init__(self):
        super().__init__()
        self.started: list[WorkerProcess] = []

    def Process(  # pyright: ignore[reportIncompatibleVariableOverride]
        self, *args: Any, **options: Any
    ) -> WorkerProcess:
        """Return a worker process that is not started yet."""
        process = WorkerProcess(*args, **options)
        self.started.append(process)
        return process

    def terminate(self) -> None:
        """End all processes, in the middle of a task too; one that is stopped would not hear."""
        for process in self.started:
            if process.pid is not None:
                process.kill()


def _end_with_parent() -> None:
    """End this process when its parent has ended: nobody else would."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@contextmanager
def _interrupt_blocked() -> Generator[None]:
    """Block the interrupt, which processes started meanwhile inherit; afterwards it arrives."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _one_thread() -> Generator[None]:
    """Give processes that are started meanwhile one thread, unless the user has chosen."""
    added = [name for name in _THREAD_VARIABLES if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]
