"""The joint prior covariance of quantities that an estimator took as independent.

An estimator has the quantities b with the prior N(b₀, D), D diagonal but for those whose
correlations it counts (`Estimate.joint_priors`). Where their covariance is Σ, the difference of
information ΔΛ = Σ⁻¹ − D⁻¹ is added to its result::

    M = ΔΛ (1 + P_bb ΔΛ)⁻¹,   x′ = x + P_xb M (b₀ − b),   P′ = P − P_xb M P_bx
    χ²′ = χ² + (b₀ − b)ᵀ M (b₀ − b),   ∂x′/∂b₀ = P′_xb Σ⁻¹

This is exact for a linear problem. A quantity that is no parameter of the estimate, but has a
sensitivity J = ∂x/∂b₀, counts as not determined by the data: P_xb = J D and P_bb = D, which gives
P′ = P + J (Σ − D) Jᵀ.

Source: the update of a Gaussian by information (Bar-Shalom, Li & Kirubarajan 2001, 3.4.2).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation.result import Estimate


def with_prior_covariance(
    estimate: Estimate, names: Sequence[str], mean: Array, covariance: Array
) -> Estimate:
    """Return the estimate with the joint prior of quantities that it took as independent.

    Parameters
    ----------
    estimate : Estimate
        Its priors had the means and the variances of the joint prior, and the
        covariances of its `joint_priors`.
    names : sequence of k str
        Those that do not act on the estimate are left out.
    mean : (k,) array
    covariance : (k, k) array
        Positive definite.
    """
    sd = np.sqrt(np.diagonal(covariance))
    columns = [estimate.sensitivity(name, s) for name, s in zip(names, sd, strict=True)]
    at = [k for k, column in enumerate(columns) if column is not None]
    if not at:
        return estimate
    prior, kept = covariance[np.ix_(at, at)], [names[k] for k in at]
    counted = np.array([name in estimate.joint_priors for name in kept])
    taken = np.where(np.outer(counted, counted) | np.eye(len(at), dtype=bool), prior, 0.0)
    slopes = np.broadcast_arrays(estimate.value, *(c for c in columns if c is not None))[1:]
    cross = np.stack(slopes, axis=-1) @ taken
    lead = estimate.value.shape[:-1]
    b = np.broadcast_to(mean[at], (*lead, len(at))).copy()
    within = np.broadcast_to(taken, (*lead, len(at), len(at))).copy()
    for k, name in enumerate(kept):
        if name in estimate.names and name not in estimate.sensitivities:
            own = estimate.names.index(name)
            b[..., k] = estimate.value[..., own]
            within[..., k, :] = within[..., :, k] = cross[..., own, :]
    added = np.linalg.inv(prior) - np.linalg.inv(taken)
    gain: Array = added @ np.linalg.inv(np.eye(len(at)) + within @ added)
    gain = (gain + _transposed(gain)) / 2
    off = mean[at] - b
    step = (gain @ off[..., None])[..., 0]
    moved: Array = estimate.covariance - cross @ gain @ _transposed(cross)
    after = (cross - cross @ gain @ within) @ np.linalg.inv(prior)
    tested = bool(estimate.dof) and not estimate.groups
    return replace(
        estimate,
        value=estimate.value + (cross @ step[..., None])[..., 0],
        covariance=(moved + _transposed(moved)) / 2,
        chi2=estimate.chi2 + np.sum(off * step, axis=-1) if tested else estimate.chi2,
        sensitivities={
            **estimate.sensitivities,
            **{name: after[..., k] for k, name in enumerate(kept)},
        },
        joint_priors=estimate.joint_priors | set(kept),
    )


def _transposed(matrix: Array) -> Array:
    return np.swapaxes(matrix, -1, -2)
