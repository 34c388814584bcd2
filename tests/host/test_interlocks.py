"""What stops a run though no device says a fault."""

from dataclasses import replace
from math import inf, nan, pi, radians

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.motion_control import AxisMotionLimits
from inercal.benches.turntable.attitude import motion
from inercal.host.drivers.rotary_table import AxisLimits, AxisState, TableState
from inercal.host.interlocks import Interlocks
from inercal.physics.sensors import imu
from inercal.recordings import Track

BENCH = Turntable(
    Measured(9.8, 0.0),
    radians(38),
    Measured(0.4, 0.0),
    limits=(AxisMotionLimits(radians(100), radians(50)),),
)
LIMITS = (AxisLimits(following_error=radians(2)),) * 3
IMU = imu()
RATE = 200.0


def _state(time: float = nan, **middle: float) -> TableState:
    still = AxisState(0.0, 0.0, 0.0, in_position=True, moving=False, enabled=True, homed=True)
    return TableState(time, (still, replace(still, **middle), still))


def _interlocks(temperature: tuple[float, float] | None = None) -> Interlocks:
    return Interlocks(LIMITS, BENCH, IMU, temperature)


def _shown(checks: Interlocks, *states: TableState) -> list[str | None]:
    return [checks.check(state, 0.02 * k) for k, state in enumerate(states)]


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (
            {"following_error": radians(1.01)},
            "axis middle: the following error is 1.01°",
        ),
        ({"rate": radians(-121)}, r"axis middle: it turns at 121 °/s; its limit is 100 °/s"),
    ],
)
def test_what_an_axis_must_not_do_is_told_at_its_second_reading(wrong: dict[str, float], says: str):
    bad = _state(**wrong)
    first, second = _shown(_interlocks(), bad, bad)
    assert first is None
    assert second is not None
    assert second.startswith(says)
    # One false reading between good ones is a false digit.
    assert _shown(_interlocks(), bad, _state(), bad, _state()) == [None] * 4


def test_what_an_axis_may_do_is_no_fault():
    fine = _state(rate=radians(119), following_error=radians(-0.99))
    assert _shown(_interlocks(), fine, fine, fine) == [None] * 3
    unknown = _state(following_error=nan)
    assert _shown(_interlocks(), unknown, unknown) == [None] * 2
    free = Interlocks((AxisLimits(following_error=inf),) * 3, BENCH, IMU)
    assert _shown(free, *[_state(following_error=1.0)] * 3) == [None] * 3


def test_a_controller_whose_clock_stands_hangs():
    checks = _interlocks()
    times = np.arange(0, 2, 0.02)
    found = [checks.check(_state(time=min(t, 1.0)), t) for t in times]
    told = times[[words is not None for words in found]]
    assert told[0] == pytest.approx(1.52, abs=0.03)
    assert found[-1] == "the table's controller hangs: its clock stopped at 1.000 s"
    # A table that tells no time does not hang.
    checks = _interlocks()
    assert not any(checks.check(_state(), t) for t in times)


def test_a_temperature_outside_for_a_second_is_told():
    checks = _interlocks(temperature=(288.15, 308.15))
    times = np.arange(0, 4, 0.02)
    warm = np.where(times == 1.0, 500.0, np.where(times > 2, 309.15, 298.15))
    found = [checks.check(_state(), t, temperature=w) for t, w in zip(times, warm, strict=True)]
    assert times[[words is not None for words in found]][0] == pytest.approx(3.04, abs=0.03)
    assert found[-1] == "the IMU is at 36.0 °C; allowed: 15.0 to 35.0 °C"
    assert checks.check(_state(), 9.0, temperature=nan) is None


def test_limits_of_another_number_of_axes_are_refused():
    with refused(key="limits", names=BENCH.names):
        Interlocks(LIMITS[:2], BENCH, IMU)


def _track(
    rates: tuple[float, float, float],
    frozen: tuple[int, ...] = (),
    at: tuple[float, float, float] = (0.3, 0.4, 0.5),
    bias: float = 0.0,
    scale: float = 0.0,
    start: float = 0.0,
) -> Track:
    """Return 1 s in which axes turn at rates, °/s, from 0.5 s on, some of their encoders frozen."""
    time = start + np.arange(int(RATE)) / RATE
    turning = np.clip(time - start - 0.5, 0, None)
    rate = np.radians(rates)
    angles = np.array(at) + turning[:, None] * rate
    felt = motion(BENCH, angles, np.where(turning > 0, 1, 0)[:, None] * rate, 0 * angles, {})
    inputs = np.array([axis.i for axis in IMU.axes])
    force = np.array([axis.measures == "f" for axis in IMU.axes])
    reading = np.where(force, felt.f @ inputs.T, (1 + scale) * felt.w @ inputs.T + bias)
    said = angles.copy()
    said[:, list(frozen)] = said[0, list(frozen)]
    return Track(time, reading, said, np.full(time.size, -1))


def _pieces(track: Track, size: int) -> list[Track]:
    return [track.slice(k, k + size) for k in range(0, track.time.size, size)]


@pytest.mark.parametrize("size", [3, 10, 100, 200])
@pytest.mark.parametrize(("axis", "name"), [(0, "outer"), (1, "middle"), (2, "inner")])
def test_an_encoder_that_stands_while_the_gyros_turn_is_named(axis: int, name: str, size: int):
    rates = [(12.0, 0.0, 0.0), (0.0, 12.0, 0.0), (0.0, 0.0, 12.0)][axis]
    checks, told = _interlocks(), list[tuple[float, str]]()
    for piece in _pieces(_track(rates, (axis,)), size):
        if words := checks.check_gyros(piece):
            told.append((piece.time[-1], words))
    assert told[0][1] == f"axis {name}: the encoder stands still while the gyros measure 12 °/s"
    # 0.2 s of it, and half a window of 20 ms.
    assert told[0][0] <= 0.5 + 0.2 + 0.05 + size / RATE


def test_other_axes_that_turn_meanwhile_are_not_blamed():
    checks = _interlocks()
    words = checks.check_gyros(_track((10.0, -12.0, 40.0), (1,)))
    assert words == "axis middle: the encoder stands still while the gyros measure -12 °/s"


def test_axes_that_are_one_are_both_named():
    checks = _interlocks()
    words = checks.check_gyros(_track((12.0, 0.0, 0.0), (0,), at=(0.3, 0.0, pi / 2)))
    assert words is not None
    assert words.startswith("axis outer: ")
    checks = _interlocks()
    # At 90° of the middle axis the inner one is the outer one.
    words = checks.check_gyros(_track((12.0, 0.0, 0.0), (0,), at=(0.3, pi / 2, 0.0)))
    assert words is not None
    assert words.startswith("axis outer or inner: the encoder stands still")


@pytest.mark.parametrize("rates", [(0.0, 0.0, 0.0), (30.0, -20.0, 10.0), (0.0, 0.0, 100.0)])
def test_declared_errors_are_no_frozen_encoder(rates: tuple[float, float, float]):
    checks = _interlocks()
    for k in range(3):
        track = _track(rates, bias=radians(1.5), scale=0.03, start=float(k))
        assert checks.check_gyros(track) is None


def test_gyros_that_are_dead_are_told():
    track = _track((0.0, 0.0, 30.0))
    dead = Track(track.time, 0 * track.reading, track.angles, track.hold)
    words = _interlocks().check_gyros(dead)
    assert words is not None
    assert words.startswith("axis inner: the encoder turns at 30 °/s while the gyros measure")


def test_an_imu_that_is_not_as_the_run_file_says_is_told():
    track = _track((0.0, 20.0, 30.0))
    turned = track.reading[:, [0, 1, 2, 5, 3, 4]]
    words = _interlocks().check_gyros(Track(track.time, turned, track.angles, track.hold))
    assert words is not None
    assert (
        "rotation about one table axis does not explain this; check that the IMU is mounted"
        in words
    )


def test_a_gap_is_no_difference():
    track = _track((0.0, 0.0, 30.0))
    checks = _interlocks()
    assert checks.check_gyros(track.slice(0, 110)) is None
    assert checks.check_gyros(track.slice(170, 200)) is None


def test_accelerometers_alone_say_nothing_of_rates():
    alone = IMU.select_axes("f")
    track = _track((0.0, 0.0, 30.0), (2,))
    few = Track(track.time, track.reading[:, :3], track.angles, track.hold)
    assert Interlocks(LIMITS, BENCH, alone).check_gyros(few) is None
