"""Processor time of the command from its start to its end, user and system, of all its processes.

Each is the least of several runs: what else the machine does can only add to it.
"""

import ctypes
import os
import resource
import shutil
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks import ROOT, Duration, Row

REPEAT = 8
THREADS = "OPENBLAS_NUM_THREADS"
NO_BYTECODE = "PYTHONDONTWRITEBYTECODE"  # compiles 200 modules in each run, for .15 s
_SET_CHILD_SUBREAPER = 36  # of prctl(2)
PROGRAM = (sys.executable, "-m", "inercal")


def processor_time(*arguments: str | Path, status: int = 0, **environment: str) -> Duration:
    """Return the processor time, s, of the program with these arguments.

    The number of threads of linear algebra is the program's own choice unless it is given.
    """
    if sys.platform == "linux":  # processes that the program leaves become children of this one
        ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    inherited = {k: value for k, value in os.environ.items() if k not in (THREADS, NO_BYTECODE)}
    begin = time.perf_counter()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    program = subprocess.Popen(
        [*PROGRAM, *map(str, arguments)],
        env=inherited | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    _, errors = program.communicate()
    wall = time.perf_counter() - begin
    # The server of its workers ends after the program; its time counts once it was waited for.
    with suppress(ChildProcessError):
        while sys.platform == "linux":
            os.waitpid(-program.pid, 0)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert program.returncode == status, errors.decode()
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Duration(used, wall, used)


def least(*arguments: str | Path, status: int = 0, **environment: str) -> Duration:
    """Return the least processor time of several runs, s."""
    times = (processor_time(*arguments, status=status, **environment) for _ in range(REPEAT))
    return min(times)


def rows() -> list[Row]:
    """Time a six-row table, its report, a mistyped run file, and a recording of small matrices."""
    with TemporaryDirectory() as folder:
        run = Path(folder) / "run.toml"
        shutil.copytree(ROOT / "examples" / "six_position", folder, dirs_exist_ok=True)
        mistyped = run.with_name("mistyped.toml")
        text = run.read_text(encoding="utf-8")
        mistyped.write_text(text.replace("latitude", "lattitude"), encoding="utf-8")
        verb = ("calibrate", "--out", folder)
        processor_time(*verb, run)  # modules are compiled to bytecode by the first run
        return [
            Row("calibrate six means, no report", least(*verb, run, "--no-report"), 0.8, "limit"),
            Row("calibrate six means, with report", least(*verb, run), 1.8, "limit"),
            Row("refuse a mistyped run file", least(*verb, mistyped, status=2), 0.4, "limit"),
            one_thread(Path(folder)),
        ]


def one_thread(folder: Path) -> Row:
    """Compare the program's choice of threads of linear algebra with one thread."""
    run = folder / "ferraris" / "run.toml"
    shutil.copytree(ROOT / "examples" / "ferraris_simulated", run.parent)
    processor_time("simulate", run)
    verb = ("calibrate", run, "--out", run.parent, "--no-report")
    turns = [
        (processor_time(*verb), processor_time(*verb, OPENBLAS_NUM_THREADS="1"))
        for _ in range(REPEAT)
    ]
    own, single = (min(times) for times in zip(*turns, strict=True))
    name = "calibrate six positions and three turns"
    # The same work twice is equal within 10 %.
    return Row(name, own, single, "one BLAS thread", to_reach=0.9)
