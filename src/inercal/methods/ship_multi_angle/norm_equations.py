"""The source's equations for the norms of a tilted triad, their solution, and the symmetric frame.

With v = M a + p, in g, each group has one equation and one row of the Jacobian J for θ::

    |v|² = A² + 1,   J = 2 (v_x aᵀ, v_y aᵀ, v_z aᵀ, vᵀ)

(M, p) → (R M, R p) keeps every norm, so the three rotations with v·(e × v) = 0 are null directions
of J at every point, for any data. The source notes that the linear equations are rank-deficient and
damps them: (JᵀJ + μ) Δ = −Jᵀρ, ρ = |v|² − (A² + 1). A damped step has no component along a null
direction, so the result equals the start there.

The user may state a frame, which replaces the rotation of the start. By the polar decomposition,
exactly one rotation or reflection R makes the inverse H of R M symmetric and positive definite::

    H = S Q,   (M, p) → (Q M, Q p),   H → S

That is the frame "symmetric", which favours no axis of the sensor. Its three conditions H_ij = H_ji
are exact. A change Δ of θ changes the result by P Δ, which combines Δ and the rotation that
restores the conditions::

    P = I − R (C R)⁻¹ C

The columns of R are the rotations, and the rows of C are the slopes of H_ij − H_ji. Because
P R = 0, the start or chance that decided the rotation affects neither the result nor its
uncertainty.

A global search replaces the source's commercial optimiser: SciPy's differential evolution (Storn
and Price 1997) minimises the sum of squares of the equations within bounds about nominal. The
damped equations then refine the result. The source sets its optimiser a goal of 5 % error; here the
error is the largest value of | |M a + p| / √(A² + 1) − 1 | over the groups. Even coefficients far
from the truth meet this goal. Equal seeds give equal results, unless the time limit ends the
search.

Source: Xiao Changrun, Liu Yang, Liu Ruijie, Transducer and Microsystem Technologies 33(10), 2014,
equations 6 to 9. Levenberg 1944 and Marquardt 1963 for μ, which the source does not print: μ is
divided by ten after a step that lowers the sum of squares, and multiplied by ten after one that
does not.
"""

# SciPy has no type stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import scipy

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import NotObserved
from inercal.benches.rate_table.bench import RateTable, sensed_motion
from inercal.benches.rate_table.fixture import is_tilted
from inercal.methods.solving import refuse_temperature_terms, require_matching_rows
from inercal.physics.frames import decompose_symmetric, skew
from inercal.physics.plan import Spins
from inercal.physics.sensors import G0, Sensor
from inercal.physics.sensors.affine import IDENTITY_PARAMETERS, AffineModel, require_affine_triad
from inercal.recordings import Observations

MIN_TILTED_STATES = 12  # groups
RANK_TOLERANCE = 1e-9  # of the largest singular value; smaller ones determine no direction
_INITIAL_DAMPING, _MAX_DAMPING = 1e-3, 1e12  # μ relative to the largest eigenvalue
# g, or relative: the problem is nearly linear, so the next step is far smaller
_CONVERGED_STEP = 1e-10
_ROUNDING = 2.0**-46  # relative to the squares
_PAIRS = ((1, 2), (2, 0), (0, 1))
_MAX_STEPS = 200
GOAL = 0.05
_POPULATION_FACTOR = 15  # times twelve


def norm_residuals(model: AffineModel, a: Array, square: Array) -> Array:
    """Return |M a + p|² − (A² + 1), (..., r) g², for readings (..., r, 3) g and A² + 1 (r,)."""
    return (model.correct(a) ** 2).sum(-1) - square


def norm_jacobian(model: AffineModel, a: Array) -> Array:
    """Return the Jacobian J with respect to θ, (..., r, 12)."""
    v = model.correct(a)
    by_matrix = v[..., :, None] * a[..., None, :]
    return 2 * np.concatenate([by_matrix.reshape(*v.shape[:-1], 9), v], axis=-1)


def rotation_directions(model: AffineModel) -> Array:
    """Return the rotations of the triad about x, y and z as changes of θ, (..., 3, 12)."""
    turns = skew(np.eye(3))
    matrix = turns @ model.matrix[..., None, :, :]
    offset = (turns @ model.offset[..., None, :, None])[..., 0]
    return AffineModel(matrix, offset).theta


def to_symmetric_frame(model: AffineModel) -> AffineModel:
    """Return models (...) with the same norms in the symmetric frame.

    Raises
    ------
    InputError
        A matrix is singular.
    """
    mirror = np.sign(np.linalg.det(model.matrix))
    plain = AffineModel(model.matrix * mirror[..., None, None], model.offset * mirror[..., None])
    _, turn = decompose_symmetric(plain.inverse.matrix)
    return AffineModel(turn @ plain.matrix, (turn @ plain.offset[..., None])[..., 0])


def frame_projection(model: AffineModel) -> Array:
    """Return P for models (...) in the symmetric frame, (..., 12, 12)."""
    slope = model.slope
    c = np.stack([slope[..., 3 * i + j, :] - slope[..., 3 * j + i, :] for i, j in _PAIRS], axis=-2)
    r = rotation_directions(model).mT
    return np.eye(12) - r @ np.asarray(np.linalg.solve(c @ r, c), dtype=float)


class DampedSolution(NamedTuple):
    """The solution of the damped equations, for (...) trials."""

    model: AffineModel
    cost: Array  # (...), Σρ², g⁴
    converged: Bools
    steps: Indices


def damped_solution(a: Array, square: Array, start: AffineModel) -> DampedSolution:
    """Minimise the sum of squares of the equations by damped steps from a start.

    Parameters
    ----------
    a : (..., r, 3) array
        Readings in g.
    square : (r,) array
        A² + 1, g².
    start : AffineModel
        Starts for (...) trials, or one for all.
    """
    lead = a.shape[:-2]
    a = a.reshape(-1, *a.shape[-2:])
    theta = np.broadcast_to(start.theta, (*lead, 12)).reshape(-1, 12).copy()
    cost = (norm_residuals(AffineModel.of(theta), a, square) ** 2).sum(-1)
    mu = np.full(len(a), np.nan)
    converged, active = np.zeros(len(a), dtype=bool), np.ones(len(a), dtype=bool)
    steps = np.zeros(len(a), dtype=np.intp)
    for _ in range(_MAX_STEPS):
        now = np.flatnonzero(active)
        if not len(now):
            break
        model = AffineModel.of(theta[now])
        u, s, vt = np.linalg.svd(norm_jacobian(model, a[now]), full_matrices=False)
        mu[now] = np.where(np.isnan(mu[now]), _INITIAL_DAMPING * s[:, 0] ** 2, mu[now])
        # Take no step along a null direction, because only rounding would decide its size.
        seen = s > RANK_TOLERANCE * s[:, :1]
        share = np.where(seen, s / np.where(seen, s**2 + mu[now, None], 1.0), 0.0)
        pull = (u.mT @ norm_residuals(model, a[now], square)[..., None])[..., 0]
        move = -(vt.mT @ (share * pull)[..., None])[..., 0]
        tried = theta[now] + move
        then = (norm_residuals(AffineModel.of(tried), a[now], square) ** 2).sum(-1)
        # A predicted decrease that is smaller than the rounding of the sum cannot be verified.
        promised = (np.where(seen, pull, 0.0) ** 2).sum(-1)
        slack = _ROUNDING * np.linalg.norm(square) * np.sqrt(cost[now])
        better = (then <= cost[now]) | (promised <= slack)
        # Convergence is judged by the undamped step, because a large μ makes any step small.
        whole = np.where(seen, pull / np.where(seen, s, 1.0), 0.0)
        left = np.linalg.norm(whole, axis=-1)
        done = left < _CONVERGED_STEP
        steps[now] += 1
        theta[now[better]], cost[now[better]] = tried[better], then[better]
        mu[now] = np.where(better, mu[now] / 10, mu[now] * 10)
        converged[now] = done
        active[now] = ~done & (mu[now] < _MAX_DAMPING * s[:, 0] ** 2)
    return DampedSolution(
        AffineModel.of(theta.reshape(*lead, 12)),
        cost.reshape(lead),
        converged.reshape(lead),
        steps.reshape(lead),
    )


def tilted_rows(name: str, observations: Observations, sensor: Sensor, steps: Spins) -> list[int]:
    """Return the rows of the tilted states; raise NotObserved if there are too few."""
    refuse_temperature_terms(sensor, name, "joint")
    require_affine_triad(sensor)
    require_matching_rows(observations, sensor, steps)
    groups = [k for k, step in enumerate(steps) if is_tilted(step)]
    if len(groups) < MIN_TILTED_STATES:
        raise NotObserved(
            f"{len(groups)} tilted states give only {len(groups)} norms for "
            f"{MIN_TILTED_STATES} coefficients; add tilted states until there are "
            f"{MIN_TILTED_STATES} for estimator {name}, or use estimator joint",
            key="steps",
        )
    return groups


def norm_observations(
    observations: Observations, bench: RateTable, steps: Spins, groups: Sequence[int]
) -> tuple[Array, Array]:
    """Return the readings in the groups, (..., r, 3) g, and A² + 1, (r,) g²."""
    f = sensed_motion(bench, [steps[k] for k in groups], {}).f / G0
    return observations.mean[..., groups, :] / G0, (f**2).sum(-1)


def axis_columns(rows: Sequence[int]) -> Indices:
    """Return the indices of the columns for the three axes of each row."""
    return (3 * np.asarray(rows, dtype=np.intp)[:, None] + np.arange(3)).ravel()


class Generation(NamedTuple):
    """The best member of the population after a generation."""

    number: int
    cost: float  # Σρ², g⁴
    worst: float  # largest relative error of a norm


@dataclass(frozen=True)
class Bounds:
    """Half widths of the search about nominal: scale and cross terms relative, bias in g."""

    scale: float = 0.1
    cross: float = 0.1
    bias: float = 0.2

    @property
    def half_width(self) -> Array:
        """Half widths of θ, (12,)."""
        matrix = np.where(np.eye(3) > 0, self.scale, self.cross)
        return np.concatenate([matrix.ravel(), np.full(3, self.bias)])


@dataclass(frozen=True)
class SearchOptions:
    """Options for the global search.

    Parameters
    ----------
    bounds : Bounds
        Search bounds about nominal.
    seed : int
    seconds : float
        Time limit, s. The best member at that time is the result.
    goal : float
        The goal is met if the largest relative error of a norm is at most this.
    """

    bounds: Bounds = Bounds()
    seed: int = 0
    seconds: float = 20.0
    goal: float = GOAL


class SearchHistory(NamedTuple):
    """The goal of a search, and the best member after each generation, before polishing."""

    goal: float
    generations: tuple[Generation, ...]

    @property
    def goal_generation(self) -> int | None:
        """Index of the first generation that met the goal."""
        return next((g.number for g in self.generations if g.worst <= self.goal), None)


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The result of a search.

    Parameters
    ----------
    model : AffineModel
        The polished model.
    cost, worst : float
        Values for the model: Σρ² in g⁴, and the largest relative error of a norm.
    history : tuple of Generation
        The best member after each generation, before polishing.
    goal : int or None
        Index of the first generation that met the goal.
    seconds : float
        Duration of the search, s.
    completed : bool
        Whether the search finished before its time limit.
    """

    model: AffineModel
    cost: float
    worst: float
    history: tuple[Generation, ...]
    goal: int | None
    seconds: float
    completed: bool


def worst_relative_error(model: AffineModel, a: Array, square: Array) -> float:
    """Return the largest relative error of a norm."""
    return float(np.abs(np.linalg.norm(model.correct(a), axis=-1) / np.sqrt(square) - 1).max())


def search(
    a: Array,
    square: Array,
    options: SearchOptions = SearchOptions(),
    *,
    generations: int = 1000,
    progress: Callable[[Generation], None] | None = None,
) -> SearchResult:
    """Minimise the sum of squares within bounds; polishing may move the result beyond them.

    Parameters
    ----------
    a : (r, 3) array
        Readings in g.
    square : (r,) array
        A² + 1, g².
    options : SearchOptions
    generations : int
        Maximum number of generations.
    progress : callable, optional
        Called after each generation.
    """
    began = perf_counter()
    history: list[Generation] = []
    half, late = options.bounds.half_width, False

    def cost(thetas: Array) -> Array:
        # One column per member.
        return (norm_residuals(AffineModel.of(thetas.T), a, square) ** 2).sum(-1)

    def after(intermediate_result: Any) -> None:
        nonlocal late
        model = AffineModel.of(np.asarray(intermediate_result.x, dtype=float))
        worst = worst_relative_error(model, a, square)
        history.append(Generation(len(history) + 1, float(intermediate_result.fun), worst))
        if progress is not None:
            progress(history[-1])
        late = perf_counter() - began > options.seconds
        if late:
            raise StopIteration

    best = scipy.optimize.differential_evolution(
        cost,
        list(zip(IDENTITY_PARAMETERS - half, IDENTITY_PARAMETERS + half, strict=True)),
        maxiter=generations,
        popsize=_POPULATION_FACTOR,
        rng=np.random.default_rng(options.seed),
        callback=after,
        polish=False,
        updating="deferred",
        vectorized=True,
    )
    done = damped_solution(a, square, AffineModel.of(np.asarray(best.x, dtype=float)))
    return SearchResult(
        done.model,
        float(done.cost),
        worst_relative_error(done.model, a, square),
        tuple(history),
        SearchHistory(options.goal, tuple(history)).goal_generation,
        perf_counter() - began,
        not late,
    )
