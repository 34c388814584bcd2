"""A second program at the table of a run: a run, a page with its own folder of runs, by hand."""

import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Event
from time import monotonic

import pytest
from tests.host.journal_sections import sections_done
from tests.host.simulated_runs import INERCAL, SHORT, plan

from inercal.basics.errors import InputError
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.journal import Journal
from inercal.host.run_folder import JOURNAL
from inercal.host.web.run_request import ManualRequest, ProcessRequest, RunRequest

PATIENCE = 300.0  # s
WORKER = "inercal.host.web.worker"
MANUAL_WORKER = "inercal.host.web.manual_worker"


def wait_until(folder: Path, is_so: Callable[[Journal], bool]) -> None:
    end, tick = monotonic() + PATIENCE, Event()
    while monotonic() < end:
        with suppress(InputError), Journal(folder / JOURNAL) as journal:  # it may be in the making
            if is_so(journal):
                return
        tick.wait(0.05)
    raise AssertionError("the run does not go on")


def by_page(module: str, order: ProcessRequest) -> str:
    """Have a page's process carry out an order; return what it tells."""
    Path(order.folder).parent.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(
        [sys.executable, "-P", "-m", module],
        input=order.json_line + "\n", capture_output=True, text=True, timeout=PATIENCE,
        check=False,
    )  # fmt: skip
    return done.stdout + done.stderr


@pytest.mark.evidence
def test_ten_programs_at_the_table_of_a_run_are_refused_and_it_is_unharmed(tmp_path: Path):
    # The last step outlasts all that is tried.
    run = plan(
        tmp_path / "plan", SHORT.replace("rest,position,0,0,0,2", "rest,position,0,0,0,9000")
    )
    with BenchSimulator(run.path, seed=1) as bench:
        where = ["--table", bench.table, "--imu", bench.imu, "--clock", str(bench.clock)]
        command = [*INERCAL, "bench", "run", str(run.path), "--speed", "5"]
        first = subprocess.Popen(
            [*command, *where, "--out", str(tmp_path / "first")],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            wait_until(tmp_path / "first", lambda journal: journal.header().state == "running")
            said: list[str] = []
            for k, host in enumerate(("127.0.0.1", "localhost", "127.1", "127.0.0.1")):
                where[1] = bench.table.replace("127.0.0.1", host)
                out = tmp_path / f"run{k}"
                second = subprocess.run(
                    [*command, *where, "--out", str(out)],
                    capture_output=True, text=True, timeout=PATIENCE, check=False,
                )  # fmt: skip
                assert second.returncode == 2
                assert not out.exists()
                said.append(second.stderr)
            table, imu, clock = bench.table, bench.imu, str(bench.clock)
            for k in range(3):
                order = RunRequest(
                    str(tmp_path / f"served{k}" / "run"),
                    plan=str(run.path),
                    table=table,
                    imu=imu,
                    clock=clock,
                )
                said.append(by_page(WORKER, order))
                assert not Path(order.folder).exists()
                folder = str(tmp_path / f"served{k}" / "hand")
                by_hand = ManualRequest(folder, "Ada", table, imu, clock, plan=str(run.path))
                said.append(by_page(MANUAL_WORKER, by_hand))
            wait_until(tmp_path / "first", lambda journal: len(sections_done(journal)) == 3)
            assert first.poll() is None
        finally:
            first.send_signal(signal.SIGINT)
            output, _ = first.communicate(timeout=PATIENCE)
    assert len(said) == 10
    assert all(
        "another program commands the table" in words and str(tmp_path / "first") in words
        for words in said
    ), said
    with Journal(tmp_path / "first" / JOURNAL) as journal:
        assert [label for label, _, _ in sections_done(journal)] == ["warm-up", "y up", "z+"]
        events = [one.words for one in journal.events() if one.level in ("warning", "alarm")]
    # The plan is too short for all coefficients, which is said before anything moves.
    assert events[-1:] == ["stopped by the operator"], output
    assert all(words.startswith("the plan does not determine") for words in events[:-1]), output
