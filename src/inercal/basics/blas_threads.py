"""Limit linear algebra to one thread in functions whose matrices are small.

With small matrices, a second thread would mostly wait, and it uses processor time while it waits.
"""

import os
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from typing import Any, ParamSpec, TypeVar

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
