"""Fix the rotations of the triad by a gauge, because norms do not observe them.

Norms do not change when the input axes h_i are rotated, h_i → R h_i. Three combinations of the six
misalignments are therefore free. A rotation by ρ turns axis i about its O axis by ρ·O_i and about
its P axis by ρ·P_i. If the matrix of misalignments is symmetric, the sums of these angles over the
axes are zero.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.keys import CoefficientName
from inercal.estimation import Gauge
from inercal.methods import Priors
from inercal.physics.sensors import Sensor

_ROTATION = "rotation of the triad"


def require_gauge(sensor: Sensor, priors: Priors) -> None:
    """Raise NotObserved if rotations of the triad are free, because norms do not observe them.

    In the reference form the rotations act on norms only through the nonlinear terms, which then
    act along other axes. This effect does not count as a measurement of the rotation.

    Raises
    ------
    NotObserved
        Rotations are free; the message names them and the misalignments.
    """
    if sensor.frame == "symmetric":
        return
    known = {name for prior in priors for name in prior.names}
    free: dict[str, list[str]] = {}
    for k, axis in enumerate("xyz"):
        names = [n for n, about in _misalignment_axes(sensor).items() if abs(about[k]) > 1 - 1e-9]
        if len(names) > 1 and set(names) <= set(sensor.coefficients) and not set(names) & known:
            free[f"{_ROTATION} about {axis} ({' + '.join(names)})"] = names
    if free:
        raise NotObserved(
            f"the norms do not determine the {'; the '.join(free)}; choose nonorthogonality, "
            'set [sensor] frame = "symmetric", or give a prior',
            tuple(free),
            names=tuple(name for names in free.values() for name in names),
        )


def _misalignment_axes(sensor: Sensor) -> dict[str, Array]:
    """Return the rotation axis of each misalignment, (3,), by full name."""
    return {
        f"{axis.name}.{term}": axis.frame[row]
        for axis in sensor.axes
        for term, row in (("delta_o", 2), ("delta_p", 1))
    }


def _rotation_rows(sensor: Sensor, p: int) -> Array:
    """Return the misalignments that correspond to rotations about x, y and z, (3, p)."""
    rows = np.zeros((3, p))
    for name, about in _misalignment_axes(sensor).items():
        if name in sensor.coefficients:
            rows[:, sensor.coefficients.index(name)] = about
    return rows


def rotation_null_directions(sensor: Sensor, size: int) -> tuple[tuple[str, Array], ...]:
    """Return the triad's rotations as directions among `size` parameters, for reports."""
    rows = _rotation_rows(sensor, size)
    return ((_ROTATION, rows),) if np.linalg.matrix_rank(rows) == 3 else ()


def gauges(sensor: Sensor) -> tuple[Gauge, ...]:
    """Return the gauge that makes the misalignment matrix symmetric, for the symmetric frame only.

    Raises
    ------
    InputError
        The sensor uses the symmetric frame, but some misalignments are not selected.
    """
    if sensor.frame != "symmetric":
        return ()
    names = tuple(
        n for n in sensor.coefficients if CoefficientName(n).term in ("delta_o", "delta_p")
    )
    if len(names) < 2 * len(sensor.axes):
        raise InputError(
            '[sensor] frame = "symmetric" needs all misalignments of the triad; choose '
            "misalignment, or remove the frame",
            key="[sensor] frame",
            names=tuple(n for n in _misalignment_axes(sensor) if n not in names),
        )
    rows = _rotation_rows(sensor, len(sensor.coefficients))
    columns = [sensor.coefficients.index(name) for name in names]
    return (Gauge("symmetric misalignments", names, rows[:, columns], np.zeros(3)),)
