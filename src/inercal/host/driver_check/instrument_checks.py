"""Check the drivers of instruments and chambers, real or simulated.

If the address has a TCP host and port, a relay between the two loses, garbles and delays replies.

The checks of a chamber's link are the same as for a table. The chamber must go 3 K up and down,
which takes a slow chamber some minutes.
"""

import re
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from math import inf, isfinite, nan
from statistics import fmean, stdev
from time import monotonic

from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS, si_factor
from inercal.host.driver_check import checks
from inercal.host.driver_check.relay import MALFORMED, CheckFailed, LinkProbe, Probe, Relay, require
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.equipment import Chamber, open_instrument
from inercal.host.link import LinkLost

Checks = dict[str, Callable[[], str]]
INSTRUMENT_TIMEOUT = 5.0  # s; a reading with a long integration time takes some seconds
_COUNT = 5
_PLACE = re.compile(r"(//|::)([^:/?\[\]]+)(::?)(\d+)(?=$|[/?]|::SOCKET)", re.IGNORECASE)


def instrument_checks(address: str, timeout: float, overloaded: str) -> Checks:
    """Return the checks that are possible at an address, by name.

    `overloaded` is an address at which the instrument reports an overload; empty if there is none.
    """
    checks = {"readings": _readings, "short timeout": _short_timeout, "close": _close_twice}
    found = {name: partial(check, address, timeout) for name, check in checks.items()}
    if overloaded:
        found["overload"] = partial(_overload, overloaded, timeout)
    if place := _PLACE.search(address):
        found["faulty link"] = partial(_faulty_link, address, timeout, place)
    return found


def _readings(address: str, timeout: float) -> str:
    with open_instrument(address, timeout) as one:
        name, begun = one.identity(), monotonic()
        found = [one.read() for _ in range(_COUNT)]
        took = (monotonic() - begun) / _COUNT
    require(name.isprintable(), f"the identity {name!r} is not one line of text")
    values, units = zip(*found, strict=True)
    require(all(map(isfinite, values)), f"the readings {values} are not all finite")
    require(len(set(units)) == 1, f"the unit changes: {units}")
    si_factor(units[0])
    mean = f"{fmean(values):.9g} {units[0]}, s {stdev(values):.2g}"
    return f"{name or 'no identity'}; {mean}; {1000 * took:.3g} ms for a reading"


def _short_timeout(address: str, timeout: float) -> str:
    """Check that a reading that is cut off ends with an error, and leaves nothing behind."""
    begun, what = monotonic(), "answered within 1 ms"
    try:
        with open_instrument(address, 1e-3) as one:
            one.read()
    except LinkLost:
        what = f"an error after {monotonic() - begun:.3f} s"
    require(monotonic() - begun < timeout, "a timeout of 1 ms has no effect")
    _readings(address, timeout)
    return what


def _close_twice(address: str, timeout: float) -> str:
    for _ in range(2):
        one = open_instrument(address, timeout)
        one.read()
        one.close()
        one.close()
    return "closed twice, and opened again"


def _overload(address: str, timeout: float) -> str:
    with open_instrument(address, timeout) as one:
        try:
            found = one.read()
        except InputError as error:
            return str(error)
    raise CheckFailed(f"an overload is returned as {found.value} {found.unit}")


def _faulty_link(address: str, timeout: float, place: re.Match[str]) -> str:
    """Check that each fault of the link is an error, and that the next reading works again."""
    before, host, colon, port = place.groups()
    with Relay((host, int(port))) as relay:
        local = f"{before}127.0.0.1{colon}{relay.port}"
        probe = Probe("", None, timeout, monotonic, relay)
        faults: dict[str, Callable[[], None]] = {
            "an unplugged link": relay.unplug,
            "a silent link": relay.silence,
            **{name: partial(setattr, relay, "change", one) for name, one in MALFORMED.items()},
            "a late reply": partial(setattr, relay, "held", []),
        }
        with open_instrument(address.replace(place[0], local, 1), timeout) as one:
            one.read()
            for name, begin in faults.items():
                begin()
                probe.expect_error(one.read, name)
                # A late reply without digits is an error if it is taken for the next one.
                held = relay.held or ()
                relay.held = [(end, re.sub(rb"\d", b"x", data)) for end, data in held]
                relay.release()
                relay.mend()
                one.read()
    return f"{len(faults)} faults are errors, and the next readings work"


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
