"""The stated uncertainty is the true one: errors over many trials, drawn as the problem says."""

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.estimation import Cauchy, Gaussian, Problem, least_squares

Array = NDArray[np.float64]
SEEDS = [11, 22, 33]
TRIALS = 2000
U = np.random.default_rng(0).normal(size=(15, 2))
NAMES = ("a", "b", "c", "n1", "n2")
SD = 0.02
PRIOR_SD = np.array([0.03, 0.05])


def model(x: Array) -> tuple[Array, Array]:
    """Mildly nonlinear in three wanted parameters and two nuisances."""
    a, b, c, n1, n2 = (x[..., i, None] for i in range(5))
    u, v = U[:, 0] + n1, U[:, 1] * (1 + n2)
    h = a + b * u + c * u * v
    columns = (np.ones_like(h), u, u * v, b + c * v, c * u * U[:, 1])
    return h, np.stack([np.broadcast_to(column, h.shape) for column in columns], axis=-1)


def draw(seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    truth = np.tile([0.1, 1.0, 0.3, 0.0, 0.0], (TRIALS, 1))
    truth[:, 3:] = PRIOR_SD * rng.normal(size=(TRIALS, 2))
    return truth, model(truth)[0] + SD * rng.normal(size=(TRIALS, 15))


def problem(y: Array) -> Problem:
    return Problem(
        names=NAMES,
        start=np.tile([0.0, 1.0, 0.0, 0.0, 0.0], (TRIALS, 1)),
        linearise=lambda x: (y - model(x)[0], model(x)[1]),
        noise=np.full(15, SD),
        scale=np.array([0.1, 0.1, 0.1, *PRIOR_SD]),
        priors=(Gaussian.independent(NAMES[3:], 0.0, PRIOR_SD),),
        wanted=NAMES[:3],
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_errors_squared_over_covariance_average_to_the_number_of_parameters(seed: int):
    truth, y = draw(seed)
    estimate = least_squares(problem(y))
    assert estimate.converged.all()
    for wanted in (estimate, estimate.select(NAMES[:3])):
        p = len(wanted.names)
        error = wanted.value - truth[:, :p]
        nees = np.einsum(
            "ti,ti->t", error, np.linalg.solve(wanted.covariance, error[..., None])[..., 0]
        )
        assert abs(np.mean(nees) - p) < 4 * np.sqrt(2 * p / TRIALS)
    # The same of χ²: fifteen observations and two priors, five parameters.
    assert estimate.dof == 12
    assert abs(np.mean(estimate.chi2) - 12) < 4 * np.sqrt(2 * 12 / TRIALS)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_bias_and_the_variance_of_cramer_and_rao(seed: int):
    truth, y = draw(seed)
    error = least_squares(problem(y)).value - truth
    jacobian = model(np.array([0.1, 1.0, 0.3, 0.0, 0.0]))[1] / SD
    bound = np.linalg.inv(jacobian.T @ jacobian + np.diag([0, 0, 0, *PRIOR_SD**-2.0]))
    sd = np.sqrt(np.diag(bound))
    assert np.all(np.abs(error.mean(axis=0)) < 4 * sd / np.sqrt(TRIALS))
    # The nuisances move the design from trial to trial: a few per cent beside the sampling.
    ratio = error.std(axis=0) / sd
    assert np.all(np.abs(ratio - 1) < 4 / np.sqrt(2 * TRIALS) + 0.02)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_robust_loss_states_its_uncertainty_with_and_without_outliers(seed: int):
    rng = np.random.default_rng(seed)
    m, p, trials = 80, 4, 500
    design = rng.normal(size=(m, p))
    truth = rng.normal(size=(trials, p))
    clean = truth @ design.T + SD * rng.normal(size=(trials, m))
    outliers = rng.random((trials, m)) < 0.1
    dirty = np.where(outliers, clean + 50 * SD * rng.choice([-1, 1], size=(trials, m)), clean)
    sd_of_clean = SD * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    for y, grown in ((clean, 1.1), (dirty, 1.5)):
        estimate = least_squares(
            Problem(
                tuple("abcd"),
                np.zeros((trials, p)),
                lambda x, y=y: (y - x @ design.T, design),
                np.full(m, SD),
                np.ones(p),
            ),
            Cauchy(),
        )
        assert estimate.converged.all()
        error = estimate.value - truth
        # It resists: outliers of 50 standard deviations hardly enlarge the error.
        assert np.all(error.std(axis=0) < grown * sd_of_clean)
        assert np.all(np.abs(error.mean(axis=0)) < 4 * error.std(axis=0) / np.sqrt(trials))
        # And says so: asymptotic in m, hence some per cent beside the sampling.
        nees = np.einsum("ti,tij,tj->t", error, np.linalg.inv(estimate.covariance), error)
        assert abs(np.mean(nees) / p - 1) < 4 * np.sqrt(2 / (p * trials)) + 0.1
        assert np.mean(estimate.birge) < 1.05


def test_without_a_loss_the_same_outliers_ruin_the_fit():
    rng = np.random.default_rng(1)
    design = rng.normal(size=(80, 4))
    y = SD * rng.normal(size=80)
    y[:8] += 50 * SD
    flat = Problem(
        tuple("abcd"),
        np.zeros(4),
        lambda x: (y - x @ design.T, design),
        np.full(80, SD),
        np.ones(4),
    )
    plain, robust = least_squares(flat), least_squares(flat, Cauchy())
    assert plain.birge > 5
    assert np.linalg.norm(plain.value) > 5 * np.linalg.norm(robust.value)


def test_weight_and_slope_are_those_of_the_cost():
    loss, u = Cauchy(), np.linspace(-9, 9, 38)
    step = 1e-6
    psi = (loss.cost(u + step) - loss.cost(u - step)) / (4 * step)
    np.testing.assert_allclose(loss.weight(u) * u, psi, atol=1e-8)
    slope = (loss.weight(u + step) * (u + step) - loss.weight(u - step) * (u - step)) / (2 * step)
    np.testing.assert_allclose(loss.slope(u), slope, atol=1e-8)


def test_a_robust_loss_does_not_doubt_the_prior():
    y = np.zeros(6)
    flat = Problem(
        ("a",),
        np.zeros(1),
        lambda x: (y - x, np.ones((6, 1))),
        np.ones(6),
        np.ones(1),
        priors=(Gaussian.independent(("a",), 100.0, 1e-3),),
    )
    estimate = least_squares(flat, Cauchy())
    assert abs(estimate.value[0] - 100) < 1e-3
