"""The packet layout of a device: pictures, and the meaning of their numbers in SI.

A reading in SI is sign · raw · size + zero. Increments (m/s, rad) are multiplied by the rate, so
that they become the mean acceleration or angular rate over the interval.
"""

import math
from dataclasses import dataclass, field
from math import inf

from inercal.host.packets.packet_format import AXES, BinaryFrame, Field, TextLine


@dataclass(frozen=True)
class Scale:
    """What the raw value of a channel means.

    Parameters
    ----------
    size : float
        SI of one unit of the raw value.
    zero : float
        SI of the raw value 0.
    full_scale : float
        SI; a reading this large, to within one step of an integer, is saturated.
    invalid : tuple of float
        Raw values that say that there is no reading.
    """

    size: float = 1.0
    zero: float = 0.0
    full_scale: float = inf
    invalid: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class PacketLayout:
    """The packets of a device.

    Parameters
    ----------
    name : str
        Of the description's file.
    description : str
        The device, and what it has to be set to.
    frames : tuple of BinaryFrame, or one TextLine
        Packets that the stream may hold, all with the same channels but temperature and status.
    accelerometer, gyro, temperature, time : Scale
        To m/s², rad/s, K and s.
    rate_hz : float or None
        Of the packets, where it is stated.
    step : float
        By which the counter (without one, the raw time) rises from packet to packet; 0: unknown.
    wraps : mapping of str to float
        Raw value at which "counter" and "time" start again at 0; 0: never.
    status_good : tuple of int
        Mask and value: a status whose masked bits differ is marked.
    """

    name: str
    description: str
    frames: tuple[BinaryFrame, ...] | tuple[TextLine]
    accelerometer: Scale
    gyro: Scale
    temperature: Scale = Scale()
    time: Scale = Scale()
    rate_hz: float | None = None
    step: float = 1.0
    wraps: dict[str, float] = field(default_factory=dict[str, float])
    status_good: tuple[int, int] = (0, 0)

    @property
    def roles(self) -> frozenset[str]:
        """The meanings of the fields of all packets."""
        return frozenset(field.role for frame in self.frames for field in frame.fields)

    @property
    def sequence(self) -> str | None:
        """What tells lost packets: "counter", else "time" of a stated rate, else None."""
        roles = {field.role for field in self.frames[0].fields}
        if "counter" in roles:
            return "counter"
        return "time" if "time" in roles and self.step else None

    @property
    def check_bits(self) -> int:
        """Bits of the weakest check; 0 without any. Where there are several, each has its part."""
        return min(
            min((check.kind.bits for check in frame.checks), default=0) for frame in self.frames
        )

    @property
    def protection(self) -> str:
        """How well a packet is protected against changed bytes, in words.

        Examples
        --------
        >>> from inercal.host.packets import read_layout
        >>> read_layout("vn100").protection
        'CRC-16/XMODEM: 1 changed packet in 65536 passes'
        """
        if not self.check_bits:
            return "none: any packet of the right form passes"
        checks = self.frames[0].checks
        words = checks[0].kind.words + (" on each part" if len(checks) > 1 else "")
        return f"{words}: 1 changed packet in {2**self.check_bits} passes"

    def scale(self, role: str) -> Scale:
        """Return what the raw values of a role mean."""
        if role in AXES:
            return self.accelerometer if role[0] == "a" else self.gyro
        return {"temperature": self.temperature, "time": self.time}.get(role, Scale())

    def resolution(self, field: Field) -> float:
        """Return the step of a field in SI; 0 for real numbers in binary."""
        size = abs(self.scale(field.role).size)
        if field.type[0] == "." and field.type[-1] == "f":
            return size * math.pow(10.0, -int(field.type[1:-1]))
        return size if field.bits or field.type == "d" else 0.0
