"""Compute norms of the specific force in many trials, for a triad with a table of its terms.

With S = ∂y/∂f, û = f̂/‖f̂‖ and b = ûᵀ S⁻¹::

    ∂‖f̂‖/∂y = b,   ∂‖f̂‖/∂c = −Σ bᵢ ∂yᵢ/∂c,   var ‖f̂‖ = b C bᵀ

The code computes one trial at a time and builds the normal equations from its columns, so no array
contains the derivatives of all trials.
"""
# Numba's decorator has no type annotations.
# pyright: reportUntypedFunctionDecorator=false

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation.kernel_options import njit
from inercal.estimation.problem import NormalEquations
from inercal.methods.residuals._force_inversion import (
    Indices,
    Model,
    Rows,
    find_force,
    set_components,
    set_product,
)
from inercal.methods.residuals._row_operations import (
    INNER,
    KERNEL,
    add_product,
    combine,
    copy,
    dot,
    dots,
    fill,
    scale,
)
from inercal.methods.residuals.term_table import ALONG, OTHER, TermTable


@njit(**INNER)
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


@njit(**INNER)
def _add_column(place: int, factor: float, a: Array, by: Array, column: Array) -> None:
    """Add factor · b · φ(a) for the product along an axis at index `place`."""
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


@njit(**INNER)
def _set_columns(table: TermTable, model: Model, rows: Rows, columns: Array) -> None:
    """Write Σ b ∂y/∂c for each coefficient, (p, r); b may be weighted."""
    part, a, b, f, seen, frames = rows.part, rows.a, rows.by, rows.f, rows.seen, table.frames
    powers = table.powers
    axis, places, factors, coefficient = table.axis, table.place, table.factor, table.coefficient
    for j in range(columns.shape[0]):
        fill(0.0, columns[j])
    for j in range(axis.size):
        i, place, factor = axis[j], places[j], factors[j]
        column, by = columns[coefficient[j]], b[i]
        if place < ALONG:
            _add_column(place, factor, a[i], by, column)
            continue
        if place < OTHER:
            combine(f, frames[i, 1 + place - ALONG], part)
            for n in range(part.size):
                part[n] *= factor
        else:
            set_components(i, table, rows)
            set_product(seen, powers[j], factor, -1, part)
        add_product(by, part, column)
    tilts, turned, outer = table.tilts, model.turned, rows.outer
    for i in range(3):
        for kind in range(2):
            j = tilts[i, kind]
            if j >= 0:
                combine(f, turned[i, kind], part)
                scale(outer[i], part)
                add_product(b[i], part, columns[j])


@njit(**INNER)
def set_normal(columns: Array, u: Array, normal: Array, gradient: Array) -> None:
    """Write the lower triangle of AᵀA, and Aᵀu, from columns Aᵀ (k, r), four products at a time."""
    k = columns.shape[0]
    for i in range(0, k, 2):
        a, b = columns[i], columns[min(i + 1, k - 1)]
        row, next_row = i * (i + 1) // 2, (i + 1) * (i + 2) // 2
        for j in range(0, i + 1, 2):
            ac, ad, bc, bd = dots(a, b, columns[j], columns[min(j + 1, k - 1)])
            normal[row + j] = ac
            if j < i:
                normal[row + j + 1] = ad
            if i + 1 < k:
                normal[next_row + j], normal[next_row + j + 1] = bc, bd
        gradient[i] = dot(a, u)
        if i + 1 < k:
            gradient[i + 1] = dot(b, u)


@njit(**INNER)
def _load(y: Array, result: Array) -> None:
    """Copy the readings of a trial, (r, 3); spare rows repeat the last one."""
    for i in range(3):
        row = result[i]
        for n in range(y.shape[0]):
            row[n] = y[n, i]
        row[y.shape[0] :] = y[y.shape[0] - 1, i]


@njit(**INNER)
def _load_noise(covariance: Array, noise: Array) -> None:
    last = covariance.shape[0] - 1
    for n in range(noise.shape[1]):
        at = min(n, last)
        for i in range(3):
            j = (i + 1) % 3
            noise[i, n] = covariance[at, i, i]
            noise[3 + i, n] = covariance[at, i, j] + covariance[at, j, i]


@njit(**INNER)
def _is_separable(table: TermTable) -> bool:
    count = 0
    for place in table.place:
        count += 1 if place >= ALONG else 0
    return count == 0


@njit(**INNER)
def _set_residuals(
    norm: Array, own: Array, rows: Rows, residual: Array, weight: Array, whitened: Array
) -> None:
    """Write residuals, weights and u for the rows that are not spare, and w and u for all rows."""
    variance, length, good, w, u = rows.variance, rows.length, rows.good, rows.w, rows.u
    for n in range(residual.size):
        w[n] = 1.0 / np.sqrt(variance[n] + own[n])
    for n in range(residual.size):
        u[n] = norm[n] - length[n] if good[n] else np.nan
    for n in range(residual.size):
        weight[n] = w[n]
    for n in range(residual.size):
        residual[n] = u[n]
    scale(w, u)
    for n in range(residual.size):
        whitened[n] = u[n]


@njit(**KERNEL)
def norm_kernel(
    table: TermTable,
    data: tuple[Array, Array, Array],
    stated: tuple[Array, Array, Array],
    x: Array,
    which: Indices,
    model: Model,
    rows: Rows,
    found: NormalEquations,
    jacobian: Array,
) -> None:
    """Write the residuals of norms, their weights, and the normal equations or the Jacobian.

    Parameters
    ----------
    table : TermTable
    data : tuple of arrays
        Readings (1 or trials, r, 3), SI; their covariance (1 or trials, r, 3, 3); ΔT
        (1 or trials, r), K.
    stated : tuple of arrays
        Norm of the specific force on the bench (1 or s, r), m/s²; its derivatives (q, 1 or s, r) by
        the bench's parameters, which come after the coefficients in x; its variance (1 or s, r) due
        to the errors of each row, (m/s²)².
    x : (s, p + q) array
        Coefficients and bench parameters, SI.
    which : (s,) array of int
        Trials that these parameters belong to.
    model : Model
    rows : Rows
        Work arrays for r rows and k = p + q parameters, which are overwritten.
    found : NormalEquations
        Output. Stated norms minus ‖f̂‖ (s, r), NaN if a reading is beyond the fold of the model;
        weights 1/sd (s, r); u (s, r); lower triangle of AᵀA, row after row (s, k (k + 1)/2);
        Aᵀu (s, k). The last two are not written if the Jacobian is requested.
    jacobian : (s or 0, r, p + q) array
        Output if it contains trials: ∂(‖f̂‖ − stated)/∂x, finite everywhere.
    """
    y, covariance, warmth = data
    made, made_by, made_variance = stated
    residual, weight, whitened, normal, gradient = found
    q, dense, separable = made_by.shape[0], jacobian.shape[0] > 0, _is_separable(table)
    p, w, u, by, part, columns = x.shape[1] - q, rows.w, rows.u, rows.by, rows.part, rows.columns
    for s in range(x.shape[0]):
        t = which[s]
        if s == 0 or y.shape[0] > 1:
            _load(y[min(t, y.shape[0] - 1)], rows.y)
        if s == 0 or covariance.shape[0] > 1:
            _load_noise(covariance[min(t, covariance.shape[0] - 1)], rows.noise)
        if s == 0 or warmth.shape[0] > 1:
            copy(warmth[min(t, warmth.shape[0] - 1)], rows.warm)
        find_force(x[s], table, model, separable, rows)
        _set_variance(by, rows.noise, rows.variance)
        norm = made[min(s, made.shape[0] - 1)]
        own = made_variance[min(s, made_variance.shape[0] - 1)]
        _set_residuals(norm, own, rows, residual[s], weight[s], whitened[s])
        # Spare rows keep zero weight.
        for n in range(y.shape[1]):
            part[n] = -1.0 if dense else -w[n]
        for n in range(y.shape[1], part.size):
            part[n] = 0.0
        for i in range(3):
            scale(part, by[i])
        for j in range(q):
            column, own = columns[p + j], made_by[j, min(s, made_by.shape[1] - 1)]
            for n in range(own.size):
                column[n] = part[n] * own[n]
        _set_columns(table, model, rows, columns[:p])
        if not dense:
            set_normal(columns, u, normal[s], gradient[s])
        else:
            for n in range(y.shape[1]):
                for j in range(columns.shape[0]):
                    jacobian[s, n, j] = columns[j, n]
