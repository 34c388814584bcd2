"""Compiled: norms of the specific force of many trials, by a triad whose terms are in a table.

Reading i is y = a + Σ c φ, with a = d·f along the (tilted) axis and φ products of a, of the
components along P and O, and of ΔT. With S = ∂y/∂f, û = f̂/‖f̂‖ and b = ûᵀ S⁻¹::

    ∂‖f̂‖/∂y = b,   ∂‖f̂‖/∂c = −Σ bᵢ ∂yᵢ/∂c,   var ‖f̂‖ = b C bᵀ

f̂ is computed as by `inercal.sensors.inverse`, by Newton's method from the affine part; slopes of
reversed sign are beyond the fold. Where all products are of a alone, each axis is inverted by
itself and f̂ = D⁻¹ a with D the directions d; otherwise the three are solved together.

The rows of a trial lie side by side in the innermost axis, and a loop over rows writes one array
from at most seven: the compiler can prove of so few that they do not overlap, and vectorises the
loop. Spare rows repeat the last one, with weight zero, up to a multiple of `_WIDTH`.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.observe.term_table import OTHER, TermTable

Bools = NDArray[np.bool_]
Indices = NDArray[np.int64]

_WIDTH = 16
_MAX_STEPS, _TINY = 40, 2.0**-1022
# Relative to the force: Newton's next step would be the square of it.
_SETTLED = 1e-9


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _directions(c: Array, table: TermTable, d: Array, turned: Array) -> None:
    """Write the input axes d (3, 3) and their derivatives by δ_O and δ_P at f, (3, 2, 3).

    h = (1, tan δ_O, −tan δ_P)/norm along I, P, O; ∂(h·f)/∂δ is a direction, too.
    """
    for i in range(3):
        o, p = table.tilts[i]
        tan_o = np.tan(c[o]) if o >= 0 else 0.0
        tan_p = np.tan(c[p]) if p >= 0 else 0.0
        norm = np.sqrt(1.0 + tan_o * tan_o + tan_p * tan_p)
        for k in range(3):
            along, pendulous, output = table.frames[i, :, k]
            d[i, k] = (along + tan_o * pendulous - tan_p * output) / norm
            turned[i, 0, k] = (1.0 + tan_o * tan_o) / norm * (pendulous - d[i, k] * tan_o / norm)
            turned[i, 1, k] = (1.0 + tan_p * tan_p) / norm * (-output - d[i, k] * tan_p / norm)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
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


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _combine(x: Array, factor: Array, out: Array) -> None:
    """Write the rows' combination out (r,) of x (3, r)."""
    a, b, c = factor
    x0, x1, x2 = x[0], x[1], x[2]
    for n in range(out.size):
        out[n] = a * x0[n] + b * x1[n] + c * x2[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _slope(k: Array, a: Array, slope: Array) -> None:
    """Write ∂y/∂a by the products along an axis, with coefficients k (6,)."""
    k1, k2, k3, odd1, odd2 = 1.0 + k[1], 2.0 * k[2], 3.0 * k[3], k[4], 2.0 * k[5]
    if odd1 == 0.0 and odd2 == 0.0:
        for n in range(a.size):
            slope[n] = k1 + (k2 + k3 * a[n]) * a[n]
    else:
        for n in range(a.size):
            x = a[n]
            slope[n] = k1 + (k2 + k3 * x) * x + odd2 * abs(x) + odd1 * np.sign(x)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _reading(k: Array, a: Array, value: Array) -> None:
    """Write the reading by the products along an axis."""
    k0, k1, k2, k3, odd1, odd2 = k[0], 1.0 + k[1], k[2], k[3], k[4], k[5]
    if odd1 == 0.0 and odd2 == 0.0:
        for n in range(a.size):
            x = a[n]
            value[n] = k0 + (k1 + (k2 + k3 * x) * x) * x
    else:
        for n in range(a.size):
            x = a[n]
            value[n] = k0 + (k1 + (k2 + k3 * x) * x) * x + (odd1 + odd2 * x) * abs(x)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _invert_axes(y: Array, k: Array, a: Array, step: Array, slope: Array, size: Array) -> None:
    """Write the forces along the axes, a (3, r), the last steps and the slopes of each axis."""
    rows = size.size
    size[:] = _TINY
    for i in range(3):
        k0, k1 = k[i, 0], 1.0 + k[i, 1]
        for n in range(rows):
            a[i, n] = (y[i, n] - k0) / k1
        for n in range(rows):
            size[n] = max(size[n], abs(a[i, n]))
    for i in range(3):
        force, last, by, read = a[i], step[i], slope[i], y[i]
        for _ in range(_MAX_STEPS):
            _slope(k[i], force, by)
            _reading(k[i], force, last)
            for n in range(rows):
                last[n] = (read[n] - last[n]) / by[n]
            unsettled = 0
            for n in range(rows):
                unsettled += not abs(last[n]) <= _SETTLED * size[n]
            for n in range(rows):
                force[n] += last[n]
            if unsettled == 0:
                break
        _slope(k[i], force, by)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _product(seen: Array, powers: Indices, factor: float, by: int, out: Array) -> bool:
    """Write a product of components seen (5, r), or with by ≥ 0 its derivative by that one.

    Returns False, and writes nothing, where the derivative is zero.
    """
    if by >= 0:
        if powers[by] == 0:
            return False
        factor *= powers[by]
    out[:] = factor
    for place in range(powers.size):
        one = seen[place]
        for _ in range(powers[place] - (place == by)):
            for n in range(out.size):
                out[n] *= one[n]
    return True


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _components(i: int, f: Array, a: Array, warm: Array, table: TermTable, seen: Array) -> None:
    """Write the components seen from axis i: a, along P and O, the sign of a, and ΔT."""
    seen[0] = a
    _combine(f, table.frames[i, 1], seen[1])
    _combine(f, table.frames[i, 2], seen[2])
    for n in range(a.size):
        seen[3, n] = np.sign(a[n])
    seen[4] = warm


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _respond(
    c: Array, k: Array, d: Array, f: Array, warm: Array, table: TermTable, others: Indices,
    seen: Array, part: Array, a: Array, value: Array, outer: Array, slope: Array,
) -> None:
    """Write readings (3, r) at f (3, r), ∂y/∂a (3, r) and S (3, 3, r) with all products."""
    rows = part.size
    across = np.empty((2, rows))
    for i in range(3):
        _combine(f, d[i], a[i])
        _reading(k[i], a[i], value[i])
        _slope(k[i], a[i], outer[i])
        if others[i]:
            _components(i, f, a[i], warm, table, seen)
            across[:] = 0.0
            for j in range(table.axis.size):
                if table.axis[j] != i or table.place[j] != OTHER:
                    continue
                own = c[table.coefficient[j]] * table.factor[j]
                for by in range(-1, 3):
                    if _product(seen, table.powers[j], own, by, part):
                        total = value[i] if by < 0 else outer[i] if by == 0 else across[by - 1]
                        for n in range(rows):
                            total[n] += part[n]
        for m in range(3):
            along, pendulous, output = d[i, m], table.frames[i, 1, m], table.frames[i, 2, m]
            if others[i]:
                for n in range(rows):
                    slope[i, m, n] = (
                        along * outer[i, n] + pendulous * across[0, n] + output * across[1, n]
                    )
            else:
                for n in range(rows):
                    slope[i, m, n] = along * outer[i, n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _cofactors(s: Array, cofactors: Array, det: Array) -> None:
    """Write cofactors of S (3, 3, r), so that S⁻¹ = cofactorsᵀ/det, and det (r,)."""
    for i in range(3):
        for j in range(3):
            a, b, c, e = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            for n in range(det.size):
                cofactors[i, j, n] = s[a, c, n] * s[b, e, n] - s[a, e, n] * s[b, c, n]
    for n in range(det.size):
        det[n] = (
            s[0, 0, n] * cofactors[0, 0, n]
            + s[0, 1, n] * cofactors[0, 1, n]
            + s[0, 2, n] * cofactors[0, 2, n]
        )


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _invert_together(
    c: Array, k: Array, d: Array, y: Array, warm: Array, table: TermTable, others: Indices,
    f: Array, a: Array, outer: Array, cofactors: Array, det: Array, good: Bools,
) -> None:
    """Write the force f (3, r), a and ∂y/∂a, cofactors and determinant of S, and what exists."""
    rows = det.size
    seen, part, value = np.empty((5, rows)), np.empty(rows), np.empty((3, rows))
    slope, size, first = np.empty((3, 3, rows)), np.full(rows, _TINY), np.empty(rows)
    step = np.empty((3, rows))
    f[:] = 0.0
    for count in range(_MAX_STEPS + 1):
        _respond(c, k, d, f, warm, table, others, seen, part, a, value, outer, slope)
        _cofactors(slope, cofactors, det)
        for i in range(3):
            for n in range(rows):
                value[i, n] = (y[i, n] - value[i, n]) / det[n]
        for m in range(3):
            for n in range(rows):
                step[m, n] = (
                    value[0, n] * cofactors[0, m, n]
                    + value[1, n] * cofactors[1, m, n]
                    + value[2, n] * cofactors[2, m, n]
                )
            for n in range(rows):
                f[m, n] += step[m, n]
        if count == 0:
            first[:] = det
            for m in range(3):
                for n in range(rows):
                    size[n] = max(size[n], abs(f[m, n]))
            continue
        unsettled = 0
        for m in range(3):
            for n in range(rows):
                unsettled += not abs(step[m, n]) <= _SETTLED * size[n]
        if unsettled == 0:
            break
    _respond(c, k, d, f, warm, table, others, seen, part, a, value, outer, slope)
    _cofactors(slope, cofactors, det)
    for n in range(rows):
        good[n] = det[n] * first[n] > 0.0
        for m in range(3):
            good[n] &= abs(step[m, n]) <= _SETTLED * size[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _add_column(place: int, factor: float, a: Array, g: Array, column: Array) -> None:
    """Add factor · g · φ(a) of the product along an axis at a place."""
    if place == 0:
        for n in range(a.size):
            column[n] += factor * g[n]
    elif place == 1:
        for n in range(a.size):
            column[n] += factor * g[n] * a[n]
    elif place == 2:
        for n in range(a.size):
            column[n] += factor * g[n] * a[n] * a[n]
    elif place == 3:
        for n in range(a.size):
            column[n] += factor * g[n] * a[n] * a[n] * a[n]
    elif place == 4:
        for n in range(a.size):
            column[n] += factor * g[n] * abs(a[n])
    else:
        for n in range(a.size):
            column[n] += factor * g[n] * a[n] * abs(a[n])


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})
def _dot(a: Array, b: Array) -> float:
    total = 0.0
    for n in range(a.size):
        total += a[n] * b[n]
    return total


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
        AᵀA, row after row, and Aᵀu, k = p + q; without trials if the Jacobian is wanted.
    """
    (count, k), r, q = x.shape, y.shape[1], made_by.shape[0]
    p = k - q
    rows = -(-r // _WIDTH) * _WIDTH
    dense = jacobian.shape[0] > 0
    packed = 0 if dense else count
    residual, weight = np.empty((count, r)), np.empty((count, r))
    normal, gradient = np.empty((packed, k * (k + 1) // 2)), np.empty((packed, k))
    others = np.zeros(3, np.int64)
    for j in range(table.axis.size):
        others[table.axis[j]] += table.place[j] == OTHER
    together = others.sum() > 0
    poly, d, turned, back = np.empty((3, 6)), np.empty((3, 3)), np.empty((3, 2, 3)), np.empty((3, 3))
    read, noise, warm = np.empty((3, rows)), np.empty((6, rows)), np.empty(rows)
    f, a = np.empty((3, rows)), np.empty((3, rows))
    outer, step = np.empty((3, rows)), np.empty((3, rows))
    g, up, seen, part = np.empty((3, rows)), np.empty((3, rows)), np.empty((5, rows)), np.empty(rows)
    cofactors, det, size = np.empty((3, 3, rows)), np.empty(rows), np.empty(rows)
    good, length, variance = np.empty(rows, np.bool_), np.empty(rows), np.empty(rows)
    w, u, columns = np.zeros(rows), np.zeros(rows), np.empty((k, rows))
    for s in range(count):
        t = which[s]
        c = x[s]
        if s == 0 or y.shape[0] > 1:
            one = y[min(t, y.shape[0] - 1)]
            for n in range(rows):
                for i in range(3):
                    read[i, n] = one[min(n, r - 1), i]
        if s == 0 or covariance.shape[0] > 1:
            own = covariance[min(t, covariance.shape[0] - 1)]
            for n in range(rows):
                at = own[min(n, r - 1)]
                for i in range(3):
                    noise[i, n] = at[i, i]
                    noise[3 + i, n] = at[i, (i + 1) % 3] + at[(i + 1) % 3, i]
        if s == 0 or warmth.shape[0] > 1:
            for n in range(rows):
                warm[n] = warmth[min(t, warmth.shape[0] - 1), min(n, r - 1)]
        poly[:] = 0.0
        for j in range(table.axis.size):
            if table.place[j] != OTHER:
                poly[table.axis[j], table.place[j]] += c[table.coefficient[j]] * table.factor[j]
        _directions(c, table, d, turned)
        if together:
            _invert_together(
                c, poly, d, read, warm, table, others, f, a, outer, cofactors, det, good
            )
        else:
            at_zero = (1.0 + poly[0, 1]) * (1.0 + poly[1, 1]) * (1.0 + poly[2, 1])
            _invert(d, back)
            _invert_axes(read, poly, a, step, outer, size)
            for m in range(3):
                _combine(a, back[m], f[m])
            for n in range(rows):
                good[n] = outer[0, n] * outer[1, n] * outer[2, n] * at_zero > 0.0
                for i in range(3):
                    good[n] &= abs(step[i, n]) <= _SETTLED * size[n]
        for n in range(rows):
            if not good[n]:
                f[:, n], a[:, n], outer[:, n], det[n] = 1.0, 1.0, 1.0, 1.0
                cofactors[:, :, n] = 1.0
        for n in range(rows):
            length[n] = np.sqrt(f[0, n] * f[0, n] + f[1, n] * f[1, n] + f[2, n] * f[2, n])
        for m in range(3):
            for n in range(rows):
                up[m, n] = f[m, n] / length[n]
        for i in range(3):
            if together:
                for n in range(rows):
                    g[i, n] = (
                        up[0, n] * cofactors[i, 0, n]
                        + up[1, n] * cofactors[i, 1, n]
                        + up[2, n] * cofactors[i, 2, n]
                    ) / det[n]
            else:
                _combine(up, back[:, i], part)
                for n in range(rows):
                    g[i, n] = part[n] / outer[i, n]
        for n in range(rows):
            variance[n] = (
                g[0, n] * g[0, n] * noise[0, n]
                + g[1, n] * g[1, n] * noise[1, n]
                + g[2, n] * g[2, n] * noise[2, n]
            )
        for n in range(rows):
            variance[n] += (
                g[0, n] * g[1, n] * noise[3, n]
                + g[1, n] * g[2, n] * noise[4, n]
                + g[2, n] * g[0, n] * noise[5, n]
            )
        its = min(s, made.shape[0] - 1)
        its_variance = min(s, made_variance.shape[0] - 1)
        for n in range(r):
            w[n] = 1.0 / np.sqrt(variance[n] + made_variance[its_variance, n])
        for n in range(r):
            weight[s, n] = w[n]
        for n in range(r):
            residual[s, n] = made[its, n] - length[n] if good[n] else np.nan
        for n in range(r):
            u[n] = w[n] * residual[s, n]
        if dense:
            w[:r] = 1.0
        for i in range(3):
            for n in range(rows):
                g[i, n] *= -w[n]
        columns[:] = 0.0
        for j in range(table.axis.size):
            i = table.axis[j]
            column = columns[table.coefficient[j]]
            if table.place[j] != OTHER:
                _add_column(table.place[j], table.factor[j], a[i], g[i], column)
            else:
                _components(i, f, a[i], warm, table, seen)
                _product(seen, table.powers[j], table.factor[j], -1, part)
                for n in range(rows):
                    column[n] += g[i, n] * part[n]
        for i in range(3):
            for kind in range(2):
                j = table.tilts[i, kind]
                if j >= 0:
                    _combine(f, turned[i, kind], part)
                    for n in range(rows):
                        columns[j, n] = g[i, n] * outer[i, n] * part[n]
        for j in range(q):
            by = made_by[j, min(s, made_by.shape[1] - 1)]
            for n in range(r):
                columns[p + j, n] = -w[n] * by[n]
        if dense:
            for n in range(r):
                for j in range(k):
                    jacobian[s, n, j] = columns[j, n]
            continue
        place = 0
        for i in range(k):
            gradient[s, i] = _dot(columns[i], u)
            for j in range(i + 1):
                normal[s, place] = _dot(columns[i], columns[j])
                place += 1
    return residual, weight, normal, gradient
