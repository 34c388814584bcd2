"""What is connected: ports, what an IMU sends, how a table's controller is set."""

from contextlib import nullcontext, suppress
from dataclasses import dataclass
from time import monotonic

import numpy as np

from inercal.benches.motion_control import ControlledBench
from inercal.host.addresses import (
    allows_second_connection,
    layout_of_address,
    link_of_address,
    open_table,
)
from inercal.host.drivers.rotary_table import AxisLimits, ProtocolError, TableFault, TableState
from inercal.host.link import LinkLost, open_link, require_pyserial
from inercal.host.packets import PRESETS, Decoder, PacketCounts, PacketLayout, read_layout
from inercal.host.table_lock import TableLock

_LISTEN_TIME = 1.0  # s
_MAX_BYTES = 1 << 16  # bytes at a time
_MIN_DECODED_FRACTION = 0.5  # of the bytes: below it what fits is chance


@dataclass(frozen=True)
class SerialPort:
    """A serial port: its address, and what the system says is there."""

    address: str
    description: str


@dataclass(frozen=True)
class PacketDecoding:
    """A way in which what an IMU sends can be read.

    Parameters
    ----------
    layout : PacketLayout
    counts : PacketCounts
        While it was listened to; what is thrown has the packet that was under way at the start.
    decoded_fraction : float
        Part of the bytes that make packets.
    rate_hz : float
        Packets a second: by the device's own clock where it tells one, else by the host's.
    """

    layout: PacketLayout
    counts: PacketCounts
    decoded_fraction: float
    rate_hz: float


@dataclass(frozen=True)
class ImuConnection:
    """What came from an IMU: bytes, s of listening, ways to read them, the best first."""

    address: str
    size: int
    seconds: float
    decodings: tuple[PacketDecoding, ...]


@dataclass(frozen=True)
class TableConnection:
    """How a table's controller is set, and where the table is."""

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
    """Listen to an IMU, and return which packets it sends.

    Parameters
    ----------
    address : str
        As `inercal.host.addresses.open_imu` takes it; without `preset` and `layout` all presets are
        tried.
    seconds : float
        s to listen; less where the other end ends.

    Raises
    ------
    InputError
        An address of another form, or no description of its packets.
    LinkLost
        Nobody is there, or the port cannot be opened.
    """
    link = link_of_address(address)
    told = [read_layout(p) for p in PRESETS] if link == address else [layout_of_address(address)]
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
    """Return what a table says of itself; moves nothing.

    Raises
    ------
    InputError, LinkLost, ProtocolError
        As `inercal.host.addresses.open_table`; the table is on a serial port, and another program
        commands it.
    """
    # Two readers of a serial port take the replies from one another.
    shares = allows_second_connection(address)
    lock = nullcontext() if shares else TableLock(address, "a query of the table")
    with lock, open_table(address, bench, timeout) as opened:
        identity = ""
        with suppress(ProtocolError, TableFault):
            identity = opened.identity()
        return TableConnection(
            address, identity, opened.axes, opened.limits, opened.wrap_period, opened.read()
        )


def _try_layout(layout: PacketLayout, came: bytes, seconds: float) -> PacketDecoding | None:
    """Return how a layout reads what came; None where it does not."""
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
