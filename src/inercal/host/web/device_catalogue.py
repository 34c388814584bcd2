"""Lists the devices that a request may choose, and the results of probing them.

A request cannot contain a path. A port is chosen by its number in the list. A typed address must be
a network address, and the packets from it must match a preset.
"""

import re
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from inercal.basics.errors import InercalError, InputError
from inercal.host import devices
from inercal.host.devices import SerialPort, imu_lines, list_serial_ports, table_lines
from inercal.host.drivers.table_address import DRIVERS
from inercal.host.packets import PRESETS
from inercal.host.tasks import host_plan
from inercal.host.web.folders import Plan
from inercal.host.web.json_objects import JsonObject, object_or_none
from inercal.runfile import read

SIMULATED, CONFIGURED = "simulated", "given"
_HOST = r"(?:[a-z0-9_.-]{1,253}|\[[0-9a-f:.]{2,45}\]):[0-9]{1,5}"
_OPTIONS = r"(?:\?[a-z]+=[0-9.,+-]+(?:&[a-z]+=[0-9.,+-]+)*)?"
_TABLE = re.compile(rf"[a-z]\w*:(?:tcp:)?//{_HOST}/?{_OPTIONS}", re.ASCII | re.IGNORECASE)
_IMU = re.compile(rf"tcp://{_HOST}/?", re.ASCII | re.IGNORECASE)
_MAX_TEXT = 300
_BAUD_RANGE = (1, 12_000_000)
_TABLE_BAUD, _IMU_BAUD = 9600, 115200


class ChosenDevices(NamedTuple):
    """Addresses of table and IMU; for a simulated bench, `simulated` is the packet preset."""

    table: str
    imu: str
    clock: str = ""
    simulated: str | None = None


class DeviceCatalogue:
    """The devices from which a request can choose.

    Parameters
    ----------
    table, imu, clock : str
        Addresses that were stated when the server was started; empty if not stated.
    """

    def __init__(self, table: str = "", imu: str = "", clock: str = ""):
        self._table, self._imu, self._clock = table, imu, clock
        self._ports: dict[str, SerialPort] = {}
        self._numbers: dict[str, str] = {}

    def refresh(self) -> None:
        """Update the list of serial ports.

        The number of a port does not change, so a choice from an older list still means the same
        port.
        """
        try:
            found = list(list_serial_ports())
        except InputError:  # without pyserial, there are no ports
            found = []
        for port in found:
            self._numbers.setdefault(port.address, f"port-{len(self._numbers)}")
        self._ports = {self._numbers[port.address]: port for port in found}

    def tables(self) -> list[dict[str, str]]:
        """Return the tables, each with `id` and a description `what`."""
        motors = ((name, f"motor on {_port_text(port)}") for name, port in self._ports.items())
        return _device_list(self._table, motors)

    def imus(self) -> list[dict[str, str]]:
        """Return the IMUs, each with `id` and a description `what`."""
        return _device_list(
            self._imu, ((name, _port_text(port)) for name, port in self._ports.items())
        )

    def chosen(self, table: object, imu: object) -> ChosenDevices:
        """Return the devices that a request chooses.

        Raises
        ------
        InputError
            The request chooses a device that is not available.
        """
        simulated = [_is_simulated(one) for one in (table, imu)]
        if all(simulated):
            return ChosenDevices("", "", "", _preset_name(_require_object(imu, "IMU")) or "fixed")
        if any(simulated):
            raise InputError(
                "one device is simulated and one is real; choose table and IMU both simulated or "
                "both real",
                names=("table", "IMU"),
            )
        clock = (
            self._clock if _text_value(table, "id") == _text_value(imu, "id") == CONFIGURED else ""
        )
        return ChosenDevices(self.table(table), self.imu(imu), clock)

    def table(self, asked: object) -> str:
        """Return the address of the table that a request chooses; for errors, see `chosen`."""
        of = _require_object(asked, "table")
        if (address := _text_value(of, "address")) is not None:
            if not _TABLE.fullmatch(address) or address.partition(":")[0].lower() not in DRIVERS:
                raise InputError(
                    f"{address!r} is not a table on the network; possible: "
                    "pmac://HOST:1025?motors=1,2,3&counts=3600000, acutrol://HOST:PORT?axes=1,2,3 "
                    "or motor:tcp://HOST:PORT",
                    key="address",
                )
            return address
        if of.get("id") == CONFIGURED and self._table:
            return self._table
        port = self._port(of, "table")
        return f"motor:{port.address}?baud={_baud(of, _TABLE_BAUD)}"

    def imu(self, asked: object, *, preset_needed: bool = True) -> str:
        """Return the address of the IMU that a request chooses; for errors, see `chosen`."""
        of = _require_object(asked, "IMU")
        given = _text_value(of, "address")
        if given is None and of.get("id") == CONFIGURED and self._imu:
            return self._imu
        if given is None:
            link = f"{self._port(of, 'IMU').address}?baud={_baud(of, _IMU_BAUD)}"
            preset = _preset_name(of)
        else:
            link, _, query = given.partition("?")
            if not _IMU.fullmatch(link):
                raise InputError(
                    f"{given!r} is not an IMU on the network; possible: "
                    "tcp://HOST:PORT?preset=NAME",
                    key="address",
                )
            key, _, named = query.partition("=")
            if query and key != "preset":
                raise InputError(
                    f"{given!r}: only preset=NAME may follow the '?', not {key!r}", key="address"
                )
            preset = _preset_name({"preset": named} if query else of)
        if preset is None:
            if preset_needed:
                raise InputError(
                    f"the packet format of the IMU is missing; choose preset: {', '.join(PRESETS)}",
                    key="preset",
                )
            return link
        return f"{link}{'&' if '?' in link else '?'}preset={preset}"

    def _port(self, of: JsonObject, what: str) -> SerialPort:
        name = of.get("id")
        port = self._ports.get(name) if isinstance(name, str) else None
        if port is None:
            raise InputError(
                f"this server has no {what} {name!r}; reload the page and choose from its list",
                key="id",
            )
        return port


def probe_devices(choice: DeviceCatalogue, plan: Plan | None, asked: JsonObject) -> dict[str, Any]:
    """Probe table and IMU; return lines with the results, and whether each could be probed.

    The devices do not move.
    """
    bench = None
    if plan is not None and not plan.summary["trouble"]:
        bench = host_plan(read(plan.path)).bench  # a plan for another kind of bench has `trouble`

    def table() -> list[str]:
        return table_lines(devices.probe_table(choice.table(asked.get("table")), bench))

    def imu() -> list[str]:
        return imu_lines(devices.probe_imu(choice.imu(asked.get("imu"), preset_needed=False)))

    return {
        what: _probe_result(asked.get(what), lines)
        for what, lines in (("table", table), ("imu", imu))
    }


def _probe_result(asked: object, lines: Callable[[], list[str]]) -> dict[str, Any]:
    try:
        if _is_simulated(asked):
            return {"ok": True, "lines": ["simulated: made when the run starts"]}
        return {"ok": True, "lines": lines()}
    except InercalError as error:
        return {"ok": False, "lines": [str(error)]}


def _device_list(given: str, others: Iterable[tuple[str, str]]) -> list[dict[str, str]]:
    result = [{"id": SIMULATED, "what": "simulated bench"}]
    if given:
        result.append({"id": CONFIGURED, "what": given})
    return result + [{"id": name, "what": what} for name, what in others]


def _port_text(port: SerialPort) -> str:
    return f"{port.address} ({port.description})" if port.description else port.address


def _require_object(asked: object, what: str) -> JsonObject:
    result = object_or_none(asked)
    if result is None:
        raise InputError(
            f"no {what} is chosen; choose one from the list or give its address", key=what
        )
    return result


def _text_value(asked: object, key: str) -> str | None:
    value = (object_or_none(asked) or {}).get(key)
    if value is not None and not (isinstance(value, str) and len(value) <= _MAX_TEXT):
        raise InputError(
            f"{key} {str(value)[:40]!r} is not possible; give a text of at most {_MAX_TEXT} "
            "characters",
            key=key,
        )
    return value


def _is_simulated(asked: object) -> bool:
    return _text_value(asked, "address") is None and _text_value(asked, "id") == SIMULATED


def _preset_name(of: JsonObject) -> str | None:
    name = _text_value(of, "preset")
    if not name:
        return None
    if name not in PRESETS:
        raise InputError(f"no preset {name!r}; possible: {', '.join(PRESETS)}", key="preset")
    return name


def _baud(of: JsonObject, usual: int) -> int:
    value = of.get("baud", usual)
    low, high = _BAUD_RANGE
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise InputError(
            f"baud rate {value!r} is not possible; give a whole number from {low} to {high}",
            key="baud",
        )
    return value
