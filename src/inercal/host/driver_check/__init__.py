"""Checks a driver against a simulator on this machine: everything that a run relies on.

A relay between the two loses, garbles and delays replies. Each check opens the device anew, and
stops it afterwards, so a failure does not affect the other checks. The driver of an instrument is
checked at the instrument, or between the instrument and a relay if its address has a TCP host and
port. A chamber must go 3 K up and down, which takes a slow chamber some minutes.
"""

import re
from collections.abc import Callable, Mapping
from contextlib import nullcontext, suppress
from functools import partial
from math import inf, isfinite, nan
from statistics import fmean, stdev
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import urlsplit

from inercal.basics.errors import InercalError, InputError
from inercal.basics.units import ZERO_CELSIUS, si_factor
from inercal.host.addresses import resolve_host, table_host
from inercal.host.driver_check import checks
from inercal.host.driver_check.checks import CHECKS
from inercal.host.driver_check.relay import MALFORMED, CheckFailed, LinkProbe, Probe, Relay, require
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.equipment import CHAMBERS, INSTRUMENTS, Chamber, open_chamber, open_instrument
from inercal.host.link import LinkLost, connect_socket, host_and_port
from inercal.host.table_driver import READ_TIMEOUT
from inercal.host.table_lock import TableLock

if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench


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
        list(probe.read_after_losses(chamber))
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


_CONNECT_TIMEOUT = 2.0  # s


class CheckResult(NamedTuple):
    """The result of one check, with the reason of a failure or what was measured."""

    name: str
    passed: bool
    reason: str


def check_driver(
    address: str,
    bench: "ControlledBench | None" = None,
    timeout: float | None = None,
    now: Callable[[], float] = monotonic,
    begin: Callable[[str], object] = lambda _: None,
    overloaded: str = "",
) -> tuple[CheckResult, ...]:
    """Carry out all checks of the driver of a table, a chamber or an instrument.

    Parameters
    ----------
    address : str
        Address of a simulator of a table or chamber that listens on this machine, or of an
        instrument.
    bench : ControlledBench, optional
        Bench that names the axes, for a driver that needs it.
    timeout : float, optional
        Longest time to wait for a reply, s; a driver with working replies needs far less.
    now : callable
        Function that returns the time of the simulator, s, with any zero.
    begin : callable
        Function that is called with the name of each check.
    overloaded : str, optional
        Address at which an instrument reports an overload.

    Raises
    ------
    InputError
        The address is malformed, states no TCP port, or is not on this machine.
    LinkLost
        Nothing listens at the address.

    Examples
    --------
    >>> check_driver("motor:serial:/dev/ttyUSB0")
    Traceback (most recent call last):
    ...
    inercal.basics.errors.InputError: 'motor:serial:/dev/ttyUSB0' has no host and port; ...
    """
    scheme = address.partition(":")[0].lower()
    if scheme in INSTRUMENTS:
        checks = instrument_checks(address, timeout or INSTRUMENT_TIMEOUT, overloaded)
        return _carry_out(checks, begin)
    chamber, limit = scheme in CHAMBERS, timeout or READ_TIMEOUT
    host = host_and_port(urlsplit(address[max(address.find("//"), 0) :]))
    place = host if chamber else table_host(address)
    if place is None:
        raise InputError(
            f"{address!r} has no host and port; a driver is checked over TCP, because the check "
            "breaks the link: start the simulator on a port",
            key="ADDRESS",
        )
    if set(resolve_host(place[0])) != {"localhost"}:
        raise InputError(
            f"{address!r} is not on this machine; the check moves the device and breaks its link, "
            "so it only works with a simulator at 127.0.0.1",
            key="ADDRESS",
        )
    with nullcontext() if chamber else TableLock(address, "a check of its driver"):
        connect_socket(address, place, _CONNECT_TIMEOUT).close()
        with Relay(place) as relay:
            probe: Any = (
                ChamberProbe(address, limit, now, relay, open_chamber)
                if chamber
                else Probe(address, bench, limit, now, relay)
            )
            kinds: Mapping[str, Callable[[Any], str]] = CHAMBER_CHECKS if chamber else CHECKS
            checks = {name: partial(check, probe) for name, check in kinds.items()}
            return _carry_out(checks, begin, probe.bring_to_rest)


def _carry_out(
    checks: Mapping[str, Callable[[], str]],
    begin: Callable[[str], object],
    after_each: Callable[[], object] = lambda: None,
) -> tuple[CheckResult, ...]:
    results: list[CheckResult] = []
    for name, check in checks.items():
        begin(name)
        try:
            results.append(CheckResult(name, True, check()))
        except Exception as error:  # a driver that is being written may raise anything
            results.append(CheckResult(name, False, _reason(error)))
        finally:
            after_each()
    return tuple(results)


def _reason(error: Exception) -> str:
    if isinstance(error, CheckFailed):
        return str(error)
    text = f"raised {type(error).__name__}: {error}"
    if isinstance(error, InercalError):
        return text
    return f"{text}; a driver only raises InputError, LinkLost, ProtocolError and TableFault"
