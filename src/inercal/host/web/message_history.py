"""Sends a new viewer first the current state of a run, and then its history."""

import json
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from itertools import islice
from typing import Any, NamedTuple

from inercal.host.journal import utc_now
from inercal.host.web.viewers import MAX_SAMPLES, SAMPLE_KINDS

_MAX_ESTIMATES, _MAX_EVENTS, _MAX_TREND = 600, 500, 600
_GROUP_SIZE = 20  # number of events, or of points in the trend, in a message


class ReceivedMessage(NamedTuple):
    """A message of a run, and the time at which it arrived (ISO 8601, UTC)."""

    at: str
    content: dict[str, Any]


class MessageHistory:
    """The messages of one run that are still relevant, in the order of arrival.

    Parameters
    ----------
    keeps_trend : bool
        Whether to store the angles of the last states, which is needed for a manual session.
    """

    def __init__(self, *, keeps_trend: bool = False):
        self._keeps_trend = keeps_trend
        self._trend: deque[str] = deque(maxlen=_MAX_TREND)  # [time, angles, set angles]
        self._last: dict[str, str] = {}  # latest message of kinds without history
        self._received: dict[str, str] = {}  # time of the latest message of each kind
        self._phase_is_newest = False
        self._estimates: list[str] = []
        self._estimate_count, self._stride = 0, 1
        self._samples = {kind: deque[str](maxlen=MAX_SAMPLES) for kind in SAMPLE_KINDS}
        self._events: deque[tuple[bool, str]] = deque(maxlen=_MAX_EVENTS)

    def add_message(self, kind: str, text: str) -> None:
        """Store a message as long as it is relevant."""
        self._received[kind] = utc_now()
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
                if kind == "state" and self._keeps_trend:
                    self._trend.extend(_trend_point(text))

    def latest(self, kind: str) -> ReceivedMessage | None:
        """Return the latest message of a kind without history; None if there is none."""
        if kind not in self._last:
            return None
        return ReceivedMessage(self._received[kind], json.loads(self._last[kind]))

    def present(self) -> Generator[tuple[str, str]]:
        """Yield kind and text of messages with the current state and the latest samples."""
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
        """Yield the history; the messages that a viewer sees first come first."""
        yield from _grouped_messages("trend", "points", list(self._trend))
        calm = [text for alarm, text in self._events if not alarm]
        events = _grouped_messages("events", "events", calm)
        estimates = list(self._estimates)
        yield from islice(events, 1)
        for k in coarse_to_fine(len(estimates)):
            yield estimates[k]
        yield from events

    def _thin(self, text: str) -> None:
        """Reduce the stored estimates to a subset that is evenly distributed over the run."""
        if self._estimate_count % self._stride == 0:
            self._estimates.append(text)
        self._estimate_count += 1
        if len(self._estimates) >= _MAX_ESTIMATES:
            self._estimates = self._estimates[::2]
            self._stride *= 2


def is_alarm(event: str) -> bool:
    """Return whether an event message is an alarm."""
    return json.loads(event).get("level") == "alarm"


def coarse_to_fine(count: int) -> Generator[int]:
    """Yield 0 … count − 1 in an order in which the first numbers always cover the range evenly.

    >>> list(coarse_to_fine(6))
    [0, 4, 2, 1, 3, 5]
    """
    if count:
        yield 0
    step = 1 << max(count - 1, 0).bit_length()
    while step > 1:
        yield from range(step // 2, count, step)
        step //= 2


def _grouped_messages(kind: str, key: str, texts: Sequence[str]) -> Iterator[str]:
    """Yield messages with several texts each; the newest comes first."""
    for end in range(len(texts), 0, -_GROUP_SIZE):
        some = ", ".join(texts[max(end - _GROUP_SIZE, 0) : end])
        yield f'{{"kind": "{kind}", "{key}": [{some}]}}'


def _trend_point(state: str) -> Iterator[str]:
    """Yield time, angles and set angles from the state of a manual session, if known."""
    told = json.loads(state)
    if told["table"] is not None:
        angles = [axis["angle"] for axis in told["table"]["axes"]]
        yield json.dumps([told["time"], angles, [axis["set"] for axis in told["manual"]]])
