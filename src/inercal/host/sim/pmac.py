"""A simulated Turbo PMAC with the commands that a table needs, over its Ethernet protocol.

The simulator was written from the manual, independently of the driver; simulator and driver have
only the protocol in common. The codec is `_Session`, the command line with its I-variables is
`Interpreter`, and the table is `dynamics.SimulatedTable`.

Commands on one line are executed in order. The first invalid one ends the line with BELL, ERRnnn
and CR instead of ACK. Values are reported with CR after each (I3=2), and I-variables that are
addresses as $hex (I9=2). Each different line is parsed only once, because hosts repeat their lines.

The following are not simulated: programs (BnR finds none: ERR015), coordinate systems, MACRO and
data gathering. A whole line is executed within one servo cycle.

Run it as `python -m inercal.host.sim.pmac --port 1025`.
"""

import re
from collections.abc import Callable
from functools import lru_cache, partial
from math import inf, tau
from struct import unpack_from

from inercal.host.sim import _table_kernel as kernel
from inercal.host.sim import dynamics
from inercal.host.sim.server import serve, simulator_parser

_VALUE = r"[+-]?(?:\$[0-9A-F]+|\d+\.?\d*|\.\d+)"
_COMMANDS = re.compile(
    rf"\s*(?:(?P<version>VER(?:SION)?)|(?P<type>TYPE)|(?P<cid>CID)|\#(?P<motor>\d+)|&(?P<system>\d+)"
    rf"|B(?P<program>\d+)R?|I(?P<first>\d+)\s*\.\.\s*(?P<last>\d+)"
    rf"|I(?P<set>\d+)\s*=\s*(?:I(?P<copy>\d+)|(?P<value>{_VALUE}))|I(?P<get>\d+)"
    rf"|R(?P<hex>H?)X:?(?P<memory>\$?[0-9A-F]+)"
    rf"|J\s*=\s*(?P<jog_to>{_VALUE})|J\s*\^\s*(?P<jog_by>{_VALUE})|J(?P<jog>[-+/])"
    rf"|(?P<act>HM|K|A|P(?!\d)|V|F|\?))\s*"
)
_UNKNOWN, _OPEN, _NO_MOTOR, _NO_PROGRAM = 3, 12, 13, 15

# Initial settings of a motor: counts, counts/ms, counts/ms², 1/16 count.
_DEFAULTS = {
    0: 1.0, 11: 16 * 20000.0, 13: 0.0, 14: 0.0, 15: 2.0, 16: 4000.0, 17: 2.0, 19: 0.1, 20: 0.0,
    21: 0.0, 22: 300.0, 23: 100.0, 24: float(0x120001), 28: 16 * 5.0, 60: 0.0,
}  # fmt: skip
_IDENTITY = {"version": "1.947", "type": "TURBO2, X4", "cid": "603382"}
_ADDRESSES = (24,)
_FRACTIONS = tuple(
    f"{part / 32:.5f}".rstrip("0").removeprefix("0").rstrip(".") for part in range(32)
)
_MAX_CACHED_LINES = 200  # number of parsed lines in the cache

# The action of a command: it returns the reply or raises `_CommandError`.
_Step = Callable[[], str | None]


class _CommandError(Exception):
    """A command cannot be executed; the exception contains the error number."""

    def __init__(self, number: int):
        self.number = number


class Interpreter:
    """Executes command lines on a table.

    Parameters
    ----------
    table : Table
    counts : float
        Encoder counts per rad.
    i10 : int
        Duration of a servo cycle in 1/8388608 ms.
    """

    def __init__(self, table: dynamics.SimulatedTable, counts: float, i10: int):
        self._table, self._counts = table, counts
        self._variables = {3: 2.0, 6: 1.0, 9: 2.0, 10: float(i10)}
        self._variables |= {20: float(0x78400), 21: 0.0, 22: 0.0, 23: 0.0}
        self._programs: dict[tuple[bytes, int], tuple[list[tuple[int, _Step]], int]] = {}
        self._reports: list[dynamics.AxisReport] | None = None
        for i in range(len(table.axes)):
            self._variables |= {100 * (i + 1) + n: value for n, value in _DEFAULTS.items()}
            self._apply(i)

    def execute_line(self, packet: bytes, motor: int) -> tuple[bytes, int]:
        """Return the complete reply to a command line, and the motor that is addressed next."""
        if (packet, motor) not in self._programs:
            if len(self._programs) >= _MAX_CACHED_LINES:
                self._programs.clear()
            self._programs[packet, motor] = self._compile_line(packet, motor)
        program, last = self._programs[packet, motor]
        said = ""
        self._reports = None
        for addressed, step in program:
            try:
                text = step()
            except (_CommandError, dynamics.ServoOffError) as error:
                number = error.number if isinstance(error, _CommandError) else _OPEN
                return f"{said}\x07ERR{number:03d}\r".encode(), addressed
            if text is None:
                self._reports = None
            else:
                said += text + "\r"
        return f"{said}\x06".encode(), last

    def execute_control(self, character: int) -> None:
        """Execute ^A (abort all) or ^K (kill all); other characters have no effect here."""
        for i in range(len(self._table.axes)):
            if character == 0x01:
                # As in the real controller, an abort also closes the loops of killed motors.
                self._table.enable(i)
                self._table.halt(i, abort=True)
            elif character == 0x0B:
                self._table.kill(i)

    def _compile_line(self, packet: bytes, motor: int) -> tuple[list[tuple[int, _Step]], int]:
        """Return the steps of a line with their motors, and the motor addressed at the end."""
        text = packet.decode("latin-1").upper().rstrip("\r\0")
        steps: list[tuple[int, _Step]] = []
        place = 0
        while place < len(text):
            if text[place] in "\x01\x0b":
                steps.append((motor, partial(self.execute_control, ord(text[place]))))
                place += 1
                continue
            match = _COMMANDS.match(text, place)
            if match is not None and match["motor"]:
                motor = int(match["motor"])
                if motor > 32:
                    match = None
            elif match is not None:
                steps.append((motor, self._step(match, motor)))
            if match is None:
                steps.append((motor, partial(_raise_error, _UNKNOWN)))
                break
            place = match.end()
        return steps, motor

    def _step(self, match: re.Match[str], motor: int) -> _Step:
        """Return the action of a command."""
        match match.lastgroup:
            case "version" | "type" | "cid" as what:
                return lambda: _IDENTITY[what]
            case "system":
                return lambda: None
            case "program":
                return partial(_raise_error, _NO_PROGRAM)
            case "last":
                requested = range(int(match["first"]), min(int(match["last"]), 8191) + 1)
                return lambda: "\r".join(map(self._report, requested)) if requested else None
            case "get":
                return partial(self._report, int(match["get"]))
            case "value" | "copy":
                to, copy = int(match["set"]), match["copy"]
                if copy is None:
                    value = _parse_number(match["value"])
                    return lambda: self._set(to, value)
                return lambda: self._set(to, self._variables.get(int(copy), 0.0))
            case "memory":
                return partial(
                    self._memory, _parse_number(match["memory"]) == 0, bool(match["hex"])
                )
            case _ if 1 <= motor <= len(self._table.axes):
                return self._command(match, motor - 1)
            case _:
                return _missing_motor_step(match["act"])

    def _set(self, to: int, value: float) -> None:
        self._variables[to] = value
        if to >= 100 and to // 100 <= len(self._table.axes):
            self._apply(to // 100 - 1)

    def _memory(self, clock: bool, in_hex: bool) -> str:
        """Report a word of memory; only the servo clock is simulated."""
        word = self._table.cycle % (1 << 24) if clock else 0
        return f"{word:X}" if in_hex else str(word - (word >> 23 << 24))

    def _command(self, match: re.Match[str], i: int) -> _Step:
        table, counts, seen = self._table, self._counts, self._read_reports
        match match["act"] or match["jog"] or match.lastgroup:
            case "jog_to":
                goal = _parse_number(match["jog_to"]) / counts
                return lambda: table.move_axis(i, goal)
            case "jog_by":
                way = _parse_number(match["jog_by"]) / counts
                return lambda: table.move_axis(i, table.reading(i) + way)
            case "+" | "-" as sign:
                return partial(table.rotate_axis, i, 1.0 if sign == "+" else -1.0)
            case "/":
                return partial(self._hold, i)
            case "HM":
                return partial(self._home, i)
            case "K":
                return partial(table.kill, i)
            case "A":
                return partial(self.execute_control, 0x01)
            case "P":
                return lambda: _format_fraction(seen()[i].reading * counts)
            case "V":
                return lambda: _format_decimal(seen()[i].rate * counts * table.period, 1)
            case "F":
                return lambda: _format_fraction(seen()[i].following_error * counts)
            case _:
                return lambda: _status_words(seen()[i].flags, self._variables[100 * (i + 1)] != 0)

    def _read_reports(self) -> list[dynamics.AxisReport]:
        """Return the reports of the axes; they are updated after commands that may change them."""
        if self._reports is None:
            self._reports = self._table.report()
        return self._reports

    def _hold(self, i: int) -> None:
        self._table.enable(i)
        self._table.halt(i)

    def _home(self, i: int) -> None:
        self._table.state[i].speed = abs(self._rad_s(i, 23))
        self._table.search(i, 1.0 if self._variables[100 * i + 123] >= 0 else -1.0)

    def _apply(self, i: int) -> None:
        """Set an axis from the I-variables of its motor."""
        x, get = self._table.state[i], self._variables
        base, to_rad = 100 * (i + 1), 1 / self._counts
        # With zero acceleration, the axis would never arrive; this is also true for a real axis.
        slowest = 1e-9
        x.acceleration = max(get[base + 19] * 1e6 * to_rad, slowest)
        x.speed = abs(self._rad_s(i, 22))
        time = max(get[base + 20], 2 * get[base + 21]) * 1e-3
        if time > 0:
            x.acceleration = min(x.acceleration, max(float(x.speed) / time, slowest))
        cycles = round(get[base + 21] * 1e-3 / self._table.period)
        x.smooth = min(max(cycles, 1), 1024) if not self._table.is_moving(i) else x.smooth
        x.abort = max(get[base + 15] * 1e6 * to_rad, slowest)
        x.high = get[base + 13] * to_rad if get[base + 13] else inf
        x.low = get[base + 14] * to_rad if get[base + 14] else -inf
        x.fatal = get[base + 11] / 16 * to_rad if get[base + 11] else inf
        x.band = get[base + 28] / 16 * to_rad

    def _rad_s(self, i: int, n: int) -> float:
        return self._variables[100 * (i + 1) + n] * 1e3 / self._counts

    def _report(self, n: int) -> str:
        value = self._variables.get(n, 0.0)
        if 20 <= n <= 23 or (100 <= n < 3300 and n % 100 in _ADDRESSES):
            return f"${int(value):X}"
        return f"{value:.12g}"


def _raise_error(number: int) -> None:
    raise _CommandError(number)


def _missing_motor_step(act: str | None) -> _Step:
    """Return the action of a command to a missing motor: report zeros or refuse to move."""
    if act in ("P", "V", "F"):
        return lambda: "0"
    if act == "?":
        return lambda: "0" * 12
    return partial(_raise_error, _NO_MOTOR)


@lru_cache(1024)
def _status_words(flags: int, activated: bool) -> str:
    """Return the two status words that `?` reports."""
    closed, moving = bool(flags & kernel.CLOSED), bool(flags & kernel.MOVING)
    first = {
        23: activated,
        19: closed,
        18: not closed,
        17: moving,
        13: closed and not moving,
        12: flags & kernel.ABORTING,
        10: flags & kernel.SEARCHING,
    }
    second = {
        15: True,
        11: flags & kernel.LIMITED,
        10: flags & kernel.HOMED,
        3: flags & kernel.AMPLIFIER,
        2: flags & kernel.TRIPPED,
        0: flags & kernel.SETTLED,
    }
    words = (sum(bool(on) << bit for bit, on in word.items()) for word in (first, second))
    return "".join(f"{word:06X}" for word in words)


def _parse_number(text: str) -> float:
    sign = -1.0 if text.startswith("-") else 1.0
    digits = text.lstrip("+-")
    return sign * (int(digits[1:], 16) if digits.startswith("$") else float(digits))


def _format_fraction(counts: float) -> str:
    """Round counts to 1/32, like the registers of the controller."""
    parts = round(counts * 32)
    return f"{'-' if parts < 0 else ''}{abs(parts) >> 5}{_FRACTIONS[abs(parts) & 31]}"


def _format_decimal(value: float, digits: int) -> str:
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


_CHUNK = 1400
_WITH_DATA = (0xB0, 0xBF, 0xC6)  # SENDLINE, GETRESPONSE, WRITEBUFFER: data of this length follow


class SimulatedPmac(dynamics.Controller):
    """A Turbo PMAC with one motor for each axis of a table; motor 1 is the outermost axis.

    Parameters
    ----------
    axes : sequence of Axis
        The axes, from outer to inner.
    counts_per_turn : int
        Encoder counts per turn, which are the same for all axes.
    """

    def __init__(
        self,
        axes: tuple[dynamics.AxisDynamics, ...] | None = None,
        counts_per_turn: int = 3_600_000,
        i10: int = 3713707,
    ):
        super().__init__(dynamics.SimulatedTable(axes or dynamics.three_axes(), 8388608e3 / i10))
        self.interpreter = Interpreter(self.table, counts_per_turn / tau, i10)

    def session(self) -> "_Session":
        """Return a new session of the controller, for a new connection."""
        return _Session(self.interpreter)


class _Session:
    """The Ethernet protocol: processes packets, and returns replies in chunks."""

    def __init__(self, interpreter: Interpreter):
        self._interpreter = interpreter
        self._motor = 1  # `#n` stays addressed until the next `#n`
        self._buffer = b""
        self._unread_reply = b""

    def feed(self, data: bytes) -> bytes:
        """See `server.Session.feed`."""
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
            case 0xC0, 0xC5:  # GETBUFFER; NUL if there are no data
                return self._chunk() or b"\x00"
            case 0xC0, 0xC2:  # READREADY
                return bytes([bool(self._unread_reply), 0])
            case 0xC0, 0xC4:  # CTRL_RESPONSE; the byte of the character differs between hosts
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
    parser = simulator_parser("python -m inercal.host.sim.pmac", __doc__)
    parser.add_argument("--counts", type=int, default=3_600_000, help="encoder counts per turn")
    options = parser.parse_args()
    serve(SimulatedPmac(counts_per_turn=options.counts), options)


if __name__ == "__main__":
    main()
