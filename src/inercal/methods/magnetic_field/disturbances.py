"""Test whether the field is the same at all nodes, with score tests (`inercal.estimation.scores`).

The nodes are divided into at most 64 stretches. These candidates are tested: a step of the field
between two stretches, a drift of the offsets, a drift of the strength, and another field during one
stretch (one rest, if there are few nodes). If the residuals are far too large, a step of the
offsets is also tested. The turns of the nodes absorb a part of each. For example, nodes without
links show only two of the three components of a step.

The products of all columns after the elimination of the turns are sufficient for the tests, so
their cost grows in proportion to the number of nodes.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.candidate_scores import rows_from_products, score_tests
from inercal.estimation.scores import Candidate, CandidateKind, ScoreTestSet, with_rows
from inercal.methods.magnetic_field.fitting import FieldFit
from inercal.methods.magnetic_field.rows import Solution

_MOST_STRETCHES = 64
_FAR = 4.0  # χ²/ν above which more causes are tested; each test lowers the power of the others
_ABSORBED = 1e-9  # share of a component's square, below which it is absorbed


def field_tests(fit: FieldFit) -> ScoreTestSet:
    """Return score tests of disturbances of the field, for the stated noise."""
    one = fit.plain
    n = len(one.problem.nodes.labels)
    edges = np.unique(np.linspace(0, n, min(n, _MOST_STRETCHES) + 1).round().astype(np.int64))
    columns = _columns(one, edges)
    flat = columns.reshape(3 * n, -1)
    by_turn = (one.rows.reading.turn.mT @ columns).reshape(3 * n, -1)
    free = one.rows.reading.jacobian.reshape(3 * n, -1)[:, one.problem.free]
    known = free.T @ flat - one.elimination.solved.T @ by_turn
    own = flat.T @ flat - by_turn.T @ one.elimination.solve_turns(by_turn)
    gram = np.block([[one.elimination.information, known], [known.T, (own + own.T) / 2]])
    f = len(known)
    product = np.concatenate([np.zeros(f), flat.T @ one.rows.reading.residual.ravel()])
    spread = np.eye(len(gram))
    whole_gram = np.zeros_like(gram)
    whole_gram[f:, f:] = flat.T @ flat
    candidates = [_visible(one, gram, whole_gram) for one in _candidates(fit, edges, spread[f:])]
    whole = np.column_stack([spread[:, :f], *(candidate.rows.T for candidate in candidates)])
    residual, rows = rows_from_products(whole.T @ gram @ whole, whole.T @ product)
    tested = score_tests(residual, rows[:, :f], with_rows(candidates, rows[:, f:]))
    return replace(tested, chi2=fit.chi2, dof=fit.dof)


def _columns(solution: Solution, edges: Indices) -> Array:
    """Return whitened columns (n, 3, k): the field and offset in each stretch, and two drifts.

    A stretch has three columns (north, west and up) for the field and three (x, y and z) for the
    offset; the drifts of the offset have three, and that of the strength one.
    """
    problem, state = solution.problem, solution.state
    n, stretches = len(problem.nodes.labels), len(edges) - 1
    white = problem.reading_whitener
    matrices = problem.model.matrices(state.coefficients, problem.nodes.temperature)
    gain = white @ matrices[:, :, :3]
    columns = np.zeros((n, 3, 2, stretches, 3))
    at = np.searchsorted(edges, np.arange(n), side="right") - 1
    columns[np.arange(n), :, 0, at] = gain @ state.attitude.mT
    columns[np.arange(n), :, 1, at] = white
    time = problem.nodes.time
    span = float(np.ptp(time)) or 1.0
    part = ((time - time.mean()) / span)[:, None, None]
    by_strength = part * (gain @ state.body_fields()[..., None])
    return np.concatenate([columns.reshape(n, 3, -1), part * white, by_strength], axis=2)


def _candidates(fit: FieldFit, edges: Indices, spread: Array) -> Iterator[Candidate]:
    """Yield candidates whose rows are combinations of the columns, (k, all columns).

    A step next to the first or last stretch would be the same as another field in that stretch.
    """
    problem = fit.plain.problem
    labels, count = problem.nodes.labels, len(edges) - 1
    ways = (
        ("north", "west", "up")
        if len(problem.directions.node)
        else ("component 1", "component 2", "component 3")
    )
    stretch, offset = spread[: 6 * count].reshape(2, count, 3, -1)
    drift = spread[6 * count :]
    for k in range(2, count - 1):
        at = f"at {labels[edges[k]]}"
        rows = stretch[k:].sum(axis=0)
        yield _candidate(f"step of the field {at}", "time", ways, rows)
        if fit.chi2 > _FAR * fit.dof:
            rows = offset[k:].sum(axis=0)
            yield _candidate(f"step of the offset {at}", "time", problem.model.axes, rows)
    yield _candidate("drift of the offset", "time", problem.model.axes, drift[:3])
    yield Candidate("drift of the strength", "time", ("drift of the strength",), ("1",), drift[3:])
    bounds: list[int] = edges.tolist()
    for k in range(count):
        first, last = labels[bounds[k]], labels[bounds[k + 1] - 1]
        at = first if first == last else f"{first}–{last}"
        yield _candidate(f"field at {at}", "row", ways, stretch[k])


def _visible(candidate: Candidate, gram: Array, whole: Array) -> Candidate:
    """Return the candidate without the components that the turns of the nodes absorb."""
    left, all_ = (np.sum(candidate.rows @ one * candidate.rows, axis=1) for one in (gram, whole))
    kept = np.flatnonzero(left > _ABSORBED * all_)
    return replace(
        candidate,
        components=tuple(candidate.components[k] for k in kept),
        units=tuple(candidate.units[k] for k in kept),
        rows=candidate.rows[kept],
    )


def _candidate(name: str, kind: CandidateKind, ways: tuple[str, ...], rows: Array) -> Candidate:
    return Candidate(name, kind, tuple(f"{name}, {way}" for way in ways), ("T",) * len(ways), rows)
