"""Tells the page of a run what has become of it since it was last told.

A sample that is shown is a mean of several where a bench is sped up: more than some hundreds a
second of the wall's no page can draw.
"""

from collections import deque
from collections.abc import Sequence
from math import ceil, nan
from time import monotonic

import numpy as np

from inercal.arrays import Array
from inercal.benches.turntable.bench import Turntable
from inercal.host.assembly import Block
from inercal.host.journal import Journal
from inercal.host.live import Live
from inercal.host.run import BenchRun
from inercal.host.web import pictures
from inercal.host.web.publish import Publisher
from inercal.runfile import Run

EVERY = 0.1  # s of the wall's between two looks at the run
_ESTIMATES = 0.5  # s of the wall's
_SHOWN, _ALLOWED = 250.0, 300.0  # samples a second of the wall's; as many before means are taken
_WINDOW = 30.0  # s of the recording over which innovations are judged
_EVENTS = 500  # of a run that goes on after an interruption


class RunTelemetry:
    """Tells of one run; called with it now and then.

    Parameters
    ----------
    publisher : Publisher
    run : Run
        Its run file.
    bench : Turntable
    journal : Journal
    """

    def __init__(self, publisher: Publisher, run: Run, bench: Turntable, journal: Journal):
        self._publisher, self._bench, self._journal = publisher, bench, journal
        sensor = run.sensor
        self._sizes = np.array([sensor.coefficient(name).si for name in sensor.coefficients])
        self._told = max(0, len(journal.events()) - _EVENTS)
        self._angles: Array | None = None
        self._left: tuple[Array, Array] | None = None  # samples that make no whole mean yet
        self._sampled = self._estimated = monotonic()
        self._estimates_of: float = nan
        self._innovations: deque[tuple[float, dict[str, tuple[float, int]]]] = deque()

    def __call__(self, run: BenchRun) -> None:
        """Tell what is new."""
        self.events()
        blocks: list[Block] = []
        while run.account.blocks:
            blocks.append(run.account.blocks.popleft())
        if blocks:
            self._angles = blocks[-1].angles[-1]
            self._samples(blocks)
        if (live := run.account.live) is not None and live.begun:
            self._judge(live)
            if monotonic() - self._estimated >= _ESTIMATES or run.sequencer.over:
                self._estimates(live)
        self._publisher.tell("state", **pictures.state(run, self._bench, self._angles))

    def events(self) -> None:
        """Tell what the journal has heard."""
        for event in self._journal.events(self._told):
            self._told += 1
            self._publisher.tell(
                "event", at=event.at, time=event.time, level=event.level, words=event.words
            )

    def _samples(self, blocks: Sequence[Block]) -> None:
        first = next((i for i in reversed(range(len(blocks))) if blocks[i].begins), None)
        if first is not None:  # what was before is void
            self._left, blocks = None, blocks[first:]
        time = np.concatenate([one.time for one in blocks])
        output = np.concatenate([one.output for one in blocks])
        now = monotonic()
        a_second = time.size / max(now - self._sampled, EVERY)
        self._sampled = now
        k = 1 if a_second <= _ALLOWED else ceil(a_second / _SHOWN)
        if self._left is not None:
            time = np.concatenate([self._left[0], time])
            output = np.concatenate([self._left[1], output])
        n = time.size // k
        self._left = time[n * k :], output[n * k :]
        if n:
            time = time[: n * k].reshape(n, k).mean(axis=1)
            output = output[: n * k].reshape(n, k, -1).mean(axis=1)
            self._publisher.tell("samples", **pictures.samples(time, output, k))

    def _judge(self, live: Live) -> None:
        """Keep how large innovations were, over a window."""
        kept = self._innovations
        if kept and kept[-1][0] > live.time:  # the recording begins anew
            kept.clear()
        if not kept or live.time - kept[-1][0] >= _WINDOW / 60:
            kept.append((live.time, live.innovations))
        while len(kept) > 1 and kept[1][0] <= live.time - _WINDOW:
            kept.popleft()

    def _nis(self, live: Live) -> dict[str, float | None]:
        """Return innovations squared over what was stated, a component, within the window."""
        before = self._innovations[0][1] if len(self._innovations) > 1 else {}
        made: dict[str, float | None] = {}
        for kind, (squares, count) in live.innovations.items():
            s, n = before.get(kind, (0.0, 0))
            made[kind] = pictures.number((squares - s) / (count - n), 4) if count > n else None
        return made

    def _estimates(self, live: Live) -> None:
        if live.time == self._estimates_of:
            return
        self._estimated, self._estimates_of = monotonic(), live.time
        self._publisher.tell(
            "estimates",
            time=pictures.number(live.time),
            values=pictures.numbers(live.values / self._sizes),
            u2=pictures.numbers(2 * live.std / self._sizes),
            nis=self._nis(live),
        )
