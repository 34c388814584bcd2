"""The gyros' delay against the accelerometers, from the way between rests.

Gravity's direction u, propagated by the rate, obeys u̇ = u × ω. If the gyros lag by τ, so does u,
and the specific force is ahead of g u by τ g u × ω. Each transition gives the τ of its best fit.
The hand's acceleration changes these values independently, so their scatter gives the uncertainty.
"""

import numpy as np

from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.estimation import Estimate
from inercal.methods import temperature
from inercal.methods.multi_position.rotations import inverse_model
from inercal.methods.residuals import norm_residuals
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations

_MIN_PASSAGES = 5  # transitions: of fewer, the scatter says too little


def gyro_delay(
    observations: Observations, sensor: Sensor, estimate: Estimate, gravity: float
) -> Measured:
    """Return how much later the gyros' samples are than the accelerometers', s.

    The mean over transitions, each with the weight of its own turning; its uncertainty from their
    scatter (Cochran 1977, Sampling Techniques, 2.30, of a ratio).

    Parameters
    ----------
    observations : Observations
        Rests with the transitions between them.
    sensor : Sensor
    estimate : Estimate
        Of the sensor's coefficients.
    gravity : float
        m/s².

    Raises
    ------
    NotObserved
        Too few transitions, or nothing turned.
    """
    from inercal.methods.multi_position._kernels import delay_sums  # loads Numba

    way = observations.transitions
    if way is None or len(way.rest) < _MIN_PASSAGES:
        count = 0 if way is None else len(way.rest)
        raise NotObserved(
            f"[method] time_offset needs gyros and {_MIN_PASSAGES} turns between rests; the "
            f"recording has {count}: record more turns, or remove time_offset",
            key="[method] time_offset",
        )
    force, c = sensor.select_axes("f"), estimate.value[: len(sensor.coefficients)]
    p, m = len(force.coefficients), len(force.axes)
    warmth = temperature.row_offsets(observations, sensor)
    up = norm_residuals(force, observations.mean[:, :m], c[:p], np.array([gravity]), dT=warmth).up
    model = inverse_model(sensor, c, float(np.mean(warmth)))
    along, square = delay_sums(
        way.time,
        way.output,
        way.left,
        way.reached,
        model.matrix,
        model.offset,
        up[way.rest],
        gravity,
    )
    if not square.sum() > 0:
        raise NotObserved(
            "[method] time_offset needs turns about horizontal axes, but every turn is about the "
            "vertical; record other turns, or remove time_offset",
            key="[method] time_offset",
        )
    value = along.sum() / square.sum()
    n = len(along)
    left = along - value * square
    return Measured(float(value), float(np.sqrt(n / (n - 1) * np.sum(left**2)) / square.sum()))
