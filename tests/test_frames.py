"""Rotations against scipy's, and decompositions by putting them together again."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tests.refusals import refused

from inercal.physics.frames import (
    attitude_from_vertical,
    decompose_symmetric,
    decompose_triangular,
    exp_so3,
    log_so3,
    skew,
)

Array = NDArray[np.float64]
Decompose = Callable[[Array], tuple[Array, Array]]

rng = np.random.default_rng(3)
AXES = rng.normal(size=(200, 3))
AXES /= np.linalg.norm(AXES, axis=1, keepdims=True)
SHAPES = [(), (1,), (4,), (2, 5), (0,)]
ANGLES = [0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-4, 0.1, 1.0, 3.0, np.pi - 1e-4, np.pi - 1e-8]


def transpose(mat: Array) -> Array:
    return np.swapaxes(mat, -1, -2)


def random_matrices(*shape: int) -> Array:
    """Right-handed, far from identity, condition numbers to some hundreds."""
    mats = rng.normal(size=(*shape, 3, 3)) * 10 ** rng.uniform(-3, 3, size=(*shape, 1, 1))
    mats[..., 0, :] *= np.sign(np.linalg.det(mats))[..., None]
    return mats


def test_skew_is_the_cross_product():
    u, v = rng.normal(size=(2, 50, 3))
    assert_allclose((skew(v) @ u[..., None])[..., 0], np.cross(v, u), rtol=0, atol=1e-15)


@pytest.mark.parametrize("angle", [*ANGLES, np.pi, 4.0, 2 * np.pi, 100.0])
def test_exp_agrees_with_scipy(angle: float):
    rotvec = angle * AXES
    tolerance = 1e-15 * max(1.0, angle)
    assert_allclose(exp_so3(rotvec), Rotation.from_rotvec(rotvec).as_matrix(), atol=tolerance * 3)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.0, np.pi, 50.0])
def test_exp_is_orthogonal_to_rounding(angle: float):
    mat = exp_so3(angle * AXES)
    assert_allclose(mat @ transpose(mat), np.broadcast_to(np.eye(3), mat.shape), atol=2e-15)
    assert_allclose(np.linalg.det(mat), 1, atol=3e-15)


@pytest.mark.parametrize("angle", ANGLES)
def test_log_undoes_exp_to_full_relative_precision(angle: float):
    # Near π the matrix itself holds the axis to rounding and the angle to rounding.
    assert_allclose(log_so3(exp_so3(angle * AXES)), angle * AXES, rtol=1e-14, atol=2e-15 * angle)


def test_log_keeps_small_rotations_to_the_last_digits():
    tiny = np.array([1e-12, -2e-9, 3e-15])
    assert_allclose(log_so3(exp_so3(tiny)), tiny, rtol=1e-15)


def test_log_of_a_half_turn_is_pi_about_either_end_of_its_axis():
    rotvec = log_so3(exp_so3(np.pi * AXES))
    assert_allclose(np.linalg.norm(rotvec, axis=-1), np.pi, rtol=1e-15)
    assert_allclose(np.abs((rotvec * AXES).sum(-1)), np.pi, rtol=1e-15)
    for axis in np.eye(3):  # exact half turns, with no rounding to break the tie
        assert_array_equal(np.abs(log_so3(2 * np.outer(axis, axis) - np.eye(3))), np.pi * axis)


def test_log_agrees_with_scipy_on_random_rotations():
    rotation = Rotation.random(500, rng=rng)
    assert_allclose(log_so3(rotation.as_matrix()), rotation.as_rotvec(), rtol=0, atol=1e-14)


def test_exp_undoes_log():
    mat = Rotation.random(500, rng=rng).as_matrix()
    assert_allclose(exp_so3(log_so3(mat)), mat, rtol=0, atol=2e-15)


def test_exp_differentiates_to_the_cross_product():
    v, step = rng.normal(size=3), 1e-7
    slope = (exp_so3(step * v) - exp_so3(-step * v)) / (2 * step)
    assert_allclose(slope, skew(v), atol=1e-9)


def test_from_up_places_the_vertical_as_given():
    up, azimuth = rng.normal(size=(300, 3)) * 40, rng.uniform(-7, 7, 300)
    mat_bn = attitude_from_vertical(up, azimuth)
    unit = up / np.linalg.norm(up, axis=1, keepdims=True)
    assert_allclose(mat_bn @ [0, 0, 1], unit, atol=1e-15)
    assert_allclose(mat_bn @ transpose(mat_bn), np.broadcast_to(np.eye(3), (300, 3, 3)), atol=2e-15)
    assert_allclose(np.linalg.det(mat_bn), 1, atol=3e-15)


@pytest.mark.parametrize("z", [1.0, -1.0])
@pytest.mark.parametrize("tilt", [0.0, 1e-300, 1e-12, 1e-8])
def test_from_up_is_orthonormal_at_and_near_both_verticals(z: float, tilt: float):
    mat = attitude_from_vertical([tilt, -tilt, z])
    assert_allclose(mat @ mat.T, np.eye(3), atol=1e-15)
    assert_allclose(mat[:, 2], [tilt, -tilt, z], atol=1e-15)


def test_from_up_of_a_level_body_is_the_level_frame():
    assert_array_equal(attitude_from_vertical([0, 0, 2.0]), np.eye(3))


def test_azimuth_counts_clockwise_from_above():
    mat_bn = attitude_from_vertical([0, 0, 1], np.pi / 2)
    assert_allclose(mat_bn.T @ [0, 1, 0], [1, 0, 0], atol=1e-15)  # y from north to east


def test_azimuth_turns_a_tilted_body_about_the_vertical():
    up = AXES[0]
    mat_nb, turned_nb = attitude_from_vertical(up).T, attitude_from_vertical(up, 0.7).T
    assert_allclose(turned_nb, exp_so3([0, 0, -0.7]) @ mat_nb, atol=1e-15)


@pytest.mark.parametrize("up", [[0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 0]])
def test_from_up_refuses_a_direction_without_length(up: list[float]):
    with refused(key="up"):
        attitude_from_vertical(up)


@pytest.mark.parametrize("decompose", [decompose_triangular, decompose_symmetric])
@pytest.mark.parametrize("shape", SHAPES)
def test_parts_multiply_to_the_matrix_and_the_second_is_a_rotation(
    decompose: Decompose, shape: tuple[int, ...]
):
    mat = random_matrices(*shape)
    part, rotation = decompose(mat)
    assert part.shape == rotation.shape == mat.shape
    size = np.linalg.norm(mat, axis=(-2, -1), keepdims=True)
    assert_allclose(part @ rotation / size, mat / size, rtol=0, atol=1e-14)
    eye = np.broadcast_to(np.eye(3), mat.shape)
    assert_allclose(rotation @ transpose(rotation), eye, rtol=0, atol=1e-14)
    assert_allclose(np.linalg.det(rotation), 1, atol=1e-14)


def test_triangular_part_is_lower_with_a_positive_diagonal():
    lower, _ = decompose_triangular(random_matrices(300))
    assert_array_equal(lower, np.tril(lower))
    assert (np.diagonal(lower, axis1=-2, axis2=-1) > 0).all()


def test_symmetric_part_is_symmetric_and_positive_definite():
    shape, _ = decompose_symmetric(random_matrices(300))
    assert_array_equal(shape, transpose(shape))
    assert (np.linalg.eigvalsh(shape) > 0).all()


def test_parts_are_recovered_from_their_product():
    rotation = Rotation.random(100, rng=rng).as_matrix()
    lower = np.tril(rng.normal(size=(100, 3, 3)), -1) + np.eye(3) * rng.uniform(0.5, 2, (100, 1, 3))
    found, turn = decompose_triangular(lower @ rotation)
    assert_allclose(found, lower, atol=1e-13)
    assert_allclose(turn, rotation, atol=1e-13)
    shape = lower @ transpose(lower)
    found, turn = decompose_symmetric(shape @ rotation)
    assert_allclose(found, shape, atol=1e-13)
    assert_allclose(turn, rotation, atol=1e-12)  # condition numbers to some hundreds


def test_symmetric_rotation_is_the_nearest_one():
    mat = np.eye(3) + 0.2 * rng.normal(size=(3, 3))
    _, rotation = decompose_symmetric(mat)
    distance = np.linalg.norm(mat - rotation)
    others = exp_so3(1e-3 * AXES) @ rotation
    assert (np.linalg.norm(mat - others, axis=(-2, -1)) > distance).all()


def test_decompositions_of_a_rotation_are_the_identity_and_itself():
    mat = exp_so3([0.4, -1.0, 2.0])
    for decompose in (decompose_triangular, decompose_symmetric):
        part, rotation = decompose(mat)
        assert_allclose(part, np.eye(3), atol=1e-15)
        assert_allclose(rotation, mat, atol=1e-15)


def test_rows_of_very_different_sensitivity_keep_their_own_precision():
    scale = np.array([1e-9, 1.0, 1e9])[:, None]
    mat = exp_so3([0.1, 0.2, 0.3]) + 0.01 * rng.normal(size=(3, 3))
    lower, rotation = decompose_triangular(scale * mat)
    assert_allclose(lower @ rotation / scale, mat, atol=1e-14)


@pytest.mark.parametrize("decompose", [decompose_triangular, decompose_symmetric])
@pytest.mark.parametrize(
    "mat",
    [
        np.zeros((3, 3)),
        np.arange(9.0).reshape(3, 3),
        np.diag([1.0, 1.0, 0.0]),
        np.diag([1.0, 1.0, -1.0]),
        np.full((3, 3), np.nan),
        np.stack([np.eye(3), np.ones((3, 3))]),
    ],
)
def test_matrices_without_a_unique_decomposition_are_refused(decompose: Decompose, mat: Array):
    with refused(key="mat"):
        decompose(mat)
