"""Bytes of the Turbo PMAC's protocol, as its manual has them."""

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.refusals import refused

from inercal.host.drivers import pmac_codec as codec
from inercal.host.drivers.rotary_table import ProtocolError


def test_a_command_is_the_header_of_the_manual_and_its_ascii():
    assert codec.response_request("#1P") == bytes.fromhex("40 BF 00 00 00 00 00 03") + b"#1P"
    assert codec.response_request("x" * 300)[:8] == bytes.fromhex("40 BF 00 00 00 00 01 2C")
    assert bytes.fromhex("C0 C5 00 00 00 00 05 78") == codec.BUFFER_REQUEST
    assert bytes.fromhex("40 B3 00 00 00 00 00 00") == codec.FLUSH_REQUEST
    assert codec.control_request("A") == bytes.fromhex("C0 C4 01 00 00 00 00 00")


@pytest.mark.parametrize("line", ["", "x" * 1493, "#1P\r", "#1\x01", "°"])
def test_a_line_that_cannot_be_sent_is_refused(line: str):
    with refused(key="line"):
        codec.response_request(line)


@pytest.mark.parametrize(
    ("reply", "lines"),
    [
        (b"\x06", []),
        (b"1995\r\x06", ["1995"]),
        (b"0\r7.6\r\x06", ["0", "7.6"]),
        (b"\r\x06", [""]),
    ],
)
def test_a_reply_is_its_lines_however_it_is_split(reply: bytes, lines: list[str]):
    for cut in range(len(reply)):
        reader = codec.ReplyReader("?")
        assert reader.feed(reply[:cut]) is None
        assert reader.feed(reply[cut:]) == lines
    reader = codec.ReplyReader("?")
    assert [reader.feed(reply[i : i + 1]) for i in range(len(reply))][-1] == lines


def test_an_error_is_raised_with_its_meaning_however_it_is_split():
    reply = b"12\r\x07ERR003\r"
    for cut in range(len(reply)):
        reader = codec.ReplyReader("#1Z")
        assert reader.feed(reply[:cut]) is None
        with pytest.raises(codec.CommandRefused) as caught:
            reader.feed(reply[cut:])
        assert caught.value.code == 3


@pytest.mark.parametrize(
    "reply",
    [
        b"12\r\x0634\r\x06",
        b"12\x06",
        b"1\x002\r\x06",
        b"\x07\r",
        b"\x07ERR03\r",
        b"\x07ERR003\r\x06",
    ],
)
def test_what_is_no_reply_is_refused(reply: bytes):
    reader = codec.ReplyReader("?")
    with pytest.raises(ProtocolError):
        reader.feed(reply)


def test_a_full_chunk_that_ends_in_cr_is_not_the_end():
    reader = codec.ReplyReader("?")
    assert reader.feed(b"123456\r" * 200) is None
    assert reader.awaits_request
    assert reader.feed(b"7\r\x06") == ["123456"] * 200 + ["7"]


def test_status_words_are_read_as_in_the_manuals_example():
    # Software Reference, `?`: the example's bits are 23, 16, 13 and 15, 14, 10, 0.
    status = codec.parse_status("81200001C401")
    assert (status.homed, status.in_position) == (True, True)
    assert not status.moving
    assert status.faults == ()


def test_faults_are_told_in_words():
    assert codec.parse_status("84000000840C").faults == ("amplifier fault", "fatal following error")
    assert codec.parse_status("000000000000").faults == ("not activated",)


def test_numbers_are_decimal_or_hexadecimal_and_nothing_else():
    assert codec.parse_number("-12.03125") == -12.03125
    assert codec.parse_number("$78400") == 0x78400
    for text in ("", "nan", "1e5", "1_0", "0x10", "--1", "1 2", "ERR003", "٣"):
        with pytest.raises(ProtocolError):
            codec.parse_number(text)


_REAL = (
    b"1995\r\x06",
    b"FFFFFF\r12.5\r-0.1\r0\r81200001C401\rFFFFFF\r\x06",
    b"\x07ERR003\r",
    b"$78400\r$0\r$0\r$0\r\x06",
    b"\x06",
)


def _mutated(rng: np.random.Generator) -> bytes:
    kind = rng.integers(4)
    if kind == 0:
        return rng.bytes(int(rng.integers(1, 40)))
    frame = bytearray(_REAL[rng.integers(len(_REAL))])
    for _ in range(rng.integers(1, 4)):
        place = int(rng.integers(len(frame) + 1))
        match kind:
            case 1:
                frame[place : place + 1] = rng.bytes(1)
            case 2:
                del frame[place : place + int(rng.integers(1, 4))]
            case _:
                frame[place:place] = _REAL[rng.integers(len(_REAL))]
    return bytes(frame)


def _fuzz(count: int) -> int:
    """Feed `count` frames in pieces to the codec; return how many were taken as replies."""
    rng = np.random.default_rng(11)
    taken = 0
    for _ in range(count):
        frame = _mutated(rng)
        cut = int(rng.integers(len(frame) + 1))
        reader = codec.ReplyReader("?")
        try:
            lines = reader.feed(frame[:cut]) or reader.feed(frame[cut:])
            for text in lines or ():
                taken += 1
                (codec.parse_status if len(text) == 12 else codec.parse_number)(text)
        except (ProtocolError, codec.CommandRefused):
            pass
    return taken


@pytest.mark.slow
@pytest.mark.parametrize("frames", [20_000, evidence(200_000), evidence(1_000_000)])
def test_damaged_frames_raise_nothing_but_the_protocols_errors(frames: int):
    assert _fuzz(frames) > 0.05 * frames
