"""Clusters that cannot be used are one line, this machine needs none, and a station waits."""

import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest
from tests.fleet.lines import make_line, rows_of, write_recording
from tests.fleet.test_fleet_cluster import Cluster
from tests.program import run_program

from inercal.basics.parallel import SerialExecutor, open_executor, open_tolerant_executor
from inercal.basics.parallel.isolated_executor import IsolatedExecutor
from inercal.cli import options
from inercal.fleet import results
from inercal.fleet.station import arriving_files

pytest.importorskip("distributed")
pytest.importorskip("pyarrow")


@pytest.mark.parametrize(
    "address",
    ["tcp://127.0.0.1", "tcp://:8786", "tcp://a:99999", "tcp://a b:1", "ucx://a:1", "tls://a:0"],
)
def test_an_address_that_is_none_is_one_line(tmp_path: Path, address: str):
    folder = make_line(tmp_path, 1)
    ended = run_program("fleet", "calibrate", folder, "--scheduler", address)
    assert (ended.status, "tcp://HOST:PORT" in ended.error) == (2, True)


def test_tls_without_certificates_names_the_settings(tmp_path: Path):
    folder = make_line(tmp_path, 1)
    ended = run_program("fleet", "calibrate", folder, "--scheduler", "tls://127.0.0.1:9")
    assert ended.status == 2
    assert "distributed.comm.tls.client.cert" in ended.error
    assert not (folder / results.FOLDER).exists()


def test_this_machine_is_processes_that_open_no_port():
    with open_tolerant_executor(2, "local") as executor:
        assert isinstance(executor, IsolatedExecutor)
        assert executor.workers == 2
    assert isinstance(open_executor(1, "local"), SerialExecutor)


@pytest.mark.parametrize(("user", "warned"), [(0, True), (1000, False)])
def test_root_is_warned(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], user: int, warned: bool
):
    monkeypatch.setattr(options.os, "geteuid", lambda: user, raising=False)
    options.warn_of_root(None)
    assert not capsys.readouterr().err
    for scheduler in ("local", "tcp://127.0.0.1:8786"):
        options.warn_of_root(scheduler)
        assert ("root" in capsys.readouterr().err) is warned


def test_a_station_survives_files_that_vanish_and_a_folder_that_is_away(tmp_path: Path):
    inbox, away = tmp_path / "inbox", tmp_path / "away"
    for k in range(4):
        write_recording(inbox / f"{k}.npz", k)
    said: list[str] = []
    polls = 0

    def poll() -> bool:
        nonlocal polls
        polls += 1
        if polls == 1:
            (inbox / "1.npz").unlink()
        if polls == 3:
            inbox.rename(away)
        if polls == 6:
            write_recording(away / "9.npz", 9)
            away.rename(inbox)
        if polls == 9:
            os.utime(inbox / "0.npz")  # touched, not changed
        return polls < 12

    arrived: list[str] = []
    for path in arriving_files(inbox, poll, say=said.append):
        arrived.append(path.name)
        if path.name == "2.npz":
            (inbox / "3.npz").unlink()  # while another one is calibrated
    assert arrived == ["0.npz", "2.npz", "9.npz"]
    assert [text.removeprefix(f"{inbox} ") for text in said] == [
        "cannot be read; waiting for it", "can be read again"
    ]  # fmt: skip


def start(folder: Path, address: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "inercal", "fleet", "calibrate", str(folder)]
    return subprocess.Popen([*command, "--scheduler", address], stderr=subprocess.PIPE, text=True)


@pytest.fixture
def silent() -> Generator[str]:
    """Yield the address of a server that accepts connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"


@pytest.mark.slow
def test_a_scheduler_that_is_silent_is_one_line(tmp_path: Path, silent: str):
    _, error = start(make_line(tmp_path, 1), silent).communicate(timeout=120)
    assert error.count("\n") == 1
    assert "no Dask scheduler answers" in error


@pytest.mark.evidence
@pytest.mark.parametrize("seconds", [0.3, 0.8, 1.2, 1.6, 2.0, 2.5, 3.0, 4.0])
@pytest.mark.parametrize("killed", ["scheduler", "worker", "client"])
def test_kills_while_a_cluster_starts_are_one_line(tmp_path: Path, seconds: float, killed: str):
    (tmp_path / "cluster").mkdir()
    folder = make_line(tmp_path / "line", 12)
    cluster = Cluster(tmp_path / "cluster", 2)
    try:
        process = start(folder, cluster.address)
        victim = process if killed == "client" else cluster.scheduler
        try:
            process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            if killed == "worker":
                cluster.kill_workers()
            else:
                victim.send_signal(signal.SIGINT if killed == "client" else signal.SIGKILL)
        _, error = process.communicate(timeout=200)
    finally:
        cluster.close()
    assert "Traceback" not in error
    assert len([line for line in error.splitlines() if "warning" not in line]) <= 1, error
    shutil.rmtree(folder / results.FOLDER, ignore_errors=True)
    assert run_program("fleet", "calibrate", folder).status == 0
    assert len(rows_of(folder)) == 12
