"""A method that the host has never heard of, live on the simulated bench and afterwards."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import pytest
from tests import rest_bias_method
from tests.host.simulated_runs import Ended, carried_out, made, plan

from inercal.benches import Turntable
from inercal.benches.turntable.reading.track_observation import observe
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.journal import Journal
from inercal.host.run_execution import FinishedRun, finish_run
from inercal.methods import METHODS, PartialEstimate
from inercal.recordings import Track
from inercal.runfile import Run

REST_BIASES = ('name = "turntable_kalman"', 'name = "rest_biases"')
PIECE = 37  # samples


class Whole(NamedTuple):
    """A run by the toy, and what was made of its recording."""

    ended: Ended
    finished: FinishedRun
    run: Run
    track: Track
    words: list[str]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Whole]:
    folder = tmp_path_factory.mktemp("toy")
    # The bench's processes know no method of a test: they have a run file of their own.
    simulated = plan(folder / "bench")
    with METHODS.with_("rest_biases", rest_bias_method.METHOD):
        run = plan(folder / "plan", replaced=[REST_BIASES])
        with BenchSimulator(simulated.path, seed=1) as bench:
            ended = carried_out(folder / "run", bench, run)
        left = made(folder / "run")
        with Journal(left.journal) as journal:
            finished = finish_run(left, journal, ended.run.recorder.live_estimator)
            words = [event.words for event in journal.events()]
        assert isinstance(left.run.bench, Turntable)
        track = observe(left.run).observations.track
        assert track is not None
        yield Whole(ended, finished, left.run, track, words)


def bits(found: Mapping[str, PartialEstimate]) -> dict[str, tuple[object, ...]]:
    return {
        part: (one.names, one.value.tobytes(), one.covariance.tobytes(), one.nis, one.components)
        for part, one in found.items()
    }


@pytest.mark.evidence
def test_a_run_by_a_method_from_outside_is_estimated_live_to_its_end(whole: Whole):
    assert whole.ended.done, whole.ended.words
    account = whole.ended.run.recorder
    assert account.estimation == "on"
    assert account.live_estimator is not None
    assert account.live_estimator.names == ("gx.bias", "gy.bias", "gz.bias")
    assert np.isfinite([account.live_estimator.values, account.live_estimator.std]).all()
    live, run = account.live_estimator, whole.run
    truth = np.array([run.truth[name] for name in live.names])
    # A rest of half a minute; scale and misalignment act on the earth's rate alone.
    slow = np.array([axis.noise.bias_instability for axis in run.sensor.select_axes("w").axes])
    assert np.all(np.abs(live.values - truth) < 4 * np.hypot(live.std, slow))
    ((squares, components),) = live.innovations.values()
    assert components > 3 * 25 * 200
    assert 0.95 < squares / components < 1.05


@pytest.mark.evidence
def test_its_live_estimate_is_that_of_the_recording_to_the_last_bit(whole: Whole):
    live, run, track = whole.ended.run.recorder.live_estimator, whole.run, whole.track
    assert live is not None
    assert run.rate_hz is not None
    assert isinstance(run.bench, Turntable)
    for length in (track.time.size, PIECE):
        again = rest_bias_method.RestMean(run.sensor, run.bench, run.rate_hz)
        for start in range(0, track.time.size, length):
            again.feed(track.slice(start, min(start + length, track.time.size)))
        assert bits(live.partial_estimates) == bits(again.estimate())
    estimate = whole.finished.outcome.estimate
    assert estimate.value.tobytes() == live.values.tobytes()
    assert "the live estimate is identical to that of the recording" in whole.words
