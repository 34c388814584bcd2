"""Tests of rests: whether their two halves agree, which a table that creeps or is knocked fails."""

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation import ModelTest
from inercal.methods.systematic.segments import Segments
from inercal.methods.turntable.drift import covariance_of_means
from inercal.physics.sensors import Sensor

HALVES = "halves of the rests"


def rest_change_deviations(segments: Segments, sensor: Sensor) -> Array:
    """Return the second half's mean minus the first's, over its sd, (m, 6)."""
    noises = [axis.noise for axis in sensor.axes]
    white = np.array([one.white**2 for one in noises])
    result = segments.halves[1] - segments.halves[0]
    start, stop = segments.start[::2], segments.stop[::2]
    for k, (a, b) in enumerate(zip(start.tolist(), stop.tolist(), strict=True)):
        middle = 0.5 * (a + b)
        drift = covariance_of_means(
            noises, np.array([a, middle]), np.array([middle, b]), segments.run
        )
        variance = 4 * white / (b - a) + drift[0, 0] + drift[1, 1] - 2 * drift[0, 1]
        if segments.rounding is not None:  # each half has an error
            variance = variance + 2 * segments.rounding.steps.variance
        result[k] /= np.sqrt(variance)
    return result


def rest_change_test(segments: Segments, sensor: Sensor) -> ModelTest:
    """Return the χ² test of all halves."""
    z = rest_change_deviations(segments, sensor)
    return ModelTest(HALVES, float((z**2).sum()), z.size)
