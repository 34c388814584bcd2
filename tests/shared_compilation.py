"""Kernels of a machine that has none: one of the processes that test compiles each, all load it."""

# Numba has no types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false

import fcntl
from pathlib import Path
from typing import Any

from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher


def compile_each_kernel_once(folder: Path) -> None:
    """Let this process wait for a kernel that another one compiles; locks are files in `folder`.

    A caller is locked before what it calls, and kernels do not call in circles, so that no two
    processes wait for one another. Within a process the compiler's own lock comes first.
    """
    folder.mkdir(parents=True, exist_ok=True)
    compile_here: Any = Dispatcher.compile
    held: set[str] = set()

    def compile_alone(self: Any, sig: Any) -> Any:
        name = f"{self.py_func.__module__}.{self.py_func.__qualname__}"
        with global_compiler_lock:
            if self._cache.cache_path is None or name in held:
                return compile_here(self, sig)
            held.add(name)
            try:
                with (folder / name).open("w", encoding="utf-8") as file:
                    fcntl.flock(file, fcntl.LOCK_EX)  # until it is closed
                    return compile_here(self, sig)
            finally:
                held.remove(name)

    Dispatcher.compile = compile_alone
