"""Readings of the table with a wrong digit are left out; true ones never are."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import degrees, nan, radians
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import chosen, evidence
from tests.host.synthetic_log import LAYOUT, PATH, Bench, Faults, run_file

from inercal.basics.units import Measured
from inercal.benches.motion_control import AxisMotionLimits
from inercal.benches.turntable import Turntable
from inercal.host.assembly import SampleAssembler, SampleBlock
from inercal.host.assembly.reading_plausibility import (
    MAX_IMPLAUSIBLE_READINGS,
    AxisReading,
    ReadingPlausibility,
)
from inercal.host.drivers.rotary_table import unpack_states
from inercal.host.live_estimator import LiveEstimator
from inercal.host.run_log import TABLE, LogFrame
from inercal.runfile import Run

ARCSEC = radians(1 / 3600)
STEP = 0.02  # s
LIMITS = (AxisMotionLimits(radians(30), radians(15)),)
BENCH = Turntable(Measured(9.8, 0.0), radians(38), axes="z", limits=LIMITS, white=0.5 * ARCSEC)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run_file(tmp_path_factory.mktemp("run"), PATH)


def turn(acceleration: float = radians(15), rate: float = radians(30)) -> Iterator[AxisReading]:
    """Yield a rest, a turn by a trapezoid of the rate, and a rest, a reading each 20 ms."""
    angle, now = 0.0, 0.0
    for wanted, count in ((0.0, 50), (rate, 300), (0.0, 300)):
        for _ in range(count):
            before = now
            step = acceleration * STEP
            now += min(max(wanted - now, -step), step)
            angle += (before + now) / 2 * STEP
            yield AxisReading(angle, now, 0.0)


def judged(readings: Sequence[AxisReading], check: ReadingPlausibility) -> list[bool]:
    return [check.accept(k * STEP, [one], settled=one.rate == 0) for k, one in enumerate(readings)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", chosen(range(5), (0,)))
def test_no_true_reading_is_left_out(run: Run, seed: int):
    bench = Bench(run, seed=seed, latency=0.004)
    made = SampleAssembler(run, LAYOUT)
    for frame in bench.frames():
        made.feed(frame)
    made.take()
    assert made.table.count > 2000
    assert made.table.implausible == 0


@pytest.mark.slow
@pytest.mark.parametrize("error", [0.2, -5.0, evidence(5.0), evidence(40.0)])
def test_a_wrong_digit_is_left_out_wherever_it_is(error: float):
    true = list(turn())
    for at in range(3, len(true) - 3, 7):
        said = true.copy()
        said[at] = replace(said[at], angle=said[at].angle + radians(error))
        check = ReadingPlausibility(BENCH)
        assert [k for k, good in enumerate(judged(said, check)) if not good] == [at]
        assert check.rejected == 1
        assert not check.is_fault


def test_in_a_hold_ten_arcseconds_and_the_noise_are_the_limit():
    check = ReadingPlausibility(BENCH)
    for k, off in enumerate((0, 0, 12, 0, 30, 0, -60, 0)):
        good = check.accept(0.08 * k, [AxisReading(off * ARCSEC, 0.0, 0.0)], settled=True)
        assert good == (abs(off) < 20)
    # A servo that is pushed says so by its following error.
    assert check.accept(0.7, [AxisReading(30 * ARCSEC, 0.0, -30 * ARCSEC)], settled=True)


def test_a_wrong_rate_is_left_out_with_its_reading():
    said = list(turn())
    said[200] = replace(said[200], rate=said[200].rate + radians(10))
    check = ReadingPlausibility(BENCH)
    assert [k for k, good in enumerate(judged(said, check)) if not good] == [200]


def test_a_stop_that_is_harder_than_the_limits_is_no_fault():
    """A table that is stopped decelerates as its controller is set, not as a plan moves it."""
    said = list(turn(acceleration=radians(570)))
    check = ReadingPlausibility(BENCH)
    good = judged(said, check)
    assert not check.is_fault
    assert sum(not one for one in good) <= 2 * 3
    assert all(good[-200:])


def test_an_encoder_that_jumps_is_a_fault_after_five_readings():
    said = list(turn())
    said[100:] = [replace(one, angle=one.angle + radians(7)) for one in said[100:]]
    check = ReadingPlausibility(BENCH)
    good = judged(said[:104], check)
    assert good.index(False) == 100
    assert not check.is_fault
    check.accept(104 * STEP, [said[104]], settled=False)
    assert check.is_fault
    assert check.in_a_row == MAX_IMPLAUSIBLE_READINGS == 5
    check.restart()
    assert check.accept(105 * STEP, [said[105]], settled=False)


def test_what_a_controller_does_not_tell_is_not_compared():
    said = [replace(one, rate=nan, following_error=nan) for one in turn()]
    check = ReadingPlausibility(BENCH)
    assert all(judged(said, check))
    said[150] = replace(said[150], angle=said[150].angle + radians(0.05))
    assert [k for k, good in enumerate(judged(said, ReadingPlausibility(BENCH))) if not good] == [
        150
    ]


def test_an_axis_without_a_zero_is_compared_with_nothing():
    check = ReadingPlausibility(BENCH)
    for k, angle in enumerate((0.0, nan, 2.0, 2.0)):
        assert check.accept(k * STEP, [AxisReading(angle, 0.0, 0.0)], settled=True)


def with_wrong_digits(frames: Sequence[LogFrame], seed: int, share: float) -> list[LogFrame]:
    """Return the frames with one decimal digit of an angle changed in a share of the polls."""
    rng, made = np.random.default_rng(seed), list[LogFrame]()
    for frame in frames:
        if frame.kind == TABLE and rng.random() < share:
            angle = np.frombuffer(frame.payload[16:24], "<f8")[0]
            digits = list(f"{abs(degrees(angle)):011.5f}")
            at = int(rng.choice([k for k, one in enumerate(digits) if one != "."]))
            digits[at] = str((int(digits[at]) + int(rng.integers(1, 10))) % 10)
            wrong = np.copysign(radians(float("".join(digits))), angle)
            payload = frame.payload[:16] + np.float64(wrong).tobytes() + frame.payload[24:]
            frame = frame._replace(payload=payload)
        made.append(frame)
    return made


def samples(run: Run, frames: Sequence[LogFrame]) -> tuple[SampleAssembler, SampleBlock]:
    made = SampleAssembler(run, LAYOUT)
    for frame in frames:
        made.feed(frame)
    block = made.take()
    assert block is not None
    return made, block


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_angles_between_are_true_where_digits_were_wrong(run: Run, seed: int):
    bench = Bench(run, seed=seed, quiet=True)
    made, block = samples(run, with_wrong_digits(bench.frames(), seed, 0.01))
    truth = bench.angles(block.table - bench.servo)
    apart = np.abs(block.angles - truth).max(axis=-1)
    assert made.table.implausible > 8
    # What is within the limits of rate and acceleration is for the filter's innovations to tell.
    assert apart.max() < 0.05 * 3600 * ARCSEC
    assert np.isfinite(block.quality.noise_gain).mean() > 0.98


@pytest.mark.slow
def test_angles_beside_an_outage_through_a_stop_are_not_usable(run: Run):
    """The table is not read for 0.1 s in which the turn ends: it may have stopped anywhere."""
    bench = Bench(run, seed=2, quiet=True, faults=Faults())
    frames = bench.frames()
    states = unpack_states([one.payload for one in frames if one.kind == TABLE])
    turned = np.abs(states.rate).max(axis=-1) > radians(2)
    stop = float(states.time[np.flatnonzero(turned)[-1]]) - bench.servo
    gone = stop - 0.02, stop + 0.07
    kept = [one for one in frames if one.kind != TABLE or not gone[0] < one.time < gone[1]]
    made, block = samples(run, kept)
    when = block.table - bench.servo
    near = (when > gone[0] + 0.005) & (when < gone[1] - 0.005)
    assert near.sum() >= 12  # no sample of the IMU is lost
    assert np.isinf(block.quality.interpolation_sd[near]).all()
    assert made.samples_with_unusable_angle >= near.sum()
    usable = np.isfinite(block.quality.noise_gain)
    off = np.abs(block.angles - bench.angles(when)).max(axis=-1)
    assert off[near].max() > 100 * ARCSEC  # what a line or a cubic makes of the stop
    assert off[usable].max() < 20 * ARCSEC


@pytest.mark.slow
@pytest.mark.parametrize("seed", chosen(range(3), (0,)))
def test_the_filter_goes_through_an_outage_at_a_stop_by_the_gyros(run: Run, seed: int):
    """Angles interpolated through the stop gave a NIS of hundreds and biases that were off."""
    bench = Bench(run, seed=seed)
    frames = bench.frames()
    states = unpack_states([one.payload for one in frames if one.kind == TABLE])
    turned = np.abs(states.rate).max(axis=-1) > radians(2)
    stop = float(states.time[np.flatnonzero(turned)[-1]]) - bench.servo
    for before, after in ((0.02, 0.07), (0.15, 0.1), (0.3, 0.05)):
        kept = [
            one
            for one in frames
            if one.kind != TABLE or not stop - before < one.time < stop + after
        ]
        live = LiveEstimator(run)
        live.feed(samples(run, kept)[1])
        nis, components = live.innovations["w"]
        assert 0.8 < nis / components < 1.1


@pytest.mark.slow
def test_the_interpolation_says_how_far_it_is_off(run: Run):
    """Where an axis begins to accelerate a cubic is off by arcseconds, and its sd is as large."""
    errors, expected, steady = list[float](), list[float](), list[float]()
    for phase in np.linspace(0, STEP, 6, endpoint=False).tolist():
        bench = Bench(run, seed=4, quiet=True, begun=2.0 + phase)
        _, block = samples(run, bench.frames())
        off = np.abs(block.angles - bench.angles(block.table - bench.servo)).max(axis=-1)
        sd = block.quality.interpolation_sd
        known = np.isfinite(sd)
        errors.append(float(np.sum(off[known] ** 2)))
        expected.append(float(np.sum(sd[known] ** 2)))
        steady.append(float(np.mean(sd[known] < 1e-3 * ARCSEC)))
    assert sum(errors) == pytest.approx(sum(expected), rel=0.4)
    assert min(steady) > 0.9


@pytest.mark.slow
def test_the_noise_of_angles_is_that_of_the_readings_times_its_gain(tmp_path: Path):
    run = run_file(tmp_path, PATH, **{'noise = "0.5 ″"': 'noise = "20 ″"'})
    noisy, quiet = (
        samples(run, replace_noise(Bench(run, seed=5, quiet=True), white).frames())[1]
        for white in (20 * ARCSEC, 0.0)
    )
    gain = noisy.quality.noise_gain
    at = np.isfinite(gain) & (np.abs(quiet.angles[:, 2]) > 0)
    error = (noisy.angles - quiet.angles)[at] / (20 * ARCSEC)
    assert np.mean(error**2) == pytest.approx(np.mean(gain[at]), rel=0.1)
    turning = at & (noisy.hold < 0)
    assert 0.5 < gain[turning].min() < 0.7 < np.mean(gain[turning]) < 0.95
    assert (gain[at & (noisy.hold >= 0)] == 1).all()


def replace_noise(bench: Bench, white: float) -> Bench:
    """Return a bench whose readback has noise and nothing else."""
    frames = bench.frames()
    rng = np.random.default_rng(8)

    def noisy(frame: LogFrame) -> LogFrame:
        if frame.kind != TABLE:
            return frame
        raw = bytearray(frame.payload)
        for i in range((len(raw) - 16) // 25):
            at = 16 + 25 * i
            angle = np.frombuffer(bytes(raw[at : at + 8]), "<f8")[0]
            raw[at : at + 8] = np.float64(angle + white * rng.standard_normal()).tobytes()
        return frame._replace(payload=bytes(raw))

    made = [noisy(one) for one in frames]
    bench.frames = lambda: made  # type: ignore[method-assign]
    return bench
