"""Compute the effect of omitted constants on a Kalman filter's innovations, in kernels.

Let a constant q that is not a filter state add d q to the states at each epoch and c q to the
observations. The filter's estimates are then biased by U q, and its innovations by S q (Friedland's
separate bias)::

    predict   U ← Φ U + d
    update    S = h·U + c        U ← U − k S

with the filter's Φ, h and k (`kalman.FilterSteps`). U starts at zero, or with 1 in the row of a
state whose value differs from its prior mean by q. The recursion includes all states of the filter
and their priors, so S is the part that they cannot absorb. The innovations ν with variance s are
therefore regressed only on S, without a Jacobian of the states. For the columns S of many
constants, the sums

    G = Σ Sᵀ S / s        b = Σ Sᵀ ν / s

are all that a score test needs. The final −U is the shift of the estimates per unit of each
constant.

Source: Friedland 1969, IEEE TAC 14(4), 359–367; Willsky and Jones 1976, IEEE TAC 21(1), 108–112
(tests of innovations for constants that start at a known time).
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kalman import FilterSteps
from inercal.estimation.kernel_options import kernel

_ROWS = 512  # number of whitened rows multiplied at once


class OmittedSums(NamedTuple):
    """Sums over a run for C constants and n states."""

    gram: Array  # G, (C, C)
    product: Array  # b, (C,)
    moved: Array  # −U at the end, (n, C)


def omitted_constant_sums(
    pieces: Iterable[tuple[FilterSteps, Array, Array]],
    start: Array,
    at: int,
    row: int,
    tested: int | None = None,
) -> OmittedSums:
    """Return the sums for D constants that drive states and B constants in the observations.

    Parameters
    ----------
    pieces : iterable of (steps, driven, seen)
        Successive pieces of the run: `steps` records e epochs with m observations each, all kept;
        `driven`, (e, r, D), is d for the states from index `at` on, ignored where nothing was
        observed; `seen`, (e, o, B), is c for the observations from index `row` on.
    start : (n, D + B) array
        The value of U before the first epoch.
    at : int
    row : int
    tested : int, optional
        Number of observations per epoch that are tested; by default all.
    """
    x = np.array(start, dtype=float, order="C")
    c = x.shape[1]
    square = np.zeros((c + 1, c + 1))
    for steps, *given in pieces:
        driven, seen = map(np.ascontiguousarray, given)
        epochs, k, _ = steps.a.shape
        # The innovations are treated as one more column, so the products include them.
        rows = np.zeros((max(_ROWS, steps.s.shape[1]), c + 1))
        # The kernel neither allocates nor multiplies matrices, because both take long to compile.
        work = np.zeros((k + 1, c))
        count = steps.s.shape[1] if tested is None else tested
        ends, epoch = np.zeros(2, np.int64), 0
        while epoch < epochs:
            _whiten_rows(steps, x, driven, at, seen, row, count, epoch, work, rows, ends)
            epoch = int(ends[0])
            whitened = rows[: ends[1]]
            square += whitened.T @ whitened
    return OmittedSums(square[:c, :c].copy(), square[:c, c].copy(), -x)


@kernel
def _whiten_rows(
    steps: FilterSteps,
    x: Array,
    driven: Array,
    at: int,
    seen: Array,
    row: int,
    tested: int,
    first: int,
    work: Array,
    rows: Array,
    ends: Indices,
) -> None:
    """Propagate U, `x`, in place from epoch `first`; write whitened rows until the buffer is full.

    `ends` (2,) receives the epoch at which to continue and the number of rows written; `work`, (k +
    1, c), is scratch space.
    """
    a, keep, h = steps.a, steps.keep, steps.h
    gain, off, s = steps.gain, steps.off, steps.s
    k, n, r, d = a.shape[1], a.shape[2], driven.shape[1], driven.shape[2]
    o, c, m = seen.shape[1], x.shape[1], s.shape[1]
    column, filled = work[k], 0
    for e in range(first, a.shape[0]):
        if filled + tested > rows.shape[0]:
            ends[0], ends[1] = e, filled
            return
        for i in range(k):
            for q in range(c):
                work[i, q] = 0.0
            for j in range(n):
                size = a[e, i, j]
                if size != 0.0:
                    for q in range(c):
                        work[i, q] += size * x[j, q]
        for i in range(k):
            for q in range(c):
                x[i, q] = work[i, q]
        for j in range(k, n):
            if keep[e, j] != 1.0:
                for q in range(c):
                    x[j, q] *= keep[e, j]
        observed = False
        for j in range(m):
            observed |= s[e, j] > 0.0
        if not observed:
            continue
        for i in range(r):
            for q in range(d):
                x[at + i, q] += driven[e, i, q]
        for j in range(m):
            if not s[e, j] > 0.0:
                continue
            for q in range(c):
                column[q] = 0.0
            if row <= j < row + o:
                for q in range(d, c):
                    column[q] = seen[e, j - row, q - d]
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
    ends[0], ends[1] = a.shape[0], filled
