"""Checks a driver against a simulator on this machine: everything that a run relies on.

A relay between the two loses, garbles and delays replies. Each check opens the device anew, and
stops it afterwards, so a failure does not affect the other checks. The driver of an instrument is
checked at the instrument.
"""

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from functools import partial
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import urlsplit

from inercal.basics.errors import InercalError, InputError
from inercal.host.addresses import resolve_host, table_host
from inercal.host.driver_check.checks import CHECKS
from inercal.host.driver_check.instrument_checks import (
    CHAMBER_CHECKS,
    INSTRUMENT_TIMEOUT,
    ChamberProbe,
    instrument_checks,
)
from inercal.host.driver_check.relay import CheckFailed, Probe, Relay
from inercal.host.equipment import CHAMBERS, INSTRUMENTS, open_chamber
from inercal.host.link import connect_socket, host_and_port
from inercal.host.table_driver import READ_TIMEOUT
from inercal.host.table_lock import TableLock

if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench

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
