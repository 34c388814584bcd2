"""Bytes that somebody else has printed, and of WitMotion what its printed formulas give."""

import numpy as np
import pytest

from inercal.host.packets import Decoder, parse_layout, read_layout

DEGREE = np.pi / 180
# NovAtel, OEM7 Commands and Logs, RAWIMUS, "ASCII Example".
RAWIMUSA = (
    b"%RAWIMUSA,2209,491612.254;2209,491612.253588,ea5afe00,329303960,-2512321,4410363,"
    b"309705,607017,-1009773*1fb76c28\r\n"
)
# VectorNav, UM001 VN-100 User Manual, "Binary Output Messages", example case 1: yaw, pitch, roll.
YAW_PITCH_ROLL = bytes.fromhex("FA01080093502E42833EF13F48B504BB9288")
# A message of an MTi as drivers print it: counter, time, acceleration, rate of turn, status word.
MTDATA2 = bytes.fromhex(
    "FAFF3631 102002DFC5 106004 00459DA0 40200C BEDC9AFA 3F549F37 411CBB70"
    "80200C BBAA5C80 3B8C5501 BB813300 E02004 00000081 45"
)
# By the formulas of WitMotion's WT901 datasheet, 5.1.2 and 5.1.3; not printed there.
# 1 g is 2048, 90 °/s are 1474.56.
WT901 = bytes.fromhex("5551 0000 0000 0008 C409 7B 5552 0000 0000 C2 05 C409 3B")


def test_the_example_of_novatels_manual_reads_one_g_on_z():
    packets = Decoder(read_layout("novatel")).feed(RAWIMUSA)
    g, rate = 0.2 / 65536 * 9.80665e-3, 0.008 / 65536 * DEGREE
    expected = [4410363 * g, 2512321 * g, 329303960 * g]
    expected += [-1009773 * rate, -607017 * rate, 309705 * rate]
    np.testing.assert_allclose(packets.readings[0], expected, rtol=1e-12)
    assert packets.readings[0, 2] == pytest.approx(9.8, abs=0.1)
    assert packets.time is not None
    assert packets.time[0] == 491612.253588
    assert packets.status[0] == 0xEA5AFE00


def test_novatels_example_with_any_character_changed_is_no_packet():
    for k in range(len(RAWIMUSA) - 2):
        wrong = RAWIMUSA[:k] + bytes([RAWIMUSA[k] ^ 1]) + RAWIMUSA[k + 1 :]
        assert len(Decoder(read_layout("novatel")).feed(wrong)) == 0


def test_the_example_of_vectornavs_manual_has_the_values_printed_there():
    # No readings in this message: its angles are taken for rates, to be read at all.
    layout = parse_layout(
        'byte_order = "little"\n[[frame]]\nlength = 18\n'
        'packet = "FA 01 08 00 gz:f32 gy:f32 gx:f32 crc16-xmodem@1:be"\n'
        '[gyro]\nscale = "1 °/s"\n',
        "ypr",
    )
    packets = Decoder(layout).feed(YAW_PITCH_ROLL)
    # Printed with eight digits: +43.578686 (Yaw), +1.8847202 (Pitch), -2.0249654e-3 (Roll).
    expected = np.array([-2.0249654e-3, 1.8847202, 43.578686]) * DEGREE
    np.testing.assert_allclose(packets.readings[0, 3:], expected, rtol=1e-7)


def test_a_message_of_an_mti_with_a_status_word_reads_one_g_on_z():
    layout = parse_layout(
        'byte_order = "big"\n[[frame]]\nlength = 54\n'
        'packet = "FA FF 36 31 10 20 02 counter:u16 10 60 04 time:u32 40 20 0C ax:f32 ay:f32 '
        'az:f32 80 20 0C gx:f32 gy:f32 gz:f32 E0 20 04 status:u32 sum8-zero@1"\n'
        '[accelerometer]\nscale = "1 m/s²"\n[gyro]\nscale = "1 rad/s"\n[time]\nscale = "100 µs"\n',
        "mti",
    )
    packets = Decoder(layout).feed(MTDATA2)
    assert packets.counter is not None
    assert packets.time is not None
    assert packets.counter[0] == 0xDFC5
    assert packets.time[0] == pytest.approx(0x459DA0 * 1e-4, rel=1e-15)
    assert packets.status[0] == 0x81
    expected = np.frombuffer(MTDATA2[19:31] + MTDATA2[34:46], ">f4")
    np.testing.assert_array_equal(packets.readings[0], expected.astype(float))
    assert np.linalg.norm(packets.readings[0, :3]) == pytest.approx(9.81, abs=0.05)


def test_witmotions_formulas_make_one_g_of_2048_and_90_degrees_per_second_of_1474():
    packets = Decoder(read_layout("witmotion")).feed(WT901)
    expected = [0, 0, 9.80665, 0, 0, 1474 / 32768 * 2000 * DEGREE]
    np.testing.assert_allclose(packets.readings[0], expected, rtol=1e-12)
    assert packets.temperature[0] == pytest.approx(25.0 + 273.15, rel=1e-15)
