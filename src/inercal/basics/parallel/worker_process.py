"""Worker processes: single-threaded, unaffected by Ctrl-C, and ended with their parent.

On Linux a server process loads the modules of the work once, and each worker is a copy of this
server (a fork). A fork is only safe in a process without other threads, so the server does nothing
else. Elsewhere each worker loads the modules itself, because macOS does not allow such copies.
"""

import gc
import os
import signal
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager, nullcontext
from multiprocessing import parent_process, resource_tracker
from multiprocessing.connection import wait
from multiprocessing.forkserver import ensure_running
from tempfile import gettempdir
from threading import Thread
from typing import TYPE_CHECKING, Any

from inercal.basics.process_settings import prepare_process

# The server listens at a path in this folder, and the system limits such paths to 108 bytes.
_HAS_SERVER = sys.platform == "linux" and len(os.fsencode(gettempdir())) < 64
if TYPE_CHECKING or not _HAS_SERVER:
    from multiprocessing.context import SpawnContext as _Context
    from multiprocessing.context import SpawnProcess as _Process
else:
    from multiprocessing.context import ForkServerContext as _Context
    from multiprocessing.context import ForkServerProcess as _Process

_SETTINGS = dict.fromkeys(
    # There are as many processes as cores, so more linear-algebra threads would only wait for each
    # other. The server must not load modules from the working folder.
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS",
     "PYTHONSAFEPATH"),
    "1",
)  # fmt: skip


class WorkerProcess(_Process):
    """A process that ignores Ctrl-C, and ends on `terminate` or with its parent.

    A terminal sends the interrupt to all processes of a command. Only the parent handles it,
    because each worker would print its own traceback.
    """

    def start(self) -> None:
        """Start the process with the interrupt blocked from its first instruction."""
        self._environment = _SETTINGS | dict(os.environ)  # the server has that of its own start
        with nullcontext() if _HAS_SERVER else _prepared():  # its server is prepared
            super().start()

    def run(self) -> None:
        """Compute tasks until the parent ends."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # on systems where signals cannot be blocked
        os.environ.clear()
        os.environ.update(self._environment)
        prepare_process()
        gc.freeze()  # a search for cycles would write to the memory shared with the server
        Thread(target=_end_with_parent, daemon=True).start()
        super().run()


class WorkerContext(_Context):
    """A multiprocessing context that starts worker processes and can terminate all of them.

    Parameters
    ----------
    modules : sequence of str
        Modules that the first server of this program loads for its workers.
    """

    def __init__(self, modules: Sequence[str] = ()):
        super().__init__()
        self.set_forkserver_preload([*modules])
        self.started: list[WorkerProcess] = []

    def prepare(self) -> None:
        """Start the server without waiting for it, so that it loads its modules meanwhile."""
        if _HAS_SERVER:
            with _prepared():
                ensure_running()

    def Process(  # pyright: ignore[reportIncompatibleVariableOverride]
        self, *args: Any, **options: Any
    ) -> WorkerProcess:
        """Return a worker process that has not been started."""
        self.prepare()
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
    resource_tracker.ensure_running()  # its start would end the blocking below
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _prepared() -> Generator[None]:
    """Block the interrupt and apply `_SETTINGS`, unless the user set them, for a new process."""
    added = {name: text for name, text in _SETTINGS.items() if name not in os.environ}
    os.environ.update(added)
    try:
        with _interrupt_blocked():
            yield
    finally:
        for name in added:
            del os.environ[name]
