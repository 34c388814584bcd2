"""A method as another package may bring it: the gyros' biases are their mean readings at rest.

With r a reading less what a gyro senses of the earth's rate, by the readback::

    b_n = b_{n-1} + (r_n − b_{n-1})/n,   var(b_n) = N² f_s/n,   S_n = N² f_s (1 + 1/(n − 1))

where N is the noise density, f_s the sampling rate and S the variance of the innovation.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from inercal.basics.errors import InputError
from inercal.benches import Turntable
from inercal.benches.turntable.attitude import motion
from inercal.benches.turntable.paths import path_by_name
from inercal.estimation import Estimate, Gaussian
from inercal.methods import Method, PartialEstimate
from inercal.physics.plan import TableStep
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations, Track

_LEAST = 100  # samples
_AXES = 3


class RestMean:
    """The recursive mean over all samples at rest."""

    def __init__(self, sensor: Sensor, bench: Turntable, rate_hz: float):
        self._gyros, self._bench = sensor.select_axes("w"), bench
        self._at = [sensor.channels.index(name) for name in self._gyros.channels]
        self._variance = np.array([axis.noise.white**2 * rate_hz for axis in self._gyros.axes])
        self._mean = self._sensed = np.zeros(_AXES)
        self._hold, self._n, self._nis = -1, 0, 0.0

    def feed(self, track: Track) -> None:
        for hold, angles, reading in zip(
            track.hold.tolist(), track.angles, track.reading[:, self._at], strict=True
        ):
            if hold < 0:
                continue
            if hold != self._hold:
                self._hold, self._sensed = hold, self._at_rest(angles)
            off = reading - self._sensed - self._mean
            if self._n:
                self._nis += float(np.sum(off**2 / (self._variance * (1 + 1 / self._n))))
            self._n += 1
            self._mean = self._mean + off / self._n

    def estimate(self) -> Mapping[str, PartialEstimate]:
        if self._n < _LEAST:
            return {}
        covariance = np.diag(self._variance / self._n)
        names, components = self._gyros.coefficients, _AXES * (self._n - 1)
        return {"all": PartialEstimate(names, self._mean, covariance, self._nis, components)}

    def _at_rest(self, angles: np.ndarray) -> np.ndarray:
        still = np.zeros((1, angles.size))
        sensed = motion(self._bench, angles[None], still, still, {})
        return self._gyros.forward(sensed, np.zeros(_AXES))[0]


def make_sequential(
    estimator: str,
    sensor: Sensor,
    bench: Turntable,
    steps: Sequence[TableStep],
    priors: Sequence[Gaussian],
    rate_hz: float,
) -> RestMean:
    return RestMean(sensor, bench, rate_hz)


def estimate_rest_mean(
    observations: Observations,
    sensor: Sensor,
    bench: Turntable,
    steps: Sequence[TableStep],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    track = observations.track
    if track is None:
        raise InputError("rest_biases follows a recording")
    made = RestMean(sensor, bench, float(1 / np.median(np.diff(track.time))))
    made.feed(track)
    found = made.estimate()["all"]
    return Estimate(
        names=found.names,
        value=found.value,
        covariance=found.covariance,
        chi2=np.array(found.nis),
        dof=found.components,
        residual=np.zeros(0),
        whitened=np.zeros(0),
        observations=(),
        wanted=found.names,
        rank=len(found.names),
        singular_values=1 / np.sqrt(np.diagonal(found.covariance)),
        null_directions=(),
        weakest=None,
        converged=np.array(True),
        iterations=np.array(1),
    )


METHOD = Method(
    name="rest_biases",
    bench=Turntable,
    default_coefficients={"f": (), "w": ("bias",)},
    needs=("f", "w"),
    plan=path_by_name,
    estimators={"mean": estimate_rest_mean},
    source="a test",
    sequential=make_sequential,
)
