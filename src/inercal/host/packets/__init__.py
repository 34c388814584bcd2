"""Packets of IMUs: described in TOML, decoded from any stream of bytes, and made from readings.

>>> from inercal.host.packets import Decoder, encode, read_layout
>>> layout = read_layout("fixed")
>>> data = encode(layout, [[0, 0, 9.8, 0, 0, 0.1]], temperature=[298.15])
>>> packets = Decoder(layout).feed(b"noise" + data)
>>> packets.readings[0].round(3).tolist()
[0.0, 0.0, 9.8, 0.0, 0.0, 0.1]
"""

from inercal.host.packets.description import PRESETS, layout_of, read_layout
from inercal.host.packets.encode import encode
from inercal.host.packets.layout import Layout
from inercal.host.packets.sequence import Flag
from inercal.host.packets.stream import Counts, Decoder, Packets, joined, read_log

__all__ = [
    "PRESETS",
    "Counts",
    "Decoder",
    "Flag",
    "Layout",
    "Packets",
    "encode",
    "joined",
    "layout_of",
    "read_layout",
    "read_log",
]
