"""What somebody who comes late is told of a run: how it stands first, then what was before."""

import json
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from itertools import islice

_MAX_ESTIMATES, _MAX_EVENTS = 600, 500
_MAX_SAMPLES = 100  # messages: some ten a second
_EVENTS_TOLD = 20  # in one message


class MessageHistory:
    """The messages of one run that still count, as they came."""

    def __init__(self):
        self._last: dict[str, str] = {}  # by kind, of which only the latest counts
        self._phase_is_newest = False
        self._estimates: list[str] = []
        self._estimate_count, self._stride = 0, 1
        self._samples = {kind: deque[str](maxlen=_MAX_SAMPLES) for kind in ("samples", "coarse")}
        self._events: deque[tuple[bool, str]] = deque(maxlen=_MAX_EVENTS)

    def add_message(self, kind: str, text: str) -> None:
        """Keep a message in so far as it counts."""
        match kind:
            case "samples" | "coarse":
                self._samples[kind].append(text)
            case "event":
                self._events.append((is_alarm(text), text))
            case "estimates":
                self._thin(text)
                self._last[kind] = text
            case _:
                self._last[kind] = text
                if kind in ("phase", "state"):
                    self._phase_is_newest = kind == "phase"

    def present(self) -> Generator[tuple[str, str]]:
        """Yield kinds and texts of how the run stands and of the last seconds' samples."""
        order = ("state", "phase") if self._phase_is_newest else ("phase", "state")
        for kind in ("plan", *order, "done"):
            if kind in self._last:
                yield kind, self._last[kind]
        for alarm, text in self._events:
            if alarm:
                yield "alarm", text
        if "estimates" in self._last:
            yield "estimates", self._last["estimates"]
        for kind, texts in self._samples.items():
            for text in texts:
                yield kind, text

    def past(self) -> Generator[str]:
        """Yield what was before, what is seen at once first."""
        events = _event_messages([text for alarm, text in self._events if not alarm])
        estimates = list(self._estimates)
        yield from islice(events, 1)
        for k in coarse_to_fine(len(estimates)):
            yield estimates[k]
        yield from events

    def _thin(self, text: str) -> None:
        """Keep every so many estimates, evenly over the run."""
        if self._estimate_count % self._stride == 0:
            self._estimates.append(text)
        self._estimate_count += 1
        if len(self._estimates) >= _MAX_ESTIMATES:
            self._estimates = self._estimates[::2]
            self._stride *= 2


def is_alarm(event: str) -> bool:
    """Tell whether an event, as its message, is an alarm."""
    return json.loads(event).get("level") == "alarm"


def coarse_to_fine(count: int) -> Generator[int]:
    """Yield 0 … count − 1 so that what was yielded covers the whole range evenly at any time.

    >>> list(coarse_to_fine(6))
    [0, 4, 2, 1, 3, 5]
    """
    if count:
        yield 0
    step = 1 << max(count - 1, 0).bit_length()
    while step > 1:
        yield from range(step // 2, count, step)
        step //= 2


def _event_messages(texts: Sequence[str]) -> Iterator[str]:
    """Yield messages of many events each, the newest first."""
    for end in range(len(texts), 0, -_EVENTS_TOLD):
        some = ", ".join(texts[max(end - _EVENTS_TOLD, 0) : end])
        yield f'{{"kind": "events", "events": [{some}]}}'
