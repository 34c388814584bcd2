"""The log of a run without any device: a table's way as polls, and packets of an IMU that felt it.

The bench's clock is the host's. The IMU's counter and the table's servo clock begin where they
like, go at their own rates and come round; what arrives, arrives somewhat later.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil, inf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inercal.benches.turntable.attitude import ideal_readback, motion
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.simulation import PathProfile, path_profile
from inercal.host.drivers.rotary_table import AxisState, TableState, pack_state
from inercal.host.packets import PacketLayout, encode, read_layout
from inercal.host.run_log import EVENT, IMU, TABLE, LogFrame, RunLog
from inercal.physics.plan import Position, Rotation
from inercal.runfile import Run, read

Array = NDArray[np.float64]
LAYOUT = read_layout("fixed")
EXAMPLE = Path(__file__).parents[2] / "examples" / "turntable"
PATH = """label,kind,outer [°],middle [°],inner [°],seconds [s],axis,angle [°],rate [°/s]
warm-up,position,0,0,0,24,,,
up,position,0,90,0,4,,,
slanted,position,90,45,0,4,,,
y+,rotation,0,0,0,,inner,360,30
rest,position,0,0,0,4,,,
"""


def run_file(folder: Path, path: str | None = None, **changes: str) -> Run:
    """Return the run of the example on a bench, written to a folder; changes are by whole line."""
    text = (EXAMPLE / "mimu.toml").read_text(encoding="utf-8")
    changes = {
        'file = "mimu.csv"': 'file = "mimu.h5"\nhold = "hold"',
        'rate = "100 Hz"': 'rate = "200 Hz"',
    } | changes
    for before, after in changes.items():
        assert before in text, before
        text = text.replace(before, after)
    given = (EXAMPLE / "path.csv").read_text(encoding="utf-8") if path is None else path
    (folder / "path.csv").write_text(given, encoding="utf-8")
    (folder / "mimu.toml").write_text(text, encoding="utf-8")
    return read(folder / "mimu.toml")


@dataclass
class Faults:
    """What goes wrong with the packets, by share of them; and from when to when the host is away.

    An outage begins in a hold, which is then repeated; `silent` is the IMU alone.
    """

    lost: float = 0.0
    repeated: float = 0.0
    changed: float = 0.0
    outages: Sequence[tuple[float, float]] = ()
    silent: Sequence[tuple[float, float]] = ()
    # From when to when the counter is so many packets too high.
    jumps: Sequence[tuple[float, float, int]] = ()


@dataclass
class Bench:
    """A bench that carries out a run's plan.

    Parameters
    ----------
    run : Run
    seed : int
    """

    run: Run
    seed: int = 0
    quiet: bool = False  # no noise, a table that is as it says
    clock: float = 0.0  # by which the IMU's clock is slow
    latency: float = 0.0  # s, of the readback
    poll: float = 0.02
    begun: float = 2.0  # s before the plan
    counter: int = 65000
    servo: float = 100.0  # s, of the table's clock at 0
    wraps: float = inf
    delay: float = 0.0  # s, least, of packets on their way
    faults: Faults = field(default_factory=Faults)
    layout: PacketLayout = LAYOUT

    def __post_init__(self) -> None:
        bench = self.run.bench
        assert isinstance(bench, Turntable)
        assert self.run.rate_hz is not None
        self.bench, self.rate = bench, self.run.rate_hz
        self.steps = [s for s in self.run.steps if isinstance(s, Position | Rotation)]
        self.way: PathProfile = path_profile(bench, self.steps)
        self.rng = np.random.default_rng(self.seed)
        names = {p.name: p for p in bench.parameters}
        self.q = {
            n: np.asarray(p.value + (0.0 if self.quiet else p.sd * self.rng.standard_normal()))
            for n, p in names.items()
        }
        self._plan()

    def _plan(self) -> None:
        """Lay the plan along the host's time: where it goes on, from which point of its way."""
        ends = self.way.ends
        starts = np.concatenate([[0.0], ends[:-1]])
        holds = {s.label: isinstance(s, Position) for s in self.steps}
        self.sections: list[tuple[float, str, dict[str, object]]] = []  # time, kind, event
        pieces = [(self.begun, 0.0)]  # host's time, the way's
        away = list(self.faults.outages)
        number, k = 0, 0
        while k < len(ends):
            label = self.way.labels[k]
            now, at = pieces[-1]
            begin, end = now + starts[k] - at, now + ends[k] - at
            if not label:
                k += 1
                continue
            told = {"what": "section", "number": number, "label": label, "hold": holds[label]}
            self.sections.append((begin, "begun", told))
            if away and begin < away[0][0] < end:
                gone, back = away.pop(0)
                assert holds[label], "an outage begins in a hold"
                self.sections.append((back, "session", {"what": "session", "next": number}))
                pieces.append((gone, starts[k]))
                pieces.append((back + 0.1, starts[k]))
                continue
            self.sections.append((end, "done", told))
            number, k = number + 1, k + 1
        now, at = pieces[-1]
        self.pieces, self.end = pieces, now + float(ends[-1]) - at + 3.0

    def along(self, time: Array) -> Array:
        """Return where on the way the table is at times of the host."""
        made = np.full(time.shape, 0.0)
        for j, (now, at) in enumerate(self.pieces):
            after = time >= now
            stands = j % 2 == 1  # from the outage on, until the host is back
            made[after] = at if stands else at + (time[after] - now)
        return np.clip(made, 0.0, self.way.ends[-1])

    def angles(self, time: Array) -> Array:
        """Return true angles at times of the host, (n, k) rad."""
        return self.way.evaluate(self.along(time))[0]

    def here(self, time: float) -> bool:
        """Whether the host is there."""
        return not any(gone <= time < back for gone, back in self.faults.outages)

    def stands(self, time: float) -> bool:
        """Whether the table waits for the host, away or just back."""
        return any(gone <= time < back + 0.1 for gone, back in self.faults.outages)

    def frames(self) -> list[LogFrame]:
        """Return all that is logged, in order."""
        rank = {TABLE: 0, IMU: 1, EVENT: 2}
        made = [*self._table(), *self._imu(), *self._events()]
        return sorted(made, key=lambda one: (one.time, rank[one.kind]))

    def log(self, path: Path) -> Path:
        """Write the log."""
        with RunLog(path) as log:
            for frame in self.frames():
                log.append(*frame)
        return path

    def _events(self) -> list[LogFrame]:
        made: list[LogFrame] = [event(0.0, {"what": "session", "next": 0, "wraps": self._wraps})]
        for when, kind, told in self.sections:
            polls = self.polled[self.polled >= when - 1e-9]
            heard = float(polls[0]) if polls.size else when
            if kind == "session":
                made.append(event(when, told | {"wraps": self._wraps}))
            else:
                time = self._servo(heard)
                made.append(event(heard + 1e-6, told | {"state": kind, "time": time}))
        return made

    @property
    def _wraps(self) -> float | None:
        return self.wraps if np.isfinite(self.wraps) else None

    def _servo(self, time: float) -> float:
        """Return the table's clock: counted on from where the host connected."""
        connected = max([0.0, *(back for _, back in self.faults.outages if back <= time)])
        if not np.isfinite(self.wraps):
            return time + self.servo
        rounds = (connected + self.servo) // self.wraps
        return time + self.servo - rounds * self.wraps

    def _table(self) -> list[LogFrame]:
        times = np.arange(0.0, self.end, self.poll)
        times = times[[self.here(t) for t in times.tolist()]]
        self.polled = times
        said = ideal_readback(
            self.bench, self.angles(times - self.latency), {} if self.quiet else self.q
        )
        if not self.quiet:
            said = said + self.bench.white * self.rng.standard_normal(said.shape)
        rates = self.way.evaluate(self.along(times - self.latency))[1]
        rates[[self.stands(t) for t in times.tolist()]] = 0.0
        moving = np.abs(self.way.evaluate(self.along(times))[1]) > 0
        late = 1e-3 * self.rng.random(times.size)
        made: list[LogFrame] = []
        for t, row, rate, turns, wait in zip(
            times.tolist(), said, rates, moving, late, strict=True
        ):
            axes = tuple(
                AxisState(float(a), float(r), 0.0, not m, bool(m), True, True)
                for a, r, m in zip(row, rate, turns, strict=True)
            )
            made.append(
                LogFrame(TABLE, t + wait * 0.5, pack_state(TableState(self._servo(t), axes)))
            )
        return made

    def _imu(self) -> list[LogFrame]:
        n = int(self.end * self.rate * (1 - self.clock)) - 1
        numbers = np.arange(n, dtype=np.float64)
        self.taken = (numbers + 0.3) / self.rate / (1 - self.clock)
        data = self.packets(self.taken)
        faults, rng = self.faults, self.rng
        self.lost = rng.random(n) < faults.lost
        self.changed = rng.random(n) < faults.changed
        twice = rng.random(n) < faults.repeated
        rows = np.frombuffer(data, np.uint8).reshape(n, -1).copy()
        where = rng.integers(0, rows.shape[1], n)
        rows[self.changed, where[self.changed]] ^= rng.integers(1, 256, self.changed.sum()).astype(
            np.uint8
        )
        for gone, back in (*faults.outages, *faults.silent):
            self.lost |= (self.taken + self.delay >= gone) & (self.taken + self.delay < back)
        order = np.repeat(np.arange(n), np.where(self.lost, 0, np.where(twice, 2, 1)))
        stream = rows[order].tobytes()
        arrived = self.taken[order] + self.delay
        # Bytes come in pieces that have nothing to do with packets.
        pieces: list[LogFrame] = []
        size, cut = rows.shape[1], 0
        for tick in np.arange(0.0, self.end + 1, self.poll).tolist():
            upto = int(np.searchsorted(arrived, tick, "right")) * size
            if upto > cut and self.here(tick):
                part = upto if rng.random() < 0.5 else max(cut + 1, upto - int(rng.integers(size)))
                pieces.append(LogFrame(IMU, tick, stream[cut:part]))
                cut = part
            elif not self.here(tick):
                cut = max(cut, upto)
        return pieces

    def packets(self, time: Array) -> bytes:
        """Return the packets of samples at times of the host."""
        sensor = self.run.sensor.with_coefficients(*self.run.truth)
        c = np.array([self.run.truth[name] for name in sensor.coefficients])
        angles, rates, accelerations = self.way.evaluate(self.along(time))
        stands = np.zeros(time.size, np.bool_)
        for gone, back in self.faults.outages:
            stands |= (time >= gone) & (time < back + 0.1)
        rates[stands], accelerations[stands] = 0.0, 0.0
        reading = np.concatenate(
            [
                sensor.forward(
                    motion(
                        self.bench,
                        angles[p],
                        rates[p],
                        accelerations[p],
                        {} if self.quiet else self.q,
                    ),
                    c,
                )
                for p in _parts(time.size)
            ]
        )
        if not self.quiet:
            for k, axis in enumerate(sensor.axes):
                reading[:, k] += axis.noise.draw(self.rng, (time.size,), self.rate)
        self.reading = reading
        counter = self.counter + np.arange(time.size)
        for start, stop, packets in self.faults.jumps:
            counter[(time >= start) & (time < stop)] += packets
        return encode(self.layout, reading, counter=counter, temperature=np.full(time.size, 298.15))


def event(time: float, told: dict[str, object]) -> LogFrame:
    return LogFrame(EVENT, time, json.dumps(told).encode())


def _parts(n: int, size: int = 8192) -> list[slice]:
    return [slice(k, min(k + size, n)) for k in range(0, ceil(n / size) * size, size)]
