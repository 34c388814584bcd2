"""Compute values when they are first used, and then store them."""

from collections.abc import Callable, Iterator, Mapping
from typing import Generic, TypeVar

T = TypeVar("T")
S = TypeVar("S")


class LazyValue(Generic[T]):
    """The return value of a function that runs only when the value is first requested.

    The function and the data that it refers to are released afterwards.
    """

    def __init__(self, work: Callable[[], T]) -> None:
        self._work: Callable[[], T] | None = work
        self._value: list[T] = []

    def __call__(self) -> T:
        """Return the value, computing it at the first call."""
        if self._work is not None:
            self._value.append(self._work())
            self._work = None
        return self._value[0]

    def then(self, change: Callable[[T], S]) -> "LazyValue[S]":
        """Return a lazy value that applies a function to this one when it is needed."""
        return LazyValue(lambda: change(self()))


class LazyMapping(Mapping[str, S]):
    """A mapping returned by a function that runs only when the mapping is first read."""

    def __init__(self, work: Callable[[], Mapping[str, S]]) -> None:
        self._content = LazyValue(work)

    def __getitem__(self, name: str) -> S:
        return self._content()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._content())

    def __len__(self) -> int:
        return len(self._content())
