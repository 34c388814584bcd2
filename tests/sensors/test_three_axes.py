"""Closed forms of three axes against LAPACK."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from inercal.basics.errors import NotInvertible
from inercal.physics.sensors import inverse, triad
from inercal.physics.sensors.inverse import determinant, invert, solve

RNG = np.random.default_rng(3)
MATRICES = np.eye(3) + 0.3 * RNG.standard_normal((4, 50, 3, 3))
RIGHT = RNG.standard_normal((4, 50, 3))


def test_closed_forms_agree_with_lapack_at_rounding():
    inverses = np.linalg.inv(MATRICES)
    assert_allclose(determinant(MATRICES), np.linalg.det(MATRICES), rtol=1e-13)
    assert_allclose(invert(MATRICES), inverses, atol=1e-13 * np.abs(inverses).max())
    x = np.linalg.solve(MATRICES, RIGHT[..., None])[..., 0]
    assert_allclose(solve(MATRICES, RIGHT), x, atol=1e-13 * np.abs(inverses).max())


def test_one_matrix_is_shared_by_many_right_sides():
    expected = RIGHT[0] @ np.linalg.inv(MATRICES[0, 0]).T
    assert_allclose(solve(MATRICES[0, :1], RIGHT[0]), expected, rtol=1e-11)


def test_an_axis_that_reads_nothing_is_refused():
    sensor = triad("triad", "f").with_coefficients("k1", "k2")
    c = np.where([name == "x.k1" for name in sensor.coefficients], -1.0, 0.0)
    with pytest.raises(NotInvertible):
        inverse(sensor, np.zeros((2, 3)), c)
