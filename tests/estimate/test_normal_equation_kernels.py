import numpy as np
import pytest
from numpy.testing import assert_allclose

from inercal.estimation import _kernels, gauss_newton_steps


def case(trials: int, m: int, k: int, seed: int = 0):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(trials, m, k)) * 10.0 ** rng.integers(-4, 4, size=k)
    rows[:, : m // 2, 0] = 0.0  # rows that do not see a parameter, as on a bench
    weight = rng.uniform(0.5, 2, size=(trials, m))
    prior_rows = np.eye(k)[: k // 2] * 0.3
    return rows, weight, rng.normal(size=(trials, m)), prior_rows, rng.normal(size=(trials, k // 2))


# 1, a part of a block, exactly one, one and a bit
@pytest.mark.parametrize("trials", [1, 5, 32, 33, 70])
@pytest.mark.parametrize("damped", [False, True])
def test_solve_agrees_with_dense_algebra(trials: int, damped: bool):
    rows, weight, u, prior_rows, v = case(trials, 12, 7)
    damping = np.full(trials, 0.1 if damped else 0.0)
    prior, pull = prior_rows.T @ prior_rows, v @ prior_rows
    triangle, slope = _kernels.normal_equations(rows, weight, u, 32)
    step, predicted, ok = _kernels.solve(triangle, prior, slope + pull, damping, 32)
    assert ok.all()
    a = rows * weight[..., None]
    for t in range(trials):
        normal = a[t].T @ a[t] + prior
        gradient = a[t].T @ u[t] + pull[t]
        damped_normal = normal + damping[t] * np.diag(np.diag(normal))
        size = np.sqrt(np.diag(normal))
        expected = np.linalg.solve(damped_normal / np.outer(size, size), gradient / size) / size
        assert_allclose(step[t], expected, rtol=1e-9)
        fall = 2 * gradient @ expected - expected @ normal @ expected
        assert_allclose(predicted[t], fall, rtol=1e-9)


@pytest.mark.parametrize("trials", [1, 32, 70])
def test_inverse_agrees_with_dense_algebra(trials: int):
    rows, weight, _, prior_rows, _ = case(trials, 12, 7)
    triangle, _ = _kernels.normal_equations(rows, weight, np.zeros((1, 12)), 32)
    inverse, ok = _kernels.inverse(triangle, prior_rows.T @ prior_rows, 32)
    assert ok.all()
    a = rows * weight[..., None]
    identity = (np.swapaxes(a, -1, -2) @ a + prior_rows.T @ prior_rows) @ inverse
    # Columns differ in size by many decades: compare in units of the columns.
    size = np.linalg.norm(a, axis=1)
    scaled = identity * size[:, None, :] / size[:, :, None]
    assert_allclose(scaled, np.broadcast_to(np.eye(7), scaled.shape), atol=1e-9)


@pytest.mark.parametrize("shared", ["rows", "weight", "both"])
def test_rows_and_weights_may_be_shared_by_all_trials(shared: str):
    rows, weight, u, prior_rows, v = case(20, 12, 7)
    rows = rows[:1] if shared != "weight" else rows
    weight = weight[:1] if shared != "rows" else weight
    step = gauss_newton_steps.solve(rows, weight, u, prior_rows, v, np.zeros(20))
    whole = np.broadcast_to(rows, (20, 12, 7)), np.broadcast_to(weight, (20, 12))
    expected = gauss_newton_steps.solve(*whole, u, prior_rows, v, np.zeros(20))
    assert_allclose(step.step, expected.step, rtol=1e-9)
    assert_allclose(step.predicted, expected.predicted, rtol=1e-9)


def test_a_singular_trial_is_marked_and_spoils_no_other():
    rows, weight, u, _, _ = case(40, 12, 7)
    rows[17, :, 3] = rows[17, :, 2]
    rows[30, :, 5] = 0.0
    none = np.zeros((7, 7))
    triangle, slope = _kernels.normal_equations(rows, weight, u, 32)
    _, _, ok = _kernels.solve(triangle, none, slope, np.zeros(40), 32)
    assert set(np.flatnonzero(~ok)) == {17, 30}
    inverse, ok = _kernels.inverse(triangle, none, 32)
    assert set(np.flatnonzero(~ok)) == {17, 30}
    assert np.all(np.isfinite(inverse[ok]))


@pytest.mark.parametrize("damped", [False, True])
def test_one_by_one_and_together_give_the_same_step(damped: bool):
    rows, weight, u, prior_rows, v = case(80, 12, 7)
    damping = np.full(80, 0.1 if damped else 0.0)
    together = gauss_newton_steps.solve(rows, weight, u, prior_rows, v, damping)
    few = slice(0, gauss_newton_steps.QR_MAX_TRIALS)
    alone = gauss_newton_steps.solve(
        rows[few], weight[few], u[few], prior_rows, v[few], damping[few]
    )
    assert_allclose(together.step[few], alone.step, rtol=1e-9)
    assert_allclose(together.predicted[few], alone.predicted, rtol=1e-9)
    covariance, ok = gauss_newton_steps.covariance(rows, weight, prior_rows)
    assert ok.all()
    size = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    other = gauss_newton_steps.covariance(rows[few], weight[few], prior_rows)[0]
    scale = size[few, :, None] * size[few, None, :]
    assert_allclose(covariance[few] / scale, other / scale, atol=1e-9)
