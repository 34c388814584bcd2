"""Tests of the field find disturbances, with few false alarms."""
# Arrays and records without annotations, because a plain script is easier to compare with formulas.
# pyright: reportUnknownParameterType=false

from collections import Counter

import numpy as np
import pytest
from scipy.stats import binom
from tests.base_seeds import evidence, most_alarms, sampled
from tests.magnetometer import generator as sim
from tests.magnetometer.calibrations import calibrated
from tests.magnetometer.cases import band, fit, linear_model, normalised_error

from inercal.basics.errors import InputError
from inercal.calibration.detectability import undetectable_causes
from inercal.estimation.scores import SCORE_TEST_SHARE, SIGNIFICANCE_LEVEL
from inercal.methods.magnetic_field.disturbances import field_tests
from inercal.methods.magnetic_field.fitting import inhomogeneity_interval
from inercal.methods.magnetic_field.records import LinearModel

LEVEL = SCORE_TEST_SHARE * SIGNIFICANCE_LEVEL
N = 24


def linked(rng, attitude, data, noise=1.0):
    """Add turns about the vertical; without noise, their stated noise is the same."""
    walk = sim.RANDOM_WALK if noise else 1e-12
    turns = sim.turns_between(attitude)
    data = sim.add_turns(rng, data, turns, noise=walk, about_up=True)
    data.turn_sd = sim.RANDOM_WALK * np.sqrt(5.0)
    return data


def disturbances(rng, own):
    """Yield the kind, the start of the test's name, and the disturbance of rests (unit size)."""
    way = rng.standard_normal(3)
    way *= 1e-6 / np.linalg.norm(way)
    part = (np.arange(N) / (N - 1) - 0.5)[:, None]
    step, single = int(rng.integers(2, N - 1)), int(rng.integers(N))
    after, only = np.arange(N)[:, None] >= step, np.arange(N)[:, None] == single
    yield "step", f"step of the field at rest {step + 1}", {"disturbance": after * way}
    yield "offset", "drift of the offset", {"drift": part * way}
    yield "strength", "drift of the strength", {"disturbance": 0.01 * part * own.field}
    yield "rest", f"field at rest {single + 1}", {"disturbance": only * way}


@pytest.mark.slow
@pytest.mark.parametrize("links", [evidence(False), True])
@pytest.mark.parametrize(("seed", "count"), sampled(50, 150))
def test_false_alarms_are_at_most_two_per_cent(links, seed, count):
    alarms, excess = 0, 0
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        attitude = sim.scattered(rng, N)
        data = sim.rests(rng, attitude, sim.device(rng))
        found = fit(linked(rng, attitude, data) if links else data)
        tests = field_tests(found)
        alarms += any(tests.adjusted(one) < LEVEL for one in tests.scores)
        excess += found.inhomogeneity > 0
    assert alarms <= 0.02 * count + 1
    # The bound of χ² has a level of 5 %; of 150 draws 0 is outside the 99.9 % band.
    assert binom.ppf(0.0005, count, 0.05) <= excess < most_alarms(count, 0.05)


@pytest.mark.parametrize("links", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("seed", "count"), sampled(6, 40))
def test_a_visible_disturbance_is_found(links, seed, count):
    """η² = 36 is χ² of exact readings with the disturbance."""
    found = Counter()
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        own, attitude = sim.device(rng), sim.scattered(rng, N)

        def tested(change, size, noise, rng=rng, own=own, attitude=attitude):
            change = {key: size * value for key, value in change.items()}
            data = sim.rests(rng, attitude, own, noise=noise, **change)
            return fit(linked(rng, attitude, data, noise) if links else data)

        for kind, name, change in disturbances(rng, own):
            eta = np.sqrt(tested(change, 0.1, 0.0).chi2) / 0.1
            tests = field_tests(tested(change, 6 / eta, 1.0))
            stem = name.partition(" at ")[0]
            least = min(tests.adjusted(one) for one in tests.scores if one.name.startswith(stem))
            found[kind] += least < LEVEL
    for kind in ("step", "offset", "strength", "rest"):
        assert found[kind] >= 0.95 * count - 2, kind


def test_without_links_two_components_of_a_step_are_visible():
    rng = np.random.default_rng(1)
    attitude = sim.scattered(rng, N)
    data = sim.rests(rng, attitude, sim.device(rng))
    alone = {one.name: one for one in field_tests(fit(data)).scores}
    both = {one.name: one for one in field_tests(fit(linked(rng, attitude, data))).scores}
    name = "step of the field at rest 12"
    assert alone[name].components == (f"{name}, north", f"{name}, up")
    assert alone[name].dof == 2
    assert both[name].dof == 3


def test_a_drift_of_exchanged_axes_has_the_sizes_of_its_own_axes():
    rng = np.random.default_rng(5)
    own, attitude, order = sim.device(rng), sim.scattered(rng, N), [1, 0, 2]
    size = np.array([3e-6, 1e-6, -2e-6])
    data = sim.rests(rng, attitude, own, drift=np.linspace(-0.5, 0.5, N)[:, None] * size)
    data.reading = data.reading[:, order]
    plain = linear_model()
    rows = [4 * k + j for k in order for j in range(4)]
    model = LinearModel(
        tuple(plain.names[row] for row in rows),
        plain.nominal[order],
        plain.directions[rows][:, order],
    )
    tests = field_tests(fit(linked(rng, attitude, data), model))
    drift = next(one for one in tests.scores if one.name == "drift of the offset")
    found = dict(zip(drift.components, drift.size, strict=True))
    for k, axis in enumerate(("mx", "my", "mz")):
        assert abs(found[f"drift of the offset, {axis}"] - size[k]) < 4.5 * drift.sd.max()


def test_a_step_is_named_with_its_size():
    rng = np.random.default_rng(2)
    own, attitude = sim.device(rng), sim.scattered(rng, N)
    change = np.zeros((N, 3))
    change[10:] = [0.4e-6, 0.0, -0.3e-6]
    data = sim.rests(rng, attitude, own, disturbance=change)
    tests = field_tests(fit(linked(rng, attitude, data)))
    best = min(tests.scores, key=tests.adjusted)
    assert best.name == "step of the field at rest 11"
    np.testing.assert_array_less(np.abs(best.size - change[-1]), 4.5 * best.sd)
    np.testing.assert_array_less(best.sd, 0.1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "count"), sampled(6, 30))
def test_an_inhomogeneous_field_is_estimated_with_its_interval(seed, count):
    tau, errors, covered = [], [], 0
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        own = sim.device(rng)
        change = 0.01 * own.strength * rng.standard_normal((N, 3))
        found = fit(sim.rests(rng, sim.scattered(rng, N), own, disturbance=change))
        low, high = inhomogeneity_interval(found)
        covered += low < 0.01 < high
        tau.append(found.inhomogeneity)
        errors.append(normalised_error(found, own))
    # The relative standard deviation of τ is about 1/√(2 · 35).
    assert np.mean(tau) == pytest.approx(0.01, rel=4 / np.sqrt(70 * count) + 0.02)
    assert covered >= 0.95 * count - 4 * np.sqrt(0.05 * 0.95 * count)
    assert np.mean(errors) == pytest.approx(1, abs=band(13, count) + 0.06)


def test_a_homogeneous_field_has_an_upper_bound():
    rng = np.random.default_rng(4)
    found = fit(sim.rests(rng, sim.scattered(rng, N), sim.device(rng)))
    low, high = inhomogeneity_interval(found)
    assert found.inhomogeneity == low == 0
    assert 0 < high < 0.005


@pytest.mark.slow
def test_more_than_five_per_cent_is_refused():
    rng = np.random.default_rng(3)
    own = sim.device(rng)
    change = 0.1 * own.strength * rng.standard_normal((N, 3))
    with pytest.raises(InputError, match="field differs within the recording by"):
        fit(sim.rests(rng, sim.scattered(rng, N), own, disturbance=change))


@pytest.mark.parametrize("seed", range(3))
def test_readings_of_another_recording_fit_no_axes(seed: int):
    rng = np.random.default_rng(seed)
    own = sim.device(rng)
    data = sim.rests(rng, sim.scattered(rng, N), own)
    data.reading = sim.rests(rng, sim.scattered(rng, N), own).reading
    with pytest.raises(InputError, match="may belong to another recording"):
        fit(data)


def test_a_step_of_the_offset_is_told_from_a_step_of_the_field():
    rng = np.random.default_rng(2)
    own, attitude = sim.device(rng), sim.scattered(rng, N)
    change = (np.arange(N)[:, None] >= N // 2) * np.array([1e-6, 0.5e-6, -0.5e-6])
    for offset, what in ((True, "offset"), (False, "field")):
        drift, field = change * offset, change * (not offset)
        data = sim.rests(rng, attitude, own, drift=drift, disturbance=field)
        tests = field_tests(fit(linked(rng, attitude, data)))
        best = max((one for one in tests.scores if one.kind == "time"), key=lambda one: one.chi2)
        assert best.name == f"step of the {what} at rest {N // 2 + 1}"


def test_many_nodes_are_tested_in_stretches():
    rng = np.random.default_rng(5)
    own = sim.device(rng)
    attitude, turns = sim.tumbling(rng, 300)
    change = np.zeros((300, 3))
    change[150:] = [1e-6, 1e-6, 0.0]
    data = sim.rests(rng, attitude, own, sigma_m=0.5e-6, disturbance=change)
    data = sim.without_directions(sim.add_turns(rng, data, turns, step=0.2))
    tests = field_tests(fit(data))
    assert len(tests.scores) < 130
    best = min(tests.scores, key=tests.adjusted)
    assert best.name.startswith("step of the field at rest 1")
    assert abs(int(best.name.rpartition(" ")[2]) - 151) < 12


def test_nine_rests_do_not_show_a_drift_of_the_strength_and_the_verdict_says_so():
    rng = np.random.default_rng(0)
    own = sim.device(rng)
    found = calibrated(rng, sim.scattered(rng, 9), own)
    causes = undetectable_causes(found.estimate, found.sensor)
    assert "drift of the strength" in {one.name for one in causes}
    assert any("drift of the strength" in text for text in found.judged.statements)
