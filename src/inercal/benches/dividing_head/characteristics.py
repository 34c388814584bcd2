"""Hysteresis, threshold, resolution and dead zone of accelerometers on a dividing head.

The input of an accelerometer is g sin ψ, where ψ is the angle of its input axis from the
horizontal. The forward pass and the reverse pass reach a position from different sides, so their
readings show the hysteresis in a loop of ±1 g. A series of small tilts applies small inputs: about
0° it shows the threshold and the dead zone, and about an inclined position, such as 30°, the
resolution (IEEE Std 1293 and 836).

The covariance of the readings contains the noise, the drift of the biases in each pass, and the
stated errors of the head's angles. The backlash of the head acts almost like a hysteresis of ±1 g
and must be stated. A series of small tilts has one error of the head's graduation; `pier` is the
error of each small tilt.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.characteristics import Characteristic, error_covariance, table_characteristics
from inercal.benches.dividing_head.bench import DividingHead, sensed_motion
from inercal.benches.dividing_head.passes import (
    drift_ramps,
    first_visit_rows,
    rows_without_series,
)
from inercal.estimation.input_output_tests import InputOutput
from inercal.physics.plan import Index
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations
from inercal.recordings.temperature import temperature_varies

_SMALL = 9e-3 * G0  # m/s², more than the largest small tilt
_SAME = 1e-8 * G0  # m/s²; closer inputs of a series are equal
_STEEP = 1e-9  # of g: below this slope the sense of the input is unknown


def head_characteristics(
    observations: Observations, sensor: Sensor, bench: DividingHead, steps: Sequence[Index]
) -> tuple[Characteristic, ...]:
    """Return the characteristics of each accelerometer; none if the temperature varied."""
    if temperature_varies(observations.temperature):
        return ()
    observations = observations.without_drift()
    motion, declared = sensed_motion(bench, steps, {}), bench.acting_parameters(steps)
    ramps = drift_ramps(steps)
    noise = observations.full_covariance
    every, m = range(len(steps)), len(sensor.axes)
    plain = set(rows_without_series(steps))
    place = first_visit_rows(steps)
    found: list[Characteristic] = []
    for k, axis in enumerate(sensor.axes):
        along = np.array(axis.i)
        x: Array = motion.f @ along
        slope = motion.df["base"] @ along
        steep = np.abs(slope) > _STEEP * bench.gravity.value
        at = np.arange(k, len(steps) * m, m)
        slopes = {name: by @ along for name, by in motion.df.items() if name != "g"}
        # Equal inputs of a series share a level, but not with the plain readings.
        levels = [place[r] if r in plain else round(float(x[r]) / _SAME) + 10**9 for r in every]
        table = InputOutput(
            x,
            observations.mean[:, k],
            noise[np.ix_(at, at)]
            + bench.drift**2 * (ramps.T @ ramps)
            + error_covariance(slopes, declared, every),
            np.where(steep, np.sign(slope) * [step.sense for step in steps], 0.0),
            np.array(levels, dtype=np.int64),
            np.zeros(len(steps), dtype=np.int64),
        )
        found += table_characteristics(axis.name, table, _SMALL, "µg", line=False)
    return tuple(found)
