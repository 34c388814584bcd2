"""The covariance of qualified parameters as the prior of an estimate.

Estimators count parameters of a bench as independent, those of filters apart; the update of their
estimate by the joint covariance is exact for a linear problem (`with_prior_covariance`).
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
    """Return mean and covariance of the qualified parameters, (k,) and (k, k), SI."""
    return np.array(known.value), np.array(known.covariance)


def with_joint_prior(bench: Bench, estimate: Estimate) -> Estimate:
    """Return the estimate with the covariance of the qualified parameters as their prior.

    Parameters
    ----------
    bench : Bench
    estimate : Estimate
        By the same parameters as independent.
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
    # A bench may add to the variance of gravity; estimators have its sum as the prior.
    covariance[np.diag_indices(len(names))] = [declared[name].sd ** 2 for name in names]
    return with_prior_covariance(estimate, names, mean, covariance)


@dataclass(frozen=True)
class JointPriorEstimator:
    """An estimator whose estimates have the joint prior; it can be sent to another process.

    Parameters
    ----------
    estimator : callable
        As of `Method.estimators`.
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
        """Return the estimate; arguments as of the estimator."""
        return with_joint_prior(bench, self.estimator(observations, sensor, bench, steps, priors))
