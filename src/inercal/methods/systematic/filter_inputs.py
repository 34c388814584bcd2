"""What the filter of systematic calibration knows before its first sample, and where it starts.

Before the data coefficients have standard deviations of a tenth of their natural size (0.1 g, 10 %,
6°), many times what a recording leaves; biases of gyros, found with the azimuth, of half of their
size and of the Earth's rate.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import radians

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.turntable.still_table import StillTable
from inercal.estimation import Gaussian
from inercal.methods.systematic.alignment import initial_attitudes
from inercal.methods.systematic.navigation import ImuModel, bias_name, earth_rate
from inercal.methods.systematic.segments import Segments
from inercal.methods.turntable.drift import Drift, drift_model
from inercal.physics.quantities import Measures
from inercal.physics.sensors import Sensor
from inercal.recordings import sample_count

EPOCH = 0.2  # s
KINDS: tuple[Measures, ...] = ("f", "w")
LAG_SD = 0.05  # s, before the data
_SIZE = 0.1  # of a coefficient's natural size, and rad of the level
_BIAS_SHARE = 0.5  # of gyro biases and of the Earth's rate
_LARGEST_AZIMUTH = radians(30)


@dataclass(frozen=True, eq=False)
class FilterModel:
    """What a filter knows before its first sample.

    Parameters
    ----------
    sensor : Sensor
        Three accelerometers, then three gyros.
    known : StillTable
    priors : sequence of Gaussian
        On coefficients.
    run_duration : float
        s, which says how slow a drift is counted.
    dt : float
        s.
    means : bool
        Whether a sample is the mean of its reading over one period.
    """

    sensor: Sensor
    known: StillTable
    priors: Sequence[Gaussian]
    run_duration: float
    dt: float
    means: bool

    @cached_property
    def imu(self) -> ImuModel:
        """The model of the readings."""
        return ImuModel(self.sensor)

    @cached_property
    def drifts(self) -> tuple[Drift, Drift]:
        """The drift of accelerometers and of gyros."""
        force, rate = (
            drift_model(
                [axis.noise for axis in self.sensor.axes if axis.measures == kind],
                self.run_duration,
                self.sensor.name,
            )
            for kind in KINDS
        )
        return force, rate

    @property
    def count(self) -> int:
        """Samples of an epoch."""
        return max(1, sample_count(EPOCH, self.dt))


@dataclass(frozen=True, eq=False)
class FilterStart:
    """Where a filter starts, and how sure that is.

    Parameters
    ----------
    attitude : (3, 3) array
        C, body to n, at the first sample.
    value : (p,) array
        Coefficients, SI.
    lag : float
        s.
    sd : (p,) array
        Of the coefficients, SI.
    attitude_sd : (3,) array
        rad, about east, north and up.
    rest_attitudes : (m, 3, 3) array
        C of the first m rests, where they are known beforehand.
    """

    attitude: Array
    value: Array
    lag: float
    sd: Array
    attitude_sd: Array
    rest_attitudes: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))


def filter_start(model: FilterModel, segments: Segments) -> FilterStart:
    """Return the start of a filter from the rests and turns of its recording, or of its begin.

    Raises
    ------
    InputError
        As of `initial_attitudes`.
    """
    sensor, imu = model.sensor, model.imu
    latitude = model.known.latitude.value
    nominal = np.zeros(len(sensor.coefficients))
    attitudes, c = initial_attitudes(segments, imu, nominal, latitude)
    earth = earth_rate(latitude)
    biases = [bias_name(axis) for axis in sensor.axes if axis.measures == "w"]
    values = zip(sensor.coefficients, c.tolist(), strict=True)
    largest = max((abs(value) for name, value in values if name in biases), default=0.0)
    bias = _BIAS_SHARE * (float(np.linalg.norm(earth)) + largest)
    sd = _SIZE * sensor.unit_scale
    for k, name in enumerate(sensor.coefficients):
        if name in biases:
            sd[k] = bias
    for prior in model.priors:  # what the user states counts, not how large errors look
        at = [sensor.coefficients.index(name) for name in prior.names]
        sd[at] = np.maximum(sd[at], 10 * np.sqrt(np.diagonal(prior.covariance)))
    azimuth = min(bias / float(earth[1]), _LARGEST_AZIMUTH)
    return FilterStart(attitudes[0], c, 0.0, sd, np.array([_SIZE, _SIZE, azimuth]))
