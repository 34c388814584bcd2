"""The order in which a run, what goes on beside it and what may take its time are left."""

import shutil
from collections.abc import Generator, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Self

import pytest
from tests.host.simulated_runs import plan

from inercal.basics.errors import InputError
from inercal.host.journal import Journal
from inercal.host.run_execution import RunInterrupted, execute_run
from inercal.host.run_folder import RunFolder, create_run


class Run:
    """Stands for a `BenchRun`; what is done is kept."""

    done: list[str]
    ends: bool
    fails = False
    trouble = ""
    needs_new_run = False

    def __init__(self, *_: object):
        Run.done.append("connected")

    def execute_plan(self) -> bool:
        Run.done.append("carried out")
        if Run.fails:
            raise InputError("no space left on device")
        return self.ends

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        Run.done.append("at rest")
        self.trouble = "stopped, and at rest"


@contextmanager
def kept(name: str) -> Generator[None]:
    Run.done.append(name)
    yield
    Run.done.append(f"{name} left")


@pytest.fixture
def begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[RunFolder, Journal]]:
    Run.done = []
    monkeypatch.setattr("inercal.host.run_execution.BenchRun", Run)
    addresses = ("pmac://10.0.0.5?motors=1,2,3&counts=3600000", "tcp://10.0.0.5:9?preset=fixed", "")
    made, journal = create_run(tmp_path / "run", plan(tmp_path / "plan"), addresses)
    with journal:
        yield made, journal


@pytest.mark.parametrize("ends", [True, False])
def test_a_table_rests_before_what_may_take_its_time_is_waited_for(
    begun: tuple[RunFolder, Journal], ends: bool
):
    Run.ends = ends
    with nullcontext() if ends else pytest.raises(RunInterrupted):
        execute_run(
            *begun, run_context=lambda _: kept("keys"), background_work=lambda: kept("register")
        )
    assert Run.done == [
        "connected", "keys", "register", "carried out", "keys left", "at rest", "register left"
    ]  # fmt: skip


def test_a_run_whose_end_no_disk_takes_may_go_on_later(
    begun: tuple[RunFolder, Journal], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(Run, "fails", True)
    with pytest.raises(RunInterrupted):
        execute_run(*begun)
    assert Run.done[-1] == "at rest"


@pytest.mark.parametrize("left", ["all", "no folder", "no path file", "no clocks"])
def test_resuming_is_offered_only_where_it_is_possible(
    begun: tuple[RunFolder, Journal], monkeypatch: pytest.MonkeyPatch, left: str
):
    made, journal = begun
    made.log.write_bytes(b"a log")
    monkeypatch.setattr(Run, "ends", False, raising=False)
    monkeypatch.setattr(Run, "fails", False)
    monkeypatch.setattr(Run, "needs_new_run", left == "no clocks")
    if left == "no folder":
        shutil.rmtree(made.path)
    elif left == "no path file":
        (made.path / "path.csv").unlink()
    with pytest.raises(RunInterrupted) as interrupted:
        execute_run(made, journal)
    assert interrupted.value.can_be_resumed == (left == "all")
    expected = {"all": "stopped, and at rest", "no clocks": "begin a new run"}
    assert expected.get(left, "cannot be resumed") in str(interrupted.value)
