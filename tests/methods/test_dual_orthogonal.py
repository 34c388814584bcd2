"""`dual_orthogonal` against its method note: what each estimator reaches on the note's bench.

Numbers of the note were computed apart from this project; data by `tests.accuracy.dividing_head`.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.dividing_head import ARCSEC, LARGE, Bench
from tests.base_seeds import SEEDS, evidence, slow
from tests.methods.dual_orthogonal_cases import (
    SENSOR,
    WHOLE,
    bound,
    calibrate,
    case,
    errors,
    known,
    nees,
    rms,
    scatter_of,
    squared,
)

from inercal.basics.units import Measured
from inercal.estimation import Estimate
from inercal.methods.dual_orthogonal import dual, joint, patent, single
from inercal.physics.sensors import G0

Array = NDArray[np.float64]
TABLE = {
    "single": (9.84, 17.3, 8.5, 10.2, 17.9, 10.3, 1.65),
    "dual": (4.70, 0.41, 0.163, 4.71, 0.43, 4.69, 0.12),
    "patent": (0.367, 0.423, 0.163, 0.419, 0.447, 0.480, 0.143),
    "joint": (0.367, 3.45, 0.163, 0.387, 3.46, 0.452, 0.129),
    "every face": (0.224, 0.496, 0.154, 0.273, 0.552, 0.274, 0.126),
}


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    "method", [one if k % 2 == 0 else slow(one) for k, one in enumerate(TABLE)]
)
def test_methods_reach_the_table(method: str, seed: int):
    given, found = calibrate(method, seed, 2000)
    reached = rms(found, given)
    print(method, seed, {name: round(value, 3) for name, value in reached.items()})
    assert list(reached.values()) == pytest.approx(TABLE[method], rel=0.06)


def test_joint_with_k3_of_a_centrifuge_knows_k1_too():
    given, found = calibrate("joint, K3 known", 1, 1000)
    assert rms(found, given)["k1"] == pytest.approx(0.41, rel=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_the_notes_limits_of_patent(seed: int):
    limits = {"k0": 0.40, "k2": 0.45, "kip": 0.52, "k1+k3": 0.16, "delta": 0.18}
    scatter: list[Array] = []
    for head in (3.0, 0.5, 10.0):
        given, found = calibrate("patent", seed, 2000, head)
        reached, off = rms(found, given), errors(found, given)
        assert all(reached[name] <= limit for name, limit in limits.items())
        assert max(float(np.abs(off[name].mean())) for name in limits) <= 0.05
        scatter.append(np.array([reached[name] for name in limits]))
    print("heads of 0.5″ and 10″ over 3″:", scatter[1] / scatter[0], scatter[2] / scatter[0])
    assert np.abs(scatter[1] / scatter[2] - 1).max() < 1e-3


@pytest.mark.parametrize(
    ("head", "expected"), [(0.5, 1.64), (1.0, 3.28), (3.0, 9.84), (10.0, 32.8)]
)
def test_a_single_accelerometer_is_as_good_as_the_head(head: float, expected: float):
    given, found = calibrate("single", 1, 1000, head)
    assert rms(found, given)["k0"] == pytest.approx(expected, rel=0.05)
    assert bound(found)["k0"] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("method", ["patent", "joint"])
def test_no_head_keeps_the_pair_from_a_micro_g(method: str):
    reached = [scatter_of(method, head) for head in (0.5, 3.0, 10.0)]
    small, middle, large = (one["k0"] for one in reached)
    assert large == pytest.approx(middle, rel=0.01)
    assert 0.95 * middle < small < 1.001 * middle < 0.4


@pytest.mark.parametrize("method", ["joint", "every face"])
@pytest.mark.parametrize("seed", SEEDS)
def test_joint_states_what_it_reaches(method: str, seed: int):
    trials = 400
    given, found = calibrate(method, seed, trials)
    print(method, seed, "NEES", nees(found, given), "χ²", found.chi2.mean(), "of", found.dof)
    assert nees(found, given) == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / trials))
    assert found.chi2.mean() == pytest.approx(found.dof, abs=4 * np.sqrt(2 * found.dof / trials))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("collimated", ["pairs", "every"])
def test_joint_states_what_it_reaches_where_all_of_the_bench_errs(collimated: str, seed: int):
    trials = 400
    given = case(seed, trials, replace(WHOLE, collimated=collimated), reverse=True)
    priors = [known(given, "kip", 20), known(given, "k3", 5)]
    found = joint(given.seen, SENSOR, given.bench, given.steps, priors)
    print(collimated, seed, "NEES", nees(found, given), "χ²", found.chi2.mean(), "of", found.dof)
    assert nees(found, given) == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / trials))
    assert found.chi2.mean() == pytest.approx(found.dof, abs=4 * np.sqrt(2 * found.dof / trials))


LEFT_OUT: dict[str, dict[str, Any]] = {
    "both": {
        "gravity": Measured(G0, 0.0),
        "autocollimator": 1e-9,
        "polygon": (),
        "certificate": 0.0,
        "base": 0.0,
        "pier": 0.0,
        "creep": 0.0,
        "drift": 0.0,
    },
    "pairs": {"harmonics": (), "division": 0.0},
    "every": {},
}


@cache
def squared_without(collimated: str, trials: int, *left_out: Any) -> Array:
    """Return the squared errors where a bench is stated whole, or with one value replaced."""
    given = case(1, trials, replace(WHOLE, collimated=collimated), reverse=True)
    priors = [known(given, "kip", 20), known(given, "k3", 5)]
    bench = replace(given.bench, **{left_out[0]: left_out[1]}) if left_out else given.bench
    return squared(joint(given.seen, SENSOR, bench, given.steps, priors), given)


@pytest.mark.parametrize(
    ("collimated", "what"),
    [
        (where, what) if k % 3 == 0 else evidence(where, what)
        for where in ("pairs", "every")
        for k, what in enumerate(LEFT_OUT["both"] | LEFT_OUT[where])
    ],
)
def test_joint_cannot_do_without_any_of_them(collimated: str, what: str):
    trials = 400
    value = (LEFT_OUT["both"] | LEFT_OUT[collimated])[what]
    without = squared_without(collimated, trials, what, value)
    more = without - squared_without(collimated, trials)
    print(f"NEES without {what}: {without.mean():.3f}")
    assert more.mean() > 0.04
    assert more.mean() > 4 * more.std() / np.sqrt(trials)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_every_face_reaches_its_bound(seed: int):
    given, found = calibrate("every face", seed, 2000)
    reached, stated = rms(found, given), bound(found)
    limits = {"k0": 0.25, "k1": 0.55, "k2": 0.30, "k3": 0.60, "kip": 0.30}
    assert all(reached[name] <= limit for name, limit in limits.items())
    assert 0.95 < nees(found, given) < 1.05
    assert all(reached[name] / stated[name] <= 1.05 for name in stated)


@pytest.mark.parametrize("method", ["dual", "patent"])
@pytest.mark.parametrize("seed", SEEDS)
def test_what_g2_does_not_see_is_no_better_known_than_the_head_s_zero(method: str, seed: int):
    """All twelve coefficients, both mounting angles with their common part among them."""
    trials = 400
    given, found = calibrate(method, seed, trials)
    # A prior's mean is the production's, from which the truth was drawn, or one with its own error.
    print(method, seed, "NEES", nees(found, given))
    assert nees(found, given) == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / trials))
    covariance = found.select(("a.delta_o", "b.delta_o")).covariance
    sd = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    assert sd / ARCSEC == pytest.approx(5, rel=0.02)


@pytest.mark.parametrize("method", ["single", "dual", "patent"])
def test_the_other_estimators_state_what_they_reach(method: str):
    given, found = calibrate(method, 2, 1000)
    reached, stated = rms(found, given), bound(found)
    assert [reached[n] for n in stated] == pytest.approx(list(stated.values()), rel=0.08)


@pytest.mark.parametrize("method", ["single", "dual", "patent", "joint"])
def test_gravity_is_in_the_scale_factors(method: str):
    given, _ = calibrate(method, 1, 1)
    estimator = {"single": single, "dual": dual, "patent": patent, "joint": joint}[method]
    priors = [] if method == "single" else [known(given, "kip", 20), known(given, "k3", 0.5)]
    variance: list[float] = []
    for sd in (0.0, 1e-5):
        bench = replace(given.bench, gravity=Measured(G0, sd * G0))
        found = estimator(given.seen, SENSOR, bench, given.steps, priors)
        to = np.array([1.0, G0**2])
        names = ["a.k1", "a.k3"]
        variance.append(float(to @ found.select(names).covariance[0] @ to))
    assert variance[1] - variance[0] == pytest.approx(1e-10, rel=0.01)


@pytest.mark.parametrize("method", ["dual", "patent", "joint", "every face"])
def test_large_errors_of_the_accelerometers_cost_nothing(method: str):
    nominal = scatter_of(method)
    large = scatter_of(method, **LARGE)
    assert list(large.values()) == pytest.approx(list(nominal.values()), rel=0.05)


@pytest.mark.parametrize("method", ["single", "dual", "patent", "joint"])
def test_calibrations_together_are_those_of_each_alone(method: str):
    given, together = calibrate(method, 3, 4)
    estimator = {"single": single, "dual": dual, "patent": patent, "joint": joint}[method]
    for t in range(4):
        alone_case = given._replace(
            seen=replace(given.seen, mean=given.seen.mean[t]),
            truth={name: value[t] for name, value in given.truth.items()},
        )
        kip = known(given, "kip", 4.69, 3) if method == "dual" else known(given, "kip", 20)
        k3 = known(given, "k3", 5) if method == "joint" else known(given, "k3", 0.5, 3)
        priors = [] if method == "single" else [replace(q, mean=q.mean[t]) for q in (kip, k3)]
        alone = estimator(alone_case.seen, SENSOR, given.bench, given.steps, priors)
        sd = alone.std
        assert np.abs((together.value[t] - alone.value)[:12] / sd[:12]).max() < 1e-6
        away = (together.covariance[t] - alone.covariance) / np.outer(sd, sd)
        assert np.abs(away).max() < 1e-6


@pytest.mark.parametrize("estimator", [single, dual, patent, joint])
def test_each_trial_may_have_its_own_noise(estimator: Callable[..., Estimate]):
    given = case(1, 3, Bench())
    told = [known(given, "kip", 20), known(given, "k3", 0.5)]
    priors = [] if estimator is single else told
    each = np.broadcast_to(given.seen.covariance, (3, *given.seen.covariance.shape)).copy()
    each[1:] *= 4
    own = replace(given.seen, covariance=each)
    found = estimator(own, SENSOR, given.bench, given.steps, priors)
    common = estimator(given.seen, SENSOR, given.bench, given.steps, priors)
    k1 = SENSOR.coefficients.index("a.k1")
    assert found.value[0] == pytest.approx(common.value[0], rel=1e-6, abs=1e-12)
    assert found.covariance[0, k1, k1] == pytest.approx(common.covariance[0, k1, k1])
    assert found.covariance[1, k1, k1] > common.covariance[1, k1, k1]
