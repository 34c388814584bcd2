"""Covariance of the readings due to the angles of a dividing head and gravity."""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.dividing_head.bench import DividingHead, sensed_motion
from inercal.physics.motion import Motion
from inercal.physics.plan import Index
from inercal.physics.sensors import Sensor


def bench_covariance(
    sensor: Sensor,
    bench: DividingHead,
    steps: Sequence[Index],
    c: Array | None = None,
    *,
    gravity: bool = True,
) -> Array:
    """Return the covariance of all readings due to the bench's angles and gravity.

    (m r, m r) in (m/s²)², row after row as `Observations.full_covariance`.

    Parameters
    ----------
    sensor : Sensor
    bench : DividingHead
    steps : sequence of r Index
    c : (p,) array, optional
        Coefficients of the sensor; None is the nominal one.
    gravity : bool
        Whether the uncertainty of gravity is included.
    """
    declared = bench.acting_parameters(steps)
    columns = [
        declared[name].sd * column
        for name, column in reading_sensitivities(sensor, bench, steps, c).items()
        if gravity or name != "g"
    ]
    size = len(sensor.channels) * len(steps)
    return sum((np.outer(column, column) for column in columns), np.zeros((size, size)))


def reading_sensitivities(
    sensor: Sensor, bench: DividingHead, steps: Sequence[Index], c: Array | None = None
) -> dict[str, Array]:
    """Return ∂(readings)/∂(parameter) for every parameter that is not exact, (m r,).

    Arguments as of `bench_covariance`. The derivative of an estimate by a stated value of the bench
    is minus its derivative by the readings times this.
    """
    result = sensed_motion(bench, steps, {})
    c = np.zeros(len(sensor.coefficients)) if c is None else c
    slope = sensor.slope(Motion(result.f), c)[..., :3]
    return {
        name: (slope @ result.df[name][..., None]).ravel()
        for name, q in bench.acting_parameters(steps).items()
        if q.sd > 0
    }
