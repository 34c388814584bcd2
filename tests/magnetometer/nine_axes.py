"""A finished calibration of nine axes, and the same device in plain matrices.

The magnetometer is the worked example of a nine-axis unit: D, o and a field, in µT.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inercal.calibration import Calibration
from inercal.physics.sensors import Readout, Sensor, imu
from inercal.physics.sensors.catalogue import axes_along

Array = NDArray[np.float64]
D = np.array([[1.02, 0.03, -0.02], [-0.01, 0.97, 0.04], [0.02, -0.03, 1.05]])
OFFSET = np.array([12.0, -8.0, 20.0])
FIELD, READING = np.array([20.0, 5.0, -40.0]), np.array([33.35, -4.95, -21.75])


def nine_axes(directions: tuple[str, str, str] = ("x", "y", "z"), *further: str) -> Sensor:
    """Return accelerometers, gyros and magnetometers in µT along these directions."""
    field = axes_along(directions, "m", "m")
    field = tuple(replace(axis, readout=Readout(1e6, 0.0, "µT")) for axis in field)
    sensor = Sensor("nine", (*imu().axes, *field))
    return sensor.with_coefficients("bias", "scale", "misalignment", *further)


def calibrated(sensor: Sensor, rows: Array, offset: Array, seed: int = 0) -> Calibration:
    """Return a calibration with these rows of D and o in µT, and a full covariance.

    The other coefficients are zero. u is about 0.1 µT, 0.1 % and 0.05°.
    """
    rng = np.random.default_rng(seed)
    values = dict.fromkeys(sensor.coefficients, 0.0)
    u = dict(zip(values, (1e-5 * sensor.unit_scale).tolist(), strict=True))
    for axis, row, bias in zip(sensor.axes[6:], rows, offset, strict=True):
        i, p = np.array(axis.i), np.array(axis.p)
        values[f"{axis.name}.bias"] = 1e-6 * float(bias)
        values[f"{axis.name}.scale"] = float(row @ i) - 1
        values[f"{axis.name}.delta_o"] = float(row @ p)
        values[f"{axis.name}.delta_p"] = -float(row @ np.cross(i, p))
        u |= {f"{axis.name}.{one}": 1e-3 for one in ("scale", "delta_o", "delta_p")}
        u[f"{axis.name}.bias"] = 1e-7
    p = len(values)
    root = np.array(list(u.values()))[:, None] * (np.eye(p) + 0.2 * rng.standard_normal((p, p)))
    return Calibration(sensor, np.array(list(values.values())), root @ root.T)
