"""A value that is computed at its first use and then stored."""

from collections.abc import Callable, Iterator, Mapping
from typing import Generic, TypeVar

T = TypeVar("T")
S = TypeVar("S")


class LazyValue(Generic[T]):
    """What a function returns, worked out at the first call.

    The function is let go then, and all data that it holds.
    """

    def __init__(self, work: Callable[[], T]) -> None:
        self._work: Callable[[], T] | None = work
        self._value: list[T] = []

    def __call__(self) -> T:
        """Return the value."""
        if self._work is not None:
            self._value.append(self._work())
            self._work = None
        return self._value[0]

    def then(self, change: Callable[[T], S]) -> "LazyValue[S]":
        """Return a function of the value, which is computed only when it is needed."""
        return LazyValue(lambda: change(self()))


class LazyMapping(Mapping[str, S]):
    """A mapping that a function returns, worked out when it is first read."""

    def __init__(self, work: Callable[[], Mapping[str, S]]) -> None:
        self._content = LazyValue(work)

    def __getitem__(self, name: str) -> S:
        return self._content()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._content())

    def __len__(self) -> int:
        return len(self._content())
