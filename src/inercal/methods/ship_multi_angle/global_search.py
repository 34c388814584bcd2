"""The source's equations by a global search, in place of its commercial optimiser.

SciPy's differential evolution (Storn and Price 1997) minimises the sum of squares of the norms'
equations within bounds about nominal; the damped equations then polish the result. The source sets
its optimiser a goal of 5 % error; here the error is the largest over the groups of
| |M a + p| / √(A² + 1) − 1 |. Coefficients far from the truth meet this goal. Equal seeds give
equal results, unless the time limit ends the search.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.methods.ship_multi_angle.norm_equations import damped_solution, norm_residuals
from inercal.physics.sensors.affine import IDENTITY_PARAMETERS, AffineModel

GOAL = 0.05
_POPULATION_FACTOR = 15  # times twelve


class Generation(NamedTuple):
    """The best member after a generation."""

    number: int
    cost: float  # Σρ², g⁴
    worst: float  # largest relative error of a norm


@dataclass(frozen=True)
class Bounds:
    """Half widths of the search about nominal: scale and cross relative, bias in g."""

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
    """Options of a search.

    Parameters
    ----------
    bounds : Bounds
        About nominal.
    seed : int
    seconds : float
        Time limit, after which the best member is the result.
    goal : float
        Largest relative error of a norm at which the goal is met.
    """

    bounds: Bounds = Bounds()
    seed: int = 0
    seconds: float = 20.0
    goal: float = GOAL


class SearchHistory(NamedTuple):
    """Goal of a search, and the best member after each generation, before polishing."""

    goal: float
    generations: tuple[Generation, ...]

    @property
    def goal_generation(self) -> int | None:
        """The number of the generation that first met the goal."""
        return next((g.number for g in self.generations if g.worst <= self.goal), None)


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The result of a search.

    Parameters
    ----------
    model : AffineModel
        Polished.
    cost, worst : float
        Of the model: Σρ² in g⁴, and the largest relative error of a norm.
    history : tuple of Generation
        The best member after each generation, before polishing.
    goal : int or None
        The generation that first met the goal.
    seconds : float
        Duration of the search.
    completed : bool
        Whether the search ended before its time limit.
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
    """Return the least sum of squares within bounds; polishing may leave them.

    Parameters
    ----------
    a : (r, 3) array
        Readings in g.
    square : (r,) array
        A² + 1, g².
    options : SearchOptions
    generations : int
        At most.
    progress : callable, optional
        Called after each generation.
    """
    began = perf_counter()
    history: list[Generation] = []
    half, late = options.bounds.half_width, False

    def cost(thetas: Array) -> Array:
        # One column a member.
        return (norm_residuals(AffineModel.of(thetas.T), a, square) ** 2).sum(-1)

    def after(intermediate_result: Any) -> None:
        nonlocal late
        model = AffineModel.of(np.asarray(intermediate_result.x, dtype=float))
        history.append(
            Generation(
                len(history) + 1,
                float(intermediate_result.fun),
                worst_relative_error(model, a, square),
            )
        )
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
