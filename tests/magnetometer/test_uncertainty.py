"""The stated uncertainty of a magnetometer agrees with its errors, for every kind of data."""
# Arrays and records without annotations, because a plain script is easier to compare with formulas.
# pyright: reportUnknownParameterType=false, reportArgumentType=false
# pyright: reportPossiblyUnboundVariable=false

import numpy as np
import pytest
from tests.base_seeds import chosen, sampled
from tests.magnetometer import generator as sim
from tests.magnetometer.cases import band, fit, linear_model, normalised_error, records, true_values

from inercal.basics.units import Measured
from inercal.methods.magnetic_field.fitting import fit_field
from inercal.methods.magnetic_field.records import FieldConditions, LinearModel

GOOD_ACCELEROMETER = np.full(9, 300e-6)  # 300 ppm and 0.3 mg
POOR_ACCELEROMETER = np.full(9, 5e-3)
GYRO = np.concatenate([np.full(9, 1e-3), np.full(3, 1e-5)])


def with_prior(rng, sd, n=24):
    data = sim.rests(rng, sim.scattered(rng, n), sim.device(rng))
    return sim.with_accelerometers(data, np.diag(sd**2), sd * rng.standard_normal(9))


def linked(rng, n=12, about_up=True):
    attitude = sim.scattered(rng, n)
    data = sim.rests(rng, attitude, sim.device(rng))
    turns = sim.turns_between(attitude)
    return sim.add_turns(rng, data, turns, gyro=GYRO, about_up=about_up)


def linked_with_prior(rng):
    attitude = sim.scattered(rng, 24)
    data = sim.rests(rng, attitude, sim.device(rng))
    sd = GOOD_ACCELEROMETER
    data = sim.with_accelerometers(data, np.diag(sd**2), sd * rng.standard_normal(9))
    return sim.add_turns(rng, data, sim.turns_between(attitude), gyro=GYRO, about_up=True)


def rests_and_motion(rng):
    """Eight rests, with six moving pieces between each two."""
    attitude, turns = sim.tumbling(rng, 50, step=1.0)
    at_rest = np.arange(0, 50, 7)
    sd = np.full(50, 0.5e-6)
    sd[at_rest] = sim.SIGMA_M
    data = sim.rests(rng, attitude, sim.device(rng), sigma_m=sd)
    return sim.without_directions(sim.add_turns(rng, data, turns, step=1.0, gyro=GYRO), at_rest)


def motion(rng, n=200):
    """Continuous motion without accelerometers."""
    attitude, turns = sim.tumbling(rng, n)
    data = sim.rests(rng, attitude, sim.device(rng), sigma_m=0.5e-6)
    return sim.without_directions(sim.add_turns(rng, data, turns, step=0.2, gyro=GYRO))


def faces(azimuths):
    return lambda rng: sim.rests(rng, sim.six_faces(rng, azimuths), sim.device(rng))


def rests(n, tilt=180.0, **options):
    def make(rng):
        attitude = sim.scattered(rng, n, np.radians(tilt))
        return sim.rests(rng, attitude, sim.device(rng), **options)

    return make


def joint(rng):
    error = 5e-3 * rng.standard_normal(9)
    return sim.joint_rests(rng, sim.scattered(rng, 30), sim.device(rng), error)


CASES = {
    "accelerometers by prior": (lambda rng: with_prior(rng, GOOD_ACCELEROMETER), 60),
    "poor accelerometers by prior": (lambda rng: with_prior(rng, POOR_ACCELEROMETER), 60),
    "accelerometers from the same rests": (joint, 60),
    "turns about the vertical": (linked, 60),
    "whole turns": (lambda rng: linked(rng, about_up=False), 40),
    "turns and accelerometers by prior": (linked_with_prior, 40),
    "rests and motion": (rests_and_motion, 20),
    "motion without accelerometers": (motion, 25),
    "six faces, two azimuths": (faces(2), 60),
    "six faces, three azimuths": (faces(3), 60),
    "six faces, four azimuths": (faces(4), 60),
    "nine rests": (rests(9), 60),
    "tilt below 45°": (rests(30, 45), 60),
    "tilt below 10°": (rests(30, 10), 60),
    "noisy magnetometer": (rests(24, sigma_m=0.5e-6), 60),
}


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "count"), sampled(30, 200))
def test_errors_of_24_rests_agree_with_their_covariance(seed, count):
    errors, chi2, dof = [], 0.0, 35
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        data = rests(24)(rng)
        found = fit(data)
        assert found.converged
        assert found.dof == dof
        errors.append(normalised_error(found, data.device))
        chi2 += found.chi2
    assert np.mean(errors) == pytest.approx(1, abs=band(13, count))
    assert chi2 / dof / count == pytest.approx(1, abs=band(dof, count))


# One of each kind of data: "turns …" and "six faces …" differ in their numbers only.
REPRESENTATIVE = (
    "accelerometers by prior",
    "accelerometers from the same rests",
    "turns about the vertical",
    "rests and motion",
    "motion without accelerometers",
    "six faces, two azimuths",
    "tilt below 10°",
)


@pytest.mark.slow
@pytest.mark.parametrize("case", chosen(CASES, REPRESENTATIVE))
@pytest.mark.parametrize(("seed", "share"), sampled(0.4, 1.0))
def test_errors_agree_with_their_covariance(case, seed, share):
    make, count = CASES[case]
    errors, chi2, dof, count = [], 0.0, 0, round(share * count)
    for k in range(count):
        data = make(np.random.default_rng([seed, 17, k]))
        found = fit(data)
        assert found.converged
        errors.append(normalised_error(found, data.device))
        chi2, dof = chi2 + found.chi2, dof + found.dof
    assert np.mean(errors) == pytest.approx(1, abs=band(12, count))
    assert chi2 / dof == pytest.approx(1, abs=band(dof, 1))


@pytest.mark.slow
def test_wrong_accelerometers_that_are_taken_as_exact_raise_chi_squared(seed):
    chi2, dof = 0.0, 0
    for k in range(12):
        rng = np.random.default_rng([seed, k])
        data = with_prior(rng, POOR_ACCELEROMETER)
        data.known, data.up_by_known = np.zeros((0, 0)), np.zeros((24, 3, 0))
        nodes, directions, links, _ = records(data)
        conditions = FieldConditions(Measured(50e-6, 0.0), hemisphere="north")
        found = fit_field(nodes, linear_model(), directions, links, conditions)
        chi2, dof = chi2 + found.chi2, dof + found.dof
    assert chi2 / dof > 1 + 2 * band(dof, 1)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "count"), sampled(80, 100))
def test_cross_covariance_predicts_the_effect_of_the_accelerometers_error(seed, count):
    """What the known error does not explain has the remaining covariance."""
    errors, along, length = [], 0.0, 0.0
    for k in range(count):
        data = with_prior(np.random.default_rng([seed, k]), POOR_ACCELEROMETER)
        found = fit(data)
        by_known = found.cross @ np.linalg.inv(data.known)
        covariance = (found.covariance - by_known @ found.cross.T)[:13, :13]
        size = np.sqrt(np.diagonal(covariance))
        weight = np.linalg.inv(covariance / np.outer(size, size))
        predicted = (by_known @ data.known_error)[:13] / size
        error = (found.value - true_values(linear_model(), data.device))[:13] / size
        errors.append((error - predicted) @ weight @ (error - predicted) / 13)
        along += error @ weight @ predicted
        length += predicted @ weight @ predicted
    assert np.mean(errors) == pytest.approx(1, abs=band(13, count))
    assert along / length == pytest.approx(1, abs=4 / np.sqrt(length))
    assert 4 / np.sqrt(length) < 0.5  # a slope of 0 or of −1 would be seen


@pytest.mark.parametrize(("seed", "count"), sampled(12, 60))
def test_strength_with_an_uncertainty_and_free_strength_agree_with_their_covariance(seed, count):
    stated, free = [], []
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        data = rests(24)(rng)
        nodes, directions, links, _ = records(data)
        strength = Measured(50e-6 + 0.3e-6 * rng.standard_normal(), 0.3e-6)
        conditions = FieldConditions(strength, hemisphere="north")
        found = fit_field(nodes, linear_model(), directions, links, conditions)
        stated.append(normalised_error(found, data.device))
        error = found.value - true_values(linear_model(), data.device)
        assert abs(error[-1]) < 5 * 0.3e-6
        found = fit(data, strength_sd=None)
        assert found.per_field
        assert sum(found.value[1:12:4]) == pytest.approx(0, abs=1e-12)
        free.append(normalised_error(found, data.device))
    assert np.mean(stated) == pytest.approx(1, abs=band(13, count))
    assert np.mean(free) == pytest.approx(1, abs=band(13, count))


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "count"), sampled(12, 60))
def test_stated_dip_agrees_with_its_covariance_and_reduces_the_uncertainty(seed, count):
    errors = []
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        data = rests(12, 30)(rng)
        dip = Measured(data.device.dip + 5e-4 * rng.standard_normal(), 5e-4)
        found, without = fit(data, dip=dip), fit(data)
        assert found.covariance[12, 12] < 0.3 * without.covariance[12, 12]
        errors.append(normalised_error(found, data.device))
    assert np.mean(errors) == pytest.approx(1, abs=band(13, count))


@pytest.mark.parametrize(("seed", "count"), sampled(12, 60))
def test_temperature_coefficients_of_the_offset_are_estimated(seed, count):
    plain, errors = linear_model(), []
    more = np.zeros((3, 3, 4))
    more[range(3), range(3), 3] = 1.0
    names = (*plain.names, "mx.bias_dT", "my.bias_dT", "mz.bias_dT")
    directions = np.concatenate([plain.directions, more])
    model = LinearModel(names, plain.nominal, directions, np.array([0] * 12 + [1] * 3))
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        data, true = rests(24)(rng), 20e-9 * rng.standard_normal(3)
        temperature = rng.uniform(-10, 10, 24)
        data.reading = data.reading + temperature[:, None] * true
        nodes, directions, links, _ = records(data)
        nodes.temperature[:] = temperature
        conditions = FieldConditions(Measured(50e-6, 0.0), hemisphere="north")
        found = fit_field(nodes, model, directions, links, conditions)
        error = (found.value[12:15] - true) / np.sqrt(np.diagonal(found.covariance)[12:15])
        errors.append(np.mean(error**2))
    assert np.mean(errors) == pytest.approx(1, abs=band(3, count))


@pytest.mark.slow
def test_an_offset_of_twenty_fields_does_not_disturb_the_starts():
    for k in range(20):
        rng = np.random.default_rng(k)
        own = sim.device(rng)
        own.o = 20 * own.strength * sim.scattered(rng, 1)[0, 2]
        found = fit(sim.rests(rng, sim.scattered(rng, 24), own))
        assert normalised_error(found, own) < 4


@pytest.mark.slow
def test_two_thousand_nodes_of_motion(seed):
    errors = []
    for k in range(8):
        data = motion(np.random.default_rng([seed, k]), 2000)
        found = fit(data)
        assert found.converged
        errors.append(normalised_error(found, data.device))
    assert np.mean(errors) == pytest.approx(1, abs=band(12, 8))
