"""A recording in pieces gives what it gives whole."""

from dataclasses import replace

import numpy as np
import pytest
from tests.noise.generator import MEMS, draw

from inercal.noise import analyse_noise, analyse_noise_stream
from inercal.noise.deviations import deviations
from inercal.noise.streaming import StreamedChannel
from inercal.recordings import Recording

N = 300_000


@pytest.fixture(scope="module")
def series() -> np.ndarray:
    return draw(replace(MEMS, n=N), 7)[0] + 0.01


@pytest.mark.parametrize("size", [997, 65_536, N])
def test_the_allan_deviation_of_pieces_is_that_of_the_whole(series: np.ndarray, size: int):
    streamed = StreamedChannel(MEMS.dt)
    for start in range(0, N, size):
        streamed.add(series[start : start + size])
    found, whole = streamed.oadev(), deviations(series, MEMS.dt)
    k = found.tau.size
    assert k >= whole.tau.size - 1
    short = found.tau <= 1024 * MEMS.dt
    assert np.allclose(found.value[short], whole.value[:k][short], rtol=1e-9)
    # Past 1024 the differences of the pieces begin at other samples.
    assert np.allclose(found.value, whole.value[:k], rtol=0.03)
    assert streamed.mean == pytest.approx(series.mean(), rel=1e-12)


@pytest.mark.evidence
def test_the_coefficients_of_pieces_are_those_of_the_whole(series: np.ndarray):
    pieces = (series[start : start + 10_000, None] for start in range(0, N, 10_000))
    streamed = analyse_noise_stream(pieces, MEMS.dt, ["gx"], ["rad/s"]).channels[0]
    recording = Recording(MEMS.dt * np.arange(float(N)), series[:, None], ("gx",), ("rad/s",))
    whole = analyse_noise(recording, kinds=()).channels[0]
    assert streamed.fit.symbols == whole.fit.symbols
    for one, other in zip(streamed.coefficients, whole.coefficients, strict=True):
        assert abs(one.value - other.value) < 0.3 * other.u


@pytest.mark.slow
@pytest.mark.parametrize("step", [60, 1000])
def test_a_step_and_a_burst_of_a_stream_are_found(series: np.ndarray, step: float):
    y = series.copy()
    y[160_000:] += step * MEMS.unit
    y[40_000:40_040] += 60 * MEMS.unit * np.random.default_rng(1).standard_normal(40)
    pieces = (y[start : start + 10_000, None] for start in range(0, N, 10_000))
    found = analyse_noise_stream(pieces, MEMS.dt, ["gx"], ["rad/s"], terms="NBK").channels[0]
    kinds = {one.kind: one.time for one in found.disturbances}
    assert len(found.disturbances) == 2
    assert kinds["step"] == pytest.approx(40_000, abs=64 * MEMS.dt)
    assert kinds["burst"] == pytest.approx(10_000, abs=10)
