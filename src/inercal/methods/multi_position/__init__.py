"""Calibrate by hand in many positions, with gravity as the only reference.

At each rest the specific force has the norm g, in any attitude. The norms therefore determine the
accelerometers' bias, scale factor and non-orthogonality. Between two rests the gyros propagate the
direction of gravity, which must agree with the accelerometers at the second rest. The rotations
determine the gyros' scale factor and misalignment relative to the accelerometers' frame. The rates
at rest determine the gyros' bias and sensitivity to acceleration. The frame is that of the
accelerometers: x along the first input axis, y in the plane of the first two.

Each kind of row has its own χ² test. If χ² exceeds its 95 % bound, enough scatter is added to the
noise to explain the excess. If χ² is below its 1 % bound, the samples contain hand tremor, and only
a share of their scatter counts as noise (`inercal.estimation.residual_scatter`). If a table of
means states its noise, this noise is never reduced. The tests of terms that the model omits use the
noise before anything is added (`inercal.methods.multi_position.rest_candidates`).

The gyros' delay relative to the accelerometers is estimated from the motion between rests.
Gravity's direction u, propagated by the rate, obeys u̇ = u × ω. If the gyros lag by τ, so does u,
and the specific force is ahead of g u by τ g u × ω. Each transition gives a value of τ. The hand's
acceleration disturbs each value independently, so the scatter of the values gives the uncertainty.
The gyros' samples are then moved by the mean of τ, and τ is estimated again until it is near zero.

The advice names attitudes that would improve a result.

Sources: Skog and Händel, "Calibration of a MEMS inertial measurement unit", XVII IMEKO World
Congress, 2006 (norms); Tedaldi, Pretto, Menegatti, ICRA 2014, 3042–3049 (rotations between rests).
"""

# pyright: reportMissingTypeStubs=false
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.run_file_advice import Change
from inercal.basics.units import Measured, format_value_and_uncertainty
from inercal.benches import Hand
from inercal.calibration.delays import delay_condition, delay_words
from inercal.calibration.next_steps import OPPOSITE_SIGN
from inercal.estimation import Estimate
from inercal.estimation.lazy_value import LazyValue
from inercal.estimation.uncertainty import COVERAGE
from inercal.methods import Fit, Method, Priors, Remarks, temperature, triangular_frame
from inercal.methods.multi_position import attitude_coverage, stages
from inercal.methods.multi_position.attitude_coverage import GeometryErrors
from inercal.methods.multi_position.rest_observations import Rests
from inercal.methods.multi_position.rotations import inverse_model
from inercal.methods.observability import require_observed
from inercal.methods.residuals import norm_residuals
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.plan import HandSteps
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_selection import coefficient_words
from inercal.recordings import Finding, Observations

_MIN_IMPROVEMENT = 1.5  # factor; a smaller improvement is not worth the user's effort
_ADVISED_ATTITUDES = 3  # number of attitudes advised if a result is weak
_SHARED = ("g", "timebase")  # parameters of the bench whose errors all coefficients share
_TEST_LEVEL = 1e-3  # probability of a false finding if the gyros are not sensitive to g
_REVERSAL_SD = 0.05  # relative; a reversed sign disturbs the other estimates by about this much
_MIN_PASSAGES = 5  # transitions; with fewer, the scatter is too uncertain
_LARGE_DELAY, _LARGE_DELAY_STEPS = 0.01, 2  # s and sampling intervals; filters delay by less
_SIGNIFICANT_DELAY = 5  # u
_DELAY_ROUNDS, _DELAY_TOLERANCE = 30, 0.1  # of the linear fit; tolerance in u
_REVERSED = (
    "the gyros show the earth's rate with the opposite sign; check the signs of the accelerometer "
    "columns, of the gyro columns and of the latitude"
)
_SIGN_NOTE = (
    "Norms at rest cannot detect a reversed axis or two exchanged axes. Compare the sign of each "
    "axis with its attitude in one rest."
)


def joint(
    observations: Observations, sensor: Sensor, bench: Hand, steps: HandSteps, priors: Priors = ()
) -> Estimate:
    """Return all coefficients by maximum likelihood from norms, rates and rotations together.

    Parameters
    ----------
    observations : Observations
        The rows are rests, with the transitions between them if there are gyros.
    sensor : Sensor
        The sensor with the coefficients to estimate.
    bench : Hand
        Gravity and the earth's rate.
    steps : sequence of HandStep
        Unused, because attitudes are estimated from the readings.
    priors : sequence of Gaussian
        Priors on coefficients, from other measurements.

    Raises
    ------
    InputError
        The observations have a trial axis.
    NotObserved
        These rests and transitions do not determine all coefficients. The message says what to
        add.
    """
    rests = _checked_rests(observations, sensor, bench, priors)
    last = stages.fit_accelerometers(rests, priors)
    if rests.transitions is not None:
        last = stages.fit_jointly(rests, stages.fit_gyros(rests, last, priors), priors)
    return _final_estimate(rests, last, priors)


def sequential(
    observations: Observations, sensor: Sensor, bench: Hand, steps: HandSteps, priors: Priors = ()
) -> Estimate:
    """Estimate the accelerometers from norms only, then the gyros with the accelerometers fixed.

    The gyros' covariance includes that of the accelerometers. The parameters and errors are as for
    `joint`.
    """
    rests = _checked_rests(observations, sensor, bench, priors)
    last = stages.fit_accelerometers(rests, priors)
    if rests.transitions is not None:
        last = stages.fit_gyros(rests, last, priors)
    return _final_estimate(rests, last, priors)


def _checked_rests(
    observations: Observations, sensor: Sensor, bench: Hand, priors: Priors
) -> Rests:
    if observations.mean.ndim != 2:
        raise InputError(
            "multi_position needs one recording, not several trials at once; pass one trial"
        )
    if len(sensor.axes) > len(sensor.select_axes("f").axes) and observations.transitions is None:
        raise InputError(
            "the sensor has gyros, but the observations have no transitions between rests; "
            "calibrate only the accelerometers, or give a recording",
            key="transitions",
        )
    rests = Rests(observations, sensor, bench)
    attitude_coverage.require_coverage(rests, priors)
    return rests


def _final_estimate(rests: Rests, last: stages.FitStage, priors: Priors) -> Estimate:
    estimate = last.estimate
    require_observed(estimate, rests.sensor, missing=())
    notes: tuple[str, ...] = ()
    if not rests.temperature_offsets.ndim:  # otherwise another temperature may also help
        notes = advice(rests, estimate)
    if rests.transitions is None:
        notes += (_SIGN_NOTE,)
    return replace(
        stages.with_shared_drift(rests, estimate),
        notes=notes,
        tests=rests.observations.tests,
        scoring=LazyValue(lambda: stages.score_tests(rests, last, priors)),
    )


def _remarks(fit: Fit[Hand, Any]) -> Remarks:
    """Return the gyros' delay if the run file requests it, or a warning if it is large."""
    if not np.all(fit.estimate.converged):
        return Remarks()
    findings = g_sensitivity_findings(Rests(fit.observations, fit.sensor, fit.bench), fit.estimate)
    notes = tuple(one.message for one in findings)
    way = fit.observations.transitions
    try:
        late = gyro_delay(fit.observations, fit.sensor, fit.estimate, fit.bench.gravity.value)
    except NotObserved:
        if fit.time_offset:
            raise
        return Remarks(findings, notes)
    if fit.time_offset:
        words = delay_words("w", late)
        note = f"{words[:1].upper()}{words[1:]}."
        return Remarks(findings, (*notes, note), delay_condition("w", late))
    assert way is not None
    least = max(_LARGE_DELAY, _LARGE_DELAY_STEPS * float(np.median(np.diff(way.time))))
    if abs(late.value) > max(least, _SIGNIFICANT_DELAY * late.sd):
        words = delay_words("w", Measured(late.value, 0.0))
        text = f"{words}; state [method] time_offset = true"
        findings += (Finding("warning", "delay", text),)
    return Remarks(findings, notes)


def gyro_delay(
    observations: Observations, sensor: Sensor, estimate: Estimate, gravity: float
) -> Measured:
    """Return the delay of the gyros' samples relative to the accelerometers', s.

    The result is the mean over the transitions, weighted by the angle of each. The uncertainty
    comes from the scatter (Cochran 1977, Sampling Techniques, 2.30, for a ratio).

    Parameters
    ----------
    observations : Observations
        Rests with the transitions between them.
    sensor : Sensor
    estimate : Estimate
        Estimate of the sensor's coefficients.
    gravity : float
        Local gravity, m/s².

    Raises
    ------
    NotObserved
        There are too few transitions, or there was no useful rotation.
    """
    way = observations.transitions
    if way is None or len(way.rest) < _MIN_PASSAGES:
        count = 0 if way is None else len(way.rest)
        raise NotObserved(
            f"[method] time_offset needs gyros and {_MIN_PASSAGES} turns between rests, but "
            f"the recording has {count}; record more turns, or remove time_offset",
            key="[method] time_offset",
        )
    from inercal.methods.multi_position._kernels import delay_sums  # loads Numba

    force, c = sensor.select_axes("f"), estimate.value[: len(sensor.coefficients)]
    p, m = len(force.coefficients), len(force.axes)
    warmth = temperature.row_offsets(observations, sensor)
    up = norm_residuals(force, observations.mean[:, :m], c[:p], np.array([gravity]), dT=warmth).up
    model = inverse_model(sensor, c, float(np.mean(warmth)))
    # Only the samples of the turns, because a copy of a long recording may not fit in memory.
    last = np.cumsum(way.reached - way.left + 1) - 1
    first = last - (way.reached - way.left)
    during: Indices = np.arange(int(last[-1]) + 1) + np.repeat(way.left - first, last - first + 1)
    time, output = way.time[during], way.output[during]
    value, ends, n = 0.0, (first, first, last, last), len(way.rest)
    for _ in range(_DELAY_ROUNDS):
        along, square = delay_sums(
            time, output, ends, model.matrix, model.offset, up[way.rest], gravity
        )
        if not square.sum() > 0:
            raise NotObserved(
                "[method] time_offset needs turns about horizontal axes, but every turn is about "
                "the vertical; record other turns, or remove time_offset",
                key="[method] time_offset",
            )
        change = along.sum() / square.sum()
        left = along - change * square
        sd = np.sqrt(n / (n - 1) * np.sum(left**2)) / square.sum()
        value += change
        if abs(change) <= _DELAY_TOLERANCE * sd:
            return Measured(float(value), float(sd))
        for k in range(m, output.shape[1]):
            output[:, k] = np.interp(time + value, way.time, way.output[:, k])
    raise NotObserved(
        "[method] time_offset: no delay of the gyros makes them agree with gravity during the "
        "turns; check the two clocks, or remove time_offset",
        key="[method] time_offset",
    )


def advice(rests: Rests, estimate: Estimate) -> tuple[str, ...]:
    """Return attitudes that would clearly reduce the uncertainty, and the uncertainty with them.

    The uncertainty is computed from the information matrix, with the estimated noise and scatter.
    """
    sensor, p = rests.sensor, len(rests.sensor.coefficients)
    unit_scale = sensor.unit_scale
    # More attitudes do not reduce the contributions from gravity and from the recording's clock.
    shared = np.stack([_shifts(estimate, name)[:p] / unit_scale for name in _SHARED])
    covariance = estimate.covariance[:p, :p] / np.outer(unit_scale, unit_scale)
    covariance -= shared.T @ shared
    sizes = {group.name: float(np.sqrt(np.mean(group.sd**2))) for group in estimate.groups}
    errors = GeometryErrors(*(sizes.get(name, 1.0) for name in ("norms", "rates", "rotations")))
    ups = rests.norms(np.concatenate([estimate.value[:p], rests.start()[p:]])).up
    before = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    more, after = attitude_coverage.next_attitudes(
        sensor, before, ups[-1], rests.bench.gravity.value, errors, max_attitudes=_ADVISED_ATTITUDES
    )
    stays = (shared**2).sum(axis=0)
    old = np.sqrt(np.diag(covariance) + stays) * unit_scale
    new = np.sqrt(np.diag(np.linalg.inv(after)) + stays) * unit_scale
    k = int(np.argmax(old / new))
    if old[k] < _MIN_IMPROVEMENT * new[k]:
        return ()
    name = sensor.coefficients[k]
    line = sensor.coefficient(name)
    sizes_told = [
        format_value_and_uncertainty(0.0, COVERAGE * float(sd[k]) / line.si)[1] for sd in (old, new)
    ]
    return (
        f"The uncertainty of the {coefficient_words(sensor, name)} is large. These attitudes would "
        f"reduce its U from {sizes_told[0]} to {sizes_told[1]} {line.unit}: "
        f"{attitude_coverage.attitudes_in_words(more)}.",
    )


def _shifts(estimate: Estimate, name: str) -> Array:
    """Return each value's shift if a bench parameter changes by one standard deviation."""
    if name not in estimate.names:
        return np.zeros(len(estimate.names))
    column = estimate.covariance[:, estimate.names.index(name)]
    variance = column[estimate.names.index(name)]
    return column / np.sqrt(variance) if variance > 0 else np.zeros(len(column))


def g_sensitivity_findings(rests: Rests, estimate: Estimate) -> tuple[Finding, ...]:
    """Return a finding if the rates at rest depend on gravity but the gyro model has no g term.

    The decision is made by an F test of the rates' residuals against the attitude, at the 0.1 %
    level. If the vertical part of the earth's rate with the opposite sign explains the dependence,
    or explains the estimated g terms, the finding refuses the result.
    """
    group = next((group for group in estimate.groups if group.name == "rates"), None)
    names = rests.sensor.coefficients
    place, reverse = rests.bench.place, (Finding("refused", OPPOSITE_SIGN, _REVERSED),)
    twice = 0.0 if place is None else 2 * earth_rate_up_north(place.value)[0]
    if group is None:
        return ()
    if own := [k for k, name in enumerate(names) if name.endswith((".g_i", ".g_p", ".g_o"))]:
        like = [-twice / rests.bench.gravity.value * names[k].endswith(".g_i") for k in own]
        offs = estimate.value[own], estimate.value[own] - like
        spread = np.eye(len(own)) * (_REVERSAL_SD * twice / rests.bench.gravity.value) ** 2
        inverse = np.linalg.inv(estimate.covariance[np.ix_(own, own)] + spread)
        none, opposite = (scipy.special.chdtrc(len(own), one @ inverse @ one) for one in offs)
        return reverse if none < _TEST_LEVEL < opposite else ()
    p = len(names)
    up = rests.norms(np.concatenate([estimate.value[:p], rests.start()[p:]])).up
    weight = 1 / group.sd.mean(axis=1)[:, None]
    attitude = weight * np.column_stack([np.ones(len(up)), up])
    freedom = 3 * (len(up) - 4)
    if freedom < 1:
        return ()
    alone, with_it, opposite = (
        _residual_sum_of_squares(design, weight * residual)
        for design, residual in (
            (weight, group.residual),
            (attitude, group.residual),
            (weight, group.residual + twice * up),
        )
    )
    level = 9 / freedom * scipy.special.fdtri(9, freedom, 1 - _TEST_LEVEL) * with_it
    if alone - with_it < level:
        return ()
    beyond = level + 9 * _REVERSAL_SD**2 * (alone - with_it)
    if opposite - with_it < beyond < alone - opposite:
        return reverse
    explained = 100 * (1 - with_it / alone)
    text = (
        "The rates at rest depend on the direction of gravity, which explains "
        f"{explained:.0f} % of their scatter, so the gyros are sensitive to acceleration"
    )
    return (Finding("note", "g", text, changes=(Change("method", "also", ("g",)),)),)


def _residual_sum_of_squares(design: Array, y: Array) -> float:
    """Return the residual sum of squares of a linear regression."""
    return float(np.sum((y - design @ np.linalg.lstsq(design, y, rcond=None)[0]) ** 2))


def _add_magnetometers(fit: Fit[Hand, Any], field: Sensor) -> tuple[Estimate, Remarks]:
    # These modules load scipy.optimize.
    from inercal.methods.magnetic_field.stage import add_magnetometers
    from inercal.methods.multi_position.rest_links import rest_links

    return add_magnetometers(fit, field, rest_links)


METHOD = Method(
    name="multi_position",
    bench=Hand,
    default_coefficients={
        "f": ("bias", "scale", "nonorthogonality"),
        "w": ("bias", "scale", "misalignment"),
        "m": ("bias", "scale", "misalignment"),
    },
    also={
        "f": ("k2", "k3", "temperature", "k0_dT3", "k1_dT2"),
        "w": ("g", "temperature", "temperature_order"),
        "m": ("temperature",),
    },
    needs=("f",),
    plan=attitude_coverage.hand_held_plan,
    estimators={"joint": joint, "sequential": sequential},
    source="Skog and Händel, IMEKO 2006; Tedaldi, Pretto, Menegatti, ICRA 2014",
    unknown_attitudes=True,
    frame=triangular_frame,  # the accelerometers' own frame, because there is no mounting
    remarks=_remarks,
    add_magnetometers=_add_magnetometers,
    triads_because="the attitudes are unknown, and only the norm of gravity is known",
)
