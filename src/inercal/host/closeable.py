"""A base class for connections, files and processes that are closed at the end of a context."""

from typing import Self


class Closeable:
    """A context manager that calls `close` at the end of its context."""

    def close(self) -> None:
        """Close the resource."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
