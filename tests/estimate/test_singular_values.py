"""Singular values where the usual algorithm fails."""

import numpy as np
import pytest

from inercal.estimation.whitened_problem import svd, svds


def test_matrices_on_which_divide_and_conquer_fails_have_singular_values(
    monkeypatch: pytest.MonkeyPatch,
):
    def fails(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    matrix = np.random.default_rng(1).normal(size=(7, 4))
    sizes = np.sqrt(np.linalg.eigvalsh(matrix.T @ matrix)[::-1])
    monkeypatch.setattr(np.linalg, "svd", fails)
    for full in (True, False):
        u, s, vt = svd(matrix, full_matrices=full)
        assert s == pytest.approx(sizes)
        assert u.shape == (7, 7 if full else 4)
        np.testing.assert_allclose(u[:, :4] * s @ vt, matrix, atol=1e-12)


def test_one_column_has_its_length():
    u, s, vt = svds(np.array([[3.0], [0.0], [4.0]]))
    assert (u * s @ vt).tolist() == [[3.0], [0.0], [4.0]]
    assert s.tolist() == [5.0]
    assert svds(np.zeros((3, 1)))[1].tolist() == [0.0]
