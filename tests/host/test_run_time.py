"""The run's time and the interlocks: no step of the host's date reaches either of them.

The bench is in this process and its time passes while the host sleeps; the host drives it by its
monotonic clock, as a bench of iron.
"""

from itertools import pairwise
from pathlib import Path
from random import Random

import pytest
from tests.base_seeds import evidence
from tests.host.in_process_bench import InProcessBench
from tests.host.simulated_runs import plan
from tests.host.watched_runs import (
    PATH,
    Killed,
    Watched,
    drive,
    in_rotation,
    kill_in_the_rotation,
)

from inercal.host.interlocks import LastChecks
from inercal.host.run_log import read_frames
from inercal.runfile import Run

HOUR = 3600.0


@pytest.fixture
def run(tmp_path: Path) -> Run:
    return plan(tmp_path / "plan", PATH)


@pytest.fixture
def bench(run: Run, monkeypatch: pytest.MonkeyPatch) -> InProcessBench:
    bench = InProcessBench(run)
    bench.install(monkeypatch)
    return bench


def detection_delay(folder: Path, bench: InProcessBench, jump: float, wait: float) -> float:
    """Resume, set the date by `jump` s and freeze an encoder; return the s until the run ends."""
    frozen: list[float] = []
    ended: list[float] = []

    def act(driven: Watched) -> None:
        rate = bench.device.controller.table.state.rate[0]
        if in_rotation(driven) and rate > 0.3 + wait and not frozen:
            bench.utc_step += jump
            bench.fault("frozen 1")
            frozen.append(bench.time)
        if driven.trouble and not ended:
            ended.append(bench.time)

    bench.utc_step += jump
    driven = drive(folder, act)
    bench.fault("frozen 1 off")
    bench.advance(60.0)
    assert frozen, driven.trouble
    return ended[0] - frozen[0]


def expect_detection(
    folder: Path, bench: InProcessBench, run: Run, jumps: list[float], seed: int
) -> None:
    kill_in_the_rotation(folder, bench, run)
    waits = Random(seed)
    delays: list[float] = []
    for jump in jumps:
        bench.advance(waits.uniform(0.0, 600.0))  # without a host
        delays.append(detection_delay(folder, bench, jump, waits.uniform(0.0, 0.2)))
    assert max(delays) <= 1.0, delays
    times = [frame.time for frame in read_frames(folder / "run.log")]
    assert min(after - before for before, after in pairwise(times)) > -0.5  # by time of arrival
    assert min(times) >= 0.0


@pytest.mark.parametrize("jump", [-HOUR, pytest.param(HOUR, marks=pytest.mark.slow)])
def test_a_frozen_encoder_is_found_within_a_second_of_a_step_of_the_date(
    tmp_path: Path, bench: InProcessBench, run: Run, jump: float
):
    expect_detection(tmp_path / "run", bench, run, [jump], seed=1)


@pytest.mark.evidence
def test_a_frozen_encoder_is_found_after_each_of_twenty_steps_of_the_date(
    tmp_path: Path, bench: InProcessBench, run: Run
):
    expect_detection(tmp_path / "run", bench, run, [-HOUR, HOUR] * 10, seed=2)


def rotate_once(driven: Watched) -> None:
    """Do nothing: the plan is carried out."""


@pytest.mark.slow
def test_a_run_goes_on_from_the_largest_time_in_its_log_by_as_long_as_it_had_no_host(
    tmp_path: Path, bench: InProcessBench, run: Run
):
    kill_in_the_rotation(tmp_path / "run", bench, run)
    before = max(frame.time for frame in read_frames(tmp_path / "run" / "run.log"))
    bench.advance(1000.0)
    bench.utc_step = -HOUR
    begun: list[float] = []
    resumed = drive(tmp_path / "run", lambda driven: begun.append(driven.time))
    assert resumed.done, resumed.trouble
    # The watchdog has taken 10 s to stop the table of the host that was killed.
    assert begun[0] == pytest.approx(before + 1010.0, abs=0.1)


@pytest.mark.parametrize("away", [evidence(0.5), pytest.param(700.0, marks=pytest.mark.slow)])
def test_a_host_that_was_started_anew_takes_the_time_of_the_tables_clock(
    tmp_path: Path, bench: InProcessBench, run: Run, away: float
):
    kill_in_the_rotation(tmp_path / "run", bench, run)
    bench.advance(away)
    bench.boot, bench.utc_step = "second", HOUR
    resumed = drive(tmp_path / "run", rotate_once)
    assert resumed.done, resumed.trouble


@pytest.mark.slow
def test_a_counter_that_began_anew_is_reported_before_anything_moves(
    tmp_path: Path, bench: InProcessBench, run: Run
):
    kill_in_the_rotation(tmp_path / "run", bench, run)
    bench.restart_imu()
    bench.advance(40.0)
    bench.commands.clear()
    resumed = drive(tmp_path / "run", rotate_once)
    assert not resumed.done
    assert "the IMU" in resumed.trouble
    assert not [line for line in bench.commands if "J=" in line or "HM" in line]


@pytest.mark.slow
def test_a_host_that_is_kept_from_its_interlocks_pauses_and_repeats_the_step(
    tmp_path: Path, bench: InProcessBench, run: Run
):
    late: list[float] = []

    def stall(driven: Watched) -> None:
        if in_rotation(driven) and not late:
            late.append(driven.time)
            bench.advance(0.6)

    driven = drive(tmp_path / "run", stall, run)
    assert driven.done, driven.trouble
    (warning, *_) = [event for event in driven.events if "the host stood still" in event.words]
    assert warning.time is not None
    assert warning.time - late[0] < 0.7


@pytest.mark.slow
def test_gyros_that_are_compared_no_more_stop_the_table_though_bytes_come(
    tmp_path: Path, bench: InProcessBench, run: Run
):
    spoiled: list[float] = []

    def spoil(driven: Watched) -> None:
        if in_rotation(driven) and not spoiled:
            spoiled.append(driven.time)
            bench.garbled = True
        elif spoiled and driven.pause_reason:
            # Samples of before wait for 0.3 s for the table's readings.
            assert driven.time - spoiled[0] < 0.3 + 0.5 + 0.2
            raise Killed

    with pytest.raises(Killed):
        drive(tmp_path / "run", spoil, run)
    assert spoiled


def test_an_interlock_is_overdue_when_it_has_not_run_for_its_interval():
    checks = LastChecks(table=0.5, gyros=0.5)
    checks.update(10.0)
    assert checks.trouble is None  # nothing is expected before it has begun
    checks.record("table", 10.0)
    checks.record("gyros", 10.1)
    checks.update(10.5)
    assert checks.trouble is None
    checks.update(10.51)
    assert checks.trouble is not None
    assert checks.trouble_since == 10.51
    checks.record("table", 10.6)
    checks.update(10.6)
    assert checks.trouble is None
    checks.pause("gyros")
    checks.update(11.0)
    assert checks.trouble is None
