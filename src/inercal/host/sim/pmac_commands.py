"""The command line of a simulated Turbo PMAC, and the I-variables behind it.

Commands on one line are carried out in their order; the first that is wrong ends the line with
BELL, ERRnnn and CR, in place of the ACK. Values are reported with CR behind each (I3=2),
I-variables that are addresses as $hex (I9=2).
"""

import re
from collections.abc import Callable
from math import inf

from inercal.host.sim.dynamics import Killed, Table

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

# What a motor is set to when the simulator starts: counts, counts/ms, counts/ms², 1/16 count.
_DEFAULTS = {
    0: 1.0, 11: 16 * 20000.0, 13: 0.0, 14: 0.0, 15: 2.0, 16: 4000.0, 17: 2.0, 19: 0.1, 20: 0.0,
    21: 0.0, 22: 300.0, 23: 100.0, 24: float(0x120001), 28: 16 * 5.0, 60: 0.0,
}  # fmt: skip
_ADDRESSES = (24,)


class Interpreter:
    """Carries out command lines on a table.

    Parameters
    ----------
    table : Table
    counts : float
        Encoder counts in a rad.
    i10 : int
        The servo cycle in 1/8388608 ms.
    """

    def __init__(self, table: Table, counts: float, i10: int):
        self._table, self._counts = table, counts
        self._variables = {3: 2.0, 6: 1.0, 9: 2.0, 10: float(i10)}
        self._variables |= {20: float(0x78400), 21: 0.0, 22: 0.0, 23: 0.0}
        for i in range(len(table.axes)):
            self._variables |= {100 * (i + 1) + n: value for n, value in _DEFAULTS.items()}
            self._apply(i)

    def line(self, packet: bytes, motor: int) -> tuple[bytes, int]:
        """Return the whole reply to a command line, and the motor that is addressed after it."""
        text = packet.decode("latin-1").upper().rstrip("\r\0")
        said: list[str] = []
        place = 0
        while place < len(text):
            if text[place] in "\x01\x0b":
                self.control(ord(text[place]))
                place += 1
                continue
            match = _COMMANDS.match(text, place)
            error = _UNKNOWN
            if match is not None:
                if match["motor"]:
                    motor = int(match["motor"])
                    error = None if motor <= 32 else _UNKNOWN
                else:
                    error = self._carry_out(match, motor, said.append)
            if match is None or error is not None:
                return (_lines(said) + f"\x07ERR{error:03d}\r").encode(), motor
            place = match.end()
        return (_lines(said) + "\x06").encode(), motor

    def control(self, character: int) -> None:
        """Carry out ^A (abort all) or ^K (kill all); others do nothing here."""
        for i in range(len(self._table.axes)):
            if character == 0x01:
                # As the real one does, an abort also closes the loops of killed motors.
                self._table.enable(i)
                self._table.halt(i, abort=True)
            elif character == 0x0B:
                self._table.kill(i)

    def _carry_out(
        self, match: re.Match[str], motor: int, say: Callable[[str], None]
    ) -> int | None:
        """Carry out one command; return the number of its error."""
        what = match.lastgroup
        match what:
            case "version":
                say("1.947")
            case "type":
                say("TURBO2, X4")
            case "cid":
                say("603382")
            case "system":
                pass
            case "program":
                return _NO_PROGRAM
            case "last":
                for n in range(int(match["first"]), min(int(match["last"]), 8191) + 1):
                    say(self._report(n))
            case "get":
                say(self._report(int(match["get"])))
            case "value" | "copy":
                to = int(match["set"])
                value = (
                    _number(match["value"])
                    if match["copy"] is None
                    else self._variables.get(int(match["copy"]), 0.0)
                )
                self._variables[to] = value
                if to >= 100 and to // 100 <= len(self._table.axes):
                    self._apply(to // 100 - 1)
            case "memory":
                cycle = self._table.cycle % (1 << 24)
                word = cycle if _number(match["memory"]) == 0 else 0
                say(f"{word:X}" if match["hex"] else str(word - (word >> 23 << 24)))
            case _:
                if not 1 <= motor <= len(self._table.axes):
                    return self._absent(match, say)
                return self._command(match, motor - 1, say)
        return None

    def _absent(self, match: re.Match[str], say: Callable[[str], None]) -> int | None:
        """Report zeros for a motor that is not there, and refuse to move it."""
        if match["act"] in ("P", "V", "F"):
            say("0")
        elif match["act"] == "?":
            say("0" * 12)
        else:
            return _NO_MOTOR
        return None

    def _command(self, match: re.Match[str], i: int, say: Callable[[str], None]) -> int | None:
        table, x = self._table, self._table.state[i]
        try:
            match match["act"] or match["jog"] or match.lastgroup:
                case "jog_to":
                    table.go(i, _number(match["jog_to"]) / self._counts)
                case "jog_by":
                    table.go(i, table.reading(i) + _number(match["jog_by"]) / self._counts)
                case "+" | "-" as sign:
                    table.run(i, 1.0 if sign == "+" else -1.0)
                case "/":
                    table.enable(i)
                    table.halt(i)
                case "HM":
                    x.speed = abs(self._rad_s(i, 23))
                    table.search(i, 1.0 if self._variables[100 * i + 123] >= 0 else -1.0)
                case "K":
                    table.kill(i)
                case "A":
                    self.control(0x01)
                case "P":
                    say(_fraction(table.reading(i) * self._counts))
                case "V":
                    say(_decimal(float(x.encoder_rate) * self._counts * table.period, 1))
                case "F":
                    say(_fraction(float(x.desired - x.encoder) * self._counts))
                case _:
                    say(self._status(i))
        except Killed:
            return _OPEN
        return None

    def _apply(self, i: int) -> None:
        """Set the axis as the I-variables of its motor say."""
        x, get = self._table.state[i], self._variables
        base, to_rad = 100 * (i + 1), 1 / self._counts
        # An acceleration of zero would never arrive; so would the real one's.
        slowest = 1e-9
        x.acceleration = max(get[base + 19] * 1e6 * to_rad, slowest)
        x.speed = abs(self._rad_s(i, 22))
        time = max(get[base + 20], 2 * get[base + 21]) * 1e-3
        if time > 0:
            x.acceleration = min(x.acceleration, max(float(x.speed) / time, slowest))
        cycles = round(get[base + 21] * 1e-3 / self._table.period)
        x.smooth = min(max(cycles, 1), 1024) if self._resting(i) else x.smooth
        x.abort = max(get[base + 15] * 1e6 * to_rad, slowest)
        x.high = get[base + 13] * to_rad if get[base + 13] else inf
        x.low = get[base + 14] * to_rad if get[base + 14] else -inf
        x.fatal = get[base + 11] / 16 * to_rad if get[base + 11] else inf
        x.band = get[base + 28] / 16 * to_rad

    def _resting(self, i: int) -> bool:
        return not self._table.moving(i)

    def _rad_s(self, i: int, n: int) -> float:
        return self._variables[100 * (i + 1) + n] * 1e3 / self._counts

    def _report(self, n: int) -> str:
        value = self._variables.get(n, 0.0)
        if 20 <= n <= 23 or (100 <= n < 3300 and n % 100 in _ADDRESSES):
            return f"${int(value):X}"
        return f"{value:.12g}"

    def _status(self, i: int) -> str:
        table, x = self._table, self._table.state[i]
        closed, moving = bool(x.closed), table.moving(i)
        first = sum(
            bool(on) << bit
            for bit, on in (
                (23, self._variables[100 * (i + 1)]),
                (19, closed),
                (18, not closed),
                (17, moving),
                (13, closed and not moving),
                (12, x.aborting),
                (10, x.mode == 3),
            )
        )
        second = sum(
            bool(on) << bit
            for bit, on in (
                (15, True),
                (11, x.limited),
                (10, x.homed),
                (3, x.amplifier),
                (2, x.tripped),
                (0, table.settled(i)),
            )
        )
        return f"{first:06X}{second:06X}"


def _lines(said: list[str]) -> str:
    return "".join(text + "\r" for text in said)


def _number(text: str) -> float:
    sign = -1.0 if text.startswith("-") else 1.0
    digits = text.lstrip("+-")
    return sign * (int(digits[1:], 16) if digits.startswith("$") else float(digits))


def _fraction(counts: float) -> str:
    """Round counts to 1/32, as the controller's registers have them."""
    return _decimal(round(counts * 32) / 32, 5)


def _decimal(value: float, digits: int) -> str:
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
