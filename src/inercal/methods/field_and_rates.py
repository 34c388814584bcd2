"""Magnetometers in continuous motion, from the field and the gyros, without rests.

The field is constant in space and the gyros give the rotation between samples. Together they
determine the three axes and offsets of the magnetometer in the frame of the gyros, and the gyros'
biases. The accelerometers are not used, so the vertical stays unknown and there is no dip.

The samples of the magnetometer at nodes along the motion are compared (`magnetic_field`), and the
gyros' rate is integrated from node to node. The rotation of a link changes with the gyros'
coefficients c and with the delay τ of the magnetometer (ψ in the frame of the later node)::

    ψ = Σ C ∂ω̂/∂c Δt,        ψ = (Cᵀ ω_before − ω_after) τ

A coefficient without a prior has a wide one. The links are integrated again with the estimate.

Source: Wu et al., "Dynamic magnetometer calibration and alignment to inertial sensors by Kalman
filtering", IEEE Trans. Control Systems Technology 26 (2018) 716.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError, NotObserved
from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.estimation.lazy_value import LazyValue
from inercal.methods import Priors, temperature
from inercal.methods.magnetic_field import (
    Directions,
    FieldConditions,
    FieldFit,
    FieldNodes,
    Links,
    fit_field,
)
from inercal.methods.magnetic_field.stage import (
    field_group,
    inhomogeneity_note,
    linear_model,
    tests_of_field,
)
from inercal.physics.frames import exp_so3
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor, inverse
from inercal.recordings import Observations

_MOST_NODES = 1500
_LEAST_SPACING = 0.1  # s; the noise of closer samples averages out less than it costs
_WIDE_BIAS = np.radians(20.0)  # rad/s
_WIDE_DELAY = 0.05  # s
_ROUNDS = 3
_DIFFERENCE = np.sqrt(20.0)  # sd of a third difference of white noise with sd 1
_NORMAL = 1.4826  # sd divided by the median of |x| of a normal distribution
_DELAY = "delay"


class _Samples(NamedTuple):
    """The samples of one recording."""

    time: Array  # (n,), s
    rate: Array  # (n, g), readings of the gyros, rad/s
    field: Array  # (n, 3), readings of the magnetometers, T
    warmth: Array  # (n,), deviation from the reference temperature, K
    fresh: Indices  # samples at which the magnetometers have new readings


class _Rotations(NamedTuple):
    """The rotation from each node to the next."""

    matrix: Array  # (l, 3, 3), from the frame of the later node to that of the earlier one
    by_coefficient: Array  # (l, 3, q), in the frame of the later node
    seconds: Array  # (l,), sum of the squared steps over one step, s
    rate: Array  # (nodes, 3), corrected, rad/s


def gls(
    observations: Observations,
    sensor: Sensor,
    bench: Hand,
    steps: Sequence[Any],
    priors: Priors = (),
) -> Estimate:
    """Return the magnetometers' coefficients, the gyros' biases and the magnetometers' delay.

    Parameters
    ----------
    observations : Observations
        One row with its track.
    sensor : Sensor
        Three gyros or more, and three magnetometers.
    bench : Hand
        With the strength of the field, if it is stated.
    steps : sequence
        Unused.
    priors : sequence of Gaussian
        Priors on coefficients of the gyros.

    Raises
    ------
    InputError
        There are no samples or not enough axes, or a prior is on other coefficients.
    NotObserved
        The motion does not determine all coefficients.
    """
    gyros, field = sensor.select_axes("w"), sensor.select_axes("m")
    if gyros.rank("w") < len("xyz"):
        raise InputError(
            "field_and_rates needs three gyros, which give the rotation between samples",
            key="[sensor.gyro]",
        )
    model, samples = linear_model(field), _samples(observations, gyros, field)
    start, wide = _known(gyros, priors)
    at = _node_samples(samples)
    steps_per_s = (len(samples.time) - 1) / float(np.ptp(samples.time))
    of_field = _noise(
        samples.field[samples.fresh], field, len(samples.fresh) / np.ptp(samples.time)
    )
    of_rate = _noise(samples.rate, gyros, steps_per_s)
    nodes = FieldNodes(
        tuple(f"{t:.2f} s" for t in samples.time[at].tolist()),
        samples.field[at],
        np.tile(np.diag(of_field**2), (len(at), 1, 1)),
        samples.time[at],
        samples.warmth[at],
    )
    conditions = FieldConditions(bench.field, None, bench.hemisphere)
    q = len(wide)
    unknown = Directions(
        np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3, q))
    )
    change, found = np.zeros(len(start)), None
    for _ in range(_ROUNDS):
        way = _rotations(samples, gyros, start + change, at)
        links = _links(way, of_rate, change)
        found = fit_field(nodes, model, unknown, links, conditions, wide)
        change = found.correction[: len(start)]
    assert found is not None
    return _estimate(sensor, found, start)


def _samples(observations: Observations, gyros: Sensor, field: Sensor) -> _Samples:
    track = observations.track
    if track is None:
        raise InputError(
            "field_and_rates needs the samples of a recording, not means of rests", key="track"
        )
    reading = [
        track.reading[:, [observations.channels.index(name) for name in part.channels]]
        for part in (gyros, field)
    ]
    warmth = temperature.sample_offsets(track, field)
    fresh = np.flatnonzero(np.any(np.diff(reading[1], axis=0, prepend=np.inf) != 0, axis=1))
    return _Samples(
        track.time,
        *reading,
        warmth if warmth.size else np.zeros(len(track.time)),
        fresh,
    )


def _node_samples(samples: _Samples) -> Indices:
    """Return the fresh samples that are nodes, at even intervals."""
    time = samples.time[samples.fresh]
    count = min(len(time), _MOST_NODES)
    if count < 2:
        raise NotObserved("the magnetometers have the same reading in all samples")
    grid = np.linspace(time[0], time[-1], count)
    return samples.fresh[np.unique(np.searchsorted(time, grid).clip(0, len(time) - 1))]


def _noise(reading: Array, sensor: Sensor, rate_hz: float) -> Array:
    """Return the standard deviation of one sample of each axis: the stated one, or that seen.

    Third differences remove all but fast motion, and the median removes its rare moments.
    """
    seen = np.median(np.abs(np.diff(reading, 3, axis=0)), axis=0) * _NORMAL / _DIFFERENCE
    stated = np.array([axis.noise.white for axis in sensor.axes]) * np.sqrt(rate_hz)
    steps = np.array([axis.noise.quantisation for axis in sensor.axes]) / np.sqrt(12)
    result = np.maximum(np.where(stated > 0, stated, seen), steps)
    if not np.all(result > 0):
        raise NotObserved("an axis has the same reading in most samples")
    return result


def _known(gyros: Sensor, priors: Priors) -> tuple[Array, Array]:
    """Return the prior mean of the gyros' coefficients, and the covariance with the delay."""
    names = gyros.coefficients
    count = len(names)
    mean, covariance = np.zeros(count), np.zeros((count + 1, count + 1))
    for k, name in enumerate(names):
        wide = _WIDE_BIAS if name.endswith(".bias") else gyros.coefficient(name).largest
        covariance[k, k] = wide**2
    covariance[-1, -1] = _WIDE_DELAY**2
    for prior in priors:
        if not set(prior.names) <= set(names):
            raise InputError(
                f"the prior on {', '.join(prior.names)} is not on coefficients of the gyros; "
                f"field_and_rates accepts priors on {', '.join(names)}",
                names=prior.names,
            )
        at = [names.index(name) for name in prior.names]
        mean[at], covariance[np.ix_(at, at)] = prior.mean, prior.covariance
    return mean, covariance


def _rotations(samples: _Samples, gyros: Sensor, c: Array, at: Indices) -> _Rotations:
    """Integrate the rate between nodes, for all nodes at once (Magnus series, two samples)."""
    rate = inverse(gyros, samples.rate, c, dT=samples.warmth).w
    motion = Motion(np.zeros((1, 3)), rate, dT=samples.warmth)
    _, design, slope = gyros.linearise(motion, c)
    by_coefficient = -np.linalg.pinv(slope[..., 3:6]) @ design
    first, last = at[:-1], at[1:]
    count = len(first)
    turn = np.tile(np.eye(3), (count, 1, 1))
    sensitivity, seconds = np.zeros((count, 3, len(c))), np.zeros(count)
    for step in range(int((last - first).max())):
        k = np.flatnonzero(first + step < last)
        i = first[k] + step
        dt = (samples.time[i + 1] - samples.time[i])[:, None]
        one, two = rate[i], rate[i + 1]
        back = exp_so3(0.5 * dt * (one + two) + dt**2 / 12 * np.cross(one, two))
        half = 0.5 * dt[..., None] * by_coefficient[i], 0.5 * dt[..., None] * by_coefficient[i + 1]
        turn[k] = turn[k] @ back
        sensitivity[k] = back.mT @ (sensitivity[k] + half[0]) + half[1]
        seconds[k] += dt[:, 0] ** 2
    return _Rotations(turn, sensitivity, seconds, rate[at])


def _links(way: _Rotations, noise: Array, change: Array) -> Links:
    """Return the links, with derivatives with respect to the coefficients and the delay.

    The rotations contain the `change` of the coefficients; the links refer to their start.
    """
    count = len(way.matrix)
    by_delay = (way.matrix.mT @ way.rate[:-1, :, None])[..., 0] - way.rate[1:]
    derivative = np.concatenate([way.by_coefficient, by_delay[..., None]], axis=2)
    covariance = np.mean(noise**2) * way.seconds[:, None, None] * np.eye(3)
    return Links(
        np.arange(count),
        way.matrix @ exp_so3(-way.by_coefficient @ change),
        covariance,
        derivative,
        np.zeros(count, dtype=bool),
    )


def _estimate(sensor: Sensor, found: FieldFit, start: Array) -> Estimate:
    g = len(start)
    value = np.concatenate([start + found.correction[:g], found.value, found.correction[g:]])
    joint = np.block(
        [
            [found.known_covariance[:g, :g], found.cross[:, :g].T, found.known_covariance[:g, g:]],
            [found.cross[:, :g], found.covariance, found.cross[:, g:]],
            [found.known_covariance[g:, :g], found.cross[:, g:].T, found.known_covariance[g:, g:]],
        ]
    )
    names = (*sensor.coefficients[:g], *found.names, _DELAY)
    p = len(sensor.coefficients)
    return Estimate(
        names=names,
        value=value,
        covariance=joint,
        chi2=np.array(found.chi2),
        dof=found.dof,
        wanted=sensor.coefficients,
        rank=p,
        singular_values=found.singular_values,
        converged=np.array(found.converged),
        iterations=np.array(found.iterations),
        groups=(field_group(found),),
        notes=(*found.notes, *inhomogeneity_note(found)),
        scoring=LazyValue(lambda: tests_of_field(found, g, len(names))),
    )
