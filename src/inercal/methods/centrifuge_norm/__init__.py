"""Calibrate accelerometers on a precision centrifuge from the norm of the specific force.

In every attitude on the arm the specific force has the norm √(a² + g²), where a is the centripetal
acceleration. The attitudes need not be known. At tens of g the quadratic terms are observable in
addition to bias and scale factor.

`ml` computes f̂ with the inverse of the sensor's exact model, and compares ‖f̂‖ with the norm that
the bench states. The rows are weighted by the readings' noise along f̂ and by the errors that
differ from dwell to dwell. Errors that are constant over the run (radius, stretch, rate, tilt,
gravity, earth's rate) are nuisances with their stated deviations. `series` and `paper` are closed
formulas (`inercal.methods.centrifuge_norm.closed_formulas`).

A rotation of the triad changes no norm, so only the non-orthogonality part of the misalignments is
observable.

The remarks name coefficients that explain the scatter of the rows. They also list rows that violate
the norm, with the change that would repair each. No row is changed, because only the user has the
original table.

A plan contains several attitudes on the arm at several rates. Each dwell lasts whole turns. Norms
determine the coefficients of an axis only if it has readings of both signs. In the twenty positions
of Wang and Li 2021, ψ covers only half a circle, and y never senses the arm from behind. On a full
circle the uncertainty of the worst coefficient is seven times smaller with the same number of
dwells.

Sources: Wang Shiming, Li Mengzhen, Navigation Positioning and Timing 8(6), 2021 (the observation);
IEEE Std 836 (the bench); `ml` is our own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi, radians

import numpy as np

from inercal.basics.errors import InputError, NotObserved
from inercal.basics.keys import CoefficientName
from inercal.benches.centrifuge.arm_motion import specific_force_norm
from inercal.benches.centrifuge.bench import Centrifuge
from inercal.calibration.forms import Frame
from inercal.estimation import Estimate, least_squares
from inercal.estimation.uncertainty import COVERAGE
from inercal.methods import Fit, Method, Priors, Remarks, solving
from inercal.methods.centrifuge_norm import closed_formulas
from inercal.methods.centrifuge_norm.omitted_coefficients import find_omitted_coefficients
from inercal.methods.centrifuge_norm.problems import (
    exact_bench_norm_problem,
    likelihood_problem,
    norm_problem,
)
from inercal.methods.centrifuge_norm.screening import screen_rows
from inercal.methods.observability import NOISE_ONLY_NOTE, require_observed
from inercal.methods.order_effects import with_tests
from inercal.physics.plan import Attitude, Spin, Spins, arm_attitude
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_selection import coefficient_words
from inercal.recordings import Finding, Observations

RATES = (2 * pi, 4 * pi, 6 * pi)
TURNS = 10
SIGN_NOTE = (
    "Norms cannot detect a reversed axis (only its k0 and k2 change their sign) or two exchanged "
    "axes. Compare the sign of each axis with its attitude in one dwell."
)
LEVER_ARM_NOTE = (
    "If no attitudes are given, norms cannot detect lever arms either: 1 µm on a radius of 1 m "
    "acts like up to 1 ppm of k1, which is not included in U."
)


def half_circle() -> tuple[Attitude, ...]:
    """Return the twenty positions of the paper: ψ from 0° in 45° steps, θ from 0° in 60° steps."""
    return tuple(arm_attitude(radians(45 * i), radians(60 * j)) for i in range(5) for j in range(4))


def full_circle() -> tuple[Attitude, ...]:
    """Return twenty positions on the full circle: ψ from 10° in steps of 72°, θ = 20° to 290°."""
    return tuple(
        arm_attitude(radians(10 + 72 * i), radians(theta))
        for i in range(5)
        for theta in (20, 110, 200, 290)
    )


ATTITUDES = {"full-circle": full_circle, "half-circle": half_circle}


def plan(
    attitudes: str = "full-circle", rates: Sequence[float] = RATES, turns: int = TURNS
) -> tuple[Spin, ...]:
    """Return the planned dwells: all attitudes at the first rate, then at the next rate.

    Parameters
    ----------
    attitudes : "full-circle" or "half-circle"
    rates : sequence of float
        Rates in the bench's positive direction, rad/s.
    turns : int
        Number of whole turns that each dwell is averaged over.

    Raises
    ------
    InputError
        The attitudes are unknown, there is no rate, or a rate is zero.
    """
    if attitudes not in ATTITUDES:
        raise InputError(
            f"attitudes {attitudes!r} are unknown; choose {' or '.join(ATTITUDES)}",
            key="attitudes",
            names=(attitudes,),
        )
    if not rates or not all(rates):
        raise InputError(
            "rates must contain at least one rate, and no rate may be 0, because at rest there is "
            "no centripetal acceleration",
            key="rates",
        )
    return tuple(
        Spin(f"p{k:02d}_r{j}", rate, 2 * pi * turns / abs(rate), attitude)
        for j, rate in enumerate(rates, start=1)
        for k, attitude in enumerate(ATTITUDES[attitudes](), start=1)
    )


def ml(
    observations: Observations, sensor: Sensor, bench: Centrifuge, steps: Spins, priors: Priors = ()
) -> Estimate:
    """Return the sensor's coefficients and the bench's nuisances by maximum likelihood.

    Parameters
    ----------
    observations : Observations
        One row per dwell, (..., r, m) in SI.
    sensor : Sensor
        Accelerometers with the coefficients to estimate. The tilted form is required if nonlinear
        terms and misalignments are estimated together.
    bench : Centrifuge
    steps : sequence of r Spin
        The steps of the rows.
    priors : sequence of Gaussian
        Priors on coefficients from other measurements, such as a static multi-position test.

    Raises
    ------
    NotObserved
        These dwells do not determine all coefficients.
    """
    estimate = solving.solve(
        observations, priors, lambda some, own: likelihood_problem(some, sensor, bench, steps, own)
    )
    require_observed(estimate, sensor, missing=())
    notes = [_observability_note(estimate)]
    if bench.indexing is None:
        known = all(step.attitude is not None for step in steps)
        notes.append(SIGN_NOTE if known else f"{SIGN_NOTE} {LEVER_ARM_NOTE}")
    elif observations.mean.ndim == 2:
        notes.append(_attitude_gain_note(estimate, observations, sensor, bench, steps, priors))
    return replace(estimate, notes=(*notes, *estimate.notes))


def _attitude_gain_note(
    estimate: Estimate,
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Spins,
    priors: Priors,
) -> str:
    """Return a note on how much known attitudes reduce the modelled uncertainties."""
    try:
        norms = norm_problem(observations, sensor, bench, steps, priors)
        alone = least_squares(replace(norms, candidates=None))
        require_observed(alone, sensor, missing=())
    except NotObserved as error:
        return f"Only the known attitudes determine the following: {'; '.join(error.directions)}."
    p = len(sensor.coefficients)
    ratio = np.sqrt(np.diagonal(estimate.covariance)[:p] / np.diagonal(alone.covariance)[:p])
    words = coefficient_words(sensor, sensor.coefficients[int(ratio.argmin())])
    return (
        f"Because the attitudes are known, the uncertainties are {ratio.min():.2g} to "
        f"{ratio.max():.2g} times those from norms only. The {words} improves most."
    )


def _observability_note(estimate: Estimate) -> str:
    """Return the note on rank, condition number and the least determined direction."""
    singular = estimate.singular_values
    assert estimate.weakest is not None
    return (
        f"The dwells determine {estimate.rank} of {len(estimate.wanted)} coefficients; the scaled "
        f"condition number is {singular[0] / singular[-1]:.3g}. The least determined direction is "
        f"{estimate.weakest.words}."
    )


@dataclass(frozen=True)
class ClosedFormulas:
    """An estimator of k0, k1 and k2 by closed formulas.

    The covariance includes only the readings' noise. The bench is treated as exact.

    Parameters
    ----------
    name : str
    invert : callable
        Maps the coefficients of the series to those of the axes.
    weighted : bool
        Whether rows are weighted by the noise of their squared norms.
    takes_root : bool
        Whether k2 is computed as the square root of a fourth-power coefficient.
    """

    name: str
    invert: closed_formulas.SeriesInverse
    weighted: bool = False
    takes_root: bool = False

    def __call__(
        self,
        observations: Observations,
        sensor: Sensor,
        bench: Centrifuge,
        steps: Spins,
        priors: Priors = (),
    ) -> Estimate:
        """Return the estimate; the arguments are as for `ml`.

        Raises
        ------
        InputError
            There are priors, a trial axis, or coefficients other than k0, k1, k2 of three
            accelerometers, or the formulas have no real root because of noise.
        NotObserved
            The dwells do not give the regression full rank.
        """
        solving.require_plain_means(observations, sensor, priors, self.name)
        mean = observations.mean
        singular = closed_formulas.regression_singular_values(sensor, mean, self.name)
        declared = bench.acting_parameters(steps, vectors=False)
        result = specific_force_norm(
            bench, steps, {name: np.array(q.value) for name, q in declared.items()}
        )

        value = closed_formulas.coefficients(
            sensor, mean, result.norm, self.invert, weighted=self.weighted
        )
        rootless = ~np.isfinite(value)
        if rootless.any():
            lost = np.array(sensor.coefficients)[rootless].tolist()
            axes = tuple(sorted({CoefficientName(name).axis for name in lost}))
            raise InputError(
                f"estimator {self.name}: with this noise the fourth-power coefficients of "
                f"{', '.join(axes)} are negative, but k2 needs their square root; use estimator "
                "series or ml",
                names=axes,
            )
        slope = closed_formulas.linearise(
            sensor, mean, result.norm, self.invert, weighted=self.weighted
        )
        noise = observations.full_covariance
        spread = slope.coefficients @ noise @ slope.coefficients.T
        if self.takes_root:
            variance = np.diagonal(slope.by_fourth @ noise @ slope.by_fourth.T)
            if (slope.fourth <= COVERAGE * np.sqrt(variance)).any():
                spread = np.full_like(spread, np.nan)
        notes = (NOISE_ONLY_NOTE, SIGN_NOTE)
        return with_tests(
            Estimate.from_closed_form(sensor.coefficients, value, spread, singular, notes),
            likelihood_problem(observations, sensor, bench, steps),
            exact_bench_norm_problem(observations, sensor, bench, steps),
        )


series = ClosedFormulas("series", closed_formulas.series)
"""Uses the series' first three coefficients, with equal weights for all rows."""
series_weighted = ClosedFormulas("series_weighted", closed_formulas.series, weighted=True)
"""Like `series`, but rows are weighted by the noise of their squared norms."""
paper = ClosedFormulas("paper", closed_formulas.paper, takes_root=True)
"""Follows the source, for comparison: it computes k2 from the fourth powers.

A negative fourth-power coefficient has no square root and raises an error. The covariance is NaN if
a coefficient is within 2u of zero, because the stated noise can then make it negative.
"""


def _remarks(fit: Fit[Centrifuge, Spin]) -> Remarks:
    """Return warnings if the estimate does not agree with the stated bench and noise."""
    if fit.estimate.dof and fit.estimate.consistent:
        return Remarks()
    warnings: tuple[Finding, ...] = ()
    rows, bench, steps, priors = fit.observations, fit.bench, fit.steps, fit.priors
    try:
        explained = find_omitted_coefficients(rows, fit.sensor, bench, steps, priors)
        if explained.words:
            warnings = (
                Finding("warning", "left out", explained.describe(), changes=explained.changes),
            )
        suspects = screen_rows(rows, explained.sensor, bench, steps, priors, explained.agreement)
    except NotObserved:
        return Remarks(warnings)  # the estimator raises the same error with details
    except InputError as error:
        return Remarks((*warnings, Finding("warning", "norm", str(error))))
    return Remarks((*warnings, *(Finding("warning", "norm", one.describe()) for one in suspects)))


def _frame(bench: Centrifuge) -> Frame:
    # Norms do not depend on the mounting.
    return "triangular" if bench.indexing is None else "mount"


METHOD = Method(
    name="centrifuge_norm",
    bench=Centrifuge,
    default_coefficients={"f": ("k0", "k1", "k2")},
    also={"f": ("k3", "koq", "nonorthogonality", "misalignment", "arm", "temperature")},
    needs=("f",),
    plan=plan,
    estimators={"ml": ml, "series": series, "series_weighted": series_weighted, "paper": paper},
    closed_formulas=("series", "series_weighted", "paper"),
    norm_only_estimators=("ml",),
    frame=_frame,
    remarks=_remarks,
    weighs_common_errors=True,
    source="Wang and Li, Navigation Positioning and Timing 8(6), 2021; IEEE Std 836",
)
