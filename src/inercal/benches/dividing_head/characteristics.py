"""Find hysteresis, threshold, warm-up drift and the like of accelerometers on a dividing head.

The input of an accelerometer is g sin ψ, where ψ is the angle of its input axis from the
horizontal. The forward pass and the reverse pass reach a position from different sides, so their
readings show the hysteresis in a loop of ±1 g. A series of small tilts applies small inputs: about
0° it shows the threshold and the dead zone, and about an inclined position, such as 30°, the
resolution (IEEE Std 1293 and 836).

The input is zero where the input axis is horizontal. That is not at 0° of the head, but at −α,
where α is the mounting angle plus the zero of the head. α is found from the other positions by
least squares, with the terms of the tumble test. The uncertainty of the difference between the
angle of the small tilts and this zero is a nuisance of the threshold.

The covariance of the readings contains the noise, the drift of the biases in each pass, and the
stated errors of the head's angles. The backlash of the head acts almost like a hysteresis of ±1 g
and must be stated. A series of small tilts has one error of the head's graduation; `pier` is the
error of each small tilt.

The readings at the beginning of a run, before the head first turns, show the warm-up drift and the
short-term stability from repeated readings of the same input. They do not enter the fit of the
coefficients.

The readings follow an exponential from the time of the first reading, 0, to that of the last, T::

    y = c + D h(t) + s ε + noise          h(t) = (1 − exp(−t/τ)) / (1 − exp(−T/τ))

D is the warm-up drift, the change from the first to the last reading. s is the short-term
stability, the standard deviation of the readings without their noise, whose variance is known. The
warm-up time is the time after which the exponential stays within a band about its last value.

The likelihood is taken as a distribution with equal weights for c, D and 1/τ. The variance v =
s² + noise² has the weight v^(−3/2), for which the mean of s has almost no bias. A drift is detected
if it reduces −2 ln L by 16 or more, which happens by chance in less than one case in a hundred. A
scatter s is detected if χ² of the exponential is improbably large.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import cos, sin, sqrt
from statistics import NormalDist

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.benches.characteristics import Characteristic, error_covariance, table_characteristics
from inercal.benches.dividing_head.bench import DividingHead, sensed_motion
from inercal.benches.dividing_head.passes import (
    drift_ramps,
    first_visit_rows,
    rows_without_series,
    warm_up_rows,
)
from inercal.estimation.input_output_tests import (
    CHANCE,
    DETECTED,
    Figure,
    InputOutput,
    probability_above,
)
from inercal.estimation.response_band import distribution
from inercal.physics.plan import Index
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations
from inercal.recordings.temperature import temperature_varies

_GAIN = 16.0  # least reduction of −2 ln L for a drift
_GRID, _ROUNDS, _NEAR = 40, 4, 25.0
_SLOWEST, _DETERMINED = 20.0, 2.0  # times T: almost a straight line; the largest time constant
_FITTED = 3  # constant, drift and time constant
_NORMAL = np.array([NormalDist().inv_cdf((k + 0.5) / 40) for k in range(40)])


def warm_up(
    time: Array, read: Array, variance: Array, band: float | None = None
) -> dict[str, Figure]:
    """Return the drift and the stability of repeated readings by name, and the times of a drift.

    The time constant is only returned if it is determined.

    Parameters
    ----------
    time, read, variance : (n,) array
        Times of the readings after turn-on, rising; readings and the variance of their noise.
    band : float or None
        Largest difference from the last value after the warm-up time.

    Raises
    ------
    InputError
        The times do not rise.
    """
    if not (np.diff(time) > 0).all():
        raise InputError("the times of the first readings do not rise", key="[data] time")
    t, y, noise = time - time[0], read - read.mean(), float(variance.mean())
    tau = np.geomspace(float(np.diff(t).min()) / 2, _SLOWEST * float(t[-1]), _GRID)
    v = np.geomspace(noise, 4 * noise + float(np.ptp(y)) ** 2, _GRID)
    without = float(_exponentials(t, y, variance, tau, v)[3].min())
    for _ in range(_ROUNDS):
        cost = _exponentials(t, y, variance, tau, v)[-1]
        near = cost <= cost.min() + _NEAR
        tau, v = _around(tau, near.any(axis=1)), _around(v, near.any(axis=0))
    size, sd, fit, _, cost = _exponentials(t, y, variance, tau, v)
    share = np.exp((cost.min() - cost) / 2)
    size = size[..., None] + sd[..., None] * _NORMAL
    found = without - float(fit.min()) >= _GAIN
    drift = distribution(size, share[..., None], detected=found)
    drift = replace(drift, bound=max(drift.high, -drift.low), detectable=sqrt(_GAIN) * drift.u)
    quiet = _exponentials(t, y, variance, tau, np.array([noise]))[2] - np.log(variance).sum()
    dof = len(t) - _FITTED
    scatter = probability_above(float(quiet.min()), dof) < CHANCE
    least = sqrt(noise * DETECTED * sqrt(2 / dof))
    s = distribution(np.sqrt(v - noise), share.sum(axis=0), detected=scatter, detectable=least)
    result = {"warm-up drift": drift, "short-term stability": s}
    constant = distribution(tau, share.sum(axis=1))
    if found and constant.high < _DETERMINED * t[-1]:
        result["warm-up time constant"] = constant
    if found and band is not None:
        slow, left = tau[:, None, None], np.exp(-t[-1] / tau)[:, None, None]
        until = -slow * np.log(band * (1 - left) / np.abs(size) + left)
        result["warm-up time"] = distribution(time[0] + until.clip(0.0), share[..., None])
    return result


def _exponentials(t: Array, y: Array, variance: Array, tau: Array, v: Array) -> tuple[Array, ...]:
    """Return the best drift of each time constant, (a,), and variance, (b,), all (a, b).

    The result is D and its standard deviation, χ² + Σ ln v with D and without it, and the same for
    the distribution of all parameters.
    """
    shape = np.expm1(-t / tau[:, None]) / np.expm1(-t[-1] / tau[:, None])
    weight = 1 / (v[:, None] - variance.mean() + variance)
    total = weight.sum(axis=1)
    level, mean = weight @ y / total, shape @ weight.T / total
    square = shape**2 @ weight.T - mean**2 * total
    drift = (shape @ (weight * y).T - mean * level * total) / square
    none = weight @ y**2 - level**2 * total - np.log(weight).sum(axis=1)
    fit = none - drift**2 * square
    return drift, square**-0.5, fit, none, fit + np.log(square * total * v * tau[:, None] ** 2)


def _around(values: Array, some: Bools) -> Array:
    """Return a finer grid over some of the values, with one cell around."""
    rows = np.flatnonzero(some)
    return np.geomspace(values[max(rows[0] - 1, 0)], values[min(rows[-1] + 1, _GRID - 1)], _GRID)


_SMALL = 9e-3 * G0  # m/s², more than the largest small tilt
_SAME = 1e-8 * G0  # m/s²; closer inputs of a series are equal
_FEWEST, _TERMS = 8, 6  # positions and terms of a tumble test
_STEEP = 1e-9  # of g: below this slope the sense of the input is unknown


def head_characteristics(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Sequence[Index],
    band: float | None = None,
) -> tuple[Characteristic, ...]:
    """Return the characteristics of each accelerometer.

    If the temperature varied after the warm-up, there are only those of the warm-up.

    Parameters
    ----------
    observations : Observations
    sensor : Sensor
    bench : DividingHead
    steps : sequence of Index
        The step of each row.
    band : float or None
        Largest difference from the last reading after the warm-up time, m/s².
    """
    plain, warm = rows_without_series(steps), list(warm_up_rows(steps))
    rest = np.arange(len(warm), len(steps), dtype=np.int64)
    varies = temperature_varies(observations.rows(rest.tolist()).temperature)
    observations = observations.without_drift
    motion, declared = sensed_motion(bench, steps, {}), bench.acting_parameters(steps)
    ramps = drift_ramps(steps)
    every, m, g = range(len(steps)), len(sensor.axes), bench.gravity.value
    place = first_visit_rows(steps)
    found: list[Characteristic] = []
    for k, axis in enumerate(sensor.axes):
        along = np.array(axis.i)
        level, slope = motion.f @ along, motion.df["base"] @ along
        if warm:
            variance = observations.covariance[warm, k, k] + (bench.pier * slope[warm]) ** 2
            away = observations.mean[warm, k] - level[warm]
            for name, one in warm_up(observations.time[warm], away, variance, band).items():
                if observations.timed or "time" not in name:
                    unit = "s" if "time" in name else "µg"
                    found.append(Characteristic(axis.name, name, one, unit))
        if varies or len(plain) < _FEWEST:
            continue
        slopes = {name: by @ along for name, by in motion.df.items() if name != "g"}
        of_angles = error_covariance(slopes, declared, every)
        at = np.arange(k, len(steps) * m, m)
        noise = observations.full_covariance[np.ix_(at, at)] + bench.drift**2 * (ramps.T @ ramps)
        read = observations.mean[:, k]
        gain = np.zeros((_TERMS, len(steps)))
        gain[:, plain] = np.linalg.pinv(_tumble_terms(level[plain] / g, slope[plain] / g))
        _, scale, tilt, *_ = gain @ read
        if not abs(tilt) < abs(scale):
            continue  # no accelerometer reads so; the fit says what is wrong
        alpha = float(tilt / scale)
        x: Array = level * cos(alpha) + slope * sin(alpha)
        # Equal inputs of a series have a level of their own, apart from the plain readings.
        equal = np.round(x / _SAME).astype(np.int64) + len(steps) + int(g / _SAME) + 1
        equal[plain] = np.array(place)[plain]
        sense = np.sign(slope) * [step.sense for step in steps]
        table = InputOutput(
            x,
            read,
            noise + of_angles,
            of_angles,
            np.where(np.abs(slope) > _STEEP * g, sense, 0.0),
            equal,
            np.zeros(len(steps), dtype=np.int64),
        )
        small = np.abs(x) < _SMALL
        small[[*warm, *plain]] = False
        away = small / max(int(small.sum()), 1) - gain[2] / scale
        zero = away @ of_angles @ away + gain[2] @ noise @ gain[2] / scale**2
        found += table_characteristics(
            axis.name, table.rows(rest), _SMALL, "µg", line=False, zero_sd=sqrt(float(zero))
        )
    return tuple(found)


def loop_columns(sensor: Sensor, bench: DividingHead, steps: Sequence[Index]) -> dict[str, Array]:
    """Return the effect of a unit hysteresis on the readings of each accelerometer, (r,).

    It is that of `inercal.estimation.input_output_tests.hysteresis` in the loop of ±1 g.
    """
    motion, plain = sensed_motion(bench, steps, {}), rows_without_series(steps)
    sense, result = np.array([step.sense for step in steps]), dict[str, Array]()
    for axis in sensor.axes:
        level, slope = (f @ np.array(axis.i) for f in (motion.f, motion.df["base"]))
        rising = np.where(np.abs(slope) > _STEEP * bench.gravity.value, np.sign(slope) * sense, 0.0)
        u = level / np.abs(level).max()
        result[axis.name] = np.zeros(len(steps))
        result[axis.name][plain] = (-0.5 * rising * (1 - u**2))[plain]
    return result


def _tumble_terms(sine: Array, cosine: Array) -> Array:
    """Return the terms of the tumble test for each position, (r, 6)."""
    one = np.ones_like(sine)
    return np.stack([one, sine, cosine, sine**2, sine * cosine, sine**3], axis=-1)
