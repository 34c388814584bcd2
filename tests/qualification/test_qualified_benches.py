"""A qualification moves the estimates, and changes their uncertainty, as its covariance says.

In every method with each of its estimators that counts the bench: the corrections are right, so
that data of a bench with errors and the qualified bench give what a perfect bench gives; a larger
variance and a correlation enlarge the covariance as the posterior of a Gaussian with that prior.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.base_seeds import evidence
from tests.methods.bench_sensitivity_cases import Case, case, observed
from tests.methods.test_bench_sensitivities import ERRORS, HEADS, NEAR

from inercal.basics.parameters import QualifiedParameters
from inercal.basics.units import Measured
from inercal.benches import Bench, DividingHead, Turntable
from inercal.benches.qualification.joint_prior import with_joint_prior
from inercal.estimation import Estimate, Gaussian
from inercal.methods.turntable_kalman.combined_estimate import run_filter
from inercal.methods.turntable_kalman.filter_config import FILTER_CONFIGS
from inercal.methods.turntable_kalman.filter_tests import FilterResult

Array = NDArray[np.float64]
SHIFT = 0.3  # standard deviations
SLOW = {"full", "drift", "paper", "trajectory", "global"}
QUALIFIED = ERRORS | {("ship_multi_angle", "global"): ERRORS["ship_multi_angle", "damped"]}
MEASURED = {"g": "gravity", "radius": "radius", "stretch": "stretch", "azimuth": "azimuth"}
NOT_QUALIFIED = {"latitude", "earth_up"}  # stated as a place


def qualified(bench: Bench, names: tuple[str, ...], value: Array, covariance: Array) -> Bench:
    """Return the bench as a run file with a qualification builds it."""
    known = QualifiedParameters(
        names,
        tuple(value.tolist()),
        tuple(map(tuple, covariance.tolist())),
        ("a" * 64,) * len(names),
        ("2026-01-01",) * len(names),
    )
    own = {
        MEASURED[name]: Measured(float(v), float(np.sqrt(s)))
        for name, v, s in zip(names, value, np.diagonal(covariance), strict=True)
        if name in MEASURED
    }
    return replace(bench, qualified=known, **own)


def names_of(method: str, estimator: str) -> tuple[str, ...]:
    return tuple(n for n in QUALIFIED[method, estimator] if n not in NOT_QUALIFIED)


def given_case(method: str, estimator: str) -> Case:
    given = case(method, estimator)
    if isinstance(given.bench, DividingHead) and method == "tumble":
        return given._replace(bench=HEADS["none"])
    return given


def stated(given: Case, names: tuple[str, ...]) -> tuple[Array, Array]:
    acting = given.bench.nuisances(given.steps, given.sensor)
    return (
        np.array([acting[name].value for name in names]),
        np.array([acting[name].sd for name in names]),
    )


def found(given: Case, bench: Bench) -> Estimate:
    return with_joint_prior(bench, given.found(bench=bench))


def posterior(estimate: Estimate, names: tuple[str, ...], d: Array, prior: Array, p: int) -> Array:
    """Return the covariance of p coefficients with another prior: by information, all inverted."""
    columns = [estimate.sensitivity(name, s) for name, s in zip(names, d, strict=True)]
    at = [k for k, one in enumerate(columns) if one is not None]
    d, prior = d[at], prior[np.ix_(at, at)]
    cross = np.stack([columns[k][:p] for k in at], axis=-1) * d**2  # type: ignore[index]
    within = np.diag(d**2)
    own = [names[k] for k in at]
    inner = [n for n in own if n in estimate.names and n not in estimate.sensitivities]
    for a, one in enumerate(own):
        for b, other in enumerate(own):
            if one in inner and other in inner:
                i, j = estimate.names.index(one), estimate.names.index(other)
                within[a, b] = estimate.covariance[i, j]
    whole = np.block([[estimate.covariance[:p, :p], cross], [cross.T, within]])
    size = np.sqrt(np.diagonal(whole))
    size = np.where(size > 0, size, 1.0)
    kept = np.sqrt(np.diagonal(whole)) > 0
    information = np.linalg.inv((whole / np.outer(size, size))[np.ix_(kept, kept)])
    added = (np.linalg.inv(prior) - np.diag(1 / d**2)) * np.outer(size[p:], size[p:])
    information[-len(at) :, -len(at) :] += added
    result = np.zeros_like(whole)
    result[np.ix_(kept, kept)] = np.linalg.inv(information)
    return (result * np.outer(size, size))[:p, :p]


def by_cost(keys: Iterable[tuple[str, str]]) -> list[Any]:
    """Return all pairs; those that take long are slow, or for `make evidence`."""
    return [
        key
        if key[1] not in SLOW
        else pytest.param(*key, marks=pytest.mark.slow)
        if key[1] in ("full", "global")
        else evidence(*key)
        for key in keys
    ]


CASES = by_cost(QUALIFIED)


@pytest.mark.parametrize(("method", "estimator"), CASES)
def test_qualified_values_correct_the_bench(method: str, estimator: str):
    given = given_case(method, estimator)
    if estimator == "global":  # in other frames the search ends anywhere in the free directions
        given = given._replace(sensor=replace(given.sensor, frame="symmetric"))
    names = names_of(method, estimator)
    value, sd = stated(given, names)
    moved = value + SHIFT * sd
    perfect = given.found().value[: len(given.truth)]
    read = observed(given, dict(zip(names, moved.tolist(), strict=True)))
    bench = qualified(given.bench, names, moved, np.diag(sd**2))
    again = given.by(read, bench)
    u = np.sqrt(np.diagonal(again.covariance))[: len(given.truth)]
    near = 2 * NEAR.get(estimator, 1e-3) * len(names)
    assert (np.abs(again.value[: len(given.truth)] - perfect) <= near * u + 1e-15).all()


BY_FILTERS = {("turntable_kalman", "full"), ("turntable_kalman", "drift")}
BY_PRIORS = [key for key in QUALIFIED if key not in BY_FILTERS]


@pytest.mark.parametrize(
    ("method", "estimator"),
    by_cost(BY_PRIORS),
)
def test_uncertainty_changes_as_the_covariance_says(method: str, estimator: str):
    given = given_case(method, estimator)
    names, p = names_of(method, estimator), len(given.truth)
    value, sd = stated(given, names)
    before = found(given, qualified(given.bench, names, value, np.diag(sd**2)))
    rng = np.random.default_rng(3)
    root = np.eye(len(names)) + 0.6 * np.tril(rng.normal(size=(len(names),) * 2), -1)
    prior = root @ root.T
    prior = prior / np.sqrt(np.outer(np.diagonal(prior), np.diagonal(prior)))
    prior = 1.5**2 * prior * np.outer(sd, sd)
    after = found(given, qualified(given.bench, names, value, prior))
    expected = posterior(before, names, sd, prior, p)
    size = np.sqrt(np.diagonal(expected))
    size = np.where(size > 0, size, 1.0)
    off = np.abs(after.covariance[:p, :p] - expected) / np.outer(size, size)
    # Closed formulas weigh by the gravity of the nominal sensor.
    assert off.max() < max(0.01, 1.5 * NEAR.get(estimator, 0.0))
    # The change is there to be seen.
    change = np.abs(after.covariance[:p, :p] - before.covariance[:p, :p]) / np.outer(size, size)
    assert change.max() > 0.05


@pytest.mark.parametrize("estimator", ["full", "drift"])
@pytest.mark.parametrize("kind", ["w", "f"])
def test_filters_have_the_joint_prior(estimator: str, kind: Literal["f", "w"]):
    given = given_case("turntable_kalman", estimator)
    names = names_of("turntable_kalman", estimator)
    value, sd = stated(given, names)
    prior = 0.6 * np.outer(sd, sd)
    np.fill_diagonal(prior, sd**2)
    track = observed(given, {}).track
    assert track is not None

    def filtered(covariance: Array) -> tuple[FilterResult, Array]:
        bench = qualified(given.bench, names, value, covariance)
        assert isinstance(bench, Turntable)
        config = FILTER_CONFIGS[estimator]
        result = run_filter(kind, given.sensor, bench, track, config)
        p = len(result.shared_covariance)
        whole = result.covariance.copy()
        whole[:p, :p] -= result.shared_covariance  # gravity's: no state
        states = [*range(p), *(result.names.index(n) for n in names if n in result.names)]
        return result, whole[np.ix_(states, states)]

    (before, first), (_, second) = filtered(np.diag(sd**2)), filtered(prior)
    own = [name for name in names if name in before.names]
    places = [*range(len(first) - len(own), len(first))]
    size = np.sqrt(np.diagonal(first))
    information = np.linalg.inv(first / np.outer(size, size))
    at = [names.index(name) for name in own]
    added = np.linalg.inv(prior[np.ix_(at, at)]) - np.diag(1 / sd[at] ** 2)
    information[np.ix_(places, places)] += added * np.outer(size[places], size[places])
    expected = np.linalg.inv(information)
    found = second / np.outer(size, size)
    p = len(given.sensor.select_axes(kind).coefficients)
    change = np.abs(found - first / np.outer(size, size))[:p, :p].max()
    assert change > 0.005 or len(own) < 2
    assert np.abs(found - expected)[:p, :p].max() < 0.05 * change + 1e-6


DIRECT = [
    ("ferraris", "ml"),
    ("centrifuge_norm", "ml"),
    ("ship_multi_angle", "joint"),
    pytest.param("rates_and_poses", "ml", marks=pytest.mark.slow),
    ("turntable_discrete", "least_squares"),
]


@pytest.mark.parametrize(("method", "estimator"), DIRECT)
def test_the_update_is_that_of_a_fit_with_the_joint_prior(method: str, estimator: str):
    given = given_case(method, estimator)
    names, p = names_of(method, estimator), len(given.truth)
    value, sd = stated(given, names)
    prior = 0.7 * np.outer(sd, sd)
    np.fill_diagonal(prior, sd**2)
    read = observed(given, dict(zip(names, (value + sd).tolist(), strict=True)))
    bench = qualified(given.bench, names, value, prior)
    updated = with_joint_prior(bench, given.by(read, bench))
    # The fit itself, with next to nothing known of the bench but the joint prior.
    unknown = qualified(given.bench, names, value, np.diag((1e3 * sd) ** 2))
    joint = Gaussian(names, value, prior)
    direct = given._replace(priors=(*given.priors, joint)).by(read, unknown)
    u = np.sqrt(np.diagonal(direct.covariance))
    at = [direct.names.index(name) for name in updated.names]
    off = np.abs(updated.covariance - direct.covariance[np.ix_(at, at)])
    assert (off <= 2e-3 * np.outer(u[at], u[at]) + 1e-30)[:p, :p].all()
    assert (np.abs(updated.value[:p] - direct.value[at][:p]) <= 5e-3 * u[at][:p]).all()
    assert updated.chi2 == pytest.approx(direct.chi2, rel=1e-2, abs=1e-3)
