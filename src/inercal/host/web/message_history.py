"""What somebody who comes late is told of a run: all that a page shows of it."""

from collections import deque
from collections.abc import Generator

_MAX_ESTIMATES, _MAX_EVENTS = 600, 500
_MAX_SAMPLES = 100  # messages: some ten a second


class MessageHistory:
    """The messages of one run that still count, as they came."""

    def __init__(self):
        self._last: dict[str, str] = {}  # by kind, of which only the latest counts
        self._phase_is_newest = False
        self._estimates: list[str] = []
        self._estimate_count, self._stride = 0, 1
        self._samples: deque[str] = deque(maxlen=_MAX_SAMPLES)
        self._events: deque[str] = deque(maxlen=_MAX_EVENTS)

    def add_message(self, kind: str, text: str) -> None:
        """Keep a message in so far as it counts."""
        match kind:
            case "samples":
                self._samples.append(text)
            case "event":
                self._events.append(text)
            case "estimates":
                self._thin(text)
                self._last[kind] = text
            case _:
                self._last[kind] = text
                if kind in ("phase", "state"):
                    self._phase_is_newest = kind == "phase"

    def messages(self) -> Generator[str]:
        """Yield what is kept, in the order in which a page can take it."""
        news = self._phase_is_newest
        yield from self._latest("plan") if news else self._latest("plan", "phase")
        yield from self._estimates
        if self._estimates and self._last["estimates"] != self._estimates[-1]:
            yield self._last["estimates"]
        yield from self._samples
        yield from self._events
        yield from self._latest("state", "phase", "done") if news else self._latest("state", "done")

    def _latest(self, *kinds: str) -> list[str]:
        return [self._last[kind] for kind in kinds if kind in self._last]

    def _thin(self, text: str) -> None:
        """Keep every so many estimates, evenly over the run."""
        if self._estimate_count % self._stride == 0:
            self._estimates.append(text)
        self._estimate_count += 1
        if len(self._estimates) >= _MAX_ESTIMATES:
            self._estimates = self._estimates[::2]
            self._stride *= 2
