"""Two orthogonal accelerometers on a dividing head: what they feel together is g.

A head of 3″ is 15 µg at the horizon. Two accelerometers at right angles err there in opposite ways,
so that ‖f̂‖ = g is free of the head; what g² does not tell (`square.NULLS`) an autocollimator does,
or priors.

* `joint`: all readings, exact, with the head's errors and the biases' drift as nuisances.
* `patent`: bias and gain from the four cardinal positions, then g² elsewhere.
* `dual`: g² alone, with priors in the place of the autocollimator.
* `single`: each accelerometer against the head taken as exact, the conventional tumble test.

The sensor is that of `inercal.benches.dividing_head.bench.mounted`. `joint` and `single` take one
accelerometer too.

Source: CN101852817A (Harbin Institute of Technology, 2010) for `patent` and `dual`, rebuilt from
the physics; IEEE Std 1293 for the tumble test; `joint` is ours.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inercal.benches.dividing_head.bench import DividingHead
from inercal.benches.dividing_head.covariance import by_bench, readings_by_bench
from inercal.estimate import Estimate, Gaussian, least_squares
from inercal.estimate.scores import UNSCORED
from inercal.methods import by_angle, temperature, vectors
from inercal.methods._base import Method
from inercal.methods.dual_orthogonal import patent as four
from inercal.methods.dual_orthogonal import square
from inercal.methods.dual_orthogonal.common import with_common_angle
from inercal.methods.dual_orthogonal.together import notes
from inercal.methods.likelihood_tests import with_tests
from inercal.methods.observed import require_observed
from inercal.plan import Index
from inercal.recording import Observations
from inercal.sensors import Sensor


def joint(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Sequence[Index],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the coefficients and the bench's errors, at the largest posterior probability.

    Parameters
    ----------
    observations : Observations
        One row a position, (..., r, 1 or 2) m/s².
    sensor : Sensor
        Of the fixture, with the coefficients that are wanted.
    bench : DividingHead
    steps : sequence of r Index
        Of the rows.
    priors : sequence of Gaussian
        On coefficients, from elsewhere: K3 of a centrifuge, Kip of single tests.

    Raises
    ------
    InputError
        A sensor that is not the fixture's, or steps that are not those of the rows.
    NotObserved
        Coefficients that these positions leave open.
    """
    square.require_mounted(sensor, alone=True)
    vectors.require_rows(observations, sensor, steps)
    square.require_positions(sensor, steps)
    estimate = least_squares(by_angle.problem(observations, sensor, bench, steps, priors))
    require_observed(estimate, sensor, missing=())
    return replace(estimate, notes=(*notes(estimate, bench, priors), *estimate.notes))


def patent(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Sequence[Index],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the coefficients by four points, then g² elsewhere; arguments as of `joint`.

    The mounting angles' common part is the mean angle beyond the head's, as good as its zero.

    Raises
    ------
    InputError
        Priors on k0 or k1, or a sensor without them.
    NotObserved
        Cardinal positions that are missing, too few others, or K3 without a prior.
    """
    square.require_mounted(sensor)
    temperature.refuse(sensor, "patent", "joint")
    vectors.require_rows(observations, sensor, steps)
    steady = by_angle.drifting(observations, bench, steps)
    there = by_angle.as_stated(steady, sensor, bench, steps)
    estimate = four.estimate(there, sensor, bench, steps, priors)
    estimate = with_common_angle(estimate, observations, sensor, bench, steps)
    estimate = with_tests(estimate, by_angle.problem(observations, sensor, bench, steps, priors))
    return replace(estimate, notes=(*notes(estimate, bench, priors), *estimate.notes))


def dual(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Sequence[Index],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the coefficients by g² alone, with what priors tell; arguments as of `joint`.

    The mounting angles' common part is the mean angle beyond the head's, as good as its zero.

    Raises
    ------
    InputError
        A sensor that is not the fixture's pair.
    NotObserved
        Combinations of coefficients that g² and the priors leave free, named.
    """
    square.require_mounted(sensor)
    temperature.refuse(sensor, "dual", "joint")
    vectors.require_rows(observations, sensor, steps)
    square.require_positions(sensor, steps)
    square.require_told(sensor, bench, steps, priors)
    steady = by_angle.drifting(observations, bench, steps)
    asked = square.problem(steady, sensor, bench, steps, priors)
    estimate = square.with_gravity(asked, least_squares(asked))
    estimate = with_common_angle(estimate, observations, sensor, bench, steps)
    return replace(estimate, notes=(*notes(estimate, bench, priors), *estimate.notes))


def single(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Sequence[Index],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the coefficients of each accelerometer for itself, the head taken as exact.

    Arguments as of `joint`. The covariance holds what the bench's errors do to the result.

    Raises
    ------
    InputError
        A sensor that is not the fixture's, or steps that are not those of the rows.
    NotObserved
        Coefficients that these positions leave open.
    """
    square.require_mounted(sensor, alone=True)
    vectors.require_rows(observations, sensor, steps)
    steady = by_angle.drifting(observations, bench, steps)
    asked = by_angle.problem(steady, sensor, bench, steps, priors, exact=True)
    found = least_squares(asked)
    _, rows = asked.linearise(asked.start)
    rows = rows.reshape(-1, *rows.shape[-2:])[0]
    assert not callable(asked.noise)
    weighted = np.asarray(np.linalg.solve(asked.noise, rows), dtype=float)
    gain = found.covariance @ np.swapaxes(weighted, -1, -2)
    bench_alone = by_bench(sensor, bench, steps)
    columns = readings_by_bench(sensor, bench, steps)
    estimate = replace(
        found,
        covariance=found.covariance + gain @ bench_alone @ np.swapaxes(gain, -1, -2),
        # The residuals hold the head's errors besides their noise: no test of either.
        chi2=np.zeros(found.value.shape[:-1]),
        dof=0,
        scoring=UNSCORED,
        sensitivities={name: -gain @ column for name, column in columns.items()},
    )
    return with_tests(estimate, by_angle.problem(observations, sensor, bench, steps, priors))


METHOD = Method(
    name="dual_orthogonal",
    bench=DividingHead,
    finds={"f": ("k0", "k1", "delta_o", "k2", "k3", "kip")},
    also={"f": ("temperature",)},
    needs=("f",),
    plan=by_angle.plan,
    estimators={"joint": joint, "patent": patent, "dual": dual, "single": single},
    source="CN101852817A, Harbin Institute of Technology, 2010; IEEE Std 1293",
)
