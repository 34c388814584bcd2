"""Calibrations to export, and readings over their range."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import ZERO_CELSIUS
from inercal.calibration import Calibration, Validity
from inercal.physics.sensors import G0, Form, Noise, Readout, imu

RANGES = Validity(rate=(-2.0, 2.0), force=(-20.0, 20.0), temperature=(263.15, 333.15))
COUNTS = (Readout(16384 / G0, 120.0, "LSB"), Readout(131 * 180 / np.pi, -40.0, "LSB"))
SI = (Readout(1.0, 0.0, "m/s^2"), Readout(1.0, 0.0, "rad/s"))
LINEAR = ("bias", "scale", "misalignment", "g")
TEMPERATURE = ("k0_dT", "k0_dT2", "bias_dT")
NONLINEAR = ("k2", "k3", "kip", "k1_prime", "k1_dT", "scale2", "scale_dT", "g_ii")
NOISE = {
    "accelerometer_noise_density": 1e-3,
    "accelerometer_random_walk": 1e-4,
    "gyroscope_noise_density": 1e-4,
    "gyroscope_random_walk": 1e-5,
    "update_rate": 200,
}
OPTIONS = {
    "kalibr": NOISE,
    "openvins": NOISE,
    "px4": {"acc_id": 1310988, "gyro_id": 1310989},
    "adis": {
        "order": "scale",
        "acc_bias_lsb": "0.8 mg",
        "gyro_bias_lsb": "0.02 deg/s",
        "scale_lsb": 2.0**-15,
        "bias_bits": 16,
    },
}


def make_calibration(
    *names: str,
    readouts: tuple[Readout, Readout] = SI,
    form: Form = "reference",
    seed: int = 1,
    size: float = 2e-3,
    u: float = 1e-5,
) -> Calibration:
    """Return an IMU with random coefficients; `size` and u are in natural units (unit_scale)."""
    sensor = imu("IMU-7", (readouts[0], Noise()), (readouts[1], Noise()))
    sensor = sensor.with_coefficients(*(names or LINEAR))
    sensor = replace(sensor, form=form)
    rng = np.random.default_rng(seed)
    c = rng.normal(size=len(sensor.coefficients)) * sensor.unit_scale * size
    small = [".g_" in name for name in sensor.coefficients]
    c[small] *= 0.01
    covariance = np.diag((u * sensor.unit_scale) ** 2)
    return Calibration(sensor, c, covariance, "ferraris", "joint", validity=RANGES)


class Readings(NamedTuple):
    """Output (n, 6), the correction by the calibration (n, 6), and temperatures (n,), °C."""

    output: Array
    corrected: Array
    celsius: Array


def random_readings(calibration: Calibration, n: int = 10_000, seed: int = 7) -> Readings:
    """Return random output that a sensor states over the calibrated range."""
    rng = np.random.default_rng(seed)
    sensor = calibration.sensor
    span = [*[RANGES.force] * 3, *[RANGES.rate] * 3]
    sensed = np.stack([rng.uniform(*(one or (0, 0)), n) for one in span], axis=1)
    scale = np.array([axis.readout.scale for axis in sensor.axes])
    offset = np.array([axis.readout.offset for axis in sensor.axes])
    output = offset + scale * sensed
    if sensor.axes[0].readout.unit == "LSB":
        output = np.rint(output)
    low, high = RANGES.temperature or (293.15, 293.15)
    celsius = rng.uniform(low, high, n) - ZERO_CELSIUS
    dT = celsius + ZERO_CELSIUS - sensor.reference_temperature
    motion = calibration.correct(output, dT=dT)
    return Readings(output, np.concatenate([motion.f, motion.w], axis=1), celsius)
