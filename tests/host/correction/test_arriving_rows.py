"""Lines and packets become samples, however the bytes are divided; damaged ones are counted."""

from pathlib import Path

import numpy as np
import pytest
from tests.host.correction.cases import HEADER, NAMED, NUMBERED, lines, run_of
from tests.refusals import refused

from inercal.host.correction.text_rows import ArrivedPackets, ArrivedRows, TextRows
from inercal.host.packets import encode, read_layout

RATE = 'rate = "1 kHz"\naccelerometer = [1, 2, 3]\ngyro = [4, 5, 6]'


def joined(parts: list[ArrivedRows | None]) -> ArrivedRows:
    there = [part for part in parts if part is not None]
    kelvin = [part.kelvin for part in there if part.kelvin is not None]
    return ArrivedRows(
        np.concatenate([part.time for part in there]),
        np.concatenate([part.readings for part in there]),
        np.concatenate(kelvin) if kelvin else None,
    )


def pieces(data: bytes, seed: int) -> list[bytes]:
    cuts = np.sort(np.random.default_rng(seed).integers(0, len(data), 60)).tolist()
    return [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]


@pytest.mark.parametrize("seed", range(5))
def test_samples_do_not_depend_on_how_the_bytes_are_divided(seed: int, tmp_path: Path):
    run, rows = run_of(tmp_path), lines(200)
    data = "".join(rows).encode()
    parser = TextRows(run, "test")
    found = joined([*map(parser.feed, pieces(data, seed)), parser.finish()])
    expected = np.array([row.split(",") for row in rows], float)
    np.testing.assert_array_equal(found.time, expected[:, 0])
    np.testing.assert_array_equal(found.readings, expected[:, 1:])
    assert parser.malformed == 0


DAMAGED = {
    "a missing column": "0,1,2,3,4,5",
    "two joined lines": "0,1,2,3,4,5,60,1,2,3,4,5,6",
    "a word": "0,1,2,overflow,4,5,6",
    "an error value": "0,1,2,3,4,5,1.#QNAN",
    "an empty cell": "0,1,2,,4,5,6",
    "not a number": "0,1,2,nan,4,5,6",
    "infinity": "0,1,2,inf,4,5,6",
    "an underscore": "0,1,2,1_0,4,5,6",
    "digits of another script": "0,1,2,٣,4,5,6",
    "binary": "0,1,2,\x00\x01,4,5,6",
}


@pytest.mark.parametrize("several", [1, 30])
@pytest.mark.parametrize("line", DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_line_is_counted_and_the_others_are_read(line: str, several: int, tmp_path: Path):
    parser, rows = TextRows(run_of(tmp_path), "test"), lines(2 * several)
    text = "".join([*rows[:several], line + "\n", "# remark\n", "\n", *rows[several:]])
    found = parser.feed(text.encode())
    assert found is not None
    assert found.time.tolist() == [k / 1000 for k in range(2 * several)]
    assert parser.malformed == 1


def test_times_by_the_rate_count_damaged_lines(tmp_path: Path):
    parser = TextRows(run_of(tmp_path, RATE), "test")
    found = joined([parser.feed(b"1,2,3,4,5,6\nbad\n"), parser.feed(b"1,2,3,4,5,6\n" * 3)])
    assert found.time.tolist() == [0.0, 0.002, 0.003, 0.004]


def test_a_counter_that_wraps_continues(tmp_path: Path):
    data = NUMBERED + '\ntime_unit = "sample"\nrate = "100 Hz"\ncounter_modulus = 256'
    parser = TextRows(run_of(tmp_path, data), "test")
    found = joined([parser.feed(f"{k % 256},0,0,0,0,0,0\n".encode()) for k in range(250, 262)])
    np.testing.assert_allclose(found.time, np.arange(250, 262) / 100)


def test_a_header_gives_the_columns_also_in_the_middle_of_a_stream(tmp_path: Path):
    parser = TextRows(run_of(tmp_path, NAMED), "test")
    assert parser.feed(f"{HEADER}\n".encode()) is None
    first = parser.feed(b"1,10,20,30,40,50,60,25\n")
    again = parser.feed(b"gz;t\ngz,t,ax,ay,az,gx,gy,temp\n60,2,10,20,30,40,50,26\n")
    for found, celsius in ((first, 25), (again, 26)):
        assert found is not None
        assert found.kelvin is not None
        assert found.readings.tolist() == [[10, -20, 30, 40, 50, 60]]  # -ay is reversed
        np.testing.assert_allclose(found.kelvin, celsius + 273.15)
    assert parser.malformed == 1  # the line with a semicolon


def test_the_file_of_the_run_gives_the_columns_of_a_stream_without_header(tmp_path: Path):
    run = run_of(tmp_path, NAMED)
    (tmp_path / "samples.csv").write_text("az;ax;ay;gx;gy;gz;t;temp\n" + "1,5;" * 7 + "2,5\n")
    found = TextRows(run, "test").feed(b"30;10;20;40;50;60;1,25;25\n")
    assert found is not None
    assert found.readings.tolist() == [[10, -20, 30, 40, 50, 60]]
    assert found.time.tolist() == [1.25]


def test_a_stream_without_the_columns_of_the_run_is_refused(tmp_path: Path):
    parser = TextRows(run_of(tmp_path, NAMED), "test")
    with refused(names=("ax",)):
        parser.feed("".join(lines(2)).encode())


def test_the_first_line_may_be_truncated_in_the_middle_of_a_stream(tmp_path: Path):
    parser = TextRows(run_of(tmp_path), "test")
    parser.restart(mid_stream=True)
    assert parser.feed(b"23,1,2,3,4,5") is None
    found = parser.feed(b",6\n1,1,2,3,4,5,6\n")
    assert found is not None
    assert found.time.tolist() == [1.0]
    parser.feed(b"2,1,2")
    parser.restart(mid_stream=True)
    assert parser.malformed == 1


def test_impossible_temperatures_and_counts_are_damaged_lines(tmp_path: Path):
    parser = TextRows(run_of(tmp_path, NAMED + "signed_bits = 16"), "test")
    rows = ["0,1,0,0,0,0,0,25", "1,65535,0,0,0,0,0,25", "2,1.5,0,0,0,0,0,25", "3,1,0,0,0,0,0,900"]
    found = parser.feed(("\n".join([HEADER, *rows]) + "\n").encode())
    assert found is not None
    assert found.readings[:, 0].tolist() == [1, -1]
    assert parser.malformed == 2


def test_the_user_is_told_once_that_no_line_can_be_read(tmp_path: Path):
    told: list[str] = []
    parser = TextRows(run_of(tmp_path), "test", tell=told.append)
    parser.feed("".join(lines(2)).encode())
    parser = TextRows(run_of(tmp_path), "test", tell=told.append)
    parser.feed(b"1,2,3,4,5,6,7\n1,2,3,4,5,6,7\n")
    assert told == []
    (tmp_path / "samples.csv").write_text("".join(lines(3)), encoding="utf-8")
    parser = TextRows(run_of(tmp_path), "test", tell=told.append)
    parser.feed(b"1;2;3;4;5;6;7\n" * 30)
    assert len(told) == 1
    assert parser.malformed == 30


def test_packets_have_the_readout_of_the_run_and_the_last_temperature(tmp_path: Path):
    layout = read_layout("fixed")
    run = run_of(tmp_path, NAMED.replace('"-ay"', '"ay"').replace('time = "t"', 'rate = "1 kHz"'))
    si = np.random.default_rng(0).normal(size=(20, 6))
    data = bytearray(encode(layout, si, temperature=np.full(20, 300.0)))
    size = len(data) // 20
    data[5 * size + 10] ^= 1  # damages the sixth packet
    parser = ArrivedPackets(run, layout)
    found = joined(list(map(parser.feed, pieces(bytes(data), 0))))
    units = np.array([9.80665] * 3 + [np.pi / 180] * 3)
    steps = [layout.accelerometer.size] * 3 + [layout.gyro.size] * 3
    kept = np.delete(si, 5, axis=0)
    assert np.all(np.abs(found.readings * units - kept) <= 0.5001 * np.array(steps))
    assert found.kelvin is not None
    np.testing.assert_allclose(found.kelvin, 300, atol=0.01)
    assert parser.malformed == 1
    assert parser.missing == 1


def test_packets_that_do_not_fit_the_run_are_refused(tmp_path: Path):
    with refused(file="run.toml"):  # -ay
        ArrivedPackets(run_of(tmp_path, NAMED), read_layout("fixed"))
