"""A Modbus server with the registers of a Watlow F4T, written from the Modbus standard.

It shares no code with the driver or with pymodbus. Function codes 3, 6 and 16 are those of "MODBUS
Application Protocol Specification V1.1b3", and the header is that of "MODBUS Messaging on TCP/IP
Implementation Guide V1.0b".
"""

from math import isnan
from struct import pack, unpack

from inercal.host.sim.chamber import SimulatedChamber

SET_POINT, MODE, EVENT_1, EVENT_8 = 2782, 2730, 16594, 16828


class SimulatedF4t:
    """A `server.Device`; event 1 switches the chamber on, and event 8 reports its door."""

    def __init__(self, unit: int = 15):
        self.time = 0.0
        self.chamber = SimulatedChamber(lambda: self.time)
        self.registers = {6730: unit, MODE: 62, EVENT_1: 62}
        self._store(SET_POINT, 25.0)
        self._store(2774, -70.0 if unit == 15 else -94.0)
        self._store(2776, 150.0 if unit == 15 else 302.0)

    def advance(self, until: float) -> None:
        self.time = max(self.time, until)

    def session(self) -> "Session":
        return Session(self)

    def fault(self, words: str) -> None:
        self.chamber.fault(words)

    def read(self, register: int, count: int) -> list[int] | None:
        """Return registers; None if one does not exist."""
        state = self.chamber.read()
        shown = state.temperature - 273.15
        self._store(2820, shown if self.registers[6730] == 15 else shown * 9 / 5 + 32)
        self.registers[EVENT_8] = 63 if state.door_open else 62
        for n in range(6):
            self.registers[1356 + 100 * n] = (61, 88, 12)[n % 3]
        if "over-temperature" in state.alarms:
            self.registers[1456] = 7
        if isnan(state.temperature):
            self.registers[1556] = 28
        found = [self.registers.get(register + i) for i in range(count)]
        return None if None in found else [word for word in found if word is not None]

    def write(self, register: int, words: list[int]) -> None:
        for i, word in enumerate(words):
            self.registers[register + i] = word
        low, high = self.registers[SET_POINT], self.registers[SET_POINT + 1]
        (shown,) = unpack(">f", pack(">HH", high, low))
        celsius = shown if self.registers[6730] == 15 else (shown - 32) * 5 / 9
        if self.registers[MODE] == 10 and self.registers[EVENT_1] == 63:
            self.chamber.set_temperature(celsius + 273.15)
        else:
            self.chamber.stop()

    def _store(self, register: int, value: float) -> None:
        self.registers[register + 1], self.registers[register] = unpack(">HH", pack(">f", value))


class Session:
    """The server's side of a connection."""

    def __init__(self, device: SimulatedF4t):
        self._device, self._buffer = device, b""

    def feed(self, data: bytes) -> bytes:
        self._buffer += data
        replies = b""
        while len(self._buffer) >= 6:
            transaction, protocol, size = unpack(">HHH", self._buffer[:6])
            if len(self._buffer) < 6 + size:
                break
            unit, body = self._buffer[6], self._buffer[7 : 6 + size]
            self._buffer = self._buffer[6 + size :]
            assert protocol == 0
            if "silent" not in self._device.chamber.faults:
                reply = bytes([unit]) + self._reply(body)
                replies += pack(">HHH", transaction, 0, len(reply)) + reply
        return replies

    def _reply(self, body: bytes) -> bytes:
        function, register, value = unpack(">BHH", body[:5])
        if function == 3:
            words = self._device.read(register, value)
            if words is None:
                return pack(">BB", 0x83, 2)  # illegal data address
            return pack(f">BB{value}H", 3, 2 * value, *words)
        if function == 6:
            self._device.write(register, [value])
            return body
        assert function == 16
        assert body[5] == 2 * value
        self._device.write(register, list(unpack(f">{value}H", body[6:])))
        return body[:5]
