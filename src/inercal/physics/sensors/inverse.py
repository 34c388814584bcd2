"""Compute the sensed motion from readings by Newton's method on the exact model.

The axes of all kinds are solved together; more than three axes of one kind are solved by least
squares. An affine model needs only one matrix; other models iterate over chunks of samples, so that
memory stays bounded. Matrices of 3 × 3 are solved in closed form, with cofactors, because for many
small matrices LAPACK spends more time on call overhead than on arithmetic.
"""

from functools import lru_cache

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotInvertible
from inercal.physics.motion import Motion
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors.axis import Axis
from inercal.physics.sensors.sensor import Sensor

_CHUNK = 1 << 16  # samples per chunk, so that a chunk's slopes fit in the outer cache levels
_MAX_STEPS = 40
_SETTLED = 1e-9  # step size relative to the motion; the remaining error is about its square
SINGULAR_TEXT = "with these coefficients the readings do not depend on the motion in some direction"


def inverse(
    sensor: Sensor,
    y: Array,
    c: Array,
    *,
    f: Array | None = None,
    w: Array | None = None,
    m: Array | None = None,
    dw: Array | None = None,
    dT: Array | float = 0.0,
    dTdt: Array | float = 0.0,
    refuse: bool = True,
) -> Motion:
    """Return the motion that produces the readings `y`.

    Parameters
    ----------
    sensor : Sensor
    y : (..., n, m) array
        Readings in SI units (after the nominal readout).
    c : (..., p) array
        Coefficients in SI units, in the order of `sensor.coefficients`.
    f, w, m : (..., n, 3) arrays, optional
        Motion that the sensor does not measure. If there are fewer than three independent input
        axes of a kind, the components perpendicular to them are taken from here, and those along
        them are ignored. By default the motion of a kind that the sensor has no axes for is zero.
    dw : (..., n, 3) array, optional
        Angular acceleration, rad/s², needed if lever arms are modelled.
    dT : (..., n) array or float
        Temperature minus the reference temperature, K.
    dTdt : (..., n) array or float
        Its time derivative, K/s.
    refuse : bool
        Whether to raise an error for readings beyond the model's fold; otherwise they give NaN,
        which an optimiser needs.

    Raises
    ------
    InputError
        There are only one or two input axes of a kind, and the components perpendicular to them are
        missing.
    NotInvertible
        A reading is beyond the model's fold, where no unique motion exists.
    """
    basis = sensor.sensed.basis
    stated = (f, w, m)[: sensor.width // 3]
    for quantity, given in zip(QUANTITIES.values(), stated, strict=False):
        rank = sensor.rank(quantity.symbol)
        if 0 < rank < 3 and given is None:
            raise InputError(
                f"sensor {sensor.name} has {rank} independent input axis directions for "
                f"{quantity.name}: pass the components perpendicular to them as "
                f"{quantity.symbol}, or zeros if there are none",
                key=quantity.symbol,
            )
    shape = (*y.shape[:-1], 3)
    zero = np.zeros((1, 3))
    across = np.concatenate(
        [np.broadcast_to(zero if v is None else v, shape) for v in stated], axis=-1
    )
    across = across - (across @ basis) @ basis.T
    rates = np.broadcast_to(zero if dw is None else dw, shape)
    thermal = tuple(np.broadcast_to(np.asarray(t, dtype=float), shape[:-1]) for t in (dT, dTdt))
    if sensor.affine:
        sensed = across + _affine(sensor, y, c, across, basis) @ basis.T
    else:
        lead = np.broadcast_shapes(y.shape[:-2], c.shape[:-1])
        sensed = np.empty((*lead, y.shape[-2], sensor.width))
        for start in range(0, y.shape[-2], _CHUNK):
            part = np.s_[..., start : start + _CHUNK, :]
            thermal_part = tuple(t[..., start : start + _CHUNK] for t in thermal)
            sensed[part] = _newton(
                sensor, y[part], c, across[part], rates[part], thermal_part, basis, start, refuse
            )
    return _motion(sensed, np.asarray(rates), thermal)


@lru_cache  # because the sensors of a line have the same axes
def nominal_inverse(axes: tuple[Axis, ...]) -> Array:
    """Return the matrix from readings without errors to the motion, (m, width).

    The rows of a product y @ matrix are (f, ω), or (f, ω, m) if there are magnetometers.

    Raises
    ------
    InputError
        There are only one or two input axes of a kind.
    """
    sensor = Sensor("with these axes", axes)
    motion = inverse(sensor, np.eye(len(axes)), np.zeros(0))
    return np.concatenate([motion.f, motion.w, motion.m][: sensor.width // 3], axis=1)


def _motion(sensed: Array, rates: Array, thermal: tuple[Array, ...]) -> Motion:
    """Return the motion with the temperature difference and rate given in `thermal`."""
    field = {"m": sensed[..., 6:]} if sensed.shape[-1] > len("fw") * 3 else {}
    return Motion(sensed[..., :3], sensed[..., 3:6], rates, *thermal, **field)


def _solve(slope: Array, right: Array) -> Array:
    """Return the Newton step, by least squares if there are more axes than unknowns."""
    if slope.shape[-2] > slope.shape[-1]:
        transposed = np.swapaxes(slope, -1, -2)
        slope, right = transposed @ slope, (transposed @ right[..., None])[..., 0]
    if slope.shape[-1] == 3:
        x = solve(slope, right)
        if not np.isfinite(x).all() and (determinant(slope) == 0).any():
            raise NotInvertible(SINGULAR_TEXT)
        return x
    try:
        return np.linalg.solve(slope, right[..., None])[..., 0].astype(np.float64, copy=False)
    except np.linalg.LinAlgError:
        raise NotInvertible(SINGULAR_TEXT) from None


def _affine(sensor: Sensor, y: Array, c: Array, across: Array, basis: Array) -> Array:
    slope = (sensor.slope(Motion(np.zeros((1, 3))), c) @ basis)[..., 0, :, :]
    if (np.linalg.matrix_rank(slope) < basis.shape[1]).any():
        raise NotInvertible(f"sensor {sensor.name}: {SINGULAR_TEXT}")
    offset = sensor.forward(_motion(across, np.zeros((1, 3)), ()), c)
    back = np.asarray(np.linalg.pinv(slope), dtype=np.float64)
    return (y - offset) @ np.swapaxes(back, -1, -2)


def _newton(
    sensor: Sensor,
    y: Array,
    c: Array,
    across: Array,
    rates: Array,
    thermal: tuple[Array, ...],
    basis: Array,
    first: int,
    refuse: bool,
) -> Array:
    """Return (f, ω, m), (..., n, width), for a chunk that starts at sample `first`."""
    origin = _motion(across, rates, thermal)
    reading, slope = sensor.reading_and_slope(origin, c)
    at_origin = slope @ basis
    x = _solve(at_origin, y - reading)
    size = np.abs(x).max(axis=-1, keepdims=True) + np.finfo(float).tiny
    step = np.full_like(x, np.inf)
    for _ in range(_MAX_STEPS):
        motion = _motion(across + x @ basis.T, rates, thermal)
        reading, slope = sensor.reading_and_slope(motion, c)
        new = _solve(slope @ basis, y - reading)
        settled = np.abs(new) <= _SETTLED * size
        x, step = x + new, new
        if settled.all():
            break
    # A bias asymmetry leaves a gap at zero: no motion gives a reading inside it, and the steps
    # alternate between its two sides. Zero motion, which lies between them, is the nearest.
    alternating = (
        (np.abs(step) > _SETTLED * size)
        & (np.abs(step) <= _asymmetry_gap(sensor, c))
        & (x * (x - step) < 0)
    )
    x = np.where(alternating, 0.0, x)
    step = np.where(alternating.any(-1, keepdims=True), 0.0, step)
    motion = _motion(across + x @ basis.T, rates, thermal)
    slope = sensor.slope(motion, c) @ basis
    unsettled = (np.abs(step) > _SETTLED * size).any(axis=-1)
    folded = np.sign(_determinant(slope)) * np.sign(_determinant(at_origin)) <= 0
    bad = unsettled | folded
    if not refuse:
        x = np.where(bad[..., None], np.nan, x)
    elif bad.any():
        row = int(np.flatnonzero(bad.any(axis=tuple(range(bad.ndim - 1))))[0])
        worst = y[..., row, :].reshape(-1, y.shape[-1])[0]
        raise NotInvertible(
            f"sensor {sensor.name}: the model cannot be inverted at sample {first + row}: for the "
            f"reading {np.array2string(worst, precision=4)} (SI) no unique motion exists; check "
            "the unit of the reading and the nonlinear coefficients"
        )
    return across + x @ basis.T


def _asymmetry_gap(sensor: Sensor, c: Array) -> Array | float:
    """Return an upper bound for the gap that bias asymmetries leave at zero, (..., 1, 1), SI."""
    jumps = [c[..., k] for k, n in enumerate(sensor.coefficients) if n.endswith(".k0_prime")]
    return 2 * np.abs(np.stack(jumps, -1)).max(-1)[..., None, None] if jumps else 0.0


def _determinant(slope: Array) -> Array:
    square = slope.shape[-2] == slope.shape[-1]
    matrix = slope if square else np.swapaxes(slope, -1, -2) @ slope
    return determinant(matrix) if matrix.shape[-1] == 3 else np.linalg.det(matrix)


# The next index in the cycle 0, 1, 2, and the index after it.
_ROW, _COLUMN = np.indices((3, 3))
_ROW_1, _ROW_2 = (_ROW + 1) % 3, (_ROW + 2) % 3
_COLUMN_1, _COLUMN_2 = (_COLUMN + 1) % 3, (_COLUMN + 2) % 3


def _cofactors(matrix: Array) -> tuple[Array, Array]:
    """Return the cofactors, (3, 3, ...), and the determinant, (...)."""
    m = np.moveaxis(matrix, (-2, -1), (0, 1))
    cofactors = m[_ROW_1, _COLUMN_1] * m[_ROW_2, _COLUMN_2]
    cofactors -= m[_ROW_1, _COLUMN_2] * m[_ROW_2, _COLUMN_1]
    return cofactors, (m[0] * cofactors[0]).sum(axis=0)


def determinant(matrix: Array) -> Array:
    """Return the determinant, (...), of a matrix (..., 3, 3)."""
    m = np.moveaxis(matrix, (-2, -1), (0, 1))
    return (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        + m[0, 1] * (m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )


def solve(matrix: Array, right: Array) -> Array:
    """Solve matrix (..., 3, 3) · x = right (..., 3); x is not finite if the matrix is singular."""
    cofactors, size = _cofactors(matrix)
    b = np.moveaxis(right, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (cofactors * b[:, None]).sum(axis=0) / size
    return np.ascontiguousarray(np.moveaxis(x, 0, -1))


def invert(matrix: Array) -> Array:
    """Return the inverse, (..., 3, 3), which is not finite where the matrix is singular."""
    cofactors, size = _cofactors(matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        cofactors /= size
    return np.ascontiguousarray(np.moveaxis(cofactors, (0, 1), (-1, -2)))
