"""Check a driver; each check returns what it found, or raises an error that says what is wrong.

All motions are at 20 °/s and 40 °/s², or at half of the limits if these are lower.
"""

from collections.abc import Callable
from itertools import pairwise
from math import degrees, isfinite, isnan, nan, radians
from statistics import median
from typing import Any

from inercal.basics.errors import InputError
from inercal.host.driver_check.relay import GRACE, MALFORMED, CheckFailed, LinkProbe, Probe, require
from inercal.host.drivers.rotary_table import (
    REST_RATE,
    AxisLimits,
    LinkLost,
    ProtocolError,
    RotaryTable,
    TableFault,
    TableState,
    require_unique_names,
)

_RATE, _ACCELERATION, _TURN = radians(20), radians(40), radians(10)
_ARRIVAL = radians(0.05)  # rad from the goal, when a move is reported to be complete
_RATE_TOLERANCE = 0.05  # of the commanded rate, in addition to the resolution of slow controllers
_HOMING_TIME = 60.0  # s
_STEADY_TIME = 0.2  # s after the acceleration; the servo still settles
_CLOCK_TIME, _CLOCK_TOLERANCE, _CLOCK_STEP = 0.5, 0.02, 0.005  # s, of the time, s


def identity(probe: Probe) -> str:
    """Check the identity of the table, its axes with their limits, and a first reading."""
    with probe.open() as table:
        name = table.identity()
        require(name.isprintable(), f"the identity {name!r} is not one line of text")
        require_unique_names(table.axes)
        named = probe.bench.names if probe.bench is not None else table.axes
        require(table.axes == named, f"the axes are {table.axes}, but the bench has {named}")
        count, state = len(table.axes), table.read()
        require(len(table.limits) == count, f"{len(table.limits)} limits for {count} axes")
        require(len(state.axes) == count, f"a reading has {len(state.axes)} axes, not {count}")
        require(table.wrap_period > 0, f"the clock wraps after {table.wrap_period} s")
        late = state.time > table.wrap_period + state.span
        wraps = f"the clock wraps after {table.wrap_period:.6g} s"
        require(not late, f"{wraps}, but the first reading has the time {state.time:.6g} s")
        unknown = set(table.unsupported) - {"servo", "home"}
        require(not unknown, f"`unsupported` contains {unknown}; possible: servo, home")
        for axis, limits, one in zip(table.axes, table.limits, state.axes, strict=True):
            possible = limits.rate > 0 and limits.acceleration > 0 and limits.low < limits.high
            require(possible, f"axis {axis} cannot turn within {limits}")
            require(isfinite(one.angle), f"axis {axis} has the angle {one.angle}")
            require(isfinite(one.rate), f"axis {axis} has the rate {one.rate}")
        return f"{name or 'no identity'}; axes {', '.join(table.axes)}"


def limits(probe: Probe) -> str:
    """Check that impossible motions are refused before anything is sent."""
    with probe.open_enabled() as table:
        probe.relay.wait_for_bytes(probe.timeout)
        count = 0
        for axis, limit in zip(table.axes, table.limits, strict=True):
            angle = table.read().axes[table.axes.index(axis)].angle
            for what, act in _impossible(table, axis, limit, angle).items():
                require_refused(probe, f"axis {axis}: {what}", act)
                count += 1
        require_refused(probe, "an unknown axis", lambda: table.spin("?", _RATE, _ACCELERATION))
        return f"{count + 1} impossible commands refused"


def _impossible(
    table: RotaryTable, axis: str, limit: AxisLimits, angle: float
) -> dict[str, Callable[[], None]]:
    """Return commands that exceed the limits of an axis, by what is wrong with them."""
    rate, acceleration = _motion(limit)
    found: dict[str, Callable[[], None]] = {
        "a rate that is not a number": lambda: table.spin(axis, nan, acceleration),
        "a move at rate 0": lambda: table.move(axis, angle, 0.0, acceleration),
        "an acceleration of 0": lambda: table.spin(axis, rate, 0.0),
    }
    if isfinite(most := limit.rate):
        found["a spin above the rate limit"] = lambda: table.spin(axis, -2 * most, acceleration)
        found["a move above the rate limit"] = lambda: table.move(
            axis, angle, 2 * most, acceleration
        )
    if isfinite(limit.acceleration):
        found["an acceleration above the limit"] = lambda: table.spin(
            axis, rate, 2 * limit.acceleration
        )
    for end, beyond in ((limit.low, -_TURN), (limit.high, _TURN)):
        if isfinite(end):
            found[f"a move to {degrees(end + beyond):.6g}°, beyond the soft limit"] = (
                lambda goal=end + beyond: table.move(axis, goal, rate, acceleration)
            )
    return found


def require_refused(probe: LinkProbe[Any], what: str, act: Callable[[], None]) -> None:
    """Require that a call raises an `InputError`, and that nothing is sent."""
    before = probe.relay.received_bytes
    refused = False
    try:
        act()
    except InputError:
        refused = True
    except (LinkLost, ProtocolError, TableFault):
        pass  # the controller refused it, but another controller may obey
    probe.relay.wait_for_bytes(probe.timeout)
    sent = probe.relay.received_bytes > before
    require(refused and not sent, f"{what} was {'sent' if sent else 'not refused'}")


def servo_and_homing(probe: Probe) -> str:
    """Check that the servos switch on, and that the zero is found."""
    with probe.open_enabled() as table:
        if "home" in table.unsupported:
            return f"servos on; no homing: {table.unsupported['home']}"
        if not all(axis.homed for axis in table.read().axes):
            table.home()
        done = probe.wait(table, _homed, _HOMING_TIME, "is not homed")
        return f"homed at {', '.join(f'{degrees(axis.angle):.3f}°' for axis in done.axes)}"


def move(probe: Probe) -> str:
    """Check that a move arrives, and that its end is not reported before."""
    worst = 0.0
    with probe.open_enabled() as table:
        for i, axis in enumerate(table.axes):
            start = table.read()
            goal = _goal(start.axes[i].angle, table.limits[i])
            end = _move_to(probe, table, axis, goal)
            worst = max(worst, abs(end.axes[i].angle - goal))
            for k, (a, b) in enumerate(zip(start.axes, end.axes, strict=True)):
                still = k == i or abs(a.angle - b.angle) < _TURN / 10
                require(still, f"axis {table.axes[k]} moved instead of, or with, axis {axis}")
    return f"arrived within {degrees(worst):.4f}°"


def _move_to(probe: Probe, table: RotaryTable, axis: str, goal: float) -> TableState:
    """Move an axis, and return the state when the move is reported to be complete."""
    i = table.axes.index(axis)
    rate, acceleration = _motion(table.limits[i])
    way = abs(goal - table.read().axes[i].angle)

    def arrived(state: TableState) -> bool:
        one = state.axes[i]
        most = 1.2 * rate + REST_RATE
        require(abs(one.rate) < most, f"axis {axis} moves at {degrees(one.rate):.3g} °/s")
        off = degrees(one.angle - goal)
        require(
            not one.settled or abs(one.angle - goal) < _ARRIVAL,
            f"axis {axis} is reported in position, but it is {off:+.3f}° from its goal",
        )
        return one.settled

    table.move(axis, goal, rate, acceleration)
    way_time = way / rate + rate / acceleration
    return probe.wait(table, arrived, way_time, f"has not arrived at {degrees(goal):.3f}°")


def rate_mode(probe: Probe) -> str:
    """Check that each axis turns at a commanded rate, in both directions."""
    worst = 0.0
    with probe.open_enabled() as table:
        for i, axis in enumerate(table.axes):
            for sign in _directions(table, i):
                rate, acceleration = _motion(table.limits[i])
                rate *= sign
                near = _RATE_TOLERANCE * abs(rate) + REST_RATE
                begin = table.read().axes[i].angle
                _start_turning(probe, table, i, sign)
                last = probe.wait(
                    table,
                    lambda state, i=i, rate=rate, near=near: abs(state.axes[i].rate - rate) < near,
                    2 * abs(rate) / acceleration,
                    f"does not turn axis {axis} at {degrees(rate):.3g} °/s",
                )
                way = last.axes[i].angle - begin
                require(way * rate > 0, f"axis {axis} turns by {degrees(way):.3g}° the wrong way")
                require(last.axes[i].moving, f"axis {axis} turns, but is not reported as moving")
                worst = max(worst, abs(last.axes[i].rate - rate))
            table.spin(axis, 0.0, _motion(table.limits[i])[1])
            probe.wait(table, _rests, _stopping_time(table, i), f"is not at rest (axis {axis})")
    return f"rates within {degrees(worst):.3g} °/s"


def clock(probe: Probe) -> str:
    """Check that the times of readings agree with the elapsed time, and with angle and rate."""
    with probe.open_enabled() as table:
        sign = _directions(table, 0)[0]
        _start_turning(probe, table, 0, sign)
        read = [_timed_reading(probe, table)]
        while read[-1][1] - read[0][1] < _CLOCK_TIME:
            read.append(_timed_reading(probe, table))
        trips = median(after - before for before, after, _ in read)
        times = [state.time for _, _, state in read]
        if all(isnan(time) for time in times):
            return f"no clock; the time of arrival is used ({1e3 * trips:.1f} ms for a reading)"
        require(all(map(isfinite, times)), "some readings have a time and others have none")
        for a, b in pairwise(times):
            require(
                a <= b,
                f"the clock goes back from {a:.6g} s to {b:.6g} s; if it wraps around, read() "
                "needs `unwrapped_time` and the right `wrap_period`",
            )
        (begun, began, first), (ends, ended, last) = read[0], read[-1]
        passed = last.time - first.time
        spare = _CLOCK_STEP + first.span + last.span + _CLOCK_TOLERANCE * (ended - begun)
        require(
            ends - began - spare < passed < ended - begun + spare,
            f"the clock of the table advances by {passed:.4g} s in {ended - begun:.4g} s",
        )
        way = last.axes[0].angle - first.axes[0].angle
        expected = (first.axes[0].rate + last.axes[0].rate) / 2 * passed
        require(
            abs(way - expected) < _RATE_TOLERANCE * abs(way) + REST_RATE * passed,
            f"in {passed:.4g} s by its clock, the axis turns by {degrees(way):.4g}°, but "
            f"{degrees(expected):.4g}° are expected from its rate",
        )
        return f"{passed:.4g} s in {ended - begun:.4g} s; {1e3 * trips:.1f} ms for a reading"


def _timed_reading(probe: Probe, table: RotaryTable) -> tuple[float, float, TableState]:
    before = probe.now()
    state = table.read()
    return before, probe.now(), state


def stop(probe: Probe) -> str:
    """Check that the table stops in time, even if no reply arrives."""
    with probe.open_enabled() as table:
        _start_turning(probe, table, 0, _directions(table, 0)[0])
        begun = probe.now()
        table.stop()
        stopping = _stopping_time(table, 0)
        state = probe.wait(table, _rests, stopping, "has not stopped")
        took = probe.now() - begun
        require(all(axis.enabled for axis in state.axes), "a stop switches the servo off")
        _start_turning(probe, table, 0, _directions(table, 0)[0])
        probe.relay.silence()
        probe.expect_error(table.stop, "a stop without a reply")
    probe.relay.mend()
    with probe.open() as table:
        probe.wait(table, _rests, stopping, "has not stopped, because no reply arrived,")
    return f"at rest after {took:.2f} s, of at most {stopping + GRACE:.2f} s"


def lost_link(probe: LinkProbe[Any]) -> str:
    """Check that a driver reports soon enough that the link is lost, or that no reply comes."""
    with probe.open() as table:
        table.read()
        probe.relay.unplug()
        lost = [probe.expect_error(table.read, "the link was unplugged") for _ in range(2)]
    probe.relay.mend()
    with probe.open() as table:
        table.read()
        probe.relay.silence()
        silent = probe.expect_error(table.read, "no reply arrived")
    return f"unplugged: {max(lost):.2f} s; silent: {silent:.2f} s"


def reconnection(probe: Probe) -> str:
    """Check that the table can be used again after its link was lost or silent."""
    with probe.open_enabled() as table:
        before = table.read().axes[0]
        for state in probe.read_after_losses(table):
            off = abs(state.axes[0].angle - before.angle)
            still = off < _TURN / 10 or not before.rests
            require(still, f"the angle of an axis at rest changed by {degrees(off):.3g}°")
    return "readings continue after an unplugged and a silent link"


def malformed_replies(probe: LinkProbe[Any]) -> str:
    """Check that no part of a malformed reply is used."""
    refused: list[str] = []
    for what, change in MALFORMED.items():
        with probe.open() as table:
            table.read()
            if not (probe.relay.is_binary and change is MALFORMED["letters for digits"]):
                probe.relay.change = change
                probe.expect_error(table.read, what)
                refused.append(what)
        probe.relay.mend()
    return f"refused: {', '.join(refused)}"


def late_reply(probe: LinkProbe[Any]) -> str:
    """Check that a late reply is not taken for the reply to the next request."""
    with probe.open() as table:
        table.read()
        probe.relay.held = []
        probe.expect_error(table.read, "the reply was late")
        probe.relay.silence()
        probe.relay.release()
        probe.expect_error(table.read, "a late reply was used for the next reading")
    return "discarded"


def after_an_error(probe: Probe) -> str:
    """Check that neither a refused nor an unanswered command changes what is reported."""
    with probe.open_enabled() as table:
        axis, limit = table.axes[0], table.limits[0]
        there = _goal(table.read().axes[0].angle, limit)
        here = _move_to(probe, table, axis, there).axes[0]
        other = _goal(here.angle, limit)
        try:
            table.move(axis, other, -1.0, 1.0)
        except InputError:
            pass
        else:
            raise CheckFailed("a move at a rate below 0 was not refused")
        state = table.read().axes[0]
        require(state.settled, "the axis is no longer in position after a refused command")
        probe.relay.silence()
        probe.expect_error(
            lambda: table.move(axis, other, *_motion(limit)), "a move without a reply"
        )
        probe.relay.mend()
        probe.read_again(table, "after a move without a reply")
        _move_to(probe, table, axis, there)
    return "the state is right after a refused command, and after one without a reply"


def close(probe: LinkProbe[Any]) -> str:
    """Check that the connection is released, and that a second call does nothing."""
    with probe.open() as table:
        table.read()
        for _ in range(2):
            table.close()
        probe.relay.wait_for_bytes(probe.timeout)
        require(not probe.relay.connections, "the connection is still open after close()")
    return "the connection is released"


def _motion(limit: AxisLimits) -> tuple[float, float]:
    """Return rate and acceleration for an axis."""
    return min(_RATE, limit.rate / 2), min(_ACCELERATION, limit.acceleration / 2)


def _goal(angle: float, limit: AxisLimits) -> float:
    """Return an angle to which an axis can move."""
    up, down = min(angle + _TURN, limit.high), max(angle - _TURN, limit.low)
    return up if up - angle >= angle - down else down


def _directions(table: RotaryTable, i: int) -> tuple[int, int]:
    """Return both directions; the one with more room before a soft limit comes first."""
    angle, limit = table.read().axes[i].angle, table.limits[i]
    return (1, -1) if limit.high - angle >= angle - limit.low else (-1, 1)


def _start_turning(probe: Probe, table: RotaryTable, i: int, sign: int) -> TableState:
    """Command a rate, and return a state after the acceleration, whatever its rate is."""
    rate, acceleration = _motion(table.limits[i])
    start = table.read().axes[i].angle
    way, time = rate**2 / (2 * acceleration) + rate * _STEADY_TIME, rate / acceleration
    table.spin(table.axes[i], sign * rate, acceleration)
    return probe.wait(
        table,
        lambda state: abs(state.axes[i].angle - start) > way,
        2 * time + _STEADY_TIME,
        f"does not turn axis {table.axes[i]} at {degrees(sign * rate):.3g} °/s",
    )


def _stopping_time(table: RotaryTable, i: int) -> float:
    rate, acceleration = _motion(table.limits[i])
    return rate / acceleration


def _homed(state: TableState) -> bool:
    return all(axis.homed and axis.settled for axis in state.axes)


def _rests(state: TableState) -> bool:
    return all(axis.rests for axis in state.axes)


CHECKS: dict[str, Callable[[Probe], str]] = {
    "identity": identity,
    "limits": limits,
    "servo and homing": servo_and_homing,
    "move": move,
    "rate": rate_mode,
    "clock": clock,
    "stop": stop,
    "lost link": lost_link,
    "reconnection": reconnection,
    "malformed replies": malformed_replies,
    "late reply": late_reply,
    "after an error": after_an_error,
    "close": close,
}
