"""Check of the units of gyro columns: at rest a gyro reads its bias, which data sheets bound.

Rests show no scale factor of gyros. Raw counts that are declared as °/s, or an analog output
without its offset, look like a large bias and leave residuals that agree with the noise. The bound
is the initial zero-rate output of a MEMS gyro of low grade, ±20 °/s at 25 °C (InvenSense, MPU-6000
and MPU-6050 Product Specification, PS-MPU-6000A-00 rev. 3.4, section 6.1). A larger bias is
possible, so that the check warns and does not refuse.
"""

from collections.abc import Sequence
from math import degrees, radians, sqrt

import numpy as np

from inercal.data.recording_loader import unsigned_column
from inercal.estimate import Gaussian
from inercal.plan import Hold, Position, Step
from inercal.recording import Finding, Observations
from inercal.sensors import Sensor
from inercal.uncertainty.coverage import COVERAGE

_LARGEST = radians(20.0)  # rad/s, of a gyro at rest


def check_zero_rates(
    observations: Observations,
    sensor: Sensor,
    steps: Sequence[Step],
    priors: Sequence[Gaussian],
    columns: Sequence[str | int],
) -> tuple[Finding, ...]:
    """Return a warning where gyros at rest read more than a bias that can be expected.

    Parameters
    ----------
    observations : Observations
        Means in SI by the nominal readout, without a trial axis.
    sensor : Sensor
    steps : sequence of r Step
        Of each row; rests are those of class `Hold` and `Position`.
    priors : sequence of Gaussian
        A prior on a bias states what is expected: the difference from its mean may be 20 °/s, or
        the expanded uncertainty of the prior if that is larger.
    columns : sequence of str or int
        Of [data] gyro, in the order of the sensor's gyros.
    """
    resting = [isinstance(step, Hold | Position) for step in steps]
    if observations.track is not None or not any(resting):
        return ()
    expected = _expected_values(priors)
    gyros = [k for k, axis in enumerate(sensor.axes) if axis.measures == "w"]
    texts: list[str] = []
    for k, column in zip(gyros, columns, strict=False):
        name = sensor.axes[k].name
        rate = float(np.median(observations.mean[resting, k]))
        bias, sd = expected.get(f"{name}.bias", (0.0, 0.0))
        if abs(rate - bias) > max(_LARGEST, COVERAGE * sd):
            number = f"{degrees(rate):.3g}".replace("-", "−")
            texts.append(f"{name} (column {unsigned_column(column)}) {number} °/s")
    if not texts:
        return ()
    text = (
        f"at rest the gyros read {', '.join(texts)}, but a bias is seldom beyond "
        f"±{degrees(_LARGEST):.0f} °/s: raw counts or volts that are declared as a rate look like "
        "this; check unit, scale and offset in [sensor.gyro], or state the bias in [method.prior]"
    )
    return (Finding("warning", "units", text),)


def _expected_values(priors: Sequence[Gaussian]) -> dict[str, tuple[float, float]]:
    """Return mean and standard deviation of each name that has a prior."""
    return {
        name: (float(prior.mean[..., k]), sqrt(float(prior.covariance[k, k])))
        for prior in priors
        for k, name in enumerate(prior.names)
    }
