"""Fit a magnetometer to the earth's field, with known accelerometers and gyros.

The unknowns are the coefficients, the dip, the corrections of the known coefficients and
the attitude of each node (`rows`). The data determine D B, but not the strength B: a stated B gives
D, and its uncertainty is added. Otherwise the mean of the scale coefficients is set to zero, so
that D is relative to the local field.

If χ² exceeds its 95 % bound, the field differs from node to node. A variance τ² B² of each
component is then added to the field, with τ chosen so that χ² equals its degrees of freedom
(Paule and Mandel 1982, see `inercal.estimation.residual_scatter`). The interval of τ contains all
values for which χ² is between its 2.5 % and 97.5 % bounds (Q profile; Viechtbauer 2007, Statistics
in Medicine 26, 37–52).
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false

from dataclasses import dataclass, replace

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.units import format_count
from inercal.estimation.nullspace import first_combinations, named_direction, row_echelon_form
from inercal.methods.magnetic_field import records, rows
from inercal.methods.magnetic_field.starts import oriented, starts

_LEAST_NODES = 7
_LEAST_DOF = 5  # with fewer, a second set of coefficients fits as well in 1 % of cases
_UNDETERMINED = 0.1  # standard deviation in typical sizes, above which a direction is refused
_LOUD = 0.1  # noise of a reading over the change of the readings
_NEGLIGIBLE = 0.1  # smallest weight that the name of a direction lists
_LEVEL = 0.95
_LARGEST_INHOMOGENEITY = 0.05
_NO_FIELD = 0.15  # inhomogeneity above which the readings look random
_LEAST, _MOST = float(np.log(1e-5)), 0.0  # of ln τ
_UNIT_ERROR = 9.0  # factor between the stated and the fitted field that shows a wrong unit


@dataclass(frozen=True, eq=False)
class FieldFit:
    """The estimated magnetometer and field.

    Parameters
    ----------
    names : tuple of str
        The coefficients, "dip" (if a node has an upward direction) and "strength".
    value, covariance : (t,) and (t, t) arrays
        The dip is in rad. The covariance includes the inhomogeneity of the field.
    cross : (t, q) array
        Covariance of the errors of these values with those of the known coefficients.
    correction : (q,) array
        Correction of the known coefficients, true minus used.
    known_covariance : (q, q) array
        Its covariance.
    chi2, dof : float and int
        χ² for the stated noise, and its degrees of freedom.
    inhomogeneity : float
        τ, the standard deviation of each component of the field between nodes, relative to the
        strength; 0 if χ² is within its 95 % bound.
    per_field : bool
        Whether the mean of the scale coefficients was set to zero, because the strength is not
        stated.
    attitude : (n, 3, 3) array
        Matrix from each body frame to magnetic north, west and up.
    singular_values : (k,) array
        Of the coefficients and the dip, in standard deviations per typical size, descending.
    notes : tuple of str
    converged : bool
    iterations : int
    plain : Solution
        The solution for the stated noise, on which tests are based; `plain.rows` contains the
        whitened residuals.
    """

    names: tuple[str, ...]
    value: Array
    covariance: Array
    cross: Array
    correction: Array
    known_covariance: Array
    chi2: float
    dof: int
    inhomogeneity: float
    per_field: bool
    attitude: Array
    singular_values: Array
    notes: tuple[str, ...]
    converged: bool
    iterations: int
    plain: rows.Solution


def fit_field(
    nodes: records.FieldNodes,
    model: records.LinearModel,
    directions: records.Directions,
    links: records.Links | None = None,
    conditions: records.FieldConditions | None = None,
    known: Array | None = None,
) -> FieldFit:
    """Estimate the coefficients of a magnetometer and the field.

    Parameters
    ----------
    nodes, model, directions, links, conditions
    known : (q, q) array, optional
        Covariance of the known coefficients to which the derivatives refer; none by default.

    Raises
    ------
    InputError
        The arrays do not fit together, the axes are not the stated ones, or the field differs too
        much between the nodes.
    NotObserved
        There are too few nodes, or they do not determine all coefficients.
    """
    known = np.zeros((0, 0)) if known is None else known
    links = records.Links.none(len(known)) if links is None else links
    conditions = records.FieldConditions() if conditions is None else conditions
    records.check_records(nodes, directions, links, known)
    strength = None if conditions.strength is None else conditions.strength.value
    free_dip = rows.FieldProblem(nodes, model, directions, links, known, None, strength)
    problem = replace(free_dip, dip=conditions.dip if len(directions.node) else None)
    if len(nodes.labels) < _LEAST_NODES or problem.dof < _LEAST_DOF:
        raise NotObserved(
            f"{len(nodes.labels)} attitudes do not determine the magnetometer; at least"
            f" {_LEAST_NODES} different ones are needed if gyros link them, 9 otherwise, and 16"
            " are recommended"
        )
    _require_change(nodes, model.axes)
    found = starts(free_dip)
    _require_unit(free_dip, found[0])
    first = rows.best_solution(free_dip, found)
    dip_sd = _require_determined(first, problem)
    try:
        state, notes = oriented(model, first.state, conditions, dip_sd)
    except InputError:  # name other axes only if the readings agree with some axes
        _require_homogeneous(_inhomogeneity(first, float(problem.dof))[0])
        raise
    plain = rows.solve(problem, state)
    singular = _singular_values(plain)
    tau, last = 0.0, plain
    if plain.chi2 > scipy.special.chdtri(problem.dof, 1 - _LEVEL):
        tau, last = _inhomogeneity(plain, float(problem.dof))
    _require_homogeneous(tau)
    value, covariance, cross, of_known = _reported(last, conditions)
    names = (*model.names, "dip", "strength")
    kept = [k for k in range(len(names)) if names[k] != "dip" or len(directions.node)]
    if strength is None:
        notes += (
            "The strength of the field is not stated, so all scale coefficients are relative to"
            " the local field and their mean is zero.",
        )
    return FieldFit(
        tuple(names[k] for k in kept),
        value[kept],
        covariance[np.ix_(kept, kept)],
        cross[kept],
        last.problem.root @ last.state.known,
        of_known,
        plain.chi2,
        problem.dof,
        tau,
        strength is None,
        last.state.attitude,
        singular,
        notes,
        first.converged and plain.converged and last.converged,
        first.iterations + plain.iterations,
        plain,
    )


def inhomogeneity_interval(fit: FieldFit) -> tuple[float, float]:
    """Return the 95 % interval of τ, the relative inhomogeneity of the field."""
    if not fit.dof:
        return 0.0, np.inf
    tail = (1 - _LEVEL) / 2
    low, high = (float(scipy.special.chdtri(fit.dof, p)) for p in (tail, 1 - tail))
    return _inhomogeneity(fit.plain, low)[0], _inhomogeneity(fit.plain, high)[0]


def _inhomogeneity(plain: rows.Solution, target: float) -> tuple[float, rows.Solution]:
    """Return the τ for which χ² equals a target, at least 0, and the solution for this τ."""
    if plain.chi2 <= target:
        return 0.0, plain
    p = plain.problem
    axes = p.model.matrices(plain.state.coefficients, np.zeros(1))[0, :, :3]
    unit = plain.state.strength**2 * axes @ axes.T

    def solution(log: float) -> rows.Solution:
        return rows.solve(replace(p, disturbance=float(np.exp(2 * log)) * unit), plain.state)

    def excess(log: float) -> float:
        return solution(log).chi2 - target

    if excess(_MOST) > 0:
        return np.inf, plain
    if excess(_LEAST) <= 0:
        return float(np.exp(_LEAST)), plain
    log = float(scipy.optimize.brentq(excess, _LEAST, _MOST, xtol=1e-3))
    return float(np.exp(log)), solution(log)


def _singular_values(solution: rows.Solution) -> Array:
    information = _information(solution)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(information)[::-1], 0.0))


def _information(solution: rows.Solution) -> Array:
    """Return the information on all free unknowns but the known ones, in typical sizes."""
    size = rows.typical_sizes(solution.problem, solution.state.strength)
    whole = solution.elimination.information * np.outer(size, size)
    k = len(whole) - solution.problem.root.shape[1]
    others = whole[k:, k:]
    return whole[:k, :k] - whole[:k, k:] @ np.linalg.solve(others, whole[k:, :k])


def _require_determined(solution: rows.Solution, problem: rows.FieldProblem) -> float:
    """Return the standard deviation of the dip; raise if a direction is not determined."""
    p = len(problem.model.names)
    chosen = [*problem.model.names, *(["dip"] if p in problem.free else [])]
    information = _information(solution)
    if problem.dip is not None:
        at = chosen.index("dip")
        information[at, at] += 1 / problem.dip.sd**2
    null = _null_directions(information)
    if len(null):
        # A solution with undetermined directions is anywhere along them; the stated axes show them
        # more clearly.
        stated = solution.state._replace(coefficients=np.zeros(p))
        at_stated = rows.solve(solution.problem, stated, most=0)
        clear = _null_directions(_information(at_stated))
        nodes, moving = problem.nodes, not len(problem.directions.node)
        noise = np.sqrt(np.median(np.diagonal(nodes.covariance, axis1=1, axis2=2)))
        if noise > _LOUD * np.linalg.norm(nodes.reading.std(axis=0)):
            raise InputError(
                "the stated noise of the magnetometer hides the field: the noise of a reading is "
                f"{noise / np.linalg.norm(nodes.reading.std(axis=0)):.2g} times the change of the "
                "readings between attitudes; check white and unit in [sensor.magnetometer]",
                key="[sensor.magnetometer] white",
            )
        raise _not_observed(chosen, clear if len(clear) else null, moving=moving)
    if "dip" not in chosen:
        return np.inf
    return float(np.sqrt(np.linalg.inv(information)[chosen.index("dip"), chosen.index("dip")]))


def _null_directions(information: Array) -> Array:
    values, vectors = np.linalg.eigh(information)
    return row_echelon_form(vectors[:, values < 1 / _UNDETERMINED**2].T)


def _not_observed(names: list[str], null: Array, *, moving: bool) -> NotObserved:
    """Return the error that names the directions `null` (k, f), in typical sizes."""
    null = np.where(np.abs(null) > _NEGLIGIBLE, null, 0.0)
    directions = [named_direction(names, row) for row in null]
    words = tuple(direction.words for direction in directions)
    cause = "the attitudes do not"
    remedy = "add rests at other attitudes, also upside down, and two azimuths or more of each face"
    if moving:
        cause, remedy = "the motion does not", "turn the sensor about all of its axes"
    return NotObserved(
        f"{cause} determine {format_count(len(words), 'combination')} of the magnetometer's"
        f" coefficients: {first_combinations(words)}; {remedy}",
        words,
        names=tuple(name for name in names if any(name in one.weights for one in directions)),
    )


def _require_homogeneous(tau: float) -> None:
    if tau > _NO_FIELD:
        raise InputError(
            "the magnetometer's readings agree with the attitudes for no order and signs of its "
            "axes: they may belong to another recording; check the file, columns and times"
        )
    if tau > _LARGEST_INHOMOGENEITY:
        raise InputError(
            f"the field differs within the recording by {100 * tau:.3g} % (1 σ per component), more"
            f" than {100 * _LARGEST_INHOMOGENEITY:.0f} %; repeat the recording away from iron,"
            " magnets and currents, and check the axes and times of the columns"
        )


def _require_change(nodes: records.FieldNodes, names: tuple[str, ...]) -> None:
    constant = np.flatnonzero(np.ptp(nodes.reading, axis=0) == 0)
    if constant.size:
        axes = ", ".join(names[k] for k in constant)
        raise InputError(
            f"the magnetometer's reading is the same at all attitudes (axis {axes}); check its"
            " columns and its range"
        )


def _require_unit(problem: rows.FieldProblem, start: rows.FieldState) -> None:
    if problem.strength is None:
        return
    model = problem.model
    both = model.matrices(start.coefficients, np.zeros(1))[0, :, :3], model.nominal[:, :3]
    # The middle one, because turns about one axis only leave the gain along that axis open.
    gain = float(np.divide(*np.linalg.svd(both, compute_uv=False)[:, 1]))
    if not 1 / _UNIT_ERROR < gain < _UNIT_ERROR:
        raise InputError(
            f"the readings are about {gain:.2g} times as large as the stated field; check the unit"
            " and the scale of the magnetometer, and the unit of the field",
            key="unit",
        )


def _reported(
    solution: rows.Solution, conditions: records.FieldConditions
) -> tuple[Array, Array, Array, Array]:
    """Return (c, δ, B), its covariance, that with the known coefficients, and that of these."""
    problem, state = solution.problem, solution.state
    model, p, free = problem.model, len(problem.model.names), problem.free
    whole = np.zeros((problem.count, problem.count))
    size = rows.typical_sizes(problem, state.strength)
    scaled = np.linalg.inv(solution.elimination.information * np.outer(size, size))
    whole[np.ix_(free, free)] = scaled * np.outer(size, size)
    whole = np.insert(np.insert(whole, p + 1, 0.0, axis=0), p + 1, 0.0, axis=1)
    value = np.concatenate([state.coefficients, [state.dip, state.strength]])
    own, cross = whole[: p + 2, : p + 2], whole[: p + 2, p + 2 :] @ problem.root.T
    of_known = problem.root @ whole[p + 2 :, p + 2 :] @ problem.root.T
    # D (1 + ε) and B / (1 + ε) fit equally well.
    e = model.scale_direction
    gains = np.where(model.acts_on_field, state.coefficients + e, 0.0)
    if conditions.strength is not None:
        by_strength = np.concatenate([-gains / state.strength, [0.0, 1.0]])
        own = own + conditions.strength.sd**2 * np.outer(by_strength, by_strength)
        return value, own, cross, of_known
    mean = float(e @ gains / (e @ e))
    move = np.eye(p + 2)
    move[:p, :p] = np.diag(np.where(model.acts_on_field, 1 / mean, 1.0))
    move[:p, :p] -= np.outer(gains, e) / (e @ e) / mean**2
    move[p + 1, :p] = state.strength * e / (e @ e)
    value[:p] = np.where(model.acts_on_field, gains / mean - e, state.coefficients)
    value[p + 1] *= mean
    return value, move @ own @ move.T, move @ cross, of_known
