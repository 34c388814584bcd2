"""Whiten the rows of rests and transitions, whose covariance is a band matrix in time order.

The reading errors of rest i enter eight rows: two for the rotation before the rest, one for its
norm, three for its rates, and two for the rotation after it. Each such block is added to a band of
eight diagonals, starting at 6 i. The rotations' own noise is added to their diagonals. Rows that do
not exist (a transition across a gap) have a variance of one and no effect. Work and memory grow
with the number of rests.

**χ² of each kind of rows, and the share or excess of the noise that explains it.**

Norms come first, then rates, then rotations. Each kind is judged with the noise of the kinds before
it, because the readings of a rest enter all three kinds.
"""

# SciPy has no type stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy

from inercal.basics.arrays import Array, Indices
from inercal.estimation.residual_scatter import ScatterModel, chi_squared, fit_scatter
from inercal.methods.multi_position.rest_observations import ResidualRows, Rests, Scatter
from inercal.methods.multi_position.rotations import RotationResiduals

Whiten = Callable[[Array], Array]
_ROWS_PER_REST = 6  # rows from one rest to the next
_BLOCK_ROWS = 8  # rows that the readings of one rest affect
NORM_ROW, RATE_ROWS = 2, slice(3, 6)


class RowCovariance(NamedTuple):
    """The covariance of all rows, in independent parts."""

    rests: Array  # (r, 8, 8), due to each rest's readings, for the rows that they enter
    rotations: Array  # (k, 2, 2), additional covariance of the rotations


def row_covariance(rests: Rests, rows: ResidualRows, scatter: Scatter) -> RowCovariance:
    """Return the covariance of the rows, from the readings' noise propagated at `rows`."""
    readings = rests.reading_covariance(scatter)
    enter, own = reading_sensitivities(rests, rows), np.zeros((0, 2, 2))
    turns = rows.rotations
    if turns is not None:
        own = turns.to_end_turn @ turns.way.noise @ turns.to_end_turn.mT
        on_the_way = _transition_offset_sensitivities(rests, turns)
        wander = scatter.rate.excess**2 * 2 * on_the_way @ on_the_way.mT
        own = scatter.turn.of(own) + wander
    return RowCovariance(enter @ readings @ enter.mT, own)


def reading_sensitivities(rests: Rests, rows: ResidualRows) -> Array:
    """Return the sensitivity of each rest's rows to its readings, (r, 8, m + 12) or (r, 8, m).

    The readings are in the order of `Rests.readings`.
    """
    r, m, turns = len(rows.norm.residual), rests.m, rows.rotations
    enter = np.zeros((r, _BLOCK_ROWS, m if rests.transitions is None else m + 12))
    back = np.broadcast_to(rows.norm.by_reading, (r, 3, m))
    enter[:, NORM_ROW, :m] = -(rows.norm.up[:, None, :] @ back)[:, 0]
    if turns is not None:
        before, after = turns.rest, turns.rest + 1
        arriving, leaving = rests.ramp_sensitivities(turns)
        on_the_way = _transition_offset_sensitivities(rests, turns)
        enter[:, RATE_ROWS, m : m + 3] = enter[:, RATE_ROWS, m + 9 :] = np.eye(3)
        enter[after, :2, :m] = turns.to_after @ back[after]
        enter[after, :2, m + 3 : m + 6] = -turns.to_end_turn
        enter[after, :2, m + 9 :] = arriving + on_the_way
        enter[before, 6:, :m] = turns.to_before @ back[before]
        enter[before, 6:, m + 6 : m + 9] = -turns.to_end_turn @ turns.way.rotation
        enter[before, 6:, m + 9 :] = leaving + on_the_way
    return enter


def _transition_offset_sensitivities(rests: Rests, turns: RotationResiduals) -> Array:
    """Return the sensitivity of the rotations to half a gyro offset between the ramps, (k, 2, 3).

    An offset is constant during a rest. In a transition it is the mean of the offsets at both ends
    plus an independent part with the same variance.
    """
    arriving, leaving = rests.ramp_sensitivities(turns)
    return np.asarray(0.5 * (-turns.to_end_turn @ turns.way.to_bias - arriving - leaving))


def sum_over_rests(rests: Rests, of_rests: Array) -> Array:
    """Return the summed effect of all rests on the rows, ordered as in `ResidualRows`.

    Parameters
    ----------
    rests : Rests
    of_rests : (r, 8, k) array
    """
    r, _, k = of_rests.shape
    line = np.zeros((_ROWS_PER_REST * r + _BLOCK_ROWS - _ROWS_PER_REST, k))
    for row in range(_BLOCK_ROWS):
        line[row : row + _ROWS_PER_REST * r : _ROWS_PER_REST] += of_rests[:, row]
    return line[row_positions(rests)]


def row_positions(rests: Rests, *, norms: bool = True) -> Indices:
    """Return the position of each row of `ResidualRows` in the band matrix."""
    r = len(rests.observations.labels)
    start = _ROWS_PER_REST * np.arange(r)
    place = (start + NORM_ROW)[: r if norms else 0]
    if rests.transitions is not None:
        at = _ROWS_PER_REST * (rests.transitions.rest + 1)
        of_rates = (start[:, None] + np.arange(_ROWS_PER_REST)[RATE_ROWS]).ravel()
        place = np.concatenate([place, np.stack([at, at + 1], axis=-1).ravel(), of_rates])
    return place


def whitener_with_drift(rests: Rests, rows: ResidualRows, whiten: Whiten) -> Whiten:
    """Return `whiten` for noise that also includes a possible drift of the accelerometers.

    If D contains the whitened columns of k drifts with unit variance, the covariance becomes 1 + D
    Dᵀ. With D = U s Vᵀ, its symmetric inverse root is 1 − U (1 − 1/√(1 + s²)) Uᵀ.
    """
    drift = rests.accelerometer_drift
    if not drift.size:
        return whiten
    enter = reading_sensitivities(rests, rows)[..., : rests.m]
    columns = [
        sum_over_rests(rests, enter[..., [axis]] * course[:, None, None])
        for axis in range(rests.m)
        for course in drift[..., axis]
    ]
    shapes, sizes, _ = np.linalg.svd(whiten(np.concatenate(columns, axis=1)), full_matrices=False)
    taken = shapes * (1 - 1 / np.sqrt(1 + sizes**2))

    def whiten_all(a: Array) -> Array:
        white = whiten(a)
        flat = white.reshape(len(white), -1)
        return (flat - taken @ (shapes.T @ flat)).reshape(white.shape)

    return whiten_all


def whitener(rests: Rests, rows: ResidualRows, scatter: Scatter, *, norms: bool = True) -> Whiten:
    """Return a function that whitens columns over all rows with the noise at `rows`.

    Parameters
    ----------
    rests : Rests
    rows : ResidualRows
        The rows at which the noise is propagated.
    scatter : Scatter
    norms : bool
        If False, the rows of norms are removed and the others are whitened without them.
    """
    r = len(rows.norm.residual)
    # Two extra rows before and after the chain, because no rotations exist at its ends.
    band = np.zeros((_BLOCK_ROWS, _ROWS_PER_REST * r + _BLOCK_ROWS - _ROWS_PER_REST))
    of_rests, of_turns = row_covariance(rests, rows, scatter)
    for column in range(_BLOCK_ROWS):
        for row in range(column, _BLOCK_ROWS):
            stop = column + _ROWS_PER_REST * r
            band[row - column, column:stop:_ROWS_PER_REST] += of_rests[:, row, column]
    place = row_positions(rests, norms=norms)
    if rests.transitions is not None:
        at = _ROWS_PER_REST * (rests.transitions.rest + 1)
        band[0, at] += of_turns[:, 0, 0]
        band[0, at + 1] += of_turns[:, 1, 1]
        band[1, at] += of_turns[:, 1, 0]
    absent = np.ones(band.shape[1], dtype=np.bool_)
    absent[place] = False
    band[0, absent] = 1.0
    for below in range(1, _BLOCK_ROWS):
        band[below, absent] = 0.0
        band[below, :-below][absent[below:]] = 0.0
    factor: Any = scipy.linalg.cholesky_banded(band, lower=True)

    def whiten(columns: Array) -> Array:
        flat = columns.reshape(len(columns), -1)
        line = np.zeros((band.shape[1], flat.shape[1]))
        line[place] = flat[0 if norms else r :]
        # `solve_banded` would factorise the triangular matrix again in each call.
        white: Array = scipy.linalg.lapack.dtbtrs(factor, line, uplo="L", overwrite_b=True)[0]
        return white[place].reshape(-1, *columns.shape[1:])

    return whiten


class ScatterStatistics(NamedTuple):
    """χ² of one kind of rows, its degrees of freedom, and the noise that explains it."""

    chi2: float
    dof: int
    spread: ScatterModel


def norm_scatter(rests: Rests, rows: ResidualRows) -> ScatterStatistics:
    """Return the statistics of the norms; `rests` have only accelerometers."""
    jacobian = rows.jacobian[:, : len(rests.sensor.coefficients)]
    dof = len(rows.residual) - int(np.linalg.matrix_rank(jacobian * rests.sensor.unit_scale))

    def whiten(force: ScatterModel, columns: Array) -> Array:
        return whitener(rests, rows, Scatter(force))(columns)

    return _statistics(rests, rows.residual, jacobian, whiten, dof, rests.rounding_share[0])


def rate_scatter(rests: Rests, rows: ResidualRows, shown: Indices) -> ScatterStatistics:
    """Return the statistics of the rates at rest, which determine the elements `shown` of x."""
    residual, jacobian = _rate_rows(rests, rows, shown)
    dof = max(len(residual) - shown.size, 0)
    whiten = _rate_whitener(rests)
    return _statistics(rests, residual, jacobian, whiten, dof, rests.rounding_share[1])


def _statistics(
    rests: Rests,
    residual: Array,
    jacobian: Array,
    whiten: Callable[[ScatterModel, Array], Array],
    dof: int,
    least: float,
) -> ScatterStatistics:
    chi2 = chi_squared(residual, jacobian, lambda a: whiten(ScatterModel(), a))
    found = fit_scatter(residual, jacobian, whiten, dof, least=least, stated=rests.noise_is_stated)
    return ScatterStatistics(chi2, dof, found)


def rotation_scatter(
    rests: Rests, rows: ResidualRows, shown: Indices, fitted: Indices, scatter: Scatter
) -> ScatterStatistics:
    """Return the statistics of the rotations: how much they add to the χ² of norms and rates.

    Parameters
    ----------
    rests : Rests
    rows : ResidualRows
        The rows at a solution.
    shown, fitted : arrays of int
        Indices of the elements of x that rates determine without rotations, and that rates and
        rotations determine together. The accelerometers' indices are added to both.
    scatter : Scatter
        The scatter of the kinds of rows that were judged before.
    """
    assert rows.rotations is not None
    norms = np.arange(len(rests.force.coefficients))
    columns = rows.jacobian[:, np.concatenate([norms, fitted])]
    dof = max(rows.rotations.residual.size - (fitted.size - shown.size), 0)

    def others(known: Scatter) -> float:
        variance = row_covariance(rests, rows, known).rests[:, NORM_ROW, NORM_ROW]
        own, white = np.sqrt(variance), _rate_whitener(rests)
        return chi_squared(
            rows.norm.residual, rows.norm.jacobian[:, :-1], lambda a: a / own[:, None]
        ) + chi_squared(*_rate_rows(rests, rows, shown), lambda a: white(known.rate, a))

    def beside(known: Scatter) -> ScatterModel:
        return fit_scatter(
            rows.residual,
            columns,
            lambda turn, a: whitener(rests, rows, known._replace(turn=turn))(a),
            dof,
            others(known),
            max(_accelerometer_share(rests, rows, known), rests.rounding_share[2]),
            stated=rests.noise_is_stated,
        )

    stated = whitener(rests, rows, scatter)
    chi2 = chi_squared(rows.residual, columns, stated) - others(scatter)
    found = beside(scatter)
    if scatter != scatter.shares and not found.excess:
        # The excess of the readings may be larger than the rotations need, but a share must not
        # depend on it.
        found = ScatterModel(share=beside(scatter.shares).share)
    return ScatterStatistics(max(chi2, 0.0), dof, found)


def _rate_rows(rests: Rests, rows: ResidualRows, shown: Indices) -> tuple[Array, Array]:
    count = 3 * len(rows.norm.residual)
    return rows.residual[-count:], rows.jacobian[-count:, shown]


def _rate_whitener(rests: Rests) -> Callable[[ScatterModel, Array], Array]:
    def whiten(rate: ScatterModel, columns: Array) -> Array:
        own = rate.of(rests.noise[:, rests.m :, rests.m :], rests.rounding[:, rests.m :])
        inverse = np.linalg.inv(np.linalg.cholesky(own))
        return (inverse @ columns.reshape(len(own), 3, -1)).reshape(columns.shape)

    return whiten


def _accelerometer_share(rests: Rests, rows: ResidualRows, scatter: Scatter) -> float:
    """Return the ratio of the accelerometers' part of the rotations' variance to the gyros'."""

    def variance(share: float) -> float:
        found = row_covariance(rests, rows, scatter._replace(turn=ScatterModel(share=share)))
        own = np.linalg.diagonal(found.rests)[:, [0, 1, 6, 7]]
        return float(own.sum() + np.linalg.trace(found.rotations).sum())

    gyros = 2 * (variance(1.0) - variance(0.5))
    return variance(1.0) / gyros - 1
