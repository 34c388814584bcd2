"""Readings of instruments on this machine: SCPI, lines that come by themselves, and what fails."""

import csv
import socket
from contextlib import ExitStack
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from tests.host.conftest import opened_by
from tests.host.guided_runs import Voltmeter, measure, readings, serve, six_positions
from tests.refusals import refused

from inercal.basics import errors
from inercal.basics.errors import InputError
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.drivers.visa import numbers_in_reply
from inercal.host.guided.instruments import LineInstrument, read_instruments
from inercal.host.link import LinkLost
from inercal.pipeline import calibrate

COUNT = 4


@pytest.fixture
def run_file(tmp_path: Path) -> Path:
    return six_positions(tmp_path)


def answers(values: list[list[float]], columns: slice) -> Voltmeter:
    """Return an instrument that answers READ? with the values, one after another."""
    rest = iter(values)

    def answer(line: str) -> str:
        return ",".join(f"{x:+.8E}" for x in next(rest)[columns]) + "\n" if line == "READ?" else ""

    return Voltmeter(answer)


def means(path: Path) -> np.ndarray:
    with path.with_name("sheet.csv").open(encoding="utf-8", newline="") as file:
        return np.array([row[1:] for row in csv.reader(file)][1:], dtype=float)


@pytest.mark.parametrize("terminal", [False, True], ids=["tcp", "serial"])
def test_scpi_readings_are_averaged_and_calibrated(run_file: Path, terminal: bool):
    values = readings(run_file, count=COUNT)
    with serve(answers(values, slice(0, 3)).answer, terminal=terminal) as server:
        done = measure(run_file, "-n", str(COUNT), "-i", server.address, given=["\n"] * 6)
    assert (done.status, done.error) == (0, "")
    expected = np.array(values).reshape(6, COUNT, 3).mean(axis=1)
    np.testing.assert_allclose(means(run_file), expected, rtol=0, atol=1e-8)
    assert calibrate(run_file).verdict.grade == "consistent"
    single = run_file.with_name("sheet.readings.csv").read_text(encoding="utf-8").splitlines()
    assert single[0] == "step,reading,ax,ay,az"
    assert len(single) == 1 + 6 * COUNT


def test_three_instruments_read_the_columns_in_order(run_file: Path):
    values = readings(run_file)
    with ExitStack() as stack:
        options: list[str] = []
        for k in range(3):
            server = stack.enter_context(serve(answers(values, slice(k, k + 1)).answer))
            options += ["-i", server.address]
        assert measure(run_file, *options, given=["\n"] * 6).status == 0
    np.testing.assert_allclose(means(run_file), values, rtol=0, atol=1e-8)


def test_a_far_mean_is_read_again_or_kept(run_file: Path):
    values = readings(run_file)
    wrong = [[-x for x in values[0]]]
    with serve(answers([*wrong, *values], slice(0, 3)).answer) as server:
        assert measure(run_file, "-i", server.address, given=["\n"] * 7).status == 0
    np.testing.assert_allclose(means(run_file), values, rtol=0, atol=1e-8)
    with serve(answers([*wrong, *values[1:]], slice(0, 3)).answer) as server:
        given = ["\n", "keep\n", *["\n"] * 5]
        assert measure(run_file, "--force", "-i", server.address, given=given).status == 0
    np.testing.assert_allclose(means(run_file)[0], wrong[0], rtol=0, atol=1e-8)


def test_what_no_instrument_reads_is_typed(tmp_path: Path):
    path = six_positions(tmp_path, ("[data.sd]", 'temperature = "T"\n[data.sd]'))
    values = readings(path)
    with serve(answers(values, slice(0, 3)).answer) as server:
        told = measure(path, "-i", server.address, given=[f"{20 + k}\n" for k in range(6)])
    assert told.status == 0
    assert means(path)[:, 3].tolist() == [20, 21, 22, 23, 24, 25]


def test_lines_that_come_by_themselves_are_read_whole():
    listener = socket.create_server(("127.0.0.1", 0))
    sent = Thread(target=_send_lines, args=(listener,))
    sent.start()
    address = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
    with LineInstrument(address, "", 5.0) as device:
        found = [device.read() for _ in range(3)]
    sent.join()
    assert found == [[1.0, 10.0], [2.0, 20.0], [3.0, 30.0]]


def _send_lines(listener: socket.socket) -> None:
    connection, _ = listener.accept()
    with listener, connection:
        for piece in (b"1.0;10.0 ", b"V\n2.0 2", b"0.0\r\n3.0,30", b".0\n"):
            connection.sendall(piece)


class Pieces:
    """A link that gives what is waiting, piece by piece."""

    address = "serial:/dev/x"

    def __init__(self, *pieces: bytes):
        self.pieces = list(pieces)

    def read(self, most: int, timeout: float) -> bytes:
        return self.pieces.pop(0) if self.pieces else b""

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...

    def __enter__(self) -> "Pieces":
        return self

    def __exit__(self, *_: object) -> None: ...


def test_what_came_before_and_the_rest_of_its_line_are_no_reading():
    link = Pieces(b"7.0\n8.", b"", b"5\n1.5\n2.5\n3.5\n9.")
    with opened_by(lambda _: link):
        device = LineInstrument("serial:/dev/x", "", 1.0)
    device.begin()
    assert [device.read(), device.read()] == [[1.5], [2.5]]
    link.pieces = [b"", b"5\n4.5\n"]
    device.begin()  # a line that was cut is waiting
    assert device.read() == [4.5]


def test_a_serial_device_may_begin_in_the_middle_of_a_line():
    with opened_by(lambda _: Pieces(b"", b"25\n1.5\n")):
        device = LineInstrument("serial:/dev/x", "", 1.0)
    device.begin()
    assert device.read() == [1.5]


def test_a_device_that_is_silent_ends_piped_lines_and_is_asked_again_by_somebody(run_file: Path):
    values, silent = readings(run_file), [True]

    def answer(line: str) -> str:
        if silent.pop() if silent else False:
            return ""
        return ",".join(map(str, values[0])) + "\n"

    with serve(answer) as server:
        options = ("-i", server.address, "--timeout", "0.05")
        done = measure(run_file, *options, given=["\n"])
        assert done.status == 2
        assert server.address in done.error
        silent.append(True)
        told = measure(run_file, *options, given=["\n", "\n", "quit\n"], typed=True)
    assert told.status == 130
    assert "1 of 6" in told.output


@pytest.mark.parametrize("reply", ["", "OVLD", "nan", "1.0 oops! 2.0", "1,inf"])
def test_what_is_no_reading_is_refused(reply: str):
    with refused(ProtocolError, names=("tcp://10.0.0.5:5025",)):
        numbers_in_reply(reply, "tcp://10.0.0.5:5025")


@pytest.mark.parametrize("reply", ["9.9E37", "+9.90000000E+37", "-9.9E37", "9.91E37", "1.0,9.9E37"])
def test_an_overload_is_refused(reply: str):
    with refused(InputError, names=("tcp://10.0.0.5:5025",)):
        numbers_in_reply(reply, "tcp://10.0.0.5:5025")


def test_another_number_of_values_than_columns_is_refused():
    with opened_by(lambda _: Pieces(b"1.0,2.0\n")):
        device = LineInstrument("tcp://x:1", "", 1.0)
    with refused(InputError, names=("tcp://x:1",)):
        read_instruments([device], ("ax", "ay", "az"), {})


def test_a_line_without_an_end_is_refused():
    with opened_by(lambda _: Pieces(b"1" * 3000, b"1" * 3000)):
        device = LineInstrument("tcp://x:1", "", 1.0)
    with pytest.raises(LinkLost):
        device.read()


def test_a_missing_pyserial_is_named_before_anything_is_written(
    run_file: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(__import__("sys").modules, "serial", None)
    done = measure(run_file, "-i", "serial:/dev/ttyUSB0", given=["\n"])
    assert done.status == 2
    assert "inercal[host]" in done.error
    assert issubclass(errors.MissingExtra, InputError)
    assert [one.name for one in run_file.parent.iterdir()] == ["run.toml"]
