"""Compute the residuals of a field problem, normal equations without the attitudes, and solutions.

R_k takes vectors of body frame k to the frame of the field (x magnetic north, y west, z up)::

    field of a node     h_k = R_kᵀ B (cos δ, 0, −sin δ)
    reading             y_k = D(c) h_k + o(c) + noise
    upward direction    u_k = R_kᵀ (0, 0, 1) − U_k s + noise    (the two components across u_k)
    rotation            0 = Log(C_jᵀ R_jᵀ R_{j+1}) − Γ_j s + noise

s is the correction of the known coefficients (true minus used), with the prior N(0, P). A small
turn of a node is R_k Exp(φ_k). The normal equations of all φ are block tridiagonal. A banded
Cholesky decomposition eliminates them (Schur complement), in a time proportional to the number of
nodes.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg

from inercal.basics.arrays import Array, Indices
from inercal.basics.units import Measured
from inercal.estimation.scores import chi2_tail_probability
from inercal.methods.magnetic_field.records import Directions, FieldNodes, LinearModel, Links
from inercal.physics.frames import exp_so3, log_so3, skew

# Share of a node's information that is added, so a decomposition exists at a pole of the field.
_TINY = 1e-13


class FieldState(NamedTuple):
    """Values of all unknowns."""

    coefficients: Array  # (p,)
    dip: float  # δ, rad; 0 if no node has an upward direction
    strength: float  # B, which is fixed: only D B is determined
    known: Array  # (r,), the correction s in units of its prior
    attitude: Array  # (n, 3, 3), R_k

    @property
    def field(self) -> Array:
        """The field in its own frame, (3,)."""
        return self.strength * np.array([np.cos(self.dip), 0.0, -np.sin(self.dip)])

    def body_fields(self) -> Array:
        """Return the field in each node's body frame, (n, 3)."""
        return self.field @ self.attitude

    def moved(self, step: Array, turns: Array) -> "FieldState":
        """Return the state after a step of (c, δ, s) and after turns (n, 3)."""
        p = len(self.coefficients)
        return FieldState(
            self.coefficients + step[:p],
            self.dip + float(step[p]),
            self.strength,
            self.known + step[p + 1 :],
            self.attitude @ exp_so3(turns),
        )


@dataclass(frozen=True, eq=False)
class FieldProblem:
    """The data, the priors and the choice of unknowns.

    Parameters
    ----------
    nodes, model, directions, links
    known : (q, q) array
        Covariance P of the known coefficients; it may be singular.
    dip : Measured, optional
        Prior of the dip.
    strength : float, optional
        B, if it is stated.
    disturbance : (3, 3) array
        Covariance of each reading that is added for an inhomogeneous field.
    """

    nodes: FieldNodes
    model: LinearModel
    directions: Directions
    links: Links
    known: Array
    dip: Measured | None = None
    strength: float | None = None
    disturbance: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @cached_property
    def root(self) -> Array:
        """Matrix L with L Lᵀ = P, (q, r)."""
        size = np.sqrt(np.maximum(np.diagonal(self.known), 0.0))
        size = np.where(size > 0, size, 1.0)
        values, vectors = np.linalg.eigh(self.known / np.outer(size, size))
        kept = values > 1e-12 * len(values)
        return size[:, None] * vectors[:, kept] * np.sqrt(values[kept])

    @cached_property
    def free(self) -> Indices:
        """Indices of the unknowns in (c, δ, s); δ only if a node has an upward direction."""
        p = len(self.model.names)
        fixed = [] if len(self.directions.node) else [p]
        return np.setdiff1d(np.arange(self.count), fixed)

    @property
    def count(self) -> int:
        """Number of elements P of (c, δ, s)."""
        return len(self.model.names) + 1 + self.root.shape[1]

    @cached_property
    def gauges(self) -> Indices:
        """First nodes of the chains in which no node has an upward direction.

        In such a chain, the turn about the field is arbitrary.
        """
        starts = np.setdiff1d(np.arange(len(self.nodes.labels)), self.links.before + 1)
        chain = np.searchsorted(starts, self.directions.node, side="right") - 1
        return np.delete(starts, np.unique(chain))

    @property
    def dof(self) -> int:
        """Degrees of freedom of χ²; prior rows and the quantities with a prior cancel."""
        turns = np.where(self.links.about_up, 1, 3)
        d = len(self.directions.node)
        rows = 2 * d + int(turns.sum()) + len(self.gauges)
        return rows - len(self.model.names) - (d > 0 and self.dip is None)

    @cached_property
    def reading_whitener(self) -> Array:
        """Whitening matrices of the readings, (n, 3, 3)."""
        return _whitener(self.nodes.covariance + self.disturbance)

    @cached_property
    def across(self) -> Array:
        """Two whitened unit vectors across each upward direction, (d, 2, 3)."""
        up = self.directions.up
        least = np.eye(3)[np.argmin(np.abs(up), axis=1)]
        first = np.cross(up, least)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        both = np.stack([first, np.cross(up, first)], axis=1).astype(np.float64)
        return np.asarray(_whitener(both @ self.directions.covariance @ both.mT) @ both)

    @cached_property
    def link_whitener(self) -> Array:
        """Whitening matrices of the rotations, (l, 3, 3), with one row for turns about up."""
        if not self.links.about_up.any():
            return _whitener(self.links.covariance)
        whitener = _whitener(self.links.covariance)
        turns = self.links.about_up
        after = np.searchsorted(self.directions.node, self.links.before[turns] + 1)
        up = self.directions.up[after]
        variance = np.einsum("ki,kij,kj->k", up, self.links.covariance[turns], up)
        whitener[turns] = 0.0
        whitener[turns, 0] = up / np.sqrt(variance)[:, None]
        return whitener


class Block(NamedTuple):
    """k groups of m whitened residuals of one kind, and their derivatives."""

    residual: Array  # (k, m)
    jacobian: Array  # (k, m, P), in (c, δ, s)
    turn: Array  # (k, m, 3), in the turn of a node; of a link, the second one


class FieldRows(NamedTuple):
    """All whitened residuals."""

    reading: Block  # of n nodes, m = 3
    direction: Block  # of d nodes, m = 2
    link: Block  # of l links, m = 3
    link_turn_before: Array  # (l, 3, 3), derivatives of the links in the turn of the first node
    prior: Array  # (P,)
    prior_weight: Array  # (P,), 1 / sd

    @property
    def blocks(self) -> tuple[Block, Block, Block]:
        """All rows but those of the priors."""
        return self.reading, self.direction, self.link

    @property
    def cost(self) -> float:
        """χ² of all rows, including the priors."""
        parts = (*(one.residual for one in self.blocks), self.prior)
        return sum(float(np.sum(part**2)) for part in parts)


def field_rows(problem: FieldProblem, state: FieldState) -> FieldRows:
    """Return the whitened rows at a state."""
    nodes, model, p, count = problem.nodes, problem.model, len(problem.model.names), problem.count
    h = state.body_fields()
    matrices = model.matrices(state.coefficients, nodes.temperature)
    white = problem.reading_whitener
    gain = white @ matrices[:, :, :3]
    off = nodes.reading - matrices[:, :, 3]
    reading = (white @ off[..., None] - gain @ h[..., None])[..., 0]
    jacobian = np.zeros((len(h), 3, count))
    jacobian[:, :, :p] = white @ model.derivatives(h, nodes.temperature)
    by_dip = state.strength * np.array([-np.sin(state.dip), 0.0, -np.cos(state.dip)])
    jacobian[:, :, p] = (gain @ (by_dip @ state.attitude)[..., None])[..., 0]

    directions, across = problem.directions, problem.across
    up = state.attitude[directions.node, 2]
    by_known = directions.derivative @ problem.root
    direction = directions.up - up + by_known @ state.known
    direction_jacobian = np.zeros((len(up), 2, count))
    direction_jacobian[:, :, p + 1 :] = -across @ by_known

    weight = np.zeros(count)
    prior = np.zeros(count)
    if problem.dip is not None:
        weight[p] = 1 / problem.dip.sd
        prior[p] = weight[p] * (problem.dip.value - state.dip)
    weight[p + 1 :], prior[p + 1 :] = 1.0, -state.known
    seen = Block((across @ direction[..., None])[..., 0], direction_jacobian, across @ skew(up))
    return FieldRows(
        Block(reading, jacobian, gain @ skew(h)), seen, *_link_rows(problem, state), prior, weight
    )


def _link_rows(problem: FieldProblem, state: FieldState) -> tuple[Block, Array]:
    """Return the rows of the links, and their derivatives in the turn of the first node."""
    links, p, count = problem.links, len(problem.model.names), problem.count
    if not len(links.before):
        none = np.zeros((0, 3, 3))
        return Block(np.zeros((0, 3)), np.zeros((0, 3, count)), none), none
    white = problem.link_whitener
    before, after = state.attitude[links.before], state.attitude[links.before + 1]
    error = log_so3(links.rotation.mT @ before.mT @ after)
    by_known = links.derivative @ problem.root
    jacobian = np.zeros((len(error), 3, count))
    jacobian[:, :, p + 1 :] = -white @ by_known
    turn = white @ (np.eye(3) + 0.5 * skew(error))
    rows = (white @ (by_known @ state.known - error)[..., None])[..., 0]
    return Block(rows, jacobian, turn), -turn @ after.mT @ before


class Elimination(NamedTuple):
    """Normal equations without the turns: `information` x = `gradient` for the free unknowns."""

    factor: Array  # (6, 3 n), banded Cholesky factor of the turns
    solved: Array  # (3 n, f), turns per unit of each free unknown
    information: Array  # (f, f)
    gradient: Array  # (f,)
    turns: Array  # (3 n,), step of the turns if the other unknowns stay
    decrease: float  # of χ², by this step

    def solve_turns(self, right: Array) -> Array:
        """Return N⁻¹ times a right-hand side (3 n, k), where N belongs to the turns."""
        return np.asarray(scipy.linalg.cho_solve_banded((self.factor, True), right))


def eliminate(problem: FieldProblem, state: FieldState, rows: FieldRows) -> Elimination:
    """Eliminate the turns of all nodes from the normal equations."""
    n, free = len(problem.nodes.labels), problem.free
    one, two = problem.directions.node, problem.links.before
    reading_turn = rows.reading.turn.mT
    block = reading_turn @ rows.reading.turn
    coupling = reading_turn @ rows.reading.jacobian
    gradient = (reading_turn @ rows.reading.residual[..., None])[..., 0]
    whole = np.concatenate([part.jacobian.reshape(-1, problem.count) for part in rows.blocks])
    right = whole.T @ np.concatenate([part.residual.ravel() for part in rows.blocks])
    right += rows.prior_weight * rows.prior
    whole = whole.T @ whole + np.diag(rows.prior_weight**2)
    before = rows.link._replace(turn=rows.link_turn_before)
    for at, part in ((one, rows.direction), (two, before), (two + 1, rows.link)):
        block[at] += part.turn.mT @ part.turn
        coupling[at] += part.turn.mT @ part.jacobian
        gradient[at] += (part.turn.mT @ part.residual[..., None])[..., 0]
    size = np.linalg.trace(block)
    block += (_TINY * size)[:, None, None] * np.eye(3)
    about = state.body_fields()[problem.gauges] / state.strength
    block[problem.gauges] += size[problem.gauges, None, None] * about[:, :, None] * about[:, None]

    band = np.zeros((6, n, 3))
    beside = np.zeros((n, 3, 3))
    beside[two] = rows.link.turn.mT @ rows.link_turn_before
    below = np.concatenate([block, beside], axis=1)
    for column in range(3):
        band[: 6 - column, :, column] = below[:, column:, column].T
    factor = scipy.linalg.cholesky_banded(band.reshape(6, 3 * n), lower=True)
    flat = coupling.reshape(3 * n, -1)[:, free]
    both = np.column_stack([flat, gradient.ravel()])
    solved = scipy.linalg.cho_solve_banded((factor, True), both)
    information = whole[np.ix_(free, free)] - flat.T @ solved[:, :-1]
    return Elimination(
        np.asarray(factor),
        solved[:, :-1],
        (information + information.T) / 2,
        right[free] - flat.T @ solved[:, -1],
        solved[:, -1],
        float(gradient.ravel() @ solved[:, -1]),
    )


def _whitener(covariance: Array) -> Array:
    """Return W with Wᵀ W = covariance⁻¹, (k, m, m)."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=np.float64)


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
