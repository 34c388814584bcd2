"""The order in which a run, what goes on beside it and what may take its time are left."""

from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Self

import pytest
from tests.host.benches import plan

from inercal.host.carry import Interrupted, carried_out
from inercal.host.folder import begin


class Run:
    """Stands for a `BenchRun`; what is done is kept."""

    done: list[str]
    ends: bool
    trouble = ""

    def __init__(self, *_: object):
        Run.done.append("connected")

    def carry_out(self) -> bool:
        Run.done.append("carried out")
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


@pytest.mark.parametrize("ends", [True, False])
def test_a_table_rests_before_what_may_take_its_time_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ends: bool
):
    Run.done, Run.ends = [], ends
    monkeypatch.setattr("inercal.host.carry.BenchRun", Run)
    addresses = ("pmac://10.0.0.5?motors=1,2,3&counts=3600000", "tcp://10.0.0.5:9?preset=fixed", "")
    made, journal = begin(tmp_path / "run", plan(tmp_path / "plan"), addresses)

    with journal, nullcontext() if ends else pytest.raises(Interrupted, match="and at rest"):
        carried_out(
            made, journal, beside=lambda _: kept("keys"), meanwhile=lambda: kept("register")
        )
    assert Run.done == [
        "connected", "keys", "register", "carried out", "keys left", "at rest", "register left"
    ]  # fmt: skip
