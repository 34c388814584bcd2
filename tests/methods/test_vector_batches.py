"""Batches of fits by vectors: the compiled normal equations against Jacobians and single fits."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from tests.methods import tumble_cases
from tests.methods.platform_devices import READ, SHORT, devices
from tests.methods.test_rates_and_poses import LINEAR, bench, steps_of
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.estimation import Estimate, Gaussian, Problem
from inercal.methods import hand_likelihood, method, rates_and_poses, tumble
from inercal.methods.dividing_head_problem import head_problem
from inercal.methods.solving import solve
from inercal.physics.sensors import G0, imu, triad
from inercal.recordings import Observations

Array = NDArray[np.float64]
TRIALS = 11
Estimator = Callable[[Observations, Sequence[Gaussian]], Estimate]
PROBLEMS = ("six positions", "six positions, drift", "ferraris", "dividing head")


class Case(NamedTuple):
    """Observations of many trials, their problem and their estimator."""

    rows: Observations
    problem: Callable[[Observations], Problem]
    estimate: Estimator


def hand(name: str, *, drift: bool = False) -> Case:
    way = method(name)
    sensor = way.prepare(triad() if name == "six_position" else imu())
    stated = Hand(Measured(9.81, 1e-3), 0.8, tilt=1e-3)
    steps = way.plan()
    rng = np.random.default_rng(4)
    sd = np.where([axis.measures == "f" for axis in sensor.axes], 1e-3, 1e-4)
    nominal = {n: np.array(q.value) for n, q in stated.nuisances(steps, sensor).items()}
    c = 0.01 * rng.standard_normal((TRIALS, len(sensor.coefficients)))
    y = sensor.forward(stated.mean_motion(steps, nominal).motion, c)
    r = len(steps)
    rows = Observations(
        tuple(step.label for step in steps),
        y + sd * rng.standard_normal(y.shape),
        np.broadcast_to(np.diag(sd**2), (r, len(sd), len(sd))),
        np.full(r, 10.0),
        np.full(r, 1000),
        10.0 * np.arange(r, dtype=float),
        sensor.channels,
        drift=np.broadcast_to(1e-7 * np.eye(r)[..., None] + 1e-7, (r, r, 3)) if drift else None,
    )
    return Case(
        rows,
        lambda some: hand_likelihood.hand_problem(some, sensor, stated, steps),
        lambda some, priors: hand_likelihood.ml(some, sensor, stated, steps, priors),
    )


def head() -> Case:
    plan = tumble_cases.positions(12, back=True)
    stated = replace(tumble_cases.EXACT, gravity=Measured(G0, 1e-4), base=1e-5, drift=1e-6)
    sensor, rng = tumble_cases.sensor(), np.random.default_rng(5)
    y = 1e-4 * rng.standard_normal((TRIALS, 1)) + np.sin(tumble_cases.angles(plan))
    rows = tumble_cases.seen(plan, y + tumble_cases.NOISE * rng.standard_normal(y.shape))
    return Case(
        rows,
        lambda some: head_problem(some, sensor, stated, plan),
        lambda some, priors: tumble.least_squares(some, sensor, stated, plan, priors),
    )


def platform() -> Case:
    made = devices(SHORT, "T", READ, LINEAR, TRIALS, np.random.default_rng(6))
    steps, sensor = steps_of(made.rows), triad("t", "w", "g").with_coefficients(*LINEAR)
    r = len(steps)
    rows = Observations(
        tuple(step.label for step in steps),
        made.reading,
        made.sd[:, None, None] ** 2 * np.eye(3),
        np.array([step.seconds for step in steps]),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        sensor.channels,
        timed=False,
    )
    return Case(
        rows,
        lambda some: pytest.fail("the problem is private to the estimator"),
        lambda some, priors: rates_and_poses.ml(some, sensor, bench(READ), steps, priors),
    )


CASES: dict[str, Callable[[], Case]] = {
    "six positions": lambda: hand("six_position"),
    "six positions, drift": lambda: hand("six_position", drift=True),
    "ferraris": lambda: hand("ferraris"),
    "dividing head": head,
    "rates and poses": platform,
}


@pytest.mark.parametrize(
    ("name", "part"),
    [*((name, None) for name in PROBLEMS), ("dividing head", 3), ("six positions, drift", 3)],
)
def test_normal_equations_are_those_of_the_jacobian(name: str, part: int | None):
    rows, build, _ = CASES[name]()
    whole = build(rows)
    assert whole.normal_equations is not None
    assert not callable(whole.noise)
    at = np.arange(len(whole.observations), dtype=np.int64)[::part]
    if part:
        whole = hand_likelihood.mean_problem.row_subset(whole, at)
        assert whole.normal_equations is not None
    rng = np.random.default_rng(8)
    start = np.broadcast_to(whole.start, (TRIALS, len(whole.names)))
    x = start + 1e-3 * whole.scale * rng.normal(size=start.shape)
    some = np.array([7, 2, 3])
    found = whole.normal_equations(x[some], some)
    residual, jacobian = whole.linearise(x)
    assert not callable(whole.noise)
    noise = np.broadcast_to(whole.noise, (TRIALS, *whole.noise.shape[-1 - whole.correlated :]))
    for k, t in enumerate(some):
        own = noise[t] if whole.correlated else np.diag(noise[t] ** 2)
        root = np.linalg.inv(np.linalg.cholesky(own))
        a, u = root @ jacobian[t], root @ residual[t]
        size = np.linalg.norm(a, axis=0)
        size[size == 0] = 1.0
        triangle = np.tril_indices(len(size))
        assert_allclose(found.residual[k], residual[t], atol=1e-12 * np.abs(rows.mean).max())
        assert_allclose(found.whitened[k], u, atol=1e-9 * float(np.linalg.norm(u)))
        expected = a.T @ a / np.outer(size, size)
        assert_allclose(
            found.normal[k] / np.outer(size, size)[triangle], expected[triangle], atol=1e-9
        )
        assert_allclose(
            found.gradient[k] / size, a.T @ u / size, atol=1e-9 * float(np.linalg.norm(u))
        )


@pytest.mark.parametrize("name", CASES)
def test_a_batch_has_the_estimates_of_single_fits(name: str):
    rows, _, estimate = CASES[name]()
    together = estimate(rows, ())
    assert together.converged.all()
    for t in (0, TRIALS - 1):
        alone = estimate(replace(rows, mean=rows.mean[t]), ())
        sd = np.sqrt(np.diag(alone.covariance))
        assert_allclose(together.value[t] / sd, alone.value / sd, atol=1e-6)
        assert_allclose(
            together.covariance[t] / np.outer(sd, sd),
            alone.covariance / np.outer(sd, sd),
            atol=1e-6,
        )
        assert_allclose(together.whitened[t], alone.whitened, atol=1e-6)
        assert (together.rank, together.dof) == (alone.rank, alone.dof)
        assert together.null_directions == alone.null_directions
    # The first trial decides.
    alone = estimate(replace(rows, mean=rows.mean[0]), ())
    assert_allclose(together.singular_values, alone.singular_values, rtol=1e-6)


def test_priors_of_each_sensor_count_in_a_batch():
    rows, _, estimate = hand("six_position")
    mean = 1e-2 * np.random.default_rng(7).normal(size=(TRIALS, 1))
    prior = Gaussian.independent(("x.k1",), np.zeros(1), 1e-2)
    together = estimate(rows, [replace(prior, mean=mean)])
    alone = estimate(replace(rows, mean=rows.mean[5]), [replace(prior, mean=mean[5])])
    sd = np.sqrt(np.diag(alone.covariance))
    assert_allclose(together.value[5] / sd, alone.value / sd, atol=1e-6)
    assert together.rank == alone.rank


def test_moments_of_curvature_of_a_batch_are_those_of_dense_algebra():
    rng = np.random.default_rng(9)
    trials, t, m, d, p, r = 3, 4, 3, 3, 9, 5
    place = rng.integers(0, p, size=(t, m, 2, d))
    eta = rng.normal(size=(trials, t, m, 2, d))
    root = rng.normal(size=(trials, p, p))
    spread = root @ np.swapaxes(root, -1, -2)
    index, rows = rng.permutation(p)[: 2 * t].reshape(t, 2), np.array([0, 1, 3, 4])
    arguments: Any = eta, place, spread, index, rows, r
    compiled, dense = (
        hand_likelihood._moments_of_trials(*arguments),
        hand_likelihood._moments(*arguments),
    )  # pyright: ignore[reportPrivateUsage]
    assert_allclose(compiled.shift, dense.shift, rtol=1e-12)
    assert_allclose(compiled.covariance, dense.covariance, rtol=1e-10, atol=1e-12)


def test_an_impossible_covariance_is_refused_in_a_batch():
    rows, build, _ = hand("six_position", drift=True)
    assert rows.drift is not None
    apart = 1e-6 * (np.eye(6) - 1)[..., None]  # three rows cannot all be opposite to one another
    whole = build(replace(rows, drift=np.broadcast_to(apart, rows.drift.shape)))
    assert whole.normal_equations is not None
    with refused(InputError, key="covariance"):
        whole.normal_equations(np.zeros((TRIALS, len(whole.names))), np.arange(TRIALS))


def test_a_method_without_normal_equations_has_the_same_estimates():
    rows, build, _ = hand("six_position")

    def outside(some: Observations, priors: Sequence[Gaussian]) -> Problem:
        return replace(build(some), normal_equations=None)

    generic = solve(rows, (), outside)
    compiled = solve(rows, (), lambda some, priors: build(some))
    sd = np.sqrt(np.diagonal(generic.covariance, axis1=-2, axis2=-1))
    assert_allclose(compiled.value / sd, generic.value / sd, atol=1e-6)
    assert_allclose(
        compiled.covariance / (sd[..., :, None] * sd[..., None, :]),
        generic.covariance / (sd[..., :, None] * sd[..., None, :]),
        atol=1e-6,
    )
    assert_allclose(compiled.chi2, generic.chi2, rtol=1e-6)
    assert compiled.rank == generic.rank
