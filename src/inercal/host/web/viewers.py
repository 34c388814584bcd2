"""Manages the viewers and the operator, and orders the messages to viewers on slow links.

A viewer answers the mark `{"kind": "mark", "n": 7}` by `{"do": "seen", "n": 7}`. The server sends a
mark after each batch of messages, and it sends the next batch when the mark is answered. The
buffers of a slow link, whose sizes are unknown, therefore contain at most one batch. Urgent
messages do not wait for the mark. Batches become larger while marks are answered quickly.
"""

import asyncio
from collections import Counter, deque
from collections.abc import Iterator
from time import monotonic
from typing import NamedTuple

MAX_VIEWERS = 32  # viewers
OPERATOR_GRACE = 10.0  # s; the place of an operator is reserved for this time
_MAX_NAME = 40  # characters
_MIN_BATCH, _FIRST_BATCH, _MAX_BATCH = 1 << 11, 1 << 12, 1 << 17  # bytes
_BATCH_TIME = 1.0  # s; then a mark is sent even if the batch is not full
_FAST, _SLOW = 0.25, 1.0  # s until the answer to a mark
MAX_SAMPLES = 100  # largest number of waiting messages; about ten arrive per second

# Kinds of messages of which only the latest is relevant. Urgent messages do not wait for a mark.
_URGENT_LATEST_KINDS = frozenset(("people", "beat"))
_LATEST_KINDS = ("state", "estimates")
SAMPLE_KINDS = ("samples", "coarse")


class Client(NamedTuple):
    """A client to which places are assigned: an address, and a known browser at this address.

    All programs at an address that have no cookie from this server count as one client.
    """

    host: str
    browser: str | None


class Viewer:
    """One viewer of the page.

    Parameters
    ----------
    number : int
    browser : str or None
        Key of the browser, if the browser is already known.
    tab : str or None
        Key of the page in the browser. A page that reconnects sends the same key.
    client : Client, optional
        The client to which the place of the viewer is assigned.

    Attributes
    ----------
    stay : asyncio.Timeout
        Timeout that expires when the place is given to somebody else.
    """

    def __init__(
        self, number: int, browser: str | None, tab: str | None = None, client: Client | None = None
    ):
        self.number, self.browser, self.tab = number, browser, tab
        self.client = client or Client("", browser)
        self.stay = asyncio.Timeout(None)
        self._urgent: deque[tuple[str, str]] = deque()
        self._latest: dict[str, str] = {}
        self._news: deque[str] = deque()
        self._samples = {kind: deque[str](maxlen=MAX_SAMPLES) for kind in SAMPLE_KINDS}
        self._history: Iterator[str] = iter(())
        self._turn, self._samples_are_next = 0, False
        self._message_ready = asyncio.Event()
        self._batch, self._batch_size, self._batch_begun = 0, _FIRST_BATCH, 0.0
        self._mark = 0
        self._marked_at: float | None = None
        self._is_fast = False

    def send(self, kind: str, text: str, *, urgent: bool = True) -> None:
        """Queue a message.

        Parameters
        ----------
        kind : str
            A later message of the same kind replaces "state", "estimates", "people" and "beat", and
            old "samples" and "coarse". Messages of all other kinds are kept.
        text : str
        urgent : bool
            For the other kinds, whether the message is sent before bulk data.
        """
        if kind in _LATEST_KINDS:
            self._latest[kind] = text
        elif kind in SAMPLE_KINDS:
            self._samples[kind].append(text)
        elif kind in _URGENT_LATEST_KINDS:
            if kind not in self._latest:
                self._urgent.append((kind, ""))
            self._latest[kind] = text
        elif urgent:
            self._keep_in_order(kind)
            self._urgent.append((kind, text))
        else:
            self._news.append(text)
        self._message_ready.set()

    def send_history(self, texts: Iterator[str]) -> None:
        """Queue a history, which is only read and sent while nothing else is waiting."""
        self._history = texts
        self._message_ready.set()

    def acknowledge(self, mark: object) -> None:
        """Handle the reply to a mark. Replies that nobody waits for are ignored."""
        if self._marked_at is None or mark != self._mark:
            return
        took = monotonic() - self._marked_at
        self._marked_at, self._batch = None, 0
        if took <= _FAST:
            self._batch_size, self._is_fast = min(2 * self._batch_size, _MAX_BATCH), True
        elif took > _SLOW:
            self._batch_size, self._is_fast = max(self._batch_size // 2, _MIN_BATCH), False
        self._message_ready.set()

    async def next_message(self) -> str:
        """Wait for the next message to send, and return it."""
        while (text := self._take()) is None:
            self._message_ready.clear()
            await self._message_ready.wait()
        if not self._batch:
            self._batch_begun = monotonic()
        self._batch += len(text.encode())
        return text

    def _keep_in_order(self, kind: str) -> None:
        """Discard queued state messages that are older than an end or restart message."""
        if kind in ("plan", "idle"):
            self._news.clear()
            for samples in self._samples.values():
                samples.clear()
            for latest in _LATEST_KINDS:
                self._latest.pop(latest, None)
            self._history = iter(())
        elif kind in ("phase", "done") and (state := self._latest.pop("state", None)):
            self._urgent.append(("", state))

    def _take(self) -> str | None:
        if self._urgent:
            kind, text = self._urgent.popleft()
            return self._latest.pop(kind) if kind in _URGENT_LATEST_KINDS else text
        if self._marked_at is not None:
            return None  # the last batch is not yet acknowledged
        if self._batch and (
            self._batch >= self._batch_size or monotonic() - self._batch_begun >= _BATCH_TIME
        ):
            self._mark, self._marked_at = self._mark + 1, monotonic()
            return f'{{"kind": "mark", "n": {self._mark}}}'
        # Messages and history alternate, because on a slow link, the latest messages would leave no
        # room for the history.
        lanes = "state", "", "estimates", ""
        for _ in lanes:
            kind = lanes[self._turn]
            self._turn = (self._turn + 1) % len(lanes)
            text = self._latest.pop(kind, None) if kind else self._take_bulk()
            if text is not None:
                return text
        return None

    def _take_bulk(self) -> str | None:
        """Return the next event, or samples and history in turn; slow links get means."""
        if self._news:
            return self._news.popleft()
        kind, other = SAMPLE_KINDS if self._is_fast else reversed(SAMPLE_KINDS)
        self._samples[other].clear()
        samples = self._samples[kind]
        self._samples_are_next = not self._samples_are_next
        if samples and self._samples_are_next:
            return samples.popleft()
        text = next(self._history, None)
        return samples.popleft() if text is None and samples else text


class _Seat:
    """The operator's place: the name, the viewer, and the keys that identify a reconnection."""

    def __init__(self, name: str, viewer: Viewer):
        self.name, self.number = name, viewer.number
        self.browser, self.tab = viewer.browser, viewer.tab


class Viewers:
    """The viewers; one may operate, and keeps this place for a while when disconnected."""

    def __init__(self):
        self.viewers: dict[int, Viewer] = {}
        self._count = 0
        self._seat: _Seat | None = None
        self._left_at = 0.0

    def make_place(self, client: Client) -> bool:
        """Return whether a client gets a place; if necessary, a client with many loses a place.

        The operator's browser always gets a place, and the operator's page never loses its place.
        """
        if len(self.viewers) < MAX_VIEWERS:
            return True
        yielding = self._yielding(client)
        if yielding is None:
            return False
        self.remove_viewer(yielding)
        yielding.stay.reschedule(0)
        return True

    def _yielding(self, client: Client) -> Viewer | None:
        """Return the viewer that loses its place: the latest viewer of the client with the most.

        This client must still have more places afterwards, because otherwise two clients could
        alternate forever.
        """
        others = [one for one in self.viewers.values() if not self.is_operator(one)]
        hosts = Counter(one.client.host for one in others)
        clients = Counter(one.client for one in others)

        def places(one: Viewer) -> tuple[int, int, int]:
            return hosts[one.client.host], clients[one.client], one.number

        most = max(others, key=places)
        has_fewer = hosts[client.host] + 1 < hosts[most.client.host]
        if has_fewer or self.is_operator_browser(client.browser):
            return most
        neighbours = (one for one in others if one.client.host == client.host)
        most = max(neighbours, key=places, default=None)
        fewer = most is not None and clients[client] + 1 < clients[most.client]
        return most if fewer else None

    @property
    def operator(self) -> str | None:
        """The name of the operator, who may be temporarily disconnected."""
        return self._held_seat.name if self._held_seat is not None else None

    def add_viewer(
        self, browser: str | None, tab: str | None = None, client: Client | None = None
    ) -> Viewer:
        """Add a viewer; if an operator was briefly disconnected, they operate again.

        The operator's page gets its place back even if the loss of its previous connection has not
        been detected yet.
        """
        self._count += 1
        viewer = Viewer(self._count, browser, tab, client)
        self.viewers[viewer.number] = viewer
        seat = self._held_seat
        if seat is not None and self.is_operator_browser(browser):
            is_same_page = tab is not None and seat.tab == tab
            if is_same_page or seat.number not in self.viewers:
                self._seat = _Seat(seat.name, viewer)
        return viewer

    def remove_viewer(self, viewer: Viewer) -> None:
        """Remove a viewer."""
        self.viewers.pop(viewer.number, None)
        if self.is_operator(viewer):
            self._left_at = monotonic()

    def is_operator(self, viewer: Viewer) -> bool:
        """Return whether a viewer is the operator."""
        return self._seat is not None and self._seat.number == viewer.number

    def is_operator_browser(self, browser: str | None) -> bool:
        """Return whether a browser is the operator's browser."""
        seat = self._held_seat
        return seat is not None and browser is not None and seat.browser == browser

    def take_seat(self, viewer: Viewer, name: object) -> str | None:
        """Make a viewer the operator; if this is not possible, return the reason as text."""
        # The operator's browser gets the place at once, because its last connection may be broken.
        own = self.is_operator(viewer) or self.is_operator_browser(viewer.browser)
        seat = self._held_seat
        if seat is not None and not own:
            there = seat.number in self.viewers
            return f"{seat.name} operates" + ("" if there else ", and may be back")
        plain = " ".join(name.split()) if isinstance(name, str) else ""
        if not plain or len(plain) > _MAX_NAME or not plain.isprintable():
            return f"give a name of 1 to {_MAX_NAME} characters"
        self._seat = _Seat(plain, viewer)
        return None

    def leave_seat(self, viewer: Viewer) -> bool:
        """Free the operator's place if a viewer has it; return whether the viewer had it."""
        if not self.is_operator(viewer):
            return False
        self._seat = None
        return True

    @property
    def _held_seat(self) -> _Seat | None:
        """Return the operator's place, unless the operator has been gone for too long."""
        if self._seat is not None and self._seat.number not in self.viewers:
            return self._seat if monotonic() - self._left_at < OPERATOR_GRACE else None
        return self._seat
