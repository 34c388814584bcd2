"""Reads the sensor with instruments: by SCPI, from lines that they send, or by their drivers.

An instrument over a link gives plain numbers, which must be in the unit that [sensor] states. An
instrument with a driver gives a `Reading`, whose unit is checked and converted.
"""

from collections.abc import Mapping, Sequence
from time import monotonic

from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import InputError
from inercal.basics.units import format_count, si_factor
from inercal.host.drivers.visa import numbers_in_reply
from inercal.host.equipment import INSTRUMENTS, Reading, open_instrument
from inercal.host.link import LINKS, Link, LinkLost, ReopenedLink

_LONGEST = 4096  # bytes in a reply
_MOST_PIECES = 1000  # largest number of discarded pieces; a fast device never stops


def open_sensor_instrument(address: str, query: str, timeout: float) -> "SensorInstrument":
    """Open the instrument at an address of a driver or of a link; see `LineInstrument`.

    Raises
    ------
    InputError
        The address is invalid, or `query` is not "READ?" although a driver chooses the query.
    LinkLost
        No device answers.
    """
    scheme = address.partition(":")[0].lower()
    if scheme in INSTRUMENTS:
        if query != "READ?":
            raise InputError(
                f"--query has no effect on {address!r}; state the query in the address, as in "
                "visa:GPIB0::22::INSTR?query=READ?",
                key="--query",
            )
        return DriverInstrument(address, timeout)
    if scheme not in LINKS and "::" in address:
        raise InputError(
            f"{address!r} is not an address; a VISA resource needs visa: in front of its name: "
            f"visa:{address}",
            names=(address,),
        )
    return LineInstrument(address, query, timeout)


class DriverInstrument(Closeable):
    """An instrument of `inercal.host.equipment`, which gives one reading with its unit."""

    def __init__(self, address: str, timeout: float):
        self.address, self._instrument = address, open_instrument(address, timeout)

    def identity(self) -> str:
        """Return one line that names the instrument; empty if it does not say what it is."""
        return self._instrument.identity()

    def begin(self) -> None:
        """Do nothing, because a driver never returns an earlier reading."""

    def read(self) -> list[Reading]:
        """Return the reading; for the errors, see `inercal.host.equipment`."""
        return [self._instrument.read()]

    def close(self) -> None:
        """Close the connection."""
        self._instrument.close()


class LineInstrument(ReopenedLink):
    """A measuring instrument at an address, which sends lines of numbers.

    Parameters
    ----------
    address : str
        Address of the instrument; see `open_link`.
    query : str
        Command that requests a reading; empty for a device that sends lines unasked.
    timeout : float
        Longest time for one reading, s.

    Raises
    ------
    InputError
        The address is invalid, or pyserial is not installed.
    LinkLost
        No device answers.
    """

    def __init__(self, address: str, query: str, timeout: float):
        super().__init__(address)
        self._query, self._timeout = query.encode(), timeout
        self._open()

    def identity(self) -> str:
        """Return no name, because a device that sends lines cannot be asked."""
        return ""

    def begin(self) -> None:
        """Discard earlier replies, because the next reading must be current."""
        link = self._open()
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
        ProtocolError
            The reply contains no numbers.
        InputError
            The reply means an overload.
        LinkLost
            There is no reply in time. The next reading opens the link again.
        """
        link = self._open()
        with on_failure(self.close, LinkLost):
            if self._query:
                link.write(self._query + b"\n")
            line = self._line(link)
            if self._cut and not self._query:
                line = self._line(link)
            self._cut = False
        return numbers_in_reply(line, self.address)

    def _open(self) -> Link:
        if self._link is None:
            self._buffer = b""
            # A serial device may be in the middle of a line, but a server begins with a new line.
            self._cut = self.address.startswith("serial:")
        return super()._open()

    def _line(self, link: Link) -> str:
        end = monotonic() + self._timeout
        while b"\n" not in self._buffer:
            left = end - monotonic()
            data = link.read(_LONGEST, left) if left > 0 else b""
            if not data and end <= monotonic():
                what = f"reply to {self._query.decode()!r}" if self._query else "line"
                raise LinkLost.at(
                    self.address,
                    f"no {what} within {self._timeout:g} s; check the cable, the address, --query "
                    "and --timeout",
                )
            self._buffer += data
            if len(self._buffer) > _LONGEST:
                why = f"received {_LONGEST} bytes without an end of line; check the baud rate"
                raise LinkLost.at(self.address, why)
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.decode("utf-8", "replace").strip()


SensorInstrument = LineInstrument | DriverInstrument


def read_instruments(
    instruments: Sequence[SensorInstrument], columns: Sequence[str], units: Mapping[str, str]
) -> dict[str, float]:
    """Return one reading of all instruments together in `units`, by column, in order.

    Raises
    ------
    InputError
        The number of values differs from the number of columns, a unit does not fit the unit of its
        column, or an instrument reports an overload.
    ProtocolError
        A reply is not a reading.
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
    return {
        name: _in_unit(value, name, units[name]) if isinstance(value, Reading) else value
        for name, value in zip(columns, values, strict=True)
    }


def _in_unit(reading: Reading, column: str, unit: str) -> float:
    try:
        return reading.value * (si_factor(reading.unit, unit) / si_factor(unit))
    except InputError:
        raise InputError(
            f"{column}: the instrument reads {reading.unit}, but [sensor] states {unit}; correct "
            "the unit and scale there, or the unit in the instrument's address",
            names=(column,),
        ) from None
