"""What interrupts a run is stated once, with its cause and times, and is no fault of the table."""

import json
from collections.abc import Callable
from contextlib import suppress
from math import radians
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.host.in_process_bench import InProcessBench
from tests.host.simulated_runs import SHORT, made, plan
from tests.host.synthetic_log import LAYOUT
from tests.host.watched_runs import Driven, Killed, Watched, drive, in_rotation

from inercal.benches.turntable.reading.host_readback import (
    BENCH_GROUP,
    IMPLAUSIBLE_POLLS,
    INTERRUPTIONS,
    Interruption,
    are_interrupted,
    describe_interruptions,
)
from inercal.host.journal import Journal
from inercal.host.recorder import RunRecorder
from inercal.host.recording_writer import write_recording
from inercal.recordings.io.hdf5 import read_group
from inercal.runfile import Run

FULL_RATE = radians(25)  # rad/s
PATH = SHORT.replace("outer,90,30", "outer,180,30")
LASTED = 8.0  # s
JUMPED = "the IMU's counter is 25 s off: the IMU was restarted, or its counter has jumped"
Disturbance = Callable[[InProcessBench, Watched], None]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    return plan(tmp_path / "plan", PATH)


@pytest.fixture
def bench(run: Run, monkeypatch: pytest.MonkeyPatch) -> InProcessBench:
    bench = InProcessBench(run)
    bench.install(monkeypatch)
    return bench


def freeze(bench: InProcessBench, driven: Watched) -> None:
    bench.advance(LASTED)


def pause(bench: InProcessBench, driven: Watched) -> None:
    driven.request("pause")


def stop(bench: InProcessBench, driven: Watched) -> None:
    driven.request("stop")


def kill(bench: InProcessBench, driven: Watched) -> None:
    raise Killed


def jump(bench: InProcessBench, driven: Watched) -> None:
    bench.counter_error = 5000


def carry_out(folder: Path, bench: InProcessBench, run: Run, disturb: Disturbance) -> Driven:
    """Carry out a run that is disturbed while it turns at its full rate; resume it if need be."""
    times: list[float] = []

    def act(driven: Watched) -> None:
        rate = bench.device.controller.table.state.rate[0]
        if in_rotation(driven) and rate > FULL_RATE and not times:
            times.append(driven.time)
            disturb(bench, driven)
        elif times and driven.time > times[0] + LASTED:
            driven.request("go on")
            bench.counter_error = 0

    with suppress(Killed):
        driven = drive(folder, act, run)
        if driven.done:
            return driven
    return drive(folder, act)


@pytest.mark.parametrize(
    ("disturb", "cause"),
    [
        pytest.param(pause, "paused by the operator", marks=pytest.mark.slow),
        pytest.param(freeze, "the host stood still for 7.98 s", marks=pytest.mark.slow),
        evidence(stop, "stopped by the operator"),
        pytest.param(kill, "the host was not running", marks=pytest.mark.slow),
        pytest.param(jump, JUMPED, marks=pytest.mark.slow),
    ],
)
def test_an_interruption_is_stated_once_and_no_reading_of_the_stop_is_left_out(
    tmp_path: Path, bench: InProcessBench, run: Run, disturb: Disturbance, cause: str
):
    driven = carry_out(tmp_path / "run", bench, run, disturb)
    assert driven.done, driven.trouble
    assert not [event for event in driven.events if "no motion" in event.words]
    folder = made(tmp_path / "run")
    path = write_recording(folder.run, LAYOUT, folder.log, folder.path)
    told = read_group(path, BENCH_GROUP, ()).attributes
    assert told[IMPLAUSIBLE_POLLS] == 0
    ((start, end, why),) = json.loads(str(told[INTERRUPTIONS]))
    assert cause in why
    # The watchdog of this bench takes 10 s to stop the table of a host that was killed.
    shortest = LASTED - 0.1 if disturb in (pause, freeze) else 0.5
    assert shortest < end - start < LASTED + 15.0


@pytest.mark.slow
def test_steps_that_the_log_has_lost_are_repeated(tmp_path: Path, bench: InProcessBench, run: Run):
    path = tmp_path / "run"
    with suppress(Killed):
        drive(path, lambda driven: kill(bench, driven) if in_rotation(driven) else None, run)
    folder = made(path)
    content = folder.log.read_bytes()
    folder.log.write_bytes(content[: content.rindex(b'"done"') - 100])  # in the second step
    driven = drive(path, lambda _: None)
    assert driven.done, driven.trouble
    assert sum(event.level == "warning" and "step 2" in event.words for event in driven.events) == 1
    with Journal(folder.journal) as journal, RunRecorder(folder, journal, LAYOUT) as recorder:
        done = [one.label for one in recorder.assembly.sections.spans if one.state == "done"]
    assert done == ["warm-up", "y up", "z+", "rest"]


def test_only_gaps_in_an_interruption_are_explained_by_it():
    known = (Interruption(412.0, 455.0, "stopped by the operator"),)
    start, stop = np.array([100.0, 411.5, 430.0]), np.array([101.0, 455.6, 470.0])
    assert are_interrupted(start, stop, known).tolist() == [False, True, False]
    assert describe_interruptions(known) == (
        "the run was interrupted once: from 412 s to 455 s (stopped by the operator); the "
        "interrupted steps were repeated"
    )
    assert describe_interruptions(()) == ""
