from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.optimize import least_squares as scipy_least_squares
from tests.refusals import refused

from inercal.basics.errors import NotObserved
from inercal.estimation import Gauge, Gaussian, Problem, least_squares

Array = NDArray[np.float64]
NAMES = ("a", "b", "c", "d")
T = np.linspace(0, 3, 12)
TRUTH = np.array([2.0, 1.3, 0.5, 0.7])
NOISE = np.full(12, 0.01)


def model(x: Array) -> tuple[Array, Array]:
    """Return a exp(−b t) + c sin(d t) and its derivatives."""
    a, b, c, d = (x[..., i, None] for i in range(4))
    e, angle = np.exp(-b * T), d * T
    s, q = np.sin(angle), np.cos(angle)
    t = np.broadcast_to(T, e.shape)
    return a * e + c * s, np.stack([e, -a * t * e, s, c * t * q], axis=-1)


def problem(
    y: Array,
    start: Array = TRUTH * 1.2,
    noise: Array | Callable[[Array], Array] = NOISE,
    priors: tuple[Gaussian, ...] = (),
    gauges: tuple[Gauge, ...] = (),
    *,
    correlated: bool = False,
) -> Problem:
    def linearise(x: Array) -> tuple[Array, Array]:
        h, jacobian = model(x)
        return y - h, jacobian

    start = np.broadcast_to(start, (*y.shape[:-1], 4))
    return Problem(
        NAMES, start, linearise, noise, np.ones(4), priors, gauges, correlated=correlated
    )


def data(trials: int | None = None, seed: int = 1) -> Array:
    shape = (12,) if trials is None else (trials, 12)
    return model(TRUTH)[0] + 0.01 * np.random.default_rng(seed).normal(size=shape)


def test_scipy_finds_the_same_minimum_and_covariance():
    y = data()
    estimate = least_squares(problem(y))
    other = scipy_least_squares(
        lambda x: (model(x)[0] - y) / 0.01, TRUTH * 1.2, xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    assert estimate.converged
    assert_allclose(estimate.value, other.x, rtol=1e-7)
    assert_allclose(estimate.chi2, 2 * other.cost, rtol=1e-10)
    jacobian = model(estimate.value)[1] / 0.01
    assert_allclose(estimate.covariance, np.linalg.inv(jacobian.T @ jacobian), rtol=1e-9)
    assert_allclose(estimate.residual, y - model(estimate.value)[0], rtol=1e-12)
    assert estimate.dof == 8


@pytest.mark.parametrize("trials", [5, 50])
def test_trials_together_equal_trials_alone(trials: int):
    y = data(trials)
    prior = Gaussian.independent(("d",), 0.7, 0.05)
    together = least_squares(problem(y, priors=(prior,)))
    assert together.value.shape == (trials, 4)
    for t in range(trials):
        alone = least_squares(problem(y[t], priors=(prior,)))
        assert_allclose(together.value[t], alone.value, rtol=1e-10)
        assert_allclose(together.covariance[t], alone.covariance, rtol=1e-8)
        assert_allclose(together.chi2[t], alone.chi2, rtol=1e-10)
        assert alone.converged
        assert together.converged[t]


def test_a_trial_that_cannot_converge_harms_no_other():
    y = data(20)
    start = np.tile(TRUTH * 1.2, (20, 1))
    start[3] = [-500.0, 30.0, 40.0, 90.0]
    estimate = least_squares(problem(y, start), max_iterations=8)
    good = np.arange(20) != 3
    assert not estimate.converged[3]
    assert estimate.converged[good].all()
    expected = least_squares(problem(y[good]))
    assert_allclose(estimate.value[good], expected.value, rtol=1e-10)


def test_a_fit_that_is_cut_short_says_so():
    assert not least_squares(problem(data()), max_iterations=1).converged


def test_trials_may_come_from_the_data_or_the_prior_alone():
    y = data(20)
    given = problem(y)
    from_data = least_squares(replace(given, start=TRUTH * 1.2))
    assert_allclose(from_data.value, least_squares(given).value, rtol=1e-12)
    means = 0.7 + 0.01 * np.arange(20.0)[:, None]
    prior = Gaussian.independent(("d",), means, 0.01)
    from_prior = least_squares(problem(y[0], priors=(prior,)))
    assert from_prior.value.shape == (20, 4)
    alone = Gaussian.independent(("d",), means[7], 0.01)
    assert_allclose(
        from_prior.value[7], least_squares(problem(y[0], priors=(alone,))).value, rtol=1e-10
    )


def test_exact_data_are_fitted_exactly():
    estimate = least_squares(problem(model(TRUTH)[0]))
    assert estimate.converged
    assert_allclose(estimate.value, TRUTH, rtol=1e-12)
    many = least_squares(problem(np.tile(model(TRUTH)[0], (20, 1))))
    assert many.converged.all()
    assert_allclose(many.value, np.tile(TRUTH, (20, 1)), rtol=1e-12)


def test_a_prior_is_a_pseudo_observation():
    y = data()
    mean, covariance = np.array([1.2, 0.6]), np.array([[4e-4, 1e-4], [1e-4, 9e-4]])
    with_prior = least_squares(problem(y, priors=(Gaussian(("b", "c"), mean, covariance),)))

    def linearise(x: Array) -> tuple[Array, Array]:
        h, jacobian = model(x)
        more = np.eye(4)[[1, 2]]
        return np.r_[y - h, mean - x[[1, 2]]], np.r_[jacobian, more]

    noise = np.zeros((14, 14))
    noise[:12, :12] = np.eye(12) * 1e-4
    noise[12:, 12:] = covariance
    observed = least_squares(
        Problem(NAMES, TRUTH * 1.2, linearise, noise, np.ones(4), correlated=True)
    )
    assert_allclose(with_prior.value, observed.value, rtol=1e-9)
    assert_allclose(with_prior.covariance, observed.covariance, rtol=1e-7)
    assert_allclose(with_prior.chi2, observed.chi2, rtol=1e-9)
    assert with_prior.dof == observed.dof == 10


@pytest.mark.parametrize("trials", [None, 20])
def test_correlated_noise_is_decorrelated(trials: int | None):
    y = data(trials)
    sd, rho = 0.01, 0.8
    noise = sd**2 * rho ** np.abs(np.subtract.outer(np.arange(12), np.arange(12)))
    estimate = least_squares(problem(y, noise=noise, correlated=True))
    inverse = np.linalg.inv(noise)
    first = 0 if trials else slice(None)
    value = estimate.value[first] if trials else estimate.value
    residual, jacobian = (y[first] if trials else y) - model(value)[0], model(value)[1]
    # Aitken's equations hold at the solution.
    assert_allclose(jacobian.T @ inverse @ residual, 0, atol=1e-5)
    covariance = estimate.covariance[first] if trials else estimate.covariance
    assert_allclose(covariance, np.linalg.inv(jacobian.T @ inverse @ jacobian), rtol=1e-7)
    chi2 = estimate.chi2[first] if trials else estimate.chi2
    assert_allclose(chi2, residual @ inverse @ residual, rtol=1e-9)


def test_as_many_trials_as_observations_keep_their_own_deviations():
    sd = 0.01 * np.random.default_rng(0).uniform(1, 2, size=(12, 12))
    y = data(12)
    together = least_squares(problem(y, noise=sd))
    for k in range(12):
        alone = least_squares(problem(y[k], noise=sd[k]))
        assert_allclose(together.value[k], alone.value, rtol=1e-8)
        assert_allclose(together.covariance[k], alone.covariance, rtol=1e-7)


@pytest.mark.parametrize("trials", [None, 20])
def test_noise_that_depends_on_the_parameters_is_a_fixed_point(trials: int | None):
    y = data(trials)
    estimate = least_squares(problem(y, noise=lambda x: 0.01 * (1 + model(x)[0] ** 2)))
    assert np.all(estimate.converged)
    for yi, x in zip(np.atleast_2d(y), np.atleast_2d(estimate.value), strict=True):
        h, jacobian = model(x)
        weights = 1 / (0.01 * (1 + h**2)) ** 2
        assert_allclose(jacobian.T @ (weights * (yi - h)), 0, atol=1e-4)
        frozen = least_squares(problem(yi, noise=0.01 * (1 + h**2)))
        assert_allclose(x, frozen.value, rtol=1e-8)


@pytest.mark.parametrize("trials", [None, 20])
def test_a_gauge_is_exact_and_equals_elimination(trials: int | None):
    y = data(trials)
    gauge = Gauge("a is twice c plus one", ("a", "c"), np.array([[1.0, -2.0]]), np.array([1.0]))
    estimate = least_squares(problem(y, gauges=(gauge,)))
    assert_allclose(estimate.value[..., 0] - 2 * estimate.value[..., 2], 1.0, rtol=0, atol=1e-14)
    assert estimate.dof == 9
    direction = np.array([1.0, 0.0, -2.0, 0.0])
    assert np.all(np.abs(estimate.covariance @ direction) < 1e-15)
    first = y[0] if trials else y

    def eliminated(t: Array) -> Array:
        b, c, d = t
        return (model(np.array([1 + 2 * c, b, c, d]))[0] - first) / 0.01

    other = scipy_least_squares(eliminated, TRUTH[1:], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    value = estimate.value[0] if trials else estimate.value
    assert_allclose(value[1:], other.x, rtol=1e-6)


def test_a_gauge_and_a_prior_together():
    gauge = Gauge("c is d", ("c", "d"), np.array([[1.0, -1.0]]), np.array([0.0]))
    prior = Gaussian.independent(("d",), 0.6, 1e-4)
    estimate = least_squares(problem(data(), gauges=(gauge,), priors=(prior,)))
    assert_allclose(estimate.value[2], estimate.value[3], rtol=1e-14)
    assert_allclose(estimate.std[2:], [1e-4 * estimate.birge] * 2, rtol=1e-2)


def test_units_do_not_matter():
    y = data()
    unit = np.array([1e6, 1e-6, 1e3, 1e-9])

    def linearise(x: Array) -> tuple[Array, Array]:
        h, jacobian = model(x / unit)
        return y - h, jacobian / unit

    scaled = Problem(NAMES, TRUTH * 1.2 * unit, linearise, np.full(12, 0.01), unit)
    estimate, plain = least_squares(scaled), least_squares(problem(y))
    assert_allclose(estimate.value / unit, plain.value, rtol=1e-9)
    assert_allclose(estimate.std / unit, plain.std, rtol=1e-9)
    assert_allclose(estimate.singular_values, plain.singular_values, rtol=1e-9)


@pytest.mark.parametrize("noise", [np.ones(5), 1 + np.eye(5)], ids=["white", "correlated"])
@pytest.mark.parametrize("trials", [None, 20])
def test_a_model_that_overflows_on_the_way_is_survived(trials: int | None, noise: Array):
    t = np.linspace(0, 40, 5)
    y = np.exp(0.5 * t)
    seen = []

    def linearise(x: Array) -> tuple[Array, Array]:
        h = np.exp(x * t)
        seen.append(np.isfinite(h).all())
        return y - h, (t * h)[..., None]

    start = np.full((1,) if trials is None else (trials, 1), 0.1)
    steep = Problem(("rate",), start, linearise, noise, np.ones(1), correlated=noise.ndim == 2)
    estimate = least_squares(steep)
    assert not all(seen)
    assert np.all(estimate.converged)
    assert_allclose(estimate.value, np.full(start.shape, 0.5), rtol=1e-12)


def test_a_linear_model_has_the_solution_of_linear_algebra():
    rng = np.random.default_rng(0)
    design, y = rng.normal(size=(9, 4)), rng.normal(size=(30, 9))
    flat = Problem(NAMES, np.zeros(4), lambda x: (y - x @ design.T, design), np.ones(9), np.ones(4))
    one = least_squares(flat)
    assert one.converged.all()
    expected = np.linalg.lstsq(design, y.T, rcond=None)[0].T
    assert_allclose(one.value, expected, rtol=1e-10)


def test_what_is_unobserved_is_refused_by_name():
    given = problem(data(), start=np.array([2.0, 1.3, 0.0, 0.7]))
    with refused(NotObserved, directions=("d",), names=("d",)):
        least_squares(given)
    # A prior covers it, and the estimate still says that the data do not see it.
    prior = Gaussian.independent(("d",), 0.7, 0.1)
    estimate = least_squares(replace(given, priors=(prior,)))
    assert [n.words for n in estimate.null_directions] == ["d"]
    assert estimate.rank == 3


def test_values_that_are_not_finite_at_the_start_are_refused():
    y = data()
    y[4] = np.nan
    with refused(key="linearise"):
        least_squares(problem(y))
