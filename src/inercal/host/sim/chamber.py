"""A simulated temperature chamber: its air, and the case of a sensor in it.

The air follows the set point with the time constant `lag`, but never faster than `ramp`. The case
follows the air with the time constant `case_lag`. With the temperatures T of the air, T_s of the
set point and T_c of the case:

    dT/dt = (T_s - T) / lag, limited to ±ramp        dT_c/dt = (T - T_c) / case_lag

Both equations are solved exactly between two readings, so the result does not depend on how often
the chamber is read. After `stop`, with an open door, or after an alarm, the air goes to the
temperature of the room instead.

`ScpiChamber` has the SCPI commands of a Watlow F4T, in °C or °F. A command has no reply, and a line
that is not understood is ignored. Output 1 switches the chamber on, output 7 reports alarms, and
output 8 reports that the door is open.

Run it as `python -m inercal.host.sim.chamber --port 5025 --pace 60`.
"""

import re
from collections.abc import Callable
from math import copysign, exp, inf, isfinite, isnan, nan
from time import monotonic

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.host.equipment import ChamberState
from inercal.host.link import LinkLost
from inercal.host.sim.dynamics import LineSession
from inercal.host.sim.faults import parse_number, unknown_fault
from inercal.host.sim.server import serve, simulator_parser

_LIMITER_MARGIN = 10.0  # K above the highest set point, at which the limiter switches off
_PASSIVE_FACTOR = 5.0  # a closed chamber that is off is this much slower than a controlled one
FAULTS = ("door", "overtemperature", "sensor", "silent")


class SimulatedChamber(Closeable):
    """A simulated `inercal.host.equipment.Chamber`, in this process.

    Parameters
    ----------
    time : callable
        Function that returns the time, s.
    start : float
        Temperature of the room, and of the air and the case at the beginning, K.
    ramp : float
        Fastest change of the air temperature, K/s.
    lag, case_lag : float
        Time constants of the air and of the case, s.
    low, high : float
        Lowest and highest set point, K.
    """

    def __init__(
        self,
        time: Callable[[], float],
        *,
        start: float = 298.15,
        ramp: float = 3 / 60,
        lag: float = 120.0,
        case_lag: float = 600.0,
        low: float = 203.15,
        high: float = 423.15,
    ):
        self.low, self.high = low, high
        self.set_point: float | None = None
        self.faults = set[str]()
        self._time, self._last = time, time()
        self._room, self._ramp, self._lag, self._case_lag = start, ramp, lag, case_lag
        self._air = self._case = start
        self._tripped = False

    @property
    def case_temperature(self) -> float:
        """Temperature of the sensor's case, K."""
        self._advance()
        return self._case

    def set_temperature(self, temperature: float) -> None:
        """See `Chamber.set_temperature`."""
        self._require_reply()
        if not self.low <= temperature <= self.high:
            raise InputError(
                f"the simulated chamber cannot go to {temperature - ZERO_CELSIUS:.6g} °C; "
                f"possible: {self.low - ZERO_CELSIUS:.6g} to {self.high - ZERO_CELSIUS:.6g} °C",
                key="temperature",
            )
        self._advance()
        self.set_point = temperature

    def read(self) -> ChamberState:
        """See `Chamber.read`."""
        self._require_reply()
        self._advance()
        return ChamberState(
            nan if "sensor" in self.faults else self._air, "door" in self.faults, self.alarms
        )

    @property
    def alarms(self) -> tuple[str, ...]:
        """Active alarms, as texts."""
        failed = ("sensor failure",) if "sensor" in self.faults else ()
        return (*failed, "over-temperature") if self._tripped else failed

    def stop(self) -> None:
        """See `Chamber.stop`."""
        self._require_reply()
        self._advance()
        self.set_point = None

    def close(self) -> None:
        """See `Chamber.close`."""

    def fault(self, words: str) -> None:
        """Set a fault by its text, such as `door` or `sensor off`.

        `door` opens the door. `overtemperature` makes the heater run until the limiter trips at
        10 K above the highest set point; `overtemperature off` also resets the limiter. `sensor`
        breaks the thermometer of the air, and with `silent` the chamber no longer replies.

        Raises
        ------
        InputError
            There is no such fault. The message lists the possible faults.
        """
        match words.split():
            case [what, *state] if what in FAULTS and state in ([], ["on"], ["off"]):
                self._advance()
                self.faults = self.faults - {what} if state == ["off"] else self.faults | {what}
                self._tripped = self._tripped and "overtemperature" in self.faults
            case _:
                raise unknown_fault(words, f"{', '.join(FAULTS)}, then on or off")

    def _require_reply(self) -> None:
        if "silent" in self.faults:
            raise LinkLost("the simulated chamber does not reply; end its fault silent")

    def _advance(self) -> None:
        """Let time pass up to the present."""
        now = self._time()
        passed, self._last = now - self._last, now
        room, door = self._room, "door" in self.faults
        if "overtemperature" in self.faults and not (self._tripped or door):
            heated = max(self.high + _LIMITER_MARGIN - self._air, 0.0) / self._ramp
            self._tripped = passed >= heated
            self._follow(inf, self._lag, self._ramp, min(passed, heated))
            passed -= min(passed, heated)
        if door:
            self._follow(room, self._lag, inf, passed)
        elif self.set_point is None or self.alarms:
            self._follow(room, _PASSIVE_FACTOR * self._lag, inf, passed)
        else:
            self._follow(self.set_point, self._lag, self._ramp, passed)

    def _follow(self, goal: float, lag: float, ramp: float, seconds: float) -> None:
        """Let the air go to a goal for a time: first at the ramp, and then exponentially."""
        beyond = abs(goal - self._air) - ramp * lag
        if beyond > 0:
            rate = copysign(ramp, goal - self._air)
            ramped = min(seconds, beyond / ramp)
            lead = rate * self._case_lag - self._air  # as the case follows a ramp
            self._case = (self._case + lead) * exp(-ramped / self._case_lag) - lead + rate * ramped
            self._air += rate * ramped
            seconds -= ramped
        if seconds > 0:
            off = self._air - goal
            fast, slow = exp(-seconds / lag), exp(-seconds / self._case_lag)
            if lag == self._case_lag:
                mixed = seconds / lag * fast
            else:
                mixed = lag / (lag - self._case_lag) * (fast - slow)
            self._air = goal + off * fast
            self._case = goal + (self._case - goal) * slow + off * mixed


def open_simulated(
    address: str, timeout: float = 1.0, time: Callable[[], float] | None = None
) -> SimulatedChamber:
    """Return a new chamber in this process for the address `sim`, or `sim:?pace=60`.

    Each call returns another chamber, at room temperature. `time` is the time of a simulated bench,
    s. Without it, time passes `pace` times as fast as wall time.
    """
    parts = re.fullmatch(r"sim(?::(?:\?pace=(.*))?)?", address, re.IGNORECASE)
    pace = parse_number(parts[1] or "1") if parts else nan
    if not (pace > 0 and isfinite(pace)):
        raise InputError(
            f"{address!r} is not the address of a simulated chamber; possible: sim, sim:?pace=60"
        )
    return SimulatedChamber(time or (lambda: pace * monotonic()))


class SimulatedScpiChamber(SimulatedChamber):
    """A `server.Device`; the keyword arguments are those of `SimulatedChamber`.

    Attributes
    ----------
    time : float
        Bench time, s.
    """

    def __init__(self, **options: float):
        self.time = 0.0
        super().__init__(lambda: self.time, **options)
        self._unit, self._is_on, self._goal = "F", False, self.read().temperature

    def driver_address(self, link: str) -> str:
        """Return the address with which a driver opens this chamber, which is served at a link."""
        ends = (f"{end - ZERO_CELSIUS:.6g}" for end in (self.low, self.high))
        return "scpi-chamber:{}?output=1&low={}&high={}&door=8&alarm=7".format(
            link.removeprefix("tcp:"), *ends
        )

    def advance(self, until: float) -> None:
        """Let bench time pass up to `until`, s."""
        self.time = max(self.time, until)

    def session(self) -> LineSession:
        """Return the controller's side of a new connection."""
        return LineSession(b"\n", self._answer_line)

    def _answer_line(self, line: str) -> str:
        if "silent" in self.faults:
            return ""
        state, celsius = self.read(), self._unit == "C"
        match line.upper().split():
            case [":UNIT:TEMPERATURE?"]:
                return f"{self._unit}\n"
            case [":SOURCE:CLOOP1:PVALUE?"]:
                value = state.temperature - ZERO_CELSIUS
                return f"{value if celsius else 1.8 * value + 32:.4f}\n"
            case [":SOURCE:CLOOP1:ERROR?"]:
                return "ERROR\n" if isnan(state.temperature) else "NONE\n"
            case [":OUTPUT1:STATE?" | ":OUTPUT7:STATE?" | ":OUTPUT8:STATE?" as query]:
                flags = {"1": self._is_on, "7": state.alarms, "8": state.door_open}
                return "ON\n" if flags[query[7]] else "OFF\n"
            case [":UNIT:TEMPERATURE", "C" | "F" as unit]:
                self._unit = unit
            case [":SOURCE:CLOOP1:SPOINT", text] if isfinite(value := parse_number(text)):
                goal = (value if celsius else (value - 32) / 1.8) + ZERO_CELSIUS
                self._goal = min(max(goal, self.low), self.high)
            case [":OUTPUT1:STATE", "ON" | "OFF" as output]:
                self._is_on = output == "ON"
            case _:
                return ""
        if self._is_on:
            self.set_temperature(self._goal)
        else:
            self.stop()
        return ""


def main() -> None:
    """Serve a simulated chamber until standard input ends; see `server.serve`."""
    parser = simulator_parser("python -m inercal.host.sim.chamber", __doc__)
    serve(SimulatedScpiChamber(), parser.parse_args())


if __name__ == "__main__":
    main()
