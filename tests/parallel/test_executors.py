"""Executors: equal results in this process and in several, errors, and ends from outside."""

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from importlib import import_module
from inspect import signature
from multiprocessing import active_children
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_array_equal
from tests.parallel import tasks
from tests.refusals import refused
from tests.uncertainty.test_monte_carlo import run as random_trials

from inercal.basics.errors import InercalError, NotObserved
from inercal.basics.parallel import Executor, SerialExecutor, WorkerLost, in_order, open_executor
from inercal.basics.parallel.isolated_executor import ProcessExecutor
from inercal.estimation.uncertainty import monte_carlo

LIMIT = 20.0  # s, for what must not hang
DIES = getattr(signal, "SIGKILL", signal.SIGTERM)


def started(executor: ProcessExecutor) -> ProcessExecutor:
    """Return the executor after its other process has computed a task."""
    end = time.monotonic() + LIMIT
    executor.submit(tasks.process_and_square, 0)
    while {process for _, (process, _) in executor.completed()} <= {os.getpid()}:
        assert time.monotonic() < end
        for x in range(200):
            executor.submit(tasks.process_and_square, x)
    return executor


@pytest.fixture(scope="module")
def two_processes() -> Generator[ProcessExecutor]:
    """Return an executor whose second process has started."""
    with started(ProcessExecutor(2, least_work=0.0)) as executor:
        yield executor


@pytest.mark.slow
def test_every_index_comes_once_from_both_processes(two_processes: ProcessExecutor):
    indices = [two_processes.submit(tasks.process_and_square, x) for x in range(1000)]
    found = dict(two_processes.completed())
    assert sorted(found) == indices
    assert [found[index][1] for index in indices] == [x * x for x in range(1000)]
    assert len({process for process, _ in found.values()}) == 2


@pytest.mark.parametrize("executor", [SerialExecutor(), ProcessExecutor(2, least_work=0.0)])
def test_results_come_in_order_and_tasks_may_follow_on_results(executor: Executor):
    with executor:
        for x in range(5):
            executor.submit(tasks.process_and_square, x)
        results = in_order(executor)
        first = [next(results)[1] for _ in range(5)]
        executor.submit(tasks.process_and_square, 9)
        assert [*first, *(x for _, x in results)] == [0, 1, 4, 9, 16, 81]


def test_monte_carlo_gives_the_same_numbers_for_any_number_of_workers():
    alone = monte_carlo(random_trials, 1234, 5, batch=50)
    with ProcessExecutor(2, least_work=0.0) as executor:
        shared = monte_carlo(random_trials, 1234, 5, batch=50, executor=executor)
    for name, x in alone.items():
        assert_array_equal(x, shared[name])


def test_processes_that_are_asked_for_compute_all_tasks():
    before = set(active_children())
    with open_executor(3) as executor:
        executor.submit(tasks.process_and_square, 3)
        process, square = next(in_order(executor))
        assert (process != os.getpid(), square) == (True, 9)
    with open_executor():
        assert set(active_children()) <= before


def test_short_work_stays_in_this_process():
    with ProcessExecutor(4) as executor:
        for x in range(100):
            executor.submit(tasks.process_and_square, x)
        assert {process for process, _ in in_order(executor)} == {os.getpid()}


def test_what_cannot_be_pickled_runs_in_this_process(two_processes: ProcessExecutor):
    for x in range(6):
        two_processes.submit(lambda x: (os.getpid(), x), x)
    found = list(dict(sorted(two_processes.completed())).values())
    assert found == [(os.getpid(), x) for x in range(6)]


def test_another_process_has_one_thread_of_linear_algebra(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with started(ProcessExecutor(2, least_work=0.0)) as executor:
        for _ in range(200):
            executor.submit(tasks.threads_of_algebra)
        found = {str(told): process for _, (process, told) in executor.completed()}
    assert "OPENBLAS_NUM_THREADS" not in os.environ
    assert found["1"] != found.get("None", os.getpid()) == os.getpid()


def test_an_error_of_another_process_comes_back_with_its_attributes():
    with started(ProcessExecutor(2, least_work=0.0)) as executor:
        executor.submit(tasks.refuse, "k9")
        with pytest.raises(NotObserved) as found:
            list(executor.completed())
    error = found.value
    assert str(error) == "k9 is open"
    assert (error.directions, error.key, error.names) == (("k9 alone",), "[method]", ("k9",))


def test_of_several_errors_the_first_by_index_is_raised(tmp_path: Path):
    late = tmp_path / "late"
    with started(ProcessExecutor(2, least_work=0.0)) as executor:
        # The other process takes the first two of these, this one the third.
        executor.submit(tasks.refuse_after, "first", late)
        executor.submit(tasks.process_and_square, 1)
        executor.submit(tasks.note_and_refuse, "third", late)
        with pytest.raises(NotObserved) as found:
            list(executor.completed())
    assert found.value.names == ("first",)


def kinds_of_errors(base: type[InercalError]) -> Generator[type[InercalError]]:
    """Yield a class of errors and all that are derived from it."""
    yield base
    for kind in base.__subclasses__():
        yield from kinds_of_errors(kind)


def test_every_error_can_be_sent_from_process_to_process():
    modules = (
        "benches.turntable.reading",
        "host.bench_run",
        "host.drivers.pmac",
        "basics.parallel",
    )
    for name in modules:
        import_module(f"inercal.{name}")
    kinds = [kind for kind in kinds_of_errors(InercalError) if kind.__module__[:8] == "inercal."]
    assert len(kinds) >= 8
    for kind in kinds:
        more: dict[str, Any] = {"code": 7} if "code" in signature(kind).parameters else {}
        error = kind("what", **more).located(Path("x.toml"), line=3, key="k")
        error.names = ("a",)
        same = pickle.loads(pickle.dumps(error))
        assert type(same) is kind
        assert str(same) == str(error)
        assert repr(vars(same)) == repr(vars(error))


def test_a_killed_process_is_one_error_and_no_hang():
    begin = time.monotonic()
    with started(ProcessExecutor(2, least_work=0.0)) as executor:
        for _ in range(3):
            executor.submit(tasks.die_elsewhere, os.getpid())
        with pytest.raises(WorkerLost):
            list(executor.completed())
    assert time.monotonic() - begin < LIMIT


@pytest.mark.parametrize("workers", [0, -1])
def test_no_worker_is_refused(workers: int):
    with refused(key="--workers"):
        open_executor(workers)


def test_one_worker_needs_no_other_process():
    assert isinstance(open_executor(1), SerialExecutor)


@pytest.fixture
def waiting(tmp_path: Path) -> Generator[subprocess.Popen[str]]:
    """Return a program, two processes of which have been running tasks without end."""
    # A shell's background ignores interrupts, and what it starts would inherit that.
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.parallel.tasks", str(tmp_path)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    signal.signal(signal.SIGINT, before)
    end = time.monotonic() + LIMIT
    while len(list(tmp_path.iterdir())) < 2:
        assert time.monotonic() < end
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    yield process
    process.kill()
    process.communicate()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="a terminal's interrupt needs a group")
def test_an_interrupt_from_the_keyboard_is_one_line_and_leaves_no_process(
    waiting: subprocess.Popen[str],
):
    os.killpg(waiting.pid, signal.SIGINT)
    # Any process that is left would keep the pipes open.
    output, errors = waiting.communicate(timeout=LIMIT)
    assert (waiting.returncode, output, errors.splitlines()) == (130, "", ["inercal: stopped"])


BLOCKED = """
from multiprocessing import forkserver
from pathlib import Path
from inercal.basics.parallel.worker_process import WorkerContext
WorkerContext().prepare()
print(Path(f"/proc/{forkserver._forkserver._forkserver_pid}/status").read_text())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has a server")
def test_the_server_ignores_interrupts_from_its_first_instruction():
    ended = subprocess.run(
        [sys.executable, "-c", BLOCKED], capture_output=True, text=True, check=True
    )
    (blocked,) = (one.split()[1] for one in ended.stdout.splitlines() if one.startswith("SigBlk"))
    assert int(blocked, 16) >> (signal.SIGINT - 1) & 1


@pytest.mark.slow
def test_no_process_outlives_one_that_was_killed(waiting: subprocess.Popen[str]):
    os.kill(waiting.pid, DIES)
    waiting.communicate(timeout=LIMIT)
