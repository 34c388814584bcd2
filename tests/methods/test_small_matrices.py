"""Matrices as numbers: their products, and rotations of any size.

Compiled functions of numbers have no wrapper for Python; their sources run here.
"""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inercal.methods.turntable import small_matrices as small
from inercal.methods.turntable import strapdown


def numbers(array: np.ndarray) -> Any:
    return tuple(array.ravel().tolist())


@pytest.fixture
def python(monkeypatch: pytest.MonkeyPatch):
    """Let the functions call one another's sources."""
    for module in (small, strapdown):
        for name, function in vars(module).copy().items():
            if hasattr(function, "py_func"):
                monkeypatch.setattr(module, name, function.py_func)


@pytest.mark.usefixtures("python")
def test_products_are_those_of_numpy():
    rng = np.random.default_rng(3)
    a, b, v = rng.standard_normal((3, 3)), rng.standard_normal((3, 3)), rng.standard_normal(3)
    w = rng.standard_normal(3)
    m, n, x = numbers(a), numbers(b), numbers(v)
    np.testing.assert_allclose(small.times_matrix(m, n), (a @ b).ravel(), rtol=1e-14)
    np.testing.assert_allclose(small.times_vector(m, x), a @ v, rtol=1e-14)
    np.testing.assert_allclose(small.transposed_times(m, x), a.T @ v, rtol=1e-14)
    np.testing.assert_allclose(small.cross(x, numbers(w)), np.cross(v, w), rtol=1e-14)
    assert small.matrix(a) == m
    assert small.vector(v) == x


@pytest.mark.usefixtures("python")
def test_numbers_are_written_where_they_belong():
    rng = np.random.default_rng(4)
    a, v = rng.standard_normal((3, 3)), rng.standard_normal(3)
    whole, row, copied, part = np.zeros((3, 3)), np.zeros(9), np.zeros(9), np.zeros(3)
    small.write_matrix(numbers(a), whole)
    small.write_row(numbers(a), row)
    small.copy_row(row, copied)
    small.write_vector(numbers(v), part)
    np.testing.assert_array_equal(whole, a)
    np.testing.assert_array_equal(row, a.ravel())
    np.testing.assert_array_equal(copied, row)
    np.testing.assert_array_equal(part, v)


@pytest.mark.usefixtures("python")
@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-4, 9.99e-3, 1.001e-2, 0.3, 3.0])
def test_turns_of_any_size_are_those_of_scipy(size: float):
    rng = np.random.default_rng(5)
    c, axis = Rotation.random(rng=rng).as_matrix(), rng.standard_normal(3)
    v = size * axis / np.linalg.norm(axis)
    wanted = c @ Rotation.from_rotvec(v).as_matrix()
    np.testing.assert_allclose(
        np.reshape(strapdown.turned(numbers(c), numbers(v)), (3, 3)), wanted, atol=4e-16, rtol=0
    )
    turned = c.copy()
    strapdown.rotate(turned, v)
    np.testing.assert_allclose(turned, wanted, atol=4e-16, rtol=0)
