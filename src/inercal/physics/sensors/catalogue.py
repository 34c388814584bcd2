"""Constructors for common sensors: single axis, pair, triad, IMU and redundant cluster."""

from collections.abc import Sequence

import numpy as np

from inercal.basics.errors import InputError
from inercal.physics.quantities import Measures
from inercal.physics.sensors.axis import Axis, Readout
from inercal.physics.sensors.noise import Noise
from inercal.physics.sensors.sensor import Sensor

# I and P of x, y, z: cyclic, so that O completes the frame (x → xyz, y → yzx, z → zxy)
CYCLIC_AXES = {
    "x": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "y": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "z": ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
}


def triad(
    name: str = "triad",
    measures: Measures = "f",
    prefix: str = "",
    readout: Readout = Readout(),
    noise: Noise = Noise(),
) -> Sensor:
    """Return a sensor with three orthogonal axes named `prefix` + x, y, z, without coefficients.

    >>> triad().with_coefficients("bias", "z.k2").coefficients
    ('x.k0', 'y.k0', 'z.k0', 'z.k2')
    """
    axes = tuple(
        Axis(prefix + a, measures, i, p, readout, noise) for a, (i, p) in CYCLIC_AXES.items()
    )
    return Sensor(name, axes)


def imu(
    name: str = "imu",
    accelerometer: tuple[Readout, Noise] = (Readout(), Noise()),
    gyro: tuple[Readout, Noise] = (Readout(), Noise()),
) -> Sensor:
    """Return an IMU with accelerometers ax, ay, az and gyros gx, gy, gz."""
    accelerometers = triad(name, "f", "a", *accelerometer).axes
    return Sensor(name, accelerometers + triad(name, "w", "g", *gyro).axes)


def single(name: str = "accelerometer", measures: Measures = "f") -> Sensor:
    """Return a sensor with a single axis "i", with I along x and P along y."""
    return Sensor(name, (Axis("i", measures, *CYCLIC_AXES["x"]),))


def pair(name: str = "pair") -> Sensor:
    """Return a pair of orthogonal accelerometers, a along x and b along y."""
    return Sensor(name, (Axis("a", "f", *CYCLIC_AXES["x"]), Axis("b", "f", *CYCLIC_AXES["y"])))


def cluster(name: str, input_axes: Sequence[Sequence[float]], measures: Measures = "f"):
    """Return a redundant cluster with axes s1, s2, … along the rows of `input_axes`, (m, 3).

    P is the horizontal direction orthogonal to I, or y if I is along z.

    Raises
    ------
    InputError
        A direction is zero or not finite.
    """
    axes: list[Axis] = []
    for k, row in enumerate(np.asarray(input_axes, dtype=float), start=1):
        length = np.linalg.norm(row)
        if not np.isfinite(length) or length == 0:
            raise InputError(
                f"cluster {name}: input axis {k} is {row.tolist()}; give a direction of finite "
                "length above 0",
                names=(f"s{k}",),
            )
        i = row / length
        p = np.cross((0.0, 0.0, 1.0), i)
        p = p / np.linalg.norm(p) if np.linalg.norm(p) > 1e-9 else np.array([0.0, 1.0, 0.0])
        axes.append(Axis(f"s{k}", measures, (i[0], i[1], i[2]), (p[0], p[1], p[2])))
    return Sensor(name, tuple(axes))
