"""Voltmeters and counters that PyVISA reads over GPIB, USB, a network or a serial port.

    visa:GPIB0::22::INSTR                                     a voltmeter, which is sent READ?
    visa:TCPIP0::10.0.0.5::INSTR?query=MEAS:FREQ?&unit=Hz     a counter
    visa:TCPIP0::10.0.0.5::5025::SOCKET?backend=@py           a VISA library, as PyVISA names it

The text before the `?` is a VISA resource name. `setup` is sent whenever the connection is opened,
such as `setup=VOLT:DC:NPLC 100`, and the instrument is then asked for its first error. `identity`
replaces *IDN?; if it is empty, the instrument is not asked what it is. `termination` is the end of
commands and replies.

A reply contains one number, or several separated by commas, semicolons or spaces. In SCPI, 9.9E37
stands for infinity and 9.91E37 for "not a number" (HP 53131A/132A programming guide, table 3-3; HP
54620 programmer's guide, "Infinity representation"). Multimeters send both for an overload.
"""

import re
from collections.abc import Generator
from contextlib import contextmanager, suppress
from math import isfinite
from typing import Any

from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import InercalError, InputError, require_extra
from inercal.basics.units import si_factor
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.drivers.table_address import address_parameters
from inercal.host.equipment import Reading
from inercal.host.link import LinkLost

_OVERLOAD = 9e36
_WORD = re.compile(r"[A-Za-zµμΩ°/²%]*")  # a unit after a number is not a value


def numbers_in_reply(reply: str, address: str, query: str = "--query") -> list[float]:
    """Return the numbers in a reply; a message names the option `query` that requests them.

    Raises
    ------
    ProtocolError
        The reply contains no number, a word that is not a unit, or a number that is not finite.
    InputError
        The reply means an overload.

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
    if not found or not all(map(isfinite, found)):
        raise ProtocolError(
            f"{address}: {reply[:60]!r} is not a reading: expected numbers separated by commas; "
            f"check the instrument and {query}",
            names=(address,),
        )
    if any(abs(value) >= _OVERLOAD for value in found):
        raise InputError(
            f"{address}: the instrument reports an overload ({reply[:60]}); choose a larger range, "
            "or check the input",
            names=(address,),
        )
    return found


_TERMINATIONS = {"lf": "\n", "cr": "\r", "crlf": "\r\n", "none": ""}
_DEFAULTS = {
    "query": "READ?", "unit": "V", "setup": "", "identity": "*IDN?", "termination": "lf",
    "backend": "",
}  # fmt: skip


class VisaInstrument(Closeable):
    """An instrument with a VISA resource name, which answers a query with one number.

    Parameters
    ----------
    address : str
        See the module docstring.
    timeout : float
        Longest time to wait for a reply, s.

    Raises
    ------
    InputError
        The address is malformed, PyVISA or its library is not installed, or the instrument refuses
        `setup`.
    LinkLost
        The instrument does not answer.
    """

    def __init__(self, address: str, timeout: float):
        self._address, self._timeout = address, timeout
        self._options = _options(address)
        self._manager = _manager(address, self._options["backend"])
        self._session: Any = None  # a MessageBasedResource of PyVISA, which loads when it is needed
        self._identity: str | None = None
        self._open()

    def identity(self) -> str:
        """Return the reply to *IDN?; empty if the address says not to ask."""
        return self._identity or ""

    def read(self) -> Reading:
        """Request a reading; after a failure, the connection is opened again first.

        Raises
        ------
        ProtocolError
            The reply is not one number, or has another unit than the address states.
        InputError
            The reply means an overload, or another instrument answers than before.
        LinkLost
            There is no reply in time, or the instrument is gone.
        """
        session, unit = self._session or self._open(), self._options["unit"]
        # A late reply, or the rest of a wrong one, must not be the next reading.
        with on_failure(self.close, LinkLost, ProtocolError):
            reply = self._ask(session, self._options["query"])
            value, *more = numbers_in_reply(reply, self._address, "query= in the address")
            suffix = reply.lstrip("0123456789+-.eE \t").casefold()
            if more or suffix not in ("", unit.casefold(), f"{unit}dc".casefold()):
                why = f"{reply[:60]!r} is not one number in {unit}; state the unit of the readings"
                raise self._error(ProtocolError, f"{why} as unit= in the address")
        return Reading(value, unit)

    def close(self) -> None:
        """Close the connection; a later reading opens it again."""
        session, self._session = self._session, None
        if session is not None:
            with suppress(Exception):  # a lost instrument cannot be closed
                session.close()

    def _open(self) -> Any:
        """Open the connection, discard earlier replies, and ask which instrument it is."""
        name = self._address.partition("?")[0].partition(":")[2]
        milliseconds = max(1, round(1000 * self._timeout))
        end = _TERMINATIONS[self._options["termination"]]
        with on_failure(self.close):
            with self._visa_errors(""):
                session = self._manager.open_resource(name, open_timeout=milliseconds)
                self._session, session.timeout = session, milliseconds
                session.write_termination, session.read_termination = end, end or None
            with suppress(Exception):  # not every interface can clear a device
                session.clear()
            asked = self._options["identity"]
            found = " ".join(self._ask(session, asked).split()) if asked else ""
            if self._identity not in (None, found):
                why = f"{found!r} answers instead of {self._identity!r}; check the address"
                raise self._error(InputError, why)
            self._identity = found
            if commands := self._options["setup"]:
                with self._visa_errors(commands):
                    session.write(f"*CLS;{commands}")
                error = self._ask(session, "SYST:ERR?")
                if not error.lstrip("+").startswith("0"):
                    why = f"the instrument refuses setup={commands}: {error[:80]}; correct it"
                    raise self._error(InputError, why)
        return session

    def _ask(self, session: Any, command: str) -> str:
        with self._visa_errors(command):
            session.write(command)
            if not (reply := session.read_raw()):
                raise EOFError(f"an empty reply to {command!r}")
            return reply.decode("ascii", "replace").strip()

    @contextmanager
    def _visa_errors(self, command: str) -> Generator[None]:
        """Raise a `LinkLost` instead of the errors of a VISA library, which may be of any class."""
        try:
            yield
        except Exception as error:
            text = str(error) or type(error).__name__
            what = f"no connection: {text}; check the address, the cable and the power"
            if getattr(error, "abbreviation", "") == "VI_ERROR_TMO" and command:
                what = f"no reply to {command!r} within {self._timeout:g} s; check the cable, the "
                what += "timeout, and query=, identity= and termination= in the address"
            raise self._error(LinkLost, what) from error

    def _error(self, kind: type[InercalError], text: str) -> InercalError:
        return kind(f"{self._address}: {text}", names=(self._address,))


def _options(address: str) -> dict[str, str]:
    """Return the parameters of an address, with defaults for those that it does not state."""
    given = address_parameters(address)
    for key in given.keys() - _DEFAULTS:
        possible = f"there are {', '.join(_DEFAULTS)}"
        raise InputError(f"unknown parameter {key!r} in {address!r}; {possible}", key=key)
    options = _DEFAULTS | given
    if (end := options["termination"]) not in _TERMINATIONS:
        possible = f"possible: {', '.join(_TERMINATIONS)}"
        raise InputError(f"termination={end!r} in {address!r}; {possible}", key="termination")
    si_factor(options["unit"])
    return options


def _manager(address: str, backend: str) -> Any:
    """Return the resource manager of a VISA library, such as "@py"; empty for the usual one."""
    what = "VISA instruments need pyvisa and pyvisa-py; install the extra"
    with require_extra("visa", what, ("pyvisa",)):
        from pyvisa import ResourceManager
    try:
        return ResourceManager(backend)
    except Exception as error:  # of any class; the text may contain a traceback
        lines = str(error).replace("\\n", "\n").replace("\\'", "'")
        *_, text = re.findall(r"\w[^\n]*[\w']", lines) or ["unknown reason"]
        raise InputError(
            f"{address!r}: the VISA library cannot be used: {text}; state a library "
            "as backend= in the address, such as @py, which is part of inercal[visa]",
            key="backend",
        ) from error
