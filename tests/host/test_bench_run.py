"""Runs on a simulated bench: what they leave, and what becomes of them when things go wrong."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.host.simulated_runs import SHORT, Act, Ended, Interfered, carried_out, made, plan

from inercal.host.addresses import open_table
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.drivers.rotary_table import ProtocolError, TableState
from inercal.host.preparation import precompile_run
from inercal.host.run_log import IMU, read_frames
from inercal.host.tasks import RunOptions


class Bench(NamedTuple):
    """A bench that was new when its first run was carried out on it; others may follow."""

    bench: BenchSimulator
    folder: Path
    first: Ended


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    folder = tmp_path_factory.mktemp("first")
    run = plan(folder / "plan")
    precompile_run(run)
    with BenchSimulator(run.path, seed=1) as bench:
        yield Bench(bench, folder / "run", carried_out(folder / "run", bench, run))


@pytest.fixture
def bench(shared: Bench) -> BenchSimulator:
    """Return a bench that others have used: what a test breaks it mends."""
    return shared.bench


@pytest.fixture
def broken(tmp_path: Path) -> Iterator[BenchSimulator]:
    """Return a bench of the test's own, whose table may be broken for good."""
    with BenchSimulator(plan(tmp_path / "plan").path, seed=1) as bench:
        yield bench


def at_rest(bench: BenchSimulator) -> bool:
    with open_table(bench.table, None) as table:
        return all(abs(axis.rate) < 1e-3 for axis in table.read().axes)


def run_with(tmp_path: Path, bench: BenchSimulator, label: str, phase: str, act: Act) -> Ended:
    run = plan(tmp_path / "plan")
    return carried_out(tmp_path / "run", bench, run, [(label, phase, act)])


@pytest.mark.slow
def test_a_run_does_its_steps_in_order_and_leaves_no_packet_out(shared: Bench):
    ended = shared.first
    assert ended.done, ended.words
    assert ended.words == ""
    assert [label for label, _, _ in ended.sections] == ["warm-up", "y up", "z+", "rest"]
    assembly = ended.run.recorder.assembly
    assert (
        assembly.imu.counts.lost,
        assembly.imu.counts.failed,
        assembly.imu.counts.discarded,
    ) == (0, 0, 0)
    assert ended.run.recorder.live_estimator is not None
    assert ended.run.recorder.live_estimator.has_estimate
    assert ended.run.recorder.estimation == "on"
    assert at_rest(shared.bench)


@pytest.mark.slow
def test_how_fast_a_bench_is_run_changes_no_byte_and_no_number(tmp_path: Path, shared: Bench):
    run = plan(tmp_path / "plan")
    with BenchSimulator(run.path, seed=1) as bench:
        slow = carried_out(tmp_path / "run", bench, run, options=RunOptions(speed=40.0))
    assert slow.done, slow.words
    assert list(read_frames(made(tmp_path / "run").log)) == list(
        read_frames(made(shared.folder).log)
    )
    live, others = slow.run.recorder.live_estimator, shared.first.run.recorder.live_estimator
    assert live is not None
    assert others is not None
    assert live.values.tolist() == others.values.tolist()


@pytest.mark.slow
def test_an_imu_that_is_unplugged_has_the_run_pause_and_go_on_when_it_is_back(
    tmp_path: Path, bench: BenchSimulator
):
    def unplug(run: object) -> None:
        bench.inject_fault("imu", "fault unplug")

    def replug(run: object) -> None:
        bench.inject_fault("imu", "fault replug")

    ended = carried_out(
        tmp_path / "run",
        bench,
        plan(tmp_path / "plan"),
        [("y up", "work", unplug), ("y up", "paused", replug)],
    )
    assert ended.done, ended.words
    assert "the IMU is gone" in ended.words
    assert [label for label, _, _ in ended.sections] == ["warm-up", "y up", "z+", "rest"]


@pytest.mark.slow
def test_an_imu_that_falls_silent_for_good_ends_the_run_with_the_table_at_rest(
    tmp_path: Path, bench: BenchSimulator
):
    def silent(run: object) -> None:
        bench.inject_fault("imu", "fault silent on")

    run = plan(tmp_path / "plan")
    acts = [("z+", "work", silent)]
    ended = carried_out(tmp_path / "run", bench, run, acts, RunOptions(patience=5.0))
    assert not ended.done
    assert "silent" in ended.run.trouble
    assert "within 5 s" in ended.run.trouble
    assert at_rest(bench)
    # The operator mends it, and goes on.
    bench.inject_fault("imu", "fault silent off")
    again = carried_out(tmp_path / "run", bench)
    assert again.done, again.words
    assert [label for label, _, _ in again.sections] == ["warm-up", "y up", "z+", "rest"]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        pytest.param("amplifier 2", "amplifier", marks=pytest.mark.slow),
        evidence("jammed 2", "middle"),
    ],
)
def test_a_fault_of_the_table_ends_the_run_with_the_axis_named_and_the_table_at_rest(
    tmp_path: Path, broken: BenchSimulator, fault: str, words: str
):
    def spoil(run: object) -> None:
        broken.inject_fault("table", f"fault {fault}")

    run = plan(tmp_path / "plan", SHORT.replace("outer,90,30", "middle,360,30"))
    ended = carried_out(tmp_path / "run", broken, run, [("z+", "work", spoil)])
    assert not ended.done
    assert words in ended.run.trouble
    assert at_rest(broken)


@pytest.mark.slow
def test_an_axis_whose_encoder_stands_is_switched_off_and_said_to_turn(
    tmp_path: Path, broken: BenchSimulator
):
    def spoil(run: object) -> None:
        broken.inject_fault("table", "fault frozen 2")

    run = plan(tmp_path / "plan", SHORT.replace("outer,90,30", "middle,360,30"))
    ended = carried_out(tmp_path / "run", broken, run, [("z+", "work", spoil)])
    assert not ended.done
    assert "axis middle: the encoder stands still while the gyros measure" in ended.words
    assert "the gyros measure" in ended.run.trouble
    with open_table(broken.table, None) as table:
        assert at_rest(broken)  # so its encoders say
        broken.inject_fault("table", "fault frozen 2 off")
        told = table.read().time
        while (state := table.read()).time <= told:
            pass  # its encoder counts on when its clock does
        axis = state.axes[1]
    assert not axis.enabled
    assert abs(axis.rate) > 1


@pytest.mark.slow
def test_a_table_that_is_gone_ends_the_run_in_words(
    tmp_path: Path, broken: BenchSimulator, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(
        "inercal.host.table_driver._REST_TIMEOUT", 1.0
    )  # nobody comes to see it at rest

    def die(run: object) -> None:
        broken.inject_fault("table", "die")

    ended = run_with(tmp_path, broken, "y up", "approach", die)
    assert not ended.done
    assert ended.run.trouble


@pytest.mark.slow
def test_readings_of_the_table_that_fail_leave_the_angles_beside_them_unusable(
    tmp_path: Path, bench: BenchSimulator
):
    left = 4

    def spoil(run: Interfered) -> None:
        read = run._table_driver._table.read

        def fails() -> TableState:
            nonlocal left
            state = read()
            if left and any(axis.rate > 0.1 for axis in state.axes):
                left -= 1
                raise ProtocolError("no whole reply")
            return state

        run._table_driver._table.read = fails

    ended = run_with(tmp_path, bench, "z+", "work", spoil)
    assert ended.done, ended.words
    assert left == 0
    assembly = ended.run.recorder.assembly
    # Every sample of the IMU stays. No filter uses the angles in the gap, nor those one reading
    # before and after it.
    assert assembly.samples_without_angle == 0
    assert abs(assembly.samples_with_unusable_angle - 7 * 0.05 * 200) <= 2
    # On a busy machine it is said before all of them are in: "so far".
    said = re.search(r"(\d+) samples", ended.words)
    assert said
    assert 0 < int(said[1]) <= assembly.samples_with_unusable_angle
    assert ended.words.count("no whole reply") == 4


@pytest.mark.slow
def test_corrupt_bytes_and_lost_packets_are_counted_and_none_of_them_enters(
    tmp_path: Path, bench: BenchSimulator
):
    def spoil(run: object) -> None:
        bench.inject_fault("imu", "fault errors 0.001")
        bench.inject_fault("imu", "fault loss 0.01")

    ended = run_with(tmp_path, bench, "warm-up", "work", spoil)
    bench.inject_fault("imu", "fault errors 0")
    bench.inject_fault("imu", "fault loss 0")
    assert ended.done, ended.words
    assembly = ended.run.recorder.assembly
    sent = 200 * (ended.run.time - ended.sections[0][1])
    # 1 − 0.999³⁶ of the packets have a byte that is changed; binomial, five standard deviations.
    for share, of in (
        (1 - 0.999**36, assembly.imu.counts.failed),
        (0.01 + 0.0354, assembly.imu.counts.lost),
    ):
        assert abs(of - share * sent) < 5 * np.sqrt(share * sent)
    raw = b"".join(
        frame.payload for frame in read_frames(made(tmp_path / "run").log) if frame.kind == IMU
    )
    assert len(raw) > 30 * 200 * 36 / 2
    live = ended.run.recorder.live_estimator
    assert live is not None
    squares, components = np.sum(list(live.innovations.values()), axis=0)
    assert 0.7 < squares / components < 1.3


@pytest.mark.slow
def test_an_operator_may_pause_a_run_and_let_it_go_on(tmp_path: Path, bench: BenchSimulator):
    ended = carried_out(
        tmp_path / "run",
        bench,
        plan(tmp_path / "plan"),
        [
            ("y up", "approach", lambda run: run.request("pause")),
            ("y up", "paused", lambda run: run.request("go on")),
        ],
    )
    assert ended.done, ended.words
    assert "paused by the operator" in ended.words


@pytest.mark.slow
def test_an_operator_may_stop_a_run_and_resume_it(tmp_path: Path, bench: BenchSimulator):
    ended = run_with(tmp_path, bench, "y up", "approach", lambda run: run.request("stop"))
    assert not ended.done
    assert ended.run.trouble == "stopped by the operator"
    assert at_rest(bench)
    states: list[str] = []

    def look(run: Interfered) -> None:
        states.append(run._journal.header().state)

    again = carried_out(tmp_path / "run", bench, acts=[("y up", "work", look)])
    assert again.done, again.words
    assert states == ["running"]
    (resumed,) = [one for one in again.events if one.words.startswith("interrupted at ")]
    assert resumed.time is not None
    assert resumed.time >= ended.run.time
    (begins,) = [one.words for one in again.events if "the recording begins at" in one.words]
    start = again.run.recorder.assembly.recording_start
    assert f" {start:.1f} s" in begins
    assert [label for label, _, _ in again.sections] == ["warm-up", "y up", "z+", "rest"]
