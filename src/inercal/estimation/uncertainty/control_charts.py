"""Control charts for repeated vectors: Shewhart, EWMA or CUSUM, T² and MEWMA.

A point is the difference d_t between p values and their reference. V_t is the covariance of the
point, and R_t that of the reference, which is common to all points::

    Shewhart   z² = d_i²/(V + R)_ii                                of each value
    EWMA       w_t = (1 − λ) w_{t−1} + λ d_i/√V_ii,   w²/(λ/(2 − λ) + R_ii/V_ii)
    T²         dᵀ (V + R)⁻¹ d                                      of all together
    MEWMA      w_t = (1 − λ) w_{t−1} + λ V^−½ d,
               wᵀ (λ/(2 − λ) I + V^−½ R V^−½)⁻¹ w

A CUSUM chart (`cusum`) can be used instead of the EWMA.

The error of the reference is the same in all points, so it does not average out in w. Each
statistic is compared with a limit h, which comes from χ² if V is known. If V was estimated from few
points, h is larger (`run_lengths.wider_limit`).

All charts together have the stated in-control run length: the four kinds have equal shares of the
false-signal rate, and the values have equal shares within each kind.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.estimation.uncertainty.cusum import chart_limit, cusum_limit, cusum_sums, wider_limit

ChartKind = Literal["Shewhart", "EWMA", "CUSUM", "T²", "MEWMA"]
KINDS: tuple[ChartKind, ...] = get_args(ChartKind)
LastingKind = Literal["EWMA", "CUSUM"]
"""The kinds of charts for small lasting changes in one value."""
_DRAWN = 4  # number of chart kinds, with only one kind for lasting changes
EWMA_WEIGHT, MEWMA_WEIGHT = 0.2, 0.1
"""The weight λ of the EWMA and MEWMA charts."""


@dataclass(frozen=True, eq=False)
class ChartLimits:
    """Limits h for the squared statistics.

    Parameters
    ----------
    shewhart, lasting : (p,) arrays
    t2, mewma : float
    run_length : float
        In-control run length ARL₀ of all charts together.
    lasting_kind : "EWMA" or "CUSUM"
    """

    shewhart: Array
    lasting: Array
    t2: float
    mewma: float
    run_length: float
    lasting_kind: LastingKind = "EWMA"

    @property
    def single_run_length(self) -> float:
        """ARL₀ of the Shewhart, EWMA or CUSUM chart for one value."""
        return self.run_length * _DRAWN * len(self.shewhart)

    @property
    def joint_run_length(self) -> float:
        """ARL₀ of the T² or MEWMA chart."""
        return self.run_length * _DRAWN


@dataclass(frozen=True, eq=False)
class ChartValues:
    """Chart statistics of n points.

    Parameters
    ----------
    shewhart, lasting : (n, p) arrays
        Signed statistics in standard deviations; for a CUSUM, the larger of the two sums.
    t2, mewma : (n,) arrays
    """

    shewhart: Array
    lasting: Array
    t2: Array
    mewma: Array

    def signals(self, limits: ChartLimits) -> dict[ChartKind, Bools]:
        """Return which points exceed each kind's limits, as (n,) or (n, p) arrays of bool."""
        return {
            "Shewhart": self.shewhart**2 > limits.shewhart,
            limits.lasting_kind: self.lasting**2 > limits.lasting,
            "T²": self.t2 > limits.t2,
            "MEWMA": self.mewma > limits.mewma,
        }


def chart_limits(
    run_length: float, dof: Array, joint_dof: float, lasting: LastingKind = "EWMA"
) -> ChartLimits:
    """Return the limits of the charts for p values.

    Parameters
    ----------
    run_length : float
        In-control run length ARL₀ of all charts together.
    dof : (p,) array
        Degrees of freedom of each value's variance; infinite if it is known.
    joint_dof : float
        Degrees of freedom of their covariance.
    lasting : "EWMA" or "CUSUM"
    """
    p = len(dof)
    joint, single = run_length * _DRAWN, run_length * _DRAWN * p
    return ChartLimits(
        np.array([_limit(single, 1.0, 1, nu) for nu in dof.tolist()]),
        np.array([lasting_limit(single, nu, lasting) for nu in dof.tolist()]),
        _limit(joint, 1.0, p, joint_dof),
        _limit(joint, MEWMA_WEIGHT, p, joint_dof),
        run_length,
        lasting,
    )


def lasting_limit(run_length: float, dof: float, kind: LastingKind) -> float:
    """Return the limit for the squared statistic of the lasting-change chart of one value."""
    if kind == "CUSUM":
        return cusum_limit(run_length, dof) ** 2
    return _limit(run_length, EWMA_WEIGHT, 1, dof)


def _limit(length: float, weight: float, size: int, dof: float) -> float:
    limit = chart_limit(length, weight, size)
    return limit if np.isinf(dof) else wider_limit(limit, size, dof)


def chart_values(
    difference: Array,
    point: Array,
    reference: Array,
    restarts: Sequence[int] = (),
    lasting: LastingKind = "EWMA",
) -> ChartValues:
    """Return the chart statistics of points in time order.

    Parameters
    ----------
    difference : (n, p) array
        Differences d from the reference.
    point, reference : (n, p, p) arrays
        Covariances V and R.
    restarts : sequence of int
        Points at which the charts with memory restart.
    lasting : "EWMA" or "CUSUM"
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
    if lasting == "CUSUM":
        up, down = cusum_sums(
            difference / np.sqrt(of_point), np.sqrt(of_reference / of_point), restarts
        )
        ewma = np.where(up >= down, up, -down)
    t2 = np.einsum("np,np->n", difference, solved)
    return ChartValues(difference / np.sqrt(of_point + of_reference), ewma, t2, mewma)


def _inverse_root(covariance: Array) -> Array:
    """Return the symmetric square root of the inverse."""
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    # The root is symmetric in units of the standard deviations; any root would whiten.
    root: Array = (vectors / np.sqrt(values)) @ vectors.T / scale
    return root
