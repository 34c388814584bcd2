"""The estimates of many devices as a user has them, one by one, at the cost of a few."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from inercal.estimation import Estimate, Gaussian
from inercal.methods.solving import prepared, solve_each
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations


def estimate_each(
    estimator: Callable[..., Estimate],
    seen: Observations,
    sensor: Sensor,
    bench: Any,
    steps: Sequence[Any],
    priors: Sequence[Gaussian] = (),
) -> list[Estimate]:
    """Return the estimate of each trial with its own tests; trials share a search as in a fleet.

    `tests/fleet` shows that such an estimate is the one of the recording alone.
    """
    together = solve_each(lambda: estimator(seen, sensor, bench, steps, priors))
    found: list[Estimate] = []
    for k, mean in enumerate(seen.mean):
        own = [replace(one, mean=one.mean[k]) if one.mean.ndim > 1 else one for one in priors]
        with prepared(together[k] if together else None):
            found.append(estimator(replace(seen, mean=mean), sensor, bench, steps, own))
    return found
