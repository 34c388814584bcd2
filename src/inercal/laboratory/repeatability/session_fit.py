"""Fit sessions and their scatter, in units that make the coefficients comparable.

For one coefficient, the scatter is what the uncertainties of its sessions do not explain. Let V be
the covariance of the k values of one coefficient due to their own uncertainties. The variance σ²
maximises the restricted likelihood of y ~ N(θ, V + σ²). Sessions are weighted by their uncertainty,
because a session with a large uncertainty cannot show a small scatter. If there is no scatter, the
weighted sum of squares about the mean follows χ² with k − 1 degrees of freedom. σ² is only used if
this sum is larger than expected by chance.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation.uncertainty.repeated_measurements import (
    EffectVariances,
    RandomEffect,
    block_matrix,
    effect_variances,
)
from inercal.laboratory.repeatability.sessions import (
    MatchedSessions,
    NamedEffect,
    similar_coefficients,
)

CHANCE = 0.05
"""If chance is less probable than this, the scatter increases U of the mean."""
CHANCE_IN_NEXT_USE = 0.2
"""The same for the next use; 0.05 would reduce coverage by 2 % if scatter equals noise."""
_STEPS = 81  # number of steps in a grid of σ
_REFINEMENTS = 3
_LEAST = 1e-3  # σ relative to the spread of the values, next to 0


@dataclass(frozen=True, eq=False)
class SingleScatter:
    """The scatter of each coefficient, estimated from its own values.

    Parameters
    ----------
    variance : (p,) array
        Variance σ² of the scatter.
    squares : (p,) array
        Weighted sum of squares about the mean, computed without scatter.
    chance : (p,) array
        Probability that the sum would be this large if there were no scatter.
    """

    variance: Array
    squares: Array
    chance: Array

    @property
    def counts(self) -> NDArray[np.bool_]:
        """Whether the sessions' own uncertainties do not explain the scatter, (p,)."""
        return self.chance < CHANCE

    @property
    def counts_in_next_use(self) -> NDArray[np.bool_]:
        """Whether the uncertainties hardly explain the scatter, (p,); used for the next use."""
        return self.chance < CHANCE_IN_NEXT_USE


def single_scatter(values: Array, covariance: Array) -> SingleScatter:
    """Estimate the scatter of each coefficient from its own values.

    Parameters
    ----------
    values : (k, p) array
    covariance : (p, k, k) array
        Covariance V of each coefficient.
    """
    k, size = values.shape
    found = np.zeros((3, size))
    for j in range(size):
        found[:2, j] = _restricted(values[:, j], covariance[j])
    found[2] = scipy.special.chdtrc(k - 1, found[1])
    return SingleScatter(found[0], found[1], found[2])


def covariances_by_coefficient(matched: MatchedSessions, own: Array, unit: Array) -> Array:
    """Return V of each coefficient, (p, k, k), including errors shared by only some sessions.

    Parameters
    ----------
    matched : MatchedSessions
    own : (k, p, p) array
        Covariances without shared errors, in the units `unit`, (p,).
    """
    k, size = own.shape[:2]
    result = np.zeros((size, k, k))
    result[:, np.arange(k), np.arange(k)] = np.diagonal(own, axis1=1, axis2=2).T
    for one in matched.shared:
        if not one.is_common:
            column = (one.column / unit).T
            result += column[:, :, None] * column[:, None, :]
    return result


def _restricted(y: Array, covariance: Array) -> tuple[float, float]:
    """Return σ², and the weighted sum of squares for σ² = 0."""
    eigenvalues, vectors = np.linalg.eigh(covariance)
    variance: Array = np.maximum(eigenvalues, 1e-12 * float(eigenvalues.max()))
    x: Array = vectors.sum(axis=0)
    z: Array = vectors.T @ (y - np.median(y))

    def likelihood(excess: Array) -> tuple[Array, Array]:
        total = variance + excess[:, None]
        information = (x**2 / total).sum(axis=1)
        mean = (x * z / total).sum(axis=1) / information
        squares = ((z - np.outer(mean, x)) ** 2 / total).sum(axis=1)
        return -0.5 * (np.log(total).sum(axis=1) + np.log(information) + squares), squares

    spread = float(np.ptp(y))
    squares = float(likelihood(np.zeros(1))[1][0])
    if spread == 0:
        return 0.0, squares
    sd: Array = np.zeros(_STEPS)
    logarithms: Array = np.linspace(float(np.log(_LEAST)), float(np.log(2.0)), _STEPS - 1)
    sd[1:] = spread * np.exp(logarithms)
    for _ in range(_REFINEMENTS):
        best = int(np.argmax(likelihood(sd**2)[0]))
        if best == 0 and sd[0] == 0:
            return 0.0, squares
        low, high = float(sd[max(best - 1, 0)]), float(sd[min(best + 1, sd.size - 1)])
        sd[:] = low + (high - low) * np.linspace(0.0, 1.0, _STEPS)
    return float(sd[int(np.argmax(likelihood(sd**2)[0]))]) ** 2, squares


_LEAST_EFFECTIVE = 1.5  # effective sessions (Σw)²/Σw²; below this, one has 80 % of the weight


@dataclass(frozen=True, eq=False)
class SessionFit:
    """The fit of k sessions with p coefficients.

    Parameters
    ----------
    matched : MatchedSessions
    effects : tuple of NamedEffect
    groups : mapping
        Indices of similar coefficients.
    unit : (p,) array
        SI size of the unit in which the following fields are stated; similar coefficients have the
        same unit.
    values : (k, p) array
    own : (k, p, p) array
        Covariances without shared errors.
    variances : EffectVariances
        Variances of the effects, SI.
    blocks : (k, p, p) array
        Covariance of each session about the mean, without shared errors.
    mean : (p,) array
    inverse : (p, p) array
        Covariance A⁻¹ of the mean without shared errors.
    shared : (p, p) array
        Covariance of the mean due to shared errors.
    gain : (p, k p) array
        Derivatives of the mean with respect to all values.
    alone : SingleScatter
        Scatter of each coefficient from its own values.
    unseen : tuple of int
        Effects that the sessions cannot show, because one session has almost all the weight and the
        scatter of the others is explained by their uncertainties. The variance of these effects is
        set to 0.
    """

    matched: MatchedSessions
    effects: tuple[NamedEffect, ...]
    groups: Mapping[tuple[str, str, float], tuple[int, ...]]
    unit: Array
    values: Array
    own: Array
    variances: EffectVariances
    blocks: Array
    mean: Array
    inverse: Array
    shared: Array
    gain: Array
    alone: SingleScatter
    unseen: tuple[int, ...]

    @property
    def has_other_days(self) -> bool:
        """Whether every session is from a different day."""
        return int(self.matched.level(0).max()) + 1 == len(self.matched.sessions)

    @property
    def variance(self) -> Array:
        """Variance of each value about the mean without shared errors, (k, p)."""
        return np.diagonal(self.blocks, axis1=1, axis2=2)

    @property
    def similar(self) -> Array:
        """Number of coefficients similar to each coefficient, including itself, (p,)."""
        count = np.ones(len(self.unit))
        for places in self.groups.values():
            count[list(places)] = len(places)
        return count


def fit_sessions(matched: MatchedSessions, effects: tuple[NamedEffect, ...]) -> SessionFit:
    """Estimate the variances of the effects in the sessions, and the mean with these variances."""
    k, p = len(matched.sessions), len(matched.names)
    groups = similar_coefficients(matched.sensor, matched.names)
    unit = _units(matched, groups)
    values, square = matched.values / unit, np.outer(unit, unit)
    own: Array = matched.own / square
    scaled = [RandomEffect(one.effect.shape / unit[:, None], one.effect.level) for one in effects]
    columns = [(one.column / unit).ravel() for one in matched.shared]
    known = block_matrix(own)
    for one, column in zip(matched.shared, columns, strict=True):
        if not one.is_common:  # an error of all sessions changes all in the same way
            known += np.outer(column, column)
    by_coefficient = covariances_by_coefficient(matched, own, unit)
    alone = single_scatter(values, by_coefficient)
    unseen = _unseen_effects(effects, by_coefficient, alone)
    variances = _seen_variances(values, known, scaled, unseen)
    total = block_matrix(_weighting(matched, square))
    for size, one in zip(variances.variance, scaled, strict=True):
        total += size * one.covariance()
    x = np.tile(np.eye(p), (k, 1))
    weighted = np.linalg.solve(total, x)
    inverse: Array = np.asarray(np.linalg.inv(x.T @ weighted), dtype=float)
    gain = inverse @ weighted.T
    shared = np.zeros((p, p))
    for column in columns:
        moved = gain @ column
        shared += np.outer(moved, moved)
    every = np.arange(k)
    blocks: Array = total.reshape(k, p, k, p)[every, :, every]
    mean = gain @ values.ravel()
    return SessionFit(
        matched, effects, groups, unit, values, own, variances, blocks, mean, inverse,
        shared, gain, alone, unseen,
    )  # fmt: skip


def _unseen_effects(
    effects: tuple[NamedEffect, ...], by_coefficient: Array, alone: SingleScatter
) -> tuple[int, ...]:
    """Return the effects that the sessions cannot show at a relevant size.

    If one session has almost all the weight in the mean, only the other sessions, with their large
    uncertainties, contain information on the scatter. A random estimate of the scatter from them
    would then dominate the uncertainty of the good session.
    """
    k = by_coefficient.shape[1]
    variance = np.diagonal(by_coefficient, axis1=1, axis2=2)
    found: list[int] = []
    for number, one in enumerate(effects):
        places = list(one.places)
        weight = 1 / variance[places].mean(axis=0)
        if weight.sum() ** 2 / (weight**2).sum() >= _LEAST_EFFECTIVE:
            continue
        squares = float(alone.squares[places].sum())
        if scipy.special.chdtrc(len(places) * (k - 1), squares) >= CHANCE:
            found.append(number)
    return tuple(found)


def _seen_variances(
    values: Array, known: Array, effects: Sequence[RandomEffect], unseen: tuple[int, ...]
) -> EffectVariances:
    """Return the variances of all effects; the variance of unseen effects is 0."""
    seen = [k for k in range(len(effects)) if k not in unseen]
    whole = effect_variances(values, known, effects)
    if not unseen:
        return whole
    variance = np.zeros(len(effects))
    if not seen:
        return EffectVariances(variance, whole.covariance, converged=True)
    part = effect_variances(values, known, [effects[k] for k in seen])
    variance[seen] = part.variance
    covariance = whole.covariance.copy()  # the confidence limits of unseen effects stay as wide
    covariance[np.ix_(seen, seen)] = part.covariance
    return EffectVariances(variance, covariance, part.converged)


def _units(
    matched: MatchedSessions, groups: Mapping[tuple[str, str, float], tuple[int, ...]]
) -> Array:
    """Return a unit for each coefficient from its u and scatter; similar ones share a unit."""
    unit = np.empty(len(matched.names))
    spread: Array = np.var(matched.values, axis=0, ddof=1)
    variance: Array = spread + np.diagonal(matched.stated, axis1=1, axis2=2).mean(axis=0)
    for places in groups.values():
        unit[list(places)] = np.sqrt(float(variance[list(places)].mean()))
    return unit


def _weighting(matched: MatchedSessions, square: Array) -> Array:
    """Return the covariances for weighting; as stated, if a file does not name shared errors."""
    silent = np.array([one.calibration.shared is None for one in matched.sessions])
    return np.where(silent[:, None, None], matched.stated, matched.own) / square
