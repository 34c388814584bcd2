"""Packets of a host that was frozen, and of counters that jump, keep the dates that they had."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from tests.host.synthetic_log import LAYOUT, Bench, Faults, run_file

from inercal.host.assembly import SampleAssembler
from inercal.host.packets import PacketLayout
from inercal.host.run_log import IMU, LogFrame
from inercal.runfile import Run

PATH = """label,kind,outer [°],middle [°],inner [°],seconds [s],axis,angle [°],rate [°/s]
warm-up,position,0,0,0,60,,,
up,position,0,90,0,4,,,
"""
FROZEN = 20.0  # s, when the host freezes, in the first rest
RATE = 200.0
PIECE = 4095  # bytes that a pseudo-terminal gives at once
EIGHT_BITS = replace(LAYOUT, wraps={"counter": 256.0})  # comes round in 1.28 s
LAYOUTS = {"16 bits": LAYOUT, "8 bits": EIGHT_BITS}
ALL = float("inf")


class Recorded:
    """A run that nothing disturbs, and its samples; by the layout of its packets."""

    def __init__(self, run: Run, layout: PacketLayout):
        self.run, self.layout = run, layout
        self._bench = Bench(run, seed=3, quiet=True, layout=layout)
        self.frames = self._bench.frames()
        self.whole = self.samples(self.frames)[1]

    def jumping(self, seconds: float, packets: int) -> list[LogFrame]:
        """Return the same with a counter that is too high for a while."""
        faults = Faults(jumps=((FROZEN, FROZEN + seconds, packets),))
        return replace(self._bench, faults=faults).frames()

    def resumed(self, jumps: Sequence[tuple[float, float, int]]) -> list[LogFrame]:
        """Return a run that had no host for 10 s, with a counter that jumps."""
        return replace(self._bench, faults=Faults(outages=((40.0, 50.0),), jumps=jumps)).frames()

    def frozen(self, seconds: float, buffer: float) -> list[LogFrame]:
        """Return what a frozen host logs: at its end it reads what fits in the buffer, in bytes."""
        end = FROZEN + seconds
        away = [one for one in self.frames if FROZEN <= one.time < end and one.kind == IMU]
        backlog = b"".join(one.payload for one in away)
        backlog = backlog[: int(min(buffer, len(backlog)))]
        starts = range(0, len(backlog), PIECE)
        late = [
            LogFrame(IMU, end - 1e-6 * (len(starts) - k), backlog[start : start + PIECE])
            for k, start in enumerate(starts)
        ]
        kept = [one for one in self.frames if not FROZEN <= one.time < end]
        return sorted([*kept, *late], key=lambda one: one.time)

    def samples(
        self, frames: Sequence[LogFrame], pieces: int = 1
    ) -> tuple[SampleAssembler, dict[int, bytes]]:
        """Return the samples by their number, from the first of the recording on."""
        made, found = SampleAssembler(self.run, self.layout), dict[int, bytes]()
        bounds = np.linspace(0, len(frames), pieces + 1).astype(int).tolist()
        for start, stop in pairwise(bounds):
            for frame in frames[start:stop]:
                made.feed(frame)
            if (block := made.take()) is not None:
                numbers = np.rint(block.time * RATE).astype(int).tolist()
                found |= {k: row.tobytes() for k, row in zip(numbers, block.output, strict=True)}
        return made, found

    def require_same_dates(self, log: list[LogFrame]) -> set[int]:
        """See that every sample has its own date however it is taken; return those missed."""
        made, found = self.samples(log)
        assert found.items() <= self.whole.items()
        assert self.samples(log, 40)[1] == found
        assert made.imu.mismatch is None
        return set(self.whole) - set(found)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recorded]:
    run = run_file(tmp_path_factory.mktemp("run"), PATH)
    return {name: Recorded(run, layout) for name, layout in LAYOUTS.items()}


def slow_cases(*values: Iterable[object]) -> list[object]:
    """Return all combinations: one of eight is slow, the others are for `make evidence`."""
    return [
        pytest.param(*one, marks=pytest.mark.evidence if k % 8 else pytest.mark.slow)
        for k, one in enumerate(product(*values))
    ]


@pytest.mark.parametrize(
    ("bits", "seconds", "buffer"),
    [
        pytest.param("16 bits", 4.0, ALL, marks=pytest.mark.slow),
        ("8 bits", 12.8, 20000.0),
        *slow_cases(LAYOUTS, (1.5, 7.7, 30.0), (ALL, 20000.0, 0.0)),
    ],
)
def test_a_backlog_has_the_dates_at_which_it_was_sent(
    recorded: dict[str, Recorded], bits: str, seconds: float, buffer: float
):
    bench = recorded[bits]
    missed = bench.require_same_dates(bench.frozen(seconds, buffer))
    if buffer == ALL and seconds < 5.0:
        assert not missed
    # The recording begins 2 s after the host. A counter that comes round in less time than the
    # backlog is trusted again when the backlog is used up.
    after = 0.6 if bits == "8 bits" else 0.1
    first, last = (FROZEN - 2.1) * RATE, (FROZEN - 2.0 + seconds + after) * RATE
    assert all(first <= k <= last for k in missed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bits", "seconds", "packets"),
    [
        ("8 bits", 3.0, -77),
        *slow_cases(LAYOUTS, (0.004, 0.3, 3.0), (23, 77, -77, 1000, 20000)),
    ],
)
def test_a_counter_that_jumps_and_comes_back_costs_only_the_packets_between(
    recorded: dict[str, Recorded], bits: str, seconds: float, packets: int
):
    bench = recorded[bits]
    missed = bench.require_same_dates(bench.jumping(seconds, packets))
    assert len(missed) <= RATE * (seconds + 0.6)


@pytest.mark.parametrize(("end", "bits"), slow_cases((45.0, 52.0, 56.0), LAYOUTS))
def test_a_counter_that_jumped_before_the_host_ended_does_not_block_the_resumed_run(
    recorded: dict[str, Recorded], bits: str, end: float
):
    bench = recorded[bits]
    _, whole = bench.samples(bench.resumed(()))
    made, found = bench.samples(bench.resumed(((38.0, end, 5050),)))
    assert found.items() <= whole.items()
    assert made.imu.mismatch is None
    assert max(found) == max(whole)
    assert len(whole) - len(found) < RATE * (2.0 + max(end - 50.0, 0.0) + 1.0)
