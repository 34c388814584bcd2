"""Increments of a turntable's readback and of the gyros between knots, for their comparison.

`gyro_comparison` says what the increments are compared by.
"""

from dataclasses import dataclass
from math import inf, radians

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array, Bools
from inercal.benches.turntable.attitude import axis_directions, body_rates, reference_attitude
from inercal.benches.turntable.bench import Turntable
from inercal.recordings import GAP_FACTOR, Track

KNOT = 0.05  # s
_HALF = 0.02  # s, half of the span of a rate
_NEAR = 3  # knots beside an acceleration that belong to it
_LONG = 10  # knots before and after, over which a slow change of the rate shows
_NOISY = 12.0  # times the noise of a reading over the span: six standard deviations of a change
_CLEAR = 50.0  # times the noise of a reading from knot to knot: a turn that its noise leaves clear
_SLOW = radians(0.5)  # rad/s: an interpolated angle that nearly stands
_DUST = 1e-9  # rad, of steps that are rounding
_COARSEST = radians(0.2)  # rad, of a readback's resolution


@dataclass(frozen=True)
class KnotSpacing:
    """Where the knots of a track are.

    Parameters
    ----------
    step : float
        s between samples.
    """

    step: float

    @property
    def every(self) -> int:
        """Samples from knot to knot."""
        return max(round(KNOT / self.step), 1)

    @property
    def half(self) -> int:
        """Half of the samples over which a rate is taken."""
        return max(round(_HALF / self.step), 1)

    @property
    def margin(self) -> int:
        """Samples before the first knot and after the last."""
        return 2 * self.half


@dataclass(frozen=True)
class Increments:
    """Increments between n + 1 knots, of g gyros.

    Parameters
    ----------
    time : (n + 1,) array
        s.
    gyro, table : (n, g) arrays
        Readings integrated, and what ideal gyros on the table would have integrated, rad.
    columns : (g, n, p) array
        What each parameter of a gyro adds to gyro − table.
    rate, acceleration : (n, g) arrays
        Changes of the rate and of the acceleration by the readback, rad/s and rad/s².
    variance : (n + 1,) array
        Of the readback's noise, rad².
    slow : (n,) array
        Whether the angles are interpolated and the table nearly stands.
    axes : (n, k, g) array
        What a gyro has of each axis' turn, rad/rad.
    usable : (n,) array
        Whether there is no gap.
    resolution : float
        Of the readback, rad.
    step : float
        s between samples.
    """

    time: Array
    gyro: Array
    table: Array
    columns: Array
    rate: Array
    acceleration: Array
    variance: Array
    slow: NDArray[np.bool_]
    axes: Array
    usable: NDArray[np.bool_]
    resolution: float
    step: float


def find_increments(
    bench: Turntable,
    track: Track,
    gyros: NDArray[np.bool_],
    inputs: Array,
    harmonics: Array,
    spacing: KnotSpacing,
) -> Increments:
    """Return the increments of a track.

    Parameters
    ----------
    bench : Turntable
    track : Track
        Of one trial, with known angles.
    gyros : (m,) array of bool
        Which columns of the readings are gyros.
    inputs : (g, 3) array
        Their nominal axes in the body.
    harmonics : (q,) array
        Orders of the readback's harmonics that have parameters.
    spacing : KnotSpacing
    """
    time, angles, h, step = track.time, track.angles, spacing.half, spacing.step
    reading = track.reading[:, gyros]
    dt = np.diff(time)
    turned = np.diff(angles, axis=0)
    mean = body_rates(bench, (angles[1:] + angles[:-1]) / 2, turned / dt[:, None])
    g = _integrals(dt, (reading[1:] + reading[:-1]) / 2)
    v = _integrals(dt, mean)
    at = np.arange(2 * h, time.size - 2 * h, spacing.every)
    span = (time[at + h] - time[at - h])[:, None]
    rate = (v[at + h] - v[at - h]) / span
    acceleration = (v[at + 2 * h] - 2 * v[at] + v[at - 2 * h]) / span**2
    # Where the table does not accelerate, these are noise that the increments have too.
    faster, jerk = np.diff(rate, axis=0), np.diff(acceleration, axis=0)
    least = _NOISY * bench.white / span[1:]
    accelerates = (np.abs(faster) > least).any(axis=-1)
    # A slow acceleration shows over a longer time: the rates at its ends have the same noise.
    ends = np.arange(len(rate))[:, None] + np.array([-_LONG, _LONG])
    first, last = rate[np.clip(ends, 0, len(rate) - 1)].swapaxes(0, 1)
    accelerates |= (np.abs(last - first)[1:] > least).any(axis=-1)
    near = np.convolve(accelerates, np.ones(2 * _NEAR + 1), "same") > 0
    faster[~near] = jerk[~near] = 0.0
    lost = np.concatenate([[0], np.cumsum(dt > GAP_FACTOR * step)])
    usable = lost[at[1:] + 2 * h] == lost[at[:-1] - 2 * h]
    there = angles[at]
    axes = axis_directions(bench, there)
    up = reference_attitude(bench, there)[:, 2, :]
    variance, slow = track.angle_variance(bench.white**2)[at], np.zeros(at.size, np.bool_)
    if track.angle_quality is not None:
        # An angle that stands is that of the nearest reading, which may be used elsewhere.
        variance = np.where(np.isfinite(variance), variance, bench.white**2)
        slow = np.linalg.norm(rate, axis=-1) < _SLOW
    sizes = np.abs(turned)
    resolution = float(sizes[sizes > _DUST].min(initial=inf))
    resolution = resolution if resolution < _COARSEST else 0.0
    increments, spans = np.diff(v[at], axis=0), np.diff(time[at])
    clear = _CLEAR * bench.white / (spacing.every * step)
    to_gyros = inputs.T
    return Increments(
        time[at],
        np.diff(g[at], axis=0),
        increments @ to_gyros,
        _parameter_columns(
            spans,
            _without_noise(increments, spans, rate, usable, clear),
            up,
            harmonics,
            there,
            faster,
            jerk,
            inputs,
        ),
        faster @ to_gyros,
        jerk @ to_gyros,
        variance,
        slow[1:] | slow[:-1],
        (axes[1:] + axes[:-1]) / 2 @ to_gyros,
        usable,
        resolution,
        step,
    )


def _without_noise(increments: Array, dt: Array, rate: Array, usable: Bools, clear: float) -> Array:
    """Return the body's increments, (n, 3), averaged where the table turns too slowly.

    The readings of a table that stands are noise. A scale factor that is fitted to them tends to
    −1, because the same noise, reversed, is in the difference between gyros and readback.

    Parameters
    ----------
    increments : (n, 3) array
        rad.
    dt : (n,) array
        s of each.
    rate : (n + 1, 3) array
        At the knots, rad/s.
    usable : (n,) array of bool
        Those without a gap; the others serve no average.
    clear : float
        rad/s, above which noise makes no difference.
    """
    size = np.linalg.norm(rate, axis=-1)
    slow = usable & (np.maximum(size[1:], size[:-1]) < clear)
    box = np.ones(2 * _LONG + 1)

    def around(values: Array) -> Array:
        return np.convolve(np.where(slow, values, 0.0), box, "full")[_LONG:-_LONG]

    mean = np.stack([around(one) for one in increments.T], axis=-1)
    mean /= np.where(slow, around(dt), 1.0)[:, None]
    return np.where(slow[:, None], mean * dt[:, None], increments)


def _parameter_columns(
    dt: Array,
    body: Array,
    up: Array,
    harmonics: Array,
    angles: Array,
    faster: Array,
    jerk: Array,
    inputs: Array,
) -> Array:
    """Return what each parameter adds to each gyro's increments, (g, n, p)."""
    pull = (up[1:] + up[:-1]) / 2 * dt[:, None]
    waves: list[Array] = []
    for h in harmonics:
        for function in (np.sin, np.cos):
            waves += list(np.diff(function(h * angles), axis=0).T)
    result: list[Array] = []
    for along in inputs:
        w = body @ along / dt
        own = dt, faster @ along, jerk @ along
        nonlinear = np.abs(w) * dt, w**2 * dt, w**3 * dt
        result.append(np.column_stack([*own, body, pull, *nonlinear, *waves]))
    return np.stack(result)


def _integrals(dt: Array, rate: Array) -> Array:
    """Return the integral of a rate (n, c) from the first sample to each, (n + 1, c)."""
    whole = np.cumsum(dt[:, None] * rate, axis=0)
    return np.concatenate([np.zeros((1, rate.shape[1])), whole])
