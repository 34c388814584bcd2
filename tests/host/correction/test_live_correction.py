"""Live correction between real pipes, terminals and sockets of this machine."""

import contextlib
import json
import os
import pty
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from threading import Thread

import msgpack  # type: ignore[import-untyped]
import numpy as np
import pytest
from tests.host.correction.cases import NUMBERED, calibration_of, lines, run_of
from tests.program import run_program
from tests.refusals import refused

from inercal.calibration.files import save
from inercal.host.correction import LiveCorrection, LiveSummary, open_correction
from inercal.host.correction.outputs import FORMATS, Output, TcpOutput, csv_format
from inercal.host.correction.sources import Source
from inercal.host.correction.text_rows import TextRows
from inercal.host.link import LinkLost
from inercal.pipeline.live_correction import CorrectedBlock, LiveCorrector

WAIT = 60.0  # s; a busy machine starts a program slowly


def read_until(end: int | socket.socket, done: bytes, count: int = 1) -> bytes:
    """Return what arrives until it contains `done` so many times."""
    data = b""
    while data.count(done) < count:
        ready, _, _ = select.select([end], [], [], WAIT)
        assert ready, data[-200:]
        more = end.recv(1 << 16) if isinstance(end, socket.socket) else os.read(end, 1 << 16)
        assert more, data[-200:]
        data += more
    return data


class Running:
    """A correction in a thread, and the descriptor from which its output is read."""

    def __init__(self, corrector: LiveCorrector, address: str, output: Output | None = None):
        self.output, self._end = os.pipe()
        self.told: list[str] = []
        format = csv_format(corrector.names)
        parser = TextRows(corrector.run, address)
        target = Output(format, self._end) if output is None else output
        self.correction = LiveCorrection(
            corrector, Source(address), parser, target, self.told.append
        )
        self._thread = Thread(target=self.correction.run)
        self._thread.start()

    def stop(self) -> LiveSummary:
        self.correction.stop()
        self._thread.join(WAIT)
        assert not self._thread.is_alive()
        return self.correction.summary

    def close(self) -> None:
        self.stop()
        os.close(self.output)
        os.close(self._end)


@pytest.fixture
def corrector(tmp_path: Path) -> LiveCorrector:
    run = run_of(tmp_path)
    return LiveCorrector(calibration_of(run), run)


@contextlib.contextmanager
def running(
    corrector: LiveCorrector, address: str, output: Output | None = None
) -> Generator[Running]:
    one = Running(corrector, address, output)
    try:
        yield one
    finally:
        one.close()


def listener() -> socket.socket:
    made = socket.create_server(("127.0.0.1", 0))
    made.settimeout(WAIT)
    return made


def test_no_sample_of_a_terminal_is_lost(corrector: LiveCorrector):
    device, terminal = pty.openpty()
    try:
        with running(corrector, os.ttyname(terminal)) as live:
            read_until(live.output, b"\n")  # the header
            for part in ["\n", *lines(200)]:
                os.write(device, part.encode())
            came = read_until(live.output, b"\n", 200)
            summary = live.stop()
    finally:
        os.close(device)
        os.close(terminal)
    times = [float(line.split(b",")[0]) for line in came.splitlines()]
    assert times == [k / 1000 for k in range(200)]
    assert (summary.samples, summary.malformed, summary.lost, summary.reconnections) == (
        200, 0, 0, 0,
    )  # fmt: skip


def test_a_lost_connection_is_opened_again_and_its_truncated_line_counted(
    corrector: LiveCorrector,
):
    with listener() as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with running(corrector, address) as live:
            for truncated in ("7,1,2", ""):
                device, _ = server.accept()
                with device:
                    device.sendall(("".join(lines(5)) + truncated).encode())
                    read_until(live.output, b"\n", 5)
            summary = live.stop()
    assert (summary.samples, summary.malformed) == (10, 1)
    assert summary.reconnections >= 1
    assert len(live.told) >= 2  # lost, and opened again


def test_datagrams_need_no_line_ends(corrector: LiveCorrector):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with running(corrector, f"udp://:{port}") as live:
        read_until(live.output, b"\n")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
            for row in lines(20):
                device.sendto(row.strip().encode(), ("127.0.0.1", port))
        read_until(live.output, b"\n", 20)
        assert live.stop().samples == 20


def test_every_reader_of_a_port_gets_the_header_and_the_samples(corrector: LiveCorrector):
    output = TcpOutput("tcp://:0", csv_format(corrector.names))
    host, _, port = output.address.removeprefix("tcp://").partition(":")
    assert host == "127.0.0.1"
    with listener() as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with running(corrector, address, output):
            device, _ = server.accept()
            place = (host, int(port))
            with device, socket.create_connection(place) as one:
                assert read_until(one, b"\n").startswith(b"time,")
                with socket.create_connection(place) as other:
                    assert read_until(other, b"\n").startswith(b"time,")
                    device.sendall("".join(lines(3)).encode())
                    assert read_until(one, b"\n", 3) == read_until(other, b"\n", 3)
                # The other reader is gone, and the first one still gets what comes.
                device.sendall("".join(lines(50)).encode())
                read_until(one, b"\n", 50)


def blocks(count: int, size: int) -> list[CorrectedBlock]:
    values = np.zeros((size, 6))
    flags = np.zeros(size, np.uint8)
    return [
        CorrectedBlock(np.linspace(k, k + size - 1, size), values, flags)
        for k in range(0, count, size)
    ]


@pytest.mark.parametrize("form", FORMATS)
def test_a_slow_reader_loses_the_oldest_samples_and_is_told_how_many(form: str):
    count, most = 20_000, 500
    reading, writing = os.pipe()
    output = Output(FORMATS[form](["fx", "fy", "fz", "wx", "wy", "wz"]), writing, most)
    for block in blocks(count, 10):
        output.put(block)
        output.flush()
    data = b""
    while not output.readers[0].is_idle:
        data += os.read(reading, 1 << 16)
        output.flush()
    os.close(writing)
    while more := os.read(reading, 1 << 16):
        data += more
    os.close(reading)
    times, told = decoded(form, data)
    assert told == output.lost > 0
    assert len(times) + told == count
    assert times[-most:] == [float(k) for k in range(count - most, count)]
    assert times == sorted(times)


def decoded(form: str, data: bytes) -> tuple[list[float], int]:
    """Return the times and the number of lost samples that a reader finds in its data."""
    if form == "csv":
        rows = data.decode().splitlines()[1:]
        lost = [int(row.split()[2]) for row in rows if row[0] == "#"]
        return [float(row.split(",")[0]) for row in rows if row[0] != "#"], sum(lost)
    if form == "json":
        objects = [json.loads(line) for line in data.splitlines()]
    else:
        unpacker = msgpack.Unpacker()
        unpacker.feed(data)
        objects = list(unpacker)
    times = [one["time"] for one in objects if "time" in one]
    return times, sum(one.get("lost", 0) for one in objects)


@pytest.mark.parametrize("form", FORMATS)
def test_a_missing_value_is_empty_and_the_others_have_nine_digits(form: str):
    values = np.array([[1 / 3, np.nan], [1e-7 / 3, 2.0]])
    block = CorrectedBlock(np.array([0.5, 0.75]), values, np.array([8, 0], np.uint8))
    data = FORMATS[form](["fx", 'temperature [%"°C"]']).block(block)
    if form == "csv":
        assert data == b"0.5000000,0.333333333,,8\n0.7500000,3.33333333e-08,2,0\n"
        return
    if form == "json":
        first, second = map(json.loads, data.splitlines())
    else:
        unpacker = msgpack.Unpacker()
        unpacker.feed(data)
        first, second = unpacker
    assert list(first) == ["time", "fx", 'temperature [%"°C"]', "flags"]
    assert first["fx"] == pytest.approx(1 / 3, abs=1e-9)
    assert list(first.values())[2:] == [None, 8]
    assert second["flags"] == 0


def program_files(tmp_path: Path) -> tuple[str, str]:
    run = run_of(tmp_path)
    save(calibration_of(run), tmp_path / "imu.calibration.json")
    return str(tmp_path / "imu.calibration.json"), str(run.path)


@pytest.mark.slow
def test_ctrl_c_ends_with_a_summary_and_status_0(tmp_path: Path):
    command = [sys.executable, "-m", "inercal", "apply", *program_files(tmp_path), "--stream", "-"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        os.write(program.stdin.fileno(), ("".join(lines(7)) + "damaged\n").encode())
        read_until(program.stdout.fileno(), b"\n", 8)
        program.send_signal(signal.SIGINT)
        _, said = program.communicate(timeout=WAIT)
    assert program.returncode == 0
    assert said.decode().startswith("inercal: 7 samples, 0 flagged, 1 malformed, 0 missing, 0 lost")


@pytest.mark.slow
def test_a_closed_pipe_ends_the_program_quietly(tmp_path: Path):
    source = tmp_path / "long.csv"
    source.write_text("".join(lines(20_000)), encoding="utf-8")
    command = [sys.executable, "-m", "inercal", "apply", *program_files(tmp_path)]
    with subprocess.Popen(
        [*command, "--stream", str(source)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as program:
        assert program.stdout is not None
        read_until(program.stdout.fileno(), b"\n", 100)
        program.stdout.close()
        assert program.stderr is not None
        said = program.stderr.read().decode()
    assert program.returncode == 0
    assert said.count("\n") == 1


def test_a_file_waits_for_its_reader(tmp_path: Path, corrector: LiveCorrector):
    source = tmp_path / "long.csv"
    source.write_text("".join(lines(30_000)), encoding="utf-8")
    with running(corrector, str(source)) as live:
        read_until(live.output, b"\n", 30_001)
        assert live.stop().lost == 0


WRONG = {
    "no such file": ["--stream", "nothing.csv"],
    "a folder": ["--stream", "."],
    "no port": ["--stream", "tcp://127.0.0.1"],
    "not a port of this machine": ["--stream", "udp://192.0.2.1:5000"],
    "a file as serial port": ["--stream", "serial:run.toml"],
    "a port of a file": ["--stream", "run.toml?baud=9600"],
    "another format": ["--stream", "-", "--format", "xml"],
    "not an address": ["--stream", "-", "--to", "stdout"],
    "an output of another machine": ["--stream", "-", "--to", "tcp://192.0.2.1:5000"],
    "an unknown preset": ["--stream", "tcp://127.0.0.1:5000?preset=nope"],
    "a file to write": ["--stream", "-", "--out", "corrected.csv"],
    "no source": ["--to", "tcp://127.0.0.1:5000", "--out", "corrected.csv"],
    "nothing": [],
    "not text": ["--stream", "imu.calibration.json"],
    "no samples": ["--stream", "empty.csv"],
}


@pytest.mark.parametrize("arguments", WRONG.values(), ids=WRONG)
def test_wrong_arguments_are_one_line_and_status_2(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    files = program_files(tmp_path)
    (tmp_path / "empty.csv").write_text("1,2,3,4,5,6\n" * 20, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert run_program("apply", *files, *arguments).status == 2


def test_a_port_that_nobody_opened_is_refused(tmp_path: Path):
    run = run_of(tmp_path, NUMBERED)
    with listener() as server:
        port = server.getsockname()[1]
    with refused(LinkLost, names=(f"tcp://127.0.0.1:{port}",)):
        open_correction(calibration_of(run), run, f"tcp://127.0.0.1:{port}")
