"""Tasks that a worker process can import, and a program that runs some."""

import os
import signal
import sys
from pathlib import Path
from threading import Event

from inercal.basics.errors import NotObserved
from inercal.basics.parallel import in_order
from inercal.basics.parallel.isolated_executor import ProcessExecutor
from inercal.cli import app

LONG = 60.0  # s


def process_and_square(x: int) -> tuple[int, int]:
    """Return the process and x²."""
    return os.getpid(), x * x


def threads_of_algebra() -> tuple[int, str | None]:
    """Return the process, and how many threads it is told to use."""
    return os.getpid(), os.environ.get("OPENBLAS_NUM_THREADS")


def refuse(name: str) -> None:
    """Raise an error with attributes."""
    raise NotObserved(f"{name} is open", (f"{name} alone",), key="[method]", names=(name,))


def refuse_after(name: str, path: Path) -> None:
    """Raise an error when a file exists."""
    while not path.exists():
        Event().wait(0.001)
    refuse(name)


def note_and_refuse(name: str, path: Path) -> None:
    """Create a file, and raise an error."""
    path.touch()
    refuse(name)


def die_elsewhere(submitting: int) -> int:
    """Kill this process, unless it is the one that submits."""
    if os.getpid() != submitting:
        os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))
    return submitting


def note_process_and_wait(folder: Path) -> None:
    """Create a file with the name of this process, and wait for long."""
    (folder / str(os.getpid())).touch()
    Event().wait(LONG)


def wait_in_two_processes(folder: Path) -> None:
    """Run tasks that do not end, in this process and in another."""
    with ProcessExecutor(2, least_work=0.0) as executor:
        executor.submit(process_and_square, 2)
        for _ in range(4):
            executor.submit(note_process_and_wait, folder)
        list(in_order(executor))


if __name__ == "__main__":
    app.app = lambda **_options: wait_in_two_processes(Path(sys.argv[1]))
    app.main()
