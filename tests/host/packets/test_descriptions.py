from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.host.packets import PRESETS, Decoder, Flag, parse_layout, read_layout
from inercal.host.packets.packet_format import AXES

GOOD = """
byte_order = "little"
rate = "100 Hz"

[[frame]]
length = 11
packet = "AA 55 counter:u8 ax:i16 gx:i16 temperature:i16 crc16-xmodem@2"

[accelerometer]
scale = "1 mg"

[gyro]
scale = "2^-14 °"

[temperature]
scale = "1/340 °C"
zero = "36.53 °C"
"""
LINE = 'line = "{counter:d},{ax:.3f}*{crc32@0:08x}"\n[accelerometer]\nscale = "1 g"\n'


def test_scales_are_in_si_and_increments_times_the_rate():
    layout = parse_layout(GOOD, "good.toml")
    assert layout.accelerometer.size == pytest.approx(9.80665e-3, rel=1e-15)
    assert layout.gyro.size == pytest.approx(100 * 2.0**-14 * 3.141592653589793 / 180, rel=1e-15)
    assert layout.temperature.size == pytest.approx(1 / 340, rel=1e-15)
    assert layout.temperature.zero == pytest.approx(36.53 + 273.15, rel=1e-15)
    american = GOOD.replace("1/340 °C", "0.1 °F").replace('zero = "36.53 °C"\n', "")
    layout = parse_layout(american, "f.toml")
    assert layout.temperature.size * 770 + layout.temperature.zero == pytest.approx(298.15)
    assert layout.wraps["counter"] == 256


def test_the_roles_are_those_of_all_packets_together():
    xsens = read_layout("xsens")
    assert "temperature" not in {field.role for field in xsens.frames[0].fields}
    assert xsens.roles == {*AXES, "counter", "time", "temperature"}
    assert parse_layout(LINE, "line.toml").roles == {"counter", "ax"}


@pytest.mark.parametrize("name", PRESETS)
def test_presets_say_what_they_are_and_how_protected(name: str):
    layout = read_layout(name)
    assert layout.name == name
    assert layout.description
    assert str(2**layout.check_bits) in layout.protection or name == "ascii"


FRAME, A, G, T = "[frame] packet", "[accelerometer]", "[gyro]", "[temperature]"


@pytest.mark.parametrize(
    ("old", "new", "key", "names"),
    [
        ("zero", "offset", f"{T} offset", ()),
        ("length = 11", "len = 11", "[frame] len", ()),
        ("length = 11", "", "[frame] length", ()),
        ("length = 11", "length = 12", "[frame] length", ()),
        ("length = 11", 'length = "11"', "[frame] length", ()),
        ("AA 55", "", FRAME, ()),
        ("crc16-xmodem", "crc17", FRAME, ("crc17",)),
        ("@2", "@9", FRAME, ("crc16-xmodem@9",)),
        ("gx:i16", "gx:i12", FRAME, ("gx:i12",)),
        ("gx:i16", "rx:i16", FRAME, ("rx",)),
        ("gx:i16", "ax:i16", FRAME, ("ax",)),
        ("counter:u8 ax:i16", "counter:f32", FRAME, ("counter",)),
        ("little", "middle", "byte_order", ()),
        ('byte_order = "little"', "", FRAME, ("ax:i16",)),
        ("100 Hz", "100 s", "rate", None),
        ("100 Hz", "0 Hz", "rate", ()),
        ('rate = "100 Hz"', "", f"{G} scale", ()),
        ("1 mg", "1 mm", f"{A} scale", ()),
        ("1 mg", "mg", f"{A} scale", ()),
        ("1 mg", "1/0 mg", f"{A} scale", ()),
        ("1 mg", "0 mg", f"{A} scale", ()),
        ("[accelerometer]", "[accelerometers]", "accelerometers", ()),
        ('[gyro]\nscale = "2^-14 °"', "", f"{G} scale", ()),
        ("36.53 °C", "36.53 V", f"{T} zero", None),
        ("[[frame]]", 'line = "{ax:d}"\n[[frame]]', None, ()),
        ("[gyro]", "[counter]\nstep = 0\n[gyro]", "[counter] step", ()),
        ("[gyro]", "[gyro]\ninvalid = [0.5]", f"{G} invalid", ()),
        ("[[frame]]", "[[frame]", None, ()),
    ],
)
def test_a_wrong_description_is_refused_in_one_line(
    old: str, new: str, key: str | None, names: tuple[str, ...] | None
):
    assert GOOD.count(old) >= 1
    with refused(key=key, file="own.toml") as refusal:
        parse_layout(GOOD.replace(old, new, 1), "own.toml")
    assert names is None or refusal.value.names == names
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("old", "new", "key", "names"),
    [
        ("{ax:.3f}", "{ax:d", "line", ()),
        ("{ax:.3f}", "{ax:9.3f}", "line", ("ax",)),
        ("{ax:.3f}", "{bx:.3f}", "line", ("bx",)),
        ("},{", "}{", "line", ("ax",)),
        ("crc32@0", "crc33@0", "line", ("crc33",)),
        ("{counter:d},{ax:.3f}", "{counter:d}", None, ()),
        ("counter", "ä", "line", ()),
    ],
)
def test_a_wrong_line_is_refused_in_one_line(
    old: str, new: str, key: str | None, names: tuple[str, ...]
):
    with refused(key=key, names=names, file="own.toml"):
        parse_layout(LINE.replace(old, new, 1), "own.toml")


def test_packets_of_one_stream_have_the_same_readings():
    other = '[[frame]]\nlength = 3\npacket = "AA 56 ax:i8"\n'
    with refused(key=FRAME, names=("ax", "counter", "gx")):
        parse_layout(GOOD.replace("[accelerometer]", f"{other}[accelerometer]"), "own.toml")


def test_packets_of_one_stream_differ_in_a_fixed_byte():
    other = '[[frame]]\nlength = 4\npacket = "AA 55 counter:u8 ax:i8"\n'
    with refused(key=FRAME, names=()):
        parse_layout(GOOD.replace("[accelerometer]", f"{other}[accelerometer]"), "own.toml")


def test_a_file_that_is_not_there_is_refused_with_the_presets(tmp_path: Path):
    with refused(file="vn101") as refusal:
        read_layout("vn101")
    assert all(preset in str(refusal.value) for preset in PRESETS)
    with refused(file=tmp_path):
        read_layout(tmp_path)


BOUNDED = """byte_order = "little"
[[frame]]
packet = "FA ax:i16 counter:u64 status:u64"
length = 19
[accelerometer]
scale = "1 mg"
"""


@pytest.mark.parametrize("value", [-(2**64), -1, 2**63, 2**64, pytest.param(10**400, id="1e400")])
@pytest.mark.parametrize(
    "key", ["[status] mask", "[status] good", "[counter] step", "[counter] wraps"]
)
def test_a_count_that_no_packet_can_hold_is_refused_with_its_key(key: str, value: int):
    section, name = key.split()
    with refused(key=key):
        parse_layout(f"{BOUNDED}{section}\n{name} = {value}\n", "packets.toml")


@pytest.mark.parametrize("value", [-(2**64), 2**64, pytest.param(10**400, id="1e400")])
def test_an_invalid_reading_that_no_packet_can_hold_is_refused(value: int):
    with refused(key="[accelerometer] invalid"):
        parse_layout(f"{BOUNDED}invalid = [{value}]\n", "packets.toml")


def test_a_good_status_with_bits_outside_the_mask_is_refused():
    with refused(key="[status] good"):
        parse_layout(f"{BOUNDED}[status]\nmask = 1\ngood = 3\n", "packets.toml")


@pytest.mark.parametrize("mask", [0, 1, 2**31, 2**53 + 1, 2**63 - 1])
def test_any_mask_that_is_accepted_marks_the_packets_whose_bits_it_holds(mask: int):
    layout = parse_layout(f"{BOUNDED}[status]\nmask = {mask}\n", "packets.toml")
    packet = bytes([0xFA, 1, 0, *[0] * 8, *[255] * 8])
    flags = Decoder(layout).feed(packet * 2).flags
    assert np.all((flags & Flag.STATUS != 0) == (mask > 0))
