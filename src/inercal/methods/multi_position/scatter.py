"""χ² of each kind of rows, and the share or excess of the noise that explains it.

Norms come first, then rates, then rotations, each with the noise of those before: the readings of a
rest enter all three kinds.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation.residual_scatter import ScatterModel, chi_squared, fit_scatter
from inercal.methods.multi_position.rest_observations import ResidualRows, Rests, Scatter
from inercal.methods.multi_position.row_whitening import NORM_ROW, row_covariance, whitener

Places = NDArray[np.int64]


class ScatterStatistics(NamedTuple):
    """χ² of one kind of rows by the stated noise, degrees of freedom, and the noise by χ²."""

    chi2: float
    dof: int
    spread: ScatterModel


def norm_scatter(rests: Rests, rows: ResidualRows) -> ScatterStatistics:
    """Return the statistics of the norms; `rests` have accelerometers alone."""
    jacobian = rows.jacobian[:, : len(rests.sensor.coefficients)]
    dof = len(rows.residual) - int(np.linalg.matrix_rank(jacobian * rests.sensor.unit_scale))

    def whiten(force: ScatterModel, columns: Array) -> Array:
        return whitener(rests, rows, Scatter(force))(columns)

    chi2 = chi_squared(rows.residual, jacobian, lambda a: whiten(ScatterModel(), a))
    found = fit_scatter(
        rows.residual,
        jacobian,
        whiten,
        dof,
        least=rests.rounding_share[0],
        stated=rests.noise_is_stated,
    )
    return ScatterStatistics(chi2, dof, found)


def rate_scatter(rests: Rests, rows: ResidualRows, shown: Places) -> ScatterStatistics:
    """Return the statistics of the rates at rest, which determine the places `shown` of x."""
    residual, jacobian = _rate_rows(rests, rows, shown)
    whiten = _rate_whitener(rests)
    dof = max(len(residual) - shown.size, 0)
    chi2 = chi_squared(residual, jacobian, lambda a: whiten(ScatterModel(), a))
    found = fit_scatter(
        residual,
        jacobian,
        whiten,
        dof,
        least=rests.rounding_share[1],
        stated=rests.noise_is_stated,
    )
    return ScatterStatistics(chi2, dof, found)


def rotation_scatter(
    rests: Rests, rows: ResidualRows, shown: Places, fitted: Places, scatter: Scatter
) -> ScatterStatistics:
    """Return the statistics of the rotations: their increment of the χ² of norms and rates.

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
            max(_accelerometer_share(rests, rows, known), rests.rounding_share[2]),
            stated=rests.noise_is_stated,
        )

    stated = whitener(rests, rows, scatter)
    chi2 = chi_squared(rows.residual, columns, stated) - others(scatter)
    found = beside(scatter)
    if scatter != scatter.shares and not found.excess:
        # The excess of the readings may be more than the rotations need; a share must not depend on
        # it.
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
        own = rate.of(rests.noise[:, rests.m :, rests.m :], rests.rounding[:, rests.m :])
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
