"""Steps of readings and the error that they leave in means; drawn and summed with NumPy alone."""

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.base_seeds import chosen

from inercal.estimation.uncertainty.rounding import (
    last_digit,
    mean_rounding_variance,
    noise_lower_bound,
    rounding_ladder,
)

Array = NDArray[np.float64]
RADIAN = np.pi / 180


def mean_reading(place: Array, noise: float) -> Array:
    """Return the mean of round(place + noise), by a sum over the probabilities of the levels."""
    from math import erf

    if not noise:
        return np.rint(place)
    below = np.vectorize(lambda x: 0.5 * (1 + erf(x / 2**0.5)))
    levels = np.arange(-8, 9)[:, None]
    edges = below((levels + 0.5 - place) / noise) - below((levels - 0.5 - place) / noise)
    return np.asarray((levels * edges).sum(axis=0), dtype=np.float64)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5])
def test_the_error_of_a_mean_is_that_of_all_places_between_two_steps(noise: float):
    place = (np.arange(4000) + 0.5) / 4000 - 0.5
    expected = np.mean((mean_reading(place, noise) - place) ** 2)
    assert mean_rounding_variance(noise) == pytest.approx(expected, rel=2e-3)


# step and unit of the last digit of the text
TEXTS = [
    (0.02, 0.01),
    (0.01, 0.01),
    (0.02 * RADIAN, 1e-4),
    (0.02 * RADIAN, 1e-5),
    (0.061 * RADIAN, 1e-4),
    (1 / 131, 1e-4),
    (3.0, 1.0),
    (1.0, 1.0),
    (0.07, 0.01),
]


@pytest.mark.parametrize(("step", "digit"), TEXTS)
def test_the_step_is_found_through_the_digits_of_its_text(step: float, digit: float):
    for seed in range(12):
        rng = np.random.default_rng(seed)
        noise = step * 10 ** rng.uniform(-1.3, 0.3)
        moving = np.cumsum(rng.normal(0, 3 * step, 200))
        read = rng.uniform(-50, 50) * step + np.concatenate([rng.normal(0, noise, 300), moving])
        text = np.rint(np.rint(read / step) * step / digit) * digit
        ladder = rounding_ladder(np.unique(text))
        assert ladder is not None, (seed, step, digit)
        assert ladder.step == pytest.approx(step, rel=0.02), (seed, step, digit)


def test_readings_without_steps_have_none():
    for seed in range(40):
        read = np.random.default_rng(seed).standard_normal(400)
        assert rounding_ladder(np.unique(read)) is None


def test_the_departure_of_uneven_digits_is_told():
    """Steps of 3.49 units of the last place are written 3 or 4 apart: 0.29 units rms off."""
    levels = np.unique(np.rint(np.arange(300) * 3.490658) * 1e-4)
    ladder = rounding_ladder(levels)
    assert ladder is not None
    assert ladder.off == pytest.approx(1e-4 / 12**0.5, rel=0.1)


def test_one_value_has_no_step():
    assert rounding_ladder(np.array([0.5])) is None


@pytest.mark.parametrize(("values", "digit"), [
    ([0.5, 1.25], 0.01), ([3.0, 7.0], 1.0), ([1 / 3, 0.2], 0.0),
])  # fmt: skip
def test_the_last_digit_of_numbers(values: list[float], digit: float):
    assert last_digit(np.array(values)) == digit


@pytest.mark.parametrize("noise", chosen((0.05, 0.1, 0.2, 0.3, 0.4, 0.6), (0.05, 0.2, 0.6)))
def test_the_bound_of_the_noise_is_below_it(noise: float):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        place = rng.uniform(0, 1) + rng.uniform(-0.21, 0.21, 30)
        read = [np.rint(p + rng.normal(0, noise, 200)).astype(np.int64) for p in place]
        bound = noise_lower_bound(read)
        assert bound <= noise + 1e-9
        if noise >= 0.3:  # many levels show it well
            assert bound > 0.75 * noise


def test_two_levels_bound_nothing():
    """Any noise down to none explains them, with a true value between the two."""
    read = [np.array([0] * 90 + [1] * 110), np.array([1] * 40 + [2] * 160)]
    assert noise_lower_bound(read) == 0.0
