"""Magnetometers at the rests and along the motion of a run by hand."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.magnetometer.hand_recordings import Made, faces, recording, scattered
from tests.magnetometer.hand_run_files import inputs, observed

NO_FIELD = {"sensor.magnetometer": None, "data.magnetometer": None}
NO_GYROS = {"sensor.gyro": None, "data.gyro": None}
SIX = {"method.name": '"six_position"', **NO_GYROS}


@pytest.fixture(scope="module")
def made() -> Made:
    rng = np.random.default_rng(1)
    return recording(scattered(24, rng), rng)


def test_the_uncertainty_of_a_slow_magnetometer_is_that_of_its_fresh_values(
    tmp_path: Path, made: Made
):
    made.write(tmp_path / "log.csv")
    found = observed(tmp_path).magnetic
    assert found is not None
    assert_array_equal(found.rest, np.arange(24))
    true = np.array([made.true_field[made.rest == k][0] for k in range(24)])
    z = (1e6 * found.mean - true) / (1e6 * np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)))
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.25  # 72 values: 1 ± 0.083
    assert_allclose(np.sqrt(np.diag(found.noise)), 0.5e-6, rtol=0.1)
    assert (found.samples < 300 / 5).all()


def test_other_axes_are_observed_as_if_there_were_no_magnetometers(tmp_path: Path, made: Made):
    made.write(tmp_path / "log.csv")
    with_field, without = observed(tmp_path), observed(tmp_path, NO_FIELD)
    assert without.magnetic is None
    assert_array_equal(with_field.mean, without.mean)
    assert_array_equal(with_field.covariance, without.covariance)
    assert with_field.transitions is not None
    assert without.transitions is not None
    assert_array_equal(with_field.transitions.start, without.transitions.start)


def test_pieces_of_motion_agree_with_the_true_field(tmp_path: Path, made: Made):
    made.write(tmp_path / "log.csv")
    found = observed(tmp_path).magnetic
    assert found is not None
    assert found.pieces is not None
    pieces = found.pieces
    true = [np.interp(pieces.time, made.time, x) for x in made.true_field.T]
    z = (1e6 * pieces.mean - np.column_stack(true)) * np.sqrt(pieces.samples)[:, None] / 0.5
    assert 0.9 < np.sqrt(np.mean(z**2)) < 1.1
    assert set(pieces.transition.tolist()) == set(range(23))


def test_a_row_is_dropped_with_its_rest(tmp_path: Path, made: Made):
    made.write(tmp_path / "log.csv")
    whole = observed(tmp_path)
    part = whole.rows([3, 5]).magnetic
    assert part is not None
    assert whole.magnetic is not None
    assert_array_equal(part.rest, [0, 1])
    assert_array_equal(part.mean, whole.magnetic.mean[[3, 5]])


@pytest.mark.slow
def test_a_magnetometer_with_a_slower_clock_may_leave_cells_empty(tmp_path: Path, made: Made):
    path = made.write(tmp_path / "log.csv")
    lines = path.read_text().splitlines()
    for k in range(2, len(lines)):
        if (k - 1) % 5:
            lines[k] = ",".join([*lines[k].split(",")[:7], "", "", ""])
    path.write_text("\n".join(lines) + "\n")
    found = observed(tmp_path, {"data.nonfinite": '"drop"'})
    assert found.magnetic is not None
    assert found.transitions is not None
    assert found.transitions.time.size > 5000  # no row of the other axes is lost
    true = np.array([made.true_field[made.rest == k][0] for k in range(24)])
    assert np.abs(1e6 * found.magnetic.mean - true).max() < 0.5


@pytest.mark.parametrize("marks", ["found", "labels"])
def test_six_faces_at_two_azimuths_give_twelve_rests(tmp_path: Path, marks: str):
    rng = np.random.default_rng(2)
    made = recording(faces(2), rng)
    names = np.array([f"{axis}_{sign}" for axis in "xyz" for sign in "pa" for _ in range(2)])
    label = np.where(made.rest < 0, "", names[made.rest])
    made.write(tmp_path / "log.csv", label=label)
    changes = {"data.label": '"label"', "data.marks": f'"{marks}"'} if marks == "labels" else {}
    found = observed(tmp_path, {**SIX, **changes})
    assert found.magnetic is not None
    assert sorted(found.labels) == sorted([*set(names), *(f"{name} (2)" for name in set(names))])
    for k, row in enumerate(found.magnetic.rest):
        name, _, visit = found.labels[row].partition(" (")
        number = 2 * names.tolist().index(name) // 2 + bool(visit)
        true = made.true_field[made.rest == number][0]
        assert_allclose(1e6 * found.magnetic.mean[k], true, atol=0.4)


def test_a_table_of_means_has_the_columns_of_the_magnetometers(tmp_path: Path):
    rng = np.random.default_rng(3)
    made = recording(faces(2), rng)
    rows = ["face,ax,ay,az,mx,my,mz"]
    names = [f"{axis}_{sign}" for axis in "xyz" for sign in "pa" for _ in range(2)]
    for k, name in enumerate(names):
        mean = [*made.force[made.rest == k].mean(axis=0), *made.field[made.rest == k].mean(axis=0)]
        rows.append(",".join([name, *(f"{x:.6f}" for x in mean)]))
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    found = observed(
        tmp_path,
        {
            **SIX,
            "data.kind": '"means"',
            "data.time": None,
            "data.label": '"face"',
            "data.sd": '{accelerometer = "1 mg", magnetometer = "0.1 µT"}',
        },
    ).magnetic
    assert found is not None
    assert_array_equal(found.rest, np.arange(12))
    true = np.array([made.true_field[made.rest == k][0] for k in range(12)])
    assert_allclose(1e6 * found.mean, true, atol=0.4)
    assert_allclose(found.covariance[0], 1e-14 * np.eye(3), rtol=1e-3)


def test_a_rest_with_a_saturated_axis_is_left_out(tmp_path: Path, made: Made):
    ended = made.field.copy()
    low, high = np.quantile(ended[:, 0], [0.0, 0.85])
    ended[:, 0] = np.clip(ended[:, 0], low, high)
    Made(made.time, made.force, made.rate, ended, made.true_field, made.rest).write(
        tmp_path / "log.csv"
    )
    found = inputs(tmp_path)
    magnetic = found.observations.magnetic
    lost = [one for one in found.findings if one.what == "magnetometer"]
    beyond = {k for k in range(24) if made.true_field[made.rest == k][0, 0] > high + 2}
    assert beyond
    assert not beyond & set(magnetic.rest.tolist())
    assert len(lost) == 24 - len(magnetic.rest)
