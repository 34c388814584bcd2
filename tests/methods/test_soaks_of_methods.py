"""Soaks of methods with means: errors of the coefficients of temperature against what is stated.

The rows of a soak share an error of its temperature and a bias that does not come back; the
readings have white noise. The bench is nearly perfect, so that these make up the uncertainty.
The covariance is as modelled, without the Birge ratio: where a method adds the errors of soaks
after the fit, χ² does not include them, and the ratio makes the stated U larger than needed.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.special import chdtri
from tests.methods.test_every_estimator import ARM, BENCH, HEAD, PLATFORM, TABLE
from tests.methods.test_temperature import FIRST, priors

from inercal.benches import DividingHead
from inercal.benches.dividing_head.bench import mounted_sensor
from inercal.environment import Environment
from inercal.environment.common_errors import changed_by_soak_errors
from inercal.environment.soaks import with_soak_errors
from inercal.methods import METHODS
from inercal.recording import Observations
from inercal.sensors import imu
from inercal.units import Measured

KELVIN = (263.15, 293.15, 333.15)
TRIALS = 8
NOISE, U_T, FORCE, RATE = 3e-5, 0.1, 5e-4, 5e-7  # SI and K
ENVIRONMENT = Environment("soaks", U_T, FORCE, RATE)
G = Measured(9.81, 1e-9)
BENCHES = (
    replace(
        TABLE, gravity=G, radius=Measured(0.25, 1e-9), seat=1e-9, pose=1e-9, speed=1e-9, lean=1e-9
    ),
    replace(BENCH, gravity=G, tilt=1e-9, turn_angle=1e-9, turn_tilt=1e-9),
    replace(
        PLATFORM,
        gravity=G,
        rate_scale=1e-9,
        rate_asymmetry=1e-9,
        rate_stability=1e-9,
        setting=1e-9,
        attitude=1e-9,
        mounting=1e-9,
    ),
    replace(HEAD, gravity=G, autocollimator=1e-9),
    replace(ARM, gravity=G),
)
LONG = pytest.mark.evidence  # a minute and more
METHODS_OF_SOAKS = [
    pytest.param("ship_multi_angle", "joint", marks=LONG),
    ("tumble", "least_squares"),
    ("centrifuge_norm", "ml"),
    pytest.param("rates_and_poses", "ml", marks=LONG),
    pytest.param("dual_orthogonal", "joint", marks=LONG),
    pytest.param("multi_position", "joint", marks=LONG),
]


def errors(name: str, estimator: str, seed: int, trials: int) -> tuple[np.ndarray, np.ndarray]:
    """Return errors, (trials, p), and covariances of the coefficients of temperature."""
    chosen = METHODS[name]
    (bench,) = (one for one in BENCHES if isinstance(one, chosen.bench))
    whole = imu().select_axes("f") if chosen.unknown_attitudes else imu()
    if chosen.bench is DividingHead:
        whole = replace(mounted_sensor(axes="a" if name == "tumble" else "ab"), form="tilted")
    kinds = {axis.measures for axis in whole.axes if axis.measures in chosen.default_coefficients}
    also = FIRST if kinds == {"f", "w"} else FIRST[:2]
    if "scale" not in chosen.default_coefficients.get("w", ("scale",)):
        also = FIRST[:3]
    sensor = chosen.prepare(whole, also=also)
    p, m = len(sensor.coefficients), len(sensor.axes)
    plan = chosen.plan()
    steps: list[Any] = [
        replace(step, label=f"{step.label} ({k})") for k in range(len(KELVIN)) for step in plan
    ]
    r = len(steps)
    motion = bench.mean_motion(steps, {}).motion  # type: ignore[union-attr]
    recorded = np.repeat(KELVIN, len(plan))
    rng = np.random.default_rng([seed, 31])
    found_errors, covariances = [], []
    for _ in range(trials):
        c = 1e-3 * rng.standard_normal(p) * sensor.unit_scale
        if name == "centrifuge_norm":
            c[[one.endswith(".k2") for one in sensor.coefficients]] *= 1e-2
        true = recorded + U_T * np.repeat(rng.standard_normal(len(KELVIN)), len(plan))
        mean = sensor.forward(replace(motion, dT=true - sensor.reference_temperature), c)
        size = np.array([FORCE if axis.measures == "f" else RATE for axis in sensor.axes])
        mean = mean + np.repeat(size * rng.standard_normal((len(KELVIN), m)), len(plan), axis=0)
        sd = np.array([NOISE if axis.measures == "f" else NOISE / 100 for axis in sensor.axes])
        seen = Observations(
            tuple(step.label for step in steps),
            mean + sd * rng.standard_normal((r, m)),
            np.broadcast_to(np.diag(sd**2), (r, m, m)),
            np.array([step.seconds for step in steps]),
            np.full(r, 1000),
            np.arange(r, dtype=float),
            sensor.channels,
            temperature=recorded,
        )
        told = priors(name, sensor, c)
        solve = chosen.estimator(estimator)
        found = solve(seen, sensor, bench, steps, told)
        if chosen.weighs_common_errors:
            seen = with_soak_errors(seen, sensor, found.value[:p], ENVIRONMENT)
            found = solve(seen, sensor, bench, steps, told)
            covariance = found.covariance
        else:  # as the pipeline does: after the fit
            moves = [
                solve(changed, sensor, bench, steps, told).value - found.value
                for changed in changed_by_soak_errors(seen, sensor, ENVIRONMENT)
            ]
            covariance = found.covariance + sum(np.outer(d, d) for d in moves)
        at = [k for k, one in enumerate(sensor.coefficients) if one.endswith("_dT")]
        found_errors.append((found.value[:p] - c)[at])
        covariances.append(covariance[np.ix_(at, at)])
    return np.array(found_errors), np.array(covariances)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "estimator"), METHODS_OF_SOAKS)
def test_soaks_of_each_method_err_by_what_is_stated(name: str, estimator: str):
    error, covariance = errors(name, estimator, 1, TRIALS)
    nees = float(np.einsum("ti,ti->", error, np.linalg.solve(covariance, error[..., None])[..., 0]))
    low, high = (float(chdtri(error.size, tail)) for tail in (0.9995, 0.0005))
    assert low < nees < high
