"""Compute score tests (`inercal.estimation.scores`) for several candidates at once."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation.scores import Candidate, ExplainedResidual, ScoreTest, ScoreTestSet
from inercal.estimation.whitened_problem import column_lengths, svd

_ROUNDING = 1e-12  # rounding error of a product of unit columns with a hundred thousand rows
_FEW_COLUMNS = 1000  # most columns for which the span is computed
_NUMBERS = 3_000_000  # most numbers in these columns, which are in memory together
_BATCH_NUMBERS = 500_000  # numbers in the candidate columns of one batch
_MANY = 5000  # with more rows than this, they are reduced to fewer dimensions
_VISIBLE = 3.0  # η at the largest plausible size; below this, a candidate is not scored
# Smallest share of a candidate's column that must remain in the residuals
_MIN_RESIDUAL_SHARE = 1e-6


def score_tests(
    residual: Array,
    jacobian: Array,
    candidates: Iterable[Candidate],
    to: Array | None = None,
    spanned: Collection[tuple[str, ...]] = (),
) -> ScoreTestSet:
    """Return the score tests of the candidates.

    Parameters
    ----------
    residual : (m,) array
        Whitened residual at the solution, including the rows of the priors.
    jacobian : (m, p) array
        Whitened ∂h/∂x for the same rows.
    candidates : iterable of Candidate
        Candidates with whitened rows, (m, k), which are zero in the rows of priors. If `moved` is
        given, it refers to the parameters whose shift is requested.
    to : (q, p) array, optional
        Matrix from the p coordinates of `jacobian` to the parameters whose shift is requested.
    spanned : collection of tuple of str
        Candidate components that are not scored, because the estimated parameters have exactly the
        same effect.
    """
    dof = len(residual) - jacobian.shape[1]
    if len(residual) > _MANY and isinstance(candidates, Sequence):
        residual, jacobian, candidates = _rotate_rows(residual, jacobian, candidates)
    size_of = column_lengths(jacobian)
    q, triangle = np.linalg.qr(jacobian / size_of)
    back = np.linalg.pinv(triangle) / size_of[:, None]
    back = back if to is None else to @ back
    result: list[ScoreTest] = []
    bases: list[Array] = []
    columns_of, few = 0, min(_FEW_COLUMNS, _NUMBERS // max(len(residual), 1))
    for batch in _batches(candidates):
        lengths = [np.linalg.norm(one.rows, axis=0) for one in batch]
        units = [_unit(one, length) for one, length in zip(batch, lengths, strict=True)]
        columns = np.concatenate([one.rows for one in batch], axis=1) * np.concatenate(units)
        taken = q.T @ columns
        left = columns - q @ taken
        left -= q @ (q.T @ left)  # repeated, because the remainder may be a millionth of the column
        start = 0
        for one, length, unit in zip(batch, lengths, units, strict=True):
            part = slice(start, start := start + unit.size)
            score, u = _score_test(
                one,
                length,
                unit,
                columns[:, part],
                taken[:, part],
                np.zeros_like(left[:, part]) if one.components in spanned else left[:, part],
                residual,
                back,
            )
            result.append(score)
            columns_of += score.dof
            if columns_of <= few:
                bases.append(u)
    # With very many columns the largest possible span is used: the bound is valid, but wider.
    span = _rank(bases) if columns_of <= few else min(columns_of, dof)
    return ScoreTestSet(tuple(result), span, float(residual @ residual), dof)


def _batches(candidates: Iterable[Candidate]) -> Iterator[list[Candidate]]:
    """Yield candidates in batches, so that the directions of all rows are read once per batch."""
    batch: list[Candidate] = []
    numbers = 0
    for one in candidates:
        batch.append(one)
        numbers += one.rows.size
        if numbers >= _BATCH_NUMBERS:
            yield batch
            batch, numbers = [], 0
    if batch:
        yield batch


def _unit(candidate: Candidate, length: Array) -> Array:
    """Return the component sizes that scale the columns, (k,)."""
    if candidate.largest is not None:
        return candidate.largest
    return np.asarray(1 / np.where(length > 0, length, 1.0))


def _score_test(
    one: Candidate,
    length: Array,
    unit: Array,
    columns: Array,
    taken: Array,
    left: Array,
    residual: Array,
    back: Array,
) -> tuple[ScoreTest, Array]:
    """Return one candidate's test and a basis of its effect on the residuals, (m, k).

    Parameters
    ----------
    one : Candidate
    length, unit : (k,) arrays
        Lengths of the candidate's columns, and the component sizes for which `columns` were
        computed.
    columns, taken, left : (m, k), (p, k) and (m, k) arrays
        The effect of these sizes on the rows, the part that the fit absorbs, and the remainder.
    residual : (m,) array
    back : (q, p) array
        Matrix from the absorbed part to shifts of the estimate.
    """
    u, s, v = svd(left, full_matrices=False)
    longest = float(np.max(length * unit, initial=0.0))
    least = _MIN_RESIDUAL_SHARE * longest
    shown = s > (least if one.largest is None else max(least, _VISIBLE))
    k, largest = int(shown.sum()), float(s[0]) if s.size else 0.0
    u, s, v = u[:, :k], s[:k], v[:k]
    t = u.T @ residual
    size, sd = v.T @ (t / s), np.sqrt(np.sum((v.T / s) ** 2, axis=1))
    # For undetectable effects: how far the largest plausible sizes would move the estimate.
    moves = size[:, None] if k else np.eye(len(unit))
    shifts = back @ (taken @ moves)
    if one.moved is not None:
        shifts = one.moved @ (unit[:, None] * moves) + (shifts if shifts.size else 0.0)
    shift = shifts[:, 0] if k else np.linalg.norm(shifts, axis=1)
    open_ = np.linalg.norm(v, axis=0) < 1 - 1e-6 if k else np.ones(len(unit), dtype=bool)
    at = np.flatnonzero(np.any(columns != 0.0, axis=1))
    score = ScoreTest(
        one.name,
        one.kind,
        one.components,
        one.units,
        np.where(open_, np.nan, size * unit),
        np.where(open_, np.nan, sd * unit),
        float(t @ t),
        k,
        shift,
        ExplainedResidual(at, columns[at] @ size, taken @ size),
        one.largest,
        one.stated_sds,
        one.changes,
        largest / max(longest, 1e-300),
        size * unit,
    )
    return score, u


def spanned_candidates(
    jacobian: Array, candidates: Iterable[Candidate]
) -> frozenset[tuple[str, ...]]:
    """Return the candidate components whose columns lie in the span of the Jacobian's columns.

    Parameters
    ----------
    jacobian, candidates
        The same as for `score_tests`.
    """
    q, _ = np.linalg.qr(jacobian / column_lengths(jacobian))
    found: list[tuple[str, ...]] = []
    for one in candidates:
        left = one.rows - q @ (q.T @ one.rows)
        share = np.linalg.norm(left, axis=0) / np.maximum(np.linalg.norm(one.rows, axis=0), 1e-300)
        if np.all(share < _MIN_RESIDUAL_SHARE):
            found.append(one.components)
    return frozenset(found)


def _rotate_rows(
    residual: Array, jacobian: Array, candidates: Sequence[Candidate]
) -> tuple[Array, Array, list[Candidate]]:
    """Rotate the rows into as few dimensions as there are columns, which keeps all products."""
    column: dict[str, Array] = {}
    for one in candidates:
        column |= dict(zip(one.components, one.rows.T, strict=True))
    at = {name: 1 + jacobian.shape[1] + k for k, name in enumerate(column)}
    whole = np.concatenate([residual[:, None], jacobian, np.array(list(column.values())).T], axis=1)
    r = np.asarray(np.linalg.qr(whole, mode="r"))
    return (
        r[:, 0],
        r[:, 1 : 1 + jacobian.shape[1]],
        [replace(one, rows=r[:, [at[name] for name in one.components]]) for one in candidates],
    )


def rows_from_products(gram: Array, product: Array) -> tuple[Array, Array]:
    """Return a residual (d,) and c columns (d, c) that have the given products.

    The residual and the columns are the coordinates of m whitened rows in an orthonormal basis of
    the d directions that the columns span. The scores need no other information about the rows.

    Parameters
    ----------
    gram : (c, c) array
        Products of the columns with each other.
    product : (c,) array
        Products of the columns with the residual.
    """
    length = np.sqrt(np.diagonal(gram))
    length = np.where(length > 0, length, 1.0)
    values, vectors = np.linalg.eigh(gram / np.outer(length, length))
    kept = values > _ROUNDING * len(values)
    root, basis = np.sqrt(values[kept]), vectors[:, kept]
    return (basis.T @ (product / length)) / root, (root[:, None] * basis.T) * length


def _rank(spaces: Sequence[Array]) -> int:
    """Return the dimension of the sum of spaces, each given by an orthonormal basis (m, k)."""
    columns = [space for space in spaces if space.shape[1]]
    if not columns:
        return 0
    whole = np.concatenate(columns, axis=1)
    gram = whole @ whole.T if whole.shape[0] <= whole.shape[1] else whole.T @ whole
    values = np.linalg.eigvalsh(gram)
    return int(np.sum(values > 1e-9 * values[-1]))
