"""Accelerometers on a precision centrifuge, from the norm of what they feel.

In any attitude on the arm specific force has the norm √(a² + g²), a the centripetal acceleration:
no attitude has to be known. At rates that press tens of g on the sensor its quadratic terms show
besides bias and scale factor.

`ml` compares ‖f̂‖, f̂ the inverse of the sensor's exact model, with the norm that the bench makes,
weighted by the readings' noise seen along f̂ and by what differs from dwell to dwell; what the whole
run shares (radius, stretch, rate, tilt, gravity, earth's rate) are nuisances with their stated
deviations. `series` and `paper` are closed formulas (`inercal.methods.centrifuge_norm.closed`).

Rotating the triad changes no norm: of the misalignments only the non-orthogonality is seen.

Source: Wang Shiming, Li Mengzhen, Navigation Positioning and Timing 8(6), 2021 (the observation);
IEEE Std 836 (the bench); `ml` is ours.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inercal.benches.arm import felt_norm
from inercal.benches.centrifuge import Centrifuge
from inercal.errors import InputError, NotObserved
from inercal.estimate import Estimate, Gaussian, least_squares
from inercal.keys import CoefficientName
from inercal.methods import temperature
from inercal.methods._base import Method
from inercal.methods.centrifuge_norm import closed
from inercal.methods.centrifuge_norm.plans import plan
from inercal.methods.centrifuge_norm.problems import by_norm, by_norm_exact, problem
from inercal.methods.likelihood_tests import with_tests
from inercal.methods.observed import NOISE_ALONE, require_observed
from inercal.plan import Spin
from inercal.recording import Observations
from inercal.sensors import Sensor
from inercal.uncertainty import propagate

Array = NDArray[np.float64]
SIGNS = (
    "norms do not tell a reversed axis, whose k0 and k2 only change sign, nor two axes exchanged: "
    "compare the sign of each axis with its attitude in one dwell"
)
ARMS = (
    "without [data] attitude they do not tell lever arms either: 1 µm on a radius of 1 m counts as "
    "up to 1 ppm of k1, and U does not hold it"
)


def ml(
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the sensor's coefficients and the bench's nuisances by maximum likelihood.

    Parameters
    ----------
    observations : Observations
        One row a dwell, (..., r, m) in SI.
    sensor : Sensor
        Accelerometers with the coefficients that are wanted, in the tilted form where nonlinear
        terms and misalignments are found together.
    bench : Centrifuge
    steps : sequence of r Spin
        Of the rows.
    priors : sequence of Gaussian
        On coefficients, from elsewhere: a static multi-position test knows bias and scale best.

    Raises
    ------
    NotObserved
        Coefficients that these dwells leave open.
    """
    estimate = least_squares(problem(observations, sensor, bench, steps, priors))
    require_observed(estimate, sensor, missing=())
    notes = [_seen(estimate)]
    if bench.indexing is None:
        known = all(step.attitude is not None for step in steps)
        notes.append(SIGNS if known else f"{SIGNS}; {ARMS}")
    elif observations.mean.ndim == 2:
        notes.append(_gained(estimate, observations, sensor, bench, steps, priors))
    return replace(estimate, notes=(*notes, *estimate.notes))


def _gained(
    estimate: Estimate,
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian],
) -> str:
    """Say what the attitudes bring beside norms, by the uncertainties as modelled."""
    try:
        norms = by_norm(observations, sensor, bench, steps, priors)
        alone = least_squares(replace(norms, candidates=None))
        require_observed(alone, sensor, missing=())
    except NotObserved as error:
        return f"the attitudes tell what norms alone leave open: {'; '.join(error.directions)}"
    p = len(sensor.coefficients)
    ratio = np.sqrt(np.diagonal(estimate.covariance)[:p] / np.diagonal(alone.covariance)[:p])
    most = int(ratio.argmin())
    return (
        f"known attitudes bring uncertainties to {ratio.min():.2g} to {ratio.max():.2g} of what "
        f"norms alone give, most for {sensor.coefficients[most]}"
    )


def _seen(estimate: Estimate) -> str:
    """Say what the dwells determine: rank, condition and the direction they see least."""
    singular = estimate.singular_values
    assert estimate.weakest is not None
    return (
        f"the dwells determine {estimate.rank} of {len(estimate.wanted)} coefficients, scaled "
        f"condition number {singular[0] / singular[-1]:.3g}; they see least of "
        f"{estimate.weakest.words}"
    )


def series(
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return k0, k1 and k2 by the series' first three coefficients, rows weighted alike.

    The covariance holds the readings' noise alone: the bench is taken as exact.

    Raises
    ------
    InputError
        Priors, a trial axis, or other coefficients than k0, k1, k2 of three accelerometers.
    NotObserved
        Dwells that leave the regression short of rank.
    """
    return _closed("series", closed.series, observations, sensor, bench, steps, priors)


def series_weighted(
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return k0, k1 and k2 as `series` does, rows weighted by the noise of their squared norms."""
    return _closed(
        "series_weighted",
        closed.series,
        observations,
        sensor,
        bench,
        steps,
        priors,
        weighted=True,
    )


def paper(
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return k0, k1 and k2 as the source does, for comparison: k2 from the fourth powers.

    The covariance is not a number where noise as stated may leave no root.

    Raises
    ------
    InputError
        As of `series`, or a fourth coefficient that is negative: it has no square root.
    NotObserved
        Dwells that leave the regression short of rank.
    """
    return _closed("paper", closed.paper, observations, sensor, bench, steps, priors)


def _closed(
    name: str,
    invert: closed.Invert,
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian],
    *,
    weighted: bool = False,
) -> Estimate:
    if priors:
        raise InputError(f"estimator {name} takes no priors; use ml")
    temperature.refuse(sensor, name, "ml")
    mean = observations.mean
    if mean.ndim != 2:
        raise InputError(f"estimator {name} works on one table at a time")
    singular = closed.require_possible(sensor, mean, name)
    declared = bench.nuisances(steps, vectors=False)
    made = felt_norm(bench, steps, {name: np.array(q.value) for name, q in declared.items()})

    def formulas(flat: Array) -> Array:
        y = flat.reshape(*flat.shape[:-1], *mean.shape)
        return closed.coefficients(sensor, y, made.norm, invert, weighted=weighted)

    value, spread = propagate(formulas, mean.ravel(), observations.full_covariance)
    if not np.isfinite(value).all():
        lost = sorted(
            {
                CoefficientName(n).axis
                for n, v in zip(sensor.coefficients, value, strict=True)
                if not np.isfinite(v)
            }
        )
        raise InputError(
            f"estimator {name}: the noise is larger than what k2 leaves in the fourth powers of "
            f"{', '.join(lost)}, whose square root it takes; use series or ml"
        )
    return with_tests(
        Estimate.of_formulas(sensor.coefficients, value, spread, singular, (NOISE_ALONE, SIGNS)),
        problem(observations, sensor, bench, steps),
        by_norm_exact(observations, sensor, bench, steps),
    )


METHOD = Method(
    name="centrifuge_norm",
    bench=Centrifuge,
    finds={"f": ("k0", "k1", "k2")},
    also={"f": ("k3", "koq", "nonorthogonality", "misalignment", "arm", "temperature")},
    needs=("f",),
    plan=plan,
    estimators={"ml": ml, "series": series, "series_weighted": series_weighted, "paper": paper},
    framed=("ml",),
    source="Wang and Li, Navigation Positioning and Timing 8(6), 2021; IEEE Std 836",
)
