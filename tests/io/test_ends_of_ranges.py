"""Clipped turns and coarse rests: which extreme is the end of a range, without a full scale."""

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.recordings import Recording
from inercal.recordings.io.audit import audit

Array = NDArray[np.float64]
HZ, REST, MOVE = 100.0, 200, 80


def session(
    step: float,
    noise: float,
    speed: float,
    end: float,
    rng: np.random.Generator,
    *,
    senses: int = 2,
) -> Array:
    """Return rests and moves of six channels, (n, 6): the gyros are cut at ±end and rounded."""
    parts: list[Array] = []
    force = rng.standard_normal(3)
    for k in range(16):
        ahead = rng.standard_normal(3)
        parts.append(np.column_stack([np.tile(force, (REST, 1)), np.zeros((REST, 3))]))
        s = np.linspace(0, 1, MOVE)[:, None]
        sign = (-1.0) ** (k * (senses - 1))
        rate = sign * speed * np.sin(np.pi * s) ** 2 * (0.6 + 0.4 * rng.random(3))
        parts.append(np.column_stack([force + (ahead - force) * s, rate]))
        force = ahead
    data = np.concatenate(parts)
    data[:, :3] += 0.002 * rng.standard_normal((len(data), 3))
    rate = data[:, 3:] + [1.68, -0.96, 0.78] + noise * rng.standard_normal((len(data), 3))
    data[:, 3:] = step * np.rint(np.clip(rate, -end, end) / step)
    return data


def saturated(data: Array, unit: str) -> dict[str, int]:
    """Return how many ranges of each channel the audit finds at the end of the range."""
    time = np.arange(len(data)) / HZ
    names = ("ax", "ay", "az", "gx", "gy", "gz")
    found = audit(Recording(time, data, names, ("m/s²",) * 3 + (unit,) * 3)).findings
    ends = [one.channel for one in found if one.what == "saturation"]
    return {str(name): ends.count(name) for name in set(ends)}


@pytest.mark.parametrize("noise", [0.005, 0.05, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_turns_beyond_16_bits_are_noticed(noise: float, seed: int):
    step = 250 / 32767
    data = session(step, noise, 400.0, 250.0, np.random.default_rng(seed))
    data[:, 3:] = np.rint(data[:, 3:] / step)
    assert np.abs(data[:, 3:]).max() == 32767
    found = saturated(data, "LSB")
    assert set(found) == {"gx", "gy", "gz"}


@pytest.mark.parametrize("step", [0.01, 0.1, 1.0])
def test_turns_cut_in_other_units_are_noticed(step: float):
    data = session(step, 0.05, 500.0, 300.0, np.random.default_rng(4))
    assert set(saturated(data, "°/s")) == {"gx", "gy", "gz"}


@pytest.mark.parametrize("senses", [1, 2])
@pytest.mark.parametrize("step", [0.02, 0.1, 0.5, 2.0])
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.3])
def test_a_coarse_gyro_at_rest_is_not_at_the_end_of_its_range(
    step: float, noise: float, senses: int
):
    data = session(step, noise * step, 70.0, 1e9, np.random.default_rng(5), senses=senses)
    assert saturated(data, "°/s") == {}


@pytest.mark.parametrize("step", [0.02, 0.5])
def test_a_coarse_gyro_that_never_turned_is_not_either(step: float):
    rng = np.random.default_rng(6)
    data = session(step, 0.1 * step, 70.0, 1e9, rng)
    still = 1.68 + 0.1 * step * rng.standard_normal(len(data))
    data[:, 3] = step * np.rint(still / step)
    if np.ptp(data[:, 3]) == 0:
        data[0, 3] += step
    assert saturated(data, "°/s") == {}
