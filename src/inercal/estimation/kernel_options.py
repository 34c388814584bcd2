"""Decorators of kernels that compile sooner and call one another without overhead.

A kernel of these allocates nothing, and so counts no references to arrays: its caller allocates
what it works with.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

_OPTIONS: dict[str, Any] = {
    "cache": True, "error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True,
}  # fmt: skip
# Numba has no types for these options.
_compile: Any = njit
F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile a function that Python may call."""
    result: F = _compile(**_OPTIONS, nogil=True)(function)
    return result


def kernel_step(function: F) -> F:
    """Compile a function that only kernels call: a call from Python would end the process.

    It has no wrapper for Python, which takes longer to compile than a function of many arrays.
    """
    result: F = _compile(**_OPTIONS, no_cpython_wrapper=True)(function)
    return result


def kernel_piece(function: F) -> F:
    """Compile a function as a part of the kernels that call it, which is for one call in each.

    A call hands over each array of its tuples, hundreds of numbers.
    """
    result: F = _compile(**_OPTIONS, no_cpython_wrapper=True, inline="always")(function)
    return result


def kernel_value(function: F) -> F:
    """Compile a small function of numbers as a part of the kernels that call it.

    So the compiler can keep what it returns, such as a tuple of nine numbers, in registers.
    """
    result: F = _compile(**_OPTIONS, no_cpython_wrapper=True, forceinline=True)(function)
    return result
