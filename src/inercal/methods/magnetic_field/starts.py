"""Find closed-form starts for a field problem: approximate axes, offset, dip and attitudes.

With T = D⁻¹/B and a centred reading m, the unit vector along the field in the body is T m − c:

* ellipsoid: |T m − c| = 1 is linear in Tᵀ T, which leaves a rotation of T. It is taken from the 24
  turns of a cube: the angle to the upward direction must be the same at all nodes.
* sphere: the same with T = I/radius.
* constant dip: f̂ᵀ(T m − c) + sin δ = 0 is linear in all unknowns.
* rotations: T m_{k+s} − c = Cᵀ (T m_k − c) over s nodes is linear in T and c.

Each finds exchanged or reversed axes without a guess. Readings are centred, because an offset may
be many times as large as the field. Sources: Li and Griffiths 2004 (ellipsoid, without their
constraint); Liu, Liu and Li 2014 (constant dip).

The sign of the field is decided last. (D, δ) and (−D, −δ) fit every recording equally well: the
field is reversed, and with it all axes. The sign of the dip (the hemisphere) decides, or else the
assumption that the magnetometer is right-handed relative to its stated axes. The other fact is then
a test. A wrong sign of the accelerometers has the same effect as a reversed field.
"""
# NumPy types the results of `lstsq` and `inv` too widely.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false

from collections.abc import Iterator

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.methods.magnetic_field.records import FieldConditions, LinearModel
from inercal.methods.magnetic_field.rows import FieldProblem, FieldState
from inercal.physics.frames import exp_so3
from inercal.physics.magnetism import TURNS_OF_CUBE, axis_names, nearest_axes

_FEW = 12  # upward directions, with which several turns must be tried
_FLAT = 1e-9  # volume of axes that lie in a plane, relative to their cubed size
_MOST_STRIDE = 100  # nodes between which rotations are compared


def starts(problem: FieldProblem) -> list[FieldState]:
    """Return the starts that the data allow."""
    centre = problem.nodes.reading.mean(axis=0)
    m = problem.nodes.reading - centre
    size = float(np.sqrt(np.mean(np.sum(m**2, axis=1)))) or 1.0
    result: list[FieldState] = []
    for inverse, c in _inverses(problem, m / size):
        if np.all(np.isfinite(inverse)) and abs(np.linalg.det(inverse)) > 1e-6:
            mat = np.asarray(np.linalg.inv(inverse) * size, dtype=np.float64)
            result.append(_start(problem, mat, centre + mat @ c))
    return result


def _inverses(problem: FieldProblem, m: Array) -> Iterator[tuple[Array, Array]]:
    """Yield T and c for centred readings (n, 3) of size 1."""
    node, up = problem.directions.node, problem.directions.up
    shapes = [_sphere(m)] if len(node) else []
    if len(node) and len(m) > 9 and (found := _ellipsoid(m)) is not None:
        shapes.append(found)
    for inverse, c in shapes:
        unit = m[node] @ inverse.T - c
        heights = np.einsum("ki,tij,kj->tk", up, TURNS_OF_CUBE, unit)
        best = np.argsort(np.var(heights, axis=1))
        for k in best[: 6 if len(node) <= _FEW else 1]:
            yield TURNS_OF_CUBE[k] @ inverse, TURNS_OF_CUBE[k] @ c
    if len(node) > 12:
        yield _constant_dip(m, m[node], up)
    if np.sum(~problem.links.about_up) > 4:
        yield _rotations(problem, m)
    elif not len(node):
        yield _ellipsoid(m) or _sphere(m)


def _sphere(m: Array) -> tuple[Array, Array]:
    found = np.linalg.lstsq(np.column_stack([2 * m, np.ones(len(m))]), np.sum(m**2, 1))[0]
    radius = np.sqrt(max(float(found[3] + found[:3] @ found[:3]), 1e-6))
    return np.eye(3) / radius, found[:3] / radius


def _ellipsoid(m: Array) -> tuple[Array, Array] | None:
    """Return T (symmetric) and c of the algebraic ellipsoid, or None if it does not exist."""
    x, y, z = m.T
    columns = np.column_stack(
        [x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z]
    )
    v = np.linalg.lstsq(columns, np.ones(len(m)))[0]
    shape = np.array([[v[0], v[3], v[4]], [v[3], v[1], v[5]], [v[4], v[5], v[2]]])
    values, vectors = np.linalg.eigh(shape)
    if values[0] <= 1e-9 * abs(values[-1]):
        return None
    centre = -np.linalg.solve(shape, v[6:])
    values = values / (1 + centre @ shape @ centre)
    inverse = vectors * np.sqrt(values) @ vectors.T
    return np.asarray(inverse), np.asarray(inverse @ centre, dtype=np.float64)


def _constant_dip(m: Array, own: Array, up: Array) -> tuple[Array, Array]:
    """Return T and c from the nodes with upward directions; `m` (n, 3) sets the scale."""
    products = (up[:, :, None] * own[:, None, :]).reshape(-1, 9)
    null = np.linalg.svd(np.column_stack([products, -up, np.ones(len(up))]))[2][-1]
    return _scaled(null[:9].reshape(3, 3), null[9:12], m)


def _rotations(problem: FieldProblem, m: Array) -> tuple[Array, Array]:
    """Return T and c from the rotations between nodes, which determine them up to a factor."""
    links = ~problem.links.about_up
    before, step = problem.links.before[links], problem.links.rotation[links]
    n = len(m)
    linked = np.zeros(n, dtype=bool)
    linked[before] = True
    one = np.tile(np.eye(3), (n, 1, 1))
    one[before] = step
    rows: list[Array] = []
    stride = 1
    while stride < min(n, _MOST_STRIDE):
        at = np.flatnonzero(linked[: n - stride])
        back = one[at].mT
        # T (m_after) − Cᵀ T m_before − (1 − Cᵀ) c = 0
        by_inverse = np.einsum("ij,kl->kijl", np.eye(3), m[at + stride])
        by_inverse -= np.einsum("kij,kl->kijl", back, m[at])
        by_c = back - np.eye(3)
        rows.append(np.concatenate([by_inverse.reshape(-1, 3, 9), by_c], axis=2).reshape(-1, 12))
        one = one[:-stride] @ one[stride:]
        linked = linked[:-stride] & linked[stride:]
        stride *= 2
    triangle = np.linalg.qr(np.concatenate(rows), mode="r")
    null = np.linalg.svd(triangle)[2][-1]
    return _scaled(null[:9].reshape(3, 3), null[9:], m)


def _scaled(inverse: Array, c: Array, m: Array) -> tuple[Array, Array]:
    length = float(np.mean(np.linalg.norm(m @ inverse.T - c, axis=1))) or 1.0
    return inverse / length, c / length


def _start(problem: FieldProblem, axes: Array, offset: Array) -> FieldState:
    """Return the state for D B (3, 3) and o (3,)."""
    model, strength = problem.model, problem.strength
    if strength is None:
        strength = float(np.linalg.norm(axes) / np.linalg.norm(model.nominal[:, :3]))
    size = np.array([1.0, 1.0, 1.0, 1 / strength])
    usable = model.powers == 0
    wanted = np.column_stack([axes / strength, offset]) - model.nominal
    columns = (model.directions[usable] * size).reshape(-1, 12).T
    coefficients = np.zeros(len(model.names))
    coefficients[usable] = np.linalg.lstsq(columns, (wanted * size).ravel())[0]
    matrix = model.matrices(coefficients, np.zeros(1))[0]
    if abs(np.linalg.det(matrix[:, :3])) < _FLAT * np.linalg.norm(matrix[:, :3]) ** 3:
        matrix = model.nominal
    unit = np.linalg.solve(matrix[:, :3], (problem.nodes.reading - matrix[:, 3]).T).T
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    dip = 0.0
    if len(problem.directions.node):
        heights = np.sum(unit[problem.directions.node] * problem.directions.up, axis=1)
        dip = float(-np.arcsin(np.clip(np.mean(heights), -0.999, 0.999)))
    known = np.zeros(problem.root.shape[1])
    return FieldState(coefficients, dip, strength, known, _attitudes(problem, unit, dip))


def _attitudes(problem: FieldProblem, unit: Array, dip: float) -> Array:
    """Return the attitudes for the directions of the field in the body, (n, 3)."""
    node, up = problem.directions.node, problem.directions.up
    result = np.zeros((len(unit), 3, 3))
    north = unit[node] - np.sum(unit[node] * up, axis=1, keepdims=True) * up
    north /= np.maximum(np.linalg.norm(north, axis=1, keepdims=True), 1e-12)
    result[node] = np.stack([north, np.cross(up, north), up], axis=1)
    if len(node) == len(unit):
        return result
    done = np.zeros(len(unit), dtype=bool)
    done[node] = True
    field = np.array([np.cos(dip), 0.0, -np.sin(dip)])
    for k in problem.gauges:
        near = np.eye(3) if float(unit[k] @ field) > -0.9 else np.diag([-1.0, 1.0, -1.0])
        result[k], done[k] = _along_field(near, unit[k], field), True
    links = problem.links
    steps = [(k, k + 1, r) for k, r in zip(links.before.tolist(), links.rotation, strict=True)]
    for one, two, rotation in (*steps, *((k, j, r.T) for j, k, r in reversed(steps))):
        if done[one] and not done[two]:
            result[two] = _along_field(result[one] @ rotation, unit[two], field)
            done[two] = True
    return result


def _along_field(near: Array, unit: Array, field: Array) -> Array:
    """Return the attitude nearest to `near` in which the field has the direction `unit`."""
    axis = np.cross(unit, field @ near)
    sine = float(np.linalg.norm(axis))
    if sine == 0:
        return near
    return near @ exp_so3(axis / sine * np.arctan2(sine, unit @ (field @ near)))


_SURE = 3.0  # standard deviations of the dip, below which its sign is unknown
_HALF_TURN = np.diag([-1.0, -1.0, 1.0])


def oriented(
    model: LinearModel, state: FieldState, conditions: FieldConditions, dip_sd: float
) -> tuple[FieldState, tuple[str, ...]]:
    """Return the state with the right sign of the field, and remarks.

    Parameters
    ----------
    model, state, conditions
    dip_sd : float
        Standard uncertainty of the dip, rad; infinite if the dip is not an unknown.

    Raises
    ------
    InputError
        The axes are not the stated ones, or the accelerometers have the wrong sign.
    """
    state = as_found = _principal(state)
    seen = abs(state.dip) > _SURE * dip_sd
    by_dip = seen and conditions.sign != 0
    right = state.dip * conditions.sign > 0 if by_dip else _determinant(model, state) > 0
    if not right:
        state = _mirrored(model, state)
    hemisphere = "northern" if state.dip > 0 else "southern"
    axes = _stated_axes(model, state)
    if _determinant(model, state) < 0:
        if by_dip and np.array_equal(_stated_axes(model, as_found), np.eye(3)):
            found = "northern" if as_found.dip > 0 else "southern"
            raise InputError(
                f"the data fit the magnetometer's stated axes in the {found} hemisphere, but "
                f"[bench] latitude, hemisphere or dip states the {hemisphere} one: check its sign. "
                "If it is right, the accelerometers have the wrong sign (gravity instead of "
                f"specific force), or the axes are wrong{_axes_that_fit(model, axes)}",
                key="[bench] latitude",
            )
        raise InputError(
            f"in the {hemisphere} hemisphere, these data need a magnetometer that is left-handed"
            " relative to its stated axes: an axis is reversed, two axes are exchanged, or the"
            " accelerometers have the wrong sign (gravity instead of specific force)"
            f"{_axes_that_fit(model, axes)}",
            key="axis",
        )
    if not np.array_equal(axes, np.eye(3)):
        other = "" if by_dip else ", or the reverse of all three in the other hemisphere"
        raise InputError(
            f"the magnetometer's axes are not the stated ones{_axes_that_fit(model, axes)}{other}",
            key="axis",
        )
    if by_dip:
        return state, ()
    assumed = "The sign of the field follows from the magnetometer's axes, taken as stated"
    if not np.isfinite(dip_sd):
        return state, (f"{assumed}.",)
    if not seen:
        return state, (f"{assumed}, because the field is too nearly horizontal to show it.",)
    return state, (f"{assumed}; they place the recording in the {hemisphere} hemisphere.",)


def _stated_axes(model: LinearModel, state: FieldState) -> Array:
    """Return the signed permutation from the stated axes to those of the data, (3, 3)."""
    turn = _relative_axes(model, state)
    return nearest_axes(turn / np.linalg.norm(turn, axis=1, keepdims=True))


def _principal(state: FieldState) -> FieldState:
    """Return the same state with a dip between −90° and 90°."""
    dip = float(np.arctan2(np.sin(state.dip), np.cos(state.dip)))
    if abs(dip) <= np.pi / 2:
        return state._replace(dip=dip)
    dip = float(np.copysign(np.pi, dip) - dip)
    return state._replace(dip=dip, attitude=_HALF_TURN @ state.attitude)


def _mirrored(model: LinearModel, state: FieldState) -> FieldState:
    """Return the state with the reversed field."""
    e = model.scale_direction
    coefficients = np.where(model.acts_on_field, -state.coefficients - 2 * e, state.coefficients)
    # −h has the same height with the opposite sign, and its azimuth is turned by 180°.
    return state._replace(
        coefficients=coefficients, dip=-state.dip, attitude=_HALF_TURN @ state.attitude
    )


def _relative_axes(model: LinearModel, state: FieldState) -> Array:
    matrix = model.matrices(state.coefficients, np.zeros(1))[0, :, :3]
    return matrix @ np.linalg.inv(model.nominal[:, :3])


def _determinant(model: LinearModel, state: FieldState) -> float:
    return float(np.linalg.det(_relative_axes(model, state)))


def _axes_that_fit(model: LinearModel, axes: Array) -> str:
    """Return words for the axes that fit, if the stated axes are those of the body."""
    stated = model.nominal[:, :3] / np.linalg.norm(model.nominal[:, :3], axis=1, keepdims=True)
    rows: Array = np.asarray(np.round(axes @ stated, 6), dtype=np.float64)
    if not np.all(np.isin(rows, (-1.0, 0.0, 1.0))):
        return ""
    names = ", ".join(f'"{name}"' for name in axis_names(rows))
    return f"; axis = [{names}] fits"
