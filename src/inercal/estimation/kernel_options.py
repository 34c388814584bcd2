"""Decorators of kernels, such as those that compile sooner and call one another without overhead.

A kernel of the latter allocates nothing, and so counts no references to arrays: its caller
allocates what it works with. Only this module names options and parts of Numba that are not public;
the version of Numba is limited for their sake. All kernels take `njit` from here, which also
accepts kernels that another version of inercal has stored.
"""
# Numba has no types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false

from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any, TypeVar

from numba import njit
from numba.core import caching, event


class _IndexOfKernels(caching.IndexDataCacheFile):
    """An index that counts as empty where it names types that are now in another module."""

    def _load_index(self) -> dict[Any, str]:
        try:
            return super()._load_index()
        except (ImportError, AttributeError):  # while unpickling, before it is compared
            return {}


caching.IndexDataCacheFile = _IndexOfKernels

KERNEL_OPTIONS: dict[str, Any] = {
    "cache": True, "error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True,
}  # fmt: skip
INNER_OPTIONS: dict[str, Any] = {**KERNEL_OPTIONS, "no_cpython_wrapper": True}
"""Of a function that only kernels call: a call from Python would end the process."""
# Numba has no types for these options.
_compile: Any = njit
F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile a function that Python may call."""
    result: F = _compile(**KERNEL_OPTIONS, nogil=True)(function)
    return result


def kernel_step(function: F) -> F:
    """Compile a function that only kernels call: a call from Python would end the process.

    It has no wrapper for Python, which takes longer to compile than a function of many arrays.
    """
    result: F = _compile(**INNER_OPTIONS)(function)
    return result


def kernel_piece(function: F) -> F:
    """Compile a function as a part of the kernels that call it, which is for one call in each.

    A call hands over each array of its tuples, hundreds of numbers.
    """
    result: F = _compile(**INNER_OPTIONS, inline="always")(function)
    return result


def kernel_value(function: F) -> F:
    """Compile a small function of numbers as a part of the kernels that call it.

    So the compiler can keep what it returns, such as a tuple of nine numbers, in registers.
    """
    result: F = _compile(**INNER_OPTIONS, forceinline=True)(function)
    return result


class _CompilationListener(event.Listener):
    def __init__(self, begun: Callable[[], None]):
        self._begun: Callable[[], None] | None = begun

    def on_start(self, event: object) -> None:
        begun, self._begun = self._begun, None
        if begun is not None:
            begun()

    def on_end(self, event: object) -> None:
        pass


@contextmanager
def on_compilation(begun: Callable[[], None]) -> Generator[None]:
    """Call a function when the first kernel of the block is compiled rather than loaded."""
    listener = _CompilationListener(begun)
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
