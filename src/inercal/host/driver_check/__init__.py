"""Checks a table driver against a simulator on this machine: everything that a run relies on.

A relay between the two loses, garbles and delays replies. Each check opens the table anew, and the
table is brought to rest after it, so a failure does not affect the other checks. The driver of an
instrument is checked at the instrument.
"""

from collections.abc import Callable, Mapping
from functools import partial
from time import monotonic
from typing import TYPE_CHECKING, NamedTuple

from inercal.basics.errors import InercalError, InputError
from inercal.host.addresses import table_host, table_places
from inercal.host.driver_check.checks import CHECKS
from inercal.host.driver_check.instrument_checks import INSTRUMENT_TIMEOUT, instrument_checks
from inercal.host.driver_check.probe import CheckFailed, Probe
from inercal.host.driver_check.relay import Relay
from inercal.host.equipment import INSTRUMENTS
from inercal.host.link import connect_socket
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
    """Carry out all checks of the driver of a table or an instrument.

    Parameters
    ----------
    address : str
        Address of a simulated table that listens on this machine, or of an instrument.
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
    if address.partition(":")[0].lower() in INSTRUMENTS:
        checks = instrument_checks(address, timeout or INSTRUMENT_TIMEOUT, overloaded)
        return _carry_out(checks, begin)
    place = table_host(address)
    if place is None:
        raise InputError(
            f"{address!r} has no host and port; a driver is checked over TCP, because the check "
            "breaks the link: start the simulator on a port",
            key="ADDRESS",
        )
    if not all(one.startswith("localhost:") for one in table_places(address)):
        raise InputError(
            f"{address!r} is not on this machine; the check moves the table and breaks its link, "
            "so it only works with a simulator at 127.0.0.1",
            key="ADDRESS",
        )
    with TableLock(address, "a check of its driver"):
        connect_socket(address, place, _CONNECT_TIMEOUT).close()
        with Relay(place) as relay:
            probe = Probe(address, bench, timeout or READ_TIMEOUT, now, relay)
            checks = {name: partial(check, probe) for name, check in CHECKS.items()}
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
