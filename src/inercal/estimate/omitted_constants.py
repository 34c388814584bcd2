"""The effect on a Kalman filter's innovations of a constant that is not a state, compiled.

Let the constant q add d q to the states at each epoch and c q to the observations. The filter's
estimates are then biased by U q, and its innovations by S q (Friedland's separate bias)::

    predict   U ← Φ U + d
    update    S = h·U + c        U ← U − k S

with the filter's Φ, h and k (`kalman.FilterSteps`). U begins at zero, or with 1 in the row of a
state whose value differs by q from its prior mean. The recursion includes all states of the filter
and their priors, so S is the part that they cannot absorb. The innovations ν of variance s are
therefore regressed on S alone, without a Jacobian of the states: for columns S of many constants

    G = Σ Sᵀ S / s        b = Σ Sᵀ ν / s

are all that a score test needs, and −U at the end is the shift of the estimates per unit of each.

Source: Friedland 1969, IEEE TAC 14(4), 359–367; Willsky and Jones 1976, IEEE TAC 21(1), 108–112
(tests of innovations for constants that begin at a known time).
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from typing import NamedTuple

import numpy as np
from numba import njit

from inercal.arrays import Array
from inercal.estimate.kalman import FilterSteps

_ROWS = 512  # whitened rows that are multiplied at once


class OmittedSums(NamedTuple):
    """Sums over a run, for C constants and n states."""

    gram: Array  # G, (C, C)
    product: Array  # b, (C,)
    moved: Array  # −U at the end, (n, C)


def omitted_constant_sums(
    steps: FilterSteps,
    start: Array,
    driven: Array,
    at: int,
    seen: Array,
    row: int,
    tested: int | None = None,
) -> OmittedSums:
    """Return what D constants that drive states and B that are observed make of the innovations.

    Parameters
    ----------
    steps : FilterSteps
        Of e epochs, all kept; m observations each.
    start : (n, D + B) array
        U before the first epoch.
    driven : (e, r, D) array
        d of the states from `at` on; not taken where nothing was observed.
    at : int
    seen : (e, o, B) array
        c of the observations from `row` on.
    row : int
    tested : int, optional
        Observations of each epoch that count; all where it is left out.
    """
    m = steps.s.shape[1]
    gram, product, x = _accumulate_sums(
        steps, np.array(start, dtype=float, order="C"), np.ascontiguousarray(driven), at,
        np.ascontiguousarray(seen), row, m if tested is None else tested,
    )  # fmt: skip
    return OmittedSums(gram, product, -x)


@njit(cache=True, nogil=True, error_model="numpy")
def _accumulate_sums(
    steps: FilterSteps,
    x: Array,
    driven: Array,
    at: int,
    seen: Array,
    row: int,
    tested: int,
) -> tuple[Array, Array, Array]:
    """Return G, b and U at the end, in place of x, U at the start."""
    a, keep, h, gain, off, s, _wanted, _rows = steps
    count, k, n = a.shape
    r, d, o, width = driven.shape[1], driven.shape[2], seen.shape[1], seen.shape[2]
    c = d + width
    moved = np.zeros((k, c))
    # The innovations are one more column: they go into the products as the others do.
    rows, square = np.zeros((_ROWS, c + 1)), np.zeros((c + 1, c + 1))
    filled = 0
    for e in range(count):
        moved[:] = 0.0
        for i in range(k):
            for j in range(n):
                size = a[e, i, j]
                if size != 0.0:
                    for q in range(c):
                        moved[i, q] += size * x[j, q]
        for i in range(k):
            for q in range(c):
                x[i, q] = moved[i, q]
        for j in range(k, n):
            if keep[e, j] != 1.0:
                for q in range(c):
                    x[j, q] *= keep[e, j]
        if not np.any(s[e] > 0.0):
            continue
        for i in range(r):
            for q in range(d):
                x[at + i, q] += driven[e, i, q]
        if filled + tested > _ROWS:
            square += rows.T @ rows
            rows[:] = 0.0
            filled = 0
        for j in range(s.shape[1]):
            if not s[e, j] > 0.0:
                continue
            column = np.zeros(c)
            if row <= j < row + o:
                for q in range(width):
                    column[d + q] = seen[e, j - row, q]
            for i in range(n):
                size = h[e, j, i]
                if size != 0.0:
                    for q in range(c):
                        column[q] += size * x[i, q]
            for i in range(n):
                size = gain[e, j, i]
                for q in range(c):
                    x[i, q] -= size * column[q]
            if j < tested:
                root = np.sqrt(s[e, j])
                for q in range(c):
                    rows[filled, q] = column[q] / root
                rows[filled, c] = off[e, j] / root
                filled += 1
    square += rows.T @ rows
    return square[:c, :c].copy(), square[:c, c].copy(), x
