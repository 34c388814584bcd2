"""Ramps at rest: lag, errors and coverage against the generator's truth."""

import numpy as np
import pytest
from tests.accuracy import ramps
from tests.base_seeds import SEEDS
from tests.evidence import temperature_ramps

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.calibration.grade import assess
from inercal.methods.temperature_ramp import hysteresis, lag_and_rate_correlation, ramp, rest
from inercal.methods.temperature_ramp.blocks import RampBlocks
from inercal.methods.temperature_ramp.ramp_fit import ramp_model
from inercal.physics.sensors import Noise
from inercal.recordings.environment import Environment
from inercal.recordings.segments.section_means import drift_covariance, even_drift_covariance

UP_AND_DOWN = "up and down, 2 × 30 min"
UP = "up, 30 min"


def test_even_blocks_have_the_covariance_of_any_sections():
    noise, count, seconds = Noise(0.0, 3.0, 0.2), 12, 7.0
    middles = seconds * (np.arange(count, dtype=np.float64) + 0.5)
    any_sections = drift_covariance([noise], middles, np.full(count, seconds), count * seconds)
    assert any_sections is not None
    even = even_drift_covariance(noise, count, seconds)
    np.testing.assert_allclose(even, any_sections[..., 0], rtol=1e-3)


def test_a_ramp_up_and_down_finds_its_lag_within_a_second_and_a_half():
    made = ramps.record(np.random.default_rng(3), ramps.PROFILES[UP_AND_DOWN]())
    error, u, lag, _ = temperature_ramps.errors_of_run(made)
    assert abs(lag - ramps.LAG) < 1.5
    assert (np.abs(error) < 4 * u + 1e-15).all()


def test_a_wrong_lag_that_is_stated_shifts_the_curve_and_a_vague_one_counts_it():
    made = ramps.record(np.random.default_rng(4), ramps.PROFILES[UP]())
    _, exact, *_ = temperature_ramps.errors_of_run(
        made, Environment("ramp", lag=Measured(ramps.LAG, 0.0))
    )
    _, vague, *_ = temperature_ramps.errors_of_run(
        made, Environment("ramp", lag=Measured(ramps.LAG, 10.0))
    )
    assert (vague > exact)[ramps.COMPARED != ramps.REFERENCE].all()


def test_lag_and_rate_are_one_thing_one_way_and_nearly_so_up_and_down():
    found = {}
    for name in (UP, UP_AND_DOWN):
        made = ramps.record(np.random.default_rng(5), ramps.PROFILES[name]())
        track = temperature_ramps.observed(made).track
        assert track is not None
        blocks = RampBlocks.from_track(track)
        # A bias that is a line: its slope is one number.
        slope = np.full(blocks.time.size, ramps.BIAS[1])
        whitening = blocks.whitening(temperature_ramps.gyro())[0]
        found[name] = lag_and_rate_correlation(blocks, slope, whitening)
        assert blocks.is_monotonic == (name == UP)
    assert found[UP] < -0.999
    assert found[UP_AND_DOWN] < -0.9


def test_an_error_of_all_temperatures_moves_the_polynomial():
    made = ramps.record(np.random.default_rng(6), ramps.PROFILES[UP_AND_DOWN]())
    _, without, *_ = temperature_ramps.errors_of_run(made)
    _, with_error, *_ = temperature_ramps.errors_of_run(made, Environment("ramp", 1.0))
    away = ramps.COMPARED != ramps.REFERENCE
    slope = np.gradient(ramps.change(ramps.COMPARED), ramps.COMPARED)
    at_reference = ramps.BIAS[1]
    expected = np.hypot(without, np.abs(slope - at_reference))
    np.testing.assert_allclose(with_error[away][1:-1], expected[away][1:-1], rtol=0.2, atol=1e-6)


def test_a_warm_up_that_is_estimated_is_not_taken_for_hysteresis():
    size = 1000 * ramps.DEG_H
    made = ramps.record(np.random.default_rng(7), ramps.PROFILES[UP_AND_DOWN](), warm_up=size)
    environment, sensor = Environment("ramp", warm_up=300.0), temperature_ramps.gyro()
    seen = temperature_ramps.observed(made)
    bench = Hand(Measured(9.81, 1e-4))
    estimate = ramp(seen, sensor, bench, rest(), environment=environment)
    (loop,) = hysteresis(ramp_model(seen, sensor, environment), estimate.value)
    assert np.abs(loop.half).max() < 0.03 * size


@pytest.mark.slow
@pytest.mark.parametrize("size", [{"drift": 2000 * ramps.DEG_H}, {"warm_up": 2000 * ramps.DEG_H}])
def test_u_includes_an_unknown_time_constant(size: dict[str, float]):
    # The advised time constant of a linear drift is half the run; that of the warm-up is wrong.
    environment, found = Environment("ramp", warm_up=1800.0 if "drift" in size else 400.0), []
    for seed in range(4):
        made = ramps.record(np.random.default_rng(seed), ramps.PROFILES[UP_AND_DOWN](), **size)
        found.append(temperature_ramps.errors_of_run(made, environment)[3])
    assert np.mean(found) < 2.5  # with a fixed time constant far above 5


@pytest.mark.parametrize("shape", ["drift", "hysteresis"])
def test_a_drift_and_hysteresis_are_named_and_a_time_constant_is_at_most_half_the_run(shape: str):
    element = ramps.PROFILES[UP_AND_DOWN]()
    drift = 500 * ramps.DEG_H * (shape == "drift")
    made = ramps.record(np.random.default_rng(8), element, drift=drift)
    if shape == "hysteresis":
        # Half the loop is built up after 7 K, a tenth of the range.
        up, start = element[:1800] - element[0], float(np.exp(-7.0))
        loop = np.concatenate([1 - np.exp(-up / 10), -1 + (2 - start) * np.exp(-up / 10)])
        made.reading[:] += 500 * ramps.DEG_H * loop
    sensor = temperature_ramps.gyro()
    seen = temperature_ramps.observed(made)
    estimate = ramp(seen, sensor, Hand(Measured(9.81, 1e-4)), rest())
    assessment = assess(estimate, len(sensor.coefficients))
    assert assessment.best is not None
    assert assessment.best.name.startswith(shape)
    for one in assessment.best.changes[1:]:
        assert float(one.value.removesuffix(" s")) <= 0.5 * element.size


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_errors_up_and_down_are_as_stated(seed: int):
    row = temperature_ramps.row(UP_AND_DOWN, ramps.PROFILES[UP_AND_DOWN], 40, seed)
    assert row.rms < 4.0
    assert 0.86 < row.coverage <= 1.0
    assert abs(row.lag - ramps.LAG) < 0.5
    assert row.lag_scatter < 1.0
