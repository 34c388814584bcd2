"""Construct common sensors: single axis, pair, triad, IMU and redundant cluster."""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.physics.quantities import Measures
from inercal.physics.sensors.axis import Axis, Noise, Readout, case_letters
from inercal.physics.sensors.sensor import Sensor

# I and P of x, y, z: cyclic, so that O completes the frame (x → xyz, y → yzx, z → zxy)
CYCLIC_AXES = {
    "x": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "y": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "z": ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
}


Direction = str | Sequence[float]
"""A direction in the case: "x", "-z", or three numbers."""


def axes_along(
    directions: Sequence[Direction],
    measures: Measures = "f",
    prefix: str = "",
    readout: Readout = Readout(),
    noise: Noise = Noise(),
) -> tuple[Axis, ...]:
    """Return axes along the given directions in the sensor's frame.

    Axes along different case axes are named after them, like those of a triad. Otherwise they are
    numbered from 1.

    Parameters
    ----------
    directions : sequence of str or of 3 floats
        Case axes such as "z" or "-x", or vectors of any length.
    measures : "f" or "w"
    prefix : str
        First part of the names.
    readout, noise
        Readout and noise of each axis.

    Raises
    ------
    InputError
        A direction is not a case axis or a finite vector that is not zero.

    Examples
    --------
    >>> [axis.name for axis in axes_along(["-z", "x"], "w", "g")]
    ['gz', 'gx']
    >>> [axis.name for axis in axes_along(["x", "x"], "w", "g")]
    ['g1', 'g2']
    """
    frames = [_input_and_pendulous(one, f"{prefix}{k}") for k, one in enumerate(directions, 1)]
    letters = case_letters(np.abs([i for i, _ in frames]).reshape(-1, 3))
    return tuple(
        Axis(prefix + (letters[k] if letters else str(k + 1)), measures, i, p, readout, noise)
        for k, (i, p) in enumerate(frames)
    )


def _input_and_pendulous(
    direction: Direction, name: str
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return I and P, unit vectors; P is horizontal unless I is along a case axis."""
    if isinstance(direction, str):
        found = CYCLIC_AXES.get(direction[-1:])
        if found is None or direction[:-1] not in ("", "+", "-"):
            raise InputError(
                f"axis {name} has direction {direction!r}; give x, y, z, -x, -y or -z, or three "
                "numbers",
                names=(name,),
            )
        (x, y, z), pendulous = found
        return ((-x, -y, -z) if direction[0] == "-" else (x, y, z)), pendulous
    given = np.asarray(direction, dtype=float)
    length = np.linalg.norm(given)
    if given.shape != (3,) or not np.isfinite(length) or length == 0:
        raise InputError(
            f"axis {name} has direction {given.tolist()}; give three finite numbers that are not "
            "all 0",
            names=(name,),
        )
    i: Array = given / length
    for letter, (along, _) in CYCLIC_AXES.items():
        if abs(i @ along) == 1:
            return _input_and_pendulous(("-" if i @ along < 0 else "") + letter, name)
    p = np.cross((0.0, 0.0, 1.0), i)
    p /= np.linalg.norm(p)
    return (i[0], i[1], i[2]), (p[0], p[1], p[2])


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
    return Sensor(name, axes_along("xyz", measures, prefix, readout, noise))


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


def cluster(
    name: str, input_axes: Sequence[Direction], measures: Measures = "f", prefix: str = "s"
) -> Sensor:
    """Return a redundant cluster, with axes in the given directions; see `axes_along`.

    Raises
    ------
    InputError
        A direction is not a case axis or a finite vector that is not zero.
    """
    return Sensor(name, axes_along(input_axes, measures, prefix))
