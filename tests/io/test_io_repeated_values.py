import numpy as np
import pytest

from inercal.basics.arrays import Array
from inercal.recordings.io.repeated_values import (
    clipping_values,
    longest_constant_run,
    merge_ranges,
    out_of_range,
    rail_ranges,
    ranges_with_values,
    stuck_ranges,
)

NONE = np.zeros((0, 2), dtype=np.int64)
RNG = np.random.default_rng(7)


def clipped(step: float) -> Array:
    """Return a sine of amplitude 12 cut at ±10, with noise before the cut, rounded to `step`."""
    t = np.arange(2000.0)
    x = 12 * np.sin(2 * np.pi * t / 500) + RNG.normal(scale=0.05, size=t.size)
    return np.clip(np.round(x / step) * step, -10.0, 10.0)


@pytest.mark.parametrize("step", [1e-6, 0.01, 0.1])
def test_a_clipped_sine_is_at_its_rails_eight_times(step: float):
    x = clipped(step)
    ranges = merge_ranges(rail_ranges(x), apart=20)
    assert len(ranges) == 8
    for start, stop in ranges:
        assert 80 < stop - start < 110
    assert np.abs(x[np.r_[tuple(slice(*r) for r in ranges)]]).mean() > 9.9


def test_a_sine_that_just_reaches_its_peak_is_not_at_a_rail():
    t = np.arange(2000.0)
    x = np.asarray(np.round(1000 * np.sin(2 * np.pi * t / 500)), dtype=np.float64)
    assert rail_ranges(x).size == 0


@pytest.mark.parametrize("noise", [0.05, 0.1, 0.3, 1.0])
@pytest.mark.parametrize("mean", [0.0, 0.25, 0.5, 0.9])
def test_a_coarsely_quantised_sensor_at_rest_is_neither_at_a_rail_nor_stuck(
    noise: float, mean: float
):
    x = np.round(mean + RNG.normal(scale=noise, size=20_000))
    assert rail_ranges(x).size == 0
    if np.ptp(x) > 0:
        assert stuck_ranges(x, NONE).size == 0


def test_a_coarse_sensor_turned_to_six_positions_is_not_at_a_rail():
    positions = [64.2, -63.7, 0.3, -0.1, 0.4, -0.4]  # ±1 g at 64 LSB/g
    x = np.concatenate([m + RNG.normal(scale=0.2, size=3000) for m in positions])
    assert rail_ranges(np.round(x)).size == 0


def test_a_single_sample_at_the_stated_end_of_range_counts():
    x = np.array([0.0, 1, 2, 1, 0, -2, -2, 0])
    assert out_of_range(x, -2, 2).tolist() == [[2, 3], [5, 7]]


def test_a_reading_held_far_longer_than_usual_is_stuck():
    x = np.round(RNG.normal(scale=3, size=20_000))
    x[5000:5400] = x[5000]
    found = stuck_ranges(x, NONE)
    assert len(found) == 1
    assert abs(found[0] - [5000, 5400]).max() <= 2


def test_an_unquantised_reading_held_twice_is_stuck_twice():
    x = RNG.normal(size=20_000)
    x[100:180], x[900:1200] = x[100], x[900]
    assert stuck_ranges(x, NONE).tolist() == [[100, 180], [900, 1200]]


def test_holds_without_noise_are_how_a_simulated_channel_reads():
    x = np.repeat(np.arange(12.0), 100)
    assert rail_ranges(x).size == 0
    assert stuck_ranges(x, NONE).size == 0


def test_neighbouring_ranges_become_one():
    ranges = np.array([[0, 5], [8, 10], [30, 31]])
    assert merge_ranges(ranges, apart=4) == [(0, 10), (30, 31)]
    assert merge_ranges(NONE, apart=4) == []


def rests(noise: float, step: float, seed: int) -> Array:
    """Return six rests of 10 s at 100 Hz, ±1 g and four times about 0 g, and moves; g."""
    rng = np.random.default_rng(seed)
    parts: list[Array] = []
    bias = rng.normal(scale=0.03)
    levels = [float(bias + level) for level in (1.0, -1.0, *rng.normal(scale=0.01, size=4))]
    for before, after in zip(levels, [*levels[1:], levels[-1]], strict=True):
        way = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, 150))
        move = before + (after - before) * way + 0.3 * np.sin(np.linspace(0, 12, 150)) * way
        parts += [np.full(1000, before), move]
    x = np.concatenate(parts)
    return np.round((x + noise * rng.normal(size=x.size)) / step) * step


@pytest.mark.parametrize("noise", [2e-4, 5e-4, 1e-3, 2e-3])
def test_quantisation_of_4_mg_is_not_stuck(noise: float):
    assert [stuck_ranges(rests(noise, 4e-3, seed), NONE).size for seed in range(40)] == [0] * 40


@pytest.mark.parametrize("step", [1e-9, 6e-5, 2.5e-4])
@pytest.mark.parametrize("at", [0.999, 1.0, 1.0005])
def test_noise_cut_off_at_the_end_of_the_range_is_found_in_the_histogram(step: float, at: float):
    end = round(at / step) * step
    for seed in range(10):
        x = rests(1e-3, step, seed)
        x -= x[:1000].mean() - 1.0  # the first rest reads 1 g
        x = np.clip(np.round(x / step) * step, -3.0, end)
        assert clipping_values(x) == (end,)
        found = ranges_with_values(x, NONE, clipping_values(x))
        assert (found[:, 0] < 1000).any()


@pytest.mark.parametrize("noise", [1e-4, 1e-3, 3e-3, 1e-2])
@pytest.mark.parametrize("step", [1e-9, 6e-5, 1e-3, 4e-3])
def test_noise_that_is_not_cut_off_piles_up_nowhere(noise: float, step: float):
    assert [clipping_values(rests(noise, step, seed)) for seed in range(20)] == [()] * 20


@pytest.mark.parametrize("cut", [0.0, 1.0, 2.0])
def test_noise_of_two_steps_cut_off_at_one_end_is_found_at_each_height(cut: float):
    for seed in range(10):
        x = np.random.default_rng(seed).normal(scale=2.1, size=90_000) + 0.1 * seed
        end = float(np.round(0.1 * seed + 2.1 * cut))
        assert clipping_values(np.minimum(np.round(x), end)) == (end,)


@pytest.mark.parametrize("noise", [0.05, 0.3, 0.7, 1.0, 2.1, 5.0])
def test_coarse_healthy_noise_with_slow_motion_piles_up_nowhere(noise: float):
    for seed in range(40):
        rng = np.random.default_rng(seed)
        x = rng.normal(scale=noise, size=6000) + np.linspace(0, 3 * (seed % 3), 6000)
        x += (seed % 2) * 0.02 * noise * np.cumsum(rng.normal(size=6000)) + seed / 40
        assert clipping_values(np.round(x)) == ()


def test_a_run_of_half_of_the_samples_is_found_wherever_it_is():
    x = RNG.normal(size=1000)
    assert longest_constant_run(x) is None
    for start in (0, 200, 499):
        y = x.copy()
        y[start : start + 501] = 1.0
        assert longest_constant_run(y) == (start, start + 501)
    assert longest_constant_run(np.ones(10)) == (0, 10)
