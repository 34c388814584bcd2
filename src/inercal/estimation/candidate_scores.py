"""Compute score tests (`inercal.estimation.scores`) for several candidates at once."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.estimation.scores import Candidate, ExplainedResidual, ScoreTest, ScoreTestSet
from inercal.estimation.whitened_problem import column_lengths, svds

_ROUNDING = 1e-12  # rounding error of a product of unit columns with a hundred thousand rows
_FEW_COLUMNS = 1000  # most columns for which the span is computed
_NUMBERS = 3_000_000  # most numbers in these columns, which are in memory together
_BATCH_NUMBERS = 500_000  # numbers in the candidate columns of one batch
_MANY = 5000  # with more rows than this, they are reduced to fewer dimensions
_VISIBLE = 3.0  # η at the largest plausible size; below this, a candidate is not scored
# Smallest share of a candidate's column that must remain in the residuals
_MIN_RESIDUAL_SHARE = 1e-6
# A direction of bench errors is open if the data show it 30 times less than another one.
_MIN_DIRECTION_SHARE = 1 / 30


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
    (found,) = score_tests_of_trials(residual[None], jacobian[None], candidates, to, spanned)
    return replace(found, dof=dof)  # of the rows before they are rotated


def score_tests_of_trials(
    residual: Array,
    jacobian: Array,
    candidates: Iterable[Candidate],
    to: Array | None = None,
    spanned: Collection[tuple[str, ...]] = (),
) -> list[ScoreTestSet]:
    """Return the score tests of the same candidates in several trials.

    The arguments are as for `score_tests`, with residuals (trials, m), Jacobians (trials, m, p) and
    rows of candidates (trials, m, k) or (m, k).
    """
    trials, m, p = jacobian.shape
    size_of = column_lengths(jacobian)
    q, triangle = np.linalg.qr(jacobian / size_of[:, None])
    back = np.linalg.pinv(triangle) / size_of[..., None]
    fit = _Fit(residual, q.mT, back if to is None else to @ back)
    result: list[list[ScoreTest]] = [[] for _ in range(trials)]
    bases: list[Array] = []
    columns_of, few = np.zeros(trials, dtype=int), min(_FEW_COLUMNS, _NUMBERS // max(m, 1))
    for batch in _batches(candidates):
        tests, shown = _tests_of_batch(batch, fit, spanned)
        for of_trial, some in zip(result, tests, strict=True):
            of_trial += some
        columns_of += [sum(one.dof for one in some) for some in tests]
        if columns_of.max() <= few:
            bases.append(shown)
    # With very many columns the largest possible span is used: the bound is valid, but wider.
    most = np.minimum(columns_of, m - p)
    spans: list[int] = (_ranks(bases, trials) if columns_of.max() <= few else most).tolist()
    chi2: list[float] = (residual[:, None] @ residual[..., None])[:, 0, 0].tolist()
    return [
        ScoreTestSet(tuple(some), span, square, m - p)
        for some, span, square in zip(result, spans, chi2, strict=True)
    ]


class _Fit(NamedTuple):
    """What all candidates need: r, Qᵀ, and the matrix from Qᵀc to shifts of the estimate."""

    residual: Array  # (trials, m)
    project: Array  # (trials, p, m)
    back: Array  # (trials, q, p)


def _tests_of_batch(
    batch: Sequence[Candidate], fit: _Fit, spanned: Collection[tuple[str, ...]]
) -> tuple[list[list[ScoreTest]], Array]:
    """Return each trial's tests, and the directions that they detect, (trials, m, d)."""
    trials, m = fit.residual.shape
    rows = [np.broadcast_to(one.rows, (trials, m, len(one.components))) for one in batch]
    columns = np.concatenate(rows, axis=-1)
    length = np.linalg.norm(columns, axis=-2)
    unit = 1 / np.where(length > 0, length, 1.0)
    groups: dict[tuple[int, bool, bool], list[tuple[int, Candidate, slice]]] = {}
    start = 0
    for place, one in enumerate(batch):
        part = slice(start, start := start + len(one.components))
        if one.largest is not None:
            unit[:, part] = one.largest
        alike = len(one.components), one.largest is None, one.moved is None
        groups.setdefault(alike, []).append((place, one, part))
    columns *= unit[:, None]
    taken = fit.project @ columns
    q = fit.project.mT
    left = columns - q @ taken
    left -= q @ (fit.project @ left)  # repeated, as the remainder may be a millionth of the column
    result: list[list[ScoreTest | None]] = [[None] * len(batch) for _ in range(trials)]
    bases: list[Array] = []
    for (_, without_size, _), members in groups.items():
        some = [one for _, one, _ in members]
        at = np.array([range(part.start, part.stop) for _, _, part in members])
        own, absorbed, rest = (np.moveaxis(a[:, :, at], 1, 2) for a in (columns, taken, left))
        rest[:, [one.components in spanned for one in some]] = 0.0
        longest = np.max(length[:, at] * unit[:, at], axis=-1)
        visible = 0.0 if without_size else _VISIBLE
        tests, u = _score_tests(some, longest, visible, unit[:, at], own, absorbed, rest, fit)
        bases.append(np.moveaxis(u, 1, 2).reshape(trials, m, -1))
        for of_trial, tested in zip(result, tests, strict=True):
            for (place, _, _), score in zip(members, tested, strict=True):
                of_trial[place] = score
    return cast(list[list[ScoreTest]], result), np.concatenate(bases, axis=-1)


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


def _score_tests(
    some: Sequence[Candidate],
    longest: Array,
    visible: float,
    unit: Array,
    columns: Array,
    taken: Array,
    left: Array,
    fit: _Fit,
) -> tuple[list[list[ScoreTest]], Array]:
    """Return the tests of c candidates with k components each in every trial, t.

    Parameters
    ----------
    some : sequence of c Candidate
    longest : (t, c) array
        Length of the longest of each candidate's columns.
    visible : float
        Smallest singular value of a direction that counts as detected.
    unit : (t, c, k) array
        The component sizes for which `columns` were computed.
    columns, taken, left : (t, c, m, k), (t, c, p, k) and (t, c, m, k) arrays
        The effect of these sizes on the rows, the part that the fit absorbs, and the remainder.
    fit : _Fit

    Returns
    -------
    list of t lists of c ScoreTest, and the directions that they detect, (t, c, m, d), or zero.
    """
    u, s, v = svds(left)
    bench = np.array([one.kind == "bench" for one in some])
    least = np.maximum(_MIN_RESIDUAL_SHARE * longest, visible)
    shown = s > np.maximum(least, bench * _MIN_DIRECTION_SHARE * s[..., 0])[..., None]
    inverse = np.where(shown, 1 / np.where(shown, s, 1.0), 0.0)
    u = u * shown[..., None, :]
    v = v * shown[..., None]
    t = (fit.residual[:, None, None] @ u)[..., 0, :]
    size = ((t * inverse)[..., None, :] @ v)[..., 0, :]
    sd = np.sqrt(np.sum((v * inverse[..., None]) ** 2, axis=-2))
    # For undetectable effects: how far the largest plausible sizes would move the estimate.
    shifts = fit.back[:, None] @ taken
    if some[0].moved is not None:
        further = np.array([one.moved for one in some]) * unit[..., None, :]
        shifts = further + (shifts if shifts.size else 0.0)
    seen: Bools = np.asarray(np.any(shown, axis=-1))
    one_shift = (shifts @ size[..., None])[..., 0]
    # Errors of a bench have random sizes, so their open directions have the deviation of the others
    typical = np.linalg.norm(size, axis=-1) / np.sqrt(np.maximum(np.sum(shown, axis=-1), 1))
    hidden = shifts - (shifts @ v.mT) @ v
    scatter = bench[:, None] * typical[..., None] * np.linalg.norm(hidden, axis=-1)
    one_shift = np.copysign(np.hypot(one_shift, scatter), one_shift)
    shift = np.where(seen[..., None], one_shift, np.linalg.norm(shifts, axis=-1))
    open_ = np.linalg.norm(v, axis=-2) < 1 - 1e-6
    explained = (columns @ size[..., None])[..., 0]
    absorbed = (taken @ size[..., None])[..., 0]
    nonzero: Bools = np.asarray(np.any(columns != 0.0, axis=(0, -1)))
    acting = [np.flatnonzero(row) for row in nonzero]
    shares = s[..., 0] / np.maximum(longest, 1e-300)
    if some[0].moved is not None:  # the estimate does not absorb what it takes from a prior
        shares = np.ones_like(shares)
    numbers = np.sum(t**2, axis=-1), shown.sum(axis=-1), shares
    chi2, dof, share = (one.tolist() for one in numbers)
    least_size = size * unit
    stated, stated_sd = (np.where(open_, np.nan, one) for one in (least_size, sd * unit))
    tests = [
        [
            ScoreTest(
                one.name,
                one.kind,
                one.components,
                one.units,
                stated[k, c],
                stated_sd[k, c],
                chi2[k][c],
                dof[k][c],
                shift[k, c],
                ExplainedResidual(acting[c], explained[k, c, acting[c]], absorbed[k, c]),
                one.largest,
                one.stated_sds,
                one.changes,
                share[k][c],
                least_size[k, c],
                one.is_switch,
                one.effect_error,
            )
            for c, one in enumerate(some)
        ]
        for k in range(len(longest))
    ]
    return tests, u


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
    """Return a residual, (d,), and c columns, (d, c), whose products are the given ones.

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


def _ranks(spaces: Sequence[Array], trials: int) -> Indices:
    """Return the dimensions of the sums of spaces, given by orthonormal bases (trials, m, k)."""
    whole = np.concatenate(spaces, axis=-1) if spaces else np.zeros((trials, 0, 0))
    across = whole.mT
    gram = whole @ across if whole.shape[1] <= whole.shape[2] else across @ whole
    if not gram.size:
        return np.zeros(trials, dtype=np.intp)
    values = np.linalg.eigvalsh(gram)
    return np.sum(values > 1e-9 * values[:, -1:], axis=-1)
