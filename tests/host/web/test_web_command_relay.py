"""What is asked of a run's process reaches the run, whenever it comes."""

from typing import cast

import pytest

from inercal.host.bench_run import BenchRun
from inercal.host.web.worker import CommandRelay


class ReceivedBytes:
    """What a run is asked."""

    def __init__(self):
        self.all: list[str] = []

    def request(self, what: str) -> None:
        self.all.append(what)


def test_what_is_asked_before_there_is_a_run_is_handed_on_in_order():
    control, run = CommandRelay(), ReceivedBytes()
    for words in ("pause", "nonsense", "go on", "abort"):
        control.command(words)
    control.attach(cast(BenchRun, run))
    control.command("pause")
    assert run.all == ["pause", "go on", "stop", "pause"]


def test_a_signal_ends_what_moves_nothing_and_else_stops_the_run():
    control, run = CommandRelay(), ReceivedBytes()
    with pytest.raises(KeyboardInterrupt):
        control.interrupt()
    control.attach(cast(BenchRun, run))
    control.interrupt()
    assert run.all == ["stop"]
