"""The magnetic field in simulations of a run by hand."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.magnetometer.hand_run_files import run_file

from inercal.pipeline import simulate, simulate_files
from inercal.runfile import read

SIX: dict[str, str | None] = {
    "method.name": '"six_position"',
    "sensor.gyro": None,
    "data.gyro": None,
    "data.time": None,
    "data.rate": '"20 Hz"',
}


def directions(data: np.ndarray) -> np.ndarray:
    return data / np.linalg.norm(data, axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("changes", "strength", "dip"),
    [
        ({}, 50.0, 65.0),
        ({"bench.hemisphere": '"south"'}, 50.0, -65.0),
        ({"bench.field": '"30 µT ± 0.0001 µT"', "bench.dip": '"-20° ± 0.0001°"'}, 30.0, -20.0),
    ],
)
@pytest.mark.parametrize("method", ["multi_position", "six_position"])
def test_the_field_has_its_strength_and_dip_in_all_attitudes(
    tmp_path: Path, method: str, changes: dict[str, str | None], strength: float, dip: float
):
    own = SIX if method == "six_position" else {"data.time": None, "data.rate": '"20 Hz"'}
    made = simulate(read(run_file(tmp_path, {**own, **changes})), 1)
    field, force = made.data[:, -3:], made.data[:, :3]
    assert_allclose(np.linalg.norm(field, axis=1), strength, rtol=1e-4)
    sine = -(directions(field) * directions(force)).sum(axis=1)
    assert_allclose(np.degrees(np.arcsin(sine)), dip, atol=1e-3)


def test_the_field_follows_the_gyros_from_rest_to_rest(tmp_path: Path):
    own = {"data.time": None, "data.rate": '"200 Hz"', "bench.latitude": '"0°"'}
    made = simulate(read(run_file(tmp_path, own)), 2)
    rate, field = made.data[:, 3:6], made.data[:, 6:]
    change = np.diff(field, axis=0) * 200
    expected = -np.cross(rate[:-1] + rate[1:], field[:-1] + field[1:]) / 4
    assert_allclose(change, expected, atol=0.02 * np.abs(change).max())


def test_a_plan_shows_two_azimuths_of_each_face_and_many_attitudes(tmp_path: Path):
    faces = simulate(read(run_file(tmp_path, SIX)), 3)
    assert faces.labels is not None
    assert len({str(name) for name in faces.labels} - {""}) == 12
    own = {"data.time": None, "data.rate": '"20 Hz"'}
    free = simulate(read(run_file(tmp_path, own)), 3)
    assert free.labels is not None
    names = {str(name) for name in free.labels} - {""}
    up = [free.data[free.labels == name, 2].mean() for name in names]
    assert len(names) >= 16
    assert min(up) < -8 < 8 < max(up)


def test_true_coefficients_move_the_readings_of_their_axis(tmp_path: Path):
    truth: dict[str, str | None] = {"sensor.truth": '{"mx.bias" = "12 µT", "my.scale" = "3 %"}'}
    plain, moved = (
        simulate_files(read(run_file(tmp_path, {**SIX, **one})), 4)["log.csv"]
        for one in ({}, truth)
    )
    assert moved.channels[-3:] == ("mx", "my", "mz")
    assert_allclose(moved.data[:, -3:], plain.data[:, -3:] * [1, 1.03, 1] + [12, 0, 0], atol=1e-9)
    assert_allclose(moved.data[:, :3], plain.data[:, :3])
