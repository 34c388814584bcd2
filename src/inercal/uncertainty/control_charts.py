"""Control charts of repeated vectors: Shewhart, EWMA, T² and MEWMA.

A point is the difference d_t of p values to their reference, with the covariance V_t of a point and
R_t of the reference, which all points have in common::

    Shewhart   z² = d_i²/(V + R)_ii                                of each value
    EWMA       w_t = (1 − λ) w_{t−1} + λ d_i/√V_ii,   w²/(λ/(2 − λ) + R_ii/V_ii)
    T²         dᵀ (V + R)⁻¹ d                                      of all together
    MEWMA      w_t = (1 − λ) w_{t−1} + λ V^−½ d,
               wᵀ (λ/(2 − λ) I + V^−½ R V^−½)⁻¹ w

The error of the reference is the same in all points, so that it does not average in w. Each
statistic is compared with a limit h, that of χ² where V is known. Where V was estimated from few
points h is larger (`run_lengths.wider_limit`).

All charts together have the in-control run length that is stated: the four kinds have equal shares
of the rate of false signals, and each value an equal share of its kind's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.uncertainty.run_lengths import chart_limit, wider_limit

ChartKind = Literal["Shewhart", "EWMA", "T²", "MEWMA"]
KINDS: tuple[ChartKind, ...] = get_args(ChartKind)
EWMA_WEIGHT, MEWMA_WEIGHT = 0.2, 0.1
"""λ of both charts."""


@dataclass(frozen=True, eq=False)
class ChartLimits:
    """Limits h of the squares.

    Parameters
    ----------
    shewhart, ewma : (p,) arrays
    t2, mewma : float
    run_length : float
        ARL₀ of all charts together.
    """

    shewhart: Array
    ewma: Array
    t2: float
    mewma: float
    run_length: float

    @property
    def single_run_length(self) -> float:
        """ARL₀ of the Shewhart or EWMA chart of one value."""
        return self.run_length * len(KINDS) * len(self.shewhart)

    @property
    def joint_run_length(self) -> float:
        """ARL₀ of T² or MEWMA."""
        return self.run_length * len(KINDS)


@dataclass(frozen=True, eq=False)
class ChartValues:
    """Statistics of n points.

    Parameters
    ----------
    shewhart, ewma : (n, p) arrays
        Signed: in standard deviations.
    t2, mewma : (n,) arrays
    """

    shewhart: Array
    ewma: Array
    t2: Array
    mewma: Array

    def signals(self, limits: ChartLimits) -> dict[ChartKind, NDArray[np.bool_]]:
        """Return which points are beyond each kind's limits, (n,) or (n, p) arrays of bool."""
        return {
            "Shewhart": self.shewhart**2 > limits.shewhart,
            "EWMA": self.ewma**2 > limits.ewma,
            "T²": self.t2 > limits.t2,
            "MEWMA": self.mewma > limits.mewma,
        }


def chart_limits(run_length: float, dof: Array, joint_dof: float) -> ChartLimits:
    """Return the limits of the charts of p values.

    Parameters
    ----------
    run_length : float
        ARL₀ of all together.
    dof : (p,) array
        Degrees of freedom of each value's variance; infinite where it is known.
    joint_dof : float
        Of their covariance.
    """
    p = len(dof)
    joint, single = run_length * len(KINDS), run_length * len(KINDS) * p

    def of(length: float, weight: float, size: int, nu: float) -> float:
        limit = chart_limit(length, weight, size)
        return limit if np.isinf(nu) else wider_limit(limit, size, nu)

    return ChartLimits(
        np.array([of(single, 1.0, 1, nu) for nu in dof.tolist()]),
        np.array([of(single, EWMA_WEIGHT, 1, nu) for nu in dof.tolist()]),
        of(joint, 1.0, p, joint_dof),
        of(joint, MEWMA_WEIGHT, p, joint_dof),
        run_length,
    )


def chart_values(
    difference: Array, point: Array, reference: Array, restarts: Sequence[int] = ()
) -> ChartValues:
    """Return the statistics of points in the order of time.

    Parameters
    ----------
    difference : (n, p) array
        d.
    point, reference : (n, p, p) arrays
        V and R.
    restarts : sequence of int
        Points at which the charts that weigh the past begin anew.
    """
    n, p = difference.shape
    of_point = np.diagonal(point, axis1=1, axis2=2)
    of_reference = np.diagonal(reference, axis1=1, axis2=2)
    solved = np.linalg.solve(point + reference, difference[:, :, None])[:, :, 0]
    ewma, mewma = np.zeros((n, p)), np.zeros(n)
    single, joint = np.zeros(p), np.zeros(p)
    variance, joint_variance = (x / (2 - x) for x in (EWMA_WEIGHT, MEWMA_WEIGHT))
    for t in range(n):
        if t in restarts:
            single, joint = np.zeros(p), np.zeros(p)
        root = _inverse_root(point[t])
        single = single + EWMA_WEIGHT * (difference[t] / np.sqrt(of_point[t]) - single)
        joint = joint + MEWMA_WEIGHT * (root @ difference[t] - joint)
        ewma[t] = single / np.sqrt(variance + of_reference[t] / of_point[t])
        spread = joint_variance * np.eye(p) + root @ reference[t] @ root.T
        mewma[t] = joint @ np.linalg.solve(spread, joint)
    return ChartValues(
        difference / np.sqrt(of_point + of_reference),
        ewma,
        np.einsum("np,np->n", difference, solved),
        mewma,
    )


def _inverse_root(covariance: Array) -> Array:
    """Return the symmetric root of the inverse."""
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    # Symmetric in units of the standard deviations; any root whitens.
    root: Array = (vectors / np.sqrt(values)) @ vectors.T / scale
    return root
