"""Set up the processes of the program itself; importing inercal does not change other programs.

A function whose matrices are small can limit linear algebra to one thread. A second thread would
mostly wait, and it uses processor time while it waits.
"""

import atexit
import ctypes
import gc
import os
import sys
import warnings
from collections.abc import Callable
from functools import wraps
from getpass import getuser
from importlib import import_module
from typing import Any, ParamSpec, TypeVar

# Python searches for unreachable cycles after this number of new objects, by default 700 or 2000.
# Compiling kernels creates millions of objects, nearly all of them reachable, and the search takes
# a tenth of the time.
_OBJECTS = 100_000
_LOADED_OBJECTS = 500_000  # before the first search: the libraries of a verb are loaded by then

# glibc returns the memory of a freed array to the system if the array exceeds a limit, at first 128
# kB, later 32 MB. The system then clears each page of the next array, which takes a third of the
# time of a Monte Carlo run. These are parameters of mallopt(3).
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_RETURNED_FROM = 2**30  # bytes of an array from which its memory is returned
_RETURNED_BEYOND = 2**31 - 1  # free bytes at the end of the heap from which they are returned


def prepare_process() -> None:
    """Keep freed array memory for later arrays, and run the garbage collector less often.

    Warnings of NumPy about absurd numbers are left out, because the checks of the results name the
    cause. An option -W of Python, or PYTHONWARNINGS, shows them.
    """
    if not sys.warnoptions:
        warnings.filterwarnings("ignore", category=RuntimeWarning)
    gc.set_threshold(_LOADED_OBJECTS)
    gc.callbacks.append(_search_more_often)
    # When a process ends, the system frees its memory. Searching all objects of the libraries for
    # cycles before that takes 0.3 s.
    atexit.register(gc.freeze)
    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):
        library.mallopt(_MMAP_THRESHOLD, _RETURNED_FROM)
        library.mallopt(_TRIM_THRESHOLD, _RETURNED_BEYOND)


def _search_more_often(phase: str, _: dict[str, int]) -> None:
    """Use the smaller number of objects after the first search."""
    if phase == "stop" and _search_more_often in gc.callbacks:
        gc.callbacks.remove(_search_more_often)
        gc.set_threshold(_OBJECTS)


P = ParamSpec("P")
R = TypeVar("R")
_CHOSEN = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def with_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Return a version of the function during which linear algebra uses one thread.

    If an environment variable sets the number of threads, the user's choice is respected.
    """

    @wraps(function)
    def limited(*args: P.args, **options: P.kwargs) -> R:
        if any(name in os.environ for name in _CHOSEN):
            return function(*args, **options)
        import_module("scipy.linalg")  # its library would start its own threads
        threads: Any = import_module("threadpoolctl")
        with threads.threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **options)

    return limited


def user_name() -> str:
    """Return the user's login name, or the user number if there is no name."""
    try:
        return getuser()
    except (ImportError, KeyError, OSError):  # there may be no name in a container
        return f"user {os.getuid()}" if hasattr(os, "getuid") else "unknown"
