"""A line on a Dask cluster of separate processes, its recordings in an S3-like store."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest
from tests.fleet.lines import make_line, rows_of, write_table
from tests.program import run_program

from inercal.basics.parallel import SerialExecutor, open_executor, open_tolerant_executor
from inercal.basics.parallel.dask_executor import SchedulerLost
from inercal.fleet import results
from inercal.fleet.calibration import calibrate_line
from inercal.fleet.export import sensor_calibration
from inercal.fleet.line import read_line

distributed = pytest.importorskip("distributed")
pytest.importorskip("pyarrow")
pytestmark = pytest.mark.slow  # a cluster takes seconds to start
WORKERS = 3
ROOT = Path(__file__).parents[2]


class Cluster:
    """A scheduler with workers, each a process of its own."""

    def __init__(self, folder: Path, workers: int):
        self._known, self._folder = folder / "scheduler.json", folder
        self.scheduler = self._start("scheduler", "--port", "0")
        self._workers = [
            self._start("worker", "--nthreads", "1", "--death-timeout", "60")
            for _ in range(workers)
        ]
        with distributed.Client(scheduler_file=str(self._known), timeout=60) as client:
            client.wait_for_workers(workers, timeout=60)
            self.address: str = client.scheduler.address

    def _start(self, what: str, *arguments: str) -> "subprocess.Popen[bytes]":
        module = f"distributed.cli.dask_{what}"
        common = ["--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(self._known)]
        return subprocess.Popen(
            [sys.executable, "-m", module, *common, *arguments],
            # Tasks of tests are imported by their names.
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)},
            cwd=self._folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def kill_workers(self) -> None:
        """Kill the processes that compute; those that watch over them start others."""
        for process in self._workers:
            listed = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
            for one in listed.split():
                os.kill(int(one), signal.SIGKILL)

    def close(self) -> None:
        for process in (*self._workers, self.scheduler):
            process.terminate()
        for process in (*self._workers, self.scheduler):
            process.wait()


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Generator[str]:
    """Yield the address of a scheduler with three workers."""
    cluster = Cluster(tmp_path_factory.mktemp("cluster"), WORKERS)
    yield cluster.address
    cluster.close()


@pytest.fixture(scope="module")
def store() -> Generator[str]:
    """Yield the address of an S3-like server, of which this process and its children know."""
    server_module = pytest.importorskip("moto.server")
    pytest.importorskip("s3fs")
    server = server_module.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    address = f"http://{host}:{port}"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", address)
        patch.setenv("AWS_ACCESS_KEY_ID", "test")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "test")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        yield address
    server.stop()


def test_a_cluster_gives_the_same_rows_bit_for_bit(scheduler: str, tmp_path: Path):
    here, there = (make_line(tmp_path / name, 12) for name in ("here", "there"))
    assert run_program("fleet", "calibrate", here).status == 0
    ended = run_program("fleet", "calibrate", there, "--scheduler", scheduler, "--json")
    assert ended.status == 0, ended.error
    assert json.loads(ended.output)["done"] == 12
    assert rows_of(here) == rows_of(there)


def test_recordings_of_a_store_are_those_of_a_folder(store: str, tmp_path: Path):
    import s3fs

    folder = make_line(tmp_path / "line", 6)
    assert run_program("fleet", "calibrate", folder).status == 0
    of_folder = rows_of(folder)
    files = s3fs.S3FileSystem(endpoint_url=store)
    files.mkdir("line")
    names = [one.id for one in read_line(folder).rows]
    for name in names:
        files.put_file(str(folder / "recordings" / f"{name}.npz"), f"line/{name}.npz")
    write_table(folder, [(name, f"s3://line/{name}.npz") for name in names])
    assert run_program("fleet", "calibrate", folder, "--json").status == 0
    same = ("id", "value", "std", "covariance", "chi2", "grade", "recording_sha256")
    assert [[row[key] for key in same] for row in rows_of(folder)] == [
        [row[key] for key in same] for row in of_folder
    ]
    found = sensor_calibration(read_line(folder), folder / results.FOLDER, "S004")
    assert found.provenance["recording"] == "s3://line/S004.npz"
    kept = json.loads(run_program("fleet", "calibrate", folder, "--json").output)
    assert (kept["kept"], kept["done"]) == (6, 0)
    files.rm_file("line/S002.npz")
    gone = json.loads(run_program("fleet", "calibrate", folder, "--json").output)
    assert (gone["kept"], gone["failed"]) == (5, 1)


def test_a_scheduler_that_ends_is_said_and_the_fleet_goes_on(tmp_path: Path):
    folder = make_line(tmp_path / "line", 12)
    line = read_line(folder)
    (tmp_path / "cluster").mkdir()
    cluster = Cluster(tmp_path / "cluster", 1)
    try:
        with open_tolerant_executor(scheduler=cluster.address) as executor:

            def end(_: object) -> None:
                cluster.scheduler.kill()
                cluster.scheduler.wait()

            with pytest.raises(SchedulerLost):
                calibrate_line(line, executor, batch=1, progress=end)
    finally:
        cluster.close()
    with SerialExecutor() as executor:
        counts = calibrate_line(line, executor)
    assert counts.kept >= 1
    assert counts.kept + counts.done == 12
    other = make_line(tmp_path / "other", 12)
    assert run_program("fleet", "calibrate", other).status == 0
    assert rows_of(folder) == rows_of(other)


def test_other_heavy_work_runs_on_the_same_cluster(scheduler: str, tmp_path: Path):
    with open_executor(scheduler=scheduler) as executor:
        for k in range(20):
            executor.submit(pow, k, 2)
        assert sorted(executor.completed()) == [(k, k * k) for k in range(20)]


def test_a_scheduler_that_does_not_answer_is_one_line(tmp_path: Path):
    folder = make_line(tmp_path, 1)
    ended = run_program("fleet", "calibrate", folder, "--scheduler", "tcp://127.0.0.1:9")
    assert ended.status == 2
    both = run_program(
        "fleet", "calibrate", folder, "--scheduler", "tcp://127.0.0.1:9", "--workers", "2"
    )
    assert both.status == 2
