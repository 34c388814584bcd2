"""Readback against gyros: what is wrong with a readback is named, and a sound one is not blamed.

Motion, readings and noise are those of `tests.evidence.cases.turntable`, which knows nothing of
inercal: gyros of 0.1 °/√h, off by 0.3 °/s, 0.5 % and 15′, a readback of 0.5″ that is 5 ms late.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.accuracy.turntable import Table, simulate_travel
from tests.evidence import sensor_models
from tests.evidence.cases import turntable as case

from inercal.basics.arrays import Array
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.gyro_comparison import (
    GyroComparison,
    ReadbackDifference,
    gyro_comparison_findings,
)
from inercal.benches.turntable.reading.readback_increments import KnotSpacing, find_increments
from inercal.benches.turntable.reading.sample_checks import (
    readback_interval,
    repeated_readback_finding,
)
from inercal.recordings import Track
from inercal.runfile import Run, read

HZ, RATE = 100.0, 30.0
PATH: case.Path = [
    ("warm-up", (0, 0, 0), 20.0), ("up", (0, 90, 0), 8.0), ("slanted", (90, 45, 30), 8.0),
    ("x+", 1, 360.0, RATE), ("x-", 1, -360.0, RATE), ("y+", 2, 360.0, RATE),
    ("y-", 2, -360.0, RATE), ("z+", 0, 360.0, RATE), ("z-", 0, -360.0, RATE),
    ("rest", (0, 0, 0), 15.0),
]  # fmt: skip
Fault = Callable[[Array, Array, float], Array]


def made(seed: int, folder: Path, path: case.Path = PATH) -> tuple[Run, Track, float]:
    """Return a run file, a sound track, and when its turn z+ has lasted for 4 s."""
    rng = np.random.default_rng(seed)
    unknowns = sensor_models.gyro_triad(0.3 * case.DEGREE, 5e-3, 15 / 60 * case.DEGREE)
    v = {name: one.sd * float(rng.standard_normal()) for name, one in unknowns.items()}
    v["latency"] = 5e-3
    true, speed, late, steps = simulate_travel(path, Table(latency=5e-3, jerk=case.JERK), HZ)
    y = case.noise_free_readings(v, true, speed)
    y[:, 3:] += case.WHITE_G * np.sqrt(HZ) * rng.standard_normal((len(y), 3))
    said = case.readback(v, late) + 0.5 * case.ARCSEC * rng.standard_normal(late.shape)
    (folder / "run.toml").write_text(case.run_text("turntable_kalman"), encoding="utf-8")
    (folder / "path.csv").write_text(case.path_text(path), encoding="utf-8")
    time = np.arange(len(y)) / HZ
    track = Track(time, y, said, np.full(time.size, -1))
    return read(folder / "run.toml"), track, float(time[np.argmax(steps == "z+")]) + 4.0


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Track, float]:
    return made(4, tmp_path_factory.mktemp("sound"))


def found(run: Run, track: Track, piece: int = 1 << 30) -> list[ReadbackDifference]:
    assert isinstance(run.bench, Turntable)
    comparison = GyroComparison(run.bench, run.sensor)
    result: list[ReadbackDifference] = []
    for start in range(0, track.time.size, piece):
        result += comparison.feed(track.slice(start, min(start + piece, track.time.size)))
    return result + comparison.finish()


def offset(size: float, until: float = 1e9) -> Fault:
    def fault(time: Array, angles: Array, at: float) -> Array:
        angles[(time >= at) & (time < at + until), 0] += size * case.DEGREE
        return angles

    return fault


def drift(rate: float) -> Fault:
    def fault(time: Array, angles: Array, at: float) -> Array:
        angles[:, 0] += rate * case.DEGREE * np.clip(time - at, 0, 6)
        return angles

    return fault


def clock(seconds: float) -> Fault:
    def fault(time: Array, angles: Array, at: float) -> Array:
        late = np.where(time >= at, time - seconds, time)
        return np.stack([np.interp(late, time, axis) for axis in angles.T], axis=-1)

    return fault


def noise(size: float) -> Fault:
    def fault(time: Array, angles: Array, at: float) -> Array:
        now = (time >= at) & (time < at + 6)
        drawn = np.random.default_rng(1).standard_normal((int(now.sum()), 3))
        angles[now] += size * case.DEGREE * drawn
        return angles

    return fault


FAULTS: dict[str, tuple[Fault, str]] = {
    "an offset of 0.02° that stays": (offset(0.02), "step"),
    "an offset of 0.02° for 2 s": (offset(0.02, 2.0), "step"),
    "an offset of 1°": (offset(1.0), "step"),
    "a drift of 1 °/s": (drift(1.0), "drift"),
    "a clock that jumps by 0.5 s": (clock(0.5), "delay"),
    "a clock that jumps by 2 ms": (clock(0.002), "step"),
    "noise of 0.05°": (noise(0.05), "noise"),
    "noise of 0.002°": (noise(0.002), "noise"),
}


def test_a_sound_readback_is_not_blamed(sound: tuple[Run, Track, float]):
    run, track, _ = sound
    assert found(run, track, 777) == []
    assert isinstance(run.bench, Turntable)
    assert gyro_comparison_findings(track, run.sensor, run.bench) == ()


@pytest.mark.parametrize(("jump", "count"), [(0.006, 0), (0.06, 1)])
def test_a_clock_may_run_away_by_its_stated_rate_during_a_pause(
    sound: tuple[Run, Track, float], jump: float, count: int
):
    run, track, at = sound
    at -= 5.0  # between two turns
    late = clock(jump)(track.time, track.angles, at)
    time = track.time + np.where(track.time >= at, 600.0, 0.0)
    assert isinstance(run.bench, Turntable)
    run = replace(run, bench=replace(run.bench, clock=10e-6))
    one = replace(track, time=time, angles=late)
    assert min(len(found(run, one, 1000)), 1) == count
    assert found(run, replace(track, angles=late))  # the same jump without a pause


@pytest.mark.parametrize(("stated", "blamed"), [(3e-5, False), (1e-6, True)])
def test_a_clock_may_run_steadily_at_its_stated_rate(tmp_path: Path, stated: float, blamed: bool):
    turns = PATH[3:6]
    rests: case.Path = [(f"level {k}", (0, 0, 0), 500.0) for k in range(len(turns))]
    path: case.Path = [PATH[0], *(one for both in zip(turns, rests, strict=True) for one in both)]
    run, track, _ = made(4, tmp_path, path)
    late = np.stack([np.interp(track.time * (1 - 3e-5), track.time, one) for one in track.angles.T])
    assert isinstance(run.bench, Turntable)
    run = replace(run, bench=replace(run.bench, clock=stated))
    assert any(found(run, replace(track, angles=late.T))) == blamed


@pytest.mark.parametrize(
    "name",
    [
        "an offset of 0.02° that stays",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in FAULTS
            if name != "an offset of 0.02° that stays"
        ),
    ],
)
def test_a_wrong_readback_is_named_with_its_time(sound: tuple[Run, Track, float], name: str):
    fault, kind = FAULTS[name]
    run, track, at = sound
    wrong = replace(track, angles=fault(track.time, track.angles.copy(), at))
    differences = found(run, wrong)
    assert kind in {one.kind for one in differences}
    piecewise = found(run, wrong, 777)
    assert [one[:3] for one in piecewise] == [one[:3] for one in differences]
    for one, other in zip(piecewise, differences, strict=True):
        assert one[3:] == pytest.approx(other[3:], rel=1e-6)
    first = min(differences, key=lambda one: one.stop)
    assert first.start - 10.0 <= at <= first.stop + 0.1
    for one in differences:
        if one.kind == "step" and one.start < at + 1 and "offset" in name:
            assert abs(one.start - at) < 0.1
            assert abs(one.size) == pytest.approx(
                (1.0 if "1°" in name else 0.02) * case.DEGREE, rel=0.1
            )
            assert one.axis == 0
    assert isinstance(run.bench, Turntable)
    findings = gyro_comparison_findings(wrong, run.sensor, run.bench)
    assert {one.what for one in findings} == {"readback"}
    assert all("relative to the gyros" in one.message or "than the gyros" in one.message
               for one in findings)  # fmt: skip


@pytest.mark.slow
def test_gyros_that_are_off_by_five_percent_blame_no_readback(sound: tuple[Run, Track, float]):
    run, track, _ = sound
    reading = track.reading.copy()
    reading[:, 3:] *= 1.05
    assert found(run, replace(track, reading=reading)) == []
    # Nor do ones of less sense than the run file states, nor a sensor without any.
    rng = np.random.default_rng(1)
    reading[:, 3:] += 5 * case.WHITE_G * np.sqrt(HZ) * rng.standard_normal((len(reading), 3))
    assert found(run, replace(track, reading=reading)) == []
    force = run.sensor.select_axes("f")
    assert isinstance(run.bench, Turntable)
    alone = replace(track, reading=track.reading[:, :3])
    assert gyro_comparison_findings(alone, force, run.bench) == ()


def test_a_turn_within_a_gap_of_a_table_that_stands_is_in_no_other_increment(
    sound: tuple[Run, Track, float],
):
    run, track, _ = sound
    assert isinstance(run.bench, Turntable)
    rest = track.slice(0, 1500)
    lost, turned = slice(700, 800), np.zeros((1500, 3))
    turned[800:, 0] = np.pi / 2
    kept = np.ones(1500, dtype=bool)
    kept[lost] = False
    gapped = Track(
        rest.time[kept], rest.reading[kept], (rest.angles + turned)[kept], rest.hold[kept]
    )
    columns = np.array([False] * 3 + [True] * 3)
    at = np.arange(4, 1396, 5)[None]
    (knots,) = find_increments(
        run.bench, gapped, columns, np.eye(3), np.empty(0), KnotSpacing(1 / HZ), at
    )
    assert knots.dt.size < at.size - 1
    assert knots.dt.max() < 0.1
    # The earth's rate and what remains of the readback's noise.
    assert np.abs(knots.columns[0][:, 3:6]).max() < 1e-5


def resampled(track: Track, hz: float, *, held: bool) -> Track:
    """Return the track with a readback that the log holds or interpolates between readings."""
    at = np.arange(track.time[0] - 0.37 / hz, track.time[-1] + 1, 1 / hz)
    read = np.stack([np.interp(at, track.time, one) for one in track.angles.T], axis=-1)
    last = np.clip(np.searchsorted(at, track.time + 1e-9, "right") - 1, 0, None)
    lines = np.stack([np.interp(track.time, at, one) for one in read.T], axis=-1)
    return replace(track, angles=read[last] if held else lines)


@pytest.mark.parametrize("hz", [50.0, 33.0, 12.5, 5.0])
def test_an_interpolated_readback_is_not_blamed_but_its_jumps_are(
    sound: tuple[Run, Track, float], hz: float
):
    run, track, at = sound
    assert isinstance(run.bench, Turntable)
    lines = resampled(track, hz, held=False)
    assert readback_interval(lines) == pytest.approx(1 / hz, rel=0.1)
    assert repeated_readback_finding(lines) is None
    assert gyro_comparison_findings(lines, run.sensor, run.bench) == ()
    wrong = replace(lines, angles=offset(0.1)(lines.time, lines.angles.copy(), at))
    finding, *_ = gyro_comparison_findings(wrong, run.sensor, run.bench)
    assert finding.start is not None
    assert track.time[finding.start] == pytest.approx(at, abs=0.2)


@pytest.mark.parametrize(("hz", "held"), [(20.0, True), (2.0, False)])
def test_a_readback_that_is_too_slow_is_named_once_with_its_rate(
    sound: tuple[Run, Track, float], hz: float, held: bool
):
    _, track, _ = sound
    assert repeated_readback_finding(track) is None
    assert readback_interval(track) == 0.0
    finding = repeated_readback_finding(resampled(track, hz, held=held))
    assert finding is not None
    found = finding.message.partition(" Hz")[0].rpartition(" ")[2]
    assert float(found) == pytest.approx(hz, rel=0.1)
