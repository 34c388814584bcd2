"""Means over marked sections, and whether their stated covariance is what they scatter by."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.refusals import refused

from inercal.physics.plan import HandStep, Hold, Turn
from inercal.physics.sensors import Noise, Readout, triad
from inercal.recordings import Finding, Mark, Observations, Recording
from inercal.recordings.segments import average_sections
from inercal.recordings.segments.section_means import MIN_SAMPLES

Array = NDArray[np.float64]
RATE = 100.0
SENSOR = triad("triad", "f", "", Readout(scale=50.0, offset=7.0, unit="LSB"))
STEPS: tuple[HandStep, ...] = (
    Hold("down", (0.0, 0.0, -1.0), 8.0),
    Hold("up", (0.0, 0.0, 1.0), 8.0),
    Turn("turn", (0.0, 0.0, 1.0), 2 * pi, 8.0),
)
MARKS = (Mark("up", 100, 900), Mark("turn", 1000, 1400), Mark("down", 1500, 2700))


def recording(data: Array, **changes: object) -> Recording:
    n = data.shape[-2]
    made = Recording(np.arange(n) / RATE, data, ("x", "y", "z"), ("LSB",) * 3, source="log.csv")
    return replace(made, **changes)  # type: ignore[arg-type]


def noise(n: int = 3000, trials: tuple[int, ...] = (), seed: int = 4) -> Array:
    return np.random.default_rng(seed).standard_normal((*trials, n, 3))


def test_means_are_those_of_the_samples_inside_the_marks():
    data = noise()
    seen = average_sections(recording(data), SENSOR, MARKS, STEPS)
    assert seen.labels == ("down", "up", "turn")  # the plan's order
    for row, (start, stop) in zip(seen.mean, [(1500, 2700), (100, 900), (1000, 1400)], strict=True):
        expected = (data[start:stop].mean(axis=0) - 7.0) / 50.0
        assert row == pytest.approx(expected, rel=1e-12)


def test_a_constant_reading_is_returned_to_the_last_digit():
    data = np.full((3000, 3), [57.0, -43.0, 7.0])
    seen = average_sections(recording(data), SENSOR, MARKS, STEPS)
    assert seen.mean.tolist() == [[1.0, -1.0, 0.0]] * 3


def test_channels_are_taken_by_name():
    data = noise()
    columns = [2, 0, 1]
    shuffled = recording(data[:, columns], channels=("z", "x", "y"))
    assert average_sections(shuffled, SENSOR, MARKS, STEPS).mean == pytest.approx(
        average_sections(recording(data), SENSOR, MARKS, STEPS).mean, rel=1e-12
    )


def test_durations_samples_and_middles_are_those_of_the_marks():
    data = noise()
    seen = average_sections(
        recording(data, time=np.arange(3000) / RATE + 5.0), SENSOR, MARKS, STEPS
    )
    assert seen.samples.tolist() == [1200, 800, 400]
    assert seen.duration == pytest.approx([12.0, 8.0, 4.0])
    assert seen.time == pytest.approx([5 + 21.0, 5 + 5.0, 5 + 12.0])


def test_a_step_without_a_mark_leaves_no_row():
    seen = average_sections(recording(noise()), SENSOR, MARKS[:2], STEPS)
    assert seen.labels == ("up", "turn")


TRIALS = 300


@pytest.fixture(scope="module")
def correlated() -> tuple[Array, Array, Observations]:
    """Return the covariance of a sample, the true means (SI), and what 300 trials observe."""
    mixing = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [-0.5, 0.2, 2.0]])
    data = noise(trials=(TRIALS,)) @ mixing.T
    return (
        mixing @ mixing.T / 50.0**2,
        np.full(3, -7.0 / 50.0),
        average_sections(recording(data), SENSOR, MARKS, STEPS),
    )


@pytest.mark.slow
def test_white_noise_is_stated_as_its_covariance_over_the_number_of_samples(
    correlated: tuple[Array, Array, Observations],
):
    of_a_sample, _, seen = correlated
    assert seen.mean.shape == (TRIALS, 3, 3)
    assert seen.dof == 2 * 19  # both positions, 20 batches each
    found = seen.covariance.mean(axis=0) * seen.samples[:, None, None]
    sd = np.sqrt(np.diag(of_a_sample))
    # An element of a covariance with ν degrees of freedom scatters by at most √(2/ν).
    band = 4 * np.sqrt(2 / (seen.dof * TRIALS))
    for row in found:
        assert (row - of_a_sample) / np.outer(sd, sd) == pytest.approx(0, abs=band)


def test_means_scatter_by_what_their_covariance_states(
    correlated: tuple[Array, Array, Observations],
):
    _, true, seen = correlated
    error = seen.mean - true
    weighed = np.linalg.solve(seen.covariance, error[..., None])[..., 0]
    nees = (error * weighed).sum(-1) / 3
    # Hotelling: the covariance is itself estimated with ν degrees of freedom.
    expected = seen.dof / (seen.dof - 3 - 1)
    assert nees.mean() == pytest.approx(expected, abs=5 * expected * np.sqrt(2 / (3 * 3 * TRIALS)))


@pytest.mark.slow
def test_coloured_noise_is_stated_by_its_density_at_zero_frequency():
    # A first-order process with correlation 0.9 from sample to sample: 19 times white noise.
    white = noise(trials=(TRIALS,))
    data = np.empty_like(white)
    data[:, 0] = white[:, 0] / np.sqrt(1 - 0.9**2)
    for k in range(1, white.shape[1]):
        data[:, k] = 0.9 * data[:, k - 1] + white[:, k]
    seen = average_sections(recording(data), SENSOR, MARKS, STEPS)
    stated = np.diagonal(seen.covariance, axis1=-2, axis2=-1).mean(axis=(0, 2))
    scatter = seen.mean.var(axis=0, ddof=1).mean(axis=-1)
    # Batches of 40 to 60 samples hold all but a tenth of it.
    assert np.sqrt(stated / scatter) == pytest.approx(1, abs=0.15)


def test_a_turns_own_motion_is_not_taken_for_noise():
    data = noise()
    moving = data.copy()
    moving[1000:1400] += 1e4 * np.sin(np.linspace(0, 2 * pi, 400))[:, None]
    still = average_sections(recording(data), SENSOR, MARKS, STEPS)
    assert np.array_equal(
        average_sections(recording(moving), SENSOR, MARKS, STEPS).covariance, still.covariance
    )


def test_a_stated_drift_is_carried_between_the_means_of_each_channel():
    noisy = replace(SENSOR.axes[1], noise=Noise(bias_instability=0.01))
    drifting = replace(SENSOR, axes=(SENSOR.axes[0], noisy, SENSOR.axes[2]))
    data = noise()
    without = average_sections(recording(data), SENSOR, MARKS, STEPS)
    assert without.drift is None
    seen = average_sections(recording(data), drifting, MARKS, STEPS)
    assert np.array_equal(seen.covariance, without.covariance)
    assert seen.drift is not None
    assert not seen.drift[..., [0, 2]].any()
    assert (np.linalg.eigvalsh(seen.drift[..., 1]) > 0).all()
    added = (seen.full_covariance - without.full_covariance).reshape(3, 3, 3, 3)
    assert added[:, 1, :, 1] == pytest.approx(seen.drift[..., 1], rel=1e-9)
    assert not added[:, 0].any()


def test_a_section_of_too_few_samples_is_refused():
    marks = (Mark("up", 100, 100 + MIN_SAMPLES - 1), *MARKS[1:])
    with refused(names=["up"]):
        average_sections(recording(noise()), SENSOR, marks, STEPS)
    average_sections(
        recording(noise()), SENSOR, (Mark("up", 100, 100 + MIN_SAMPLES), *MARKS[1:]), STEPS
    )


def test_turns_alone_are_refused_since_only_rests_show_the_noise():
    with refused(names=()):
        average_sections(recording(noise()), SENSOR, MARKS[1:2], STEPS)


def test_a_hold_with_a_move_inside_its_mark_is_refused():
    data = noise()
    data[300:350] += 100.0
    holds = (*MARKS, Mark("level", 2800, 2900))
    steps = (*STEPS, Hold("level", (1.0, 0.0, 0.0), 1.0))
    with refused(names=["up"]):
        average_sections(recording(data), SENSOR, holds, steps)


def flaw(what: str, start: int, stop: int, channel: str | None = "y") -> Recording:
    message = f"y is flawed in samples {start} to {stop - 1}"
    finding = Finding("warning", what, message, channel, start, stop)
    return recording(noise(), findings=(finding,))


@pytest.mark.parametrize("what", ["saturation", "stuck"])
@pytest.mark.parametrize(
    ("start", "stop", "section"),
    [(899, 950, "up"), (50, 101, "up"), (1100, 1110, "turn"), (1400, 1501, "down")],
)
def test_a_section_with_saturated_or_stuck_samples_is_refused(
    what: str, start: int, stop: int, section: str
):
    with refused(names=[section]):
        average_sections(flaw(what, start, stop), SENSOR, MARKS, STEPS)


@pytest.mark.parametrize("what", ["saturation", "stuck"])
def test_flaws_between_the_sections_or_in_other_channels_do_no_harm(what: str):
    average_sections(flaw(what, 900, 1000), SENSOR, MARKS, STEPS)
    average_sections(flaw(what, 200, 300, channel="gx"), SENSOR, MARKS, STEPS)


def with_gap(after: int) -> Recording:
    time = np.arange(3000) / RATE
    time[after + 1 :] += 0.1
    return recording(noise(), time=time)


@pytest.mark.parametrize("after", [1000, 1200, 1398])
def test_a_turn_with_samples_lost_is_refused(after: int):
    with refused(names=["turn"]):
        average_sections(with_gap(after), SENSOR, MARKS, STEPS)


@pytest.mark.parametrize("after", [300, 999, 1399, 2000])
def test_samples_lost_outside_a_turn_do_no_harm(after: int):
    average_sections(with_gap(after), SENSOR, MARKS, STEPS)
