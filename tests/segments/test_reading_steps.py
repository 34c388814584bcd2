"""Steps of a recording's channels and the covariance of its means, on rests drawn with NumPy."""

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.base_seeds import chosen

from inercal.estimation.uncertainty.rounding import mean_rounding_variance
from inercal.physics.sensors import Sensor, imu
from inercal.recordings import ReadingSteps, RoundedChannel
from inercal.recordings.rounding_errors import RoundingErrors, join_rounding_errors
from inercal.recordings.segments.reading_steps import reading_steps

Array = NDArray[np.float64]
RESTS, LENGTH = 30, 200


def gyro() -> Sensor:
    whole = imu().select_axes("w")
    return Sensor("gyro", whole.axes[:1])


def channel(rests: list[Array], moves: Array) -> tuple[Array, list[tuple[int, int]]]:
    """Return rests with a move between each two, (n, 1), and where the rests are."""
    parts: list[Array] = []
    at: list[tuple[int, int]] = []
    count = 0
    for rest in rests:
        at.append((count, count + rest.size))
        parts += [rest, moves]
        count += rest.size + moves.size
    return np.concatenate(parts)[:, None], at


def session(
    noise: float, apart: float, rng: np.random.Generator, step: float = 0.02
) -> tuple[Array, Array, list[tuple[int, int]], float]:
    """Return readings, true values of the rests minus their bias, rests, and the bias."""
    bias = rng.uniform(-3, 3)
    off = step * rng.uniform(-apart, apart, RESTS)
    rests = [step * np.rint((bias + d) / step + noise * rng.standard_normal(LENGTH)) for d in off]
    sweep = np.sin(np.linspace(0, 2 * np.pi, 60)) * 40 * step + bias
    data, at = channel(rests, step * np.rint(sweep / step))
    return data, off, at, bias


def estimate(
    data: Array, off: Array, at: list[tuple[int, int]]
) -> tuple[float, float, ReadingSteps]:
    """Return the bias by least squares of the means, its standard deviation, and the steps."""
    found = reading_steps(data, [0], gyro(), at, si=True)
    mean = np.array([data[a:b].mean(axis=0) for a, b in at])
    scatter = np.mean([data[a:b].var() for a, b in at]) / LENGTH
    covariance = np.eye(len(at)) * max(scatter, 1e-16)
    errors = found.errors_of_means(mean)
    if errors is not None:
        covariance = covariance + errors.covariance[..., 0]
    weight = np.linalg.solve(covariance, np.ones(len(at)))
    variance = 1 / weight.sum()
    return float(variance * weight @ (mean[:, 0] - off)), float(variance**0.5), found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("noise", "apart"),
    chosen(product((0.05, 0.2, 0.4), (0.0, 0.21, 2.0)), [(0.05, 0.21), (0.2, 2.0), (0.4, 0.0)]),
)
def test_the_bias_of_rounded_rests_is_within_its_uncertainty(noise: float, apart: float):
    """Independent errors of 30 rests would have a mean square of 11 to 47, and a coverage of .2."""
    z: list[float] = []
    for seed in range(40):
        data, off, at, bias = session(noise, apart, np.random.default_rng([seed, 7]))
        value, sd, _ = estimate(data, off, at)
        z.append((value - bias) / sd)
    square = float(np.mean(np.square(z)))
    assert square < 1.84, square  # 99.9 % of χ² of 40
    assert np.mean(np.abs(z) < 2) > 0.82  # of 40 with .95


@pytest.mark.parametrize("noise", [0.1, 0.3])
def test_thirty_rests_are_worth_one(noise: float):
    data, off, at, _ = session(noise, 0.1, np.random.default_rng(3))
    _, sd, found = estimate(data, off, at)
    assert sd > 0.9 * found.variance[0] ** 0.5
    assert found.variance[0] > 0.02**2 * mean_rounding_variance(noise)


def test_a_noisy_channel_is_not_corrected():
    data, off, at, _ = session(3.0, 1.0, np.random.default_rng(3))
    _, sd, found = estimate(data, off, at)
    assert not found.variance.any()
    assert sd == pytest.approx(0.06 / (RESTS * LENGTH) ** 0.5, rel=0.05)


def test_a_band_that_is_never_read_is_a_dead_band():
    rng = np.random.default_rng(1)
    rate = np.sin(np.linspace(0, 2 * np.pi, 400)) * 20 + 0.1
    moves = np.where(np.abs(rate) < 0.3, 0.0, np.round(rate, 3))
    moves = np.concatenate([moves, *(np.round(0.3 + 0.05 * rng.random((2, 30)), 3) * [[1], [-1]])])
    data, at = channel([np.zeros(LENGTH)] * 6, moves)
    found = reading_steps(data, [0], gyro(), at, si=True)
    assert found.dead_band[0]
    assert found.step[0] == pytest.approx(0.6, abs=0.02)
    assert found.variance[0] == pytest.approx(0.3**2 / 3, rel=0.1)


def test_one_value_in_all_rests_has_the_error_of_a_whole_step():
    step = 0.5
    moves = step * np.rint(np.sin(np.linspace(0, 2 * np.pi, 300)) * 60)
    data, at = channel([np.full(LENGTH, 2 * step)] * 8, moves)
    found = reading_steps(data, [0], gyro(), at, si=True)
    assert found.step[0] == pytest.approx(step)
    assert found.noise[0] == 0.0
    assert found.variance[0] == pytest.approx(step**2 / 12, rel=0.01)


def test_rows_far_apart_have_independent_errors():
    steps = ReadingSteps(np.array([1.0]), np.zeros(1), np.zeros(1, dtype=np.bool_), np.zeros(1))
    errors = steps.errors_of_means(np.array([[0.0], [0.1], [40.0]]))
    assert errors is not None
    between = errors.covariance[..., 0]
    assert between[0, 1] > 0.9 / 12
    assert between[0, 2] == pytest.approx(0.0, abs=1e-12)
    assert between[2, 2] == pytest.approx(1 / 12, rel=0.01)
    assert np.linalg.eigvalsh(between).min() > 0


def test_a_row_that_crosses_many_steps_averages_their_errors():
    steps = ReadingSteps(np.array([1.0]), np.zeros(1), np.zeros(1, dtype=np.bool_), np.zeros(1))
    rest, move = np.zeros((100, 1)), np.arange(-50.0, 50.0)[:, None]
    turn = np.concatenate([move[:10], np.full((80, 1), 7.0), move[:10]])
    crossed = steps.crossed([rest, move, turn])
    assert crossed.ravel().tolist() == pytest.approx([1.0, 100.0, 100**2 / (80**2 + 10 * 2**2)])
    errors = steps.errors_of_means(np.array([[0.0], [0.1], [7.0]]), crossed)
    assert errors is not None
    assert errors.covariance[1, 1, 0] == pytest.approx(1 / 1200, rel=0.01)
    assert errors.covariance[0, 1, 0] == 0
    assert errors.covariance[2, 2, 0] == pytest.approx(1 / 12, rel=0.01)


def test_turns_at_one_rate_have_the_same_error():
    steps = ReadingSteps(np.array([1.0]), np.zeros(1), np.zeros(1, dtype=np.bool_), np.zeros(1))
    turn = np.full((50, 1), 7.0)
    errors = steps.errors_of_means(np.full((2, 1), 7.0), steps.crossed([turn, turn]))
    assert errors is not None
    assert errors.covariance[0, 1, 0] == pytest.approx(1 / 12, rel=0.01)


@pytest.mark.parametrize("first", [True, False])
def test_joined_rows_keep_the_rounded_channels_of_the_only_rounded_recording(first: bool):
    steps = ReadingSteps(np.array([1.0]), np.zeros(1), np.zeros(1, dtype=np.bool_), np.zeros(1))
    channel = RoundedChannel("ax", 1.0, 0.0, dead_band=False, std=0.3)
    known = RoundingErrors(np.full((2, 2, 1), 0.1), steps, (channel,))
    joined = join_rounding_errors(*((known, None, 2, 1) if first else (None, known, 1, 2)))
    assert joined is not None
    assert joined.channels == (channel,)
    own = slice(0, 2) if first else slice(1, 3)
    assert np.array_equal(joined.covariance[own, own], known.covariance)
    assert joined.covariance.sum() == pytest.approx(0.4)
