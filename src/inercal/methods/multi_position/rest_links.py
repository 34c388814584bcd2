"""The rotations between rests as links of a field problem (`inercal.methods.magnetic_field`).

Only the turn about the vertical is used, because the fit of the gyros used the tilt already. The
rotation is relative to the earth, whose rate about the vertical is removed.
"""

from typing import Any

import numpy as np

from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.estimation.residual_scatter import ScatterModel
from inercal.methods import Fit
from inercal.methods.magnetic_field import Links
from inercal.methods.multi_position.rest_observations import Rests
from inercal.methods.multi_position.rotations import transition_rotations
from inercal.physics.frames import exp_so3

_RAMP = 2 / 3  # mean of the squared weights along a ramp, times two for its two halves


def rest_links(fit: Fit[Hand, Any]) -> Links | None:
    """Return the rotations between neighbouring rests, or None for a sensor without gyros."""
    observations, sensor, estimate = fit.observations, fit.sensor, fit.estimate
    rests = Rests(observations, sensor, fit.bench)
    transitions, p = rests.transitions, len(sensor.coefficients)
    if transitions is None:
        return None
    found = dict(zip(estimate.names, estimate.value.tolist(), strict=True))
    x = rests.start()
    x[:p] = estimate.value[:p]
    warmth = rests.transition_temperature_offsets
    way = transition_rotations(
        transitions, sensor, x[:p], rests.rate_noise, found.get("timebase", 0.0), warmth
    )
    before, after = transitions.rest, transitions.rest + 1
    up = rests.norms(x).up[after]
    earth = found.get("earth_up", rests.known_quantities[3].value)
    turned = exp_so3(earth * transitions.duration[:, None] * up) @ way.rotation
    step = observations.duration / observations.samples
    ramps = rests.ramps * (_RAMP * step[:, None])
    own = way.noise + (ramps[before, 1] + ramps[after, 0])[:, None, None] * rests.rate_noise
    spread = {group.name: group.spread for group in estimate.groups}
    wander = spread.get("rates", ScatterModel()).excess * transitions.duration
    clock = _sd(estimate, "timebase") * way.to_timebase
    covariance = (
        spread.get("rotations", ScatterModel()).of(own)
        + wander[:, None, None] ** 2 * np.eye(3)
        + clock[:, :, None] * clock[:, None, :]
    )
    # Nodes are the rests with readings of the magnetometers.
    seen = () if observations.magnetic is None else observations.magnetic.rest
    node = np.searchsorted(seen, before)
    both = np.flatnonzero(np.isin(before, seen) & np.isin(after, seen))
    return Links(
        node[both],
        turned.mT[both],
        covariance[both],
        way.coefficient_derivatives[both],
        np.ones(len(both), dtype=bool),
    )


def _sd(estimate: Estimate, name: str) -> float:
    """Return the standard deviation of a parameter; 0 if it was not estimated."""
    if name not in estimate.names:
        return 0.0
    k = estimate.names.index(name)
    return float(np.sqrt(estimate.covariance[k, k]))
