"""IMU packets: described in TOML, decoded from any stream of bytes, and encoded from readings.

>>> from inercal.host.packets import Decoder, encode, read_layout
>>> layout = read_layout("fixed")
>>> data = encode(layout, [[0, 0, 9.8, 0, 0, 0.1]], temperature=[298.15])
>>> packets = Decoder(layout).feed(b"noise" + data)
>>> packets.readings[0].round(3).tolist()
[0.0, 0.0, 9.8, 0.0, 0.0, 0.1]
"""

from inercal.host.packets.description import PRESETS, parse_layout, read_layout
from inercal.host.packets.encode import encode
from inercal.host.packets.layout import PacketLayout
from inercal.host.packets.stream import Decoder, Flag, PacketCounts, Packets, join_packets, read_log

__all__ = [
    "PRESETS",
    "Decoder",
    "Flag",
    "PacketCounts",
    "PacketLayout",
    "Packets",
    "encode",
    "join_packets",
    "parse_layout",
    "read_layout",
    "read_log",
]
