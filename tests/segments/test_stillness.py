"""Which marked sections count as rests: a change of the mean, not of the scatter."""

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.physics.sensors import G0, Noise, Readout, imu
from inercal.recordings import Mark, Recording
from inercal.recordings.segments import require_still

Array = NDArray[np.float64]
RATE, SECONDS, RESTS = 100.0, 10.0, 6
N = round(RATE * SECONDS)
SENSOR = imu("imu", (Readout(1 / G0, 0.0, "g"), Noise()), (Readout(unit="rad/s"), Noise()))
MARKS = tuple(Mark(f"p{k:02d}", k * N, (k + 1) * N) for k in range(RESTS))
QUIET = np.repeat([1e-3, 1e-3], 3)  # g, rad/s
THIRD = slice(2 * N, 3 * N)


def recording(data: Array) -> Recording:
    time = np.arange(len(data)) / RATE
    return Recording(time, data, SENSOR.channels, ("g",) * 3 + ("rad/s",) * 3, source="log.csv")


def session(seed: int, noise: Array = QUIET) -> Array:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.normal(size=(RESTS, 6)), N, axis=0) + noise * rng.normal(
        size=(RESTS * N, 6)
    )


def slow(rng: np.random.Generator, seconds: float) -> Array:
    """Return N samples of first-order noise of variance 1 with a correlation time."""
    keep = float(np.exp(-1 / (RATE * seconds)))
    y = np.empty(N)
    y[0] = rng.normal()
    for k in range(1, N):
        y[k] = keep * y[k - 1] + np.sqrt(1 - keep**2) * rng.normal()
    return y


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("times", [12.0, 40.0, 500.0])
def test_white_noise_however_large_is_no_move(seed: int, times: float):
    data = session(seed)
    data[THIRD] += times * QUIET * np.random.default_rng(seed).normal(size=(N, 6))
    assert require_still(recording(data), SENSOR, MARKS) == ()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("seconds", [0.05, 1.0])
def test_noise_of_a_second_twelve_times_that_of_others_is_no_move(seed: int, seconds: float):
    rng = np.random.default_rng(seed)
    data = session(seed)
    data[THIRD, 0] += 12e-3 * slow(rng, seconds)
    assert require_still(recording(data), SENSOR, MARKS) == ()


def test_channels_that_stand_still_in_float_are_no_measure_of_a_move():
    data = session(3, 0 * QUIET)
    data[THIRD, 3] += 3e-7 * np.linspace(-1, 1, N)  # beside 1e-17 from rounding elsewhere
    assert require_still(recording(data), SENSOR, MARKS) == ()


@pytest.mark.parametrize("drift", [2e-3, 20e-3])
def test_a_drift_common_to_all_rests_is_no_move(drift: float):
    data = session(3, 0.01 * QUIET)
    data[:, 1] += drift * np.linspace(0, 1, len(data))
    assert require_still(recording(data), SENSOR, MARKS) == ()


def test_a_change_of_two_steps_of_a_coarse_channel_is_no_move():
    data = np.round(session(4, 0.02 * QUIET) / 4e-3) * 4e-3
    data[2 * N + 300 : 2 * N + 700, 1] += 8e-3
    assert require_still(recording(data), SENSOR, MARKS) == ()


@pytest.mark.parametrize(
    ("channel", "change"),
    [(0, 0.05), (2, -0.05), (5, 0.05)],
)
@pytest.mark.parametrize("part", [slice(0, N // 10), slice(N // 2, N), slice(400, 480)])
def test_a_move_within_a_section_is_refused_with_its_name(channel: int, change: float, part: slice):
    data = session(5)
    data[THIRD][part, channel] += change
    with refused(names=["p02"]):
        require_still(recording(data), SENSOR, MARKS)


def test_a_sensor_in_the_hand_all_along_a_section_is_refused():
    rng = np.random.default_rng(6)
    data = session(6)
    for k in range(3):
        data[THIRD, k] += 0.3 * slow(rng, 0.5)
        data[THIRD, 3 + k] += 0.5 * slow(rng, 0.5)
    with refused(names=["p02"]):
        require_still(recording(data), SENSOR, MARKS)


def test_an_accepted_section_that_moves_is_a_warning():
    data = session(7)
    data[2 * N + 300 : 3 * N, 0] += 0.05
    (finding,) = require_still(recording(data), SENSOR, MARKS, ["p02"])
    assert (finding.severity, finding.start, finding.stop) == ("warning", 2 * N, 3 * N)
    with refused(names=["p02"]):
        require_still(recording(data), SENSOR, MARKS, [])


def test_accepting_a_section_that_is_none_or_still_is_refused():
    data = session(8)
    with refused(key="[data] accept_moving", names=["p99"]):
        require_still(recording(data), SENSOR, MARKS, ["p99"])
    with refused(key="[data] accept_moving", names=["p02"]):
        require_still(recording(data), SENSOR, MARKS, ["p02"])


def test_a_single_wild_reading_is_named_with_its_time():
    data = session(5)
    data[2 * N + 300, 2] += 80.0
    with pytest.raises(InputError, match=r"az at 23 s, .* far from all others"):
        require_still(recording(data), SENSOR, MARKS)
    data[2 * N + 300 : 2 * N + 400, 2] = data[2 * N + 300, 2]
    with pytest.raises(InputError, match="section p02 moves"):
        require_still(recording(data), SENSOR, MARKS)
