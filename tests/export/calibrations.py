"""Calibrations to export, and readings over their range."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import ZERO_CELSIUS
from inercal.calibration import Calibration, Validity
from inercal.physics.sensors import G0, Form, Noise, Readout, imu, triad

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
    "basalt": NOISE,
    "betaflight": {"acc_1g": 2048, "mag_lsb": "0.15 uT"},
    "inav": {"acc_1g": 2048, "gyro_lsb": f"{1 / 16.4} deg/s", "mag_lsb": "0.15 uT"},
    "px4": {"acc_id": 1310988, "gyro_id": 1310989},
    "adis": {
        "order": "scale",
        "acc_bias_lsb": "0.8 mg",
        "gyro_bias_lsb": "0.02 deg/s",
        "scale_lsb": 2.0**-15,
        "bias_bits": 16,
    },
}


@cache
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


@cache
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


# D, o in T, a field, and what targets without the rotation see: a worked example by hand.
DISTORTION = np.array([[1.02, 0.03, -0.02], [-0.01, 0.97, 0.04], [0.02, -0.03, 1.05]])
HARD_IRON = np.array([12e-6, -8e-6, 20e-6])
FIELD = (-60e-6, 60e-6)
MICROTESLA = Readout(1e6, 0.0, "uT")


def make_magnetometer(
    *more: str, readout: Readout = MICROTESLA, inertial: bool = False, turn: Array | None = None
) -> Calibration:
    """Return magnetometers with D and o, with an IMU if `inertial`, and with D = D turn.

    `more` names temperature terms, with values of 1 % over the range.
    """
    sensor = triad("mag", "m", "m", readout)
    names = tuple(f"m{a}.{name}" for name in ("bias", "scale", "delta_o", "delta_p") for a in "xyz")
    stated: dict[str, float] = {}
    if inertial:
        own = make_calibration()
        sensor = replace(sensor, axes=own.sensor.axes + sensor.axes)
        names = (*names, *own.sensor.coefficients)
        stated = dict(zip(own.sensor.coefficients, own.values.tolist(), strict=True))
    sensor = sensor.with_coefficients(*names, *(f"m{a}.{name}" for name in more for a in "xyz"))
    matrix = DISTORTION if turn is None else DISTORTION @ turn
    for k, a in enumerate("xyz"):
        stated |= {
            f"m{a}.bias": HARD_IRON[k],
            f"m{a}.scale": matrix[k, k] - 1,
            f"m{a}.delta_o": matrix[k, (k + 1) % 3],
            f"m{a}.delta_p": -matrix[k, (k + 2) % 3],
            f"m{a}.bias_dT": (k - 1) * 12e-9,
            f"m{a}.scale_dT": (k + 1) * 1e-4,
        }
    c = np.array([stated[name] for name in sensor.coefficients])
    u = 1e-6 * sensor.unit_scale
    return Calibration(sensor, c, np.diag(u**2), validity=RANGES)


def magnetometer_readings(calibration: Calibration, n: int = 10_000) -> Readings:
    """Return random output of all axes and the correction, f, ω and m of the axes that exist."""
    rng = np.random.default_rng(11)
    span = {"f": (-20.0, 20.0), "w": (-2.0, 2.0), "m": FIELD}
    axes = calibration.sensor.axes
    sensed = np.stack([rng.uniform(*span[axis.measures], n) for axis in axes], axis=1)
    output = calibration.sensor.to_output(sensed)
    celsius = rng.uniform(-10.0, 60.0, n)
    dT = celsius + ZERO_CELSIUS - calibration.sensor.reference_temperature
    motion = calibration.correct(output, dT=dT)
    kinds = dict.fromkeys(axis.measures for axis in axes)
    return Readings(output, np.hstack([getattr(motion, kind) for kind in kinds]), celsius)
