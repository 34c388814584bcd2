"""What the residuals of each kind of rows say of their noise: χ², and the spread that explains it.

Norms are judged first, then rates, then rotations, each with what was found before: the readings of
a rest are in all of them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.estimate.residual_scatter import ScatterModel, chi_squared, fit_scatter
from inercal.methods.multi_position.rest_observations import ResidualRows, Rests, Scatter
from inercal.methods.multi_position.row_whitening import NORM_ROW, row_covariance, whitener

Places = NDArray[np.int64]


class ScatterStatistics(NamedTuple):
    """χ² of one kind of rows as stated, its degrees of freedom, and the spread that is found."""

    chi2: float
    dof: int
    spread: ScatterModel


def norm_scatter(rests: Rests, rows: ResidualRows) -> ScatterStatistics:
    """Judge the norms; `rests` are seen by accelerometers alone."""
    jacobian = rows.jacobian[:, : len(rests.sensor.coefficients)]
    dof = len(rows.residual) - int(np.linalg.matrix_rank(jacobian * rests.sensor.unit_scale))

    def whiten(force: ScatterModel, columns: Array) -> Array:
        return whitener(rests, rows, Scatter(force))(columns)

    chi2 = chi_squared(rows.residual, jacobian, lambda a: whiten(ScatterModel(), a))
    return ScatterStatistics(chi2, dof, fit_scatter(rows.residual, jacobian, whiten, dof))


def rate_scatter(rests: Rests, rows: ResidualRows, shown: Places) -> ScatterStatistics:
    """Judge the rates at rest, which show these places of x."""
    residual, jacobian = _rate_rows(rests, rows, shown)
    whiten = _rate_whitener(rests)
    dof = max(len(residual) - shown.size, 0)
    chi2 = chi_squared(residual, jacobian, lambda a: whiten(ScatterModel(), a))
    return ScatterStatistics(chi2, dof, fit_scatter(residual, jacobian, whiten, dof))


def rotation_scatter(
    rests: Rests, rows: ResidualRows, shown: Places, fitted: Places, scatter: Scatter
) -> ScatterStatistics:
    """Judge the rotations: by what they add to χ² of norms and rates together with these.

    Parameters
    ----------
    rests : Rests
    rows : ResidualRows
        At a solution.
    shown, fitted : arrays of int
        Places of x that the rates alone show, and that rates and rotations show together; the
        accelerometers' besides.
    scatter : Scatter
        Of what was judged before.
    """
    assert rows.rotations is not None
    norms = np.arange(len(rests.force.coefficients))
    columns = rows.jacobian[:, np.concatenate([norms, fitted])]
    dof = max(rows.rotations.residual.size - (fitted.size - shown.size), 0)

    def others(known: Scatter) -> float:
        own, white = _norm_deviations(rests, rows, known), _rate_whitener(rests)
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
            _accelerometer_share(rests, rows, known),
        )

    stated = whitener(rests, rows, scatter)
    chi2 = chi_squared(rows.residual, columns, stated) - others(scatter)
    found = beside(scatter)
    if scatter != scatter.shares and not found.excess:
        # What is added to the readings may be more than the rotations need: it tells no share.
        found = ScatterModel(share=beside(scatter.shares).share)
    return ScatterStatistics(max(chi2, 0.0), dof, found)


def _norm_deviations(rests: Rests, rows: ResidualRows, scatter: Scatter) -> Array:
    """Return the standard deviations of the norms, (r,) m/s²."""
    return np.sqrt(row_covariance(rests, rows, scatter).rests[:, NORM_ROW, NORM_ROW])


def _rate_rows(rests: Rests, rows: ResidualRows, shown: Places) -> tuple[Array, Array]:
    count = 3 * len(rows.norm.residual)
    return rows.residual[-count:], rows.jacobian[-count:, shown]


def _rate_whitener(rests: Rests) -> Callable[[ScatterModel, Array], Array]:
    def whiten(rate: ScatterModel, columns: Array) -> Array:
        own = rate.of(rests.noise[:, rests.m :, rests.m :])
        inverse = np.linalg.inv(np.linalg.cholesky(own))
        return (inverse @ columns.reshape(len(own), 3, -1)).reshape(columns.shape)

    return whiten


def _accelerometer_share(rests: Rests, rows: ResidualRows, scatter: Scatter) -> float:
    """Return the accelerometers' part in the rotations' variance, over the gyros' part."""

    def variance(share: float) -> float:
        found = row_covariance(rests, rows, scatter._replace(turn=ScatterModel(share=share)))
        own = np.diagonal(found.rests, axis1=1, axis2=2)[:, [0, 1, 6, 7]]
        return float(own.sum() + np.trace(found.rotations, axis1=1, axis2=2).sum())

    gyros = 2 * (variance(1.0) - variance(0.5))
    return variance(1.0) / gyros - 1
