"""Accelerometers on a precision centrifuge, from the norm of what they feel.

In any attitude on the arm specific force has the norm √(a² + g²), a the centripetal acceleration:
no attitude has to be known. At rates that press tens of g on the sensor its quadratic terms show
besides bias and scale factor.

`ml` compares ‖f̂‖, f̂ the inverse of the sensor's exact model, with the norm that the bench makes,
weighted by the readings' noise seen along f̂ and by what differs from dwell to dwell; what the whole
run shares (radius, stretch, rate, tilt, gravity, earth's rate) are nuisances with their stated
deviations. `series` and `paper` are closed formulas
(`inercal.methods.centrifuge_norm.closed_formulas`).

Rotating the triad changes no norm: of the misalignments only the non-orthogonality is seen.

Source: Wang Shiming, Li Mengzhen, Navigation Positioning and Timing 8(6), 2021 (the observation);
IEEE Std 836 (the bench); `ml` is ours.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inercal.arrays import Array
from inercal.benches.centrifuge.arm_motion import specific_force_norm
from inercal.benches.centrifuge.bench import Centrifuge
from inercal.calibration.forms import Frame
from inercal.errors import InputError, NotObserved
from inercal.estimate import Estimate, Gaussian, least_squares
from inercal.keys import CoefficientName
from inercal.methods import temperature
from inercal.methods._base import Method
from inercal.methods.centrifuge_norm import closed_formulas
from inercal.methods.centrifuge_norm.arm_plans import plan
from inercal.methods.centrifuge_norm.problems import exact_bench_norm_problem, norm_problem, problem
from inercal.methods.centrifuge_norm.remarks import remarks
from inercal.methods.likelihood_tests import with_tests
from inercal.methods.observability import NOISE_ONLY_NOTE, require_observed
from inercal.plan import Spin
from inercal.recording import Observations
from inercal.sensors import Sensor
from inercal.uncertainty import propagate

SIGN_NOTE = (
    "norms do not tell a reversed axis, whose k0 and k2 only change sign, nor two axes exchanged: "
    "compare the sign of each axis with its attitude in one dwell"
)
LEVER_ARM_NOTE = (
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
    notes = [_observability_note(estimate)]
    if bench.indexing is None:
        known = all(step.attitude is not None for step in steps)
        notes.append(SIGN_NOTE if known else f"{SIGN_NOTE}; {LEVER_ARM_NOTE}")
    elif observations.mean.ndim == 2:
        notes.append(_attitude_gain_note(estimate, observations, sensor, bench, steps, priors))
    return replace(estimate, notes=(*notes, *estimate.notes))


def _attitude_gain_note(
    estimate: Estimate,
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian],
) -> str:
    """Say what the attitudes bring beside norms, by the uncertainties as modelled."""
    try:
        norms = norm_problem(observations, sensor, bench, steps, priors)
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


def _observability_note(estimate: Estimate) -> str:
    """Say what the dwells determine: rank, condition and the direction they see least."""
    singular = estimate.singular_values
    assert estimate.weakest is not None
    return (
        f"the dwells determine {estimate.rank} of {len(estimate.wanted)} coefficients, scaled "
        f"condition number {singular[0] / singular[-1]:.3g}; they see least of "
        f"{estimate.weakest.words}"
    )


@dataclass(frozen=True)
class ClosedFormulas:
    """An estimator of k0, k1 and k2 by closed formulas.

    The covariance holds the readings' noise alone: the bench is taken as exact.

    Parameters
    ----------
    name : str
    invert : callable
        From the coefficients of the series to those of the axes.
    weighted : bool
        Whether rows are weighted by the noise of their squared norms.
    """

    name: str
    invert: closed_formulas.SeriesInverse
    weighted: bool = False

    def __call__(
        self,
        observations: Observations,
        sensor: Sensor,
        bench: Centrifuge,
        steps: Sequence[Spin],
        priors: Sequence[Gaussian] = (),
    ) -> Estimate:
        """Return the estimate; arguments as of `ml`.

        Raises
        ------
        InputError
            Priors, a trial axis, or other coefficients than k0, k1, k2 of three accelerometers; or
            noise that may leave no root.
        NotObserved
            Dwells that leave the regression short of rank.
        """
        if priors:
            raise InputError(f"estimator {self.name} takes no priors; use ml")
        temperature.refuse_temperature_terms(sensor, self.name, "ml")
        mean = observations.mean
        if mean.ndim != 2:
            raise InputError(f"estimator {self.name} works on one table at a time")
        singular = closed_formulas.regression_singular_values(sensor, mean, self.name)
        declared = bench.acting_parameters(steps, vectors=False)
        result = specific_force_norm(
            bench, steps, {name: np.array(q.value) for name, q in declared.items()}
        )

        def formulas(flat: Array) -> Array:
            y = flat.reshape(*flat.shape[:-1], *mean.shape)
            return closed_formulas.coefficients(
                sensor, y, result.norm, self.invert, weighted=self.weighted
            )

        value, spread = propagate(formulas, mean.ravel(), observations.full_covariance)
        if not np.isfinite(value).all():
            lost = (
                n for n, v in zip(sensor.coefficients, value, strict=True) if not np.isfinite(v)
            )
            axes = sorted({CoefficientName(name).axis for name in lost})
            raise InputError(
                f"estimator {self.name}: the noise is larger than what k2 leaves in the fourth "
                f"powers of {', '.join(axes)}, whose square root it takes; use series or ml"
            )
        notes = (NOISE_ONLY_NOTE, SIGN_NOTE)
        return with_tests(
            Estimate.from_closed_form(sensor.coefficients, value, spread, singular, notes),
            problem(observations, sensor, bench, steps),
            exact_bench_norm_problem(observations, sensor, bench, steps),
        )


series = ClosedFormulas("series", closed_formulas.series)
"""By the series' first three coefficients, rows weighted alike."""
series_weighted = ClosedFormulas("series_weighted", closed_formulas.series, weighted=True)
"""As `series`, rows weighted by the noise of their squared norms."""
paper = ClosedFormulas("paper", closed_formulas.paper)
"""As the source does, for comparison: k2 from the fourth powers.

A fourth coefficient that is negative has no square root, and is refused; the covariance is not a
number where noise as stated may leave none.
"""


def _frame(bench: Centrifuge) -> Frame:
    # Norms know no mounting.
    return "triangular" if bench.indexing is None else "mount"


METHOD = Method(
    name="centrifuge_norm",
    bench=Centrifuge,
    default_coefficients={"f": ("k0", "k1", "k2")},
    also={"f": ("k3", "koq", "nonorthogonality", "misalignment", "arm", "temperature")},
    needs=("f",),
    plan=plan,
    estimators={"ml": ml, "series": series, "series_weighted": series_weighted, "paper": paper},
    norm_only_estimators=("ml",),
    frame=_frame,
    remarks=remarks,
    source="Wang and Li, Navigation Positioning and Timing 8(6), 2021; IEEE Std 836",
)
