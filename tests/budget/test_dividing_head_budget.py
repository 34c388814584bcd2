"""Budgets on a dividing head: first order against drawing, and against what is stated."""

import numpy as np
import pytest
from tests.accuracy.dividing_head import ARCSEC

from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import (
    CollimationMode,
    DividingHead,
    mounted_sensor,
    position_plan,
)
from inercal.estimation import Gaussian
from inercal.methods.dual_orthogonal import joint, patent
from inercal.physics.sensors import G0
from inercal.pipeline.budget import Experiment, budget

SENSOR = mounted_sensor().with_coefficients("k0", "k1", "k2", "k3", "kip", "delta_o")
PRIORS = (
    Gaussian.independent(("a.kip", "b.kip"), np.zeros(2), 20e-6 / G0),
    Gaussian.independent(("a.k3", "b.k3"), np.zeros(2), 0.5e-6 / G0**2),
)


def experiment(collimated: CollimationMode, **truth: float) -> Experiment:
    bench = DividingHead(
        Measured(G0, 1e-6 * G0),
        (1.9 * ARCSEC, 1.6 * ARCSEC),
        1.6 * ARCSEC,
        0.1 * ARCSEC,
        collimated,
        certificate=0.05 * ARCSEC,
        base=5 * ARCSEC,
        pier=0.02 * ARCSEC,
        creep=0.1 * ARCSEC,
        lean=20 * ARCSEC,
        drift=1e-6 * G0,
    )
    steps = position_plan(12, reverse=True)
    noise = np.broadcast_to((0.2e-6 * G0) ** 2 * np.eye(2), (24, 2, 2))
    estimator = patent if collimated == "pairs" else joint
    return Experiment(SENSOR, bench, steps, estimator, noise, PRIORS, truth)


@pytest.mark.parametrize("collimated", ["every", pytest.param("pairs", marks=pytest.mark.slow)])
def test_first_order_monte_carlo_and_stated_uncertainty_agree(collimated: CollimationMode):
    made = experiment(collimated)
    found = budget(made, trials=150)
    names = {line.name for line in made.imperfections}
    assert {"drift", "creep of the base", "tilt of the base", "polygon's faces"} <= names
    total, stated = found.total, made.stated()
    kept = stated > 0
    for k, name in enumerate(SENSOR.coefficients):
        error = 4 * total.error[k] + 0.02 * total.monte_carlo[k]
        assert total.monte_carlo[k] == pytest.approx(total.first_order[k], abs=error), name
    # What the estimators state is what comes out, mounting angles with their zero among it.
    assert stated[kept] == pytest.approx(total.first_order[kept], rel=0.1)


def test_a_drift_that_is_drawn_reaches_the_readings():
    made = experiment("every")
    q = {name: np.array(p.value) for name, p in made.bench_parameters.items()}
    still = made.readings(q, SENSOR.coefficients)
    moved = made.readings(q | {"drift_a[pass 1]": np.array(1e-5)}, SENSOR.coefficients) - still
    assert np.abs(moved[:, 1]).max() == 0
    assert np.diff(moved[:12, 0]) == pytest.approx(1e-5 / 12)
    assert np.ptp(moved[12:, 0]) == pytest.approx(0, abs=1e-15)
