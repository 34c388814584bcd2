from pathlib import Path

import pytest

from inercal.errors import InputError
from inercal.host.packets import PRESETS, parse_layout, read_layout
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


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rate", "rates", "unknown key rates; possible here: about, byte_order, rate, line, frame"),
        ("zero", "offset", "unknown key [temperature] offset; possible here: scale, zero, invalid"),
        ("length = 11", "len = 11", "unknown key [frame] len; possible here: packet, length"),
        ("length = 11", "", "own.toml: [frame] length is missing"),
        ("length = 11", "length = 12", "[frame] packet: it has 11 bytes and length says 12"),
        ("length = 11", 'length = "11"', "[frame] length: '11'; give a whole number"),
        ("AA 55", "", "[frame] packet: no sync: a packet begins with one fixed byte or more"),
        ("crc16-xmodem", "crc17", "no check 'crc17'; there are crc16-ccitt-false, crc16-xmodem"),
        ("@2", "@9", "'crc16-xmodem@9' begins at byte 9 and stands at 9 itself"),
        (
            "gx:i16",
            "gx:i12",
            "'gx:i12' is neither a byte ('FA'), a field ('ax:i16'), a gap ('_:2')",
        ),
        (
            "gx:i16",
            "rx:i16",
            "no role 'rx'; there are ax, ay, az, gx, gy, gz, temperature, counter",
        ),
        ("gx:i16", "ax:i16", "'ax' comes twice"),
        ("counter:u8 ax:i16", "counter:f32", "'counter' is a whole number; it cannot be 'f32'"),
        ("little", "middle", 'byte_order: \'middle\'; it is "big" or "little"'),
        ('byte_order = "little"', "", "'ax:i16' has no byte order; give byte_order = \"little\""),
        ("100 Hz", "100 s", "rate: '100 s' is a time; expected a frequency, such as 'Hz'"),
        ("100 Hz", "0 Hz", "rate: '0 Hz'; it must be above 0"),
        ('rate = "100 Hz"', "", "[gyro] scale: '°' is an increment and needs the rate"),
        ("1 mg", "1 mm", "[accelerometer] scale: 'mm' is a length; expected an acceleration"),
        ("1 mg", "mg", "[accelerometer] scale: 'mg' is not a number with a unit, such as \"1 µg\""),
        ("1 mg", "1/0 mg", "[accelerometer] scale: '1/0 mg' divides by 0"),
        ("1 mg", "0 mg", "[accelerometer] scale: '0 mg' is no size of a step"),
        ("[accelerometer]", "[accelerometers]", "unknown key accelerometers; possible here: about"),
        ('[gyro]\nscale = "2^-14 °"', "", '[gyro] scale is missing; such as "16/32768 °/s"'),
        (
            "36.53 °C",
            "36.53 V",
            "[temperature] zero: '36.53 V' is a voltage; expected a temperature",
        ),
        (
            "[[frame]]",
            'line = "{ax:d}"\n[[frame]]',
            "give either a line of text, line = …, or binary",
        ),
        ("[gyro]", "[counter]\nstep = 0\n[gyro]", "[counter] step: 0; it must be 1 or more"),
        ("[gyro]", "[gyro]\ninvalid = [0.5]", "[gyro] invalid: [0.5]; give raw values, such as"),
        ("[[frame]]", "[[frame]", "no TOML: Expected ']]' at the end of an array declaration"),
    ],
)
def test_a_wrong_description_is_refused_in_one_line(old: str, new: str, message: str):
    assert GOOD.count(old) >= 1
    with pytest.raises(InputError) as refused:
        parse_layout(GOOD.replace(old, new, 1), "own.toml")
    assert str(refused.value).startswith("own.toml: ")
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("{ax:.3f}", "{ax:d", "a line looks like '{counter:d},{ax:.6f}'"),
        ("{ax:.3f}", "{ax:9.3f}", "line: '{ax:9.3f}' has no such form; there are :d, :.6f, :.6e"),
        ("{ax:.3f}", "{bx:.3f}", "line: no role 'bx'; there are ax, ay, az"),
        ("},{", "}{", "line: nothing separates 'ax' from what stands before it"),
        ("crc32@0", "crc33@0", "line: no check 'crc33'; there are crc16-ccitt-false"),
        ("{counter:d},{ax:.3f}", "{counter:d}", "no reading in the packet; there are ax, ay, az"),
        ("counter", "ä", "line: a line is of 1024 printable ASCII characters at most"),
    ],
)
def test_a_wrong_line_is_refused_in_one_line(old: str, new: str, message: str):
    with pytest.raises(InputError) as refused:
        parse_layout(LINE.replace(old, new, 1), "own.toml")
    assert str(refused.value).startswith("own.toml: ")
    assert message in str(refused.value)


def test_packets_of_one_stream_have_the_same_readings():
    other = '[[frame]]\nlength = 3\npacket = "AA 56 ax:i8"\n'
    with pytest.raises(InputError, match="ax, counter, gx in one packet and not the same"):
        parse_layout(GOOD.replace("[accelerometer]", f"{other}[accelerometer]"), "own.toml")


def test_packets_of_one_stream_are_told_apart_by_a_fixed_byte():
    other = '[[frame]]\nlength = 4\npacket = "AA 55 counter:u8 ax:i8"\n'
    with pytest.raises(InputError, match="no fixed byte distinguishes this packet from another"):
        parse_layout(GOOD.replace("[accelerometer]", f"{other}[accelerometer]"), "own.toml")


def test_a_file_that_is_not_there_is_refused_with_the_presets(tmp_path: Path):
    with pytest.raises(InputError, match=r"vn101: no description .* presets are ascii, fixed"):
        read_layout("vn101")
    with pytest.raises(InputError, match="no description of packets can be read there"):
        read_layout(tmp_path)
