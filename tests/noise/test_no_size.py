"""Recordings without noise, and disturbances near their ends: nothing is found that is nothing."""

import numpy as np
import pytest

from inercal.estimation.section_statistics import analyse_sections, haar_contrasts
from inercal.noise.disturbances import find_changes, find_disturbances

DT = 0.01
NAMES = ("ax", "ay", "az")


@pytest.mark.parametrize("ulps", [0, 1, 3])
@pytest.mark.parametrize("seed", range(5))
def test_sections_without_noise_raise_no_burst_and_no_change(ulps: int, seed: int):
    rng = np.random.default_rng([seed, ulps])
    sections, labels, seconds = [], [f"r{k}" for k in range(6)], []
    for _ in labels:
        n, reading = int(rng.integers(300, 2000)), rng.uniform(-10, 10, 3)
        rounding = np.spacing(np.abs(reading)) * rng.integers(-ulps, ulps + 1, (n, 3))
        sections.append(reading + rounding)
        seconds.append(n * DT)
    found = analyse_sections(haar_contrasts(sections, np.array(seconds)), labels, NAMES)
    assert min((test.p_value for test in found.tests), default=1.0) > 0.5
    assert not found.disturbance_variance.any()


def test_a_channel_with_noise_is_judged_beside_one_without():
    rng = np.random.default_rng(3)
    sections, labels = [], [f"r{k}" for k in range(6)]
    for k in range(6):
        y = np.stack([np.full(1000, 9.81 + k), 1e-3 * rng.standard_normal(1000)], axis=-1)
        y[500:, 1] += 1e-3 * (k == 2)
        sections.append(y)
    found = analyse_sections(haar_contrasts(sections, np.full(6, 10.0)), labels, ("ax", "ay"))
    assert found.within is not None
    assert found.within.p_value < 1e-6
    assert np.flatnonzero(found.disturbance_variance.any(axis=1)).tolist() == [2]


@pytest.mark.parametrize("seed", range(40))
def test_no_disturbance_has_the_size_zero(seed: int):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3000, 12000))
    start = [int(rng.integers(1, 150)), n - int(rng.integers(1, 150)), int(rng.integers(0, n))]
    y = rng.standard_normal(n)
    first = start[seed % 3]
    y[first : first + int(rng.integers(1, 300))] += 10 ** rng.uniform(0, 2)
    found = find_disturbances(y, DT)
    assert all(abs(one.size) > 0.05 for one in found)
    assert all(one.seconds > 0 for one in found)
    assert len({(one.time, one.size) for one in found}) == len(found)


@pytest.mark.parametrize("place", [30, 4970])
def test_a_step_within_a_second_of_an_end_is_found_where_it_is(place: int):
    y = np.random.default_rng(5).standard_normal(5000)
    y[place:] += 20.0
    (one,) = find_changes(y, DT)
    assert one.time == pytest.approx(place * DT, abs=0.02)
    assert one.size == pytest.approx(20.0, abs=1.0)
    assert one.kind == "step"
