"""Gyros by constant rates and rests, accelerometers by poses of known attitude, in one likelihood.

Sections of all kinds are mixed at will: rests, dwells at constant rates and turns by known angles
about a vertical axis, in settings with several case axes up, and poses of known angles. The errors
of the table are nuisances whose deviations must be stated: most of them are like an error of the
sensor, and show in no residual. Accelerometers are used at rest alone, where the place of each in
the case is not sensed.

What a plan does not determine is refused by name, whatever residual excitation by the earth's rate
or by errors of the bench there is (`inercal.methods.rates_and_poses.plan_structure`).

Source: IEEE Std 952 and 1431, scale-factor and bias tests on a rate table; IEEE Std 1293,
multipoint tests; the likelihood is ours.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName, ErrorName
from inercal.basics.parameters import Parameter
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.sections import KnownTurn, PlatformStep, RateDwell
from inercal.estimation import Estimate, Gaussian, Problem
from inercal.methods import mean_problem, solving
from inercal.methods._base import Method
from inercal.methods.estimator_inputs import require_matching_rows
from inercal.methods.likelihood_tests import with_problem_tests
from inercal.methods.observability import require_observed
from inercal.methods.rates_and_poses.equal_weights import least_squares_line, refuse_priors_and_form
from inercal.methods.rates_and_poses.plan_structure import require_determined
from inercal.methods.rates_and_poses.platform_plans import plan
from inercal.methods.rates_and_poses.sign_terms import readings_without_input, without_signs
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations


def ml(
    observations: Observations,
    sensor: Sensor,
    bench: RatePlatform,
    steps: Sequence[PlatformStep],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the estimate of all readings but those of accelerometers while the table turns.

    Parameters
    ----------
    observations : Observations
        One row a section, (..., r, m) SI.
    sensor : Sensor
        Accelerometers, gyros or both, with the coefficients to estimate.
    bench : RatePlatform
    steps : sequence of RateDwell or Pose
        Steps of a plan that have no row are ignored.
    priors : sequence of Gaussian
        On coefficients.

    Raises
    ------
    InputError
        Rows without their steps, or an error of the bench that acts and is not stated.
    NotObserved
        Coefficients that these sections do not determine, by name.
    """
    observations = observations.without_drift()
    by_label = {step.label: step for step in steps}
    done = [by_label[label] for label in observations.labels if label in by_label]
    require_matching_rows(observations, sensor, done)
    declared, suspects = bench.nuisances(done, sensor), bench.suspects(done, sensor)
    _refuse_profiles(sensor, done)
    used = _used_readings(sensor, done)
    require_determined(observations, sensor, bench, done, priors, used)
    unsigned = readings_without_input(sensor, bench, done)

    def problem(some: Observations, own: Sequence[Gaussian]) -> Problem:
        whole = mean_problem.problem(
            some,
            sensor,
            declared,
            lambda q: bench.mean_motion(done, q),
            own,
            with_drift_candidate=True,
            zero_input=unsigned,
            families=_turn_on_family(suspects),
            suspects=suspects,
        )
        return mean_problem.row_subset(without_signs(whole, sensor, unsigned), used)

    estimate = solving.solve(observations, priors, problem)
    require_observed(estimate, sensor, missing=())
    return replace(estimate, tests=observations.tests)


def ieee(
    observations: Observations,
    sensor: Sensor,
    bench: RatePlatform,
    steps: Sequence[PlatformStep],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the estimate by least squares with equal weights, as of `ml`; the bench is exact.

    Raises
    ------
    InputError
        As of `ml`, and priors, coefficients of temperature, the tilted form or a trial axis.
    NotObserved
        As of `ml`.
    """
    refuse_priors_and_form(observations, sensor, priors)
    by_problem = ml(observations, sensor, bench, steps)
    by_label = {step.label: step for step in steps}
    done = [by_label[label] for label in observations.labels]
    line = least_squares_line(observations, sensor, bench, done, _used_readings(sensor, done))
    return with_problem_tests(line, by_problem)


def _turn_on_family(suspects: Mapping[str, Parameter]) -> dict[str, tuple[str, ...]]:
    """Return the gyros' biases that differ between settings as one candidate, and by setting."""
    result: dict[str, tuple[str, ...]] = {}
    for full in suspects:
        name = ErrorName(full)
        if name.name.startswith("turn_on"):
            for kind in ("turn_on", name.vector):
                result[kind] = (*result.get(kind, ()), full)
    return result


def _used_readings(sensor: Sensor, steps: Sequence[PlatformStep]) -> NDArray[np.int64]:
    """Return the places of the readings that are used, row after row."""
    turning = np.array([isinstance(step, RateDwell) and step.rate != 0 for step in steps])
    forces = np.array([axis.measures == "f" for axis in sensor.axes])
    return np.flatnonzero(~(turning[:, None] & forces))


def _refuse_profiles(sensor: Sensor, steps: Sequence[PlatformStep]) -> None:
    """Refuse terms of a turn's profile: a mean does not hold the mean of squares of the rate."""
    terms = tuple(
        name for name in sensor.coefficients if CoefficientName(name).term in ("scale2", "scale3")
    )
    if terms and any(isinstance(step, KnownTurn) for step in steps):
        raise InputError(
            f"[method] {', '.join(terms)}: a turn by an angle has no one rate, so that a mean does "
            "not determine them; remove these coefficients, or turn at constant rates alone",
            key="[method]",
            names=terms,
        )


METHOD = Method(
    name="rates_and_poses",
    bench=RatePlatform,
    default_coefficients={
        "f": ("bias", "scale", "misalignment"),
        "w": ("bias", "scale", "misalignment"),
    },
    also={
        "f": ("nonlinearity", "asymmetry", "cross", "temperature", "temperature_order"),
        "w": ("nonlinearity", "asymmetry", "g", "g2", "temperature", "temperature_order"),
    },
    needs=(),
    plan=plan,
    estimators={"ml": ml, "ieee": ieee},
    constant_rates=True,
    weighs_common_errors=True,
    source="IEEE Std 952 and 1431, rate tests; IEEE Std 1293, multipoint tests",
)
