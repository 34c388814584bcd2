"""Addresses of tables and IMUs: an address names a link, the kind of device, and settings.

    pmac://192.168.0.5:1025?motors=1,2,3&counts=3600000     axes from outer to inner; counts per
                                                            turn, one for all or one per axis,
                                                            < 0 reverses the axis
    acutrol://192.168.0.6:5025?axes=1,2,3                   axes from outer to inner
    motor:serial:/dev/ttyUSB0?baud=9600                     one axis, over any link
    serial:/dev/ttyUSB0?preset=xsens&baud=921600            an IMU; `preset` is one of `PRESETS`
    tcp://127.0.0.1:40123?layout=own.toml                   an IMU; `layout` is your own file

All other parameters after `?` belong to the link.
"""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Callable, Sequence
from contextlib import suppress
from ipaddress import IPv6Address, ip_address
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import parse_qsl, urlencode, urlsplit

from inercal.basics.errors import InputError
from inercal.host.drivers.acutrol import Acutrol, AcutrolAxis
from inercal.host.drivers.motor import Motor
from inercal.host.drivers.pmac import Pmac, PmacAxis
from inercal.host.drivers.rotary_table import AxisLimits, RotaryTable
from inercal.host.link import CONNECT_TIMEOUT, host_and_port, open_link

# These are only imported for type checks, because the guard opens a table and must start quickly.
if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench
    from inercal.host.imu_port import ImuPort
    from inercal.host.packets import PacketLayout

_TABLES = (
    "pmac://HOST:1025?motors=1,2,3&counts=3600000, acutrol://HOST:PORT?axes=1,2,3 or "
    "motor:serial:PATH?baud=9600"
)
_MOST_MOTORS = 32
_PMAC_PORT = 1025


class DeviceAddresses(NamedTuple):
    """Addresses of the devices; `clock` is empty unless the bench is simulated."""

    table: str
    imu: str
    clock: str = ""


def open_table(address: str, bench: ControlledBench | None, timeout: float = 1.0) -> RotaryTable:
    """Connect to the table at `address` and return its driver.

    Parameters
    ----------
    address : str
        See the module docstring.
    bench : ControlledBench or None
        Bench that names the axes and states the limits for a controller that reports none. Without
        a bench, each axis is named after its number.
    timeout : float
        Longest time to wait for a reply, s.

    Raises
    ------
    InputError
        The address is malformed, or its axes do not match the bench.
    LinkLost
        No device answers at the address.
    ProtocolError
        A device answers, but it is not the kind of table in the address.
    """
    scheme, _ = _scheme(address)
    if scheme in DRIVERS:
        return DRIVERS[scheme](address, bench, timeout)
    raise InputError(f"{address!r} is not an address of a table; possible: {_TABLES}")


def allows_second_connection(address: str) -> bool:
    """Return whether two programs can be connected to a table at once (not on serial ports)."""
    kind, at = _scheme(address)
    return not (kind == "motor" and at.startswith("serial:"))


def table_places(address: str) -> tuple[str, ...]:
    """Return the network hosts and ports, or the serial port, to which a table's address refers.

    Two addresses refer to the same controller if they have one of these places in common. The
    function resolves host names to IP addresses, omitted default ports, different names of this
    machine, and symbolic links to a serial port. It ignores the axes in an address and opens no
    connection.
    """
    scheme, _ = _scheme(address)
    link = address.partition("?")[0]
    if scheme == "motor":
        link = link.partition(":")[2]
    kind, at = _scheme(link)
    if kind == "serial":
        return (f"serial:{os.path.realpath(at)}",)
    place = host_and_port(urlsplit(link), _PMAC_PORT if kind == "pmac" else None)
    if place is None:
        return (link,)
    host, port = place
    return tuple(f"{one}:{port}" for one in _resolve(host))


def _resolve(host: str) -> tuple[str, ...]:
    """Return the sorted numeric addresses of a host, or the name if it cannot be resolved."""
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return (host,)
    return tuple(sorted({_number_of_host(family, str(at[0])) for family, *_, at in found}))


def _number_of_host(family: int, number: str) -> str:
    """Return the numeric address of a host, or "localhost" for an address of this machine."""
    with socket.socket(family, socket.SOCK_DGRAM) as probe, suppress(OSError):
        probe.bind((number, 0))
        return "localhost"
    ip = ip_address(number.partition("%")[0])
    mapped = ip.ipv4_mapped if isinstance(ip, IPv6Address) else None
    return str(mapped or ip)


def open_imu(
    address: str,
    now: Callable[[], float],
    connect_timeout: float = CONNECT_TIMEOUT,
    *,
    synchronous: bool = False,
) -> ImuPort:
    """Open the port to the IMU at `address` and return it.

    `now` and `synchronous` are passed to `ImuPort`, and `connect_timeout` is passed to its link.

    Raises
    ------
    InputError
        The address is malformed, or it does not describe the packets.
    LinkLost
        No device answers at the address, or the port cannot be opened.
    """
    from inercal.host.imu_port import ImuPort

    layout, link = layout_of_address(address), link_of_address(address)
    return ImuPort(open_link(link, connect_timeout), layout, now, synchronous=synchronous)


def layout_of_address(address: str) -> PacketLayout:
    """Return the packet layout that an IMU's address selects by `preset` or `layout`.

    Raises
    ------
    InputError
        The address contains neither `preset` nor `layout`, or both, or the description cannot be
        read.
    """
    from inercal.host.packets import PRESETS, read_layout

    given = _AddressParameters(address).values
    if ("preset" in given) == ("layout" in given):
        raise InputError(
            f"{address!r} must state the packet format, either preset=NAME or layout=FILE.toml; "
            f"presets are {', '.join(PRESETS)}"
        )
    if "preset" in given and given["preset"] not in PRESETS:
        raise InputError(
            f"no preset {given['preset']!r} in {address!r}; possible: {', '.join(PRESETS)}"
        )
    return read_layout(given.get("preset") or given["layout"])


def link_of_address(address: str) -> str:
    """Return the address of an IMU's link: its address without `preset` and `layout`."""
    whole = _AddressParameters(address).values
    given = {k: v for k, v in whole.items() if k not in ("preset", "layout")}
    if given == whole:
        return address
    query = f"?{urlencode(given, safe='/')}" if given else ""
    return address.partition("?")[0] + query


class _AddressParameters:
    """The parameters of an address; each is removed when it is read."""

    def __init__(self, address: str):
        self.address = address
        pairs = parse_qsl(urlsplit(address).query, keep_blank_values=True)
        self.values = dict(pairs)
        if len(self.values) < len(pairs):
            raise InputError(f"{address!r} gives a parameter twice; give each parameter once")

    def axis_numbers(self, key: str, most: int) -> list[int]:
        """Return the axis numbers in a parameter: 1 to `most`, and each at most once."""
        text = self._take(key, f"{key}=1,2,3")
        parts = text.split(",")
        if not all(re.fullmatch(r"[0-9]{1,2}", part) for part in parts):
            raise InputError(f"{key}={text!r} in {self.address!r}; give numbers as {key}=1,2,3")
        numbers = [int(part) for part in parts]
        if len(set(numbers)) < len(numbers) or not all(1 <= n <= most for n in numbers):
            raise InputError(
                f"{key}={text!r} in {self.address!r}; possible: 1 to {most}, each once"
            )
        return numbers

    def counts(self, axes: int) -> list[float]:
        """Return the counts per turn of each axis."""
        text = self._take("counts", "counts=3600000")
        try:
            values = [float(part) for part in text.split(",")]
        except ValueError:
            values = []
        if len(values) not in (1, axes) or not all(isfinite(v) and v for v in values):
            raise InputError(
                f"counts={text!r} in {self.address!r}; give the counts per turn, not 0: one "
                f"number for all axes, or {axes} numbers"
            )
        return values if len(values) == axes else values * axes

    def tcp_address(self, port: int | None) -> str:
        """Return the address of the link; raise an error if parameters remain."""
        if self.values:
            raise InputError(
                f"unknown parameter {next(iter(self.values))!r} in {self.address!r}; "
                f"possible: {_TABLES}"
            )
        parts = urlsplit(self.address)
        place = host_and_port(parts, port)
        if place is None or parts.path not in ("", "/") or parts.username:
            raise InputError(f"{self.address!r} has no valid host and port; possible: {_TABLES}")
        host, port = place
        host = f"[{host}]" if ":" in host else host
        return f"tcp://{host}:{port}"

    def _take(self, key: str, example: str) -> str:
        if key not in self.values:
            raise InputError(f"{self.address!r} has no parameter {key}; add it, such as {example}")
        return self.values.pop(key)


def _scheme(address: str) -> tuple[str, str]:
    kind, _, at = address.partition(":")
    return kind.lower(), at


def _axis_names(
    address: str, key: str, numbers: Sequence[int], bench: ControlledBench | None
) -> tuple[str, ...]:
    if bench is None:
        return tuple(str(n) for n in numbers)
    if len(bench.names) != len(numbers):
        raise InputError(
            f"{address!r} gives {len(numbers)} {key}, but the bench has the axes "
            f"{', '.join(bench.names)}; give one for each axis"
        )
    return bench.names


def _open_pmac(address: str, bench: ControlledBench | None, timeout: float) -> RotaryTable:
    given = _AddressParameters(address)
    motors = given.axis_numbers("motors", _MOST_MOTORS)
    names = _axis_names(address, "motors", motors, bench)
    counts = given.counts(len(motors))
    where = given.tcp_address(_PMAC_PORT)
    axes = [PmacAxis(*axis) for axis in zip(names, motors, counts, strict=True)]
    return Pmac(where, axes, timeout)


def _open_acutrol(address: str, bench: ControlledBench | None, timeout: float) -> RotaryTable:
    given = _AddressParameters(address)
    numbers = given.axis_numbers("axes", 9)
    names = _axis_names(address, "axes", numbers, bench)
    where = given.tcp_address(None)
    axes = [AcutrolAxis(*axis) for axis in zip(names, numbers, strict=True)]
    return Acutrol(where, axes, timeout)


def _open_motor(address: str, bench: ControlledBench | None, timeout: float) -> RotaryTable:
    _, at = _scheme(address)
    if not at.startswith(("serial:", "tcp:")):
        raise InputError(
            f"{address!r} has no link after 'motor:'; possible: {_TABLES} or motor:tcp://HOST:PORT"
        )
    (name,) = _axis_names(address, "motor", (1,), bench)
    limits = AxisLimits()
    if bench is not None:
        of_axis = bench.axis_motion_limits[0]
        limits = AxisLimits(of_axis.rate, of_axis.acceleration)
    return Motor(at, limits, name, timeout=timeout)


# Drivers by the scheme of the address. Each function has the arguments of `open_table`.
DRIVERS: dict[str, Callable[[str, ControlledBench | None, float], RotaryTable]] = {
    "pmac": _open_pmac,
    "acutrol": _open_acutrol,
    "motor": _open_motor,
}
