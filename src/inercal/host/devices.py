"""What is connected: ports, what an IMU sends, how a table's controller is set."""

from contextlib import suppress
from dataclasses import dataclass
from time import monotonic

import numpy as np

from inercal.benches.turntable.bench import Turntable
from inercal.host.addresses import layout_of_address, link_of_address, open_table
from inercal.host.drivers.table import AxisLimits, ProtocolError, TableFault, TableState
from inercal.host.link import LinkLost, open_link, pyserial_needed
from inercal.host.packets import PRESETS, Counts, Decoder, Layout, read_layout

_LISTENS = 1.0  # s
_MOST = 1 << 16  # bytes at a time
_TAKEN = 0.5  # of the bytes: below it what fits is chance


@dataclass(frozen=True)
class Port:
    """A serial port: its address, and what the system says is there."""

    address: str
    what: str


@dataclass(frozen=True)
class Sender:
    """A way in which what an IMU sends can be read.

    Parameters
    ----------
    layout : Layout
    counts : Counts
        While it was listened to; what is thrown has the packet that was under way at the start.
    taken : float
        Part of the bytes that make packets.
    rate_hz : float
        Packets a second: by the device's own clock where it tells one, else by the host's.
    """

    layout: Layout
    counts: Counts
    taken: float
    rate_hz: float


@dataclass(frozen=True)
class Imu:
    """What came from an IMU: bytes, s of listening, ways to read them, the best first."""

    address: str
    size: int
    seconds: float
    senders: tuple[Sender, ...]


@dataclass(frozen=True)
class Table:
    """How a table's controller is set, and where the table is."""

    address: str
    identity: str
    axes: tuple[str, ...]
    limits: tuple[AxisLimits, ...]
    wraps: float
    state: TableState


def ports() -> tuple[Port, ...]:
    """Return the serial ports of this machine.

    Raises
    ------
    InputError
        pyserial is not installed.
    """
    with pyserial_needed():
        from serial.tools import list_ports
    return tuple(
        Port(f"serial:{port.device}", port.description or "") for port in list_ports.comports()
    )


def imu(address: str, seconds: float = _LISTENS) -> Imu:
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
                came += opened.read(_MOST, left)
        took = monotonic() - begun
    senders = [sender for layout in told if (sender := _sender(layout, bytes(came), took))]
    senders.sort(key=lambda sender: (-sender.taken, -sender.layout.check_bits))
    return Imu(address, len(came), took, tuple(senders))


def table(address: str, bench: Turntable | None = None, timeout: float = 1.0) -> Table:
    """Return what a table says of itself; moves nothing.

    Raises
    ------
    InputError, LinkLost, ProtocolError
        As `inercal.host.addresses.open_table`.
    """
    with open_table(address, bench, timeout) as opened:
        identity = ""
        with suppress(ProtocolError, TableFault):
            identity = opened.identity()
        return Table(address, identity, opened.axes, opened.limits, opened.wraps, opened.read())


def _sender(layout: Layout, came: bytes, seconds: float) -> Sender | None:
    """Return how a layout reads what came; None where it does not."""
    decoder = Decoder(layout, mid_stream=True)
    packets = decoder.feed(came)
    counts = decoder.counts
    taken = 1 - (counts.thrown + decoder.pending) / max(len(came), 1)
    if not len(packets) or taken < _TAKEN:
        return None
    rate = (counts.packets + counts.lost) / seconds
    if packets.time is not None and len(packets) > 1:
        step = float(np.median(np.diff(packets.time)))
        rate = 1 / step if step > 0 else rate
    return Sender(layout, counts, taken, rate)
