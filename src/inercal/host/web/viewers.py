"""Who looks on, and which of them operates."""

import asyncio
from time import monotonic

from inercal.host.web.dropping_queue import DroppingQueue
from inercal.host.web.publisher import DROPPABLE_KINDS

MAX_VIEWERS = 32  # viewers
OPERATOR_GRACE = 10.0  # s that an operator's place is kept
_MAX_NAME = 40  # characters
_LATEST_ONLY_KINDS = frozenset(("people", "beat"))  # kinds of which only the latest counts


class Viewer:
    """Somebody who looks on.

    Parameters
    ----------
    number : int
    browser : str or None
        Which browser it is, where that has said so before.
    """

    def __init__(self, number: int, browser: str | None):
        self.number, self.browser = number, browser
        self._queue: DroppingQueue[tuple[str, str]] = DroppingQueue()
        self._latest: dict[str, str] = {}  # what waits, by kind
        self._message_ready = asyncio.Event()

    def send(self, kind: str, text: str) -> None:
        """Have a message sent; pictures give way to later ones where it cannot be at once."""
        if kind in _LATEST_ONLY_KINDS:
            waits = kind in self._latest
            self._latest[kind] = text
            if waits:
                return  # at the place of the former
        self._queue.put((kind, text), must_keep=kind not in DROPPABLE_KINDS)
        self._message_ready.set()

    async def next_message(self) -> str:
        """Return what is to be sent next, once there is something."""
        while (one := self._queue.take()) is None:
            self._message_ready.clear()
            await self._message_ready.wait()
        kind, text = one
        return self._latest.pop(kind, text)


class Viewers:
    """Those who look on. One of them may operate, and whoever is gone keeps that for a while."""

    def __init__(self):
        self.viewers: dict[int, Viewer] = {}
        self._count = 0
        self._seat: tuple[str, int, str | None] | None = None  # name, viewer, browser
        self._left_at = 0.0

    @property
    def is_full(self) -> bool:
        """Nobody else can look on."""
        return len(self.viewers) >= MAX_VIEWERS

    @property
    def operator(self) -> str | None:
        """The name of who operates, or may still be back."""
        return self._held_seat[0] if self._held_seat is not None else None

    def add_viewer(self, browser: str | None) -> Viewer:
        """Take somebody in; an operator who was gone for a moment operates again."""
        self._count += 1
        viewer = Viewer(self._count, browser)
        self.viewers[viewer.number] = viewer
        seat = self._held_seat
        if seat is not None and seat[1] not in self.viewers and self.is_operator_browser(browser):
            self._seat = seat[0], viewer.number, browser
        return viewer

    def remove_viewer(self, viewer: Viewer) -> None:
        """Let somebody go."""
        self.viewers.pop(viewer.number, None)
        if self.is_operator(viewer):
            self._left_at = monotonic()

    def is_operator(self, viewer: Viewer) -> bool:
        """Tell whether somebody is the operator."""
        return self._seat is not None and self._seat[1] == viewer.number

    def is_operator_browser(self, browser: str | None) -> bool:
        """Tell whether a browser is that of the operator."""
        return self._held_seat is not None and browser is not None and self._held_seat[2] == browser

    def take_seat(self, viewer: Viewer, name: object) -> str | None:
        """Let somebody operate; return in words why not."""
        # To the operator's browser at once: its last connection may be broken and not known to be.
        own = self.is_operator(viewer) or self.is_operator_browser(viewer.browser)
        if self._held_seat is not None and not own:
            there = self._held_seat[1] in self.viewers
            return f"{self._held_seat[0]} operates" + ("" if there else ", and may be back")
        plain = " ".join(name.split()) if isinstance(name, str) else ""
        if not plain or len(plain) > _MAX_NAME or not plain.isprintable():
            return f"give a name of 1 to {_MAX_NAME} characters"
        self._seat = plain, viewer.number, viewer.browser
        return None

    def leave_seat(self, viewer: Viewer) -> bool:
        """Let nobody operate, if that one did; tell whether it did."""
        if not self.is_operator(viewer):
            return False
        self._seat = None
        return True

    @property
    def _held_seat(self) -> tuple[str, int, str | None] | None:
        """The seat, unless who had it has been gone for too long."""
        if self._seat is not None and self._seat[1] not in self.viewers:
            return self._seat if monotonic() - self._left_at < OPERATOR_GRACE else None
        return self._seat
