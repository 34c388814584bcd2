"""Driver for temperature chambers that are controlled by lines of text, such as SCPI over TCP.

The commands are data, one `ChamberDialect` for each kind of controller. All temperatures in the
lines are in °C.

**f4t**, the SCPI commands of the Watlow F4T on port 5025. The lines are listed in the manuals of
TestEquity (F4T Controller, chapter "Communications"; 101H, chapter 6) and of Watlow (F4T Setup and
Operations, chapter 6). These commands have no reply, so a query follows each of them. They neither
switch the control loop off nor return its limits. The address must therefore state the limits, and
the event output with which the maker of the chamber switches it on:
`scpi-chamber://10.0.0.7?output=1&low=-40&high=130`. If the maker has assigned event outputs to the
door and to the alarms, `&door=8&alarm=7` names them.

Not verified on hardware: that lines end with LF, that the controller answers the last of several
lines that arrive at once, that it replies to nothing else, and that such an output is on while the
door is open, or while there is an alarm.
"""

import re
from collections.abc import Callable, Mapping
from math import isfinite, nan
from string import Formatter
from typing import NamedTuple

from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.host.drivers.rotary_table import ProtocolError, stop_with_retry
from inercal.host.drivers.table_address import TableAddress
from inercal.host.drivers.text_dialogue import TextDialogue
from inercal.host.equipment import ChamberState
from inercal.host.link import Link, open_link

_NUMBER = r"[+-]?\d{1,6}(?:\.\d{0,9})?(?:[Ee][+-]?\d{1,2})?"


class Exchange(NamedTuple):
    """Text that is sent, and the pattern of its only reply; `value` names the number in it."""

    text: str
    reply: str


class Flag(NamedTuple):
    """A query with two possible replies: one if all is well, and one if not.

    It is only used if the address has all the parameters in the query.
    """

    query: str
    good: str
    bad: str


class ChamberDialect(NamedTuple):
    """The commands of a kind of controller.

    In each text, the parameters of the address are filled in, and `{celsius}` is the set point.

    Parameters
    ----------
    port : int
        Default TCP port.
    ending : str
        End of each line and reply, one character.
    required, optional : mapping of str to int
        Largest numbers of the address's parameters, in addition to `low` and `high`.
    begin : Exchange
        Sent after the connection is opened.
    temperature : Exchange
        Query of the air temperature.
    go, stop : Exchange
        Commands that go to a set point, and that end heating and cooling.
    alarms : mapping of str to Flag
        Queries of alarms, by the text of the alarm.
    door : Flag
        Query of the door.
    sensor_alarm : str
        Alarm during which the temperature has no meaning.
    """

    port: int
    ending: str
    required: Mapping[str, int]
    optional: Mapping[str, int]
    begin: Exchange
    temperature: Exchange
    go: Exchange
    stop: Exchange
    alarms: Mapping[str, Flag]
    door: Flag
    sensor_alarm: str = "sensor failure"


DIALECTS = {
    "f4t": ChamberDialect(
        port=5025,
        ending="\n",
        required={"output": 8},
        optional={"door": 8, "alarm": 8},
        begin=Exchange(":UNIT:TEMPERATURE C\n:UNIT:TEMPERATURE?", "C"),
        temperature=Exchange(":SOURCE:CLOOP1:PVALUE?", f"(?P<value>{_NUMBER})"),
        go=Exchange(
            ":SOURCE:CLOOP1:SPOINT {celsius:.3f}\n:OUTPUT{output}:STATE ON\n:OUTPUT{output}:STATE?",
            "ON",
        ),
        stop=Exchange(":OUTPUT{output}:STATE OFF\n:OUTPUT{output}:STATE?", "OFF"),
        alarms={
            "sensor failure": Flag(":SOURCE:CLOOP1:ERROR?", "NONE", "ERROR"),
            "chamber alarm": Flag(":OUTPUT{alarm}:STATE?", "OFF", "ON"),
        },
        door=Flag(":OUTPUT{door}:STATE?", "OFF", "ON"),
    ),
}


class ScpiChamber(Closeable):
    """A `Chamber` that is controlled by lines of text.

    Parameters
    ----------
    link : str
        Address of the link, such as `tcp://10.0.0.7:5025`.
    dialect : ChamberDialect
    low, high : float
        Lowest and highest set point, K.
    parameters : mapping of str to str
        Values of the dialect's parameters.
    timeout : float
        Longest time to wait for a reply, s.
    opener : callable
        Function that opens a link to an address; tests replace it.
    """

    def __init__(
        self,
        link: str,
        dialect: ChamberDialect,
        low: float,
        high: float,
        parameters: Mapping[str, str],
        timeout: float = 1.0,
        opener: Callable[[str], Link] = open_link,
    ):
        self._dialect, self._parameters = dialect, dict(parameters)
        self.low, self.high = low, high
        self._dialogue = TextDialogue(link, dialect.ending.encode(), timeout, opener)
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
        alarms = tuple(text for text, flag in self._dialect.alarms.items() if self._is_bad(flag))
        door = self._is_bad(self._dialect.door)
        if self._dialect.sensor_alarm in alarms:
            return ChamberState(nan, door, alarms)
        value = float(self._ask(self._dialect.temperature)["value"])
        return ChamberState(value + ZERO_CELSIUS, door, alarms)

    def stop(self) -> None:
        """See `Chamber.stop`; the command is sent even if an earlier reply is missing."""
        stop_with_retry(lambda: self._ask(self._dialect.stop, urgent=True))

    def close(self) -> None:
        """Close the connection; the chamber continues."""
        self._dialogue.close()

    def _is_bad(self, flag: Flag) -> bool | None:
        """Return whether a flag is bad; None if the address has no parameter for its query."""
        if not all(key in self._parameters for _, key, *_ in Formatter().parse(flag.query) if key):
            return None
        said = self._ask(Exchange(flag.query, f"(?P<word>{flag.good}|{flag.bad})"))["word"]
        return re.fullmatch(flag.good, said) is None

    def _ask(self, exchange: Exchange, *, urgent: bool = False, **values: float) -> re.Match[str]:
        """Send text, and return its reply; raises `ProtocolError` if it is not as expected."""
        text = exchange.text.format(**self._parameters, **values)
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
    example = "scpi-chamber://HOST?output=1&low=-40&high=130"
    name = TableAddress(address, example).take("dialect", "dialect=f4t", "f4t")
    if (dialect := DIALECTS.get(name)) is None:
        raise InputError(f"no dialect {name!r} in {address!r}; possible: {', '.join(DIALECTS)}")
    at = TableAddress(address, example, dialect.port)
    at.take("dialect", "dialect=f4t", name)
    low, high = (_kelvin(at, key, example) for key, example in (("low", "-40"), ("high", "130")))
    if not low < high:
        raise InputError(f"low is not below high in {address!r}; give both in °C: {example}")
    parameters = {key: at.take(key, f"{key}=1") for key in dialect.required}
    parameters |= {key: text for key in dialect.optional if (text := at.take(key, "", ""))}
    for key, text in parameters.items():
        most = {**dialect.required, **dialect.optional}[key]
        if not (re.fullmatch("[1-9][0-9]?", text) and int(text) <= most):
            raise InputError(f"{key}={text!r} in {address!r}; possible: 1 to {most}", key=key)
    return ScpiChamber(at.link(), dialect, low, high, parameters, timeout)


def _kelvin(address: TableAddress, key: str, example: str) -> float:
    """Return a temperature in °C from an address, in K."""
    text = address.take(key, f"{key}={example}")
    try:
        value = float(text) + ZERO_CELSIUS
    except ValueError:
        value = nan
    if not (isfinite(value) and value > 0):
        raise InputError(f"{key}={text!r} in {str(address)!r}; give °C: {key}={example}", key=key)
    return value
