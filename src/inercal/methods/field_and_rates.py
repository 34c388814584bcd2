"""Calibrate magnetometers in continuous motion, from the field and the gyros, without rests.

The field is constant in space and the gyros give the rotation between samples. Together they
determine the three axes and offsets of the magnetometer in the frame of the gyros, and the gyros'
biases. The accelerometers are not used, so the vertical stays unknown and there is no dip.

The samples of the magnetometer at nodes along the motion are compared (`magnetic_field`), and the
gyros' rate is integrated from node to node. The rotation of a link changes with the gyros'
coefficients c and with the delay τ of the magnetometer (ψ in the frame of the later node)::

    ψ = Σ C ∂ω̂/∂c Δt,        ψ = (Cᵀ ω_before − ω_after) τ,        ψ = −R_afterᵀ ω_e T

A coefficient without a stated prior gets a wide one. The direction of the earth's rate ω_e is
unknown, and so is the attitude R at first. The links are therefore integrated again with the
estimate, and at times earlier by the estimated delay.

Source: Wu et al., "Dynamic magnetometer calibration and alignment to inertial sensors by Kalman
filtering", IEEE Trans. Control Systems Technology 26 (2018) 716.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError, NotObserved
from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.estimation.residual_scatter import LEAST_RATIO
from inercal.methods import Fit, Method, Priors, Remarks, temperature, triangular_frame
from inercal.methods.magnetic_field.fitting import fit_field
from inercal.methods.magnetic_field.records import Directions, FieldConditions, FieldNodes, Links
from inercal.methods.magnetic_field.stage import (
    DELAY_SD,
    STATED_NOISE,
    field_remarks,
    joined,
    linear_model,
    temperature_offsets,
)
from inercal.methods.multi_position.attitude_coverage import hand_held_plan
from inercal.methods.multi_position.rest_links import BetweenNodes, between_nodes
from inercal.methods.order_effects import with_tests_of_priors
from inercal.physics.earth import EARTH_RATE
from inercal.physics.frames import exp_so3
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations, Track, Transitions

_MOST_NODES = 1500
_WIDE_BIAS = np.radians(20.0)  # rad/s
_ROUNDS = 3
_DIFFERENCE = np.sqrt(20.0)  # sd of a third difference of white noise with sd 1
_NORMAL = 1.4826  # sd divided by the median of |x| of a normal distribution


def prior(
    observations: Observations,
    sensor: Sensor,
    bench: Hand,
    steps: Sequence[Any],
    priors: Priors = (),
) -> Estimate:
    """Return what is known of the gyros before the recording, which `add_magnetometers` refines.

    A bias is assumed to be within 40 °/s, a scale-factor error within 20 %, unless priors state
    more.
    """
    names = sensor.coefficients
    mean = np.zeros(len(names))
    covariance = np.diag(
        [
            _WIDE_BIAS**2 if n.endswith(".bias") else sensor.coefficient(n).largest ** 2
            for n in names
        ]
    )
    for one in priors:
        at = [names.index(name) for name in one.names]
        mean[at], covariance[np.ix_(at, at)] = one.mean, one.covariance
    return Estimate.from_closed_form(names, mean, covariance, 1 / np.sqrt(np.diag(covariance)))


def add_magnetometers(fit: Fit[Hand, Any], field: Sensor) -> tuple[Estimate, Remarks]:
    """Return the coefficients of magnetometers and gyros, the delay, and remarks on the field.

    Raises
    ------
    InputError
        There are fewer than three gyros or magnetometers, or the field is not the same everywhere.
    NotObserved
        The motion does not determine all coefficients.
    """
    gyros, track = fit.sensor, fit.observations.track
    seen = None if fit.observations.magnetic is None else fit.observations.magnetic.pieces
    if gyros.rank("w") < len("xyz"):
        raise InputError(
            "field_and_rates needs three gyros, which give the rotation between samples",
            key="[sensor.gyro]",
        )
    assert track is not None
    assert seen is not None
    model, start, g = linear_model(field), fit.estimate.value, len(gyros.coefficients)
    earth = np.full(3, EARTH_RATE / np.sqrt(3))
    q = g + 1 + len(earth)
    wide = np.diag([*np.zeros(g), DELAY_SD, *earth]) ** 2
    wide[:g, :g] = fit.estimate.covariance
    at = _even_samples(seen.time)
    span = float(np.ptp(seen.time))
    of_field, ratio = _noise(seen.mean, field, (len(seen.time) - 1) / span)
    of_rate, _ = _noise(track.reading, gyros, (len(track.time) - 1) / float(np.ptp(track.time)))
    warmth = temperature_offsets(seen.temperature, field, len(seen.time))
    nodes = FieldNodes(
        tuple(f"{t:.2f} s" for t in seen.time[at].tolist()),
        seen.mean[at],
        np.tile(np.diag(of_field**2), (len(at), 1, 1)),
        seen.time[at],
        warmth[at],
    )
    unknown = Directions(
        np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3, q))
    )
    conditions = FieldConditions(fit.bench.field)
    change, found = np.zeros(g + 1), None  # of the coefficients and the delay
    for _ in range(_ROUNDS):
        c, time = start + change[:g], nodes.time - change[g]
        way, variance = _links(track, gyros, c, of_rate, time)
        by_earth = np.zeros((len(at) - 1, 3, 3))
        if found is not None:
            by_earth = -found.attitude[1:].mT * np.diff(nodes.time)[:, None, None]
        # The rotations contain the change of coefficients and delay; the links refer to the start.
        links = Links(
            np.arange(len(at) - 1),
            way.matrix @ exp_so3(-way.derivative @ change),
            variance[:, None, None] * np.eye(3),
            np.concatenate([way.derivative, by_earth], axis=2),
            np.zeros(len(at) - 1, dtype=bool),
        )
        found = fit_field(nodes, model, unknown, links, conditions, wide)
        change = found.correction[: g + 1]
    assert found is not None
    # The later stage refined the gyros; the earth's rate is no result.
    posterior = found.known_covariance[: g + 1, : g + 1]
    found = replace(
        found, correction=change, cross=found.cross[:, : g + 1], known_covariance=posterior
    )
    refined = replace(fit.estimate, value=start + change[:g], covariance=posterior[:g, :g])
    refined = with_tests_of_priors(refined, gyros, fit.priors)
    estimate = joined(refined, found, g)
    return estimate, field_remarks(estimate, found, STATED_NOISE * (ratio > LEAST_RATIO))


def _even_samples(time: Array) -> Indices:
    """Return samples of the magnetometers at even intervals, no more than can be fitted."""
    count = min(len(time), _MOST_NODES)
    grid = time[0] + (time[-1] - time[0]) * np.arange(count) / (count - 1)
    nearest = np.asarray(np.searchsorted(time, grid), dtype=np.int64)
    return np.unique(np.minimum(nearest, len(time) - 1))


def _noise(reading: Array, sensor: Sensor, rate_hz: float) -> tuple[Array, float]:
    """Return the deviation of one sample of each axis, as stated or seen, and their largest ratio.

    Third differences remove all but fast motion, and the median removes its rare moments.
    """
    changes: Array = np.median(np.abs(np.diff(reading, 3, axis=0)), axis=0) * _NORMAL / _DIFFERENCE
    stated = np.array([axis.noise.white for axis in sensor.axes]) * np.sqrt(rate_hz)
    steps = np.array([axis.noise.quantisation for axis in sensor.axes]) / np.sqrt(12)
    result = np.maximum(np.where(stated > 0, stated, changes), steps)
    if not np.all(result > 0):
        raise NotObserved("an axis has the same reading in most samples")
    return result, float(np.max(stated[changes > 0] / changes[changes > 0], initial=0.0))


def _links(
    track: Track, gyros: Sensor, c: Array, noise: Array, time: Array
) -> tuple[BetweenNodes, Array]:
    """Return the rotations between the nodes' times, and the variance of each, (l,) rad²."""
    offsets = temperature.sample_offsets(track, gyros)
    sample = np.searchsorted(0.5 * (track.time[1:] + track.time[:-1]), time)  # the nearest
    first, last = sample[:-1], sample[1:]
    output = gyros.to_output(track.reading)
    parts = Transitions(track.time, output, first, first, first, last, last)
    white, dT = float(np.mean(noise**2)), offsets if offsets.size else None
    ends = time[:-1], time[1:]
    between = between_nodes(parts, gyros, c, white * np.eye(3), ends, dT=dT)
    # Nodes beyond the ends of the track have the same sample.
    least = white * np.diff(time) * np.diff(track.time).min()
    return between, np.maximum(np.linalg.trace(between.noise) / 3, least)


METHOD = Method(
    name="field_and_rates",
    bench=Hand,
    default_coefficients={"w": ("bias",), "m": ("bias", "scale", "misalignment")},
    also={"w": ("scale",), "m": ("temperature",)},
    needs=("w", "m"),
    plan=hand_held_plan,
    estimators={"gls": prior},
    closed_formulas=("gls",),
    source="Wu et al., IEEE Trans. Control Systems Technology 26 (2018) 716",
    unknown_attitudes=True,
    follows_rest=True,
    frame=triangular_frame,
    add_magnetometers=add_magnetometers,
    triads_because="the rotation between two samples needs all three rates",
)
