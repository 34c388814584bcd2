"""Compute the covariance of readings due to gravity and the angles of a dividing head."""

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

    The matrix is (m r, m r) in (m/s²)², ordered row by row like `Observations.full_covariance`.

    Parameters
    ----------
    sensor : Sensor
    bench : DividingHead
    steps : sequence of r Index
    c : (p,) array, optional
        Coefficients of the sensor; None means a nominal sensor.
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
    """Return the readings' derivatives, (m r,), with respect to each parameter that is not exact.

    The arguments are the same as for `bench_covariance`. To get the derivative of an estimate with
    respect to a stated value of the bench, multiply its derivative with respect to the readings by
    this one, and change the sign.
    """
    result = sensed_motion(bench, steps, {})
    c = np.zeros(len(sensor.coefficients)) if c is None else c
    slope = sensor.slope(Motion(result.f), c)[..., :3]
    return {
        name: (slope @ result.df[name][..., None]).ravel()
        for name, q in bench.acting_parameters(steps).items()
        if q.sd > 0
    }
