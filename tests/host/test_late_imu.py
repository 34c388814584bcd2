"""A simulated IMU whose process was stopped comes back, and simulators end without a word."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Timer

import pytest
from tests.host.simulated_runs import Interfered, carried_out, plan

from inercal.host.bench_simulator import BenchSimulator
from inercal.host.link import open_link
from inercal.host.packets import read_layout
from inercal.host.packets.encode import PacketPacker
from inercal.host.sim import motion_link
from inercal.host.sim.bench_simulator import BenchDevice
from inercal.host.sim.imu_model import SimulatedImu
from inercal.host.sim.mimu import MotionServer, PacketSender
from inercal.host.sim.simulated_errors import SimulatedErrors, draw_errors
from inercal.runfile import Run, read

MIMU = Path(__file__).parents[2] / "examples" / "turntable" / "mimu.toml"
ANSWER_TIMEOUT = 0.01  # s


@pytest.fixture(scope="module")
def run() -> Run:
    return read(MIMU)


@pytest.fixture(scope="module")
def drawn(run: Run) -> SimulatedErrors:
    return draw_errors(run, 0)


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, socket.socket]]:
    """Return the table's end of the link to the IMU, and the IMU's."""
    mine, other = socket.socketpair()
    with mine, other:
        yield mine, other


def answer_all(imu: socket.socket, parts: int) -> list[float]:
    """Take so many parts of the motion, and answer each; return until when they are."""
    until: list[float] = []
    for _ in range(parts):
        part = motion_link.receive(imu)
        assert part is not None
        until.append(part.end_time)
        motion_link.send_byte_counts(imu, len(until))
    return until


def test_an_imu_that_does_not_answer_gets_all_motion_when_it_does(
    drawn: SimulatedErrors, ends: tuple[socket.socket, socket.socket]
):
    table, imu = ends
    bench = BenchDevice(drawn, table, ANSWER_TIMEOUT)
    for k in range(1, 11):
        bench.advance(0.1 * k)
    assert bench.time == pytest.approx(1.0, abs=1e-3)  # it waits for the IMU no longer
    assert bench.bytes_sent == 0
    until = answer_all(imu, 2)
    while len(until) < 11:  # the standing table first, then ten parts
        bench.advance(1.0)
        until += answer_all(imu, 1)
    bench.synchronise_imu()
    assert until == pytest.approx([0.1 * k for k in range(11)])
    assert bench.sent_until == pytest.approx(1.0)


def test_an_imu_that_is_late_for_minutes_is_given_up(
    drawn: SimulatedErrors, ends: tuple[socket.socket, socket.socket]
):
    table, _ = ends
    bench = BenchDevice(drawn, table, ANSWER_TIMEOUT)
    for k in range(1, 150):
        bench.advance(float(k))
    assert table.fileno() == -1
    assert bench.sent_until > 120.0


@pytest.fixture
def packets(run: Run, drawn: SimulatedErrors) -> tuple[SimulatedImu, PacketSender]:
    class NoPort:
        address = "nowhere"

        def write(self, data: bytes) -> int:
            return len(data)

        def close(self) -> None: ...

    packer = PacketPacker(read_layout("fixed"), 200.0)
    return SimulatedImu(run, drawn, 200.0, 60.0), PacketSender(packer, NoPort, 0)


@pytest.mark.parametrize("connected", [False, True])
def test_a_server_of_motion_ends_its_thread_whether_or_not_a_table_is_there(
    tmp_path: Path, packets: tuple[SimulatedImu, PacketSender], connected: bool
):
    listener, address = motion_link.listen(tmp_path / "motion")
    server = MotionServer(listener, [packets])
    if not connected:
        server.close()
        return
    with motion_link.connect(address, 5.0):
        server.close()


@pytest.mark.slow
def test_the_imus_process_ends_without_a_word_while_its_table_is_there(tmp_path: Path):
    command = [sys.executable, "-P", "-m", "inercal.host.sim.mimu", str(MIMU), "--rate", "200"]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [*command, "--folder", str(tmp_path)], stdin=pipe, stdout=pipe, stderr=pipe, text=True
    ) as process:
        assert process.stdin
        assert process.stdout
        _, imu, _, motion = process.stdout.readline().split()
        with motion_link.connect(motion, 5.0), open_link(imu):
            process.stdin.close()
            process.stdin = None
            _, said = process.communicate(timeout=20.0)
    assert (process.returncode, said) == (0, "")


@pytest.mark.slow
def test_a_run_goes_on_after_its_imu_was_stopped_for_five_seconds(tmp_path: Path):
    run = plan(tmp_path / "plan")
    with BenchSimulator(run.path, seed=1) as bench:
        imu = bench._processes["imu"].pid

        def stop(_: Interfered) -> None:
            os.kill(imu, signal.SIGSTOP)
            Timer(5.0, os.kill, (imu, signal.SIGCONT)).start()

        ended = carried_out(tmp_path / "run", bench, run, [("y up", "work", stop)])
    assert ended.done, ended.words
    assert [label for label, _, _ in ended.sections] == ["warm-up", "y up", "z+", "rest"]
