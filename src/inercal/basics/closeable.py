"""Closes connections, files and processes at the end of a `with` block, or after a failure."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Self


class Closeable:
    """A context manager that calls `close` at the end of its `with` block."""

    def close(self) -> None:
        """Close the resource."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def on_failure(undo: Callable[[], object], *kinds: type[BaseException]) -> Generator[None]:
    """Call `undo` if the block raises an error of these kinds; without kinds, any error."""
    caught = kinds or (BaseException,)
    try:
        yield
    except caught:
        undo()
        raise
