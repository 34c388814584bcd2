"""What the residuals of each kind of rows say of their noise: χ², and the spread that explains it.

Norms are judged first, then rates, then rotations, each with what was found before: the readings of
a rest are in all of them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.estimate.spread import Spread, chi_squared, spread
from inercal.methods.multi_position.chain import NORM, noise, whitener
from inercal.methods.multi_position.rests import Rests, Rows, Scatter

Places = NDArray[np.int64]


class Judged(NamedTuple):
    """χ² of one kind of rows as stated, its degrees of freedom, and the spread that is found."""

    chi2: float
    dof: int
    spread: Spread


def of_norms(rests: Rests, rows: Rows) -> Judged:
    """Judge the norms; `rests` are seen by accelerometers alone."""
    jacobian = rows.jacobian[:, : len(rests.sensor.coefficients)]
    dof = len(rows.residual) - int(np.linalg.matrix_rank(jacobian * rests.sensor.unit_scale))

    def whiten(force: Spread, columns: Array) -> Array:
        return whitener(rests, rows, Scatter(force))(columns)

    chi2 = chi_squared(rows.residual, jacobian, lambda a: whiten(Spread(), a))
    return Judged(chi2, dof, spread(rows.residual, jacobian, whiten, dof))


def of_rates(rests: Rests, rows: Rows, shown: Places) -> Judged:
    """Judge the rates at rest, which show these places of x."""
    residual, jacobian = _rates(rests, rows, shown)
    whiten = _whiten_rates(rests)
    dof = max(len(residual) - shown.size, 0)
    chi2 = chi_squared(residual, jacobian, lambda a: whiten(Spread(), a))
    return Judged(chi2, dof, spread(residual, jacobian, whiten, dof))


def of_rotations(
    rests: Rests, rows: Rows, shown: Places, fitted: Places, scatter: Scatter
) -> Judged:
    """Judge the rotations: by what they add to χ² of norms and rates together with these.

    Parameters
    ----------
    rests : Rests
    rows : Rows
        At a solution.
    shown, fitted : arrays of int
        Places of x that the rates alone show, and that rates and rotations show together; the
        accelerometers' besides.
    scatter : Scatter
        Of what was judged before.
    """
    assert rows.turns is not None
    norms = np.arange(len(rests.force.coefficients))
    columns = rows.jacobian[:, np.concatenate([norms, fitted])]
    dof = max(rows.turns.residual.size - (fitted.size - shown.size), 0)

    def others(known: Scatter) -> float:
        own, white = _norms(rests, rows, known), _whiten_rates(rests)
        return chi_squared(
            rows.norm.residual, rows.norm.jacobian[:, :-1], lambda a: a / own[:, None]
        ) + chi_squared(*_rates(rests, rows, shown), lambda a: white(known.rate, a))

    def beside(known: Scatter) -> Spread:
        return spread(
            rows.residual,
            columns,
            lambda turn, a: whitener(rests, rows, known._replace(turn=turn))(a),
            dof,
            others(known),
            _by_accelerometers(rests, rows, known),
        )

    stated = whitener(rests, rows, scatter)
    chi2 = chi_squared(rows.residual, columns, stated) - others(scatter)
    found = beside(scatter)
    if scatter != scatter.shares and not found.excess:
        # What is added to the readings may be more than the rotations need: it tells no share.
        found = Spread(share=beside(scatter.shares).share)
    return Judged(max(chi2, 0.0), dof, found)


def _norms(rests: Rests, rows: Rows, scatter: Scatter) -> Array:
    """Return the standard deviations of the norms, (r,) m/s²."""
    return np.sqrt(noise(rests, rows, scatter).rests[:, NORM, NORM])


def _rates(rests: Rests, rows: Rows, shown: Places) -> tuple[Array, Array]:
    count = 3 * len(rows.norm.residual)
    return rows.residual[-count:], rows.jacobian[-count:, shown]


def _whiten_rates(rests: Rests) -> Callable[[Spread, Array], Array]:
    def whiten(rate: Spread, columns: Array) -> Array:
        own = rate.of(rests.noise[:, rests.m :, rests.m :])
        inverse = np.linalg.inv(np.linalg.cholesky(own))
        return (inverse @ columns.reshape(len(own), 3, -1)).reshape(columns.shape)

    return whiten


def _by_accelerometers(rests: Rests, rows: Rows, scatter: Scatter) -> float:
    """Return the accelerometers' part in the rotations' variance, over the gyros' part."""

    def variance(share: float) -> float:
        found = noise(rests, rows, scatter._replace(turn=Spread(share=share)))
        own = np.diagonal(found.rests, axis1=1, axis2=2)[:, [0, 1, 6, 7]]
        return float(own.sum() + np.trace(found.turns, axis1=1, axis2=2).sum())

    gyros = 2 * (variance(1.0) - variance(0.5))
    return variance(1.0) / gyros - 1
