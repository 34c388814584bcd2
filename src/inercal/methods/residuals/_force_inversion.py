"""Invert a triad's model: compute the force from readings and a table of terms.

Reading i is y = a + Σ k φ(a) + e·f + other products, with a = d·f along the (tilted) axis. The
force is the root that `inercal.physics.sensors.inverse` finds, by Newton's method from the linear
part. If a slope has the opposite sign, the root is beyond the fold. If all products depend only on
a, each axis is inverted separately and f = D⁻¹ a, where D contains the directions d. Otherwise the
three axes are solved together.
"""
# Numba's decorator has no type annotations.
# pyright: reportUntypedFunctionDecorator=false

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.estimation.kernel_options import njit
from inercal.methods.residuals._row_operations import (
    INNER,
    add,
    combine,
    combine_column,
    copy,
    divide,
    fill,
    minor,
    multiply,
    multiply_column,
    raise_size,
    scale,
    set_slope,
)
from inercal.methods.residuals.term_table import ALONG, OTHER, TermTable

_WIDTH = 16  # rows are padded to a multiple of this by repeating the last one
_MAX_STEPS, _TINY = 40, 2.0**-1022
# Last step relative to the force: the remaining error is of the order of its square.
_SETTLED = 2.0**-26
_EXACT = 1e-14  # last step, relative; below this, slopes before the step equal those after it


class Model(NamedTuple):
    """The model in one trial: y = a + Σ k φ(a) + e·f + other products, with a = d·f."""

    along: Array  # k (3, 6), coefficients of the products along each axis
    directions: Array  # d (3, 3)
    turned: Array  # (3, 2, 3), ∂d/∂(δ_O, δ_P), which are also directions
    across: Array  # e (3, 3)
    slope: Array  # (3, 3), ∂y/∂f at zero force
    back: Array  # (3, 3), its inverse

    @classmethod
    def empty(cls) -> "Model":
        """Return uninitialised arrays for the model of one trial."""
        return cls(np.zeros((3, 6)), np.zeros((3, 3)), np.zeros((3, 2, 3)), *np.zeros((3, 3, 3)))


class Rows(NamedTuple):
    """The rows of a trial, which lie along the last axis of all arrays."""

    y: Array  # (3, r)
    noise: Array  # (6, r), variances of y and twice the covariances xy, yz, zx
    warm: Array  # (r,), ΔT
    f: Array  # (3, r)
    a: Array  # (3, r)
    outer: Array  # (3, r), ∂y/∂a
    slope: Array  # S (3, 3, r)
    cofactors: Array  # (3, 3, r), of S
    det: Array  # (r,), of S
    off: Array  # (3, r), y minus the readings at f
    step: Array  # (3, r), the last Newton step
    size: Array  # (r,), of the force
    good: Bools  # (r,), whether f exists
    length: Array  # (r,), ‖f̂‖
    by: Array  # b (3, r)
    seen: Array  # (5, r), components for an axis: a, along P and O, sign of a, ΔT
    across: Array  # (2, r), ∂y/∂ the components along P and O
    part: Array  # (r,), temporary values
    variance: Array  # (r,), b C bᵀ
    w: Array  # (r,), weights
    u: Array  # (r,), weighted residuals
    columns: Array  # Aᵀ (k, r)

    @classmethod
    def empty(cls, r: int, k: int) -> "Rows":
        """Return uninitialised arrays for r rows and k parameters."""
        r = -(-r // _WIDTH) * _WIDTH
        y, f, a, outer, off, step, by = np.zeros((7, 3, r))
        slope, cofactors = np.zeros((2, 3, 3, r))
        warm, det, size, length, part, variance, w, u = np.zeros((8, r))
        noise, seen, across = np.zeros((6, r)), np.zeros((5, r)), np.zeros((2, r))
        good, columns = np.zeros(r, dtype=np.bool_), np.zeros((k, r))
        return cls(
            y, noise, warm, f, a, outer, slope, cofactors, det, off, step, size, good, length, by,
            seen, across, part, variance, w, u, columns,
        )  # fmt: skip


@njit(**INNER)
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


@njit(**INNER)
def _set_model(c: Array, table: TermTable, model: Model) -> float:
    """Write the model with coefficients c and return the determinant of ∂y/∂f at zero force.

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
        fill(0.0, k[i])
        fill(0.0, e[i])
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


@njit(**INNER)
def _off(k: Array, y: Array, a: Array, off: Array, outer: Array) -> None:
    """Write y minus a minus the products along an axis with coefficients k (6,), and ∂y/∂a."""
    k0, k1, k2, k3, odd1, odd2 = k[0], 1.0 + k[1], k[2], k[3], k[4], k[5]
    for n in range(a.size):
        x = a[n]
        sign = (1.0 if x > 0.0 else 0.0) - (1.0 if x < 0.0 else 0.0)
        off[n] = y[n] - k0 - (k1 + (k2 + k3 * x) * x) * x - (odd1 + odd2 * x) * abs(x)
        outer[n] = k1 + (2.0 * k2 + 3.0 * k3 * x) * x + 2.0 * odd2 * abs(x) + odd1 * sign


@njit(**INNER)
def _unsettled(step: Array, limit: float, size: Array) -> int:
    """Return the number of rows that need another step."""
    count = 0
    for n in range(step.size):
        count += 0 if abs(step[n]) <= limit * size[n] else 1
    return count


@njit(**INNER)
def _mark(step: Array, size: Array, slope: Array, at_zero: float, good: Bools) -> int:
    """Mark rows that have not converged or are beyond the fold, and return their number.

    The marks are written only if there are such rows, because a loop over bools is slow.
    """
    count = 0
    for n in range(step.size):
        count += 0 if abs(step[n]) <= _SETTLED * size[n] and slope[n] * at_zero > 0.0 else 1
    if count > 0:
        for n in range(step.size):
            good[n] &= abs(step[n]) <= _SETTLED * size[n] and slope[n] * at_zero > 0.0
    return count


@njit(**INNER)
def _start(y: Array, k0: float, factor: float, a: Array, size: Array) -> None:
    """Write the linear part of the force along an axis, and raise smaller sizes to it."""
    for n in range(a.size):
        a[n] = (y[n] - k0) * factor
    raise_size(a, size)


@njit(inline="always")
def _invert_axes(model: Model, rows: Rows) -> int:
    """Write a and ∂y/∂a if all products are along the axes; return how many rows have no root."""
    ys, forces, steps, outers, ks = rows.y, rows.a, rows.step, rows.outer, model.along
    size, det, part, good = rows.size, rows.det, rows.part, rows.good
    fill(_TINY, size)
    for i in range(3):
        _start(ys[i], ks[i, 0], 1.0 / (1.0 + ks[i, 1]), forces[i], size)
    fill(1.0, det)
    at_zero = 1.0
    for i in range(3):
        k, y, a, step, outer = ks[i], ys[i], forces[i], steps[i], outers[i]
        for _ in range(_MAX_STEPS):
            _off(k, y, a, step, outer)
            divide(outer, step)
            add(step, 1.0, a)
            if _unsettled(step, _SETTLED, size) == 0:
                break
        _off(k, y, a, part, outer)
        scale(outer, det)
        at_zero *= 1.0 + k[1]
    bad = 0
    for i in range(3):
        bad += _mark(steps[i], size, det, at_zero, good)
    return bad


@njit(**INNER)
def set_product(seen: Array, powers: Indices, factor: float, by: int, out: Array) -> bool:
    """Write a product of the components `seen` (5, r), or its derivative for component `by` if ≥ 0.

    Return False and write nothing if the derivative is zero.
    """
    if by >= 0:
        if powers[by] == 0:
            return False
        factor *= powers[by]
    fill(factor, out)
    for place in range(powers.size):
        one = seen[place]
        for _ in range(powers[place] - (1 if place == by else 0)):
            for n in range(out.size):
                out[n] *= one[n]
    return True


@njit(**INNER)
def set_components(i: int, table: TermTable, rows: Rows) -> None:
    """Write the components that axis i senses."""
    seen, a, f, frames = rows.seen, rows.a[i], rows.f, table.frames
    copy(a, seen[0])
    copy(rows.warm, seen[4])
    combine(f, frames[i, 1], seen[1])
    combine(f, frames[i, 2], seen[2])
    sign = seen[3]
    for n in range(a.size):
        sign[n] = (1.0 if a[n] > 0.0 else 0.0) - (1.0 if a[n] < 0.0 else 0.0)


@njit(**INNER)
def _other_products(
    i: int, c: Array, table: TermTable, rows: Rows, off: Array, outer: Array
) -> bool:
    """Add the products of axis i that are neither along nor across it; return whether any exist."""
    seen, part, across = rows.seen, rows.part, rows.across
    axis, places, powers = table.axis, table.place, table.powers
    coefficient, factor = table.coefficient, table.factor
    found = False
    for j in range(axis.size):
        if axis[j] != i or places[j] != OTHER:
            continue
        if not found:
            set_components(i, table, rows)
            fill(0.0, across[0])
            fill(0.0, across[1])
            found = True
        own = c[coefficient[j]] * factor[j]
        for by in range(-1, 3):
            if set_product(seen, powers[j], own, by, part):
                total = off if by < 0 else outer if by == 0 else across[by - 1]
                add(part, -1.0 if by < 0 else 1.0, total)
    return found


@njit(inline="always")
def _respond(c: Array, table: TermTable, model: Model, rows: Rows) -> None:
    """Write the response at f: a, y minus the readings, ∂y/∂a, and S with its cofactors."""
    f, part, across, slope, frames = rows.f, rows.part, rows.across, rows.slope, table.frames
    ds, es, ks = model.directions, model.across, model.along
    ys, forces, offs, outers = rows.y, rows.a, rows.off, rows.outer
    for i in range(3):
        off, outer = offs[i], outers[i]
        combine(f, ds[i], forces[i])
        _off(ks[i], ys[i], forces[i], off, outer)
        if es[i, 0] != 0.0 or es[i, 1] != 0.0 or es[i, 2] != 0.0:
            combine(f, es[i], part)
            add(part, -1.0, off)
        others = _other_products(i, c, table, rows, off, outer)
        for m in range(3):
            set_slope(ds[i, m], outer, es[i, m], slope[i, m])
            if others:
                add(across[0], frames[i, 1, m], slope[i, m])
                add(across[1], frames[i, 2, m], slope[i, m])
    _set_cofactors(slope, rows.cofactors, rows.det)


@njit(inline="always")
def _set_cofactors(s: Array, cofactors: Array, det: Array) -> None:
    """Write the cofactors of S (3, 3, r), so that S⁻¹ = cofactorsᵀ/det, and det (r,)."""
    for i in range(3):
        for j in range(3):
            a, b, c, e = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            minor(s[a, c], s[b, e], s[a, e], s[b, c], cofactors[i, j])
    multiply(s[0], cofactors[0], det)


@njit(inline="always")
def _invert_together(c: Array, at_zero: float, table: TermTable, model: Model, rows: Rows) -> int:
    """Write f, a, ∂y/∂a and S for any products; return how many rows have no root.

    `at_zero` is the determinant of S at zero force.
    """
    f, off, steps, size, part, det = rows.f, rows.off, rows.step, rows.size, rows.part, rows.det
    good, cofactors, ys, forces = rows.good, rows.cofactors, rows.y, rows.a
    ks, back, ds = model.along, model.back, model.directions
    fill(_TINY, size)
    for i in range(3):
        _start(ys[i], ks[i, 0], 1.0, off[i], part)
    for m in range(3):
        combine(off, back[m], f[m])
        raise_size(f[m], size)
    inexact = 1
    for _ in range(_MAX_STEPS):
        _respond(c, table, model, rows)
        unsettled, inexact = 0, 0
        for m in range(3):
            step = steps[m]
            multiply_column(off, cofactors, m, step)
            divide(det, step)
            add(step, 1.0, f[m])
            unsettled += _unsettled(step, _SETTLED, size)
            inexact += _unsettled(step, _EXACT, size)
        if unsettled == 0:
            break
    if inexact > 0:
        _respond(c, table, model, rows)
    bad = 0
    for i in range(3):
        combine(f, ds[i], forces[i])
        bad += _mark(steps[i], size, det, at_zero, good)
    return bad


@njit(**INNER)
def _replace_bad(rows: Rows) -> None:
    """Write finite numbers in rows where no force exists."""
    for n in range(rows.part.size):
        if not rows.good[n]:
            rows.det[n] = 1.0
            for i in range(3):
                rows.f[i, n], rows.a[i, n], rows.outer[i, n] = 1.0, 1.0, 1.0
                for j in range(3):
                    rows.cofactors[i, j, n] = 1.0


@njit(**INNER)
def find_force(c: Array, table: TermTable, model: Model, separable: bool, rows: Rows) -> None:
    """Write f̂, its norm, and b = ûᵀ S⁻¹, which are finite even if the force does not exist."""
    f, a, bys, length, good = rows.f, rows.a, rows.by, rows.length, rows.good
    outers, det, cofactors, back = rows.outer, rows.det, rows.cofactors, model.back
    at_zero = _set_model(c, table, model)
    for n in range(length.size):
        good[n] = True
    if separable:
        bad = _invert_axes(model, rows)
        _invert(model.directions, back)
        for m in range(3):
            combine(a, back[m], f[m])
    else:
        bad = _invert_together(c, at_zero, table, model, rows)
    if bad > 0:
        _replace_bad(rows)
    multiply(f, f, length)
    for n in range(length.size):
        length[n] = np.sqrt(length[n])
    for i in range(3):
        by = bys[i]
        if separable:
            combine_column(f, back, i, by)
            divide(outers[i], by)
        else:
            multiply(f, cofactors[i], by)
            divide(det, by)
        divide(length, by)
