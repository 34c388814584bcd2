"""The account of a run that goes on: what was said before the interruption is not said again."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests import rest_bias_method
from tests.host.synthetic_log import LAYOUT, PATH, Bench, Faults, run_file

from inercal.benches import Turntable
from inercal.estimation import Gaussian
from inercal.host.journal import Journal
from inercal.host.recorder import RunRecorder
from inercal.host.run_folder import RunFolder, create_run
from inercal.host.run_log import EVENT, LogFrame, RunLog, read_frames
from inercal.host.sequencer import SectionEvent
from inercal.methods import METHODS, PartialEstimate
from inercal.physics.plan import TableStep
from inercal.physics.sensors import Sensor
from inercal.runfile import read

ADDRESSES = (
    "pmac://10.0.0.5:1025?motors=1,2,3&counts=3600000",
    "tcp://10.0.0.6:1?preset=fixed",
    "",
)
# Its first rest is too short for the filters; it lasts for longer than what is said again waits.
LONG = PATH.replace("0,0,0,24", "0,0,0,12").replace("90,45,0,4", "90,45,0,110")
HALF = 80.0  # s


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> list[LogFrame]:
    run = run_file(tmp_path_factory.mktemp("bench"), LONG)
    return Bench(run, seed=1, faults=Faults(lost=0.01)).frames()


def interrupted(folder: Path, frames: list[LogFrame]) -> RunFolder:
    """Return the folder of a run that left these frames, and a journal that has heard nothing."""
    (folder / "plan").mkdir()
    made, journal = create_run(folder / "run", run_file(folder / "plan", LONG), ADDRESSES)
    journal.close()
    with RunLog(made.log) as log:
        for frame in frames:
            log.append(*frame)
    return made


def go_on(account: RunRecorder, frames: list[LogFrame]) -> None:
    """Let a run go on, as these frames come."""
    for frame in frames:
        account.record_frame(*frame)
        if account.is_processing_due(frame.time):
            account.process_pending(frame.time)


@pytest.mark.parametrize(
    ("method", "stands"), [("turntable_kalman", "waits"), ("turntable_discrete", "none")]
)
def test_live_estimation_waits_or_is_not_the_methods(tmp_path: Path, method: str, stands: str):
    run = run_file(tmp_path, LONG)
    text = run.path.read_text(encoding="utf-8")
    assert 'name = "turntable_kalman"' in text
    run.path.write_text(text.replace('name = "turntable_kalman"', f'name = "{method}"'))
    folder, journal = create_run(tmp_path / "run", read(run.path), ADDRESSES)
    with journal, RunRecorder(folder, journal, LAYOUT) as account:
        assert account.estimation == stands


class Half(rest_bias_method.RestMean):
    """A sequential estimator that knows one coefficient and no other."""

    def estimate(self) -> Mapping[str, PartialEstimate]:
        return {
            part: PartialEstimate(one.names[:1], one.value[:1], one.covariance[:1, :1], 0.0, 0)
            for part, one in super().estimate().items()
        }


class Faulty(rest_bias_method.RestMean):
    """A sequential estimator with a mistake."""

    def estimate(self) -> Mapping[str, PartialEstimate]:
        return {part: {}[part] for part in super().estimate()}


@contextmanager
def followed(
    folder: Path, frames: list[LogFrame], made: type[rest_bias_method.RestMean]
) -> Generator[RunRecorder]:
    """Give the account of a run by a method from outside that is followed by such an estimator."""

    def estimator_of(
        estimator: str,
        sensor: Sensor,
        bench: Turntable,
        steps: Sequence[TableStep],
        priors: Sequence[Gaussian],
        rate_hz: float,
    ) -> rest_bias_method.RestMean:
        return made(sensor, bench, rate_hz)

    method = replace(rest_bias_method.METHOD, sequential=estimator_of)
    with METHODS.with_("rest_biases", method):
        run = run_file(folder, LONG, **{'"turntable_kalman"': '"rest_biases"'})
        left, journal = create_run(folder / "run", run, ADDRESSES)
        with journal, RunRecorder(left, journal, LAYOUT) as account:
            go_on(account, frames)
            account.process_pending(frames[-1].time)
            yield account


@pytest.mark.slow
def test_nothing_is_navigated_before_all_coefficients_are_estimated(
    tmp_path: Path, logged: list[LogFrame]
):
    for made, navigated in ((Half, False), (rest_bias_method.RestMean, True)):
        (tmp_path / made.__name__).mkdir()
        with followed(tmp_path / made.__name__, logged, made) as account:
            assert account.estimation == "on"
            assert account.live_estimator is not None
            assert np.isfinite(account.live_estimator.values).tolist() == [
                True,
                navigated,
                navigated,
            ]
            assert (account.navigation is not None) == navigated


@pytest.mark.slow
def test_a_mistake_of_a_method_from_outside_ends_its_estimate_and_not_the_run(
    tmp_path: Path, logged: list[LogFrame]
):
    with followed(tmp_path, logged, Faulty) as account:
        assert account.estimation == "ended"
        assert account.assembly.samples > 10_000
        ends = [
            words
            for _, words in account.recent_messages
            if words.startswith("live estimation ends")
        ]
        assert ends == ["live estimation ends: KeyError: 'all'"]


@pytest.mark.slow
def test_what_was_said_before_an_interruption_is_not_said_again(
    tmp_path: Path, logged: list[LogFrame]
):
    folder = interrupted(tmp_path, [])
    with Journal(folder.journal) as journal:
        with RunRecorder(folder, journal, LAYOUT) as account:
            go_on(account, logged)
        said = journal.events()
        assert [event.words.split()[0] for event in said] == ["live", "so", "so"]
        for _ in range(2):
            with RunRecorder(folder, journal, LAYOUT) as account:
                assert account.assembly.imu.counts.lost > 100
            assert journal.events() == said


@pytest.mark.slow
def test_an_end_of_live_estimation_that_only_the_replay_comes_to_is_said_once(
    tmp_path: Path, logged: list[LogFrame]
):
    folder = interrupted(tmp_path, logged)
    with Journal(folder.journal) as journal:
        for _ in range(2):
            with RunRecorder(folder, journal, LAYOUT) as account:
                assert account.live_estimator is None
                assert account.estimation == "ended"
        (event,) = journal.events()
    assert event.words.startswith("live estimation ends: ")
    assert "begins with a rest of 11" in event.words


@pytest.mark.slow
def test_of_a_run_that_goes_on_losses_are_told_when_there_are_more(
    tmp_path: Path, logged: list[LogFrame]
):
    before = [frame for frame in logged if frame.time < HALF]
    folder = interrupted(tmp_path, before)
    with Journal(folder.journal) as journal, RunRecorder(folder, journal, LAYOUT) as account:
        lost = account.assembly.imu.counts.lost
        assert lost > 50
        told = len(journal.events())
        go_on(account, logged[len(before) :])
        (event,) = journal.events(told)
    assert event.time == pytest.approx(120, abs=6)  # as if nothing had interrupted it
    assert lost < int(event.words.split()[2]) < account.assembly.imu.counts.lost


@pytest.mark.slow
def test_a_section_is_done_when_the_samples_of_its_end_are_in_the_log(
    tmp_path: Path, logged: list[LogFrame]
):
    folder = interrupted(tmp_path, [])
    ended = SectionEvent(0, "rest", "done", 40.0, "rest")
    with Journal(folder.journal) as journal, RunRecorder(folder, journal, LAYOUT) as account:
        account.record_section(40.0, ended, holds=True)
        done_at: list[float] = []
        for frame in logged:
            account.record_frame(*frame)
            if journal.completed_steps() == 1:
                done_at.append(frame.time)
        assert 40.0 < done_at[0] < 40.2
    kinds = [frame.kind for frame in read_frames(folder.log)]
    assert kinds[0] == EVENT  # the log has the section at once
