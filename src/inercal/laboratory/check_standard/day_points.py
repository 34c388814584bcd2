"""Combine the sessions of each day into one point, which is their mean with a covariance.

Sessions on one day are not independent. Suppose that each of four sessions a day were one point and
that these points shared half of their variance: an EWMA designed for an in-control run length of
385 would then only reach 59. The mean of the n sessions on a day has the covariance::

    V = Σ C_own/n² + Σ_c σ_c² K_c Σ_levels (n_l/n)²

σ_c² K_c are the components of the scatter in the reference, and n_l sessions belong to level l of
component c. The reference mean μ̂ has the covariance A⁻¹. Errors that the sessions share cancel in
the difference from μ̂ if they come from the same determination. If not, the squared difference of
their columns is added.
"""

from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.laboratory.repeatability.session_fit import SessionFit
from inercal.laboratory.repeatability.sessions import LevelName, MatchedSessions

_WHICH: dict[LevelName, int] = {"mount": 1, "turn-on": 2}


@dataclass(frozen=True, eq=False)
class DayPoints:
    """The points of n days with p coefficients, in the units of the fit.

    Parameters
    ----------
    sessions : tuple of tuple of int
        Indices of the sessions on each day.
    difference : (n, p) array
        Difference from the reference mean.
    point, reference : (n, p, p) arrays
        Covariance of the point, and covariance of the reference. The latter includes errors that
        only the point or only the reference has.
    """

    sessions: tuple[tuple[int, ...], ...]
    difference: Array
    point: Array
    reference: Array


def day_points(
    matched: MatchedSessions, fit: SessionFit, reference: list[int], widening: Array
) -> DayPoints:
    """Compute the points of all days.

    Parameters
    ----------
    matched : MatchedSessions
        All sessions.
    fit : SessionFit
        Fit of the reference.
    reference : list of int
        Indices of the sessions in the reference.
    widening : (p,) array
        Factor that multiplies the standard deviation of each coefficient's scatter.
    """
    unit = fit.unit
    values, square = matched.values / unit, np.outer(unit, unit)
    days = matched.level(0)
    members = [np.flatnonzero(days == day).tolist() for day in range(int(days.max()) + 1)]
    shared: list[tuple[Array, Array]] = []
    for one in matched.shared:
        column: Array = one.column / unit
        shared.append((column, fit.gain @ column[reference].ravel()))
    difference: list[Array] = []
    point: list[Array] = []
    of_reference: list[Array] = []
    for of_day in members:
        n = len(of_day)
        difference.append(values[of_day].mean(axis=0) - fit.mean)
        scattered = np.zeros_like(square)
        for one, variance in zip(fit.effects, fit.variances.variance, strict=True):
            shape = one.effect.shape / unit[:, None]
            share = _share(matched, of_day, one.level)
            scattered = scattered + share * variance * shape @ shape.T
        scattered = scattered * np.outer(widening, widening)
        point.append(scattered + matched.own[of_day].sum(axis=0) / square / n**2)
        total = fit.inverse * np.outer(widening, widening)
        for column, mean in shared:
            off = column[of_day].mean(axis=0) - mean
            total = total + np.outer(off, off)
        of_reference.append(total)
    return DayPoints(
        tuple(map(tuple, members)), np.array(difference), np.array(point), np.array(of_reference)
    )


def _share(matched: MatchedSessions, of_day: list[int], level: LevelName) -> float:
    """Return Σ (n_l/n)², which is the fraction of a variance that remains in the mean of a day."""
    if level not in _WHICH:
        return 1.0
    number = matched.level(_WHICH[level])[of_day]
    return float(np.sum((np.bincount(number) / len(of_day)) ** 2))
