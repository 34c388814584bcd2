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

A latitude φ with the wrong sign changes the vertical earth rate by 2 ω sin φ. If the force on the
gyros is gravity, this acts like a g-sensitivity along I that all gyros have in common and that no
residual shows::

    Δg_i = −2 ω sin φ / g

The n sensitivities to acceleration of a sensor are assumed to be normally distributed with an
unknown standard deviation σ, so that their estimates have the covariance C + σ²I. The sign is
doubtful if the largest likelihood over σ is 500 times as large without Δg_i as with it. Fewer than
1 in 1000 healthy sensors, whatever their σ and C, are that similar to Δg_i by chance.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan, sqrt

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName, ErrorName
from inercal.basics.parameters import Parameter
from inercal.basics.units import Measured, format_quantity
from inercal.estimation import Estimate, ScoreTest
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.sensors import G0, Sensor
from inercal.physics.sensors.coefficient_tables import TERMS, ErrorTerm
from inercal.recordings import Finding

CRITICAL_SHIFT, DETECTABLE_NORM = 5.0, 7.0  # shift in u, and limit of η at this shift
_UNSCORED_NORM = 3.0  # a candidate with a smaller η at its largest plausible size is not scored
_ROUNDING = 1e-9  # u
_UNITS = {"rad": "°", "rad/s": "°/h", "m": "mm", "T": "µT", "1": "ppm", "m/s²": "µg"}


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
) -> dict[str, str]:
    """Return bench parameters that are stated as exact although the data cannot show an error.

    The values are the errors that shift a coefficient by 5 u, as text; empty if unknown.

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
    found: dict[str, str] = {}
    for one, moved in zip(exact, shifts, strict=True):
        if _is_undetectable(one, moved):
            sizes = _undetected_sizes(one, moved, sensor)
            known = len(sizes) == 1 and isfinite(sizes[0])
            size = format_quantity(sizes[0], 0.0, _UNITS.get(one.units[0], one.units[0]), 2)
            found.setdefault(ErrorName(one.name).name, size if known else "")
    return found


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
    if not score.dof and score.kind == "coefficient":
        size = [coefficient_definition(sensor, full).largest for full in score.components]
    elif not score.dof:
        size = [nan] * len(size) if score.largest is None else score.largest.tolist()
    if moved <= 0:
        return [nan] * len(size)
    return [CRITICAL_SHIFT * one / moved for one in size]


_LIKELY = 500.0
_TRIALS = 200  # standard deviations σ that are tried
_FEWEST = 2  # gyros that can have a sensitivity in common


def wrong_latitude_sign(
    estimate: Estimate, sensor: Sensor, latitude: Measured | float | None
) -> Iterator[Finding]:
    """Yield a warning if the g-sensitivities imply that the latitude, rad, has the wrong sign."""
    names = [CoefficientName(name).term for name in sensor.coefficients]
    at = [k for k, name in enumerate(names) if name in ("g_i", "g_p", "g_o")]
    along = np.array([names[k] == "g_i" for k in at])
    if latitude is None or along.sum() < max(_FEWEST, sensor.rank("w")):
        return
    place = latitude.value if isinstance(latitude, Measured) else latitude
    shift = -2 * earth_rate_up_north(place)[0] / G0
    variance, directions = np.linalg.eigh(estimate.covariance[np.ix_(at, at)])
    stated, other = ((estimate.value[at] - part) @ directions for part in (0, shift * along))
    own = max(abs(shift), float(np.max(np.abs(stated)))) * np.geomspace(1e-4, 10, _TRIALS)
    total = np.maximum(variance, 0) + own[:, np.newaxis] ** 2
    likely = [np.max(-0.5 * np.sum(x**2 / total + np.log(total), axis=1)) for x in (stated, other)]
    if likely[1] - likely[0] > np.log(_LIKELY):
        size = f"{shift / sensor.coefficient(sensor.coefficients[at[0]]).si:.3g} °/h/g"
        text = f"the sign of the latitude seems wrong, because all g_i are near {size}"
        yield Finding("warning", "latitude", f"{text}; check the sign of [bench] latitude")
