"""Calibrate two orthogonal accelerometers on a dividing head, which together sense g.

A head error of 3″ corresponds to 15 µg when the sensitive axis is horizontal. Two accelerometers at
right angles have opposite errors there, so ‖f̂‖ = g does not depend on the head. An autocollimator
or priors determine the combinations that g² leaves free (`g_squared.NULL_DIRECTIONS`).

* `joint`: uses all readings and the exact model; the head's errors and the biases' drift are
  nuisances.
* `patent`: computes bias and gain from the four cardinal positions, then uses g² at the others.
* `dual`: uses only g², with priors instead of the autocollimator.
* `single`: compares each accelerometer with the head, which is treated as exact. This is the
  conventional tumble test.

The sensor comes from `inercal.benches.dividing_head.bench.mounted_sensor`; `joint` and `single`
also accept one accelerometer.

g² does not observe the common mounting angle. `patent` and `dual` compute it from the angle at
which the compensated accelerometers sense gravity. The mean difference between this angle and the
head's angle is the common mounting angle plus the mean error of the head, mainly its zero error.

Some sums of coefficients are known far better than each coefficient separately. A vertical
accelerometer determines k1 + K3 g². Intermediate positions would separate the two, but there the
head's second harmonic has the same effect. A centrifuge separates them, and so does a polygon face
at each position. Both mounting angles depend on the head's zero; the angle between the
accelerometers does not.

Sources: CN101852817A (Harbin Institute of Technology, 2010) for `patent` and `dual`, derived again
from the physics; IEEE Std 1293 for the tumble test; `joint` is our own.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_quantity
from inercal.benches.dividing_head.bench import (
    DividingHead,
    bench_covariance,
    reading_sensitivities,
)
from inercal.benches.dividing_head.passes import sensor_angles
from inercal.estimation import Estimate, least_squares
from inercal.estimation.scores import NO_SCORE_TESTS
from inercal.estimation.uncertainty import COVERAGE
from inercal.methods import Method, Priors, dividing_head_problem
from inercal.methods.dual_orthogonal import g_squared
from inercal.methods.dual_orthogonal import patent_estimator as four
from inercal.methods.dual_orthogonal.g_squared import MOUNTING_ANGLES
from inercal.methods.observability import require_observed
from inercal.methods.order_effects import with_tests
from inercal.methods.solving import refuse_temperature_terms, require_matching_rows
from inercal.physics.plan import Indexings
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations

_MIN_IMPROVEMENT = 3.0  # ratio of one coefficient's uncertainty to that of the sum


class CoefficientSum(NamedTuple):
    """A sum of two coefficients that is far better known than either, in SI units of the first."""

    name: str
    meaning: str
    terms: tuple[str, str]
    value: float
    sd: float  # modelled standard deviation


def well_determined_sums(estimate: Estimate, g: float) -> tuple[CoefficientSum, ...]:
    """Return k1 + K3 g² for each accelerometer and the angle between them, if they are well known.

    Parameters
    ----------
    estimate : Estimate
        Estimate from one recording.
    g : float
        Local gravity, m/s².
    """
    axes = [CoefficientName(name).axis for name in estimate.wanted if name.endswith(".k1")]
    requested = [
        (f"{a}.k1 + {a}.k3 g²", "gain between up and down", (f"{a}.k1", f"{a}.k3"), (1.0, g**2))
        for a in axes
    ]
    first, second = MOUNTING_ANGLES
    between = (f"{second} − {first}", "angle between the accelerometers", (second, first))
    sums: list[CoefficientSum] = []
    for name, meaning, terms, weights in (*requested, (*between, (1.0, -1.0))):
        if set(terms) <= set(estimate.wanted):
            both, to = estimate.select(terms), np.array(weights)
            sd = float(np.sqrt(to @ both.covariance @ to))
            alone = np.abs(to) * np.sqrt(np.diagonal(both.covariance))
            if (alone > _MIN_IMPROVEMENT * sd).all():
                sums.append(CoefficientSum(name, meaning, terms, float(to @ both.value), sd))
    return tuple(sums)


def notes(estimate: Estimate, bench: DividingHead, priors: Priors) -> Iterator[str]:
    """Yield the notes on the well-determined sums of one recording; none for many trials."""
    if estimate.value.ndim != 1:
        return
    sums = well_determined_sums(estimate, bench.gravity.value)
    k = COVERAGE * float(estimate.birge)
    gains = [one for one in sums if one.terms != MOUNTING_ANGLES[::-1]]
    if gains:
        known = {name for prior in priors for name in prior.names}
        why = "The prior of K3 separates them."
        if not {one.terms[1] for one in gains} <= known:
            why = "Without a prior of K3, only the stated errors of the head separate them."
        values = ", ".join(
            f"{CoefficientName(one.terms[0]).axis} {format_quantity(one.value, k * one.sd, 'ppm')}"
            for one in gains
        )
        yield (
            f"k1 + K3 g² is known better than k1 or K3: {values} (k = 2). {why} To improve both, "
            "provide K3 from a centrifuge, or read a polygon face at every position."
        )
    for one in (one for one in sums if one not in gains):
        yield (
            f"The angle between the accelerometers, δ_b − δ_a, is "
            f"{format_quantity(one.value, k * one.sd, '″')} (k = 2). Their common angle cannot be "
            "known better than the zero of the head."
        )


def joint(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Indexings,
    priors: Priors = (),
) -> Estimate:
    """Return the most probable coefficients and bench errors, given all readings and priors.

    Parameters
    ----------
    observations : Observations
        One row per position, (..., r, 1 or 2) m/s².
    sensor : Sensor
        The fixture's sensor, with the coefficients to estimate.
    bench : DividingHead
    steps : sequence of r Index
        The steps of the rows.
    priors : sequence of Gaussian
        Priors on coefficients from other measurements: K3 from a centrifuge, Kip from single tests.

    Raises
    ------
    InputError
        The sensor does not fit the fixture, or the steps do not match the rows.
    NotObserved
        These positions do not determine all coefficients.
    """
    g_squared.require_fixture_sensor(sensor, allow_single=True)
    require_matching_rows(observations, sensor, steps)
    g_squared.require_enough_positions(sensor, steps)
    estimate = least_squares(
        dividing_head_problem.head_problem(observations, sensor, bench, steps, priors)
    )
    require_observed(estimate, sensor, missing=())
    return replace(estimate, notes=(*notes(estimate, bench, priors), *estimate.notes))


def patent(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Indexings,
    priors: Priors = (),
) -> Estimate:
    """Return the coefficients from four points, then from g²; the arguments are as for `joint`.

    Raises
    ------
    InputError
        There are priors on k0 or k1, or k0 or k1 is not selected.
    NotObserved
        Cardinal positions are missing, there are too few other positions, or K3 has no prior.
    """
    g_squared.require_fixture_sensor(sensor)
    refuse_temperature_terms(sensor, "patent", "joint")
    require_matching_rows(observations, sensor, steps)
    steady = dividing_head_problem.with_drift_covariance(observations, bench, steps)
    there = dividing_head_problem.readings_at_stated_angles(steady, sensor, bench, steps)
    estimate = four.two_stage_estimate(there, sensor, bench, steps, priors)
    estimate = _with_common_angle(estimate, observations, sensor, bench, steps)
    estimate = with_tests(
        estimate, dividing_head_problem.head_problem(observations, sensor, bench, steps, priors)
    )
    return replace(estimate, notes=(*notes(estimate, bench, priors), *estimate.notes))


def dual(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Indexings,
    priors: Priors = (),
) -> Estimate:
    """Return the coefficients from g² and the priors only; the arguments are as for `joint`.

    Raises
    ------
    InputError
        The sensor does not fit the fixture pair.
    NotObserved
        g² and the priors leave combinations of coefficients free; the message names them.
    """
    g_squared.require_fixture_sensor(sensor)
    refuse_temperature_terms(sensor, "dual", "joint")
    require_matching_rows(observations, sensor, steps)
    g_squared.require_enough_positions(sensor, steps)
    g_squared.require_determined(sensor, bench, steps, priors)
    steady = dividing_head_problem.with_drift_covariance(observations, bench, steps)
    requested = g_squared.g_squared_problem(steady, sensor, bench, steps, priors)
    estimate = g_squared.with_gravity_sensitivity(requested, least_squares(requested))
    estimate = _with_common_angle(estimate, observations, sensor, bench, steps)
    return replace(estimate, notes=(*notes(estimate, bench, priors), *estimate.notes))


def _with_common_angle(
    estimate: Estimate,
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Indexings,
) -> Estimate:
    """Return an estimate from g² with the common mounting angle and its variance added.

    g² estimates mounting angles ± δ/2. The arguments are as for `joint`, with two accelerometers.
    """
    if not set(g_squared.MOUNTING_ANGLES) <= set(sensor.coefficients):
        return estimate
    g, stated = bench.gravity.value, sensor_angles(bench, steps)
    p = len(sensor.coefficients)
    sensed = g_squared.compare_with_gravity(
        sensor, observations.mean, estimate.value[..., :p], g
    ).force
    beyond = np.arctan2(sensed[..., 0], sensed[..., 1]) - stated.nominal
    common = np.mean((beyond + np.pi) % (2 * np.pi) - np.pi, axis=-1)

    declared = bench.acting_parameters(steps)
    by_bench = sum(
        (one.sd * stated.weights[name].mean()) ** 2
        for name, one in declared.items()
        if name in stated.weights
    )
    across = np.stack([np.cos(stated.nominal), -np.sin(stated.nominal)], axis=-1).ravel()
    across = across / (g * len(steps))
    variance = by_bench + across @ observations.full_covariance @ across
    both = [estimate.names.index(name) for name in g_squared.MOUNTING_ANGLES]
    value, covariance = estimate.value.copy(), estimate.covariance.copy()
    value[..., both] += common[..., None]
    rows, columns = np.ix_(both, both)
    covariance[..., rows, columns] += np.asarray(variance)[..., None, None]
    moved = {name: by.copy() for name, by in estimate.sensitivities.items()}
    for name, weight in stated.weights.items():
        # If the stated angle of the head is larger, the mounting angle is smaller.
        by = moved.setdefault(name, np.zeros_like(value))
        by[..., both] -= weight.mean()
    return replace(estimate, value=value, covariance=covariance, sensitivities=moved)


def single(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Indexings,
    priors: Priors = (),
) -> Estimate:
    """Return each accelerometer's coefficients separately, with the head treated as exact.

    The arguments are as for `joint`. The covariance includes the effect of the bench's errors on
    the result.

    Raises
    ------
    InputError
        The sensor does not fit the fixture, or the steps do not match the rows.
    NotObserved
        These positions do not determine all coefficients.
    """
    g_squared.require_fixture_sensor(sensor, allow_single=True)
    require_matching_rows(observations, sensor, steps)
    steady = dividing_head_problem.with_drift_covariance(observations, bench, steps)
    requested = dividing_head_problem.head_problem(steady, sensor, bench, steps, priors, exact=True)
    alone = least_squares(requested)
    _, rows = requested.linearise(requested.start)
    rows = rows.reshape(-1, *rows.shape[-2:])[0]
    assert not callable(requested.noise)
    weighted = np.asarray(np.linalg.solve(requested.noise, rows), dtype=float)
    gain = alone.covariance @ weighted.mT
    bench_alone = bench_covariance(sensor, bench, steps)
    columns = reading_sensitivities(sensor, bench, steps)
    estimate = replace(
        alone,
        covariance=alone.covariance + gain @ bench_alone @ gain.mT,
        # The residuals contain both head errors and noise, so they cannot test either of them.
        chi2=np.zeros(alone.value.shape[:-1]),
        dof=0,
        scoring=NO_SCORE_TESTS,
        sensitivities={name: -gain @ column for name, column in columns.items()},
    )
    return with_tests(
        estimate, dividing_head_problem.head_problem(observations, sensor, bench, steps, priors)
    )


METHOD = Method(
    name="dual_orthogonal",
    bench=DividingHead,
    default_coefficients={"f": ("k0", "k1", "delta_o", "k2", "k3", "kip")},
    also={"f": ("temperature",)},
    needs=("f",),
    plan=dividing_head_problem.plan,
    remarks=dividing_head_problem.remarks,
    estimators={"joint": joint, "patent": patent, "dual": dual, "single": single},
    closed_formulas=("patent", "dual"),
    weighs_common_errors=True,
    source="CN101852817A, Harbin Institute of Technology, 2010; IEEE Std 1293",
)
