"""The checks of a chamber's driver; those of the link are the same as for a table.

The chamber is sent 3 K up and down, for which a slow one needs some minutes of its own time.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from math import inf, nan

from inercal.basics.units import ZERO_CELSIUS
from inercal.host.driver_check import checks
from inercal.host.driver_check.probe import CheckFailed, LinkProbe, require
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.equipment import Chamber
from inercal.host.link import LinkLost

_STEP, _NEAR, _PASSING = 3.0, 0.3, 0.5  # K: a change, its tolerance, and what a stop may exceed
_LONGEST = 3600.0  # s for a change by `_STEP`
_PLAUSIBLE = (150.0, 600.0)  # K
_WATCH = 600.0  # s after a stop


class ChamberProbe(LinkProbe[Chamber]):
    """A driver of a chamber; see `LinkProbe`."""

    def wait(self, chamber: Chamber, low: float, high: float) -> None:
        """Read the chamber until its temperature is within limits, K."""
        end = self.now() + _LONGEST
        while not low < (now := chamber.read().temperature) < high:
            if self.now() > end:
                raise CheckFailed(
                    f"the chamber has not arrived within {_LONGEST:.0f} s; it is at "
                    f"{now - ZERO_CELSIUS:.2f} °C, and should be above {low - ZERO_CELSIUS:.2f} °C "
                    f"and below {high - ZERO_CELSIUS:.2f} °C"
                )

    def bring_to_rest(self) -> None:
        """See `LinkProbe.bring_to_rest`."""
        self.relay.mend()
        # The check of `stop` reports what fails here.
        with suppress(Exception), self.open() as chamber:
            chamber.stop()


def state(probe: ChamberProbe) -> str:
    """Check that the reading is plausible, and that nothing is wrong with the simulator."""
    with probe.open() as chamber:
        now = chamber.read()
    possible = _PLAUSIBLE[0] < now.temperature < _PLAUSIBLE[1]
    require(possible, f"the temperature is {now.temperature:.6g}, which is not plausible in K")
    require(now.door_open in (None, False), f"the door is reported as {now.door_open}; close it")
    require(now.alarms == (), f"the alarms are {now.alarms}; end them in the simulator")
    door = "not reported" if now.door_open is None else "closed"
    return f"{now.temperature - ZERO_CELSIUS:.2f} °C; door {door}; no alarm"


def limits(probe: ChamberProbe) -> str:
    """Check that impossible temperatures are refused before anything is sent."""
    impossible = (nan, -inf, 0.0, 2000.0)
    with probe.open() as chamber:
        probe.relay.wait_for_bytes(probe.timeout)
        for temperature in impossible:
            go = partial(chamber.set_temperature, temperature)
            checks.require_refused(probe, f"a set point of {temperature:g} K", go)
    return f"{len(impossible)} impossible set points refused"


def set_point(probe: ChamberProbe) -> str:
    """Check that the chamber arrives at a higher and at a lower set point."""
    with probe.open() as chamber:
        start = chamber.read().temperature
        for goal in (start + _STEP, start):
            chamber.set_temperature(goal)
            probe.wait(chamber, goal - _NEAR, goal + _NEAR)
    return f"arrived within {_NEAR:g} K, upwards and downwards"


def stop(probe: ChamberProbe) -> str:
    """Check that a stop ends heating, even if no reply arrives."""
    for what, cut in (("", lambda: None), (" without a reply", probe.relay.silence)):
        with probe.open() as chamber:
            start = chamber.read().temperature
            chamber.set_temperature(start + 5 * _STEP)
            probe.wait(chamber, start + _NEAR, inf)
            cut()
            with suppress(LinkLost, ProtocolError):
                chamber.stop()
            probe.relay.mend()
        with probe.open() as chamber:
            most, end = chamber.read().temperature + _PASSING, probe.now() + _WATCH
            while probe.now() < end:
                heats = f"the chamber still heats after a stop{what}"
                require(chamber.read().temperature < most, heats)
    return "heating ends, even without a reply"


def reconnection(probe: ChamberProbe) -> str:
    """Check that the chamber can be used again after its link was lost or silent."""
    with probe.open() as chamber:
        for what, cut in (("unplugged", probe.relay.unplug), ("silent", probe.relay.silence)):
            cut()
            with suppress(LinkLost, ProtocolError):
                chamber.read()  # the check of a lost link requires an error
            probe.relay.mend()
            probe.read_again(chamber, f"after the link was {what}")
    return "readings continue after an unplugged and a silent link"


CHAMBER_CHECKS: dict[str, Callable[[ChamberProbe], str]] = {
    "state": state,
    "limits": limits,
    "set point": set_point,
    "stop": stop,
    "lost link": checks.lost_link,
    "reconnection": reconnection,
    "malformed replies": checks.malformed_replies,
    "late reply": checks.late_reply,
    "close": checks.close,
}
