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
from inercal.host.assembly import SampleBlock
from inercal.host.bench_run import BenchRun
from inercal.host.journal import Journal
from inercal.host.live_estimator import LiveEstimator
from inercal.host.web import page_messages
from inercal.host.web.publisher import Publisher
from inercal.runfile import Run

UPDATE_INTERVAL = 0.1  # s of the wall's between two looks at the run
_ESTIMATE_INTERVAL = 0.5  # s of the wall's
_DISPLAY_RATE, _MAX_DISPLAY_RATE = (
    250.0,
    300.0,
)  # samples a second of the wall's; as many before means are taken
_INNOVATION_WINDOW = 30.0  # s of the recording over which innovations are judged
_MAX_EVENTS = 500  # of a run that goes on after an interruption


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
        self._unit_sizes = np.array([sensor.coefficient(name).si for name in sensor.coefficients])
        self._published_events = max(0, len(journal.events()) - _MAX_EVENTS)
        self._angles: Array | None = None
        self._remainder: tuple[Array, Array] | None = None  # samples that make no whole mean yet
        self._samples_published_at = self._estimates_published_at = monotonic()
        self._estimates_time: float = nan
        self._innovations: deque[tuple[float, dict[str, tuple[float, int]]]] = deque()

    def __call__(self, run: BenchRun) -> None:
        """Tell what is new."""
        self.publish_events()
        blocks: list[SampleBlock] = []
        while run.recorder.blocks:
            blocks.append(run.recorder.blocks.popleft())
        if blocks:
            self._angles = blocks[-1].angles[-1]
            self._publish_samples(blocks)
        if (live := run.recorder.live_estimator) is not None and live.has_estimate:
            self._record_innovations(live)
            if (
                monotonic() - self._estimates_published_at >= _ESTIMATE_INTERVAL
                or run.sequencer.is_over
            ):
                self._publish_estimates(live)
        self._publisher.publish(
            "state", **page_messages.state_message(run, self._bench, self._angles)
        )

    def publish_events(self) -> None:
        """Tell what the journal has heard."""
        for event in self._journal.events(self._published_events):
            self._published_events += 1
            self._publisher.publish(
                "event", at=event.at, time=event.time, level=event.level, words=event.words
            )

    def _publish_samples(self, blocks: Sequence[SampleBlock]) -> None:
        first = next((i for i in reversed(range(len(blocks))) if blocks[i].starts_recording), None)
        if first is not None:  # what was before is void
            self._remainder, blocks = None, blocks[first:]
        time = np.concatenate([one.time for one in blocks])
        output = np.concatenate([one.output for one in blocks])
        now = monotonic()
        a_second = time.size / max(now - self._samples_published_at, UPDATE_INTERVAL)
        self._samples_published_at = now
        k = 1 if a_second <= _MAX_DISPLAY_RATE else ceil(a_second / _DISPLAY_RATE)
        if self._remainder is not None:
            time = np.concatenate([self._remainder[0], time])
            output = np.concatenate([self._remainder[1], output])
        n = time.size // k
        self._remainder = time[n * k :], output[n * k :]
        if n:
            time = time[: n * k].reshape(n, k).mean(axis=1)
            output = output[: n * k].reshape(n, k, -1).mean(axis=1)
            self._publisher.publish("samples", **page_messages.samples_message(time, output, k))

    def _record_innovations(self, live: LiveEstimator) -> None:
        """Keep how large innovations were, over a window."""
        kept = self._innovations
        if kept and kept[-1][0] > live.time:  # the recording begins anew
            kept.clear()
        if not kept or live.time - kept[-1][0] >= _INNOVATION_WINDOW / 60:
            kept.append((live.time, live.innovations))
        while len(kept) > 1 and kept[1][0] <= live.time - _INNOVATION_WINDOW:
            kept.popleft()

    def _nis(self, live: LiveEstimator) -> dict[str, float | None]:
        """Return innovations squared over what was stated, a component, within the window."""
        before = self._innovations[0][1] if len(self._innovations) > 1 else {}
        result: dict[str, float | None] = {}
        for kind, (squares, count) in live.innovations.items():
            s, n = before.get(kind, (0.0, 0))
            result[kind] = (
                page_messages.rounded_number((squares - s) / (count - n), 4) if count > n else None
            )
        return result

    def _publish_estimates(self, live: LiveEstimator) -> None:
        if live.time == self._estimates_time:
            return
        self._estimates_published_at, self._estimates_time = monotonic(), live.time
        self._publisher.publish(
            "estimates",
            time=page_messages.rounded_number(live.time),
            values=page_messages.rounded_numbers(live.values / self._unit_sizes),
            u2=page_messages.rounded_numbers(2 * live.std / self._unit_sizes),
            nis=self._nis(live),
        )
