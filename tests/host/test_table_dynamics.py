"""How a simulated table turns: within its limits, and the same at whatever pace."""

from math import pi, tau

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.refusals import refused

from inercal.host.sim import _table_kernel as kernel
from inercal.host.sim.dynamics import AxisDynamics, ServoOffError, SimulatedTable, three_axes


def _table(axis: AxisDynamics | None = None, **settings: float) -> SimulatedTable:
    table = SimulatedTable([axis or AxisDynamics()], 2000.0)
    for name, value in settings.items():
        table.state[0][name] = value
    table.enable(0)
    return table


def _settled(table: SimulatedTable) -> bool:
    """Tell whether the axis is held, at rest, and within the band."""
    return bool(table.report()[0].flags & kernel.SETTLED)


def _commanded(table: SimulatedTable, until: float) -> np.ndarray:
    """Return the commanded angles of every cycle up to `until`."""
    angles = []
    while table.time + table.period <= until:
        table.advance(table.time + table.period)
        angles.append(float(table.state[0].desired))
    return np.array(angles)


@pytest.mark.parametrize("smooth", [1, 100])
@pytest.mark.parametrize("way", [1e-7, 0.01, -2.0, evidence(1e-4), evidence(1.0)])
def test_the_profile_keeps_rate_and_acceleration_and_ends_at_its_goal(way: float, smooth: int):
    table = _table(speed=0.8, acceleration=1.7, smooth=smooth)
    table.move_axis(0, way)
    angles = _commanded(table, 5.0)
    rates = np.diff(angles, prepend=0.0) / table.period
    turning = np.diff(rates, prepend=0.0) / table.period
    # Second differences of angles of 2 rad are rounded to 4·2e-16 rad in (0.5 ms)².
    assert np.max(np.abs(rates)) <= 0.8 + 1e-9
    assert np.max(np.abs(turning)) <= 1.7 + 1e-8
    assert angles[-1] == way
    assert np.max(angles * np.sign(way)) <= abs(way) + 1e-12
    assert _settled(table)


def test_a_trapezoid_takes_the_time_of_the_textbook():
    table = _table(speed=0.5, acceleration=2.0)
    table.move_axis(0, 1.0)
    angles = _commanded(table, 4.0)
    taken = np.argmax(angles == 1.0) * table.period
    # way / speed + speed / acceleration
    assert taken == pytest.approx(1.0 / 0.5 + 0.5 / 2.0, abs=3 * table.period)


@pytest.mark.slow
def test_an_s_curve_has_no_step_of_acceleration():
    steps = []
    for smooth in (1, 200):
        table = _table(speed=0.5, acceleration=2.0, smooth=smooth)
        table.move_axis(0, 1.0)
        steps.append(np.max(np.abs(np.diff(_commanded(table, 4.0), 3))) / table.period**2)
    assert steps[0] >= 1.9
    assert steps[1] <= 1.1 * 2.0 / 200


def test_a_goal_changed_on_the_way_is_reached():
    table = _table(speed=1.0, acceleration=1.0)
    table.move_axis(0, 3.0)
    table.advance(1.5)
    table.move_axis(0, -1.0)
    table.advance(10.0)
    assert _settled(table)
    assert table.reading(0) == pytest.approx(-1.0, abs=1e-9)


def test_the_servo_lags_at_a_steady_rate_as_its_equation_says():
    axis = AxisDynamics(omega=50.0, zeta=0.7, feedforward=0.5)
    table = _table(axis, speed=0.3)
    table.rotate_axis(0, 1.0)
    table.advance(5.0)
    x = table.state[0]
    # The servo sees the encoder of the cycle before.
    lag = float(x.desired - x.encoder) + 0.3 * table.period
    assert lag == pytest.approx(2 * 0.7 * 0.5 / 50.0 * 0.3, rel=1e-6)


def test_the_same_cycles_give_the_same_numbers_at_whatever_pace():
    results = []
    for steps in (1, 7, 1001):
        table = SimulatedTable(three_axes())
        for i in range(3):
            table.enable(i)
            table.state[i].smooth = 10 * (i + 1)
        table.move_axis(0, 1.0)
        table.rotate_axis(1, -1.0)
        table.search(2)
        parts = [table.advance(8.0 * (k + 1) / steps) for k in range(steps)]
        results.append(np.concatenate(parts))
    for other in results[1:]:
        np.testing.assert_array_equal(other, results[0])


def test_time_that_does_not_come_to_a_cycle_passes_later():
    table = SimulatedTable(three_axes(), 1000.0)
    assert [len(table.advance(until)) for until in (0.0009, 0.003, 0.001, 0.3)] == [0, 3, 0, 297]
    assert table.time == pytest.approx(0.3, rel=1e-12)


def test_true_motion_is_consistent_angle_rate_and_acceleration():
    table = _table(speed=0.8, acceleration=1.7)
    table.move_axis(0, 1.0)
    motion = table.advance(3.0)
    np.testing.assert_allclose(
        np.diff(motion[:, 0, 0]), motion[1:, 0, 1] * table.period, atol=1e-15
    )
    np.testing.assert_allclose(
        np.diff(motion[:, 0, 1]), motion[1:, 0, 2] * table.period, atol=1e-15
    )


def test_a_killed_axis_coasts_by_its_friction_and_refuses_to_move():
    table = _table(AxisDynamics(friction=0.2), speed=1.0)
    table.rotate_axis(0, 1.0)
    table.advance(3.0)
    table.kill(0)
    motion = table.advance(13.0)
    assert motion[2000, 0, 1] == pytest.approx(1.0 - 0.2 * 1.0, abs=1e-3)
    assert motion[-1, 0, 1] == 0.0
    with pytest.raises(ServoOffError):
        table.move_axis(0, 0.0)


def test_the_motors_torque_bounds_the_acceleration_and_the_error_trips():
    table = _table(AxisDynamics(torque=1.0), speed=3.0, acceleration=5.0, fatal=0.05)
    table.rotate_axis(0, 1.0)
    motion = table.advance(2.0)
    assert np.max(np.abs(motion[..., 2])) <= 1.0 + 1e-9
    assert table.state[0].tripped


def test_a_frozen_encoder_hides_the_motion_from_its_reading():
    table = _table(speed=1.0, fatal=0.1)
    table.rotate_axis(0, 1.0)
    table.advance(1.0)
    table.fault(0, "frozen")
    before = table.reading(0)
    table.advance(1.05)
    assert table.reading(0) == before
    assert table.state[0].angle > before + 0.01


def test_harmonics_of_the_encoder_are_in_its_reading_alone():
    bent = AxisDynamics(reading=lambda angle: angle + 1e-4 * np.sin(2 * angle))
    tables = [_table(axis, speed=1.0) for axis in (bent, AxisDynamics())]
    for table in tables:
        table.move_axis(0, pi / 4)
        table.advance(5.0)
    assert tables[0].reading(0) - tables[1].reading(0) == pytest.approx(1e-4, rel=1e-6)
    assert tables[0].state[0].angle == tables[1].state[0].angle


def test_the_index_is_found_from_either_side():
    for direction in (1.0, -1.0):
        table = _table(AxisDynamics(start=1.0, index=0.25), speed=0.5)
        table.search(0, direction)
        table.advance(30.0)
        x = table.state[0]
        assert x.homed
        assert float(x.angle) % tau == pytest.approx(0.25, abs=1e-6)
        assert table.reading(0) == pytest.approx(0.0, abs=1e-6)


def test_a_fault_that_is_none_is_refused_with_those_there_are():
    with refused(key="fault", names=("melted",)):
        _table().fault(0, "melted")
