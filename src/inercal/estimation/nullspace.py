"""Analyse observability: the rank, the singular values, and which directions are undetermined.

The whitened Jacobian is expressed in units of each parameter's typical size. A singular value is
then the change of the observations, in noise standard deviations, for a move of one typical size.
The nuisances are marginalised first, with their priors: their columns are projected out. Directions
that do not change any row are then written in reduced row echelon form, which separates independent
degeneracies.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import NotObserved
from inercal.estimation.problem import Problem
from inercal.estimation.whitened_problem import LinearisationPoint, WhitenedProblem, svd

# Relative to the largest singular value. Rounding leaves about 1e-14; a direction with so small a
# singular value is not usable on any bench.
_NOTHING = 1e-10
_TERMS = 6  # most parameters that a direction in words lists
_LISTED = 3  # most directions that a message lists


@dataclass(frozen=True)
class NullDirection:
    """A combination of parameters, in units of their typical sizes.

    Parameters
    ----------
    weights : dict of str to float
        Weight of each parameter; the largest weight is one.
    words : str
        Readable form: "z.k0 + 0.98 z.k1 (in units of their typical size)".
    """

    weights: dict[str, float]
    words: str


class Observability(NamedTuple):
    """Which of the chosen parameters can be estimated, at one set of parameter values."""

    rank: int
    singular_values: Array  # descending
    null_directions: tuple[NullDirection, ...]
    weakest: NullDirection | None


UNKNOWN = Observability(0, np.zeros(0), (), None)


def observability(system: WhitenedProblem, point: LinearisationPoint) -> Observability:
    """Return which directions the data determine at a point in the first trial.

    A prior on a wanted parameter does not make a direction observed, but it may determine it.

    Raises
    ------
    NotObserved
        Neither the data nor a prior nor a gauge determines some direction.
    """
    seen = _observability(system, point, system.nuisance_rows)
    if seen.null_directions:
        free = _observability(system, point, system.prior_full).null_directions
        if free:
            words = tuple(direction.words for direction in free)
            touched = {name for direction in free for name in direction.weights}
            plain = [one.partition(" (in units")[0] for one in words]
            names = tuple(name for name in system.problem.names if name in touched)
            raise NotObserved(
                f"the data do not determine {', '.join(names)}; add rows in other attitudes or at "
                "other rates, choose fewer coefficients, or give a prior "
                f"{undetermined_combinations(plain, 'their typical size')}",
                words,
                names=names,
            )
    return seen


def _observability(
    system: WhitenedProblem, point: LinearisationPoint, prior_rows: Array
) -> Observability:
    """Return the observability with only these prior rows (b, p)."""
    problem, data = system.problem, point.weight[0][:, None] * point.rows[0]
    wanted = [problem.names.index(name) for name in problem.wanted]
    # Coordinates of the free moves, split by `left` into those that move wanted parameters and the
    # others.
    if system.basis is None:
        moves, left = np.eye(len(problem.names)), np.eye(len(wanted))
        rows = np.concatenate([data, prior_rows]) * problem.scale
        along, beside = moves[:, wanted], np.delete(moves, wanted, axis=1)
    else:
        moves = system.basis / problem.scale[:, None]
        rows = np.concatenate([data, prior_rows @ system.basis])
        left, size, right = svd(moves[wanted])
        n = int(np.sum(size > _NOTHING))
        left, along, beside = left[:, :n], right[:n].T / size[:n], right[n:].T

    if len(rows) > rows.shape[1]:
        # The triangular factor R in rows = Q R has the same null space and singular values.
        rows = np.linalg.qr(rows, mode="r")
    q, s, v = svd(rows @ beside)
    # The rows of a wide prior are weak but not zero, so only rounding errors count as zero here.
    n = int(np.sum(s > 1e-14 * np.max(s, initial=0.0)))
    q, loose = q[:, :n], v[n:]

    direct = rows @ along
    reference = np.linalg.norm(direct)
    _, s, v = svd(direct - q @ (q.T @ direct))
    rank = int(np.sum(s > _NOTHING * reference))
    singular = np.concatenate([s, np.zeros(left.shape[1] - len(s))])

    null = v[rank:] @ left.T
    directions = _name_null_directions(problem, point.x[0], null)
    directions += [
        named_direction(problem.names, w) for w in row_echelon_form(loose @ (moves @ beside).T)
    ]
    weakest = None
    if rank:
        weights = v[rank - 1] @ left.T
        weights = weights / weights[np.argmax(np.abs(weights))]
        weakest = named_direction(problem.wanted, np.where(np.abs(weights) > 0.05, weights, 0.0))
    return Observability(rank, singular, tuple(directions), weakest)


def _name_null_directions(problem: Problem, x: Array, null: Array) -> list[NullDirection]:
    """Return the null directions as rows (q, wanted), the known ones first."""
    directions: list[NullDirection] = []
    wanted = [problem.names.index(name) for name in problem.wanted]
    for words, known in problem.known_nulls:
        vectors = np.atleast_2d(known(x) if callable(known) else known) / problem.scale
        _, size, span = svd(vectors[:, wanted], full_matrices=False)
        span = span[size > _NOTHING * np.max(size, initial=0.0)]
        # Directions common to both spaces have a principal angle of zero (Björck and Golub 1973).
        _, cosine, turn = svd(null @ span.T)
        common = turn[: len(cosine)][cosine > 1 - 1e-9] @ span
        if len(common):
            found = [named_direction(problem.wanted, w) for w in row_echelon_form(common)]
            directions += [NullDirection(d.weights, f"{words}: {d.words}") for d in found]
            # Keep the part of the null space that is orthogonal to the directions named so far.
            null = svd(null - (null @ common.T) @ common, full_matrices=False)[2]
            null = null[: len(null) - len(common)]
    return directions + [named_direction(problem.wanted, w) for w in row_echelon_form(null)]


def first_combinations(words: Sequence[str]) -> str:
    """Return the first combinations of coefficients as one text, and the number of the others."""
    more = len(words) - _LISTED
    return "; ".join([*words[:_LISTED], *([f"and {more} more"] if more > 0 else [])])


def undetermined_combinations(words: Sequence[str], units: str = "g and rad/s") -> str:
    """Return the end of a message: the first undetermined combinations, in brackets."""
    return f"(undetermined combinations, in units of {units}: {first_combinations(words)})"


def row_echelon_form(rows: Array) -> Array:
    """Return the reduced row echelon form of independent rows, scaled to largest weight 1."""
    if not len(rows):
        return rows
    rows = rows.copy()
    for i in range(len(rows)):
        # Among equal weights the first parameter is the pivot, so that rounding does not decide.
        size = np.max(np.abs(rows[i:]), axis=0)
        column = int(np.flatnonzero(size > 0.999 * np.max(size))[0])
        pivot = i + int(np.argmax(np.abs(rows[i:, column])))
        rows[[i, pivot]] = rows[[pivot, i]]
        rows[i] /= rows[i, column]
        others = np.arange(len(rows)) != i
        rows[others] -= rows[others, column : column + 1] * rows[i]
    largest = np.argmax(np.abs(rows), axis=1)
    rows /= rows[np.arange(len(rows)), largest, None]
    rows = np.where(np.abs(rows) > 1e-6, rows, 0.0)
    return rows[np.argsort([np.flatnonzero(row)[0] for row in rows], kind="stable")]


def named_direction(names: Sequence[str], weights: Array) -> NullDirection:
    """Describe a direction in words, using only its largest parameters."""
    chosen = {name: float(w) for name, w in zip(names, weights, strict=True) if w != 0}
    largest = sorted(chosen, key=lambda name: -abs(round(chosen[name], 9)))[:_TERMS]
    words = ""
    for name in (name for name in chosen if name in largest):
        size = f"{abs(chosen[name]):.3g}"
        sign = " − " if chosen[name] < 0 else " + "
        words += (sign if words or chosen[name] < 0 else "") + ("" if size == "1" else size + " ")
        words += name
    words = words.strip().replace("− ", "−", 1) if words.startswith(" −") else words
    if len(chosen) > _TERMS:
        words += f" and {len(chosen) - _TERMS} more"
    if len(chosen) > 1:
        words += " (in units of their typical size)"
    return NullDirection(chosen, words)
