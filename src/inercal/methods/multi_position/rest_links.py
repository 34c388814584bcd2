"""The rotations between the nodes of a field problem, from the gyros (`methods.magnetic_field`).

Nodes are the rests and, if the magnetometers were read in between, pieces of the motion. From one
rest directly to the next, only the turn about the vertical is used, because the fit of the gyros
used the tilt already. Rotations are relative to the earth, whose rate about the vertical is
removed. A delay τ of the magnetometers turns a piece by ω τ (ψ in the frame of the later node)::

    ψ = (Cᵀ ω_before − ω_after) τ,       with ω = 0 at a rest
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.estimation.residual_scatter import ScatterModel
from inercal.methods import Fit
from inercal.methods.magnetic_field.records import Links
from inercal.methods.magnetic_field.stage import NodeTimes
from inercal.methods.multi_position.rest_observations import Rests
from inercal.methods.multi_position.rotations import inverse_model, transition_rotations
from inercal.physics.frames import exp_so3
from inercal.physics.sensors import Sensor
from inercal.recordings import Transitions

_RAMP = 2 / 3  # sum of the squared weights of a ramp, in half its samples


def rest_links(fit: Fit[Hand, Any], nodes: NodeTimes) -> Links | None:
    """Return the rotations between neighbouring nodes, or None for a sensor without gyros."""
    observations, sensor, estimate = fit.observations, fit.sensor, fit.estimate
    rests = Rests(observations, sensor, fit.bench)
    way, p = rests.transitions, len(sensor.coefficients)
    if way is None:
        return None
    found = dict(zip(estimate.names, estimate.value.tolist(), strict=True))
    x = rests.start()
    x[:p] = estimate.value[:p]
    # Node j − 1 and node j are linked if both belong to the same transition.
    before = np.arange(len(nodes.time) - 1)
    from_row, to_row = nodes.rest[:-1], nodes.rest[1:]
    of = np.where(from_row >= 0, _index(way.rest, from_row), nodes.transition[:-1])
    into = np.where(to_row >= 0, _index(way.rest, to_row - 1), nodes.transition[1:])
    before = before[(of == into) & (of >= 0)]
    k, still = of[before], nodes.rest >= 0
    sample = np.searchsorted(way.time, nodes.time).clip(0, len(way.time) - 1)
    one, two = sample[before], sample[before + 1]
    first, last = still[before], still[before + 1]
    parts = replace(
        way,
        rest=k,
        start=np.where(first, way.start[k], one),
        left=np.where(first, way.left[k], one),
        reached=np.where(last, way.reached[k], two),
        stop=np.where(last, way.stop[k], two),
    )
    time = np.where(still, np.nan, nodes.time)
    between = between_nodes(
        parts, sensor, x[:p], rests.rate_noise, (time[before], time[before + 1]),
        found.get("timebase", 0.0), rests.transition_temperature_offsets,
    )  # fmt: skip
    earth = found.get("earth_up", rests.known_quantities[3].value) * parts.duration
    matrix = _without_earth(between.matrix, earth, before, nodes.rest, rests.norms(x).up)
    derivative = between._replace(matrix=matrix).derivative
    covariance = _covariance(fit, rests, parts, between.noise, between.to_timebase, (first, last))
    known = derivative[..., :p] if still.all() else derivative
    return Links(before, matrix, covariance, known, first & last)


class BetweenNodes(NamedTuple):
    """The rotations of l links between nodes, whose times may be beside those of samples."""

    matrix: Array  # (l, 3, 3), from the frame of the later node to that of the earlier one
    by_coefficient: Array  # (l, 3, p), in the frame of the later node
    rates: list[Array]  # (l, 3) at the earlier and at the later node, rad/s
    noise: Array  # (l, 3, 3), covariance due to the white noise, rad²
    to_timebase: Array  # (l, 3), as in `TransitionRotations`

    @property
    def derivative(self) -> Array:
        """Derivatives by the coefficients and by the delay of the magnetometers, (l, 3, p + 1)."""
        delayed = self.matrix.mT @ self.rates[0][..., None] - self.rates[1][..., None]
        return np.concatenate([self.by_coefficient, delayed], axis=2)


def between_nodes(
    parts: Transitions, sensor: Sensor, c: Array, white: Array, ends: tuple[Array, Array],
    timebase: float = 0.0, dT: Array | None = None,
) -> BetweenNodes:  # fmt: skip
    """Return the rotations between nodes near the samples `left` and `reached` of each part.

    `ends` are the times of the nodes before and after, (l,) each, s, or NaN for a rest. The other
    arguments are those of `transition_rotations`.
    """
    turns = transition_rotations(parts, sensor, c, white, timebase, dT)
    model = inverse_model(sensor, c)
    rates, aside = list[Array](), list[Array]()
    for time, sample in zip(ends, (parts.left, parts.reached), strict=True):
        rate = (parts.output[sample] @ model.matrix.T + model.offset)[:, 3:]
        rates.append(np.where(np.isnan(time)[:, None], 0.0, rate))
        aside.append(rates[-1] * np.nan_to_num(time - parts.time[sample])[:, None])
    back = exp_so3(-aside[1])
    return BetweenNodes(
        exp_so3(-aside[0]) @ turns.rotation.mT @ back.mT,
        back @ turns.coefficient_derivatives,
        rates,
        turns.noise,
        turns.to_timebase,
    )


def _without_earth(matrix: Array, earth: Array, before: Indices, rest: Indices, up: Array) -> Array:
    """Return rotations (l, 3, 3) relative to the earth, which turned about up by `earth` (l,)."""
    result, here = matrix.copy(), up[0]
    for k, j in enumerate(before.tolist()):
        here = matrix[k].T @ (up[rest[j]] if rest[j] >= 0 else here)
        result[k] = matrix[k] @ exp_so3(-earth[k] * here)
    return result


def _index(starts: Indices, rows: Indices) -> Indices:
    """Return the transition that starts at each row; −1 if there is none."""
    at = np.searchsorted(starts, rows).clip(0, max(len(starts) - 1, 0))
    return np.where(starts[at] == rows, at, -1)


def _covariance(
    fit: Fit[Hand, Any],
    rests: Rests,
    parts: Transitions,
    noise: Array,
    to_timebase: Array,
    at_rest: tuple[Bools, Bools],
) -> Array:
    """Return the covariance of each rotation, (l, 3, 3) rad², without the coefficients' part."""
    step = fit.observations.duration / fit.observations.samples
    assert rests.transitions is not None
    row = rests.transitions.rest[parts.rest]
    ramps = rests.ramps * (_RAMP * step[:, None])
    ramp = np.where(at_rest[0], ramps[row, 1], 0.0) + np.where(at_rest[1], ramps[row + 1, 0], 0.0)
    # Between two samples there is at least the noise of one step.
    least = np.median(np.diff(parts.time)) ** 2 * np.diag(np.diag(rests.rate_noise))
    own = noise + ramp[:, None, None] * rests.rate_noise + least
    spread = {group.name: group.spread for group in fit.estimate.groups}
    wander = spread.get("rates", ScatterModel()).excess * parts.duration
    clock = _sd(fit.estimate, "timebase") * to_timebase
    return (
        spread.get("rotations", ScatterModel()).of(own)
        + wander[:, None, None] ** 2 * np.eye(3)
        + clock[:, :, None] * clock[:, None, :]
    )


def _sd(estimate: Estimate, name: str) -> float:
    """Return the standard deviation of a parameter; 0 if it was not estimated."""
    if name not in estimate.names:
        return 0.0
    k = estimate.names.index(name)
    return float(np.sqrt(estimate.covariance[k, k]))
