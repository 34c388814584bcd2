"""Check whether rows on a rate table are consistent with one affine triad, for any estimator.

Untilted rows are compared as vectors, tilted rows as norms, in g::

    f − (M a + p)          |f| − |M a + p|

All rows share the bench's errors. The covariance S of the rows contains the noise of the readings
and the bench's deviations, mapped to M a + p and then to the compared rows. The rows are fitted by
generalised least squares with S, starting from the estimator's solution. The residuals have

    χ² = min r(θ)ᵀ S⁻¹ r(θ),   degrees of freedom = rows − directions of θ that the rows determine

The residuals r = (I − A G) ε of a linear estimator with gain G have the singular covariance
(I − A G) S (I − A G)ᵀ. Its pseudo-inverse gives the same χ², because both exclude the columns of A.

Norms do not change with a rotation of the triad. The solution is therefore first rotated so that
its vectors are closest to the bench's. Directions with a standard deviation above a tenth of their
natural size count as not observed and keep the estimator's value.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.rate_table.bench import RateTable, force_sensitivities, sensed_motion
from inercal.estimation import Candidate, Problem, ScoreTestSet, score_tests
from inercal.estimation.lazy_value import LazyValue
from inercal.estimation.scores import NO_SCORE_TESTS
from inercal.methods import Priors, mean_problem
from inercal.methods.observability import OBSERVABILITY_LIMIT
from inercal.physics.plan import Spins
from inercal.physics.sensors import G0, Sensor
from inercal.physics.sensors.affine import AffineModel, to_coefficients
from inercal.recordings import Observations

_ITERATIONS = 3  # of the Gauss-Newton method, because norms are nearly linear in θ
_VARIANCE_FLOOR = 1e-14  # relative to the largest variance; smaller variances are rounding


class Consistency(NamedTuple):
    """χ² for (...) trials, its degrees of freedom, score tests of a single trial, sensitivities."""

    chi2: Array
    dof: int
    scoring: LazyValue[ScoreTestSet]
    sensitivities: Mapping[str, Array]  # of θ to bench errors, (..., 12)


def joint_problem(
    observations: Observations, sensor: Sensor, bench: RateTable, steps: Spins, priors: Priors = ()
) -> Problem:
    """Return the problem with all readings and with the bench's errors as nuisances."""
    # The rows of a table without times are in the order of measurement.
    return mean_problem.problem_of_readings(
        observations,
        sensor,
        bench.acting_parameters(steps),
        lambda q: bench.mean_motion(steps, q),
        priors,
        with_drift_candidate=True,
        common_errors=("lean",),
    )


def row_covariance(
    observations: Observations, bench: RateTable, steps: Spins, matrix: Array
) -> Array:
    """Return the covariance of M a + p − f over all rows, (..., 3 r, 3 r) g².

    The covariance includes noise and bench errors.

    Parameters
    ----------
    observations, bench, steps
        The same as for the estimator, with r rows.
    matrix : (..., 3, 3) array
        The matrix M.
    """
    r, size = len(steps), 3 * len(steps)
    noise = observations.full_covariance
    noise = noise.reshape(*noise.shape[:-2], r, 3, r, 3)
    turned = np.einsum("...ij,...ajbk,...lk->...aibl", matrix, noise, matrix, optimize=True)
    result = force_sensitivities(bench, steps).reshape(-1, size)
    return (turned.reshape(*turned.shape[:-4], size, size) + result.T @ result) / G0**2


def _bench_sensitivities(bench: RateTable, steps: Spins, gain: Array) -> dict[str, Array]:
    """Return the sensitivity of θ to bench errors that are stated for the whole run, (..., 12).

    Parameters
    ----------
    bench, steps
        The same as for the estimator, with r rows.
    gain : (..., 12, 3 r) array
        The same as for `consistency`. A stated error adds to f, so it subtracts from M a + p − f.
    """
    result = sensed_motion(bench, steps, {}).df
    return {
        name: -gain @ result[name].ravel() / G0
        for name, q in bench.acting_parameters(steps).items()
        if q.scope == "run" and q.sd > 0
    }


def linearised_rows(
    model: AffineModel, level: Array, f: Array, groups: Array, square: Array
) -> tuple[Array, Array]:
    """Return the residuals, (..., 3 r + s) g, and the Jacobian of the model's values.

    Parameters
    ----------
    model : AffineModel
    level, f : (..., r, 3) and (r, 3) arrays
        Readings in untilted states, and the bench's specific force, g.
    groups, square : (..., s, 3) and (s,) arrays
        Readings in tilted states, g, and A² + 1, g².
    """
    away = f - model.correct(level)
    v = model.correct(groups)
    length = np.linalg.norm(v, axis=-1)
    by_vector = np.zeros((*away.shape, 12))
    for axis in range(3):
        by_vector[..., axis, 3 * axis : 3 * axis + 3] = level
        by_vector[..., axis, 9 + axis] = 1.0
    along = v / length[..., None]
    by_matrix = along[..., :, None] * groups[..., None, :]
    by_norm = np.concatenate([by_matrix.reshape(*along.shape[:-1], 9), along], axis=-1)
    lead = away.shape[:-2]
    return (
        np.concatenate([away.reshape(*lead, -1), np.sqrt(square) - length], axis=-1),
        np.concatenate([by_vector.reshape(*lead, -1, 12), by_norm], axis=-2),
    )


def consistency(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Spins,
    model: AffineModel,
    gain: Array,
    level: Sequence[int],
    groups: Sequence[int] = (),
) -> Consistency:
    """Return the tests for the rows that an estimator used.

    Parameters
    ----------
    observations, sensor, bench, steps
        The same as for the estimator, with r rows.
    model : AffineModel
        The estimator's solution, for (...) trials.
    gain : (..., 12, 3 r) array
        Sensitivity of θ to errors of M a + p − f in all rows; the axis index varies fastest.
    level, groups : sequence of int
        Rows that are compared as vectors, and as norms.
    """
    used = sorted((*level, *groups))
    here = [steps[k] for k in used]
    some = observations.rows(used)
    at_level, at_groups = ([used.index(k) for k in rows] for rows in (level, groups))
    f = sensed_motion(bench, here, {}).f / G0
    a, square = some.mean / G0, (f[at_groups] ** 2).sum(-1)
    nearest = model if level else _rotated_to_nearest(model, a, f)

    def residuals(model: AffineModel, readings: Array) -> tuple[Array, Array]:
        of_level, of_groups = readings[..., at_level, :], readings[..., at_groups, :]
        return linearised_rows(model, of_level, f[at_level], of_groups, square)

    def at(theta: Array) -> tuple[Array, Array]:
        # Derivatives at the noisy readings would depend on the noise, and therefore on the
        # residuals.
        here = AffineModel.of(theta)
        return residuals(here, a)[0], residuals(here, here.inverse.correct(f))[1]

    map_to = comparison_map(nearest, a, at_level, at_groups)
    spread = map_to @ row_covariance(some, bench, here, nearest.matrix) @ map_to.mT
    whitener = _whitener(spread)
    theta = np.array(nearest.theta)
    theta, u, residual = _generalised_least_squares(theta, at, whitener)
    chi2 = np.asarray((residual**2).sum(-1))
    dof = residual.shape[-1] - u.shape[-1]
    by_bench = _bench_sensitivities(bench, steps, gain)
    if observations.mean.ndim > 2:
        return Consistency(chi2, dof, NO_SCORE_TESTS, by_bench)

    def work() -> ScoreTestSet:
        fitted = AffineModel.of(theta)
        value, _ = to_coefficients(sensor, fitted)
        _, slope = to_coefficients(sensor, model)
        requested = joint_problem(some, sensor, bench, here)
        start = np.concatenate([value, requested.start[len(value) :]])
        assert requested.candidates is not None
        # Computed at the fitted rows without noise, like the derivatives.
        expected = fitted.inverse.correct(f)
        from_readings = whitener @ comparison_map(fitted, expected, at_level, at_groups)
        own = [3 * k + axis for k in used for axis in range(3)]
        whitened: list[Candidate] = []
        for one in requested.candidates(start):
            columns = one.rows.reshape(len(used), 3, -1)
            # The estimator weights the rows differently from this fit, so its gain gives its shift.
            shift = slope @ gain[:, own] @ _added_rows(model.matrix, columns)
            rows = -from_readings @ _added_rows(fitted.matrix, columns)
            whitened.append(replace(one, rows=rows, moved=shift))
        # `moved` contains the full shift, from the estimator's gain; coordinates along U have no
        # shift.
        none = np.zeros((len(value), u.shape[1]))
        return score_tests(residual, u, whitened, none)

    return Consistency(chi2, dof, LazyValue(work), by_bench)


def _added_rows(matrix: Array, rows: Array) -> Array:
    """Return the effect of readings (r, 3, k) m/s² on M a + p, (3 r, k) g."""
    return np.einsum("ij,rjk->rik", matrix, rows).reshape(-1, rows.shape[-1]) / G0


def _generalised_least_squares(
    theta: Array, at: Callable[[Array], tuple[Array, Array]], whitener: Array
) -> tuple[Array, Array, Array]:
    """Return θ by generalised least squares, the basis U of its columns, and whitened residuals."""
    residual, slope = at(theta)
    s = np.linalg.svd(whitener @ slope, compute_uv=False)
    count = int((s.reshape(-1, s.shape[-1])[0] > 1 / OBSERVABILITY_LIMIT).sum())
    for _ in range(_ITERATIONS):
        u, s, vt = _largest_singular_vectors(whitener @ slope, count)
        pull = u.mT @ (whitener @ residual[..., None])
        theta = theta + (vt.mT @ (pull / s[..., None]))[..., 0]
        residual, slope = at(theta)
    u, _, _ = _largest_singular_vectors(whitener @ slope, count)
    left = whitener @ residual[..., None]
    left = left - u @ (u.mT @ left)
    return theta, u, left[..., 0]


def _largest_singular_vectors(slope: Array, count: int) -> tuple[Array, Array, Array]:
    """Return the largest singular values and their vectors."""
    u, s, vt = np.linalg.svd(slope, full_matrices=False)
    return u[..., :count], s[..., :count], vt[..., :count, :]


def comparison_map(
    model: AffineModel, a: Array, level: Sequence[int], groups: Sequence[int]
) -> Array:
    """Return the map from M a + p in all rows to the compared rows; axis index varies fastest."""
    size = 3 * len(level)
    columns = (3 * np.asarray(level, dtype=np.intp)[:, None] + np.arange(3)).ravel()
    result = np.zeros((*a.shape[:-2], size + len(groups), 3 * a.shape[-2]))
    result[..., np.arange(size), columns] = 1.0
    v = model.correct(a)
    along = v / np.linalg.norm(v, axis=-1, keepdims=True)
    for k, group in enumerate(groups):
        result[..., size + k, 3 * group : 3 * group + 3] = along[..., group, :]
    return result


def _whitener(spread: Array) -> Array:
    """Return the symmetric W that mixes the rows least, with W S W = I, (..., m, m)."""
    variance, directions = np.linalg.eigh(spread)
    variance = np.maximum(variance, _VARIANCE_FLOOR * variance[..., -1:])
    return (directions / np.sqrt(variance)[..., None, :]) @ directions.mT


def _rotated_to_nearest(model: AffineModel, a: Array, f: Array) -> AffineModel:
    """Rotate the model so that its vectors are closest to f; the norms do not change."""
    u, _, vt = np.linalg.svd(f.T @ model.correct(a))
    turn = np.asarray(u @ vt)
    return AffineModel(turn @ model.matrix, (turn @ model.offset[..., None])[..., 0])
