"""Compute the normal equations for readings in known motion, for many trials.

The rows of a trial are those of ∂h/∂(c, q) = (design, slope · ∂(f, ω)/∂q). They are assembled and
whitened one trial at a time, so no array contains the derivatives of all trials. If all trials
share motion, coefficients and noise, as at the start of a search, AᵀA is computed only once.
"""
# Numba's decorator has no type annotations.
# pyright: reportUntypedFunctionDecorator=false

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import njit
from inercal.estimation.problem import NormalEquations
from inercal.methods.residuals._kernels import set_normal
from inercal.methods.residuals._row_operations import INNER, KERNEL, add, dot, fill


class Derivatives(NamedTuple):
    """Derivatives for r rows of m axes and for s trials; p coefficients and q other parameters."""

    design: Array  # (1 or s, r, m, p)
    slope: Array  # (1 or s, 1 or r, m, 6), ∂h/∂(f, ω)
    f: Array  # (q, 1 or s, r, 3), sensitivity of specific force to other parameters
    w: Array  # (q or 0, 1 or s, r, 3), sensitivity of the rate to other parameters
    readings: Array  # (n, q), effect of unit parameters on the observed readings
    observed: Indices  # (n,), indices of the observed readings, row after row


class WhitenedNoise(NamedTuple):
    """Noise of n observations, for each trial or shared by all."""

    weight: Array  # 1/sd (1 or trials, n)
    factor: Array  # Cholesky factor of the covariance (0, 1 or trials, n, n); 0: use the weights


class TrialBuffer(NamedTuple):
    """Work arrays for one trial with n observations and k parameters."""

    rows: Array  # (n, k)
    columns: Array  # (k, n)
    u: Array  # (n,)
    busy: Indices  # (k,)

    @classmethod
    def empty(cls, n: int, k: int) -> "TrialBuffer":
        """Return uninitialised arrays."""
        return cls(np.zeros((n, k)), np.zeros((k, n)), np.zeros(n), np.zeros(k, dtype=np.int64))


@njit(**INNER)
def _set_rows(by: Derivatives, s: int, rows: Array) -> None:
    """Write ∂h/∂(c, q) for trial s and the observed readings, (n, k)."""
    design = by.design[min(s, by.design.shape[0] - 1)]
    slope = by.slope[min(s, by.slope.shape[0] - 1)]
    at_f, at_w = min(s, by.f.shape[1] - 1), min(s, by.w.shape[1] - 1)
    _, m, p = design.shape
    for place in range(by.observed.size):
        n, i = by.observed[place] // m, by.observed[place] % m
        row, own, along = rows[place], design[n, i], slope[min(n, slope.shape[0] - 1), i]
        for k in range(p):
            row[k] = own[k]
        for k in range(by.f.shape[0]):
            one = by.f[k, at_f, n]
            total = along[0] * one[0] + along[1] * one[1] + along[2] * one[2]
            row[p + k] = total + by.readings[place, k]
        for k in range(by.w.shape[0]):
            one = by.w[k, at_w, n]
            row[p + k] += along[3] * one[0] + along[4] * one[1] + along[5] * one[2]


@njit(**INNER)
def _decorrelate(factor: Array, rows: Array) -> None:
    """Replace rows (n, k) by L⁻¹ rows."""
    for i in range(rows.shape[0]):
        row, line = rows[i], factor[i]
        for j in range(i):
            if line[j] != 0.0:
                add(rows[j], -line[j], row)
        w = 1.0 / line[i]
        for k in range(row.size):
            row[k] *= w


@njit(**INNER)
def _set_sparse_normal(rows: Array, busy: Indices, normal: Array) -> None:
    """Write the lower triangle of AᵀA from rows that each depend on few parameters."""
    fill(0.0, normal)
    for i in range(rows.shape[0]):
        row, count = rows[i], 0
        for k in range(row.size):
            if row[k] != 0.0:
                busy[count] = k
                count += 1
        for a in range(count):
            k = busy[a]
            place, value = k * (k + 1) // 2, row[k]
            for b in range(a + 1):
                normal[place + busy[b]] += value * row[busy[b]]


@njit(**INNER)
def _is_dense(rows: Array) -> bool:
    """Return whether products of whole columns are faster than products of single elements."""
    count = 0
    for i in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            count += 1 if rows[i, k] != 0.0 else 0
    return 3 * count > rows.size


@njit(**INNER)
def _whiten_residual(residual: Array, noise: WhitenedNoise, t: int, u: Array) -> None:
    if noise.factor.shape[0] == 0:
        weight = noise.weight[min(t, noise.weight.shape[0] - 1)]
        for i in range(u.size):
            u[i] = weight[i] * residual[i]
        return
    factor = noise.factor[min(t, noise.factor.shape[0] - 1)]
    for i in range(u.size):
        total = residual[i]
        for j in range(i):
            total -= factor[i, j] * u[j]
        u[i] = total / factor[i, i]


@njit(**KERNEL)
def vector_kernel(
    by: Derivatives,
    noise: WhitenedNoise,
    which: Indices,
    buffer: TrialBuffer,
    found: NormalEquations,
) -> None:
    """Write whitened residuals and normal equations of trials.

    Parameters
    ----------
    by : Derivatives
    noise : WhitenedNoise
    which : (s,) array of int
        Trials that these derivatives and residuals belong to.
    buffer : TrialBuffer
    found : NormalEquations
        The residuals y − h (s, n) are input; the other arrays are output.
    """
    residual, weight, whitened, normal, gradient = found
    rows, columns, u, busy = buffer
    full = noise.factor.shape[0] > 0
    alike = max(by.design.shape[0], by.slope.shape[0], by.f.shape[1], by.w.shape[1]) == 1
    alike = alike and max(noise.weight.shape[0], noise.factor.shape[0]) == 1
    for s in range(which.size):
        t = which[s]
        own = noise.weight[min(t, noise.weight.shape[0] - 1)]
        if s == 0 or not alike:
            _set_rows(by, s, rows)
            if full:
                _decorrelate(noise.factor[min(t, noise.factor.shape[0] - 1)], rows)
            else:
                for i in range(rows.shape[0]):
                    for k in range(rows.shape[1]):
                        rows[i, k] *= own[i]
            for i in range(rows.shape[0]):
                for k in range(rows.shape[1]):
                    columns[k, i] = rows[i, k]
        _whiten_residual(residual[s], noise, t, u)
        for i in range(u.size):
            whitened[s, i] = u[i]
            weight[s, i] = own[i]
        if s > 0 and alike:
            for k in range(normal.shape[1]):
                normal[s, k] = normal[0, k]
            for k in range(columns.shape[0]):
                gradient[s, k] = dot(columns[k], u)
        elif full and _is_dense(rows):
            set_normal(columns, u, normal[s], gradient[s])
        else:
            _set_sparse_normal(rows, busy, normal[s])
            for k in range(columns.shape[0]):
                gradient[s, k] = dot(columns[k], u)


@njit(**KERNEL)
def to_cholesky_factors(covariance: Array) -> bool:
    """Replace covariances (s, n, n) by their Cholesky factors; return whether all factors exist."""
    good = True
    for s in range(covariance.shape[0]):
        a = covariance[s]
        for i in range(a.shape[0]):
            for j in range(i + 1):
                total = a[i, j]
                for k in range(j):
                    total -= a[i, k] * a[j, k]
                if j < i:
                    a[i, j] = total / a[j, j]
                else:
                    good = good and total > 0.0
                    a[i, i] = np.sqrt(total) if total > 0.0 else 1.0
    return good
