"""Checks that stop a run although neither the table nor the IMU reports a fault.

Each check returns None, or a text that describes the fault. The table's readings are compared with
the gyros, because the controller cannot detect that an encoder is frozen while its axis turns. w
are the rates from the gyros, v are the rates computed from the readback θ̇ with the geometry of the
bench, and u_i are the directions of the axes in the body frame::

    |w − v| > 5 °/s + |v|/20 for 0.2 s;   axis i explains it with δ_i where  w − v ≈ u_i δ_i

The term |v|/20 allows for scale factor errors, and the 5 °/s allow for biases and the latency of
the readback. An interlock that has not run for 0.5 s gives no protection, so this is also a reason
to stop the table (`LastChecks`). These checks are not a safety function; the hardware interlock is.

`ReadbackWarnings` warn an operator if the gyros contradict the readback. They use the same
comparison as for the recording (`gyro_comparison`). They describe the error of the readback but not
its cause. They do not stop the table, because the interlocks stop dangerous motion.
"""

from collections.abc import Sequence
from math import degrees, inf, isfinite, nan, radians
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS, format_duration
from inercal.benches.motion_control import ControlledBench
from inercal.benches.turntable import Turntable, is_turntable
from inercal.benches.turntable.attitude import motion
from inercal.benches.turntable.reading.gyro_comparison import GyroComparison
from inercal.benches.turntable.reading.implied_rates import gyro_rates, half_window, table_rates
from inercal.host.drivers.rotary_table import AxisLimits, TableState
from inercal.physics.sensors import Sensor
from inercal.recordings import Track

MAX_CHECK_INTERVAL = 0.5  # s between two checks of an interlock
_FOLLOWING_ERROR_SHARE = 0.5  # fraction of the following error at which the servo switches off
_RATE_MARGIN = 1.2  # times the rate limit of the bench
_CLOCK_TIMEOUT = 0.5  # s; the controller's clock may stand still for this time
# Time for which a temperature must be out of range, s. A single false packet is no reason to stop.
_TEMPERATURE_PERSISTENCE = 1.0
_RATE_DIFFERENCE, _RATE_SHARE = radians(5), 0.05  # rad/s, and fraction of the rate
_DIFFERENCE_PERSISTENCE = 0.2  # s
_STANDSTILL_RATE = radians(0.5)  # rad/s
_UNEXPLAINED_SHARE = 0.25  # largest unexplained fraction of the squared difference


Interlock = Literal["table", "gyros"]
_CHECKED = {"table": "the table's readings", "gyros": "the gyros against the table"}


class LastChecks:
    """The run time of the last check of each interlock; an overdue interlock is a fault.

    Parameters
    ----------
    table, gyros : float
        Longest permitted time between two checks of the table's readings, and between two
        comparisons of the gyros with the table, s.

    Attributes
    ----------
    trouble : str or None
        Text that names the overdue interlock; None if no interlock is overdue.
    trouble_since : float
        Run time at which the trouble began, s.
    """

    def __init__(self, table: float = MAX_CHECK_INTERVAL, gyros: float = MAX_CHECK_INTERVAL):
        self.trouble: str | None = None
        self.trouble_since = 0.0
        self._longest = {"table": table, "gyros": gyros}
        self._last: dict[str, float] = {}

    def record(self, which: Interlock, time: float) -> None:
        """Record that an interlock has run; from now on, it must run on schedule."""
        self._last[which] = time

    def pause(self, which: Interlock) -> None:
        """Expect no checks from an interlock until it runs again, because it has no data now."""
        self._last.pop(which, None)

    def update(self, time: float) -> None:
        """Check whether an interlock is overdue at a run time, s."""
        overdue = [
            (which, time - last)
            for which, last in self._last.items()
            if time - last > self._longest[which]
        ]
        if not overdue:
            self.trouble = None
        elif self.trouble is None:
            which, age = overdue[0]
            self.trouble = (
                f"nothing has checked {_CHECKED[which]} for {format_duration(age)}; "
                f"at most {self._longest[which]:g} s are allowed while the table is driven"
            )
            self.trouble_since = time


class Interlocks:
    """The interlock checks of one run.

    Parameters
    ----------
    limits : sequence of AxisLimits
        Limits that are set in the table's controller.
    bench : ControlledBench
        Bench that states the axes and their limits.
    sensor : Sensor
        The sensor whose readings `check_gyros` receives.
    temperature : tuple of two floats, optional
        Lowest and highest permitted temperature of the IMU, K.

    Attributes
    ----------
    has_gyros : bool
        Whether the sensor has gyros that `check_gyros` can compare with the table. This is
        impossible on a rate table, which reports no attitude.
    encoder_stuck : bool
        Whether an axis turned while its encoder was frozen. If its servo is on, the axis
        accelerates.
    rate_difference : float
        Latest difference between the rates from the gyros and from the readback, rad/s; 0 if they
        agree.

    Raises
    ------
    InputError
        The number of limits differs from the number of axes of the bench.
    """

    def __init__(
        self,
        limits: Sequence[AxisLimits],
        bench: ControlledBench,
        sensor: Sensor,
        temperature: tuple[float, float] | None = None,
    ):
        if len(limits) != len(bench.names):
            raise InputError(
                f"limits has {len(limits)} entries, but the bench has {len(bench.names)} axes; "
                "give one for each",
                key="limits",
                names=bench.names,
            )
        self._geometry: Turntable | None = bench if is_turntable(bench) else None
        self._temperature = temperature
        self._axes = tuple(
            (name, of.following_error * _FOLLOWING_ERROR_SHARE, held.rate * _RATE_MARGIN)
            for name, of, held in zip(bench.names, limits, bench.axis_motion_limits, strict=True)
        )
        self._gyros = np.array([axis.measures == "w" for axis in sensor.axes], np.bool_)
        self._inputs = np.array([axis.i for axis in sensor.axes if axis.measures == "w"])
        self.has_gyros = bool(self._inputs.size) and self._geometry is not None
        self.encoder_stuck, self.rate_difference = False, 0.0
        self._since: dict[str, float] = {}
        self._time = nan
        self._previous_samples: tuple[Array, Array, Array] | None = None
        self._agreement_time = nan

    def check(self, state: TableState, now: float, temperature: float | None = None) -> str | None:
        """Describe what is wrong with the table or the IMU; None if nothing is wrong.

        Parameters
        ----------
        state : TableState
            The latest state.
        now : float
            Run time, s.
        temperature : float, optional
            Temperature of the IMU, K; NaN if it is unknown.
        """
        for (name, following, fastest), axis in zip(self._axes, state.axes, strict=True):
            # A single reading is not trusted, because its digits may have been corrupted.
            error, rate = abs(axis.following_error), abs(axis.rate)
            if self._persists(f"error {name}", error > following, now):
                return (
                    f"axis {name}: the following error is {degrees(error):.3g}°, more than "
                    f"{_FOLLOWING_ERROR_SHARE:.0%} of the error at which the servo switches off"
                )
            if self._persists(f"rate {name}", rate > fastest, now):
                return (
                    f"axis {name}: it turns at {degrees(rate):.4g} °/s; its limit is "
                    f"{degrees(fastest / _RATE_MARGIN):.4g} °/s"
                )
        stands, self._time = state.time == self._time, state.time
        if self._persists("clock", stands, now, _CLOCK_TIMEOUT):
            return f"the table's controller hangs: its clock stopped at {state.time:.3f} s"
        if self._temperature and temperature is not None and isfinite(temperature):
            low, high = self._temperature
            if self._persists(
                "temperature", not low <= temperature <= high, now, _TEMPERATURE_PERSISTENCE
            ):
                return (
                    f"the IMU is at {temperature - ZERO_CELSIUS:.1f} °C; allowed: "
                    f"{low - ZERO_CELSIUS:.1f} to {high - ZERO_CELSIUS:.1f} °C"
                )
        return None

    def check_gyros(self, track: Track) -> str | None:
        """Describe how the gyros' rates differ from the readback; None if they agree.

        Parameters
        ----------
        track : Track
            Samples of one trial that continue the samples of the previous call.
        """
        geometry = self._geometry
        if geometry is None or not self.has_gyros or not track.time.size:
            return None
        time, reading, angles = track.time, track.reading[:, self._gyros], track.angles
        if self._previous_samples:
            now = time, reading, angles
            time, reading, angles = map(
                np.concatenate, zip(self._previous_samples, now, strict=True)
            )
        h = half_window(time) if time.size > 1 else 1
        self._previous_samples = time[-2 * h :], reading[-2 * h :], angles[-2 * h :]
        if time.size <= 2 * h:
            self._previous_samples = time, reading, angles
            return None
        table, read = table_rates(geometry, time, angles), gyro_rates(time, reading)
        left = read.rate - table.rate @ self._inputs.T
        size = np.linalg.norm(left, axis=-1)
        most = _RATE_DIFFERENCE + _RATE_SHARE * np.linalg.norm(table.rate, axis=-1)
        apart = (size > most) & table.is_complete
        first = table.time[0] if np.isnan(self._agreement_time) else self._agreement_time
        agreed = np.maximum.accumulate(np.where(apart, first, table.time))
        self._agreement_time = float(agreed[-1])
        lasts = apart & (table.time - agreed >= _DIFFERENCE_PERSISTENCE)
        self.rate_difference = float(size[-1]) if lasts[-1] else 0.0
        at = np.flatnonzero(lasts)
        if not at.size:
            return None
        turned = (angles[2 * h :] - angles[: -2 * h]) / (time[2 * h :] - time[: -2 * h])[:, None]
        return self._describe_difference(geometry, angles[h:-h][at], turned[at], left[at])

    def _describe_difference(
        self, bench: Turntable, angles: Array, turned: Array, left: Array
    ) -> str:
        """Describe a difference, (n, g), and name the axis that explains it."""
        zero = np.zeros_like(angles)
        earth = motion(bench, angles, zero, zero, {}).w
        total = float(np.sum(left**2))
        found: list[tuple[str, float, float]] = []
        for i, name in enumerate(bench.names):
            unit = np.zeros_like(angles)
            unit[:, i] = 1
            along = (motion(bench, angles, unit, zero, {}).w - earth) @ self._inputs.T
            own: Array = np.sum(along * left, axis=-1) / np.maximum(
                np.sum(along**2, axis=-1), 1e-12
            )
            if np.sum((left - along * own[:, None]) ** 2) <= _UNEXPLAINED_SHARE * total:
                found.append((name, float(np.mean(turned[:, i])), float(np.mean(own))))
        if not found:
            size = degrees(np.sqrt(total / len(left)))
            return (
                f"gyros and readback differ by {size:.3g} °/s, and rotation about one table axis "
                "does not explain this; check that the IMU is mounted as the run file states"
            )
        names = " or ".join(name for name, _, _ in found)
        _, said, beyond = found[0]
        stands = abs(said) < _STANDSTILL_RATE
        self.encoder_stuck |= stands
        does = "stands still" if stands else f"turns at {degrees(said):.3g} °/s"
        return (
            f"axis {names}: the encoder {does} while the gyros measure "
            f"{degrees(said + beyond):.3g} °/s"
        )

    def _persists(self, what: str, wrong: bool, now: float, most: float = 0.0) -> bool:
        """Return whether a fault has lasted for longer than `most` s."""
        if not wrong:
            self._since.pop(what, None)
            return False
        return now - self._since.setdefault(what, now) > most


_INTERVAL = 60.0  # s between warnings of one kind


class ReadbackWarnings:
    """Warnings about the readback of one run.

    Parameters
    ----------
    bench : ControlledBench
        Bench; only a turntable has angles to compare.
    sensor : Sensor
    """

    def __init__(self, bench: ControlledBench, sensor: Sensor):
        self._bench, self._sensor = bench, sensor
        self._said: dict[str, float] = {}  # run time of the last warning of each kind, s
        self.restart()

    def restart(self) -> None:
        """Start again, because the recording starts again."""
        bench = self._bench
        self._comparison: GyroComparison | None = None
        if is_turntable(bench):
            self._comparison = GyroComparison(bench, self._sensor, bench.latency.value)

    def find(self, begin: float, track: Track | None = None) -> list[str]:
        """Return warnings for the windows that these samples complete, or for the last samples.

        Parameters
        ----------
        begin : float
            Run time at which the time in the track is 0, s.
        track : Track, optional
            Samples of one trial, with known angles, that continue the earlier samples. None at the
            end.
        """
        if self._comparison is None:
            return []
        found = self._comparison.finish() if track is None else self._comparison.feed(track)
        result: list[str] = []
        for one in found:
            if one.stop - self._said.get(one.kind, -inf) >= _INTERVAL:
                self._said[one.kind] = one.stop
                shown = one._replace(start=one.start + begin, stop=one.stop + begin)
                result.append(shown.describe(self._bench.names))
        return result
