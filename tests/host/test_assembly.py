"""Samples from frames: none lost, doubled or false, the same however they are taken."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import radians
from pathlib import Path

import numpy as np
import pytest
from tests.host.synthetic_log import LAYOUT, PATH, Bench, Faults, event, run_file
from tests.refusals import refused

from inercal.host.assembly import SampleAssembler, SampleBlock
from inercal.host.packets import read_layout
from inercal.host.run_log import EVENT, IMU, TABLE, LogFrame, RunLog, read_frames
from inercal.recordings import AngleQuality
from inercal.runfile import Run

ARCSEC = radians(1 / 3600)
AWAY = (33.0, 33.0 + 400.0)  # in the hold "up": the counter of 16 bits comes round in 327 s
SERVO = 290.0  # s, after which the table's clock comes round
UNREAD = (30.0, 37.0)  # s, in which the table is not read


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run_file(tmp_path_factory.mktemp("run"), PATH)


@pytest.fixture(scope="module")
def hard(run: Run) -> Bench:
    """Return a bench where all goes wrong: the host is away for longer than both clocks' turns."""
    faults = Faults(
        lost=0.02, repeated=0.02, changed=0.02, outages=(AWAY,), silent=((450.0, 453.0),)
    )
    return Bench(run, seed=3, wraps=SERVO, faults=faults, delay=1e-3)


@pytest.fixture(scope="module")
def logged(hard: Bench) -> list[LogFrame]:
    return hard.frames()


def taken(
    run: Run, logged: list[LogFrame], cuts: "list[int] | None" = None
) -> tuple[SampleAssembler, SampleBlock]:
    made, blocks = SampleAssembler(run, LAYOUT), list[SampleBlock]()
    bounds: list[int] = [0, *(cuts or []), len(logged)]
    for start, stop in pairwise(bounds):
        for frame in logged[start:stop]:
            made.feed(frame)
        if (block := made.take()) is not None:
            if block.starts_recording:
                blocks.clear()
            blocks.append(block)
    assert blocks
    columns = zip(*(one[:-2] for one in blocks), strict=True)
    quality = AngleQuality(*map(np.concatenate, zip(*(one.quality for one in blocks), strict=True)))
    joined = map(np.concatenate, columns)
    return made, SampleBlock(*joined, quality=quality, starts_recording=True)


@pytest.fixture(scope="module")
def whole(run: Run, logged: list[LogFrame]) -> tuple[SampleAssembler, SampleBlock]:
    """Return all samples of the bench where all goes wrong, taken in one piece."""
    return taken(run, logged)


def schedules(logged: list[LogFrame]) -> Iterator[list[int]]:
    rng, n = np.random.default_rng(5), len(logged)
    ends = np.searchsorted([one.time for one in logged], AWAY).tolist()
    # One by one where the host goes and comes back.
    single = {k for end in ends for k in range(end - 200, end + 200)}
    yield sorted({*range(20, n, 20), *single} & {*range(1, n)})
    yield np.sort(rng.choice(np.arange(1, n), 40, replace=False)).tolist()


@pytest.mark.slow
def test_the_samples_are_the_same_however_they_are_taken(
    run: Run, logged: list[LogFrame], whole: tuple[SampleAssembler, SampleBlock]
):
    made, block = whole
    for cuts in schedules(logged):
        other, parts = taken(run, logged, cuts)
        for one, two in zip(
            (*block[:-2], *block.quality), (*parts[:-2], *parts.quality), strict=True
        ):
            assert one.tobytes() == two.tobytes()
        assert (other.samples, other.imu.counts) == (made.samples, made.imu.counts)
        assert (other.imu.drops, other.table.drops) == (made.imu.drops, made.table.drops)
        assert other.sections.spans == made.sections.spans


def test_every_good_packet_is_a_sample_once(
    hard: Bench, whole: tuple[SampleAssembler, SampleBlock]
):
    made, block = whole
    numbers = np.rint(block.time * hard.rate).astype(int)
    assert block.time == pytest.approx(numbers / hard.rate, abs=1e-12)
    assert (np.diff(numbers) > 0).all()
    begun = next(when for when, kind, _ in hard.sections if kind == "begun")
    first = int(np.searchsorted(hard.taken, begun))
    # The clocks are tied to some ms: which sample is the first is not known better.
    offset = min(range(first - 3, first + 4), key=lambda k: np.sum(hard.lost[k + numbers]))
    good = np.flatnonzero(~(hard.lost | hard.changed))
    got = numbers + offset
    assert np.isin(got, good).all()
    last = got[-1]
    missed = np.setdiff1d(good[(good >= offset) & (good <= last)], got)
    # Where the host goes and comes back, a packet is cut and a few have no poll behind them.
    near = [abs(hard.taken[missed] - edge) < 0.06 for edge in (*AWAY, 450.0, 453.0)]
    assert np.any(near, axis=0).all()
    assert missed.size <= 20
    assert hard.end - hard.taken[last] < 2.0
    assert made.samples == numbers.size
    assert made.imu.drops.repeated > 200
    assert made.imu.counts.failed > 0


def test_a_changed_byte_never_enters(hard: Bench, whole: tuple[SampleAssembler, SampleBlock]):
    _, block = whole
    numbers = np.rint(block.time * hard.rate).astype(int)
    # The tie between host and clocks is no matter: packets tell their samples.
    lost = hard.lost
    first = int(np.searchsorted(hard.taken, hard.begun))
    offset = min(range(first - 3, first + 4), key=lambda k: np.sum(lost[k + numbers]))
    sent = hard.reading[numbers + offset]
    resolution = np.array([9.80665e-6] * 3 + [radians(1 / 3600)] * 3)
    assert (np.abs(block.reading - sent) <= 0.51 * resolution).all()
    assert hard.changed.sum() > 200


@pytest.mark.slow
def test_clocks_are_tied_within_the_declared_latency(run: Run):
    for seed, delay in ((1, 0.0), (2, 4e-3)):
        bench = Bench(run, seed=seed, delay=delay, quiet=True)
        _, block = taken(run, bench.frames())
        number = np.rint(block.time * bench.rate).astype(int)
        first = int(np.searchsorted(bench.taken, block.table[0] - bench.servo - 0.015))
        stamped = block.table - bench.servo
        candidates = [np.abs(stamped - bench.taken[first + k + number]).max() for k in range(7)]
        assert min(candidates) < bench.bench.latency.value + 3 * bench.bench.latency.sd


@pytest.mark.slow
def test_angles_between_polls_are_true_to_an_arcsecond_away_from_kinks(run: Run):
    bench = Bench(run, seed=4, quiet=True)
    _, block = taken(run, bench.frames())
    when = block.table - bench.servo
    apart = np.abs(block.angles - bench.angles(when)).max(axis=-1)
    steps = when[:, None] + 0.02 * np.arange(-3, 4)
    accelerations = bench.way.evaluate(bench.along(steps.ravel()))[2].reshape(*steps.shape, -1)
    smooth = (np.ptp(accelerations, axis=1) < 1e-9).all(axis=-1)
    assert smooth.mean() > 0.8
    assert apart[smooth].max() < 0.01 * ARCSEC  # a cubic holds a constant acceleration
    assert apart.max() < 20 * ARCSEC
    turning = np.abs(bench.way.evaluate(bench.along(when))[1]).max(axis=-1) > radians(29)
    assert (turning & smooth).sum() > 1000


def test_a_hold_that_is_void_keeps_its_number_and_loses_its_label(
    whole: tuple[SampleAssembler, SampleBlock],
):
    made, block = whole
    labels = made.sections.labels(block.table)
    away = [one for one in made.sections.spans if one.number == 1]
    assert [one.state for one in away] == ["void", "done"]
    assert [one.label for one in away] == ["up", "up"]
    void, again = away
    assert again.start_time - void.end_time == pytest.approx(AWAY[1] - AWAY[0] + 0.1, abs=0.05)
    within = (block.table > void.start_time) & (block.table < void.end_time)
    assert set(labels[within]) == {""}
    assert set(block.hold[within]) == {-1, 1}
    within = (block.table > again.start_time) & (block.table < again.end_time)
    assert set(labels[within]) == {"up"}
    assert set(block.hold[within]) == {-1, 2}
    assert block.hold.max() == 4  # warm-up, up, up again, slanted, rest; of them all but the turn
    settling = 0.25 + 2 * 5e-3
    for number in range(5):
        span = block.table[block.hold == number]
        section = [s for s in made.sections.spans if s.start_time <= span[0] <= s.end_time]
        assert len(section) == 1
        assert span[0] - section[0].start_time == pytest.approx(settling, abs=0.03)
        assert section[0].end_time - span[-1] == pytest.approx(settling, abs=0.03)
    assert (block.hold[labels == "y+"] == -1).all()


@pytest.mark.slow
def test_a_first_rest_that_was_interrupted_is_left_out_of_the_recording(run: Run):
    faults = Faults(outages=((15.0, 25.0),))
    bench = Bench(run, seed=6, faults=faults)
    logged = bench.frames()
    made, block = taken(run, logged)
    first = [one for one in made.sections.spans if one.number == 0]
    assert [one.state for one in first] == ["void", "done"]
    assert block.time[0] == 0
    assert block.table[0] == pytest.approx(first[1].start_time, abs=0.02)
    assert block.hold[block.hold >= 0][0] == 0
    for cuts in list(schedules(logged))[1:2]:
        parts = taken(run, logged, cuts)[1]
        assert parts.time.tobytes() == block.time.tobytes()
        assert parts.hold.tobytes() == block.hold.tobytes()


@pytest.mark.slow
def test_a_first_rest_of_twenty_seconds_is_enough(run: Run):
    bench = Bench(run, seed=6, faults=Faults(outages=((24.5, 30.0),)))
    made, block = taken(run, bench.frames())
    assert block.table[0] == pytest.approx(made.sections.spans[0].start_time, abs=0.02)
    assert made.sections.spans[0].state == "void"


def test_a_gap_in_a_hold_begins_another(run: Run):
    bench = Bench(run, seed=7, faults=Faults(silent=((10.0, 10.45), (20.0, 20.6))))
    _, block = taken(run, bench.frames())
    when = block.table - bench.servo
    assert set(block.hold[(when > 3) & (when < 19.9)]) == {0}
    assert set(block.hold[(when > 20.7) & (when < 25)]) == {1}


@pytest.mark.parametrize("wraps", [290.0, pytest.param(1e9, marks=pytest.mark.slow)])
def test_a_clock_that_was_set_anew_is_refused(run: Run, wraps: float):
    bench = Bench(run, seed=8, wraps=wraps, faults=Faults(outages=((33.0, 60.0),)))
    logged = bench.frames()
    anew = [
        one
        if one.kind != TABLE or one.time < 60
        else replace_time(one, one.time - 59.0)  # what the servo counts since it was switched on
        for one in logged
    ]
    with refused(names=("the table",)):
        taken(run, anew)
    other = Bench(run, seed=8, wraps=wraps, counter=20000, faults=bench.faults)
    mixed = [one for one in logged if one.kind != IMU or one.time < 60]
    mixed += [one for one in other.frames() if one.kind == IMU and one.time >= 60]
    made, block = taken(run, sorted(mixed, key=lambda one: one.time))
    assert made.imu.mismatch is not None
    assert "counter" in made.imu.mismatch
    assert block.table[-1] - bench.servo < 33.0


def replace_time(frame: LogFrame, time: float) -> LogFrame:
    return frame._replace(payload=np.float64(time).tobytes() + frame.payload[8:])


@pytest.mark.slow
def test_an_imu_that_was_silent_for_longer_than_half_its_counters_turn_is_followed(run: Run):
    """In one session: the decoder alone would take the step for one back."""
    longer = PATH.replace("warm-up,position,0,0,0,24", "warm-up,position,0,0,0,225")
    slow = run_file(run.path.parent, longer)
    bench = Bench(slow, seed=9, faults=Faults(silent=((20.0, 195.0),)))
    _, block = taken(slow, bench.frames())
    k = int(np.argmax(np.diff(block.time)))
    assert block.time[k + 1] - block.time[k] == pytest.approx(175.0, abs=0.03)
    assert block.table[-1] - bench.servo > 235


@pytest.mark.slow
def test_a_torn_frame_at_the_end_loses_what_it_held(
    run: Run, tmp_path: Path, logged: list[LogFrame], hard: Bench
):
    path = tmp_path / "log"
    with RunLog(path) as log:
        for frame in logged:
            log.append(*frame)
    whole = taken(run, list(read_frames(path)))[1]
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 12])
    with RunLog(path) as log:
        assert log.incomplete_bytes > 0
    part = taken(run, list(read_frames(path)))[1]
    n = part.time.size
    assert 0 < n < whole.time.size
    assert part.reading.tobytes() == whole.reading[:n].tobytes()
    assert part.hold.tobytes() == whole.hold[:n].tobytes()


@pytest.mark.slow
def test_nothing_comes_of_the_time_before_the_first_section_or_before_clocks_are_tied(run: Run):
    bench = Bench(run, seed=10)
    logged = bench.frames()
    made = SampleAssembler(run, LAYOUT)
    for frame in logged:
        if frame.time < 4.9:
            made.feed(frame)
    assert made.take() is None
    silent = [one for one in logged if one.kind != EVENT]
    made = SampleAssembler(run, LAYOUT)
    for frame in silent:
        made.feed(frame)
    assert made.take() is None


def test_readings_that_cannot_be_are_left_out_and_counted(run: Run):
    bench = Bench(run, seed=11, quiet=True)
    logged = bench.frames()
    low = run_file(run.path.parent, PATH, **{'full_scale = "150 °/s"': 'full_scale = "20 °/s"'})
    made, block = taken(low, logged)
    assert made.imu.drops.beyond_range > 1000
    assert np.abs(block.reading[:, 3:]).max() <= radians(20) * (1 + 1e-5)


@pytest.mark.parametrize(
    ("payload", "key"),
    [(b"no json", "event"), (b"[1]", "event"), (b'{"what": "section"}', "section")],
)
def test_an_event_that_is_none_is_refused(run: Run, payload: bytes, key: str):
    made = SampleAssembler(run, LAYOUT)
    made.feed(LogFrame(EVENT, 0.0, payload))
    with refused(key=key):
        made.take()


def test_events_of_others_are_no_matter(run: Run):
    made = SampleAssembler(run, LAYOUT)
    made.feed(event(0.0, {"what": "temperature", "celsius": 21.5}))
    assert made.take() is None


def test_packets_that_cannot_be_timed_are_refused(run: Run):
    with refused(key="[data] rate", names=(LAYOUT.name,)):
        SampleAssembler(run, replace(LAYOUT, rate_hz=100.0))
    ascii_like = read_layout("witmotion")
    with refused(key=None, names=("witmotion",)):
        SampleAssembler(run, replace(ascii_like, rate_hz=None))


@pytest.mark.slow
def test_without_readback_no_sample_waits_for_an_angle(tmp_path: Path):
    without = {
        'kind = "turntable"': 'kind = "turntable"\nreadback = false',
        'name = "turntable_kalman"': 'name = "systematic"',
        'file = "mimu.csv"': 'file = "mimu.h5"',
        **dict.fromkeys(
            (
                'azimuth = "0 ° ± 0.1 °"',
                'lean = "5 ″"',
                'square = "2 ″"',
                'harmonics = ["2 ″", "1 ″"]',
                'noise = "0.5 ″"',
                'latency = "0 ms ± 5 ms"',
                'table = ["outer", "middle", "inner"]',
            ),
            "",
        ),
    }
    of_angles = run_file(tmp_path, PATH)
    logged = [
        one
        for one in Bench(of_angles, seed=4).frames()
        if one.kind != TABLE or not UNREAD[0] < one.time < UNREAD[1]
    ]
    made, block = taken(of_angles, logged)
    lost = made.samples_without_angle
    assert lost == pytest.approx(200 * (UNREAD[1] - UNREAD[0]), rel=0.03)
    made, whole = taken(run_file(tmp_path, PATH, **without), logged)
    assert made.samples_without_angle == made.samples_with_unusable_angle == 0
    assert whole.time.size == block.time.size + lost
    assert np.abs(np.diff(whole.time) - 1 / 200).max() < 1e-6
    assert whole.angle_output.shape == whole.estimator_track.angles.shape == (whole.time.size, 0)
    assert whole.estimator_track.angle_quality is None
    # The host drives by what the table says, where it does.
    assert np.isnan(whole.angles).any(axis=1).sum() == lost
