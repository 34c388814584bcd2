"""What waits to be sent: news stay until they are, pictures give way to later ones."""

from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")
_MOST = 64  # pictures that wait


class DroppingQueue(Generic[T]):
    """A queue in order, of which the oldest pictures are dropped where nobody takes them.

    Parameters
    ----------
    most : int
        Pictures that wait.
    """

    def __init__(self, most: int = _MOST):
        self._most, self._pictures = most, 0
        self._waiting: deque[tuple[bool, T]] = deque()

    def put(self, one: T, *, sure: bool) -> None:
        """Have something wait; what is not `sure` is a picture."""
        self._waiting.append((sure, one))
        self._pictures += not sure
        if self._pictures > self._most:
            oldest = next(i for i, (stays, _) in enumerate(self._waiting) if not stays)
            del self._waiting[oldest]
            self._pictures -= 1

    def take(self) -> T | None:
        """Return what has waited longest; None where nothing does."""
        if not self._waiting:
            return None
        sure, one = self._waiting.popleft()
        self._pictures -= not sure
        return one
