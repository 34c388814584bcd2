from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.host.packets.cases import fed, motion, same
from tests.refusals import refused

from inercal.host.packets import PRESETS, Decoder, Flag, encode, parse_layout, read_layout, read_log

COUNTED = [name for name in PRESETS if read_layout(name).sequence == "counter"]
BINARY = ("fixed", "vn100", "witmotion", "xsens")


def packets_of(name: str, n: int) -> list[bytes]:
    """Return n packets one by one."""
    layout, given = read_layout(name), motion(read_layout(name), n)
    return [
        encode(layout, counter=[k], **{key: values[k : k + 1] for key, values in given.items()})
        for k in range(n)
    ]


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("every", [5, evidence(1)])
def test_a_stream_cut_at_any_byte_gives_the_same_arrays_bit_for_bit(name: str, every: int):
    layout, parts = read_layout(name), packets_of(name, 8)
    parts[2] = parts[2][:-5]  # cut short
    parts[4] = parts[4][:9] + b"\x00" + parts[4][9:]  # a byte inserted
    parts.insert(6, parts[1][:7] + b"\xfa\xff\xaa\x55%")  # garbage with beginnings of packets
    data = b"".join(parts)
    whole, counts = fed(layout, data)
    assert len(whole) >= 4
    for cut in range(1, len(data), every):
        packets, found = fed(layout, data[:cut], data[cut:])
        assert same(packets, whole), cut
        assert found == counts
    packets, found = fed(layout, *(data[k : k + 1] for k in range(len(data))))
    assert same(packets, whole)
    assert found == counts


@pytest.mark.parametrize("name", BINARY)
def test_a_packet_is_there_as_soon_as_its_last_byte(name: str):
    decoder = Decoder(read_layout(name))
    for packet in packets_of(name, 5):
        assert len(decoder.feed(packet[:-1])) == 0
        assert len(decoder.feed(packet[-1:])) == 1
        assert decoder.pending == 0


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("flaw", ["lost byte", "wrong byte", "lost packet", "byte between"])
def test_one_flaw_costs_one_packet_at_most(name: str, flaw: str):
    layout, parts = read_layout(name), packets_of(name, 9)
    clean, _ = fed(layout, b"".join(parts))
    sizes = [len(part) for part in parts]
    middle = len(parts[4]) // 2
    parts[4] = {
        "lost byte": parts[4][:middle] + parts[4][middle + 1 :],
        "wrong byte": parts[4][: middle - 1] + b"\x7f" + parts[4][middle:],
        "lost packet": b"",
        "byte between": b"\x7f" + parts[4],
    }[flaw]
    found, counts = fed(layout, b"".join(parts))
    kept = list(range(9))
    if len(found) == 8:
        kept.remove(4)
    assert len(found) == len(kept)
    if flaw == "lost byte" and name == "ascii":
        return  # nothing shows that a digit is missing
    np.testing.assert_array_equal(found.readings, clean.readings[kept])
    assert counts.discarded == sum(map(len, parts)) - sum(sizes[k] for k in kept)
    # A line that follows rubbish is whole where it begins with a fixed character.
    assert len(kept) == (9 if flaw == "byte between" and name != "ascii" else 8)
    if layout.sequence:
        assert counts.lost == 9 - len(kept)
        assert (found.flags & Flag.GAP != 0).tolist() == [k == 5 and 4 not in kept for k in kept]


@pytest.mark.parametrize("name", BINARY)
def test_a_wrong_check_is_counted(name: str):
    parts = packets_of(name, 3)
    parts[1] = parts[1][:-1] + bytes([parts[1][-1] ^ 1])
    assert fed(read_layout(name), b"".join(parts))[1].failed == 1


def test_a_counter_of_16_bits_is_counted_on_across_its_end():
    layout = read_layout("fixed")
    given = motion(layout, 4)
    packets, counts = fed(layout, encode(layout, counter=[65534, 65535, 65536, 65539], **given))
    assert packets.counter is not None
    assert packets.counter.tolist() == [65534, 65535, 65536, 65539]
    assert counts.lost == 2


def test_repeated_and_late_packets_are_marked_and_kept():
    layout = read_layout("fixed")
    packets, counts = fed(layout, encode(layout, counter=[1, 2, 2, 3, 1, 4], **motion(layout, 6)))
    assert (packets.flags & Flag.REPEATED != 0).tolist() == [False, False, True, *[False] * 3]
    assert (packets.flags & Flag.OUT_OF_ORDER != 0).tolist() == [*[False] * 4, True, False]
    assert (counts.repeated, counts.out_of_order, counts.lost) == (1, 1, 2)


def test_a_clock_of_32_bits_is_counted_on_exactly():
    layout = read_layout("xsens")
    ticks = np.arange(2**32 - 200, 2**32 + 200, 100)
    given = motion(layout, 4) | {"time": ticks * 1e-4}
    packets, _ = fed(layout, encode(layout, **given))
    np.testing.assert_array_equal(packets.time, ticks * layout.time.size)


def test_time_of_a_stated_rate_tells_lost_packets_where_there_is_no_counter():
    layout = read_layout("vn100")
    given = motion(layout, 20)
    kept = np.delete(np.arange(20), [7, 8, 9, 15])
    _, counts = fed(layout, encode(layout, **{key: v[kept] for key, v in given.items()}))
    assert counts.lost == 4


def test_full_scale_status_and_codes_without_a_reading_are_marked():
    text = (
        'byte_order = "big"\n[[frame]]\nlength = 6\n'
        'packet = "A5 ax:i16 status:u8 gx:i16"\n[status]\nmask = 0x81\ngood = 0x80\n'
        '[accelerometer]\nscale = "16/32768 g"\nfull_scale = "16 g"\n'
        '[gyro]\nscale = "1 °/s"\ninvalid = [-32768]\n'
    )
    rows = ["7FFF 80 0000", "7FFE 80 0000", "8000 80 0000", "0000 81 0000", "0000 02 8000"]
    packets, _ = fed(parse_layout(text, "own"), bytes.fromhex("A5" + "A5".join(rows)))
    none = Flag(0)
    saturated = [Flag.SATURATED, none, Flag.SATURATED]
    assert packets.flags.tolist() == [*saturated, Flag.STATUS, Flag.STATUS | Flag.INVALID]
    assert np.isnan(packets.readings[4, 3])


def test_a_packet_that_has_no_status_is_not_marked_for_it():
    text = (
        'byte_order = "big"\n[[frame]]\nlength = 4\npacket = "A5 01 ax:i8 status:u8"\n'
        '[[frame]]\nlength = 3\npacket = "A5 02 ax:i8"\n[status]\nmask = 1\ngood = 1\n'
        '[accelerometer]\nscale = "1 g"\n'
    )
    packets, _ = fed(parse_layout(text, "own"), bytes.fromhex("A5010001 A50200 A5010000"))
    assert packets.flags.tolist() == [0, 0, Flag.STATUS]
    assert packets.status.tolist() == [1, 0, 0]


def test_integers_of_24_bits_keep_sign_and_byte_order():
    text = (
        'byte_order = "big"\n[[frame]]\nlength = 7\npacket = "93 ax:i24 ay:i24:le"\n'
        '[accelerometer]\nscale = "2^-19 g"\n'
    )
    packets, _ = fed(parse_layout(text, "own"), bytes.fromhex("93 FFFFFE 010080"))
    g = 9.80665 * 2.0**-19
    np.testing.assert_array_equal(packets.readings[0, :2], [-2 * g, (1 - 2**23) * g])


def test_a_line_that_is_cut_at_the_start_of_a_stream_is_left_out():
    layout = read_layout("ascii")
    data = b"23,0.1,1,2,3,4,5,6,20\n124,0.2,1,2,3,4,5,6,20\n"
    decoder = Decoder(layout, mid_stream=True)
    packets = decoder.feed(data)
    assert packets.counter is not None
    assert packets.counter.tolist() == [124]
    assert decoder.counts.discarded == 22


def test_a_line_without_end_is_not_held_for_ever():
    decoder = Decoder(read_layout("ascii"))
    for _ in range(20):
        decoder.feed(b"1," * 1000)
    assert decoder.pending <= 4096
    assert len(decoder.feed(b"1\n5,0,1,2,3,4,5,6,20\n")) == 1


@pytest.mark.parametrize("name", PRESETS)
def test_a_file_reads_like_the_stream(name: str, tmp_path: Path):
    layout = read_layout(name)
    data = b"\x00\xff" + b"".join(packets_of(name, 40))[:-3]
    file = tmp_path / "log.bin"
    file.write_bytes(data)
    packets, counts = read_log(file, layout)
    live, found = fed(layout, *(data[k : k + 11] for k in range(0, len(data), 11)))
    assert same(packets, live)
    size = len(data) - sum(map(len, packets_of(name, 40)[40 - counts.packets - 1 : 39]))
    assert counts.discarded == size
    assert found.packets == counts.packets >= 38


def test_a_file_without_packets_is_refused_with_what_was_there(tmp_path: Path):
    file = tmp_path / "log.bin"
    file.write_bytes(bytes(100))
    with refused(file=file, names=("vn100",)):
        read_log(file, read_layout("vn100"))
    with refused(file="none", names=()):
        read_log(tmp_path / "none", read_layout("vn100"))
