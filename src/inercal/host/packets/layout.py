"""The packet layout of a device: the formats of its packets, and the scale of each number.

A reading in SI is sign · raw · size + zero. Increments (m/s, rad) are multiplied by the rate; the
result is the mean acceleration or angular rate over the interval.
"""

import math
from dataclasses import dataclass, field
from math import inf

from inercal.host.packets.packet_format import AXES, BinaryFrame, Field, TextLine


@dataclass(frozen=True)
class Scale:
    """The scale of a channel, which converts raw values to SI.

    Parameters
    ----------
    size : float
        SI value of one unit of the raw value.
    zero : float
        SI value of the raw value 0.
    full_scale : float
        Full scale in SI. A reading is saturated if it is beyond this value or less than one integer
        step below it.
    invalid : tuple of float
        Raw values that mean "no reading".
    """

    size: float = 1.0
    zero: float = 0.0
    full_scale: float = inf
    invalid: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class PacketLayout:
    """The packets of a device, and the meaning of their values.

    Parameters
    ----------
    name : str
        Name of the file with the description.
    description : str
        Name of the device, and the settings that it needs.
    frames : tuple of BinaryFrame, or one TextLine
        Packets that may occur in the stream. All have the same channels, except temperature and
        status.
    accelerometer, gyro, temperature, time : Scale
        Scales to m/s², rad/s, K and s.
    rate_hz : float or None
        Packet rate, if stated.
    step : float
        Increment of the counter from packet to packet or, without a counter, of the raw time; 0 if
        unknown.
    wraps : mapping of str to float
        Raw values at which "counter" and "time" wrap around to 0; 0 if they never do.
    status_good : tuple of int
        Mask and value. A packet is marked if the masked bits of its status differ from the value.
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
        """The roles of the fields in all packets."""
        return frozenset(field.role for frame in self.frames for field in frame.fields)

    @property
    def sequence(self) -> str | None:
        """The value that reveals lost packets: "counter", "time" (at a stated rate), or None."""
        roles = {field.role for field in self.frames[0].fields}
        if "counter" in roles:
            return "counter"
        return "time" if "time" in roles and self.step else None

    @property
    def check_bits(self) -> int:
        """Bits of the weakest checksum; 0 if there is none. Each checksum covers its own part."""
        return min(
            min((check.kind.bits for check in frame.checks), default=0) for frame in self.frames
        )

    @property
    def protection(self) -> str:
        """Text that says how well a packet is protected against changed bytes.

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
        """Return the scale of the raw values of a role."""
        if role in AXES:
            return self.accelerometer if role[0] == "a" else self.gyro
        return {"temperature": self.temperature, "time": self.time}.get(role, Scale())

    def resolution(self, field: Field) -> float:
        """Return the resolution of a field in SI; 0 for binary real numbers."""
        size = abs(self.scale(field.role).size)
        if field.type[0] == "." and field.type[-1] == "f":
            return size * math.pow(10.0, -int(field.type[1:-1]))
        return size if field.bits or field.type == "d" else 0.0
