"""Long averaging times: which differences are used, and how many degrees of freedom they give."""

import allantools
import numpy as np
import pytest
from tests.noise.generator import MEMS, draw

from inercal.basics.arrays import Array
from inercal.noise.confidence import degrees_of_freedom
from inercal.noise.deviations import FULL_OVERLAP, deviations
from inercal.noise.pieces import Part, gap_oadev

N = 1 << 14


@pytest.mark.slow
def test_all_averaging_times_use_every_difference():
    y = draw(MEMS, 6)[0][:N] + 1e-7 * np.arange(N)  # with a ramp, which is large at long times
    found = deviations(y, MEMS.dt, spacing="all")
    m = np.array([1, 7, FULL_OVERLAP, FULL_OVERLAP + 1, 3001, N // 2 - 1])
    tau, value, _, count = allantools.oadev(y, rate=1 / MEMS.dt, data_type="freq", taus=m * MEMS.dt)
    np.testing.assert_allclose(tau, m * MEMS.dt)
    np.testing.assert_allclose(found.value[m - 1], value, rtol=1e-9)
    np.testing.assert_array_equal(found.count[m - 1], count)
    np.testing.assert_array_equal(found.count, N + 1 - 2 * np.arange(1, N // 2 + 1))


@pytest.mark.slow
def test_all_averaging_times_of_pieces_use_every_difference():
    y = draw(MEMS, 6)[0][:N]
    whole = deviations(y, MEMS.dt, spacing="all")
    cut = N // 3
    parts = [Part(y[:cut], 0.0), Part(y[cut:], cut * MEMS.dt)]  # a gap of no length
    pieces = gap_oadev(parts, MEMS.dt, "all")
    np.testing.assert_allclose(pieces.value, whole.value, rtol=1e-9)
    np.testing.assert_array_equal(pieces.count, whole.count)


def test_by_default_every_sixteenth_of_an_averaging_time_is_used():
    y = draw(MEMS, 6)[0]
    octaves = deviations(y, MEMS.dt)
    short = octaves.tau <= FULL_OVERLAP * MEMS.dt * 1.001
    factor = np.rint(octaves.tau / MEMS.dt).astype(int)
    np.testing.assert_array_equal(octaves.count[short], y.size + 1 - 2 * factor[short])
    stride = factor[~short] // 16
    np.testing.assert_array_equal(
        octaves.count[~short], (y.size - 2 * factor[~short]) // stride + 1
    )


def noise(alpha: int, rng: np.random.Generator, n: int) -> Array:
    white = rng.standard_normal(n + 1)
    return np.diff(white) if alpha == 2 else white[1:] if alpha == 0 else np.cumsum(white[1:])


@pytest.mark.parametrize("alpha", [2, 0, -2])
def test_the_degrees_of_freedom_are_those_of_the_differences_that_are_used(alpha: int):
    n, m, draws = 1 << 15, 2048, 300
    rng = np.random.default_rng(20 + alpha)
    variances = [
        deviations(noise(alpha, rng, n), 1.0, factors=[m]).value[0] ** 2 for _ in range(draws)
    ]
    seen = 2 * np.mean(variances) ** 2 / np.var(variances, ddof=1)
    stated = degrees_of_freedom("oadev", alpha, m, n, 16)
    # The relative sd of a variance of nearly Gaussian draws, five of them.
    assert seen == pytest.approx(stated, rel=5 * np.sqrt(2 / draws) * (1 + 6 / stated))
    if alpha == 2:  # the differences in between hold further noise
        assert degrees_of_freedom("oadev", alpha, m, n) > 20 * stated
        found = deviations(noise(alpha, rng, n), 1.0, factors=[m])
        assert found.label == ("quantisation",)
        assert found.edf[0] == pytest.approx(stated)
