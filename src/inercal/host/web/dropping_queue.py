"""What waits to be sent: news stay until they are, pictures give way to later ones."""

from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")
_MAX_DROPPABLE = 64  # pictures that wait


class DroppingQueue(Generic[T]):
    """A queue in order, of which the oldest pictures are dropped where nobody takes them.

    Parameters
    ----------
    max_droppable : int
        Pictures that wait.
    """

    def __init__(self, max_droppable: int = _MAX_DROPPABLE):
        self._max_droppable, self._droppable_count = max_droppable, 0
        self._waiting: deque[tuple[bool, T]] = deque()

    def put(self, one: T, *, must_keep: bool) -> None:
        """Have something wait; what is not `sure` is a picture."""
        self._waiting.append((must_keep, one))
        self._droppable_count += not must_keep
        if self._droppable_count > self._max_droppable:
            oldest = next(i for i, (stays, _) in enumerate(self._waiting) if not stays)
            del self._waiting[oldest]
            self._droppable_count -= 1

    def take(self) -> T | None:
        """Return what has waited longest; None where nothing does."""
        if not self._waiting:
            return None
        must_keep, one = self._waiting.popleft()
        self._droppable_count -= not must_keep
        return one
