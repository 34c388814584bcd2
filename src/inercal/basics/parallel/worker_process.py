"""Worker processes: single-threaded, unaffected by Ctrl-C, and ended with their parent."""

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

# There are as many processes as cores, so more linear-algebra threads would only wait for each
# other.
_THREAD_VARIABLES = (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
)


class WorkerProcess(SpawnProcess):
    """A process that ignores Ctrl-C, and ends on `terminate` or with its parent.

    A terminal sends the interrupt to all processes of a command. Only the parent handles it,
    because each worker would print its own traceback.
    """

    def start(self) -> None:
        """Start the process with the interrupt blocked from its first instruction."""
        with _interrupt_blocked(), _one_thread():
            super().start()

    def run(self) -> None:
        """Compute tasks until the parent ends."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # on systems where signals cannot be blocked
        prepare_process()
        Thread(target=_end_with_parent, daemon=True).start()
        super().run()


class WorkerContext(SpawnContext):
    """A multiprocessing context that starts worker processes and can terminate all of them."""

    def __init__(self):
        super().__init__()
        self.started: list[WorkerProcess] = []

    def Process(  # pyright: ignore[reportIncompatibleVariableOverride]
        self, *args: Any, **options: Any
    ) -> WorkerProcess:
        """Return a worker process that has not been started."""
        process = WorkerProcess(*args, **options)
        self.started.append(process)
        return process

    def terminate(self) -> None:
        """Kill all processes, even during a task; a suspended process would not react to less."""
        for process in self.started:
            if process.pid is not None:
                process.kill()


def _end_with_parent() -> None:
    """End this process when its parent has ended, because nothing else would end it."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@contextmanager
def _interrupt_blocked() -> Generator[None]:
    """Block the interrupt signal; processes that are started meanwhile do not receive it."""
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
    """Limit processes started in the block to one thread, unless the user set a number."""
    added = [name for name in _THREAD_VARIABLES if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]
