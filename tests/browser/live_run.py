"""A run in the server's own process, as large as a real one, that goes on until it is ended."""

import asyncio
import json
from collections.abc import AsyncGenerator
from contextlib import suppress
from math import floor
from time import monotonic
from typing import Any

from tests.browser import messages

from inercal.host.web.run_request import RunProcess, RunRequest

PAST = 100.0  # s of the run before anybody looks on
_INTERVAL = 0.1  # s between two looks at the run, as of a real one
_COARSE = 20  # samples of which a mean is told to a slow link


class LiveRun(RunProcess):
    """What a run tells: 100 s of past at once, then at its own pace."""

    def __init__(self, order: RunRequest):
        self.order = order
        self.commands: list[str] = []
        self._told: asyncio.Queue[messages.Message | None] = asyncio.Queue()
        self._loop = asyncio.get_running_loop()

    def tell(self, *told: messages.Message) -> None:
        """Have something told; behind an end nothing more is."""
        for one in told:
            self._loop.call_soon_threadsafe(self._told.put_nowait, one)
            if one["kind"] == "done":
                self._loop.call_soon_threadsafe(self._told.put_nowait, None)

    def send_line(self, line: str) -> bool:
        """Keep a command."""
        self.commands.append(line)
        return True

    def stop(self) -> None:
        """Come to an end."""
        stopped = {"state": "interrupted", "words": "stopped by the operator", "verdict": None}
        self.tell(messages.done(**stopped, report=None, calibration=None))

    async def messages(self) -> AsyncGenerator[tuple[str, str]]:
        """Yield what there was, then what comes."""
        begun = monotonic() - PAST
        for one in _past():
            yield one["kind"], json.dumps(one)
        until = PAST
        while True:
            one: messages.Message | None = {}
            with suppress(TimeoutError):
                one = await asyncio.wait_for(self._told.get(), _INTERVAL)
            if one is None:
                return
            if one:
                yield one["kind"], json.dumps(one)
                continue
            now = monotonic() - begun
            for piece in _pieces(until, now):
                yield piece["kind"], json.dumps(piece)
            until = now

    async def wait_for_exit(self) -> int:
        """Return the status."""
        return 0


def means(fine: messages.Message) -> messages.Message:
    """Return samples as a slow link is told them."""
    n = len(fine["t"]) // _COARSE

    def mean(row: list[float]) -> list[float]:
        return [round(sum(row[i * _COARSE : (i + 1) * _COARSE]) / _COARSE, 6) for i in range(n)]

    y = [mean(row) for row in fine["y"]]
    return {"kind": "coarse", "t": mean(fine["t"]), "y": y, "every": _COARSE}


def _past() -> list[messages.Message]:
    told: list[messages.Message] = [messages.plan()]
    told += [messages.estimates(PAST * k / 200) for k in range(1, 201)]
    for begin in range(int(PAST) - 10, int(PAST)):
        fine = messages.samples(begin, begin + 1)
        told += [means(fine), fine]
    told.append(messages.event(6.0, "axis inner: following error", "alarm"))
    told += [messages.event(4.0 + k, f"event {k}") for k in range(90)]
    told.append(messages.state(PAST))
    return told


def _pieces(begin: float, end: float) -> list[messages.Message]:
    """Return the messages of a piece of the run, s."""
    told: list[Any] = []
    if floor(2 * end) > floor(2 * begin):  # twice a second, as a host works
        half = floor(2 * end) / 2
        fine = messages.samples(half - 0.5, half)
        told += [means(fine), fine, messages.estimates(half)]
    return [*told, messages.state(round(end, 3))]
