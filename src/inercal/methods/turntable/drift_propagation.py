"""Propagate the drift of biases over time; the equations are in `drift`."""

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation.kernel_options import kernel, kernel_step, record
from inercal.methods.turntable.drift import Drift

record(Drift)


@kernel_step
def sum_drift_components(x: Array, first: int, components: int, out: Array) -> None:
    """Write each bias's drift, the sum of its components; their states start at index `first`."""
    for k in range(3):
        out[k] = 0.0
    for c in range(components):
        for k in range(3):
            out[k] += x[first + 3 * c + k]


@kernel
def propagate_drift(
    drift: Drift, since: float, first: int, keep: Array, drawn: Array, joint: Array
) -> None:
    """Write the diagonals of Φ and Q for the drift over a time; its states start at `first`.

    `joint`, (c, 3), is the covariance of the noise of each component with that of J, for
    `add_drift_cross_covariance`.
    """
    times, variance, walk = drift.times, drift.variance, drift.walk
    own = first + 3 * times.size  # index at which J begins
    for k in range(3):
        total = 0.0
        for c in range(times.size):
            at = first + 3 * c + k
            if np.isinf(times[c]):
                keep[at], drawn[at] = 1.0, walk[k] * since
                continue
            kept = np.exp(-since / times[c])
            keep[at] = kept
            drawn[at] = variance[c, k] * (1 - kept * kept)
            joint[c, k] = 2 * variance[c, k] * times[c] * (1 - kept)
            total += 2 * variance[c, k] * times[c] * since
        if drift.mean_over_run:
            drawn[own + k] = total


@kernel
def add_drift_cross_covariance(drift: Drift, first: int, joint: Array, p: Array) -> None:
    """Add the covariance between J's noise and the components' noise to P, after `predict`."""
    if not drift.mean_over_run:
        return
    components = drift.times.size
    for k in range(3):
        own = first + 3 * components + k
        for c in range(components):
            at = first + 3 * c + k
            p[at, own] += joint[c, k]
            p[own, at] += joint[c, k]
