"""What a run survives, and what brings its table to rest: a killed server, a stop, Ctrl-C."""

import signal
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Event
from time import monotonic
from typing import Self

import pytest
from tests.host.journal_sections import sections_done
from tests.host.simulated_runs import INERCAL, SHORT, plan, quick
from tests.host.web.pages import COMPILING, RUNNING, SIMULATED, Page, Served, opened

from inercal.host.journal import Journal
from inercal.host.tasks import RunOptions
from inercal.host.web.run_request import RunProcess, RunRequest, run_in_progress
from inercal.laboratory.store import Register

pytestmark = pytest.mark.slow


class Serving:
    """`inercal bench serve` as a process."""

    def __init__(self, folder: Path, *options: str):
        for name in ("plans", "runs"):
            (folder / name).mkdir(exist_ok=True)
        where = ["--plans", str(folder / "plans"), "--runs", str(folder / "runs")]
        where += ["--register", str(folder / "register.db"), "--port", "0", *options]
        self._said = folder / "said.txt"
        # No pipe: the run's process keeps it open when the server is gone.
        with self._said.open("w") as said:
            command = [*INERCAL, "bench", "serve", *where]
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, text=True)
        assert self.process.stdout
        where_is = self.process.stdout.readline()
        assert where_is.startswith("the page is at http://127.0.0.1:"), self._said.read_text()
        self.port = int(where_is.strip().rstrip("/").rpartition(":")[2])

    def page(self) -> Page:
        return opened(self.port)

    def ended(self) -> str:
        """Wait for the end; return what was said on standard error."""
        self.process.communicate(timeout=60)
        return self._said.read_text()

    def killed(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.communicate(timeout=60)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.killed()


def wait_until(condition: Callable[[], object], patience: float = RUNNING) -> None:
    end, tick = monotonic() + patience, Event()
    while not condition():
        assert monotonic() < end
        tick.wait(0.02)


def state(folder: Path) -> str:
    with Journal(folder / "run.journal") as journal:
        return journal.header().state


def begun(page: Page, folder: Path) -> Path:
    """Start the run of the only plan; return its folder once the table does something."""
    page.operate("Ada")
    page.say("start", plan="plan", sensor=None, **SIMULATED)
    run = page.until("plan", COMPILING)["run"]
    page.until("state", COMPILING)
    return folder / "runs" / run


def until_turning(page: Page) -> None:
    """Hear the page until the table turns about z."""
    page.until("event", COMPILING, words="step 3 of 4: z+")
    moves = page.until("state")
    while abs(moves["table"]["axes"][0]["rate"]) < 20:
        moves = page.until("state")


def rests(page: Page) -> bool:
    """Tell whether the table stood when the page heard of it last."""
    last = [one for one in page.heard if one["kind"] == "state"][-1]
    return all(abs(axis["rate"]) < 0.1 for axis in last["table"]["axes"])


def test_a_run_whose_server_is_killed_goes_on_to_its_report(tmp_path: Path):
    plan(tmp_path / "plans", quick())
    with Serving(tmp_path) as serving, serving.page() as page:
        folder = begun(page, tmp_path)
        serving.killed()
    assert run_in_progress(folder)
    wait_until(lambda: not run_in_progress(folder))
    assert state(folder) == "done"
    assert (folder / "plan.report.html").is_file()
    with Register(str(tmp_path / "register.db")) as register:
        assert [run.state for run in register.runs()] == ["done"]


@pytest.mark.evidence
def test_a_server_started_anew_finds_the_run_stops_it_resumes_it_and_ends_with_it(tmp_path: Path):
    plan(tmp_path / "plans", SHORT.replace("outer,90,30", "outer,3600,30"))
    with Serving(tmp_path, "--speed", "20") as serving, serving.page() as page:
        folder = begun(page, tmp_path)
        serving.killed()
    with Serving(tmp_path, "--speed", "20") as serving, serving.page() as page:
        page.operate("Bob")
        page.say("start", plan="plan", sensor=None, **SIMULATED)
        assert "is active outside this page" in page.until("refused")["words"]
        page.say("stop", run=folder.name)
        wait_until(lambda: not run_in_progress(folder))
        assert state(folder) == "interrupted"
        page.say("resume", run=folder.name, table=None, imu=None)
        until_turning(page)
        serving.process.send_signal(signal.SIGINT)
        done = page.until("done")
        assert (done["state"], done["words"]) == ("interrupted", "stopped by the operator")
        assert rests(page)
        page.closed()
        assert "the run is being stopped" in serving.ended()
        assert serving.process.returncode == 0
    assert state(folder) == "interrupted"
    with Journal(folder / "run.journal") as journal:
        words = [event.words for event in journal.events()]
    assert len({one.partition("seed ")[2] for one in words if "seed" in one}) == 1
    assert words.count("stopped by the operator") == 2


def hurried(order: RunRequest) -> RunProcess:
    """Start a run on a bench that is 30 times as fast as a real one."""
    return RunProcess(replace(order, options=RunOptions(30.0)))


@pytest.mark.evidence
def test_any_viewer_stops_the_table_and_the_operator_may_resume(tmp_path: Path):
    plan(tmp_path / "plans", SHORT.replace("outer,90,30", "outer,720,30"))
    with Served(tmp_path, start=hurried) as served, served.page() as page:
        folder = begun(page, tmp_path)
        until_turning(page)
        with served.page() as other:
            other.until("state")
            other.say("stop")
            done = other.until("done")
        assert (done["state"], done["words"]) == ("interrupted", "stopped by the operator")
        page.until("done")
        assert rests(page)
        page.say("resume", run=folder.name, table=None, imu=None)
        page.until("plan", COMPILING)
        done = page.until("done", COMPILING)
        assert done["state"] in ("done", "carried out"), done
    with Journal(folder / "run.journal") as journal:
        labels = [label for label, _, _ in sections_done(journal)]
    assert labels == ["warm-up", "y up", "z+", "rest"]
