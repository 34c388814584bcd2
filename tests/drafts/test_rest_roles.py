"""Logs at rest without names, for a noise analysis: only gravity tells the triads apart."""

from pathlib import Path

import numpy as np
import pytest

from inercal.basics.errors import InputError
from inercal.pipeline.drafts.rest_recording import read_rest_recording

HZ = 100.0
COUNT = np.arange(4000)
_RNG = np.random.default_rng(3)
FORCE = np.array([0.1, -0.2, 0.97]) + _RNG.normal(0, 2e-3, (COUNT.size, 3))  # g
RATE = np.array([0.7, -0.6, 0.3]) + _RNG.normal(0, 0.05, (COUNT.size, 3))  # °/s, of norm 1
STATED = {"sensor.gyro.unit": "°/s"}


def written(path: Path, *columns: np.ndarray) -> Path:
    np.savetxt(path, np.column_stack(columns), delimiter=",", fmt="%.10g")
    return path


@pytest.mark.parametrize("scale", [1.0, 9.80665, 1000.0], ids=["g", "m/s²", "mg"])
@pytest.mark.parametrize("first", ["accelerometers", "gyros"])
def test_the_triad_that_reads_gravity_is_that_of_the_accelerometers(
    scale: float, first: str, tmp_path: Path
):
    rate = RATE + 1.2  # no longer of norm 1
    parts = (scale * FORCE, rate) if first == "accelerometers" else (rate, scale * FORCE)
    found = read_rest_recording(written(tmp_path / "log.csv", COUNT / HZ, *parts), STATED)
    assert found.channels == ("ax", "ay", "az", "gx", "gy", "gz")
    np.testing.assert_allclose(found.data[:, :3].mean(axis=0), FORCE.mean(axis=0) * 9.80665)
    np.testing.assert_allclose(found.data[:, 3:].mean(axis=0), np.radians(rate.mean(axis=0)))


def test_whole_seconds_without_a_name_suggest_the_rate(tmp_path: Path):
    log = written(tmp_path / "log.csv", np.floor(1.7e9 + COUNT / HZ), FORCE, RATE + 1.2)
    with pytest.raises(InputError) as caught:
        read_rest_recording(log, STATED | {"sensor.accelerometer.unit": "g"})
    assert caught.value.key == "data.rate"
    assert str(caught.value).endswith('rate = "100 Hz"')


@pytest.mark.parametrize(
    "parts",
    [(FORCE,), (RATE,), (FORCE, RATE), (np.rint(16384 * FORCE),), (3 * FORCE, RATE + 1)],
    ids=["g alone", "gyros of norm 1 alone", "both of norm 1", "counts", "no gravity"],
)
def test_triads_that_may_be_either_are_not_guessed(parts: tuple[np.ndarray, ...], tmp_path: Path):
    log = written(tmp_path / "log.csv", COUNT / HZ, *parts)
    with pytest.raises(InputError) as caught:
        read_rest_recording(log, STATED)
    assert caught.value.key == "data.accelerometer"
    stated = STATED | {"data.gyro": "[2, 3, 4]"}
    assert read_rest_recording(log, stated).channels[-3:] == ("gx", "gy", "gz")


@pytest.mark.parametrize("bits", [8, 16, 32])
def test_packet_counters_of_any_size_are_unwrapped_and_show_lost_packets(bits: int, tmp_path: Path):
    kept = np.delete(COUNT, [1500, 1501, 1502])
    counter = (kept + 2**bits - 100) % 2**bits
    log = written(tmp_path / "log.csv", counter, 9.81 * FORCE[kept], RATE[kept] + 1)
    found = read_rest_recording(log, STATED | {"data.rate": f"{HZ:g} Hz"})
    np.testing.assert_allclose(found.time, kept / HZ, atol=1e-9)


def test_a_stated_rate_does_not_replace_seconds_that_contradict_it(tmp_path: Path):
    log = written(tmp_path / "log.csv", COUNT / HZ, 9.81 * FORCE, RATE + 1)
    with pytest.raises(InputError) as caught:
        read_rest_recording(log, STATED | {"data.rate": f"{2 * HZ:g} Hz"})
    assert caught.value.key == "[data] rate"
