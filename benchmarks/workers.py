"""Two workers against one: commands from start to end, and tasks of 100 ms.

The studies take their default number of trials. A budget with its default takes a few seconds, of
which the start of the program is 1 to 2 s and cannot be divided, so the budget has twenty times as
many trials here. Other work on the machine lengthens the times with two workers more than those
with one.
"""

import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks import ROOT, Duration, Row, Skipped
from benchmarks.start_up import processor_time
from inercal.basics.parallel import available_cores
from inercal.basics.parallel.isolated_executor import ProcessExecutor

REPEAT, OFTEN = 3, 8  # turns of commands, and of tasks
TO_REACH = 1.7  # times as fast by two workers
MORE_WORK = 1.1  # processor time of two workers, as a multiple of that of one
EFFICIENCY = 0.85  # of two workers, of tasks of 100 ms
TASK, TASKS = 0.1, 40  # s
ARM = ROOT / "examples" / "centrifuge" / "arm_run.toml"
JOBS = {
    "reproduce ship-model": ("reproduce", "ship-model"),
    "reproduce dual-orthogonal": ("reproduce", "dual-orthogonal"),
    "budget of a triad on an arm, 20000 trials": ("budget", ARM.name, "--trials", "20000"),
}


def compute_for(iterations: int) -> int:
    """Compute without waiting; return the process."""
    for _ in range(iterations):
        pass
    return os.getpid()


def rows() -> Iterator[Row | Skipped]:
    """Time the commands, then tasks in workers that have started; yield each row when it is."""
    if available_cores() < 2:
        yield Skipped("two workers", "this process may use one core")
        return
    with TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ARM.parent, folder, dirs_exist_ok=True)
        for work, verb in JOBS.items():
            yield from _job(work, verb, folder)
    yield _efficiency()


def _job(work: str, verb: tuple[str, ...], folder: Path) -> Iterator[Row]:
    """Compare the wall and processor time of a command with one worker and with two, by turns."""
    program, *rest = verb
    arguments = [folder / one if one.endswith(".toml") else one for one in rest]
    turns = [
        [_wall(program, *arguments, "--out", folder, "--workers", str(n)) for n in (1, 2)]
        for _ in range(REPEAT)
    ]
    one, two = (min(times) for times in zip(*turns, strict=True))
    peer = f"1 worker, {one.processor:.3g} s of processor"
    yield Row(f"{work}, 2 workers", two, one, peer, to_reach=TO_REACH)
    limit = MORE_WORK * min(one.processor for one, _ in turns)
    used = min(two.processor for _, two in turns)
    yield Row(f"{work}, 2 workers, CPU", used, limit, f"{MORE_WORK} × 1 worker")


def _wall(*arguments: str | Path) -> Duration:
    used = processor_time(*arguments)
    return Duration(used.wall, used.wall, used.processor)


def _efficiency() -> Row:
    """Compare tasks by two workers with half the time that one needs."""
    begin = time.perf_counter()
    compute_for(iterations := 1_000_000)
    iterations = round(iterations * TASK / (time.perf_counter() - begin))
    halves: list[float] = []
    shared: list[float] = []
    with ProcessExecutor(2, least_work=0.0) as executor:
        while _share(executor, iterations) < 2:  # until the other worker has started
            pass
        for _ in range(OFTEN):
            begin = time.perf_counter()
            for _ in range(TASKS):
                compute_for(iterations)
            halves.append((time.perf_counter() - begin) / 2)
            begin = time.perf_counter()
            assert _share(executor, iterations) == 2
            shared.append(time.perf_counter() - begin)
    name = f"{TASKS} tasks of {TASK * 1e3:.0f} ms by 2 workers"
    return Row(name, min(shared), min(halves), "half of 1 worker", to_reach=EFFICIENCY)


def _share(executor: ProcessExecutor, iterations: int) -> int:
    """Return how many processes took part in the tasks."""
    for _ in range(TASKS):
        executor.submit(compute_for, iterations)
    return len({process for _, process in executor.completed()})
