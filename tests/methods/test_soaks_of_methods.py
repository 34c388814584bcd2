"""Soaks of methods with means: errors of the coefficients of temperature against what is stated.

The rows of a soak share an error of its temperature and a bias that does not come back; the
readings have white noise. The bench is nearly perfect, so that these make up the uncertainty.
The covariance is that to state, with its Birge ratio: χ² contains the errors of the soaks. Of
multi_position, which adds them after the fit, it is as modelled.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.special import chdtri
from tests.base_seeds import SEEDS
from tests.methods.test_every_estimator import ARM, BENCH, HEAD, PLATFORM, TABLE
from tests.methods.test_temperature import FIRST, priors

from inercal.basics.units import Measured
from inercal.benches import DividingHead
from inercal.benches.dividing_head.bench import mounted_sensor
from inercal.methods import METHODS
from inercal.physics.sensors import imu
from inercal.recordings import Observations
from inercal.recordings.environment import Environment
from inercal.recordings.soaks import changed_by_soak_errors, with_soak_errors

KELVIN = (263.15, 293.15, 333.15)
TRIALS = 8  # of each seed
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
WEIGHING = [
    ("ship_multi_angle", "joint"),
    ("tumble", "least_squares"),
    ("centrifuge_norm", "ml"),
    ("dual_orthogonal", "joint"),
    ("dual_orthogonal", "single"),
    pytest.param("rates_and_poses", "ml", marks=pytest.mark.evidence),
]


class Trials(NamedTuple):
    """Errors and covariances of the coefficients of temperature, and χ² of each trial."""

    error: np.ndarray
    covariance: np.ndarray
    chi2: np.ndarray
    dof: int

    def require_nees(self) -> None:
        """Assert that the sum of squared normalised errors is within its .1 % band."""
        whitened = np.linalg.solve(self.covariance, self.error[..., None])[..., 0]
        require_chi2(float(np.sum(self.error * whitened)), self.error.size)


def require_chi2(total: float, dof: int) -> None:
    low, high = (float(chdtri(dof, tail)) for tail in (0.9995, 0.0005))
    assert low < total < high


def simulate(name: str, estimator: str, seed: int, trials: int, *, told: bool = True) -> Trials:
    """Return trials of a method whose soaks are stated, or for `told` false are not."""
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
    found_errors, covariances, chi2 = [], [], []
    dof = 0
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
        known = priors(name, sensor, c)
        solve = chosen.estimator(estimator)
        found = solve(seen, sensor, bench, steps, known)
        if chosen.weighs_common_errors and not told:
            covariance = found.stated_covariance
        elif chosen.weighs_common_errors:
            seen = with_soak_errors(seen, sensor, found.value[:p], ENVIRONMENT)
            found = solve(seen, sensor, bench, steps, known)
            covariance = found.stated_covariance
        else:  # as the pipeline does: after the fit
            moves = [
                solve(changed, sensor, bench, steps, known).value - found.value
                for changed in changed_by_soak_errors(seen, sensor, ENVIRONMENT)
            ]
            covariance = found.covariance + sum(np.outer(d, d) for d in moves)
        at = [k for k, one in enumerate(sensor.coefficients) if one.endswith("_dT")]
        found_errors.append((found.value[:p] - c)[at])
        covariances.append(covariance[np.ix_(at, at)])
        chi2.append(float(found.chi2))
        dof = found.dof
    return Trials(np.array(found_errors), np.array(covariances), np.array(chi2), dof)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("name", "estimator"), WEIGHING)
def test_soaks_of_each_method_err_by_what_is_stated_and_chi2_contains_them(
    name: str, estimator: str, seed: int
):
    found = simulate(name, estimator, seed, TRIALS)
    found.require_nees()
    if estimator == "single":
        assert found.dof == 0  # it makes no test
    else:
        require_chi2(float(found.chi2.sum()), found.dof * TRIALS)


def test_soaks_that_are_not_stated_are_found_by_chi2():
    found = simulate("tumble", "least_squares", 4, TRIALS, told=False)
    assert (found.chi2 > 5 * found.dof).all()


@pytest.mark.evidence
def test_errors_of_soaks_that_are_added_after_the_fit_are_what_is_stated():
    simulate("multi_position", "joint", 1, TRIALS).require_nees()
