"""Controls a chamber while a plan is carried out at several temperatures (soaks).

A soak is stable if, during the whole of the last `steady_time`, the chamber was within `tolerance`
of the set temperature, and the slope of a straight line through the sensor's own temperatures is
less than `drift`. Each step of the plan waits until the soak is stable. If the packets contain no
temperature, only the chamber is checked, and the plan waits for the stated time `wait`.

The chamber is read every 0.25 s. The run ends if the chamber reports an alarm or an open door, or
if two successive readings T are outside the limits, or change faster than the largest permitted
rate r. Noise is no reason to stop, so they may exceed the rate by 0.3 K::

    |T(t) − T(t − s)| > r s + 0.3 K for any s up to 60 s

If the chamber does not answer, the run pauses. These checks are not a safety function: the
chamber's own limiter is.
"""

from collections import deque
from collections.abc import Callable
from functools import partial
from math import inf, isfinite, nan
from typing import Literal, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.closeable import Closeable
from inercal.basics.errors import InercalError, InputError
from inercal.basics.units import ZERO_CELSIUS, format_duration
from inercal.host.equipment import ChamberPort, ChamberState, open_chamber
from inercal.host.packets import PacketLayout
from inercal.host.tasks import has_soaks, host_plan
from inercal.physics.section_settings import key_error
from inercal.recordings.environment import Environment
from inercal.runfile import Run

_INTERVAL = 0.25  # s between two readings of the chamber
_RECORD_INTERVAL = 1.0  # s between two readings that are recorded and compared with the criteria
_REPORT_INTERVAL = 600.0  # s between two messages while the run waits
# Longest time to wait for a reply, s of wall time. During a run on a simulated bench, the watchdog
# waits for this reply too.
_SIMULATED_TIMEOUT, _TIMEOUT = 0.25, 1.0
_RATE_WINDOW, _RATE_ALLOWANCE = 60.0, 0.3  # s, K
_LIMIT_MARGIN = 10.0  # K beyond the soaks; the limits if the run file states none
_SUCCESSIVE = 2  # readings
Say = Callable[[Literal["info", "warning", "alarm"], str], None]
Record = Callable[[float, float, float], None]


def require_chamber(run: Run, layout: PacketLayout, chamber: str) -> None:
    """Raise an error if soaks and chamber do not match, before anything moves.

    Parameters
    ----------
    run : Run
    layout : PacketLayout
        Layout of the IMU's packets.
    chamber : str
        Address of the chamber; empty if there is none.

    Raises
    ------
    InputError
        There are soaks but no chamber, or a chamber but no soaks; the sensor is mounted by hand; or
        neither the packets nor the run file show when a soak is stable.
    """
    environment = run.environment

    def refusal(text: str, key: str = "temperatures") -> InputError:
        return key_error(f"[environment] {key}", text, run.path)

    if environment is None or not has_soaks(run):
        if chamber:
            raise refusal(
                "a run in a chamber needs them; add the temperatures of the soaks, or leave out "
                "--chamber"
            )
        return
    if not chamber:
        raise refusal(
            "give the address of the chamber with --chamber, or remove the key to carry out the "
            "plan at one temperature"
        )
    if host_plan(run).spins:
        raise refusal("an operator mounts the sensor during this plan; use a turntable")
    if "temperature" not in layout.roles and not environment.profile.wait:
        raise refusal(
            f"the packets of {layout.name} contain no temperature, so state how long the sensor "
            'needs to follow the chamber, such as wait = "45 min"',
            "wait",
        )


def open_soaks(
    address: str, run: Run, layout: PacketLayout, say: Say, record: Record, simulated: bool
) -> "SoakControl | None":
    """Connect to the chamber at an address; None if there is none.

    For the other parameters, see `SoakControl`.
    """
    if not address or run.environment is None:
        return None
    timeout = _SIMULATED_TIMEOUT if simulated else _TIMEOUT
    port = ChamberPort(partial(open_chamber, address, timeout), synchronous=simulated)
    has_thermometer = "temperature" in layout.roles
    return SoakControl(port, run.environment, len(run.steps), say, record, has_thermometer)


class _Sample(NamedTuple):
    """Temperatures of chamber and sensor, K, at a run time, s."""

    time: float
    chamber: float
    sensor: float


class SoakControl(Closeable):
    """Brings a chamber from soak to soak, and finds reasons to stop it.

    Parameters
    ----------
    port : ChamberPort
    environment : Environment
        Environment with the temperatures of the soaks.
    steps : int
        Number of steps in each soak.
    say : callable
        Function that reports a message to the operator.
    record : callable
        Function that records a run time, s, the chamber's temperature and its set temperature, K.
    has_thermometer : bool
        Whether the packets contain the sensor's temperature.

    Attributes
    ----------
    is_stable : bool
        Whether the present soak is stable.
    trouble : str or None
        Why the chamber does not answer; None if it answers.
    trouble_since : float
        Run time at which the trouble began, s.
    """

    def __init__(
        self,
        port: ChamberPort,
        environment: Environment,
        steps: int,
        say: Say,
        record: Record,
        has_thermometer: bool,
    ):
        self.is_stable, self.trouble, self.trouble_since = False, None, 0.0
        self._port, self._steps, self._say, self._record = port, steps, say, record
        self._has_thermometer = has_thermometer
        self._soaks, self._criteria = environment.soaks, environment.criteria
        self._wait = max(environment.profile.wait, self._criteria.steady_time)
        self._limits = self._criteria.limits or (
            min(self._soaks) - _LIMIT_MARGIN,
            max(self._soaks) + _LIMIT_MARGIN,
        )
        self._soak, self._ended, self._stop_reported = -1, False, False
        self._time = self._since = self._within_since = 0.0
        self._due = self._record_due = self._report_due = -inf
        self._last_reading = nan
        self._samples = deque[_Sample]()  # of the last `steady_time`, in this soak
        self._recent = deque[tuple[float, float]]()  # time and temperature of the chamber
        self._doubts: dict[str, int] = {}

    @property
    def progress(self) -> str:
        """The soak, the temperatures and the remaining time, as text; empty before the start."""
        if self._soak < 0 or not self._samples:
            return ""
        _, chamber, sensor = self._samples[-1]
        left = max(self._since + self._criteria.longest_wait - self._time, 0.0)
        state = "stable" if self.is_stable else f"waiting, at most {format_duration(left)} more"
        own = f", sensor {_celsius(sensor)}" if isfinite(sensor) else ""
        return f"{self._name}: chamber {_celsius(chamber)}{own}; {state}"

    @property
    def _name(self) -> str:
        target = _celsius(self._soaks[self._soak])
        return f"soak {self._soak + 1} of {len(self._soaks)} at {target}"

    def may_begin(self, number: int) -> bool:
        """Return whether a step may begin: its soak was reached and is stable."""
        return self.is_stable and number // self._steps == self._soak

    def update(self, time: float, number: int, sensor: float, *, ended: bool) -> str | None:
        """Read the chamber, and return a reason to end the run; None if there is none.

        Parameters
        ----------
        time : float
            Run time, s.
        number : int
            Number of the present step, counted over all soaks.
        sensor : float
            The sensor's own temperature, K; NaN if unknown.
        ended : bool
            Whether the plan has ended; the chamber is then stopped.
        """
        self._time = time
        if ended and not self._ended:
            self._ended, self._due, self._port.target = True, -inf, None
        soak = min(number // self._steps, len(self._soaks) - 1)
        if not ended and soak != self._soak:
            self._begin_soak(soak)
        if time < self._due:
            return None
        try:
            state = self._port.exchange()
        except InputError as error:
            return None if ended else f"{self._name}: {error}"
        except InercalError as error:
            self._follow_silence(str(error))
            return None
        if state is None:
            self._follow_silence("no reply has arrived")
            return None
        self._due, self._last_reading, self.trouble = time + _INTERVAL, time, None
        if ended:
            self._report_stop()
            return None
        return self._check(state, sensor) or self._follow_soak(state.temperature, sensor)

    def _begin_soak(self, soak: int) -> None:
        self._soak, self._since, self._due = soak, self._time, -inf
        self._port.target = self._soaks[soak]
        self._lose_stability()
        self._say("info", f"{self._name}: the chamber is set to this temperature")

    def _lose_stability(self) -> None:
        self.is_stable, self._since = False, self._time
        self._samples.clear()
        self._within_since, self._report_due = inf, self._time + _REPORT_INTERVAL

    def _follow_silence(self, words: str) -> None:
        """Note that there is no reading, and why; it is a trouble if it lasts."""
        if not isfinite(self._last_reading):
            self._last_reading = self._time
        if self.trouble is None and self._time - self._last_reading > self._port.silence:
            self.trouble, self.trouble_since = f"the chamber does not answer: {words}", self._time
            self._lose_stability()

    def _check(self, state: ChamberState, sensor: float) -> str | None:
        """Return why the run must end; None if nothing is wrong."""
        if state.alarms:
            return f"the chamber reports an alarm: {', '.join(state.alarms)}"
        if state.door_open:
            return "the chamber's door is open"
        kelvin, (low, high) = state.temperature, self._limits
        allowed = f"allowed: {_celsius(low)} to {_celsius(high)}"
        if self._persists("no temperature", wrong=not isfinite(kelvin)):
            return "the chamber reports no temperature"
        if self._persists("chamber", wrong=not low <= kelvin <= high and isfinite(kelvin)):
            return f"the chamber is at {_celsius(kelvin)}; {allowed}"
        if self._persists("sensor", wrong=not low <= sensor <= high and isfinite(sensor)):
            return f"the sensor is at {_celsius(sensor)}; {allowed}"
        return self._check_rate(kelvin)

    def _check_rate(self, kelvin: float) -> str | None:
        if not isfinite(kelvin):
            return None
        recent, rate = self._recent, self._criteria.max_rate
        while recent and recent[0][0] < self._time - _RATE_WINDOW:
            recent.popleft()
        for time, before in recent:
            if abs(kelvin - before) > rate * (self._time - time) + _RATE_ALLOWANCE:
                if not self._persists("rate", wrong=True):
                    return None
                return (
                    f"the chamber's temperature changed from {_celsius(before)} to "
                    f"{_celsius(kelvin)} within {format_duration(self._time - time)}; allowed: "
                    f"{60 * rate:g} K/min"
                )
        self._persists("rate", wrong=False)
        recent.append((self._time, kelvin))
        return None

    def _persists(self, what: str, *, wrong: bool) -> bool:
        self._doubts[what] = self._doubts.get(what, 0) + 1 if wrong else 0
        return self._doubts[what] >= _SUCCESSIVE

    def _follow_soak(self, kelvin: float, sensor: float) -> str | None:
        """Record a reading, and find whether the soak is stable; return a reason to end the run."""
        if self._time < self._record_due or not isfinite(kelvin):
            return None
        self._record_due = self._time + _RECORD_INTERVAL
        self._record(self._time, kelvin, self._soaks[self._soak])
        first = self._time - self._criteria.steady_time
        self._samples.append(_Sample(self._time, kelvin, sensor))
        while len(self._samples) > 1 and self._samples[1].time <= first:
            self._samples.popleft()
        unstable = self._find_unstable()
        if not unstable and not self.is_stable:
            self.is_stable = True
            waited = format_duration(self._time - self._since)
            self._say("info", f"{self.progress} after {waited}")
        elif unstable and self.is_stable:
            self.is_stable, self._since = False, self._time
            self._report_due = self._time + _REPORT_INTERVAL
            self._say("warning", f"{self._name} is no longer stable: {unstable}")
        elif unstable and self._time - self._since > self._criteria.longest_wait:
            longest = format_duration(self._criteria.longest_wait)
            return f"{self._name} did not become stable within {longest}: {unstable}"
        elif unstable and self._time >= self._report_due:
            self._report_due = self._time + _REPORT_INTERVAL
            self._say("info", f"{self.progress}; {unstable}")
        return None

    def _find_unstable(self) -> str:
        """Return why the soak is not stable; empty if it is stable."""
        criteria, target = self._criteria, self._soaks[self._soak]
        columns: Array = np.array(self._samples).T
        time, chamber, sensor = columns[0], columns[1], columns[2]
        if abs(chamber[-1] - target) > criteria.tolerance:
            self._within_since = inf
            return f"the chamber is at {_celsius(chamber[-1])}; tolerance: {criteria.tolerance:g} K"
        self._within_since = min(self._within_since, self._time)
        if self._has_thermometer and not np.isfinite(sensor).all():
            return "the sensor's temperature is unknown, or was unknown a moment ago"
        covered = time[-1] - time[0] >= criteria.steady_time
        if self._has_thermometer and covered:
            since = time - time.mean()
            slope = abs(float(since @ (sensor - sensor[0]) / (since @ since)))
            if slope > criteria.drift:
                return (
                    f"the sensor drifts by {60 * slope:.2g} K/min; allowed: "
                    f"{60 * criteria.drift:.2g} K/min"
                )
        if not covered or self._time - self._within_since < self._wait:
            return f"the temperatures must be steady for {format_duration(self._wait)}"
        return ""

    def _report_stop(self) -> None:
        """Report once that the chamber has stopped, if it has."""
        if self._port.is_stopped and not self._stop_reported:
            self._stop_reported = True
            self._say("info", "the chamber was stopped; it returns to room temperature by itself")

    def close(self) -> None:
        """Stop the chamber, report it, and close the connection."""
        try:
            self._port.stop()
            self._report_stop()
        except InercalError as error:
            self._say("alarm", f"the chamber could not be stopped: {error}; stop it by hand")
        finally:
            self._port.close()


def _celsius(kelvin: float) -> str:
    return f"{kelvin - ZERO_CELSIUS:.1f} °C".replace("-", "−")
