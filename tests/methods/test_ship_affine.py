"""f = M a + p against the sensor's coefficients: one to one, both ways, with slopes."""

from dataclasses import replace

import numpy as np
import pytest
from tests.methods.ship_cases import SENSOR, case

from inercal.basics.errors import InputError
from inercal.estimation.uncertainty import jacobian, propagate
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0, imu, triad
from inercal.physics.sensors.affine import (
    AFFINE_NAMES,
    IDENTITY_PARAMETERS,
    AffineModel,
    to_affine,
    to_coefficients,
)

RNG = np.random.default_rng(1)
C = case(1, 1).truth[0]


def test_the_model_corrects_what_the_sensor_reads():
    model, _ = to_affine(SENSOR, C)
    f = RNG.standard_normal((50, 3))
    read = SENSOR.forward(Motion(f * G0), C) / G0
    assert model.correct(read) == pytest.approx(f, abs=1e-14)


def test_there_and_back_is_exact():
    model, out = to_affine(SENSOR, C)
    again, back = to_coefficients(SENSOR, model)
    assert again == pytest.approx(C, abs=1e-14)
    assert out @ back == pytest.approx(np.eye(12), abs=1e-12)


@pytest.mark.parametrize("far", [1.0, 10.0])
def test_slopes_are_those_of_the_maps(far: float):
    c = far * C
    model, out = to_affine(SENSOR, c)
    step = np.full(12, 1e-3)
    assert out == pytest.approx(
        jacobian(lambda x: to_affine(SENSOR, x)[0].theta, c, step), abs=1e-9
    )
    _, back = to_coefficients(SENSOR, model)
    by_theta = jacobian(lambda x: to_coefficients(SENSOR, AffineModel.of(x))[0], model.theta, step)
    assert back == pytest.approx(by_theta, abs=1e-8)


def test_a_covariance_survives_the_way_there_and_back():
    root = 1e-3 * RNG.standard_normal((12, 12))
    covariance = root @ root.T
    theta, there = propagate(lambda x: to_affine(SENSOR, x)[0].theta, C, covariance)
    model, out = to_affine(SENSOR, C)
    assert out @ covariance @ out.T == pytest.approx(there, rel=1e-6, abs=1e-14)
    _, back = to_coefficients(SENSOR, AffineModel.of(theta))
    assert back @ there @ back.T == pytest.approx(covariance, rel=1e-6, abs=1e-14)
    assert model.theta == pytest.approx(theta)


def test_the_ideal_sensor_is_the_identity_and_thetas_have_the_papers_order():
    assert to_affine(SENSOR, np.zeros(12))[0].theta.tolist() == IDENTITY_PARAMETERS.tolist()
    c = np.zeros(12)
    c[SENSOR.coefficients.index("y.k0")] = 0.1 * G0
    c[SENSOR.coefficients.index("x.delta_o")] = 1e-9
    moved = dict(
        zip(AFFINE_NAMES, to_affine(SENSOR, c)[0].theta - IDENTITY_PARAMETERS, strict=True)
    )
    assert moved["Ayp"] == pytest.approx(-0.1)
    assert moved["Exy"] == pytest.approx(-1e-9)
    assert moved["Axp"] == pytest.approx(1e-10)


def test_trials_are_mapped_at_once():
    many = case(1, 5).truth
    model, slope = to_affine(SENSOR, many)
    assert slope.shape == (5, 12, 12)
    assert model.theta[3] == pytest.approx(to_affine(SENSOR, many[3])[0].theta, abs=1e-15)
    assert to_coefficients(SENSOR, model)[0] == pytest.approx(many, abs=1e-14)


@pytest.mark.parametrize(
    "sensor",
    [
        replace(SENSOR, form="tilted"),
        triad().with_coefficients("k0", "k1"),
        triad().with_coefficients("k0", "k1", "k2", "delta_o", "delta_p"),
        imu().with_coefficients("k0", "k1", "bias"),
    ],
)
def test_another_error_model_is_refused(sensor):  # pyright: ignore
    with pytest.raises(InputError):
        to_affine(sensor, np.zeros(len(sensor.coefficients)))
