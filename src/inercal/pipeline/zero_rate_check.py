"""Check the units of gyro columns, because a gyro at rest should read only its bias.

`inercal.recordings.io.rest_norm` checks the accelerometers.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np

from inercal.estimation import Gaussian
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.physics.plan import Hold, Position, Step
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Observations
from inercal.recordings.data.recording_loader import unsigned_column
from inercal.recordings.io.rest_norm import LARGEST_BIAS, rate_finding


def check_zero_rates(
    observations: Observations,
    sensor: Sensor,
    steps: Sequence[Step],
    priors: Sequence[Gaussian],
    columns: Sequence[str | int],
) -> tuple[Finding, ...]:
    """Return a warning if gyros at rest read more than a plausible bias.

    Parameters
    ----------
    observations : Observations
        Means in SI units from the nominal readout, without a trial axis.
    sensor : Sensor
    steps : sequence of r Step
        Step of each row; rests are steps of the classes `Hold` and `Position`.
    priors : sequence of Gaussian
        Priors of biases. The difference from the mean of a prior may be 20 °/s, or the expanded
        uncertainty of the prior if this is larger.
    columns : sequence of str or int
        Columns that [data] gyro names, in the order of the sensor's gyros.
    """
    resting = [isinstance(step, Hold | Position) for step in steps]
    if observations.track is not None or not any(resting):
        return ()
    expected = _expected_values(priors)
    gyros = [k for k, axis in enumerate(sensor.axes) if axis.measures == "w"]
    large: list[tuple[str, float]] = []
    for k, column in zip(gyros, columns, strict=False):
        name = sensor.axes[k].name
        rate = float(np.median(observations.mean[resting, k]))
        bias, sd = expected.get(f"{name}.bias", (0.0, 0.0))
        if abs(rate - bias) > max(LARGEST_BIAS, COVERAGE * sd):
            large.append((f"{name} (column {unsigned_column(column)})", rate))
    finding = rate_finding(large, ", or state the bias in [method.prior]")
    return () if finding is None else (finding,)


def _expected_values(priors: Sequence[Gaussian]) -> dict[str, tuple[float, float]]:
    """Return the mean and standard deviation of each coefficient that has a prior."""
    return {
        name: (float(prior.mean[..., k]), sqrt(float(prior.covariance[k, k])))
        for prior in priors
        for k, name in enumerate(prior.names)
    }
