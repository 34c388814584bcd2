"""Rotations of the triad: what no norm sees, and the gauge that takes its place.

With the input axes h_i every norm stays as it is under h_i → R h_i. Of the six misalignments three
combinations are therefore free: a rotation by ρ turns axis i about its O by ρ·O_i and about its P
by ρ·P_i. Their sums over the axes are zero where the matrix of the misalignments is symmetric.
"""

from collections.abc import Sequence

import numpy as np

from inercal.arrays import Array
from inercal.errors import InputError, NotObserved
from inercal.estimate import Gauge, Gaussian
from inercal.keys import CoefficientName
from inercal.sensors import Sensor

_ROTATION = "rotation of the triad"


def require_gauge(sensor: Sensor, priors: Sequence[Gaussian]) -> None:
    """Refuse rotations of the triad: no norm sees them.

    In the reference form they show through the nonlinear terms alone, which bend along other axes;
    that is not a measurement of an angle, and it is not taken for one.

    Raises
    ------
    NotObserved
        Naming the rotations and the misalignments.
    """
    if sensor.frame == "symmetric":
        return
    told = {name for prior in priors for name in prior.names}
    free = [
        (axis, names)
        for axis, names in zip("xyz", _rotations(sensor), strict=True)
        if len(names) > 1 and set(names) <= set(sensor.coefficients) and not set(names) & told
    ]
    if free:
        words = tuple(f"{_ROTATION} about {axis} ({' + '.join(names)})" for axis, names in free)
        raise NotObserved(
            f"norms see no {'; no '.join(words)}: choose nonorthogonality, "
            'or state the frame, [sensor] frame = "symmetric", or give a prior',
            words,
        )


def _rotations(sensor: Sensor) -> list[list[str]]:
    """Return the misalignments that a rotation of the triad about x, y and z consists of."""
    return [
        [
            f"{axis.name}.{name}"
            for axis in sensor.axes
            for name, about in (("delta_o", axis.frame[2]), ("delta_p", axis.frame[1]))
            if abs(about[k]) > 1 - 1e-9
        ]
        for k in range(3)
    ]


def _rotation_rows(sensor: Sensor, p: int) -> Array:
    """Return the misalignments of a rotation about x, y and z, one row each, (3, p)."""
    rows = np.zeros((3, p))
    for axis in sensor.axes:
        for name, about in (("delta_o", axis.frame[2]), ("delta_p", axis.frame[1])):
            full = f"{axis.name}.{name}"
            if full in sensor.coefficients:
                rows[:, sensor.coefficients.index(full)] = about
    return rows


def rotation_null_directions(sensor: Sensor, size: int) -> tuple[tuple[str, Array], ...]:
    """Return the rotations of the triad among `size` parameters, for reports."""
    rows = _rotation_rows(sensor, size)
    return ((_ROTATION, rows),) if np.linalg.matrix_rank(rows) == 3 else ()


def gauges(sensor: Sensor) -> tuple[Gauge, ...]:
    """Return the gauge that makes the matrix of the misalignments symmetric, where it is asked.

    Raises
    ------
    InputError
        Asked for without all of the misalignments.
    """
    if sensor.frame != "symmetric":
        return ()
    names = tuple(
        n for n in sensor.coefficients if CoefficientName(n).term in ("delta_o", "delta_p")
    )
    if len(names) < 2 * len(sensor.axes):
        raise InputError(
            'frame "symmetric" takes all misalignments of the triad: choose misalignment, or leave '
            "the frame out"
        )
    rows = _rotation_rows(sensor, len(sensor.coefficients))
    columns = [sensor.coefficients.index(name) for name in names]
    return (Gauge("symmetric misalignments", names, rows[:, columns], np.zeros(3)),)
