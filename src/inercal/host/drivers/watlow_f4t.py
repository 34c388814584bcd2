"""Driver for chambers with a Watlow F4T controller, by Modbus TCP.

Numbers are in the controller's unit, °C or °F, as IEEE floats of two holding registers, of which
the first contains the low word. The registers of control loop 1 are:

    2774, 2776   low and high limit of the set point
    2782         set point
    2730         control mode: off (62), automatic (10)
    2820         process value
    6730         unit for Ethernet: °F (30), °C (15)
    1356 + 100 (n − 1)   state of alarm n; startup (88), none (61) and blocked (12) are no alarms
    16594, …     profile event n: off (62), on (63)

Sources: the TestEquity F4T Controller manual, page 46 (set point, events, order of the words), and
the library ChamberConnectLibrary of ESPEC North America, file watlowf4t.py (all others). Nothing
was tried on hardware. In particular, it is assumed that a failed sensor shows as an alarm or as a
process value that is not finite, and that no profile is running. The data map of the controller
must be "F4T"; with "F4 compatibility", the registers have other meanings.
"""

import logging
from collections.abc import Callable
from math import isfinite, nan
from typing import Any
from urllib.parse import urlsplit

from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import require_extra
from inercal.basics.units import ZERO_CELSIUS
from inercal.host.drivers.rotary_table import ProtocolError, stop_with_retry
from inercal.host.drivers.scpi_chamber import require_reachable
from inercal.host.drivers.table_address import TableAddress
from inercal.host.equipment import ChamberState
from inercal.host.link import CONNECT_TIMEOUT, LinkLost, connect_socket, host_and_port

LOW_LIMIT, HIGH_LIMIT, SET_POINT, MODE, TEMPERATURE = 2774, 2776, 2782, 2730, 2820
UNIT, ALARM, ALARM_STEP = 6730, 1356, 100
EVENTS = (16594, 16596, 16598, 16600, 16822, 16824, 16826, 16828)
OFF, ON, AUTOMATIC, FAHRENHEIT, CELSIUS = 62, 63, 10, 30, 15
NO_ALARM = (88, 61, 12)
_MOST_ALARMS = 14
_CHECK_DATA_MAP = "check that its data map is F4T, and the numbers in the address"


class WatlowF4t(Closeable):
    """A `Chamber` with a Watlow F4T controller.

    Parameters
    ----------
    address : str
        Address of the controller, `tcp://HOST:PORT`.
    timeout : float
        Longest time to wait for a reply, s.
    event : int
        Number of the profile event that switches the chamber on; 0 if there is none.
    door : int
        Number of the profile event that is on while the door is open; 0 if there is none.
    alarms : int
        Number of alarms that the controller has.

    Raises
    ------
    MissingExtra
        pymodbus is not installed.
    LinkLost, ProtocolError
        Nothing answers, or the device is not an F4T.
    """

    def __init__(
        self, address: str, timeout: float = 1.0, event: int = 0, door: int = 0, alarms: int = 6
    ):
        with require_extra("chamber", "a Watlow F4T needs pymodbus; install it", ("pymodbus",)):
            from pymodbus.client import ModbusTcpClient
        # Errors are raised; without a handler, they would also be printed.
        logging.getLogger("pymodbus").addHandler(logging.NullHandler())
        place = host_and_port(urlsplit(address))
        assert place is not None
        self.address, self._place = address, place
        self._event, self._door, self._alarms = event, door, alarms
        self._client = ModbusTcpClient(place[0], port=place[1], timeout=timeout, retries=0)
        with on_failure(self.close):
            self.low, self.high = self._read_kelvin(LOW_LIMIT), self._read_kelvin(HIGH_LIMIT)

    def set_temperature(self, temperature: float) -> None:
        """See `Chamber.set_temperature`."""
        require_reachable(self.address, temperature, self.low, self.high)
        celsius = temperature - ZERO_CELSIUS
        value = 1.8 * celsius + 32 if self._is_fahrenheit() else celsius
        words = self._client.convert_to_registers(value, self._client.DATATYPE.FLOAT32, "little")
        self._request(self._client.write_registers, SET_POINT, values=words)
        self._write(MODE, AUTOMATIC)
        if self._event:
            self._write(EVENTS[self._event - 1], ON)

    def read(self) -> ChamberState:
        """See `Chamber.read`."""
        states = [self._read(ALARM + ALARM_STEP * n) for n in range(self._alarms)]
        alarms = [f"alarm {n} (state {s})" for n, s in enumerate(states, 1) if s not in NO_ALARM]
        temperature = self._read_kelvin(TEMPERATURE)
        if not isfinite(temperature):
            temperature = nan
            alarms.append("sensor failure")
        door = self._read(EVENTS[self._door - 1]) == ON if self._door else None
        return ChamberState(temperature, door, tuple(alarms))

    def stop(self) -> None:
        """See `Chamber.stop`; the loop is switched off, and then the event."""

        def switch_off() -> None:
            self._write(MODE, OFF)
            if self._event:
                self._write(EVENTS[self._event - 1], OFF)

        stop_with_retry(switch_off)

    def close(self) -> None:
        """Close the connection; the chamber continues."""
        self._client.close()

    def _is_fahrenheit(self) -> bool:
        unit = self._read(UNIT)
        if unit not in (FAHRENHEIT, CELSIUS):
            raise ProtocolError(
                f"{self.address}: {unit} in register {UNIT} is not a unit; {_CHECK_DATA_MAP}"
            )
        return unit == FAHRENHEIT

    def _read_kelvin(self, register: int) -> float:
        words = self._request(self._client.read_holding_registers, register, count=2).registers
        value: Any = self._client.convert_from_registers(
            words, self._client.DATATYPE.FLOAT32, "little"
        )
        return ((value - 32) / 1.8 if self._is_fahrenheit() else value) + ZERO_CELSIUS

    def _read(self, register: int) -> int:
        return self._request(self._client.read_holding_registers, register, count=1).registers[0]

    def _write(self, register: int, value: int) -> None:
        self._request(self._client.write_register, register, value=value)

    def _request(self, act: Callable[..., Any], register: int, **arguments: Any) -> Any:
        """Send a request, and return its reply; after an error, the next one connects again."""
        from pymodbus.exceptions import ModbusException

        with on_failure(self._client.close, ProtocolError, LinkLost):
            if self._client.socket is None:
                self._client.socket = connect_socket(self.address, self._place, CONNECT_TIMEOUT)
            try:
                reply = act(register, **arguments)
            except (ModbusException, OSError) as error:
                raise LinkLost.at(
                    self.address,
                    f"no reply for register {register}: {error}; check the cable and the power of "
                    "the controller",
                ) from error
            count = arguments.get("count")
            if reply.isError() or (count and len(reply.registers) != count):
                raise ProtocolError(
                    f"{self.address}: the controller refused register {register}; {_CHECK_DATA_MAP}"
                )
        return reply


def open_watlow_f4t(address: str, timeout: float) -> WatlowF4t:
    """Open the chamber at an address, such as `watlow-f4t://10.0.0.7?event=1`; see `WatlowF4t`."""
    at = TableAddress(address, "watlow-f4t://HOST?event=1&door=8&alarms=6", 502)
    event, door = (at.number(key, len(EVENTS), 0) for key in ("event", "door"))
    alarms = at.number("alarms", _MOST_ALARMS, 6)
    return WatlowF4t(at.tcp(), timeout, event, door, alarms)
