"""Compare the noise that a run file states with the noise in the data.

For a recording, the noise density of the means is compared with [sensor] white. In addition to
white noise N, a mean over T contains the effects of bias instability B, random walk K and the
quantisation step q. The variance of these effects is at most B² + K² T/3 + q²/12, and the
comparison takes it into account. The density is estimated from n shorter means in each section, so
for B and q at most 4/n of T counts. If the sensor moves or is held by hand, its readings scatter by
more than its noise. In these cases, only a stated white noise that is too large can be detected.

For a table of means, the noise is only known from the run file, and the residuals show whether it
is correct (`inercal.estimation.residual_scatter`). The residuals also show if noise and bench
errors together were stated too large. This is only a remark, because a bench may be better than its
user can prove.

Noise that was stated too large is reported if the factor is at least 1.3 and chance does not
explain this. The report is a warning if the uncertainties depend on the stated noise. This is the
case for a table of means. It is also the case for a method that weights its readings by the stated
noise, if the residuals are too small. If the uncertainties depend on the noise in the recording,
the report is only a remark for a factor below 2. With a larger factor, the unit or the scale is
doubtful.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.basics.keys import ObservationName
from inercal.basics.units import format_number, format_value_and_uncertainty, si_factor
from inercal.calibration.grade import SHARED_TILTS
from inercal.estimation import Estimate
from inercal.estimation.residual_scatter import LEAST_RATIO, LEVEL, noise_scale
from inercal.estimation.scores import chi2_tail_probability
from inercal.physics.plan import Rotation, Spin, Step, Turn
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Observations, Severity

_LARGE_RATIO = 2.0  # ratio of noise above which unit or scale is doubtful
_CORRELATED = 4.0  # slow noise, which is correlated, may double the estimate from shorter means
_SEEN = 0.5  # of a rounding step; rounding hides smaller noise


class _Comparison(NamedTuple):
    """Ratio of stated to observed standard deviation, for one axis or for a kind of axes."""

    ratio: float
    axis: int  # index in the sensor
    p_value: float  # probability that the observed noise would be this small by chance


def stated_noise_findings(
    estimate: Estimate,
    observations: Observations,
    sensor: Sensor,
    steps: Sequence[Step],
    *,
    recorded: bool,
    by_hand: bool,
    own_tilts: bool = False,
) -> tuple[Finding, ...]:
    """Return findings about noise that differs from the stated noise, with the factors.

    Parameters
    ----------
    estimate : Estimate
        It must not have a trial axis.
    observations : Observations
        It must not have a trial axis.
    sensor : Sensor
    steps : sequence of r Step
        Step of each row.
    recorded : bool
        Whether the rows are means from a recording. If not, the deviations are stated.
    by_hand : bool
        Whether the sensor is held by hand.
    own_tilts : bool
        Whether each visit to a face has its own tilt, so that equal tilts give small residuals.
    """
    whole = [(1 / group.scatter_ratio, group.chi2, group.dof)
             for group in estimate.groups if group.dof and group.chi2 > 0]  # fmt: skip
    if not estimate.groups and estimate.dof and estimate.chi2 > 0:
        chi2 = float(estimate.chi2)
        whole = [((estimate.dof / chi2) ** 0.5, chi2, estimate.dof)]
    chances = [(ratio, 1 - chi2_tail_probability(chi2, dof)) for ratio, chi2, dof in whole]
    small = max((ratio for ratio, p in chances if len(whole) * p < LEVEL), default=1.0)
    if recorded:
        severe = small >= LEAST_RATIO
        found = tuple(_recorded_noise(observations, sensor, steps, by_hand, severe))
    elif estimate.groups:
        found = (_means_finding("means", small),) if small >= LEAST_RATIO else ()
    else:
        found = tuple(_noise_of_means(estimate, sensor))
    if not found and small >= LEAST_RATIO and not (estimate.groups and recorded):
        text = (
            f"the residuals are {small:.2g} times smaller than the stated noise and bench imply: "
        )
        if own_tilts:
            text += "if a face has the same tilt at each visit, state placement in [bench]"
            return (Finding("note", SHARED_TILTS, text, factor=small),)
        text += "U is too large"
        return (Finding("note", "residuals", text, factor=small),)
    return found


def _recorded_noise(
    observations: Observations, sensor: Sensor, steps: Sequence[Step], by_hand: bool, severe: bool
) -> Iterator[Finding]:
    """Yield a finding for each kind of axes whose noise differs from the stated noise."""
    variance = np.diagonal(observations.covariance, axis1=-2, axis2=-1)
    rounding, hidden = observations.rounding, np.zeros(len(sensor.axes), dtype=np.bool_)
    if rounding is not None:
        variance = np.maximum(variance - rounding.variances, 0.0)
        hidden = (rounding.steps.step > 0) & (rounding.steps.noise < _SEEN)
    resting = np.array([not by_hand and _is_at_rest(step) for step in steps])
    duration = observations.duration[:, None]
    # The noise was estimated from the scatter of this many shorter means in each section.
    batches = observations.dof / max(int(resting.sum()), 1) + 1
    shorter = min(_CORRELATED / batches, 1.0)
    for kind, quantity in QUANTITIES.items():
        own = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind and not hidden[k]]
        noises = [sensor.axes[k].noise for k in own]
        if not any(noise.white for noise in noises):
            continue
        stated = np.array([noise.white**2 for noise in noises])
        slow = np.array([n.bias_instability**2 + n.quantisation**2 / 12 for n in noises])
        walk = np.array([n.random_walk**2 for n in noises])
        most = stated + slow * duration * shorter + walk * duration**2 / 3
        density = variance[:, own] * duration
        low = np.median(density / stated, axis=0)
        high = np.median((density / most)[resting], axis=0) if resting.any() else np.ones(len(own))
        too_small = int(np.argmax(high))
        # If the sensor is held by hand, all accelerometers share one number.
        each = observations.dof / (len(own) if by_hand and kind == "f" else 1)
        compared = _most_significant(low, each)
        unit, section = quantity.noise_unit, quantity.sensor
        size = si_factor(unit, f"({quantity.unit})/√Hz")
        if high[too_small] > _LARGE_RATIO**2:
            k, ratio, severity = too_small, float(low[too_small]) ** -0.5, "warning"
        elif compared is not None:
            k, ratio = compared.axis, compared.ratio
            severity: Severity = "warning" if severe or ratio > _LARGE_RATIO else "note"
        else:
            continue
        name = sensor.axes[own[k]].name
        mean = float(np.sqrt(np.median(density[:, k])))
        recorded, white = (
            format_value_and_uncertainty(0.0, x / size)[1] for x in (mean, noises[k].white)
        )
        text = (
            f"{name}: [sensor.{section}] white is {_times(ratio)}: it is {white} {unit}, but the "
            f"noise of the recording is {recorded} {unit}; "
        )
        if severity == "warning" and ratio > 1 and severe:
            text += "U is too large, because it is computed from the stated noise; "
        text += f"check white, unit and scale of [sensor.{section}]"
        yield Finding(severity, "noise", text, name, factor=ratio)


def _most_significant(low: Array, dof: float) -> _Comparison | None:
    """Return the comparison, of one axis or of all, in which the noise is significantly small.

    Parameters
    ----------
    low : (m,) array
        Ratio of observed to stated variance of each axis.
    dof : float
        Degrees of freedom of each axis.
    """
    m, worst = len(low), int(np.argmin(low))
    mean = float(np.mean(low))
    compared = [
        _Comparison(float(low[worst]) ** -0.5, worst, m * _smaller(float(low[worst]), dof)),
        _Comparison(mean**-0.5, worst, _smaller(mean, m * dof)),
    ]
    kept = [
        one for one in compared if len(compared) * one.p_value < LEVEL and one.ratio >= LEAST_RATIO
    ]
    return min(kept, key=lambda one: one.p_value, default=None)


def _smaller(ratio: float, dof: float) -> float:
    """Return the probability of a ratio of observed to stated variance that is this small."""
    if np.isinf(dof):
        return 0.0 if ratio < 1 else 1.0
    return float(scipy.special.chdtr(dof, dof * ratio))


def _noise_of_means(estimate: Estimate, sensor: Sensor) -> Iterator[Finding]:
    """Yield a finding for each kind of axes if the stated deviation of means is too large."""
    rows = estimate.rows()
    if rows is None or len(estimate.observations) != len(rows.residual):
        return
    kinds = np.array(
        [sensor.measures.get(ObservationName(one).channel, "f") for one in estimate.observations]
    )
    for kind, quantity in QUANTITIES.items():
        if not np.any(kinds == kind):
            continue
        found = noise_scale(rows, kinds == kind, LEVEL)
        if found is not None and found.ratio >= LEAST_RATIO:
            yield _means_finding(quantity.sensor, found.ratio)


def _means_finding(section: str, ratio: float) -> Finding:
    text = (
        f"the means scatter less than stated: [data.sd] of {section} is {_times(ratio)}; U is too "
        f"large, because it is computed from this value; check values and units in [data.sd]"
    )
    return Finding("warning", "noise", text, factor=ratio)


def _times(ratio: float) -> str:
    """Say by what factor a stated noise is too large or too small."""
    word = "large" if ratio > 1 else "small"
    return f"{format_number(max(ratio, 1 / ratio), 2)} times too {word}"


def _is_at_rest(step: Step) -> bool:
    """Return whether a step is at rest."""
    if isinstance(step, Spin):
        return step.rate == 0
    return not isinstance(step, Turn | Rotation)
