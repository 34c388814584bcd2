"""Solve a field problem by Gauss–Newton steps, from several closed-form starts."""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation.scores import chi2_tail_probability
from inercal.methods.magnetic_field.rows import (
    Elimination,
    FieldProblem,
    FieldRows,
    FieldState,
    eliminate,
    field_rows,
)

_MOST_ITERATIONS = 60
_MOST_HALVINGS = 8
_SMALL_STEP = 1e-8  # decrease of χ² predicted for the next step
_STEP_SIZE = 3.0  # typical sizes; bounds the steps in directions that are hardly determined
_SURELY_WRONG = 1e-4  # p-value of χ², below which the other starts are tried too


class Solution(NamedTuple):
    """The end of an iteration."""

    problem: FieldProblem
    state: FieldState
    rows: FieldRows
    elimination: Elimination
    converged: bool
    iterations: int

    @property
    def chi2(self) -> float:
        """χ² of all rows, including the priors."""
        return self.rows.cost


def typical_sizes(problem: FieldProblem, strength: float) -> Array:
    """Return, for each free unknown, the change that moves a reading by about one field, (f,)."""
    model = problem.model
    effect = np.linalg.norm(model.directions, axis=(1, 2))
    warm = np.maximum(np.max(np.abs(problem.nodes.temperature), initial=0.0), 1e-9)
    of_coefficients = np.where(model.acts_on_field, 1.0, strength) / effect / warm**model.powers
    rest = np.ones(problem.root.shape[1])
    return np.concatenate([of_coefficients, [1.0], rest])[problem.free]


def solve(problem: FieldProblem, state: FieldState, most: int = _MOST_ITERATIONS) -> Solution:
    """Return the minimum of χ² that Gauss–Newton steps reach from a state."""
    size = typical_sizes(problem, state.strength)
    rows = field_rows(problem, state)
    for count in range(most + 1):
        found = eliminate(problem, state, rows)
        damped = found.information * np.outer(size, size) + np.eye(len(size)) / _STEP_SIZE**2
        step = size * np.linalg.solve(damped, size * found.gradient)
        converged = float(step @ found.gradient) + found.decrease < _SMALL_STEP
        if converged or count == most:
            return Solution(problem, state, rows, found, converged, count)
        whole = np.zeros(problem.count)
        whole[problem.free] = step
        turns = (found.turns - found.solved @ step).reshape(-1, 3)
        for share in 0.5 ** np.arange(_MOST_HALVINGS):
            moved = state.moved(share * whole, share * turns)
            next_rows = field_rows(problem, moved)
            if next_rows.cost <= rows.cost * (1 + 1e-12) + _SMALL_STEP:
                break
        else:
            return Solution(problem, state, rows, found, False, count)
        state, rows = moved, next_rows
    raise AssertionError("unreachable")


def best_solution(problem: FieldProblem, starts: list[FieldState]) -> Solution:
    """Return the solution with the smallest χ² among those from all starts.

    The starts are tried in the order of their χ². If the first leads to a plausible χ², the others
    are not needed.
    """
    starts = sorted(starts, key=lambda one: field_rows(problem, one).cost)
    best: Solution | None = None
    for start in starts:
        found = solve(problem, start)
        if best is None or (found.converged, -found.chi2) > (best.converged, -best.chi2):
            best = found
        if best.converged and chi2_tail_probability(best.chi2, problem.dof) > _SURELY_WRONG:
            break
    assert best is not None
    return best
