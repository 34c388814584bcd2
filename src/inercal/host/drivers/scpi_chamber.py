"""Driver for temperature chambers that are controlled by lines of text, such as SCPI over TCP.

The commands are data, one `ChamberDialect` for each kind of controller. All temperatures in the
lines are in °C.

**f4t**, the SCPI commands of the Watlow F4T on port 5025. The manuals of TestEquity (F4T
Controller, chapter "Communications"; 101H, chapter 6) list the commands for the unit and the
control loop. The commands for outputs are in the Watlow manual 1680-2414, pages 226 and 227; we
know them only from programs that cite these pages. A command has no reply, so a query follows it.
No command switches the control loop off or returns its limits. The address must therefore state the
limits, and the event output with which the maker of the chamber switches it on:
`scpi-chamber://10.0.0.7?output=1&low=-40&high=130`. If the maker has assigned event outputs to the
door and to the alarms, `&door=8&alarm=7` names them.

Not verified on hardware: that lines end with LF, that the controller answers the last of several
lines that arrive at once, that it replies to nothing else, and that such an output is on while the
door is open, or while there is an alarm.
"""

import re
from collections.abc import Mapping
from contextlib import suppress
from math import isfinite, nan
from typing import NamedTuple

from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.host.drivers.rotary_table import ProtocolError, stop_with_retry
from inercal.host.drivers.table_address import TableAddress, address_parameters
from inercal.host.drivers.text_dialogue import TextDialogue
from inercal.host.equipment import ChamberState

_NUMBER = r"[+-]?\d{1,6}(?:\.\d{0,9})?(?:[Ee][+-]?\d{1,2})?"
_MOST = 64  # largest number of an output


class Exchange(NamedTuple):
    """Text that is sent, and the pattern of its only reply.

    The parameters of the address are filled in, and `{celsius}` is the set point. In the pattern,
    the group `value` is a number, and the group `bad` is the word for an alarm or an open door.
    """

    text: str
    reply: str


class ChamberDialect(NamedTuple):
    """The commands of a kind of controller.

    Parameters
    ----------
    port : int
        Default TCP port.
    ending : str
        End of each line and reply, one character.
    parameters : mapping of str to bool
        Parameters of the address in addition to `low` and `high`, which are numbers from 1, and
        whether they are required. A query of the door or of an alarm is only used if the address
        has its parameter.
    begin : Exchange
        Sent after the connection is opened, and before other requests.
    temperature : Exchange
        Query of the air temperature.
    go, stop : Exchange
        Commands that go to a set point, and that end heating and cooling.
    door : Exchange
        Query of the door.
    alarms : mapping of str to Exchange
        Queries of alarms, by the text of the alarm. During a "sensor failure", the temperature has
        no meaning.
    """

    port: int
    ending: str
    parameters: Mapping[str, bool]
    begin: Exchange
    temperature: Exchange
    go: Exchange
    stop: Exchange
    door: Exchange
    alarms: Mapping[str, Exchange]


_SWITCH = "\n:OUTPUT{output}:STATE ON\n:OUTPUT{output}:STATE?"
DIALECTS = {
    "f4t": ChamberDialect(
        port=5025,
        ending="\n",
        parameters={"output": True, "door": False, "alarm": False},
        begin=Exchange(":UNIT:TEMPERATURE C\n:UNIT:TEMPERATURE?", "C"),
        temperature=Exchange(":SOURCE:CLOOP1:PVALUE?", f"(?P<value>{_NUMBER})"),
        go=Exchange(":SOURCE:CLOOP1:SPOINT {celsius:.3f}" + _SWITCH, "ON"),
        stop=Exchange(":OUTPUT{output}:STATE OFF\n:OUTPUT{output}:STATE?", "OFF"),
        door=Exchange(":OUTPUT{door}:STATE?", "OFF|(?P<bad>ON)"),
        alarms={
            "sensor failure": Exchange(":SOURCE:CLOOP1:ERROR?", "NONE|(?P<bad>ERROR)"),
            "chamber alarm": Exchange(":OUTPUT{alarm}:STATE?", "OFF|(?P<bad>ON)"),
        },
    ),
}


class ScpiChamber(Closeable):
    """A `Chamber` that is controlled by lines of text.

    Parameters
    ----------
    link : str
        Address of the link, such as `tcp://10.0.0.7:5025`.
    dialect : ChamberDialect
    given : mapping of str to float
        Values of the dialect's parameters, and the lowest and highest set point `low` and `high`,
        °C.
    timeout : float
        Longest time to wait for a reply, s.
    """

    def __init__(
        self, link: str, dialect: ChamberDialect, given: Mapping[str, float], timeout: float
    ):
        self._dialect, self._given = dialect, given
        self.low, self.high = given["low"] + ZERO_CELSIUS, given["high"] + ZERO_CELSIUS
        self._dialogue = TextDialogue(link, dialect.ending.encode(), timeout)
        with on_failure(self.close):
            self._ask(dialect.begin)

    def set_temperature(self, temperature: float) -> None:
        """See `Chamber.set_temperature`."""
        require_reachable(self._dialogue.address, temperature, self.low, self.high)
        # Another program may have changed the unit meanwhile.
        self._ask(self._dialect.begin)
        self._ask(self._dialect.go, celsius=temperature - ZERO_CELSIUS)

    def read(self) -> ChamberState:
        """See `Chamber.read`."""
        self._ask(self._dialect.begin)
        alarms = tuple(text for text, query in self._dialect.alarms.items() if self._is_bad(query))
        value = nan
        if "sensor failure" not in alarms:
            value = float(self._ask(self._dialect.temperature)["value"]) + ZERO_CELSIUS
        return ChamberState(value, self._is_bad(self._dialect.door), alarms)

    def stop(self) -> None:
        """See `Chamber.stop`; the command is sent even if an earlier reply is missing."""
        stop_with_retry(lambda: self._ask(self._dialect.stop, urgent=True))

    def close(self) -> None:
        """Close the connection; the chamber continues."""
        self._dialogue.close()

    def _is_bad(self, query: Exchange) -> bool | None:
        """Return whether a reply is bad; None if the address lacks a parameter of the query."""
        with suppress(KeyError):
            return self._ask(query)["bad"] is not None
        return None

    def _ask(self, exchange: Exchange, *, urgent: bool = False, **values: float) -> re.Match[str]:
        """Send text, and return its reply; raises `ProtocolError` if it is not as expected."""
        text = exchange.text.format(**self._given, **values)
        text = text.replace("\n", self._dialect.ending) + self._dialect.ending
        reply = self._dialogue.ask(text.encode(), urgent=urgent)
        if not (found := re.fullmatch(exchange.reply, reply, re.ASCII)):
            raise ProtocolError(
                f"{self._dialogue.address}: the chamber replied {reply[:60]!r} to {text.strip()!r}"
                "; check the dialect in the address, and that the controller is in remote mode"
            )
        return found


def require_reachable(address: str, temperature: float, low: float, high: float) -> None:
    """Raise an `InputError` unless a temperature is within limits; all are in K."""
    if not low <= temperature <= high:
        raise InputError(
            f"{address}: the chamber cannot go to {temperature - ZERO_CELSIUS:.6g} °C; possible: "
            f"{low - ZERO_CELSIUS:.6g} to {high - ZERO_CELSIUS:.6g} °C",
            key="temperature",
            names=(address,),
        )


def open_scpi_chamber(address: str, timeout: float) -> ScpiChamber:
    """Open the chamber at an address; see the module docstring and `open_chamber`."""
    name = address_parameters(address).get("dialect", "f4t")
    if (dialect := DIALECTS.get(name)) is None:
        raise InputError(f"no dialect {name!r} in {address!r}; possible: {', '.join(DIALECTS)}")
    at = TableAddress(address, "scpi-chamber://HOST?output=1&low=-40&high=130", dialect.port)
    at.take("dialect", "", name)
    given = {key: _celsius(at, key, example) for key, example in (("low", -40), ("high", 130))}
    for key, is_required in dialect.parameters.items():
        if number := at.number(key, _MOST, None if is_required else 0):
            given[key] = number
    return ScpiChamber(at.link(), dialect, given, timeout)


def _celsius(address: TableAddress, key: str, example: int) -> float:
    text = address.take(key, f"{key}={example}")
    with suppress(ValueError):
        if isfinite(value := float(text)):
            return value
    raise InputError(f"{key}={text!r} in {str(address)!r}; give °C: {key}={example}", key=key)
