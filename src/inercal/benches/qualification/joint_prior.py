"""Use the covariance of qualified parameters as the prior of an estimate.

Estimators, except filters, treat the parameters of a bench as independent. Their estimate is then
updated with the joint covariance, which is exact for a linear problem (`with_prior_covariance`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.parameters import NOT_QUALIFIED, QualifiedParameters
from inercal.benches import Bench
from inercal.estimation import Estimate, Gaussian
from inercal.estimation.result import with_prior_covariance
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations


def joint_prior(known: QualifiedParameters) -> tuple[Array, Array]:
    """Return the mean, (k,), and the covariance, (k, k), of the qualified parameters in SI."""
    return np.array(known.value), np.array(known.covariance)


def with_joint_prior(bench: Bench, estimate: Estimate) -> Estimate:
    """Return the estimate with the joint covariance of the qualified parameters as the prior.

    Parameters
    ----------
    bench : Bench
    estimate : Estimate
        Estimate in which the same parameters were treated as independent.
    """
    known: QualifiedParameters = getattr(bench, "qualified", NOT_QUALIFIED)
    declared = {one.name: one for one in bench.parameters}
    places = [
        k
        for k, name in enumerate(known.names)
        if name in declared and declared[name].scope == "run" and declared[name].sd > 0
    ]
    covariance = joint_prior(known)[1][np.ix_(places, places)] if places else np.zeros((0, 0))
    if not np.any(covariance - np.diag(np.diagonal(covariance))):
        return estimate
    names = [known.names[k] for k in places]
    mean = np.array([declared[name].value for name in names])
    # A bench may add to the variance of gravity; the prior of the estimators is the sum.
    covariance[np.diag_indices(len(names))] = [declared[name].sd ** 2 for name in names]
    return with_prior_covariance(estimate, names, mean, covariance)


@dataclass(frozen=True)
class JointPriorEstimator:
    """An estimator that applies the joint prior and can be sent to another process.

    Parameters
    ----------
    estimator : callable
        One of `Method.estimators`.
    """

    estimator: Any

    def __call__(
        self,
        observations: Observations,
        sensor: Sensor,
        bench: Any,
        steps: Sequence[Any],
        priors: Sequence[Gaussian] = (),
    ) -> Estimate:
        """Return the estimate; the arguments are the same as for the wrapped estimator."""
        return with_joint_prior(bench, self.estimator(observations, sensor, bench, steps, priors))
