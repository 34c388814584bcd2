"""Times on a turntable: a readback with its own clock, samples lost unnoticed."""

from dataclasses import replace
from functools import cache
from math import radians

import numpy as np
import pytest
from tests.accuracy import turntable as tt
from tests.base_seeds import evidence, slow

from inercal.basics.errors import InputError
from inercal.basics.units import Measured
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading import dropped_samples
from inercal.benches.turntable.reading.dropped_samples import (
    dropped_sample_findings,
    find_dropped_samples,
)
from inercal.benches.turntable.reading.readback_clock import ClockMismatch, align_readback
from inercal.physics.sensors.catalogue import imu
from inercal.recordings import Track

SEEDS = (5, 23)
DENSE_SEEDS = [5, pytest.param(23, marks=pytest.mark.slow)]
SENSOR = imu()
BENCH = Turntable(Measured(tt.G, 0.0), radians(38))
START: tt.Stand = ("warm-up", (0, 0, 0), 30.0)
SLOW = [START, *tt.positions(10), *tt.turns()]
FAST = [START, *tt.positions(10), *tt.turns(1080, 30, back=True)]
PATHS = {"slow": SLOW, "fast": FAST}
HZ = 100.0
LATE = tt.Table().latency
DENSE = 10
EXACT = replace(tt.Table(), harmonics=(0.0, 0.0), white=0.0, latency=0.0)


@cache
def draw_recording(path: str, seed: int) -> tt.Draw:
    return tt.draw(seed, 3, PATHS[path], tt.T)


@cache
def draw_dense_recording(path: str, seed: int) -> tt.Draw:
    """Return a run ten times as dense as its readings, whose noise is of their rate."""
    grade = replace(tt.T, arw=tt.T.arw / np.sqrt(DENSE))
    return tt.draw(seed, 1, PATHS[path], grade, EXACT, hz=DENSE * HZ)


def make_track(made: tt.Draw, trial: int = 0) -> Track:
    reading = np.concatenate([made.forces[trial], made.rates[trial]], -1)
    return Track(made.time, reading, made.angles[trial], np.zeros(made.time.size, int))


def track_without_sample(one: Track, sample: int, *, readback: bool) -> Track:
    """Lose a sample unnoticed, with its readback or with a readback on its own clock."""
    kept = np.arange(one.time.size) != sample
    angles = one.angles[kept] if readback else one.angles[:-1]
    return Track(one.time[:-1], one.reading[kept], angles, one.hold[:-1])


def table_speed(made: tt.Draw) -> np.ndarray:
    """Return the table's rate, °/s."""
    return np.degrees(np.linalg.norm(np.gradient(made.true, made.time, axis=0), axis=-1))


def sample_places(made: tt.Draw, where: str) -> np.ndarray:
    """Return samples in steady turns, where rates change, or at rest between two turns."""
    size = table_speed(made)
    change = np.abs(np.gradient(size, made.time))
    moving = np.flatnonzero(size > 0.5)
    inner = np.arange(size.size)
    inner = (inner > moving[0] + 100) & (inner < moving[-1] - 100)
    told = {
        "turn": (size > 5) & (change < 0.1),
        "change": (change > 5) & (size > 2),
        "rest": (size == 0) & (change == 0),
    }
    return np.flatnonzero(told[where] & inner)


def readback_on_own_clock(
    made: tt.Draw, offset: float, drift: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps and readback at 100 Hz of a table's clock T = o + (1 + d) t."""
    rng = np.random.default_rng(1)
    stamps = np.arange(-0.5, made.time[-1] * (1 + drift) + offset, 1 / HZ)
    t = (stamps - offset) / (1 + drift)
    angles = np.stack([np.interp(t, made.time, one) for one in made.true.T], -1)
    return stamps, angles + tt.Table().white * rng.standard_normal(angles.shape)


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("seed", DENSE_SEEDS)
@pytest.mark.parametrize(
    ("offset", "drift"), [evidence(0.95, 1e-3), slow(-0.95, -1e-3), (0.0137, 2e-5)]
)
def test_offset_and_rate_of_the_tables_clock_are_found_within_their_deviations(
    path: str, seed: int, offset: float, drift: float
):
    made = draw_dense_recording(path, seed)
    time, rates = made.time[::DENSE], made.rates[0, ::DENSE]
    found = align_readback(BENCH, time, rates, *readback_on_own_clock(made, offset, drift))
    assert abs(found.offset - offset) < 3 * found.offset_sd < 150e-6
    assert abs(found.drift - drift) < 3 * found.drift_sd < 1.5e-6


@pytest.mark.parametrize("seed", DENSE_SEEDS)
def test_interpolation_of_the_readback_errs_by_less_than_half_an_arcsecond(seed: int):
    """Beyond what the offset found makes, and the readback's own noise: .5″."""
    made = draw_dense_recording("fast", seed)
    time, rates = made.time[::DENSE], made.rates[0, ::DENSE]
    found = align_readback(BENCH, time, rates, *readback_on_own_clock(made, 0.314, 2e-4))
    off = found.offset - 0.314 + (found.drift - 2e-4) * time
    rate = np.gradient(made.true, made.time, axis=0)[::DENSE]
    error = found.angles - made.true[::DENSE] - rate * off[:, None]
    turning = table_speed(made)[::DENSE] > 0
    assert np.sqrt(np.mean(error[turning] ** 2)) < np.hypot(tt.Table().white, 0.3 * tt.ARCSEC)
    assert np.abs(error).max() < 5 * tt.Table().white + 0.5 * tt.ARCSEC


def test_a_readback_of_another_run_is_refused():
    made, other = draw_dense_recording("slow", SEEDS[0]), draw_dense_recording("fast", SEEDS[0])
    stamps, angles = readback_on_own_clock(other, 0.0, 0.0)
    with pytest.raises(InputError):
        align_readback(BENCH, made.time[::DENSE], made.rates[0, ::DENSE], stamps, angles)


def test_a_readback_that_ends_in_a_turn_is_refused():
    made = draw_dense_recording("slow", SEEDS[0])
    stamps, angles = readback_on_own_clock(made, 0.3, 0.0)
    end = np.searchsorted(stamps, made.time[sample_places(made, "turn")[-1]])
    keep = made.time[::DENSE] < stamps[end] + 1.0
    rates = made.rates[0, ::DENSE][keep]
    with pytest.raises(InputError):
        align_readback(BENCH, made.time[::DENSE][keep], rates, stamps[:end], angles[:end])


def test_a_table_that_never_turned_has_no_offset():
    made = draw_dense_recording("slow", SEEDS[0])
    time = made.time[: int(20 * DENSE * HZ) : DENSE]
    rates = made.rates[0, : int(20 * DENSE * HZ) : DENSE]
    with pytest.raises(ClockMismatch):
        align_readback(BENCH, time, rates, time, np.zeros((time.size, 3)))


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("seed", [SEEDS[0], *map(evidence, SEEDS[1:])])
def test_runs_that_lost_nothing_raise_no_alarm(path: str, seed: int):
    made = draw_recording(path, seed)
    for trial in range(len(made.rates)):
        assert dropped_sample_findings(make_track(made, trial), SENSOR, BENCH) == ()


@pytest.mark.parametrize("where", ["turn", "change"])
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("seed", SEEDS)
def test_one_row_lost_while_turning_is_found_where_it_is(path: str, seed: int, where: str):
    made, rng = draw_recording(path, seed), np.random.default_rng(seed)
    for sample in rng.choice(sample_places(made, where), 2).tolist():
        (slip,) = find_dropped_samples(
            track_without_sample(make_track(made), sample, readback=True), SENSOR, BENCH
        )
        assert (slip.first, slip.last, round(slip.samples), slip.row) == (
            sample - 1, sample, 1, True,
        )  # fmt: skip


@pytest.mark.parametrize("where", ["turn", evidence("change"), "rest"])
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("seed", SEEDS)
def test_one_sample_of_the_sensor_alone_is_found_between_changes_of_rate(
    path: str, seed: int, where: str
):
    made, rng = draw_recording(path, seed), np.random.default_rng(seed)
    for sample in rng.choice(sample_places(made, where), 2).tolist():
        (slip,) = find_dropped_samples(
            track_without_sample(make_track(made), sample, readback=False), SENSOR, BENCH
        )
        assert not slip.row
        assert slip.first - 3 <= sample <= slip.last + 3
        # A loss within a change spoils the offset of that change itself.
        assert slip.samples == pytest.approx(1, abs=0.4 if where == "change" else 0.1)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_row_lost_at_rest_does_not_show(seed: int):
    made = draw_recording("slow", seed)
    sample = int(np.random.default_rng(seed).choice(sample_places(made, "rest")))
    assert (
        find_dropped_samples(
            track_without_sample(make_track(made), sample, readback=True), SENSOR, BENCH
        )
        == ()
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_several_rows_and_a_repeated_one_are_counted(seed: int):
    made = draw_recording("slow", seed)
    one, (first, second) = make_track(made), sample_places(made, "turn")[[500, -500]].tolist()
    rows = np.r_[:first, first + 3 : second, second, second : one.time.size]
    size = rows.size
    odd = Track(one.time[:size], one.reading[rows], one.angles[rows], one.hold[:size])
    found = dropped_sample_findings(odd, SENSOR, BENCH)
    assert [finding.severity for finding in found] == ["warning"] * 2
    assert [(f.start, f.stop) for f in found] == [(first - 1, first + 1), (second - 3, second - 1)]
    counts = [round(drop.samples) for drop in find_dropped_samples(odd, SENSOR, BENCH)]
    assert counts == [3, -1]


def test_a_gap_in_time_is_no_slip():
    made = draw_recording("slow", SEEDS[0])
    one, sample = make_track(made), int(sample_places(made, "turn")[700])
    kept = np.arange(one.time.size) != sample
    noticed = Track(one.time[kept], one.reading[kept], one.angles[kept], one.hold[kept])
    assert find_dropped_samples(noticed, SENSOR, BENCH) == ()


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("size", [4_000, evidence(9_000)])
def test_a_long_run_is_searched_piece_by_piece(
    monkeypatch: pytest.MonkeyPatch, path: str, size: int
):
    made = draw_recording(path, SEEDS[0])
    whole = make_track(made)
    row, alone = sample_places(made, "turn")[[300, -300]].tolist()
    odd = track_without_sample(whole, row, readback=True)
    odd = track_without_sample(odd, alone, readback=False)
    at_once = find_dropped_samples(odd, SENSOR, BENCH)
    monkeypatch.setattr(dropped_samples, "_PIECE", size)
    assert find_dropped_samples(whole, SENSOR, BENCH) == ()
    found = find_dropped_samples(odd, SENSOR, BENCH)
    assert [one.row for one in found] == [one.row for one in at_once] == [True, False]
    # The largest change of rate, which says what a change is, is that of a piece.
    for one, other in zip(found, at_once, strict=True):
        assert (one.first, one.last) == pytest.approx((other.first, other.last), abs=2)
        assert one.samples == pytest.approx(other.samples, abs=0.05)
