"""Every estimator of ship models tests its rows, and names what they do not agree with."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import chdtrc
from tests.accuracy.rate_table import Bench
from tests.base_seeds import chosen, evidence, most_alarms
from tests.methods.ship_cases import (
    ESTIMATORS,
    RADIUS,
    SENSOR,
    STEPS,
    Case,
    calibrated,
    case,
)

from inercal.benches.rate_table.bench import sensed_motion
from inercal.benches.rate_table.fixture import is_tilted
from inercal.calibration.grade import assess
from inercal.estimation import Estimate
from inercal.methods.ship_consistency import row_covariance
from inercal.methods.ship_multi_angle import global_
from inercal.methods.ship_multi_angle.norm_equations import SearchOptions
from inercal.methods.ship_planar import fit_level_states
from inercal.physics.sensors import G0

Array = NDArray[np.float64]
Effect = Callable[[Case, int, float], Array]


def of_one(name: str, given: Case, trial: int = 0, readings: Array | None = None) -> Estimate:
    mean = given.seen.mean[trial] if readings is None else readings
    estimator = ESTIMATORS[name]
    return estimator(replace(given.seen, mean=mean), SENSOR, given.bench, given.steps)


def inconsistent(found: Estimate) -> bool:
    return assess(found, len(SENSOR.coefficients)).rejects


@pytest.mark.parametrize("name", ESTIMATORS)
def test_chi_square_of_the_base_case_is_chi_square(name: str):
    _, found = calibrated(name, 1, 300)
    assert found.dof == {"planar": 15, "joint": 63}.get(name, 31)
    p = chdtrc(found.dof, found.chi2)
    assert found.chi2.mean() / found.dof == pytest.approx(1, abs=4 * np.sqrt(2 / found.dof / 300))
    assert np.mean(p < 0.005) <= 0.02
    assert np.mean(p < 0.05) < 0.1


def test_chi_square_is_that_of_the_residuals_with_their_own_covariance():
    given = case(4, 1)
    rows = [k for k, step in enumerate(given.steps) if not is_tilted(step)]
    found = of_one("planar", given)
    steps = [given.steps[k] for k in rows]
    at = np.array([3 * k + axis for k in rows for axis in range(3)])
    f, a = sensed_motion(given.bench, steps, {}).f / G0, given.seen.mean[0, rows] / G0
    model, gain = fit_level_states(a, f)
    spread = row_covariance(given.seen, given.bench, given.steps, model.matrix)[np.ix_(at, at)]
    # Residuals move by the errors themselves and by the solution, at rows without noise.
    clean = model.inverse.correct(f)
    by_theta = np.kron(clean, np.eye(3)).reshape(len(rows) * 3, 3, 3).swapaxes(1, 2)
    by_theta = np.concatenate([by_theta.reshape(-1, 9), np.tile(np.eye(3), (len(rows), 1))], axis=1)
    left = np.eye(len(at)) + by_theta @ gain
    residual = (f - model.correct(a)).ravel()
    values, directions = np.linalg.eigh(left @ spread @ left.T)
    kept = values > 1e-9 * values[-1]
    assert kept.sum() == found.dof
    own = ((directions.T @ residual)[kept] ** 2 / values[kept]).sum()
    assert float(found.chi2) == pytest.approx(own, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", chosen(ESTIMATORS, [*ESTIMATORS][::2]))
def test_a_radius_that_is_5_percent_off_is_named(name: str):
    given = case(2, 12, replace(Bench(), radius=0.0))
    told = replace(given.bench, radius=replace(given.bench.radius, value=RADIUS * 1.05))
    wrong = given._replace(bench=told)
    for trial in range(12):
        found = of_one(name, wrong, trial)
        judged = assess(found, len(SENSOR.coefficients))
        assert judged.rejects
        assert judged.suspect is not None
        assert "radius" in (judged.suspect.name, *judged.suspect.indistinguishable)
        assert float(found.birge) > 1.5


@pytest.mark.parametrize("name", ["planar", "joint"])
def test_a_lean_alike_at_all_rests_is_named(name: str):
    given = case(2, 14, replace(Bench(), radius=0.0))
    rests = [step.label for step in given.steps if step.rate == 0]
    lean = {f"lean_1[{label}]": np.array(0.7 * np.pi / 180) for label in rests}
    more = (
        sensed_motion(given.bench, given.steps, lean).f
        - sensed_motion(given.bench, given.steps, {}).f
    )
    found = of_one(name, given, readings=given.seen.mean[0] + more)
    suspect = assess(found, len(SENSOR.coefficients)).suspect
    assert suspect is not None
    assert "lean" in (suspect.name, *suspect.indistinguishable)
    score = next(one for one in found.score_tests.scores if one.name == "lean")
    assert score.size[0] == pytest.approx(0.7 * np.pi / 180, abs=4 * score.sd[0])


@pytest.mark.slow
def test_a_search_tests_its_norms_too():
    given = case(2, 1)
    told = replace(given.bench, radius=replace(given.bench.radius, value=RADIUS * 1.05))
    quick = SearchOptions(seconds=2.0)
    seen = replace(given.seen, mean=given.seen.mean[0])
    right = global_(seen, SENSOR, given.bench, given.steps, options=quick)
    assert right.dof == 7
    assert not inconsistent(right)
    assert len(right.score_tests.scores) > 20
    bent = replace(seen, mean=seen.mean + 3e-4 * given.draw.felt[0] ** 2 * G0 * 10)
    assert inconsistent(global_(bent, SENSOR, told, given.steps, options=quick))


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_row_that_is_wrong_has_the_name_of_its_row(name: str):
    given = case(3, 1)
    for k in (0, 4, 6):
        readings = given.seen.mean[0].copy()
        readings[k] += 0.05 * G0
        suspect = assess(of_one(name, given, readings=readings), len(SENSOR.coefficients)).suspect
        # Untilted states alone do not separate the two speeds of one mounting.
        assert suspect is not None
        assert STEPS[k].label in (suspect.name, *suspect.indistinguishable)
        assert suspect.kind == "row"


@pytest.mark.parametrize("name", ESTIMATORS)
def test_scores_say_how_the_estimate_shifts(name: str):
    given = case(5, 1)
    before = of_one(name, given)
    for candidate, size in (("k3", 1e-6), ("radius", 1e-4)):
        (score,) = (one for one in before.score_tests.scores if one.name == candidate)
        readings = EFFECTS[candidate](given, 0, size)
        after = of_one(name, given, readings=readings)
        (then,) = (one for one in after.score_tests.scores if one.name == candidate)
        p = len(SENSOR.coefficients)
        moved = (after.value - before.value)[:p]
        said = (then.shift - score.shift)[:p]
        assert (then.size - score.size) == pytest.approx(np.full(len(score.size), size), rel=0.1)
        assert np.linalg.norm((moved - said) / before.std[:p]) < 0.1 * np.linalg.norm(
            moved / before.std[:p]
        )


def centripetal(given: Case, trial: int, radius: float, rate: float) -> Array:
    """Return readings where radius and rate differ from those that the bench states."""
    told = given.bench
    turned = [replace(step, rate=step.rate * (1 + rate)) for step in given.steps]
    other = replace(told, radius=replace(told.radius, value=RADIUS + radius))
    more = sensed_motion(other, turned, {}).f - sensed_motion(told, given.steps, {}).f
    return given.seen.mean[trial] + more @ given.draw.matrix[trial].T


def powers(power: int) -> Effect:
    def effect(given: Case, trial: int, size: float) -> Array:
        return given.seen.mean[trial] + size * (given.draw.felt[trial] * G0) ** power

    return effect


def asymmetry(given: Case, trial: int, size: float) -> Array:
    return given.seen.mean[trial] + size * np.abs(given.draw.felt[trial] * G0)


EFFECTS: dict[str, Effect] = {
    "radius": lambda given, trial, size: centripetal(given, trial, size, 0.0),
    "rate": lambda given, trial, size: centripetal(given, trial, 0.0, size),
    "k2": powers(2),
    "k3": powers(3),
    "k1_prime": asymmetry,
}
PROBE = {"radius": 1e-4, "rate": 1e-4, "k2": 1e-6, "k3": 1e-7, "k1_prime": 1e-4}


def visible(name: str, given: Case, what: str) -> float:
    """Return the size with η = 6: by how much the rows' χ² falls for it, per size squared."""
    step = PROBE[what]
    # η is linear in the size: differences of χ² far from zero are quadratic.
    exact = replace(given.seen, mean=given.draw.felt[0] @ given.draw.matrix[0].T * G0)
    exact = replace(exact, mean=exact.mean + given.draw.bias[0] * G0)
    clean = given._replace(seen=replace(exact, mean=exact.mean[None]))
    base = of_one(name, clean)
    bent = of_one(name, clean, readings=EFFECTS[what](clean, 0, 100 * step))
    other = of_one(name, clean, readings=EFFECTS[what](clean, 0, -100 * step))
    # Errors of the poses are in all three: the mean of both signs leaves the square alone.
    square = (float(bent.chi2) + float(other.chi2)) / 2 - float(base.chi2)
    return 6 * 100 * step / np.sqrt(square)


@pytest.mark.slow
@pytest.mark.parametrize("name", chosen(ESTIMATORS, ("planar", "joint")))
@pytest.mark.parametrize("devices", [10, evidence(40)])
def test_what_is_visible_is_not_called_consistent(name: str, devices: int):
    given = case(21, devices)
    for what, effect in EFFECTS.items():
        if name == "planar" and what == "k1_prime":
            continue  # untilted, no axis senses a negative force: it is not separated from k1
        size = visible(name, given, what)
        judged = [
            assess(of_one(name, given, k, effect(given, k, size)), len(SENSOR.coefficients))
            for k in range(devices)
        ]
        seen = sum(one.rejects for one in judged)
        first = Counter(one.suspect.name for one in judged if one.suspect)
        named = sum(what in (s.name, *s.indistinguishable) for one in judged if (s := one.suspect))
        print(f"{name}: {what} of {size:.3g}: {seen} seen, named {named}, {first.most_common(3)}")
        assert seen >= 0.9 * devices


@pytest.mark.slow
@pytest.mark.parametrize("name", chosen(ESTIMATORS, ("planar_norm", "damped")))
@pytest.mark.parametrize(("devices", "most"), [(60, most_alarms(60, 0.01)), evidence(300, 6)])
def test_the_base_case_is_called_consistent(name: str, devices: int, most: int):
    given = case(31, devices)
    wrong = sum(inconsistent(of_one(name, given, k)) for k in range(devices))
    print(f"{name}: {wrong} of {devices} not consistent")
    assert wrong <= most
