"""Connect to tables and IMUs by addresses, which name a link, the kind of device, and settings.

    pmac://192.168.0.5:1025?motors=1,2,3&counts=3600000     axes from outer to inner; counts per
                                                            turn, one for all or one per axis,
                                                            < 0 reverses the axis
    acutrol://192.168.0.6:5025?axes=1,2,3                   axes from outer to inner
    motor:serial:/dev/ttyUSB0?baud=9600                     one axis, over any link
    serial:/dev/ttyUSB0?preset=xsens&baud=921600            an IMU; `preset` is one of `PRESETS`
    tcp://127.0.0.1:40123?layout=own.toml                   an IMU; `layout` is your own file

All other parameters after `?` belong to the link. Other packages can add kinds of tables and links
through the entry points (`inercal.tables`, `inercal.links`).
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from contextlib import suppress
from ipaddress import IPv6Address, ip_address
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

from inercal.basics.errors import InputError
from inercal.host.drivers.rotary_table import RotaryTable
from inercal.host.drivers.table_address import (
    DRIVERS,
    Driver,
    TableAddress,
    address_parameters,
    with_parameters,
)
from inercal.host.link import CONNECT_TIMEOUT, LINKS, host_and_port, open_link

# These are only imported for type checks, because the guard opens a table and must start quickly.
if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench
    from inercal.host.imu_port import ImuPort
    from inercal.host.packets import PacketLayout


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
    driver = table_driver(address)
    return driver.open(TableAddress(address, driver.example, driver.port), bench, timeout)


def table_driver(address: str) -> Driver:
    """Return the driver that the scheme of a table's address names, or raise an `InputError`."""
    return DRIVERS.for_address(address, lambda: ", ".join(one.example for one in DRIVERS.values()))


def allows_second_connection(address: str) -> bool:
    """Return whether two programs can be connected to a table at once (only over a network)."""
    link = _scheme(_table_link(address))[0]
    return table_driver(address).shared and link in ("tcp", _scheme(address)[0])


def table_places(address: str) -> tuple[str, ...]:
    """Return the network hosts and ports, or the serial port, to which a table's address refers.

    Two addresses refer to the same controller if they have one of these places in common. The
    function resolves host names to IP addresses, omitted default ports, different names of this
    machine, and symbolic links to a serial port. It ignores the axes in an address and opens no
    connection.
    """
    link = _table_link(address)
    kind, at = _scheme(link)
    if kind == "serial":
        return (f"serial:{os.path.realpath(at)}",)
    place = table_host(address)
    if place is None:
        return (link,)
    host, port = place
    return tuple(f"{one}:{port}" for one in resolve_host(host))


def table_host(address: str) -> tuple[str, int] | None:
    """Return the host and the port in a table's address; None if it has none."""
    return host_and_port(urlsplit(_table_link(address)), table_driver(address).port)


def _table_link(address: str) -> str:
    """Return the link in a table's address: without parameters, and without a scheme before it."""
    link = address.partition("?")[0]
    _, at = _scheme(link)
    return at if not at.startswith("//") and _scheme(at)[0] in LINKS else link


def resolve_host(host: str) -> tuple[str, ...]:
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

    given = address_parameters(address)
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
    whole = address_parameters(address)
    given = {k: v for k, v in whole.items() if k not in ("preset", "layout")}
    if given == whole:
        return address
    return with_parameters(address, given)


def _scheme(address: str) -> tuple[str, str]:
    kind, _, at = address.partition(":")
    return kind.lower(), at
