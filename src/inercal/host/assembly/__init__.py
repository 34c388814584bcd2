"""Frames of the log put together: samples of the IMU with the table's angles at their times.

The IMU's time is its own counter's, the table's its controller's. Both are tied to the host's clock
by the least difference to the time of arrival in the first seconds: what is left is the bench's
latency. Arrivals serve for nothing else but to tell, after an outage, how often a counter has begun
again meanwhile.

The same frames give the same samples to the last bit, however often `take` is called.

Events are JSON objects by their `what`. "session": a host attached; `next` is the first step that
is to be done (anew), `wraps` the s after which the table's clock begins again, null or left out if
never. "section": `number`, `label`, `state` "begun", "done" or "void", `time` by the table's clock,
and whether it is a `hold`. Others are of no matter here.
"""

import json
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches.turntable import turntable_of
from inercal.benches.turntable.epochs import settling
from inercal.data.load import readback_units
from inercal.errors import InputError
from inercal.host.assembly.imu import Imu, LeftOut, Samples
from inercal.host.assembly.polls import Table
from inercal.host.assembly.sections import Sections, Span
from inercal.host.log import EVENT, IMU, TABLE, Frame
from inercal.host.packets import Counts, Layout
from inercal.recording import Track
from inercal.runfile import Run

_APART = 0.5  # s without a sample that end a hold


class Block(NamedTuple):
    """Samples, as a recording holds them.

    Parameters
    ----------
    time : (n,) array
        s by the IMU's clock, from the recording's first sample on.
    output : (n, m) array
        In output units of the sensor's axes.
    reading : (n, m) array
        The same in SI.
    said : (n, k) array
        Angles in units of the readback's columns.
    angles : (n, k) array
        The same in rad.
    hold : (n,) array of int
        Number of the hold; −1 elsewhere.
    temperature : (n,) array
        K; NaN where there is none.
    table : (n,) array
        s by the table's clock.
    begins : bool
        The recording begins with this block: what came before is void.
    """

    time: Array
    output: Array
    reading: Array
    said: Array
    angles: Array
    hold: NDArray[np.int64]
    temperature: Array
    table: Array
    begins: bool

    @property
    def track(self) -> Track:
        """What a sequential estimator follows."""
        return Track(self.time, self.reading, self.angles, self.hold)


@dataclass(frozen=True)
class Tally:
    """What became of what came.

    Parameters
    ----------
    samples : int
        Given out, since the recording began.
    bytes : Counts
        Of the IMU's bytes, all sessions together.
    left_out : LeftOut
        Packets that are no samples.
    no_angle : int
        Samples where the table's angles are not known.
    polls_left_out : int
        Polls whose time is not later than that before.
    """

    samples: int
    bytes: Counts
    left_out: LeftOut
    no_angle: int
    polls_left_out: int


class Assembly:
    """Puts a run's frames together.

    Parameters
    ----------
    run : Run
        On a turntable.
    layout : Layout
        Of the IMU's packets.
    poll : float
        s between polls of the table.

    Raises
    ------
    InputError
        No turntable or no rate; packets without counter and time, of another rate, or without an
        axis of the sensor.
    """

    def __init__(self, run: Run, layout: Layout, poll: float = 0.02):
        bench = turntable_of(run)
        if run.rate_hz is None:
            raise InputError(f'{run.path}: [data] rate is missing, such as "200 Hz"')
        self.sensor = run.sensor
        self._imu, self._table = Imu(run.sensor, layout, run.rate_hz), Table(poll)
        self._settling = settling(bench)
        self._sections = Sections(self._settling)
        # SI size of a unit of each axis' column in the recording; negative reverses.
        sizes = readback_units(run)
        self._units = np.array([sizes[name] for name in bench.names])
        self._pending: list[Frame] = []
        self._attempt: int = 0
        self._fresh()

    @property
    def sections(self) -> tuple[Span, ...]:
        """The sections so far, by the table's clock."""
        return tuple(replace(one) for one in self._sections.all)

    @property
    def tally(self) -> Tally:
        """What became of all that was worked through."""
        imu = self._imu
        return Tally(
            self._count, imu.counts, replace(imu.left_out), self._no_angle, self._table.left_out
        )

    @property
    def offset(self) -> float | None:
        """The IMU's clock minus the table's, s, as arrival has it; None while it is not known."""
        if self._imu.offset is None or self._table.offset is None:
            return None
        return self._table.offset - self._imu.offset

    def feed(self, frame: Frame) -> None:
        """Put a frame to those to be worked through."""
        self._pending.append(frame)

    def take(self) -> Block | None:
        """Return the samples that what was fed completes; None where there are none.

        Raises
        ------
        InputError
            A frame that is none of a run, or a device that set its clock anew.
        """
        pending, self._pending = self._pending, []
        for kind, group in groupby(_sorted(pending), key=lambda one: one.kind):
            frames = list(group)
            if kind == IMU:
                self._imu.feed(frames)
            elif kind == TABLE:
                self._table.feed(frames)
            else:
                for frame in frames:
                    self._event(frame)
        return self._block()

    def labels(self, table: Array) -> NDArray[np.str_]:
        """Return what samples of `Block.table` are called, (n,): "" beside and in void sections."""
        return self._sections.labels(table)

    def _event(self, frame: Frame) -> None:
        event = _read(frame)
        if event.get("what") == "section":
            self._sections.tell(event, self._table.turns)
        elif event.get("what") == "session":
            self._sections.session(int(event.get("next", 0)), self._table.last)
            self._imu.session()
            wraps = event.get("wraps")
            self._table.session(np.inf if wraps is None else float(wraps))

    def _fresh(self) -> None:
        """Begin a recording."""
        self._first: float | None = None  # tick
        self._count, self._holds, self._no_angle = 0, 0, 0
        self._before = (-1, -np.inf)  # section and time of the last sample in a hold

    def _block(self) -> Block | None:
        offset, known, imu = self.offset, self._table.known, self._imu
        if offset is None or known is None or known.time.size < 3:
            return None
        if self._sections.attempt != self._attempt:
            self._attempt = self._sections.attempt
            self._fresh()
        samples = self._ready(float(known.time[-2]) - self._settling, offset)
        if samples is None:
            return None
        table = samples.ticks / imu.per_second - offset
        late = table >= self._sections.start
        angles, there = self._table.angles(table)
        self._table.forget(float(table[-1]))
        self._no_angle += int(np.sum(late & ~there))
        kept = late & there
        if not kept.any():
            return None
        if not kept.all():
            samples, table, angles = samples.where(kept), table[kept], angles[kept]
        begins = self._first is None
        if self._first is None:
            self._first = float(samples.ticks[0])
        self._count += table.size
        said = angles / self._units
        time = (samples.ticks - self._first) / imu.per_second
        return Block(
            time,
            samples.output,
            self.sensor.to_si(samples.output),
            said,
            said * self._units,
            self._numbers(table, time),
            samples.temperature,
            table,
            begins,
        )

    def _ready(self, until: float, offset: float) -> Samples | None:
        """Return the samples of before a time of the table; those behind wait on."""
        waiting, imu = self._imu.waiting, self._imu
        if not waiting:
            return None
        whole = Samples._make(map(np.concatenate, zip(*waiting, strict=True)))
        n = int(np.searchsorted(whole.ticks / imu.per_second - offset, until))
        imu.waiting = [whole.where(slice(n, None))] if n < whole.ticks.size else []
        return whole.where(slice(0, n)) if n else None

    def _numbers(self, table: Array, time: Array) -> NDArray[np.int64]:
        """Return the number of the hold of each sample."""
        section = self._sections.holding(table)
        held = np.flatnonzero(section >= 0)
        number = np.full(table.size, -1, np.int64)
        if held.size:
            which, when = section[held], time[held]
            before = np.concatenate([[self._before[0]], which[:-1]])
            apart = when - np.concatenate([[self._before[1]], when[:-1]])
            number[held] = self._holds - 1 + np.cumsum((which != before) | (apart > _APART))
            self._holds = int(number[held[-1]]) + 1
            self._before = int(which[-1]), float(when[-1])
        return number


def _sorted(frames: list[Frame]) -> list[Frame]:
    """Return frames by kind between events, so that many of one kind are worked through at once."""
    made: list[Frame] = []
    for _, group in groupby(frames, key=lambda one: one.kind == EVENT):
        made += sorted(group, key=lambda one: one.kind)
    return made


def _read(frame: Frame) -> dict[str, Any]:
    try:
        event: Any = json.loads(frame.payload)
        return dict(event)
    except (TypeError, ValueError):
        raise InputError(
            f"an event of the log at {frame.time:.6g} s is none: {frame.payload!r}"
        ) from None


__all__ = ["Assembly", "Block", "LeftOut", "Span", "Tally"]
