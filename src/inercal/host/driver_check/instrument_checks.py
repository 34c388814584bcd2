"""The checks of an instrument's driver, at the instrument itself or at a simulator.

If the address has a TCP host and port, a relay between the two loses, garbles and delays replies.
"""

import re
from collections.abc import Callable
from functools import partial
from math import isfinite
from statistics import fmean, stdev
from time import monotonic

from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.host.driver_check.probe import CheckFailed, Probe, require
from inercal.host.driver_check.relay import MALFORMED, Relay
from inercal.host.equipment import open_instrument
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
