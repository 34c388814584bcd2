"""Which table and which IMU: what there is to choose from, and what a request may choose.

Nothing of a request is a path. A port is named by its number in the list that was given; an address
that somebody writes is one of the network, and its packets are of a preset.
"""

import re
from collections.abc import Iterable
from typing import NamedTuple

from inercal.errors import InputError
from inercal.host.devices import Port, ports
from inercal.host.packets import PRESETS
from inercal.host.web.requests import Asked, as_object

SIMULATED, GIVEN = "simulated", "given"
_HOST = r"(?:[a-z0-9_.-]{1,253}|\[[0-9a-f:.]{2,45}\]):[0-9]{1,5}"
_OPTIONS = r"(?:\?[a-z]+=[0-9.,+-]+(?:&[a-z]+=[0-9.,+-]+)*)?"
_TABLE = re.compile(rf"(?:pmac|acutrol|motor:tcp)://{_HOST}/?{_OPTIONS}", re.ASCII | re.IGNORECASE)
_IMU = re.compile(rf"tcp://{_HOST}/?", re.ASCII | re.IGNORECASE)
_LONGEST = 300
_BAUDS = (1, 12_000_000)
_TABLE_BAUD, _IMU_BAUD = 9600, 115200


class Chosen(NamedTuple):
    """Where table and IMU are; `simulated` is the preset of a bench that is to be simulated."""

    table: str
    imu: str
    clock: str = ""
    simulated: str | None = None


class Choice:
    """What there is to choose from.

    Parameters
    ----------
    table, imu, clock : str
        Addresses that were given when the server was started; empty where none was.
    """

    def __init__(self, table: str = "", imu: str = "", clock: str = ""):
        self._table, self._imu, self._clock = table, imu, clock
        self._ports: dict[str, Port] = {}
        self._numbers: dict[str, str] = {}

    def look(self) -> None:
        """Look which ports there are.

        A port keeps its number: who chose from an older list means the port that it named.
        """
        try:
            found = list(ports())
        except InputError:  # pyserial is not installed: there are none
            found = []
        for port in found:
            self._numbers.setdefault(port.address, f"port-{len(self._numbers)}")
        self._ports = {self._numbers[port.address]: port for port in found}

    def tables(self) -> list[dict[str, str]]:
        """Return the tables: `id` and `what`, in words."""
        motors = ((name, f"motor on {_words(port)}") for name, port in self._ports.items())
        return _shown(self._table, motors)

    def imus(self) -> list[dict[str, str]]:
        """Return the IMUs."""
        return _shown(self._imu, ((name, _words(port)) for name, port in self._ports.items()))

    def chosen(self, table: object, imu: object) -> Chosen:
        """Return what a request chooses.

        Raises
        ------
        InputError
            Something that is not there to be chosen.
        """
        simulated = [_is_simulated(one) for one in (table, imu)]
        if all(simulated):
            return Chosen("", "", "", _preset(_mapping(imu, "IMU")) or "fixed")
        if any(simulated):
            raise InputError("a simulated table and a simulated IMU go together")
        clock = self._clock if _asks(table, "id") == _asks(imu, "id") == GIVEN else ""
        return Chosen(self.table(table), self.imu(imu), clock)

    def table(self, asked: object) -> str:
        """Return the address of the table that a request chooses; raises as `chosen`."""
        of = _mapping(asked, "table")
        if (address := _asks(of, "address")) is not None:
            if not _TABLE.fullmatch(address):
                raise InputError(
                    f"{address!r} is no table on the network; possible: "
                    "pmac://HOST:1025?motors=1,2,3&counts=3600000, acutrol://HOST:PORT?axes=1,2,3 "
                    "or motor:tcp://HOST:PORT"
                )
            return address
        if of.get("id") == GIVEN and self._table:
            return self._table
        port = self._port(of, "table")
        return f"motor:{port.address}?baud={_baud(of, _TABLE_BAUD)}"

    def imu(self, asked: object, *, preset_needed: bool = True) -> str:
        """Return the address of the IMU that a request chooses; raises as `chosen`."""
        of = _mapping(asked, "IMU")
        given = _asks(of, "address")
        if given is None and of.get("id") == GIVEN and self._imu:
            return self._imu
        if given is None:
            link = f"{self._port(of, 'IMU').address}?baud={_baud(of, _IMU_BAUD)}"
            preset = _preset(of)
        else:
            link, _, query = given.partition("?")
            if not _IMU.fullmatch(link):
                raise InputError(
                    f"{given!r} is no IMU on the network; possible: tcp://HOST:PORT?preset=NAME"
                )
            key, _, named = query.partition("=")
            if query and key != "preset":
                raise InputError(f"{given!r}: behind the ? stands preset=NAME and nothing else")
            preset = _preset({"preset": named} if query else of)
        if preset is None:
            if preset_needed:
                raise InputError(f"say what the IMU sends: preset is one of {', '.join(PRESETS)}")
            return link
        return f"{link}{'&' if '?' in link else '?'}preset={preset}"

    def _port(self, of: Asked, what: str) -> Port:
        name = of.get("id")
        port = self._ports.get(name) if isinstance(name, str) else None
        if port is None:
            raise InputError(f"no {what} {name!r} here; look at the list again")
        return port


def _shown(given: str, others: Iterable[tuple[str, str]]) -> list[dict[str, str]]:
    made = [{"id": SIMULATED, "what": "simulated bench"}]
    if given:
        made.append({"id": GIVEN, "what": given})
    return made + [{"id": name, "what": what} for name, what in others]


def _words(port: Port) -> str:
    return f"{port.address} ({port.what})" if port.what else port.address


def _mapping(asked: object, what: str) -> Asked:
    made = as_object(asked)
    if made is None:
        raise InputError(f"choose a {what}")
    return made


def _asks(asked: object, key: str) -> str | None:
    value = (as_object(asked) or {}).get(key)
    if value is not None and not (isinstance(value, str) and len(value) <= _LONGEST):
        raise InputError(f"{key}: no text of up to {_LONGEST} characters")
    return value


def _is_simulated(asked: object) -> bool:
    return _asks(asked, "address") is None and _asks(asked, "id") == SIMULATED


def _preset(of: Asked) -> str | None:
    name = _asks(of, "preset")
    if not name:
        return None
    if name not in PRESETS:
        raise InputError(f"no preset {name!r}; possible: {', '.join(PRESETS)}")
    return name


def _baud(of: Asked, usual: int) -> int:
    value = of.get("baud", usual)
    low, high = _BAUDS
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise InputError(f"baud {value!r}; give a whole number from {low} to {high}")
    return value
