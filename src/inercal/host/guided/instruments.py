"""Reads instruments: SCPI over TCP or a serial port, or devices that send lines unasked.

A reply or line contains one number, or several separated by commas, semicolons or spaces. The value
9.9E37 means overload in SCPI.
"""

import re
from collections.abc import Callable, Sequence
from math import isfinite
from time import monotonic

from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import InputError
from inercal.basics.units import format_count
from inercal.host.link import Link, LinkLost, open_link

_OVERLOAD = 9e36
_LONGEST = 4096  # bytes in a reply
_MOST_PIECES = 1000  # largest number of discarded pieces; a fast device never stops
_WORD = re.compile(r"[A-Za-zµμΩ°/²%]*")  # a unit after a number is not a value


class LineInstrument(Closeable):
    """A measuring instrument at an address, which sends lines of numbers.

    Parameters
    ----------
    address : str
        Address of the instrument; see `open_link`.
    query : str
        Command that requests a reading; empty for a device that sends lines unasked.
    timeout : float
        Longest time for one reading, s.
    opener : callable
        Function that opens a link to an address.

    Raises
    ------
    InputError
        The address is invalid, or pyserial is not installed.
    LinkLost
        No device answers.
    """

    def __init__(
        self, address: str, query: str, timeout: float, opener: Callable[[str], Link] = open_link
    ):
        self.address = address
        self._query, self._timeout, self._opener = query.encode(), timeout, opener
        self._buffer = b""
        self._link: Link | None = self._open()

    def begin(self) -> None:
        """Discard earlier replies, because the next reading must be current."""
        link = self._link = self._link or self._open()
        data = self._buffer
        with on_failure(self.close, LinkLost):
            for _ in range(_MOST_PIECES):
                if not (piece := link.read(_LONGEST, 0.0)):
                    break
                data += piece
        if data:
            # The rest of a line that began earlier is discarded, because it is not a current
            # reading.
            _, ended, rest = data.rpartition(b"\n")
            self._cut = bool(rest) or (self._cut and not ended)
            self._buffer = b""

    def read(self) -> list[float]:
        """Return the numbers in one reading.

        Raises
        ------
        InputError
            The reply contains no numbers, or an overload.
        LinkLost
            There is no reply in time. The next reading opens the link again.
        """
        link = self._link = self._link or self._open()
        with on_failure(self.close, LinkLost):
            if self._query:
                link.write(self._query + b"\n")
            line = self._line(link)
            if self._cut and not self._query:
                line = self._line(link)
            self._cut = False
        return numbers_in_reply(line, self.address)

    def close(self) -> None:
        """Close the link; a later reading opens it again."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _open(self) -> Link:
        self._buffer = b""
        # A serial device may be in the middle of a line, but a server begins with a new line.
        self._cut = self.address.startswith("serial:")
        return self._opener(self.address)

    def _line(self, link: Link) -> str:
        end = monotonic() + self._timeout
        while b"\n" not in self._buffer:
            left = end - monotonic()
            data = link.read(_LONGEST, left) if left > 0 else b""
            if not data and end <= monotonic():
                what = f"reply to {self._query.decode()!r}" if self._query else "line"
                raise LinkLost(
                    f"{self.address}: no {what} within {self._timeout:g} s; check the cable, the "
                    "address, --query and --timeout",
                    names=(self.address,),
                )
            self._buffer += data
            if len(self._buffer) > _LONGEST:
                raise LinkLost(
                    f"{self.address}: received {_LONGEST} bytes without an end of line; check the "
                    "baud rate",
                    names=(self.address,),
                )
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.decode("utf-8", "replace").strip()


def numbers_in_reply(reply: str, address: str) -> list[float]:
    """Return the numbers in a reply.

    Raises
    ------
    InputError
        The reply contains no number, a word that is not a unit, a non-finite number or an overload.

    Examples
    --------
    >>> numbers_in_reply("+1.25E-03,-2.0 V", "tcp://10.0.0.5:5025")
    [0.00125, -2.0]
    """
    found: list[float] = []
    for word in re.split(r"[,;\s]+", reply.strip()):
        try:
            found.append(float(word))
        except ValueError:
            if not found or not _WORD.fullmatch(word):
                found.clear()
                break
    if not found or not all(isfinite(value) and abs(value) < _OVERLOAD for value in found):
        raise InputError(
            f"{address}: {reply[:60]!r} is not a reading: expected numbers separated by commas; "
            "check the range of the instrument and --query",
            names=(address,),
        )
    return found


def read_instruments(
    instruments: Sequence[LineInstrument], columns: Sequence[str]
) -> dict[str, float]:
    """Return one reading of all instruments together, by column, in order.

    Raises
    ------
    InputError
        The number of values differs from the number of columns.
    LinkLost
        An instrument does not answer.
    """
    values = [value for one in instruments for value in one.read()]
    if len(values) != len(columns):
        addresses = ", ".join(one.address for one in instruments)
        raise InputError(
            f"{addresses}: {format_count(len(values), 'number')} in a reading, but the table has "
            f"{len(columns)} columns to read, {', '.join(columns)}; give an instrument for each, "
            "or one that reads them all",
            names=tuple(one.address for one in instruments),
        )
    return dict(zip(columns, values, strict=True))
