"""Who looks on, and which of them operates."""

import asyncio
from time import monotonic

from inercal.host.web.dropping_queue import DroppingQueue
from inercal.host.web.publish import PICTURES

MOST = 32  # viewers
GONE = 10.0  # s that an operator's place is kept
_NAME = 40  # characters
_LATEST = frozenset(("people", "beat"))  # kinds of which only the latest counts


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
        self._lanes: DroppingQueue[tuple[str, str]] = DroppingQueue()
        self._latest: dict[str, str] = {}  # what waits, by kind
        self._news = asyncio.Event()

    def send(self, kind: str, text: str) -> None:
        """Have a message sent; pictures give way to later ones where it cannot be at once."""
        if kind in _LATEST:
            waits = kind in self._latest
            self._latest[kind] = text
            if waits:
                return  # at the place of the former
        self._lanes.put((kind, text), sure=kind not in PICTURES)
        self._news.set()

    async def next(self) -> str:
        """Return what is to be sent next, once there is something."""
        while (one := self._lanes.take()) is None:
            self._news.clear()
            await self._news.wait()
        kind, text = one
        return self._latest.pop(kind, text)


class Viewers:
    """Those who look on. One of them may operate, and whoever is gone keeps that for a while."""

    def __init__(self):
        self.viewers: dict[int, Viewer] = {}
        self._count = 0
        self._seat: tuple[str, int, str | None] | None = None  # name, viewer, browser
        self._gone = 0.0

    @property
    def full(self) -> bool:
        """Nobody else can look on."""
        return len(self.viewers) >= MOST

    @property
    def operator(self) -> str | None:
        """The name of who operates, or may still be back."""
        return self._kept[0] if self._kept is not None else None

    def come(self, browser: str | None) -> Viewer:
        """Take somebody in; an operator who was gone for a moment operates again."""
        self._count += 1
        viewer = Viewer(self._count, browser)
        self.viewers[viewer.number] = viewer
        seat = self._kept
        if seat is not None and seat[1] not in self.viewers and self.is_operators(browser):
            self._seat = seat[0], viewer.number, browser
        return viewer

    def go(self, viewer: Viewer) -> None:
        """Let somebody go."""
        self.viewers.pop(viewer.number, None)
        if self.operates(viewer):
            self._gone = monotonic()

    def operates(self, viewer: Viewer) -> bool:
        """Tell whether somebody is the operator."""
        return self._seat is not None and self._seat[1] == viewer.number

    def is_operators(self, browser: str | None) -> bool:
        """Tell whether a browser is that of the operator."""
        return self._kept is not None and browser is not None and self._kept[2] == browser

    def take_seat(self, viewer: Viewer, name: object) -> str | None:
        """Let somebody operate; return in words why not."""
        # To the operator's browser at once: its last connection may be broken and not known to be.
        own = self.operates(viewer) or self.is_operators(viewer.browser)
        if self._kept is not None and not own:
            there = self._kept[1] in self.viewers
            return f"{self._kept[0]} operates" + ("" if there else ", and may be back")
        plain = " ".join(name.split()) if isinstance(name, str) else ""
        if not plain or len(plain) > _NAME or not plain.isprintable():
            return f"give a name of 1 to {_NAME} characters"
        self._seat = plain, viewer.number, viewer.browser
        return None

    def leave_seat(self, viewer: Viewer) -> bool:
        """Let nobody operate, if that one did; tell whether it did."""
        if not self.operates(viewer):
            return False
        self._seat = None
        return True

    @property
    def _kept(self) -> tuple[str, int, str | None] | None:
        """The seat, unless who had it has been gone for too long."""
        if self._seat is not None and self._seat[1] not in self.viewers:
            return self._seat if monotonic() - self._gone < GONE else None
        return self._seat
