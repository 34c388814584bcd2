"""A simulated Turbo PMAC with the commands that a table needs, over its Ethernet protocol.

It was written from the manual, independently of the driver; the two have only the protocol in
common. The codec is `_Session`, the command line is `pmac_commands`, and the table is
`dynamics.SimulatedTable`.

The following are not simulated: programs (BnR finds none: ERR015), coordinate systems, MACRO and
data gathering. A whole line is executed within one servo cycle.

Run it as `python -m inercal.host.sim.pmac --port 1025`.
"""

from argparse import ArgumentParser
from math import tau
from struct import unpack_from

from inercal.host.sim.controller import Controller
from inercal.host.sim.dynamics import AxisDynamics, SimulatedTable, three_axes
from inercal.host.sim.pmac_commands import Interpreter
from inercal.host.sim.server import add_pace_option, selected_pace, serve

_CHUNK = 1400
_WITH_DATA = (0xB0, 0xBF, 0xC6)  # SENDLINE, GETRESPONSE, WRITEBUFFER: the length is of the data


class SimulatedPmac(Controller):
    """A Turbo PMAC with one motor for each axis of a table; motor 1 is the outermost axis.

    Parameters
    ----------
    axes : sequence of Axis
        The axes, from outer to inner.
    counts_per_turn : int
        Encoder counts per turn, the same on all axes.
    """

    def __init__(
        self,
        axes: tuple[AxisDynamics, ...] | None = None,
        counts_per_turn: int = 3_600_000,
        i10: int = 3713707,
    ):
        super().__init__(SimulatedTable(axes or three_axes(), 8388608e3 / i10))
        self.interpreter = Interpreter(self.table, counts_per_turn / tau, i10)

    def session(self) -> "_Session":
        """Return the controller's side of a new connection."""
        return _Session(self.interpreter)


class _Session:
    """The Ethernet protocol: takes packets, and returns replies in chunks."""

    def __init__(self, interpreter: Interpreter):
        self._interpreter = interpreter
        self._motor = 1  # `#n` stays addressed until the next one
        self._buffer = b""
        self._unread_reply = b""

    def feed(self, data: bytes) -> bytes:
        """As `server.Session.feed`."""
        self._buffer += data
        answer = b""
        while len(self._buffer) >= 8:
            kind, request, value, _, length = unpack_from(">BBHHH", self._buffer)
            size = 8 + (length if kind == 0x40 and request in _WITH_DATA else 0)
            if len(self._buffer) < size:
                break
            packet, self._buffer = self._buffer[8:size], self._buffer[size:]
            answer += self._answer(kind, request, value, packet)
        return answer

    def _answer(self, kind: int, request: int, value: int, packet: bytes) -> bytes:
        match kind, request:
            case 0x40, 0xBF:  # GETRESPONSE
                reply, self._motor = self._interpreter.execute_line(packet, self._motor)
                self._unread_reply = reply
                return self._chunk()
            case 0x40, 0xB0:  # SENDLINE
                self._unread_reply, self._motor = self._interpreter.execute_line(
                    packet, self._motor
                )
                return b"@"
            case 0xC0, 0xC5:  # GETBUFFER; NUL if there is nothing
                return self._chunk() or b"\x00"
            case 0xC0, 0xC2:  # READREADY
                return bytes([bool(self._unread_reply), 0])
            case 0xC0, 0xC4:  # CTRL_RESPONSE; the character may be in either byte, as hosts differ
                self._interpreter.execute_control(value >> 8 or value & 0xFF)
                return b"\x06"
            case 0x40, 0xB3:  # FLUSH
                self._unread_reply = b""
                return b"@"
            case _:
                return b""

    def _chunk(self) -> bytes:
        chunk, self._unread_reply = self._unread_reply[:_CHUNK], self._unread_reply[_CHUNK:]
        return chunk


def main() -> None:
    """Serve a simulated PMAC until standard input ends; see `server.serve`."""
    parser = ArgumentParser(prog="python -m inercal.host.sim.pmac", description=__doc__)
    parser.add_argument("--port", type=int, default=0, help="port; 0 selects any free one")
    parser.add_argument("--counts", type=int, default=3_600_000, help="encoder counts per turn")
    add_pace_option(parser)
    options = parser.parse_args()
    serve(SimulatedPmac(counts_per_turn=options.counts), selected_pace(options), options.port)


if __name__ == "__main__":
    main()
