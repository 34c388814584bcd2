"""Find undetectable causes: they shift a coefficient by 5 u before any test notices them.

A candidate of the score tests with size δ shifts the estimate by J⁺c δ, and a residual with the
norm η = |c' δ| remains (`inercal.estimation.scores`). If the candidate shifts a coefficient with
standard uncertainty u by 5 u, the norm of the residual is::

    η = 5 / R        R = max |J⁺c| / (u |c'|)

At η = 6, a test nearly always detects the cause. Causes with η below 7 are listed, because 7 also
includes marginal causes. If such a cause is present, the result can be wrong by 5 u although its
verdict is "consistent". A coefficient is not listed if the size that causes a shift of 5 u exceeds
10 % of the coefficient's natural size, because such a size is implausible.

If a candidate has one component, R does not depend on the data. If a candidate has several
components, R is computed in the direction of their estimate. The largest R over all directions may
be larger.

Source: Baarda 1968, A testing procedure for use in geodetic networks, Netherlands Geodetic
Commission (external reliability).

If a plan leaves few or no degrees of freedom, a wrong reading shows in no residual, but the terms
beyond bias, scale factor and misalignment become large. In healthy MEMS sensors, these terms change
the reading by at most 0.2 % of 1 g or 1 rad/s, at 1 g or 1 rad/s. The limit is ten times as large.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import nan, sqrt

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName, ErrorName
from inercal.basics.parameters import Parameter
from inercal.basics.units import format_value_and_uncertainty
from inercal.estimation import Estimate, ScoreTest
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_tables import TERMS, ErrorTerm
from inercal.recordings import Finding

CRITICAL_SHIFT, DETECTABLE_NORM = 5.0, 7.0  # shift in u, and limit of η at this shift
_UNSCORED_NORM = 3.0  # a candidate with a smaller η at its largest plausible size is not scored
_ROUNDING = 1e-9  # u


@dataclass(frozen=True)
class UndetectableCause:
    """A cause that no test can detect in these data.

    Parameters
    ----------
    name : str
        Name of a kind of coefficient, such as "k2", or of a drift. "row" means the readings of
        single rows.
    component : str
        Full name of the component for which the smallest size shifts a coefficient; empty for rows.
    size : float
        The size that shifts a coefficient by 5 u, SI; NaN if unknown.
    """

    name: str
    component: str
    size: float


def coefficient_definition(sensor: Sensor, full: str) -> ErrorTerm:
    """Return the table entry of a coefficient by full name, even if it is not estimated."""
    axis, short = CoefficientName(full).parts
    return TERMS[sensor.measures[axis]][short]


def undetectable_causes(estimate: Estimate, sensor: Sensor) -> tuple[UndetectableCause, ...]:
    """Return the causes that were not estimated and that no test could detect in these data.

    Parameters
    ----------
    estimate : Estimate
        An estimate without a trial axis; the coefficients of the sensor come first.
    sensor : Sensor
    """
    scores = estimate.score_tests.scores
    shifts = _largest_shifts(scores, estimate.std[: len(sensor.coefficients)])
    groups: dict[tuple[str, str], str] = {}
    for one in scores:
        for component in one.components if len(one.components) > 1 else ():
            groups.setdefault((one.kind, component), one.name)
    found: dict[str, UndetectableCause] = {}
    for one, moved in zip(scores, shifts, strict=True):
        if one.kind not in ("coefficient", "time") or not _is_undetectable(one, moved):
            continue
        sizes = _undetected_sizes(one, moved, sensor)
        if one.kind == "coefficient" and any(
            size > coefficient_definition(sensor, full).largest
            for size, full in zip(sizes, one.components, strict=True)
        ):
            continue
        if len(one.components) == 1:
            name = groups.get((one.kind, one.components[0]), one.name)
            if name not in found or not sizes[0] >= found[name].size:
                found[name] = UndetectableCause(name, one.components[0], sizes[0])
        elif one.kind == "coefficient" and one.dof:
            found.setdefault(one.name, UndetectableCause(one.name, one.components[0], nan))
    rows = [pair for pair in zip(scores, shifts, strict=True) if pair[0].kind == "row"]
    if 2 * sum(_is_undetectable(*pair) for pair in rows) > len(rows):
        found["row"] = UndetectableCause("row", "", nan)
    return tuple(found.values())


def undetectable_exact_parameters(
    estimate: Estimate, sensor: Sensor, expected: Mapping[str, Parameter]
) -> tuple[str, ...]:
    """Return bench parameters that are stated as exact although the data cannot show an error.

    Parameters
    ----------
    estimate, sensor
        See `undetectable_causes`.
    expected : mapping of str to Parameter
        Stated parameters of the bench, by full name. A parameter that is not among them is exact
        if the run file does not state it.
    """
    exact = [
        one
        for one in estimate.score_tests.scores
        if one.kind == "bench"
        and one.stated_sds is not None
        and not one.stated_sds.any()
        and all(
            name not in expected or expected[name].scope != "position" for name in one.components
        )
    ]
    shifts = _largest_shifts(exact, estimate.std[: len(sensor.coefficients)])
    pairs = zip(exact, shifts, strict=True)
    return tuple(
        dict.fromkeys(
            ErrorName(one.name).name for one, moved in pairs if _is_undetectable(one, moved)
        )
    )


def _is_undetectable(score: ScoreTest, moved: float) -> bool:
    """Return whether a cause, which shifts a coefficient by `moved` u, reaches 5 u undetected."""
    eta = sqrt(score.chi2)
    if not score.dof:
        if score.kind in ("row", "time"):  # no plausible size is known, so any shift counts
            return moved > _ROUNDING
        eta = _UNSCORED_NORM
    return DETECTABLE_NORM * moved > CRITICAL_SHIFT * eta


def _largest_shifts(scores: Sequence[ScoreTest], u: Array) -> list[float]:
    """Return the largest shift of a coefficient, in u, due to each cause of the estimated size."""
    shifts = [np.zeros(len(u)), *(one.shift[: len(u)] for one in scores)]
    relative = np.abs(shifts) / np.where(u > 0, u, np.inf)
    return np.max(relative, axis=1, initial=0.0).tolist()[1:]


def _undetected_sizes(score: ScoreTest, moved: float, sensor: Sensor) -> list[float]:
    """Return the sizes, SI, at which the components shift a coefficient by 5 u; NaN if unknown."""
    size: list[float] = np.abs(score.size).tolist()
    if moved <= 0 or not (score.dof or score.kind == "coefficient"):
        return [nan] * len(size)
    if not score.dof:
        size = [coefficient_definition(sensor, full).largest for full in score.components]
    return [CRITICAL_SHIFT * one / moved for one in size]


_GROUPS = ("nonlinearity", "asymmetry", "cross", "g", "g2")
_LARGEST = 0.02  # of the natural size
_SIGMAS = 6.0  # standard deviations by which a coefficient must exceed the limit


def implausible_sizes(estimate: Estimate, sensor: Sensor) -> Iterator[Finding]:
    """Yield a warning for each implausibly large coefficient of an estimate without trial axis."""
    sds = np.sqrt(np.diag(estimate.covariance)).tolist()
    for name, value, sd in zip(sensor.coefficients, estimate.value.tolist(), sds, strict=False):
        line = sensor.coefficient(name)
        if line.group in _GROUPS and abs(value) > _LARGEST * line.unit_scale + _SIGMAS * sd:
            size = f"{format_value_and_uncertainty(value / line.si, sd / line.si)[0]} {line.unit}"
            yield Finding(
                "warning",
                "size",
                f"{name} is {size}, implausibly large; look for a wrong reading",
            )
