"""Encodes requests to a Turbo PMAC over Ethernet and decodes its replies, without any I/O.

A request consists of a header of 8 bytes and the command line. The header contains type and request
(one byte each), and then value, index and length (two bytes each; the length is big-endian). The
reply is text: lines that end with CR, and an ACK at the end. If a command is refused, the reply is
BELL, ERRnnn and CR. The controller sends at most 1400 bytes and then waits for a request before it
sends the rest. TCP may split these bytes anywhere. The end of a reply is never guessed from the
number of bytes that arrived.

Source: Delta Tau, Turbo PMAC User Manual, "Turbo PMAC Ethernet Protocol"; Turbo PMAC Software
Reference Manual, I6 (errors), `?` (status), `P`, `V`, `F`.
"""

import re
from functools import lru_cache
from struct import pack
from typing import NamedTuple

from inercal.basics.errors import InputError
from inercal.host.drivers.rotary_table import ProtocolError, TableFault

CHUNK_SIZE = 1400  # bytes that the controller sends at a time
FLUSH_ANSWER = b"@"  # the controller's answer to `FLUSH_REQUEST`
_MAX_REPLY_SIZE = 1 << 20  # bytes; real replies are far shorter
_MAX_LINE_SIZE = 1492  # largest number of bytes of a command line in a packet

_DOWNLOAD, _UPLOAD = 0x40, 0xC0
_FLUSH, _GETRESPONSE, _CONTROL, _GETBUFFER = 0xB3, 0xBF, 0xC4, 0xC5
# Requests for the next 1400 bytes of a reply, and to discard the rest of a reply.
BUFFER_REQUEST = pack(">BBHHH", _UPLOAD, _GETBUFFER, 0, 0, CHUNK_SIZE)
FLUSH_REQUEST = pack(">BBHHH", _DOWNLOAD, _FLUSH, 0, 0, 0)
_ACK = b"\x06"
_END = re.compile(rb"[\x06\x07]")  # ACK, or BELL before an error
_JUNK = re.compile(rb"[^\x20-\x7e\r\n]")
_REFUSAL = re.compile(rb"\x07(ERR(\d{3}))\r")
_WORDS = {n: re.compile(rf"\s*[0-9A-Fa-f]{{1,{n}}}\s*") for n in (6, 12)}
_PLAIN = re.compile(r"[+-]?\d{1,20}(?:\.\d{0,20})?", re.ASCII)
_NUMBER = re.compile(
    r"\s*([+-]?)(\$[0-9A-Fa-f]{1,12}|\d{1,20}(?:\.\d{0,20})?|\.\d{1,20})\s*", re.ASCII
)

ERRORS = {
    1: "not allowed while a program runs",
    2: "wrong password",
    3: "unknown command or bad data",
    4: "illegal character",
    5: "only allowed with a buffer open",
    6: "no room in the buffer",
    7: "the buffer is in use",
    8: "MACRO ring: auxiliary communication failed",
    9: "structure error in a program",
    10: "both overtravel limits are set",
    11: "the previous move is not over",
    12: "the motor's loop is open: enable it first",
    13: "the motor is not activated (Ixx00)",
    14: "no motor in the coordinate system",
    15: "no such program",
    16: "structure error in the running program",
    17: "the motors are not where they were stopped",
    18: "phasing is under way, or its clock is missing",
    19: "position may not be changed while moves are stored",
}

NEGATIVE_END, POSITIVE_END = "negative end limit", "positive end limit"
# Bits in the two status words of a motor that mean faults.
_FAULTS = (
    (1, 22, NEGATIVE_END),
    (1, 21, POSITIVE_END),
    (2, 12, "stopped at a limit of the desired position"),
    (2, 11, "stopped at a position limit"),
    (2, 8, "phasing reference error"),
    (2, 6, "integrated fatal following error"),
    (2, 5, "amplifier overload (I²t)"),
    (2, 3, "amplifier fault"),
    (2, 2, "fatal following error"),
)


class CommandRefused(TableFault):
    """The controller refused a command; `code` is the error number, or None if unknown."""

    def __init__(self, message: str, code: int | None):
        super().__init__(message)
        self.code = code


class MotorStatus(NamedTuple):
    """The status of a motor.

    Parameters
    ----------
    enabled : bool
        Whether the amplifier is on and the loop is closed.
    moving : bool
        Whether the desired velocity is not zero; the controller also reports this for an open loop.
    homed : bool
        Whether homing is complete.
    in_position : bool
        Whether the motor is within Ixx28 of its target.
    faults : tuple of str
        Faults as text.
    """

    enabled: bool
    moving: bool
    homed: bool
    in_position: bool
    faults: tuple[str, ...]


# The same line requests the table's state fifty times per second, so requests are cached.
@lru_cache(64)
def response_request(line: str) -> bytes:
    """Return the request that executes a command line and asks for the reply."""
    try:
        data = line.encode("ascii")
    except UnicodeEncodeError:
        data = b""
    if not 0 < len(data) <= _MAX_LINE_SIZE or min(data) < 0x20:
        raise InputError(
            f"{line!r} is not a command line: it needs 1 to {_MAX_LINE_SIZE} printable ASCII "
            "characters",
            key="line",
        )
    return pack(">BBHHH", _DOWNLOAD, _GETRESPONSE, 0, 0, len(data)) + data


def control_request(letter: str) -> bytes:
    """Return the request for a control character, such as "A" for ^A.

    The character is the first byte of the value, as in the drivers at synchrotrons.
    """
    return pack("<BBHHH", _UPLOAD, _CONTROL, ord(letter) & 0x1F, 0, 0)


class ReplyReader:
    """Assembles the reply to `line` from pieces of any size."""

    def __init__(self, line: str):
        self._line = line
        self._data = bytearray()
        self._end: int | None = None

    @property
    def awaits_request(self) -> bool:
        """Whether the controller waits for a request before it sends the rest of a reply."""
        return len(self._data) > 0 and len(self._data) % CHUNK_SIZE == 0

    @property
    def size(self) -> int:
        """Number of bytes received so far."""
        return len(self._data)

    def feed(self, data: bytes) -> list[str] | None:
        """Process received bytes; return the lines of the reply, or None while it is incomplete.

        Raises
        ------
        CommandRefused
            The controller answered with BELL and an error.
        ProtocolError
            There are bytes after the end, bytes that are not text, or no end within 1 MiB.
        """
        seen = len(self._data)
        self._data += data
        if self._end is None:
            found = _END.search(self._data, seen)
            self._end = found.start() if found else None
            junk = _JUNK.search(self._data, seen, found.start() if found else len(self._data))
            if junk:
                raise ProtocolError(
                    f"the reply to {self._line!r} contains byte 0x{junk[0].hex()}, which is not "
                    "text; check the link to the PMAC"
                )
        if self._end is None:
            if len(self._data) > _MAX_REPLY_SIZE:
                raise ProtocolError(
                    f"the reply to {self._line!r} has no end within {_MAX_REPLY_SIZE} bytes; "
                    "check that the address is that of a Turbo PMAC"
                )
            return None
        if self._data[self._end] == _ACK[0]:
            return self._lines(self._end)
        self._raise_refusal(bytes(self._data[self._end :]))
        return None

    def _lines(self, end: int) -> list[str]:
        if end + 1 < len(self._data):
            raise ProtocolError(
                f"the reply to {self._line!r} is followed by further bytes; check that no other "
                "program uses the controller"
            )
        text = self._data[:end].decode("ascii").replace("\n", "")
        if text and not text.endswith("\r"):
            raise ProtocolError(
                f"the reply to {self._line!r} is cut short in its last line {text[-40:]!r}; check "
                "the link to the PMAC"
            )
        return text.split("\r")[:-1]

    def _raise_refusal(self, rest: bytes) -> None:
        """Raise the error that the controller sends after BELL, if the error is complete."""
        # The received part must be the beginning of a known refusal.
        match = _REFUSAL.fullmatch(rest + b"\x07ERR000\r"[len(rest) :])
        if match is None:
            raise ProtocolError(
                f"the PMAC refused {self._line!r} with {rest[:20]!r}, not with ERRnnn; set I6=1 so "
                "that it states the error number"
            )
        if len(rest) == match.end():
            code = int(match[2])
            meaning = ERRORS.get(code, "an error that the manual does not list")
            raise CommandRefused(f"{match[1].decode()} to {self._line!r}: {meaning}", code)


def parse_number(text: str) -> float:
    """Return a number in the controller's notation: decimal, or hexadecimal after `$`.

    Raises `ProtocolError` for any other text.
    """
    if _PLAIN.fullmatch(text):
        return float(text)
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise ProtocolError(
            f"the PMAC replied {text[:40]!r} where a number was expected; check the link"
        )
    size = float(int(match[2][1:], 16)) if match[2][0] == "$" else float(match[2])
    return -size if match[1] == "-" else size


def parse_word(text: str, digits: int) -> int:
    """Return a word of at most `digits` (6 or 12) hexadecimal digits, without `$`.

    Raises `ProtocolError` for any other text.
    """
    if not _WORDS[digits].fullmatch(text):
        raise ProtocolError(
            f"the PMAC replied {text[:40]!r} where at most {digits} hexadecimal digits were "
            "expected; check the link"
        )
    return int(text, 16)


# In a run, a motor reports only a few different words, so the results are cached.
@lru_cache(256)
def parse_status(text: str) -> MotorStatus:
    """Return a motor's status from the reply to `#n?`: 12 digits, two words of 24 bits."""
    if len(text.strip()) != 12:
        raise ProtocolError(
            f"the PMAC replied {text[:40]!r} where a motor status of 12 hexadecimal digits was "
            "expected; check the link"
        )
    both = parse_word(text, 12)
    first, second = both >> 24, both & 0xFFFFFF
    activated = bool(first >> 23 & 1)
    enabled = bool(first >> 19 & 1) and not first >> 18 & 1
    words = (0, first, second)
    faults = tuple(wrong for which, bit, wrong in _FAULTS if words[which] >> bit & 1)
    return MotorStatus(
        enabled,
        moving=enabled and not first >> 13 & 1,
        homed=bool(second >> 10 & 1),
        in_position=bool(second & 1),
        faults=faults if activated else (*faults, "not activated"),
    )
