"""Programs killed at any moment, and several at once: the register is sound and loses nothing."""

import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Timer
from time import monotonic

import numpy as np
import psycopg
import pytest
from tests.base_seeds import evidence
from tests.store.calibration_generator import DRIFTING, content, write

from inercal.laboratory.store import Register
from inercal.laboratory.store.connection import resolve_address

FEW = 10
FILES_PER_KILL = 12  # more than are entered before the kills are over
OF_RUN = 20  # files
# Forks a writer for each line that it is sent: the register's address, the folder, the number of
# the file to begin with, and of the statement before which the writer kills itself, 0 for none.
WRITER = """
import json, os, signal, sys
from pathlib import Path
from tempfile import TemporaryDirectory
from sqlalchemy import event
from sqlalchemy.engine import Engine
from inercal.physics.sensors import Noise, Readout, triad
from inercal.laboratory.store import Register, RunFacts

sensor = triad("MIMU № 17", "f", "a", Readout(1.0, 0.0, "m/s²"), Noise())

# What is imported when it is first used is there before the first fork.
with TemporaryDirectory() as warm, Register(f"{warm}/r.db") as register:
    register.enter_calibration(sys.argv[1])

def say(*words):
    # One write, which a kill leaves whole or undone.
    os.write(1, (" ".join(map(str, words)) + "\\n").encode())

def write(address, folder, first):
    say("writer", os.getpid())
    register = Register(address)
    for k in range(first, 10**6):
        path = Path(folder, f"{k}.calibration.json")
        if not path.exists():
            break
        if k % 2:
            say("calibration", register.enter_calibration(path), k)
        else:
            files = {f"{n}.h5": (n, f"{k}-{n}") for n in range(20)}
            bench = "turntable", ""
            facts = RunFacts(f"run {k}", sensor, *bench, "2026-01-01", "done", "", "", "", files)
            say("run", register.enter_run(facts, path), k)

def kill_before(statement):
    left = [statement]
    def count(*_):
        left[0] -= 1
        if not left[0]:
            os.kill(os.getpid(), signal.SIGKILL)
    event.listen(Engine, "before_cursor_execute", count)
    event.listen(Engine, "commit", count)

for line in sys.stdin:
    address, folder, first, statement = json.loads(line)
    child = os.fork()
    if not child:
        if statement:
            kill_before(statement)
        write(address, folder, first)
        os._exit(0)
    say("over", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


class Writers:
    """What forks writers, one after the other."""

    def __init__(self, folder: Path):
        self._process = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(folder / "0.calibration.json")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        )
        self.pid = self.status = 0

    def start(self, address: str, folder: Path, first: int = 0, statement: int = 0) -> None:
        """Fork a writer; it may be killed from now on."""
        assert self._process.stdin is not None
        line = json.dumps([address, str(folder), first, statement])
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()
        word, number = self._line()
        assert word == "writer"
        self.pid = int(number)

    def told(self) -> Iterator[tuple[str, int, int]]:
        """Give what the writer entered, kind, number and file, until it is over."""
        while True:
            word, *numbers = self._line()
            if word == "over":
                self.status = int(numbers[0])
                return
            yield word, int(numbers[0]), int(numbers[1])

    def _line(self) -> list[str]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line.endswith("\n")
        return line.split()

    def __enter__(self) -> "Writers":
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


def written(folder: Path, count: int) -> Path:
    """Write so many calibration files into a folder."""
    rng = np.random.default_rng(1)
    for k in range(count):
        write(folder / f"{k}.calibration.json", content(DRIFTING, k / 50, rng))
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder of a few calibration files."""
    return written(tmp_path_factory.mktemp("files"), FEW)


@pytest.fixture(scope="module")
def writers(folder: Path) -> Iterator[Writers]:
    with Writers(folder) as writers:
        yield writers


@pytest.fixture(scope="module")
def other(folder: Path) -> Iterator[Writers]:
    with Writers(folder) as writers:
        yield writers


def require_sound(address: str, told: set[tuple[str, int]]) -> None:
    """Prove that the database is sound, that all that was told is there, and nothing half."""
    file = resolve_address(address).file
    if file is not None:
        db = sqlite3.connect(file)
        assert db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert db.execute("PRAGMA foreign_key_check").fetchall() == []
        db.close()
    with Register(address) as register:
        calibrations, runs = register.calibrations(), register.runs()
        there = {("calibration", one.id) for one in calibrations}
        there |= {("run", one.id) for one in runs}
        assert told <= there
        for one in calibrations[-3:]:
            rows = register.coefficients(one.id)
            assert [row[1] for row in rows] == one.calibration.values.tolist()
        assert all(len(one.files) == OF_RUN for one in runs)


@pytest.mark.slow
@pytest.mark.parametrize("kills", [10, evidence(50)])
def test_kills_lose_nothing_and_leave_nothing_half(
    address: str, writers: Writers, tmp_path: Path, kills: int
):
    rng, count = random.Random(1), FILES_PER_KILL * kills
    files = tmp_path / "files"
    files.mkdir()
    written(files, count)
    told: set[tuple[str, int]] = set()
    first, tried, within = 0, 0, 0
    while within < kills:
        times: list[float] = []
        timer = Timer(0.0, print)
        until = rng.randrange(3, 5)
        writers.start(address, files, first)
        for kind, number, k in writers.told():
            told.add((kind, number))
            first = k + 1
            times.append(monotonic())
            if len(times) == until:
                # As long as the last one of its kind took is how long this write will take.
                wait = rng.uniform(0.0, times[-2] - times[-3])
                timer = Timer(wait, os.kill, (writers.pid, signal.SIGKILL))
                timer.start()
        timer.join()
        assert writers.status == -signal.SIGKILL
        tried, within = tried + 1, within + (len(times) == until)
        require_sound(address, told)
    print(f"{within} of {tried} kills within a write")
    # What was in hand when a writer was killed is entered by the next one.
    writers.start(address, files)
    last = [k for _, _, k in writers.told()]
    assert (writers.status, last) == (0, list(range(count)))
    require_sound(address, told)
    with Register(address) as register:
        assert len(register.calibrations()) == count
        assert len(register.runs()) == count // 2


@pytest.mark.parametrize(
    "address", ["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)], indirect=True
)
def test_a_kill_before_any_statement_of_a_write_leaves_all_or_nothing(
    address: str, writers: Writers, tmp_path: Path
):
    files = tmp_path / "files"
    files.mkdir()
    written(files, 1)
    outcomes: list[bool] = []
    Register(address).close()
    while not outcomes or writers.status:
        writers.start(address, files, statement=len(outcomes) + 1)
        told = list(writers.told())
        assert writers.status in (0, -signal.SIGKILL)
        assert not (told and writers.status)
        with Register(address) as register:
            runs, calibrations = register.runs(), register.calibrations()
            assert len(runs) == len(calibrations) == len(register.sensors())
            for one in calibrations:
                assert len(register.coefficients(one.id)) == 24
            assert all(len(one.files) == OF_RUN for one in runs)
        outcomes.append(bool(runs))
        assert len(outcomes) < 200
    assert outcomes == [False] * (len(outcomes) - 1) + [True]
    assert len(outcomes) > 20


@pytest.mark.slow
def test_two_programs_enter_the_same_at_once_and_it_is_there_once(
    address: str, folder: Path, writers: Writers, other: Writers
):
    # Nobody made the register before: both come to make its tables.
    writers.start(address, folder)
    other.start(address, folder)
    first, second = list(writers.told()), list(other.told())
    assert (writers.status, other.status) == (0, 0)
    assert len(first) == FEW
    assert first == second
    require_sound(address, {(kind, number) for kind, number, _ in first})
    with Register(address) as register:
        assert len(register.calibrations()) == FEW
        assert len(register.runs()) == FEW // 2


@pytest.mark.slow
def test_who_reads_sees_whole_calibrations_while_another_writes(
    address: str, folder: Path, writers: Writers
):
    seen = [0]
    with Register(address) as register:
        writers.start(address, folder)
        for _ in writers.told():
            found = register.calibrations()
            assert all(len(register.coefficients(one.id)) == 24 for one in found[-2:])
            seen.append(len(found))
    assert seen == sorted(seen)
    assert seen[-1] == FEW


@pytest.mark.slow
def test_a_server_that_breaks_off_between_two_writes_is_reached_again(database: str, folder: Path):
    paths = sorted(folder.iterdir())[:2]
    with Register(database) as register:
        register.enter_calibration(paths[0])
        with psycopg.connect(database, autocommit=True) as server:
            server.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                "WHERE pid <> pg_backend_pid() AND datname = current_database()"
            )
        assert register.enter_calibration(paths[1]) == 2
