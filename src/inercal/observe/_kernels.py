"""Compiled: norms of the specific force of many trials, by a triad whose terms are in a table.

Reading i is y = a + Σ c φ, with a = d·f along the (tilted) axis and φ products of a, of the
components along P and O, and of ΔT. With S = ∂y/∂f, û = f̂/‖f̂‖ and b = ûᵀ S⁻¹::

    ∂‖f̂‖/∂y = b,   ∂‖f̂‖/∂c = −Σ bᵢ ∂yᵢ/∂c,   var ‖f̂‖ = b C bᵀ

f̂ is the root that `inercal.sensors.inverse` finds, by Newton's method from the linear part; slopes
of reversed sign are beyond the fold. Where all products are of a alone, each axis is inverted by
itself and f̂ = D⁻¹ a with D the directions d; otherwise the three are solved together.

The rows of a trial lie side by side in the innermost axis. A loop over rows writes one or two
arrays from few: the compiler then proves that they do not overlap, and vectorises the loop. Spare
rows, up to a multiple of `_WIDTH`, repeat the last one with weight zero.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.observe.term_table import ALONG, OTHER, TermTable

Bools = NDArray[np.bool_]
Indices = NDArray[np.int64]

_WIDTH = 16
_MAX_STEPS, _TINY = 40, 2.0**-1022
# Of the last step, relative to the force: the error left is of the order of its square.
_SETTLED = 1e-9


class _Model(NamedTuple):
    """The model of a trial: y = a + Σ k φ(a) + e·f + other products, with a = d·f."""

    along: Array  # k (3, 6), of the products along each axis
    directions: Array  # d (3, 3)
    turned: Array  # (3, 2, 3), derivatives of d by δ_O and δ_P, which are directions, too
    across: Array  # e (3, 3)
    slope: Array  # (3, 3), ∂y/∂f at zero force
    back: Array  # (3, 3), its inverse


class _Rows(NamedTuple):
    """The rows of a trial, in the last axis of all arrays."""

    y: Array  # (3, r)
    noise: Array  # (6, r), variances of y and twice the covariances xy, yz, zx
    warm: Array  # (r,), ΔT
    f: Array  # (3, r)
    a: Array  # (3, r)
    outer: Array  # (3, r), ∂y/∂a
    slope: Array  # S (3, 3, r)
    cofactors: Array  # (3, 3, r), of S
    det: Array  # (r,), of S
    off: Array  # (3, r), y less the readings at f
    step: Array  # (3, r), the last one
    size: Array  # (r,), of the force
    good: Bools  # (r,), whether f exists
    length: Array  # (r,), ‖f̂‖
    by: Array  # b (3, r)
    seen: Array  # (5, r), components of an axis: a, along P and O, sign of a, ΔT
    across: Array  # (2, r), ∂y/∂ the components along P and O
    part: Array  # (r,)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _new_rows(r: int) -> _Rows:
    three, one = np.zeros((7, 3, r)), np.zeros((5, r))
    nine = np.zeros((2, 3, 3, r))
    return _Rows(
        three[0], np.zeros((6, r)), one[0], three[1], three[2], three[3], nine[0], nine[1], one[1],
        three[4], three[5], one[2], np.zeros(r, np.bool_), one[3], three[6],
        np.zeros((5, r)), np.zeros((2, r)), one[4],
    )


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _invert(m: Array, result: Array) -> float:
    """Write the inverse of a matrix (3, 3) and return its determinant."""
    for i in range(3):
        for j in range(3):
            a, b, c, e = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            result[j, i] = m[a, c] * m[b, e] - m[a, e] * m[b, c]
    size = m[0, 0] * result[0, 0] + m[0, 1] * result[1, 0] + m[0, 2] * result[2, 0]
    for i in range(3):
        for j in range(3):
            result[i, j] /= size
    return size


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _set_model(c: Array, table: TermTable, model: _Model) -> float:
    """Write the model of coefficients c and return the determinant of ∂y/∂f at zero force.

    h = (1, tan δ_O, −tan δ_P) · norm along I, P, O.
    """
    d, turned, k, e = model.directions, model.turned, model.along, model.across
    frames, tilts, axis, places = table.frames, table.tilts, table.axis, table.place
    coefficient, factor = table.coefficient, table.factor
    for i in range(3):
        o, p = tilts[i, 0], tilts[i, 1]
        tan_o = np.tan(c[o]) if o >= 0 else 0.0
        tan_p = np.tan(c[p]) if p >= 0 else 0.0
        norm = 1.0 / np.sqrt(1.0 + tan_o * tan_o + tan_p * tan_p)
        by_o, by_p = (1.0 + tan_o * tan_o) * norm, (1.0 + tan_p * tan_p) * norm
        for m in range(3):
            along, pendulous, output = frames[i, 0, m], frames[i, 1, m], frames[i, 2, m]
            one = (along + tan_o * pendulous - tan_p * output) * norm
            d[i, m] = one
            turned[i, 0, m] = by_o * (pendulous - one * tan_o * norm)
            turned[i, 1, m] = by_p * (-output - one * tan_p * norm)
    for i in range(3):
        _fill(0.0, k[i])
        _fill(0.0, e[i])
    for j in range(axis.size):
        i, place, own = axis[j], places[j], c[coefficient[j]] * factor[j]
        if place < ALONG:
            k[i, place] += own
        elif place < OTHER:
            for m in range(3):
                e[i, m] += own * frames[i, 1 + place - ALONG, m]
    slope = model.slope
    for i in range(3):
        for m in range(3):
            slope[i, m] = (1.0 + k[i, 1]) * d[i, m] + e[i, m]
    return _invert(slope, model.back)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _combine(x: Array, factor: Array, out: Array) -> None:
    """Write the combination of rows x (3, r), out (r,)."""
    a, b, c = factor[0], factor[1], factor[2]
    x0, x1, x2 = x[0], x[1], x[2]
    for n in range(out.size):
        out[n] = a * x0[n] + b * x1[n] + c * x2[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _off(k: Array, y: Array, a: Array, off: Array, outer: Array) -> None:
    """Write y less a and the products along an axis, of coefficients k (6,), and ∂y/∂a."""
    k0, k1, k2, k3, odd1, odd2 = k[0], 1.0 + k[1], k[2], k[3], k[4], k[5]
    if odd1 == 0.0 and odd2 == 0.0:
        for n in range(a.size):
            x = a[n]
            off[n] = y[n] - k0 - (k1 + (k2 + k3 * x) * x) * x
            outer[n] = k1 + (2.0 * k2 + 3.0 * k3 * x) * x
    else:
        for n in range(a.size):
            x = a[n]
            sign = (1.0 if x > 0.0 else 0.0) - (1.0 if x < 0.0 else 0.0)
            off[n] = y[n] - k0 - (k1 + (k2 + k3 * x) * x) * x - (odd1 + odd2 * x) * abs(x)
            outer[n] = k1 + (2.0 * k2 + 3.0 * k3 * x) * x + 2.0 * odd2 * abs(x) + odd1 * sign


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _unsettled(step: Array, size: Array) -> int:
    """Return in how many rows another step is worth it."""
    count = 0
    for n in range(step.size):
        count += 0 if abs(step[n]) <= _SETTLED * size[n] else 1
    return count


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _mark(step: Array, size: Array, slope: Array, at_zero: float, good: Bools) -> int:
    """Mark rows that are not settled or beyond the fold, and return their number.

    The marks are written only where there is one: a loop over bools is slow.
    """
    count = 0
    for n in range(step.size):
        count += 0 if abs(step[n]) <= _SETTLED * size[n] and slope[n] * at_zero > 0.0 else 1
    if count > 0:
        for n in range(step.size):
            good[n] &= abs(step[n]) <= _SETTLED * size[n] and slope[n] * at_zero > 0.0
    return count


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _add(step: Array, factor: float, total: Array) -> None:
    for n in range(step.size):
        total[n] += factor * step[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _fill(value: float, row: Array) -> None:
    for n in range(row.size):
        row[n] = value


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _copy(row: Array, result: Array) -> None:
    for n in range(row.size):
        result[n] = row[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _divide(slope: Array, step: Array) -> None:
    for n in range(step.size):
        step[n] /= slope[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _start(y: Array, k0: float, factor: float, a: Array, size: Array) -> None:
    """Write the linear part of the force along an axis, and raise the sizes to it."""
    for n in range(a.size):
        a[n] = (y[n] - k0) * factor
    _raise_size(a, size)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _raise_size(a: Array, size: Array) -> None:
    for n in range(a.size):
        size[n] = max(size[n], abs(a[n]))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _invert_axes(model: _Model, rows: _Rows) -> int:
    """Write f, a and ∂y/∂a where all products are along the axes; return how many do not exist.

    The first step is by the slope at zero, without a division.
    """
    size, good, ys, forces, steps, outers = (
        rows.size, rows.good, rows.y, rows.a, rows.step, rows.outer
    )
    ks = model.along
    _fill(_TINY, size)
    for i in range(3):
        _start(ys[i], ks[i, 0], 1.0 / (1.0 + ks[i, 1]), forces[i], size)
    bad = 0
    for i in range(3):
        k, y, a, step, outer = ks[i], ys[i], forces[i], steps[i], outers[i]
        _off(k, y, a, step, outer)
        _add(step, 1.0 / (1.0 + k[1]), a)
        for _ in range(_MAX_STEPS):
            _off(k, y, a, step, outer)
            _divide(outer, step)
            _add(step, 1.0, a)
            if _unsettled(step, size) == 0:
                break
        bad += _mark(step, size, outer, 1.0 + k[1], good)
    return bad


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _product(seen: Array, powers: Indices, factor: float, by: int, out: Array) -> bool:
    """Write a product of components seen (5, r), or with by ≥ 0 its derivative by that one.

    Returns False, and writes nothing, where the derivative is zero.
    """
    if by >= 0:
        if powers[by] == 0:
            return False
        factor *= powers[by]
    _fill(factor, out)
    for place in range(powers.size):
        one = seen[place]
        for _ in range(powers[place] - (1 if place == by else 0)):
            for n in range(out.size):
                out[n] *= one[n]
    return True


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _components(i: int, table: TermTable, rows: _Rows) -> None:
    """Write the components that axis i sees."""
    seen, a, f, frames = rows.seen, rows.a[i], rows.f, table.frames
    _copy(a, seen[0])
    _copy(rows.warm, seen[4])
    _combine(f, frames[i, 1], seen[1])
    _combine(f, frames[i, 2], seen[2])
    sign = seen[3]
    for n in range(a.size):
        sign[n] = (1.0 if a[n] > 0.0 else 0.0) - (1.0 if a[n] < 0.0 else 0.0)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _other_products(
    i: int, c: Array, table: TermTable, rows: _Rows, off: Array, outer: Array
) -> bool:
    """Add the products of axis i that are neither along nor across; return whether it has any."""
    seen, part, across = rows.seen, rows.part, rows.across
    axis, places, powers = table.axis, table.place, table.powers
    coefficient, factor = table.coefficient, table.factor
    found = False
    for j in range(axis.size):
        if axis[j] != i or places[j] != OTHER:
            continue
        if not found:
            _components(i, table, rows)
            _fill(0.0, across[0])
            _fill(0.0, across[1])
            found = True
        own = c[coefficient[j]] * factor[j]
        if _product(seen, powers[j], own, -1, part):
            _add(part, -1.0, off)
        if _product(seen, powers[j], own, 0, part):
            _add(part, 1.0, outer)
        for m in range(2):
            if _product(seen, powers[j], own, 1 + m, part):
                _add(part, 1.0, across[m])
    return found


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _set_slope(along: float, outer: Array, bent: float, slope: Array) -> None:
    for n in range(slope.size):
        slope[n] = along * outer[n] + bent


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _respond(c: Array, table: TermTable, model: _Model, rows: _Rows) -> None:
    """Write at f: a, y less the readings, ∂y/∂a, and S with its cofactors."""
    f, part, across, slope, frames = rows.f, rows.part, rows.across, rows.slope, table.frames
    ds, es, ks = model.directions, model.across, model.along
    ys, forces, offs, outers = rows.y, rows.a, rows.off, rows.outer
    for i in range(3):
        off, outer = offs[i], outers[i]
        _combine(f, ds[i], forces[i])
        _off(ks[i], ys[i], forces[i], off, outer)
        if es[i, 0] != 0.0 or es[i, 1] != 0.0 or es[i, 2] != 0.0:
            _combine(f, es[i], part)
            _add(part, -1.0, off)
        others = _other_products(i, c, table, rows, off, outer)
        for m in range(3):
            _set_slope(ds[i, m], outer, es[i, m], slope[i, m])
            if others:
                _add(across[0], frames[i, 1, m], slope[i, m])
                _add(across[1], frames[i, 2, m], slope[i, m])
    _set_cofactors(slope, rows.cofactors, rows.det)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _minor(a: Array, b: Array, c: Array, d: Array, result: Array) -> None:
    for n in range(result.size):
        result[n] = a[n] * b[n] - c[n] * d[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _set_cofactors(s: Array, cofactors: Array, det: Array) -> None:
    """Write cofactors of S (3, 3, r), so that S⁻¹ = cofactorsᵀ/det, and det (r,)."""
    for i in range(3):
        for j in range(3):
            a, b, c, e = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            _minor(s[a, c], s[b, e], s[a, e], s[b, c], cofactors[i, j])
    _multiply(s[0], cofactors[0], det)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _multiply(x: Array, y: Array, total: Array) -> None:
    """Write Σ x y over three rows."""
    x0, x1, x2, y0, y1, y2 = x[0], x[1], x[2], y[0], y[1], y[2]
    for n in range(total.size):
        total[n] = x0[n] * y0[n] + x1[n] * y1[n] + x2[n] * y2[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _invert_together(
    c: Array, at_zero: float, table: TermTable, model: _Model, rows: _Rows
) -> int:
    """Write f, a, ∂y/∂a and S for any products; return how many do not exist.

    `at_zero` is the determinant of S at zero force.
    """
    f, off, steps, size, part, det = rows.f, rows.off, rows.step, rows.size, rows.part, rows.det
    good, cofactors, ys, forces = rows.good, rows.cofactors, rows.y, rows.a
    ks, back, ds = model.along, model.back, model.directions
    _fill(_TINY, size)
    for i in range(3):
        _start(ys[i], ks[i, 0], 1.0, off[i], part)
    for m in range(3):
        _combine(off, back[m], f[m])
        _raise_size(f[m], size)
    for _ in range(_MAX_STEPS):
        _respond(c, table, model, rows)
        unsettled = 0
        for m in range(3):
            step = steps[m]
            _multiply(off, cofactors[:, m], step)
            _divide(det, step)
            _add(step, 1.0, f[m])
            unsettled += _unsettled(step, size)
        if unsettled == 0:
            break
    bad = 0
    for i in range(3):
        _combine(f, ds[i], forces[i])
        bad += _mark(steps[i], size, det, at_zero, good)
    return bad


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _replace_bad(rows: _Rows) -> None:
    """Write finite numbers where no force exists."""
    for n in range(rows.part.size):
        if not rows.good[n]:
            rows.det[n] = 1.0
            for i in range(3):
                rows.f[i, n], rows.a[i, n], rows.outer[i, n] = 1.0, 1.0, 1.0
                for j in range(3):
                    rows.cofactors[i, j, n] = 1.0


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _find_force(c: Array, table: TermTable, model: _Model, separable: bool, rows: _Rows) -> None:
    """Write f̂, its norm, and b = ûᵀ S⁻¹; finite where the force does not exist, too."""
    f, a, bys, length, good = rows.f, rows.a, rows.by, rows.length, rows.good
    outers, det, cofactors, back = rows.outer, rows.det, rows.cofactors, model.back
    at_zero = _set_model(c, table, model)
    for n in range(length.size):
        good[n] = True
    if separable:
        bad = _invert_axes(model, rows)
        _invert(model.directions, back)
        for m in range(3):
            _combine(a, back[m], f[m])
    else:
        bad = _invert_together(c, at_zero, table, model, rows)
    if bad > 0:
        _replace_bad(rows)
    _multiply(f, f, length)
    for n in range(length.size):
        length[n] = np.sqrt(length[n])
    for i in range(3):
        by = bys[i]
        if separable:
            _combine(f, back[:, i], by)
            _divide(outers[i], by)
        else:
            _multiply(f, cofactors[i], by)
            _divide(det, by)
        _divide(length, by)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _set_variance(by: Array, noise: Array, variance: Array) -> None:
    """Write b C bᵀ (r,)."""
    for n in range(variance.size):
        variance[n] = (
            by[0, n] * by[0, n] * noise[0, n]
            + by[1, n] * by[1, n] * noise[1, n]
            + by[2, n] * by[2, n] * noise[2, n]
        )
    for n in range(variance.size):
        variance[n] += (
            by[0, n] * by[1, n] * noise[3, n]
            + by[1, n] * by[2, n] * noise[4, n]
            + by[2, n] * by[0, n] * noise[5, n]
        )


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _add_product(a: Array, b: Array, total: Array) -> None:
    for n in range(total.size):
        total[n] += a[n] * b[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _scale(factor: Array, row: Array) -> None:
    for n in range(row.size):
        row[n] *= factor[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _add_column(place: int, factor: float, a: Array, by: Array, column: Array) -> None:
    """Add factor · b · φ(a) of the product along an axis at a place."""
    if place == 0:
        for n in range(a.size):
            column[n] += factor * by[n]
    elif place == 1:
        for n in range(a.size):
            column[n] += factor * by[n] * a[n]
    elif place == 2:
        for n in range(a.size):
            column[n] += factor * by[n] * a[n] * a[n]
    elif place == 3:
        for n in range(a.size):
            column[n] += factor * by[n] * a[n] * a[n] * a[n]
    elif place == 4:
        for n in range(a.size):
            column[n] += factor * by[n] * abs(a[n])
    else:
        for n in range(a.size):
            column[n] += factor * by[n] * a[n] * abs(a[n])


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _set_columns(table: TermTable, model: _Model, rows: _Rows, columns: Array) -> None:
    """Write Σ b ∂y/∂c of each coefficient, (p, r); b may be weighted."""
    part, a, b, f, seen, frames = rows.part, rows.a, rows.by, rows.f, rows.seen, table.frames
    powers = table.powers
    axis, places, factors, coefficient = table.axis, table.place, table.factor, table.coefficient
    for j in range(columns.shape[0]):
        _fill(0.0, columns[j])
    for j in range(axis.size):
        i, place, factor = axis[j], places[j], factors[j]
        column, by = columns[coefficient[j]], b[i]
        if place < ALONG:
            _add_column(place, factor, a[i], by, column)
            continue
        if place < OTHER:
            _combine(f, frames[i, 1 + place - ALONG], part)
            for n in range(part.size):
                part[n] *= factor
        else:
            _components(i, table, rows)
            _product(seen, powers[j], factor, -1, part)
        _add_product(by, part, column)
    tilts, turned, outer = table.tilts, model.turned, rows.outer
    for i in range(3):
        for kind in range(2):
            j = tilts[i, kind]
            if j >= 0:
                _combine(f, turned[i, kind], part)
                _scale(outer[i], part)
                _add_product(b[i], part, columns[j])


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"}, _nrt=False)
def _dot(a: Array, b: Array) -> float:
    total = 0.0
    for n in range(a.size):
        total += a[n] * b[n]
    return total


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"}, _nrt=False)
def _dots(a: Array, b: Array, c: Array, d: Array) -> tuple[float, float, float, float]:
    """Return a·c, a·d, b·c and b·d."""
    ac, ad, bc, bd = 0.0, 0.0, 0.0, 0.0
    for n in range(a.size):
        ac += a[n] * c[n]
        ad += a[n] * d[n]
        bc += b[n] * c[n]
        bd += b[n] * d[n]
    return ac, ad, bc, bd


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _set_normal(columns: Array, u: Array, normal: Array, gradient: Array) -> None:
    """Write the lower triangle of AᵀA, and Aᵀu, of columns Aᵀ (k, r): four products at a time."""
    k = columns.shape[0]
    for i in range(0, k, 2):
        a, b = columns[i], columns[min(i + 1, k - 1)]
        row, next_row = i * (i + 1) // 2, (i + 1) * (i + 2) // 2
        for j in range(0, i + 1, 2):
            ac, ad, bc, bd = _dots(a, b, columns[j], columns[min(j + 1, k - 1)])
            normal[row + j] = ac
            if j < i:
                normal[row + j + 1] = ad
            if i + 1 < k:
                normal[next_row + j], normal[next_row + j + 1] = bc, bd
        gradient[i] = _dot(a, u)
        if i + 1 < k:
            gradient[i + 1] = _dot(b, u)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _load(y: Array, result: Array) -> None:
    """Copy the readings of a trial, (r, 3); spare rows repeat the last one."""
    for i in range(3):
        row = result[i]
        for n in range(y.shape[0]):
            row[n] = y[n, i]
        row[y.shape[0] :] = y[y.shape[0] - 1, i]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _load_noise(covariance: Array, noise: Array) -> None:
    last = covariance.shape[0] - 1
    for n in range(noise.shape[1]):
        at = min(n, last)
        for i in range(3):
            j = (i + 1) % 3
            noise[i, n] = covariance[at, i, i]
            noise[3 + i, n] = covariance[at, i, j] + covariance[at, j, i]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def norm_kernel(
    table: TermTable,
    y: Array,
    covariance: Array,
    warmth: Array,
    made: Array,
    made_by: Array,
    made_variance: Array,
    x: Array,
    which: Indices,
    jacobian: Array,
) -> tuple[Array, Array, Array, Array]:
    """Return residuals of norms, their weights, and normal equations or the Jacobian.

    Parameters
    ----------
    table : TermTable
    y : (1 or trials, r, 3) array
        Readings, SI.
    covariance : (1 or trials, r, 3, 3) array
        Covariance of the readings.
    warmth : (1 or trials, r) array
        ΔT, K.
    made : (1 or s, r) array
        Norm of the specific force on the bench, m/s².
    made_by : (q, 1 or s, r) array
        Its derivatives by the bench's parameters, which follow the coefficients in x.
    made_variance : (1 or s, r) array
        Variance of it by the errors of each row, (m/s²)².
    x : (s, p + q) array
        Coefficients and parameters of the bench, SI.
    which : (s,) array of int
        Trials of these parameters.
    jacobian : (s, r, p + q) array
        Output, ∂(‖f̂‖ − made)/∂x, finite everywhere; normal equations are computed if it has no
        trials.

    Returns
    -------
    residual : (s, r) array
        `made` − ‖f̂‖; NaN where a reading is beyond the fold of the model.
    weight : (s, r) array
        1/sd of it.
    normal, gradient : (s, k (k + 1)/2) and (s, k) arrays
        Lower triangle of AᵀA, row after row, and Aᵀu, k = p + q; without trials if the Jacobian is
        wanted.
    """
    (count, k), r, q = x.shape, y.shape[1], made_by.shape[0]
    p, dense = k - q, jacobian.shape[0] > 0
    packed = 0 if dense else count
    residual, weight = np.empty((count, r)), np.empty((count, r))
    normal, gradient = np.empty((packed, k * (k + 1) // 2)), np.empty((packed, k))
    separable = True
    for place in table.place:
        separable &= place < ALONG
    rows = _new_rows(-(-r // _WIDTH) * _WIDTH)
    model = _Model(
        np.empty((3, 6)),
        np.empty((3, 3)),
        np.empty((3, 2, 3)),
        np.empty((3, 3)),
        np.empty((3, 3)),
        np.empty((3, 3)),
    )
    size, by, noise, length, good = rows.part.size, rows.by, rows.noise, rows.length, rows.good
    w, u, negative, variance = np.zeros(size), np.zeros(size), np.zeros(size), np.empty(size)
    columns = np.zeros((k, size))
    for s in range(count):
        t = which[s]
        if s == 0 or y.shape[0] > 1:
            _load(y[min(t, y.shape[0] - 1)], rows.y)
        if s == 0 or covariance.shape[0] > 1:
            _load_noise(covariance[min(t, covariance.shape[0] - 1)], noise)
        if s == 0 or warmth.shape[0] > 1:
            _copy(warmth[min(t, warmth.shape[0] - 1)], rows.warm)
        _find_force(x[s], table, model, separable, rows)
        _set_variance(by, noise, variance)
        norm, own = made[min(s, made.shape[0] - 1)], made_variance[min(s, made_variance.shape[0] - 1)]
        for n in range(r):
            w[n] = 1.0 / np.sqrt(variance[n] + own[n])
        for n in range(r):
            u[n] = norm[n] - length[n]
        for n in range(r):
            u[n] = u[n] if good[n] else np.nan
        for n in range(r):
            weight[s, n], residual[s, n] = w[n], u[n]
        for n in range(r):
            u[n] *= w[n]
        if dense:
            w[:r] = 1.0
        for n in range(r):
            negative[n] = -w[n]
        for i in range(3):
            _scale(negative, by[i])
        _set_columns(table, model, rows, columns[:p])
        for j in range(q):
            column, own = columns[p + j], made_by[j, min(s, made_by.shape[1] - 1)]
            for n in range(r):
                column[n] = negative[n] * own[n]
        if dense:
            for n in range(r):
                for j in range(k):
                    jacobian[s, n, j] = columns[j, n]
            continue
        _set_normal(columns, u, normal[s], gradient[s])
    return residual, weight, normal, gradient
