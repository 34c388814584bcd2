"""Estimate random effects with known shapes in repeated measurements of one vector (REML).

Each session i = 1 … k measures p values with its own known covariance C_i. Random effects add to
the scatter. An effect c is the same in all sessions with the same level, such as a day, and has the
covariance σ_c² G_c G_cᵀ with a known shape::

    y_i = θ + Σ_c u_c(level of i) + e_i,   u_c ~ N(0, σ_c² G_c G_cᵀ),   e_i ~ N(0, C_i)

A few sessions cannot determine an unconstrained covariance of p values, because its rank would be
at most k − 1. They can determine one variance for each shape. The variances maximise the restricted
likelihood, found by Fisher scoring with σ_c² ≥ 0 (Patterson and Thompson 1971, Biometrika 58,
545–554). Let V be the covariance of all sessions, X the derivative of y with respect to θ, P = V⁻¹
− V⁻¹X(XᵀV⁻¹X)⁻¹XᵀV⁻¹ and Z_c the effect's part of V without σ_c². Then::

    score_c = ½ (yᵀPZ_cPy − tr PZ_c),   information_cd = ½ tr PZ_cPZ_d
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices

_STEPS = 100
_HALVINGS = 30
_LEAST_SEEN = 1e-10  # least visible part of an effect, relative to its total effect
_PRECISION = 1e-6  # tolerance of the score in units of its standard deviation


@dataclass(frozen=True, eq=False)
class RandomEffect:
    """Scatter with a known shape, common to all sessions with the same level.

    Parameters
    ----------
    shape : (p, r) array
        The matrix G, with independent columns.
    level : (k,) array of int
        Level of each session, from 0.
    """

    shape: Array
    level: Indices

    @property
    def levels(self) -> int:
        """Number of levels."""
        return int(self.level.max()) + 1

    def factor(self) -> Array:
        """Return the factor H, (k p, levels · r), with Z = H Hᵀ."""
        same = (self.level[:, None] == np.arange(self.levels)).astype(float)
        return np.asarray(np.kron(same, self.shape), dtype=float)

    def covariance(self) -> Array:
        """Return the covariance Z, (k p, k p), for unit variance."""
        same = (self.level[:, None] == self.level).astype(float)
        return np.asarray(np.kron(same, self.shape @ self.shape.T), dtype=float)


@dataclass(frozen=True, eq=False)
class EffectVariances:
    """Estimated variances of the effects.

    Parameters
    ----------
    variance : (c,) array
        Variances σ_c²; 0 if the sessions scatter less than their own covariances predict.
    covariance : (c, c) array
        Covariance of the variances: the inverse of the information.
    converged : bool
    """

    variance: Array
    covariance: Array
    converged: bool


def block_matrix(blocks: Array) -> Array:
    """Return the block-diagonal matrix (k p, k p) with the blocks (k, p, p)."""
    k, p, _ = blocks.shape
    result = np.zeros((k, p, k, p))
    result[np.arange(k), :, np.arange(k)] = blocks
    return result.reshape(k * p, k * p)


def effect_variances(
    values: Array, covariance: Array, effects: Sequence[RandomEffect]
) -> EffectVariances:
    """Return the variances of the effects.

    Parameters
    ----------
    values : (k, p) array
        Measured values, in units in which the effects have similar sizes.
    covariance : (k p, k p) array
        Known covariance: C_i, and contributions that sessions share. It is positive definite.
    effects : sequence of RandomEffect
    """
    k, p = values.shape
    x = np.tile(np.eye(p), (k, 1))
    y = (values - values.mean(axis=0)).ravel()
    # Start from half of the scatter: if everything is noise, the steps end at 0.
    start = np.array([_first_variance(values, one) for one in effects])
    return restricted_variances(y, x, covariance, [one.factor() for one in effects], start)


def restricted_likelihood(y: Array, x: Array, v: Array) -> tuple[float, Array, Array]:
    """Return the restricted log-likelihood without its constant, P, and P y.

    Parameters
    ----------
    y : (n,) array
    x : (n, p) array
        Derivatives of y with respect to the free parameters.
    v : (n, n) array
        Covariance of y.
    """
    inverse = np.linalg.inv(v)
    vx = inverse @ x
    information = x.T @ vx
    projected = inverse - vx @ np.linalg.solve(information, vx.T)
    py = projected @ y
    size = np.linalg.slogdet(v)[1] + np.linalg.slogdet(information)[1]
    return -0.5 * float(size + y @ py), projected, py


class MeasurementBlock(NamedTuple):
    """Measurements y = x θ + e that are independent of other blocks.

    x (n, p) contains the derivatives of y (n,) with respect to the parameters that are free only in
    this block. The known covariance is (n, n), and each effect c has a factor H_c (n, r).
    """

    y: Array
    x: Array
    covariance: Array
    factors: Sequence[Array]


def restricted_variances(
    y: Array, x: Array, covariance: Array, factors: Sequence[Array], start: Array
) -> EffectVariances:
    """Return the variances σ_c² ≥ 0 of y = x θ + e, cov(e) = covariance + Σ σ_c² H_c H_cᵀ.

    Parameters
    ----------
    y, x, covariance : (n,), (n, p) and (n, n) arrays
    factors : sequence of (n, r) arrays
        Factors H_c.
    start : (c,) array
        Start values of the variances.

    Returns
    -------
    EffectVariances
        The variances; 0 for an effect that θ absorbs completely, such as a random walk between two
        times if a slope is free.
    """
    return pooled_variances((MeasurementBlock(y, x, covariance, factors),), start)


def pooled_variances(blocks: Sequence[MeasurementBlock], start: Array) -> EffectVariances:
    """Return the variances σ_c² ≥ 0 common to all blocks; see `restricted_variances`."""
    parts = [[h @ h.T for h in one.factors] for one in blocks]

    def covariances(variance: Array) -> list[Array]:
        return [
            one.covariance + sum(s * z for s, z in zip(variance, of_block, strict=True))
            for one, of_block in zip(blocks, parts, strict=True)
        ]

    def likelihood(variance: Array) -> tuple[float, list[tuple[Array, Array]]]:
        found = [
            restricted_likelihood(one.y, one.x, v)
            for one, v in zip(blocks, covariances(variance), strict=True)
        ]
        return sum(one[0] for one in found), [(one[1], one[2]) for one in found]

    count = len(start)
    seen = _are_seen(blocks, covariances(start), [one[0] for one in likelihood(start)[1]])
    variance = np.where(seen, start, 0.0)
    value, projections = likelihood(variance)
    converged = False
    information = np.eye(count)
    for _ in range(_STEPS):
        score, information = _score(blocks, projections)
        free = seen & ((variance > 0) | (score > 0))
        size = np.sqrt(np.maximum(np.diag(information), 1e-300))
        scaled = score / size
        if np.all(np.abs(scaled[free]) <= _PRECISION):
            converged = True
            break
        step = np.zeros(count)
        correlation = (information / np.outer(size, size))[np.ix_(free, free)]
        step[free] = np.linalg.lstsq(correlation, scaled[free], rcond=1e-12)[0] / size[free]
        for _ in range(_HALVINGS):
            trial = np.maximum(variance + step, 0.0)
            found = likelihood(trial)
            if found[0] > value:
                break
            step /= 2
        else:
            converged = True  # no step increases the likelihood
            break
        variance, (value, projections) = trial, found
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    correlation = information / np.outer(size, size)
    inverse = np.linalg.pinv(correlation, hermitian=True) / np.outer(size, size)
    return EffectVariances(variance, inverse, converged)


def _are_seen(
    blocks: Sequence[MeasurementBlock], covariances: Sequence[Array], projected: Sequence[Array]
) -> Bools:
    """Return whether the free parameters leave effects visible: Σ tr HᵀPH vs. Σ tr HᵀV⁻¹H."""
    found: list[bool] = []
    for c in range(len(blocks[0].factors)):
        factors = [one.factors[c] for one in blocks]
        whole = sum(
            float(np.sum(h * np.linalg.solve(v, h)))
            for h, v in zip(factors, covariances, strict=True)
        )
        left = sum(float(np.sum(h * (p @ h))) for h, p in zip(factors, projected, strict=True))
        found.append(left > _LEAST_SEEN * whole)
    return np.array(found, dtype=bool)


def _first_variance(values: Array, effect: RandomEffect) -> float:
    size = np.square(effect.shape).sum(axis=1)
    spread: Array = np.var(values, axis=0, ddof=1)
    return 0.5 * float(spread[size > 0].mean() / size[size > 0].mean())


def _score(
    blocks: Sequence[MeasurementBlock], projections: Sequence[tuple[Array, Array]]
) -> tuple[Array, Array]:
    count = len(blocks[0].factors)
    score, information = np.zeros(count), np.zeros((count, count))
    for block, (projected, py) in zip(blocks, projections, strict=True):
        factors = block.factors
        by: list[Array] = [projected @ h for h in factors]
        score += [
            0.5 * (float(np.sum(np.square(h.T @ py))) - float(np.sum(h * ph)))
            for h, ph in zip(factors, by, strict=True)
        ]
        information += [[0.5 * float(np.sum(np.square(h.T @ ph))) for ph in by] for h in factors]
    return score, information
