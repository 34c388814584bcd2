"""What a connection, a file and a process have in common: a context closes it."""

from typing import Self


class Closeable:
    """A context manager that calls `close` at the end of its context."""

    def close(self) -> None:
        """Close what is open."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
