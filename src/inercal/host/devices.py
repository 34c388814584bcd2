"""Detects connected devices: serial ports, packets of an IMU, a table's settings, a chamber."""

from collections.abc import Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from math import degrees, isfinite, isnan
from time import monotonic

import numpy as np

from inercal.basics.units import ZERO_CELSIUS, format_count
from inercal.benches.motion_control import ControlledBench
from inercal.host import addresses
from inercal.host.drivers.rotary_table import AxisLimits, ProtocolError, TableFault, TableState
from inercal.host.equipment import ChamberState, open_chamber
from inercal.host.link import LinkLost, open_link, require_pyserial
from inercal.host.packets import PRESETS, Decoder, PacketCounts, PacketLayout, read_layout
from inercal.host.table_lock import TableLock

_LISTEN_TIME = 1.0  # s
_MAX_BYTES = 1 << 16  # bytes at a time
_MIN_DECODED_FRACTION = 0.5  # of all bytes; a smaller fraction may match by chance


@dataclass(frozen=True)
class SerialPort:
    """A serial port: its address, and the description from the system."""

    address: str
    description: str


@dataclass(frozen=True)
class PacketDecoding:
    """A packet format that matches the bytes from an IMU.

    Parameters
    ----------
    layout : PacketLayout
    counts : PacketCounts
        Counts of the received packets. The discarded bytes include the rest of a packet that began
        earlier.
    decoded_fraction : float
        Fraction of the bytes that belong to valid packets.
    rate_hz : float
        Packets per second, by the clock of the device if packets contain it, and otherwise by the
        host's clock.
    """

    layout: PacketLayout
    counts: PacketCounts
    decoded_fraction: float
    rate_hz: float


@dataclass(frozen=True)
class ImuConnection:
    """The bytes received from an IMU, and the matching packet formats; the best comes first."""

    address: str
    size: int
    seconds: float
    decodings: tuple[PacketDecoding, ...]


@dataclass(frozen=True)
class TableConnection:
    """The settings of a table's controller, and the state of the table."""

    address: str
    identity: str
    axes: tuple[str, ...]
    limits: tuple[AxisLimits, ...]
    wrap_period: float
    state: TableState


def list_serial_ports() -> tuple[SerialPort, ...]:
    """Return the serial ports of this machine.

    Raises
    ------
    InputError
        pyserial is not installed.
    """
    with require_pyserial():
        from serial.tools import list_ports
    return tuple(
        SerialPort(f"serial:{port.device}", port.description or "")
        for port in list_ports.comports()
    )


def probe_imu(address: str, seconds: float = _LISTEN_TIME) -> ImuConnection:
    """Listen to an IMU, and find the packet formats that match its bytes.

    Parameters
    ----------
    address : str
        Address of the IMU (see `inercal.host.addresses.open_imu`). Without `preset` and `layout`,
        all presets are tried.
    seconds : float
        Listening time, s. It is shorter if the other end closes the connection.

    Raises
    ------
    InputError
        The address is malformed, or the description of the packets cannot be read.
    LinkLost
        No device answers, or the port cannot be opened.
    """
    link = addresses.link_of_address(address)
    if link == address:
        told = [read_layout(preset) for preset in PRESETS]
    else:
        told = [addresses.layout_of_address(address)]
    came = bytearray()
    with open_link(link) as opened:
        begun = monotonic()
        with suppress(LinkLost):
            while (left := begun + seconds - monotonic()) > 0:
                came += opened.read(_MAX_BYTES, left)
        took = monotonic() - begun
    senders = [sender for layout in told if (sender := _try_layout(layout, bytes(came), took))]
    senders.sort(key=lambda sender: (-sender.decoded_fraction, -sender.layout.check_bits))
    return ImuConnection(address, len(came), took, tuple(senders))


def probe_table(
    address: str, bench: ControlledBench | None = None, timeout: float = 1.0
) -> TableConnection:
    """Return a table's settings and state without moving it.

    Raises
    ------
    InputError, LinkLost, ProtocolError
        See `inercal.host.addresses.open_table`. An error is also raised if the table is on a serial
        port and another program commands it.
    """
    # If two programs read one serial port, each loses replies to the other.
    shares = addresses.allows_second_connection(address)
    lock = nullcontext() if shares else TableLock(address, "a query of the table")
    with lock, addresses.open_table(address, bench, timeout) as opened:
        identity = ""
        with suppress(ProtocolError, TableFault):
            identity = opened.identity()
        return TableConnection(
            address, identity, opened.axes, opened.limits, opened.wrap_period, opened.read()
        )


def probe_chamber(address: str, timeout: float = 1.0) -> ChamberState:
    """Return a chamber's state without changing it; the errors are those of `open_chamber`."""
    with open_chamber(address, timeout) as opened:
        return opened.read()


def _try_layout(layout: PacketLayout, came: bytes, seconds: float) -> PacketDecoding | None:
    """Decode bytes with a layout, and return the result; None if the layout does not match."""
    decoder = Decoder(layout, mid_stream=True)
    packets = decoder.feed(came)
    counts = decoder.counts
    taken = 1 - (counts.discarded + decoder.pending) / max(len(came), 1)
    if not len(packets) or taken < _MIN_DECODED_FRACTION:
        return None
    rate = (counts.packets + counts.lost) / seconds
    if packets.time is not None and len(packets) > 1:
        step = float(np.median(np.diff(packets.time)))
        rate = 1 / step if step > 0 else rate
    return PacketDecoding(layout, counts, taken, rate)


def port_lines(ports: Sequence[SerialPort]) -> list[str]:
    """Return text lines that list the serial ports."""
    if not ports:
        return ["no serial port found; query a table or an IMU by its address: --table, --imu"]
    return [f"{port.address}  {port.description}" for port in ports]


def imu_lines(imu: ImuConnection) -> list[str]:
    """Return text lines that describe the data from an IMU."""
    lines = [f"{imu.address}: {imu.size} bytes in {imu.seconds:.1f} s"]
    if not imu.size:
        return [
            *lines,
            "  it sends nothing: check that it is switched on, and check the baud rate and the "
            "wiring. (A simulated IMU with granted time waits for a run; use simulate --pace 1.)",
        ]
    if not imu.decodings:
        return [
            *lines,
            "  no preset matches these bytes: try another baud rate, or describe the packets: "
            "layout=FILE.toml",
        ]
    return lines + [
        f"  preset={one.layout.name}: {one.rate_hz:.6g} packets per second, "
        f"{100 * one.decoded_fraction:.3g} % of the bytes used, "
        f"{format_count(one.counts.failed, 'checksum error')}; {one.layout.protection}"
        for one in imu.decodings
    ]


def table_lines(table: TableConnection) -> list[str]:
    """Return text lines that describe a table."""
    state = table.state
    lines = [f"{table.address}: {table.identity or 'does not identify itself'}"]
    for name, limit, axis in zip(table.axes, table.limits, state.axes, strict=True):
        soft = "no soft limits"
        if isfinite(limit.low) or isfinite(limit.high):
            soft = f"soft limits {degrees(limit.low):.6g} to {degrees(limit.high):.6g} °"
        servo = "servo on" if axis.enabled else "servo off"
        homed = "homed" if axis.homed else "not homed"
        most = degrees(limit.following_error)
        lines.append(
            f"  {name}: at {degrees(axis.angle):.4f} °, {servo}, {homed}; up to "
            f"{degrees(limit.rate):.6g} °/s and {degrees(limit.acceleration):.6g} °/s², {soft}"
            + (f", following error {most:.6g} °" if isfinite(most) else "")
            + (f"; {', '.join(axis.faults)}" if axis.faults else "")
        )
    if isfinite(table.wrap_period):
        lines.append(f"  the clock of the table wraps around after {table.wrap_period:.0f} s")
    return lines


def chamber_lines(address: str, state: ChamberState) -> list[str]:
    """Return a text line that describes the chamber at an address."""
    door = {None: "not reported", True: "open", False: "closed"}[state.door_open]
    alarms = ", ".join(state.alarms) or "no alarm"
    unknown = isnan(state.temperature)
    air = (
        "at an unknown temperature" if unknown else f"at {state.temperature - ZERO_CELSIUS:.2f} °C"
    )
    return [f"{address}: air {air}, door {door}; {alarms}"]
