"""Hysteresis, threshold, warm-up drift and the like of accelerometers on a dividing head.

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
short-term stability (`inercal.estimation.warm_up`). They do not enter the fit of the coefficients.
"""

from collections.abc import Sequence
from math import cos, sin, sqrt

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.characteristics import Characteristic, error_covariance, table_characteristics
from inercal.benches.dividing_head.bench import DividingHead, sensed_motion
from inercal.benches.dividing_head.passes import (
    drift_ramps,
    first_visit_rows,
    rows_without_series,
    warm_up_rows,
)
from inercal.estimation.input_output_tests import InputOutput
from inercal.estimation.warm_up import warm_up
from inercal.physics.plan import Index
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations
from inercal.recordings.temperature import temperature_varies

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
    observations = observations.without_drift()
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


def _tumble_terms(sine: Array, cosine: Array) -> Array:
    """Return the terms of the tumble test for each position, (r, 6)."""
    one = np.ones_like(sine)
    return np.stack([one, sine, cosine, sine**2, sine * cosine, sine**3], axis=-1)
