"""Attitude and motion of a body on a turntable, exactly and to first order.

C and the readback are defined in `inercal.benches.turntable.bench`. u_i are the directions of the
axes in the body, θ̇_i their rates, Ω is the earth's rate and r the lever arm. With all vectors in
the body frame::

    ω = Cᵀ Ω + v,   v = Σ θ̇_i u_i,   u̇_i = u_i × Σ_{j>i} θ̇_j u_j
    ω̇ = (Cᵀ Ω) × v + Σ θ̈_i u_i + θ̇_i u̇_i
    f = g Cᵀ e_up + ω̇ × r + ω × (ω × r)

so f includes the Euler and centripetal accelerations and the earth's Coriolis acceleration. Gravity
at r is assumed to be equal to gravity at the intersection of the axes; its gradient, 3 µm/s² per
metre, is neglected.

Errors of the table rotate the attitude by a rotation vector in the level frame::

    C ≈ exp(Σ_j B_j β_j) C_ref,   C_ref from the readback, no lean, right angles

For a lean, an azimuth or a right angle, B is the unit vector of the rotation. For harmonics, B is
the axis' direction times −sin(hθ) or −cos(hθ), because the axis has turned less than a readback
that is too large.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parameters import Parameter
from inercal.benches.turntable.bench import Turntable
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.frames import stack_components
from inercal.physics.motion import Motion

_BLOCK = 1 << 15  # samples


@dataclass(frozen=True, eq=False)
class Misalignment:
    """The misalignment of the true attitude relative to the attitude from the readback.

    Parameters
    ----------
    parameters : tuple of q Parameter
        Leans, azimuth, right angles and harmonics. For the azimuth, β is its error.
    by : (..., n, 3, q) array
        Derivative of the rotation vector in the level frame with respect to each parameter,
        rad/rad.
    """

    parameters: tuple[Parameter, ...]
    by: Array


def reference_attitude(bench: Turntable, angles: Array) -> Array:
    """Return the attitude, body to level, that follows from the readback.

    Parameters
    ----------
    bench : Turntable
    angles : (..., n, k) array
        Readback of the k axes, outermost first, rad.

    Returns
    -------
    (..., n, 3, 3) array
        Rotation matrix mat_nb from the body to the level frame n.

    Raises
    ------
    InputError
        The angles are for another number of axes.
    """
    return true_attitude(bench, _without_known_harmonics(bench, angles), {})


def _without_known_harmonics(bench: Turntable, angles: Array) -> Array:
    """Return the readback (..., n, k) minus its qualified harmonics, to first order."""
    if not any(name.startswith(("sin", "cos")) for name in bench.qualified.names):
        return angles
    known = ideal_readback(bench, angles, {})
    return 2 * np.asarray(angles, dtype=float) - known


def true_attitude(bench: Turntable, angles: Array, q: Mapping[str, Array]) -> Array:
    """Return the true attitude, body to level, mat_nb, (..., n, 3, 3).

    Parameters
    ----------
    bench : Turntable
    angles : (..., n, k) array
        True angles, outermost axis first, rad.
    q : mapping of str to (...) array
        The bench's parameters, SI, by name. A missing parameter keeps its stated value.

    Raises
    ------
    InputError
        The angles are for another number of axes.
    """
    return _attitude_and_axes(bench, angles, q)[0]


def ideal_readback(bench: Turntable, angles: Array, q: Mapping[str, Array]) -> Array:
    """Return the readback for true angles (..., n, k), rad, without noise and delay."""
    angles = _checked_angles(bench, angles)
    zero = np.zeros(())
    columns: list[Array] = []
    for i, name in enumerate(bench.names):
        reading = theta = angles[..., i]
        for h in range(1, len(bench.harmonics) + 1):
            for wave, function in (("sin", np.sin), ("cos", np.cos)):
                full = f"{wave}{h}[{name}]"
                amplitude = np.asarray(q.get(full, zero)) + bench.correction(full)
                reading = reading + amplitude[..., None] * function(h * theta)
        columns.append(reading)
    return stack_components(*columns)


def linear_misalignment(bench: Turntable, angles: Array) -> Misalignment:
    """Return the first-order rotation of the attitude by each parameter, at readback angles.

    Parameters
    ----------
    bench : Turntable
    angles : (..., n, k) array
        Readback, outermost axis first, rad.

    Raises
    ------
    InputError
        The angles are for another number of axes.
    """
    angles = _checked_angles(bench, angles)
    east, north, up = np.eye(3)
    by: dict[str, Array] = {"lean_x": east, "lean_y": north, "azimuth": -up}
    mat = _base_attitude(bench, {})
    letters = ["xyz".index(a) for a in bench.axes]
    between = [*_orthogonal_axes(bench), None]
    for i, (name, axis, third) in enumerate(zip(bench.names, letters, between, strict=True)):
        mat = mat @ _axis_rotation(axis, angles[..., i])
        along = mat[..., axis]
        for h in range(1, len(bench.harmonics) + 1):
            phase = h * angles[..., i, None]
            by[f"sin{h}[{name}]"] = -np.sin(phase) * along
            by[f"cos{h}[{name}]"] = -np.cos(phase) * along
        if third is not None:
            by[f"square_{i + 1}"] = mat[..., third]
    parameters = tuple(p for p in bench.parameters if p.name in by)
    result = np.empty((*angles.shape[:-1], 3, len(parameters)))
    for k, p in enumerate(parameters):
        result[..., k] = by[p.name]
    return Misalignment(parameters, result)


def motion(
    bench: Turntable, angles: Array, rates: Array, accelerations: Array, q: Mapping[str, Array]
) -> Motion:
    """Return the exact f, ω and derivative of ω at the IMU's centre, (..., n, 3) each.

    Parameters
    ----------
    bench : Turntable
    angles, rates, accelerations : (..., n, k) arrays
        True motion of the axes, outermost first, in rad, rad/s and rad/s².
    q : mapping of str to (...) array
        The bench's parameters, SI, by name. A missing parameter keeps its stated value.

    Raises
    ------
    InputError
        The angles are for another number of axes.
    """
    mat, axes = _attitude_and_axes(bench, angles, q)
    up, north = earth_rate_up_north(bench.latitude)
    earth = north * mat[..., 1, :] + up * mat[..., 2, :]
    v, dv = np.zeros_like(earth), np.zeros_like(earth)
    for i in reversed(range(len(bench.axes))):  # v is the rate of the axes inside the i-th
        u = np.moveaxis(axes[i], 0, -1)
        dv = dv + accelerations[..., i, None] * u + rates[..., i, None] * _cross(u, v)
        v = v + rates[..., i, None] * u
    w, dw = earth + v, _cross(earth, v) + dv
    f = _parameter_value(bench, q, "g")[..., None, None] * mat[..., 2, :]
    arms = (_parameter_value(bench, q, f"lever_{a}") for a in "xyz")
    lever = stack_components(*arms)[..., None, :]
    if lever.any():
        f = f + _cross(dw, lever) + _cross(w, _cross(w, lever))
    return Motion(f, w, dw)


def body_rates(bench: Turntable, angles: Array, rates: Array) -> Array:
    """Return ω for the stated values of the bench, (n, 3) rad/s, computed block by block.

    Parameters
    ----------
    bench : Turntable
    angles, rates : (n, k) arrays
        The same as for `motion`.
    """
    result = np.empty((len(angles), 3))
    up, north = earth_rate_up_north(bench.latitude)
    for start in range(0, len(angles), _BLOCK):
        part = slice(start, start + _BLOCK)
        rows, axes = _attitude_rows_and_axes(bench, angles[part], {})
        turning = np.zeros((3, 1))
        for u, rate in zip(axes[::-1], rates[part].T[::-1], strict=True):
            turning = turning + rate * u.reshape(3, -1)
        result[part] = (north * rows[1] + up * rows[2] + turning).T
    return result


def axis_directions(bench: Turntable, angles: Array) -> Array:
    """Return the axes' unit vectors in the body, (n, k, 3), for the stated values of the bench.

    Parameters
    ----------
    bench : Turntable
    angles : (n, k) array
        The same as for `motion`.
    """
    axes = _attitude_and_axes(bench, angles, {})[1]
    return np.stack([np.broadcast_to(u.T, (len(angles), 3)) for u in axes], axis=1)


def _attitude_and_axes(
    bench: Turntable, angles: Array, q: Mapping[str, Array]
) -> tuple[Array, list[Array]]:
    """Return the attitude, (..., n, 3, 3), and each axis' direction in the body, (3, ..., n)."""
    rows, axes = _attitude_rows_and_axes(bench, angles, q)
    return np.ascontiguousarray(np.moveaxis(rows, (0, 1), (-2, -1))), axes


def _attitude_rows_and_axes(
    bench: Turntable, angles: Array, q: Mapping[str, Array]
) -> tuple[Array, list[Array]]:
    """Return the same as `_attitude_and_axes`, but the attitude as (3, 3, ..., n)."""
    angles = _checked_angles(bench, angles)
    letters = ["xyz".index(a) for a in bench.axes]
    # The rotation of the axes inside the i-th, (3, 3, ..., n). NumPy would take twice as long for
    # products of n small matrices.
    within: Array = np.eye(3)
    axes: list[Array] = []
    for i in reversed(range(len(letters))):
        if i + 1 < len(letters):
            third, size = _orthogonal_axes(bench)[i], _parameter_value(bench, q, f"square_{i + 1}")
            if size.any():
                within = _rotated(third, size[..., None], within)
        axes.append(within[letters[i]])
        within = _rotated(letters[i], angles[..., i], within)
    base = np.moveaxis(_base_attitude(bench, q), (-2, -1), (0, 1))
    if not np.array_equal(base[..., 0], np.eye(3)):
        within = _with_dimensions(within, base.ndim)
        base = _with_dimensions(base, within.ndim)
        rows = [b[0] * within[0] + b[1] * within[1] + b[2] * within[2] for b in base]
        within = np.stack(rows)
    return within, axes[::-1]


def _base_attitude(bench: Turntable, q: Mapping[str, Array]) -> Array:
    """Return T, (..., 1, 3, 3)."""
    return _tilted_base(bench, q) if q else _declared_base(bench)


@lru_cache(maxsize=16)
def _declared_base(bench: Turntable) -> Array:
    """Return T for the stated values of the bench, as a read-only array."""
    result = _tilted_base(bench, {})
    result.setflags(write=False)
    return result


def _tilted_base(bench: Turntable, q: Mapping[str, Array]) -> Array:
    x, y, azimuth = (_parameter_value(bench, q, name) for name in ("lean_x", "lean_y", "azimuth"))
    return (_axis_rotation(0, x) @ _axis_rotation(1, y) @ _axis_rotation(2, -azimuth))[
        ..., None, :, :
    ]


def _orthogonal_axes(bench: Turntable) -> list[int]:
    """Return, for each pair of neighbouring axes, the third axis, about which their error acts."""
    return [3 - "xyz".index(a) - "xyz".index(b) for a, b in pairwise(bench.axes)]


def _parameter_value(bench: Turntable, q: Mapping[str, Array], name: str) -> Array:
    value = q[name] if name in q else bench.acting_parameters()[name].value
    return np.asarray(value, dtype=float) + bench.correction(name)


def _axis_rotation(axis: int, angle: ArrayLike) -> Array:
    """Return rotations by angles (...) about one axis, (..., 3, 3)."""
    angle = np.asarray(angle, dtype=float)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    mat = np.zeros((*angle.shape, 3, 3))
    mat[..., axis, axis] = 1
    mat[..., j, j] = mat[..., k, k] = np.cos(angle)
    mat[..., k, j] = np.sin(angle)
    mat[..., j, k] = -mat[..., k, j]
    return mat


def _rotated(axis: int, angle: Array, mat: Array) -> Array:
    """Rotate matrices, (3, 3, ...), by angles (...) about one axis."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine, mat = np.cos(angle), np.sin(angle), _with_dimensions(mat, 2 + angle.ndim)
    result = np.empty(np.broadcast_shapes((3, 3, *angle.shape), mat.shape))
    result[axis] = mat[axis]
    result[j] = cosine * mat[j] - sine * mat[k]
    result[k] = sine * mat[j] + cosine * mat[k]
    return result


def _with_dimensions(mat: Array, dimensions: int) -> Array:
    """Return matrices (3, 3, ...) with at least this many dimensions, for broadcasting."""
    return mat.reshape(3, 3, *[1] * (dimensions - mat.ndim), *mat.shape[2:])


def _cross(a: Array, b: Array) -> Array:
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _checked_angles(bench: Turntable, angles: Array) -> Array:
    angles = np.asarray(angles, dtype=float)
    k = len(bench.axes)
    if angles.shape[-1:] != (k,):
        raise InputError(
            f"turntable: angles has the shape {angles.shape}; {k} axes need the shape (..., {k})",
            key="angles",
        )
    return angles


def earth_rate_level_frame(bench: Turntable) -> Array:
    """Return the earth's rate in the level frame, (3,) rad/s."""
    up, north = earth_rate_up_north(bench.latitude)
    return np.array([0.0, north, up])
