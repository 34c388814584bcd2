"""Simulated motions, calibrated by `field_and_rates` as a calibration from a run file does."""

from dataclasses import dataclass, replace

import numpy as np
from tests.magnetometer import motion as sim
from tests.magnetometer.calibrations import FIELD_NAMES, FIELD_SD, coefficients

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.calibration.verdict import Verdict, verdict
from inercal.estimation import Estimate
from inercal.methods import METHODS, Fit
from inercal.physics.sensors import Noise, Sensor, axes_along
from inercal.recordings import Observations, Track
from inercal.recordings.magnetic import MagneticPieces, MagneticReadings

BIASES = tuple(f"g{axis}.bias" for axis in "xyz")


@dataclass(frozen=True)
class MotionCalibrated:
    """A motion, the sensor of its calibration and the estimate of all axes."""

    data: sim.Motion
    sensor: Sensor
    estimate: Estimate

    @property
    def judged(self) -> Verdict:
        """The verdict without findings about a recording."""
        return verdict(self.estimate, self.sensor, ())

    def errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the errors of all coefficients and the delay, and their covariance."""
        own = self.data.device
        true = dict(zip(FIELD_NAMES, coefficients(own.d, own.o), strict=True))
        true |= dict(zip(BIASES, self.data.bias, strict=True))
        true["delay"] = self.data.delay
        at = [self.estimate.names.index(name) for name in true]
        error = self.estimate.value[at] - np.array([*true.values()])
        return error, self.estimate.covariance[np.ix_(at, at)]


def calibrated_motion(
    rng: np.random.Generator, data: sim.Motion, noise: bool = True
) -> MotionCalibrated:
    """Return the calibration of a motion, whose stated strength is drawn with its uncertainty.

    With `noise`, the white noise of all axes is stated; otherwise the method has to find it.
    """
    rate = 1 / float(np.mean(np.diff(data.time)))
    slow = 1 / float(np.mean(np.diff(data.time[data.fresh])))
    stated = (sim.SIGMA_W / np.sqrt(rate), sim.SIGMA_M / np.sqrt(slow)) if noise else (0.0, 0.0)
    gyro, magnetic = (Noise(white=float(one)) for one in stated)
    chosen = METHODS["field_and_rates"]
    sensor = Sensor("unit", axes_along("xyz", "w", "g", noise=gyro)).with_coefficients("bias")
    field = Sensor("unit", axes_along("xyz", "m", "m", noise=magnetic))
    field = field.with_coefficients("bias", "scale", "misalignment")
    count, k = len(data.time), len(data.fresh)
    none = np.zeros((0, 3))
    pieces = MagneticPieces(
        np.zeros(k, dtype=np.int64),
        data.time[data.fresh],
        data.field[data.fresh],
        np.ones(k, dtype=np.int64),
    )
    seen = Observations(
        ("motion",),
        data.rate.mean(axis=0)[None],
        1e-12 * np.eye(3)[None],
        np.ptp(data.time)[None],
        np.array([count]),
        data.time.mean()[None],
        sensor.channels,
        track=Track(data.time, data.rate, np.zeros((count, 0)), np.zeros(count, dtype=np.int64)),
        magnetic=MagneticReadings(
            field.channels,
            np.zeros(0, dtype=np.int64),
            none,
            np.zeros((0, 3, 3)),
            np.zeros(0),
            np.zeros(0),
            np.zeros((3, 3)),
            pieces=pieces,
        ),
    )
    strength = data.device.strength + FIELD_SD * rng.standard_normal()
    bench = Hand(Measured(9.80665, 1e-5), field=Measured(strength, FIELD_SD))
    estimate = chosen.estimators["gls"](seen, sensor, bench, ())
    assert chosen.add_magnetometers is not None
    whole, _ = chosen.add_magnetometers(Fit("gls", sensor, bench, seen, (), (), estimate), field)
    both = replace(
        sensor, axes=sensor.axes + field.axes, coefficients=sensor.coefficients + field.coefficients
    )
    return MotionCalibrated(data, both, whole)
