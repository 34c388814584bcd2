"""Compare the increments of a turntable's readback and of the gyros between knots.

`gyro_comparison` describes the model of the comparison.

The weighted residuals of several gyros in one window are computed in linear time. The noise of n
increments has a tridiagonal covariance T = L D Lᵀ, and the parameters add C P Cᵀ. With A = D^−½ L⁻¹
C P^½, and Q the upper part of the orthogonal factor in [A; 1] = Q R, the inverse of the sum is W =
T⁻¹ − B Bᵀ, where B = L⁻ᵀ D^−½ Q. No n × n matrix is formed, and no digits are lost if C P Cᵀ is
much larger than T.
"""
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false

from dataclasses import dataclass
from math import ceil, inf, radians

import numpy as np
import scipy.linalg
import scipy.ndimage

from inercal.basics.arrays import Array, Bools, Indices
from inercal.benches.turntable.attitude import axis_directions, body_rates, reference_attitude
from inercal.benches.turntable.bench import Turntable
from inercal.recordings import GAP_FACTOR, Track

KNOT = 0.05  # s
_HALF = 0.02  # s, half of the span over which a rate is taken
_NEAR = 3  # knots beside an acceleration that belong to it
_LONG = 10  # knots before and after, over which a slow change of the rate is visible
_NOISY = 12.0  # times the noise of a reading over the span: six standard deviations of a change
_CLEAR = 50.0  # times the noise of a reading from knot to knot: a turn well above the noise
_SLOW = radians(0.5)  # rad/s: slower than this, an interpolated angle nearly stands still
_DUST = 1e-9  # rad: smaller steps are rounding errors
_TIMING = 5e-4  # s by which single readings are early or late while the rate changes
_SETTLED = radians(10 / 3600)  # rad within which an interpolated angle stands still
_COMMON = 12  # parameters that every comparison has
_COARSEST = radians(0.2)  # rad, of a readback's resolution


@dataclass(frozen=True)
class KnotSpacing:
    """The spacing of the knots in a track.

    Parameters
    ----------
    step : float
        Time between samples, s.
    interval : float
        Time between the readings of a linearly interpolated readback, s; 0 for other readbacks.
    """

    step: float
    interval: float = 0.0

    @property
    def every(self) -> int:
        """Number of samples from knot to knot."""
        return max(round(KNOT / self.step), 1)

    @property
    def half(self) -> int:
        """Half the number of samples over which a rate is taken."""
        return max(round(_HALF / self.step), 1)

    @property
    def margin(self) -> int:
        """Number of samples needed before the first knot and after the last."""
        return 2 * self.half


@dataclass(frozen=True)
class Increments:
    """Increments of g gyros in one window, for n intervals between knots without a gap.

    Parameters
    ----------
    time, dt : (n,) arrays
        Start and length of each increment, s.
    end : float
        Time of the last knot, s.
    difference : (g, n) array
        Integrated readings minus the integral for ideal gyros on the table, rad.
    columns : (g, n, p) array
        Derivative of the difference with respect to each parameter of a gyro.
    rate : (g, n) array
        Changes of the rate according to the readback, rad/s.
    readback, between : (g, n) and (g, n − 1) arrays
        Variance of an increment due to the readback, and its covariance with the next one, rad².
    dynamic : (g, n) array
        Variance due to changes of the rate between samples, rad².
    axes : (g, n, k) array
        Component of each axis' turn that a gyro senses, rad/rad.
    variance : float
        Median variance of one angle of the readback, rad².
    resolution : float
        Resolution of the readback, rad.
    """

    time: Array
    dt: Array
    end: float
    difference: Array
    columns: Array
    rate: Array
    readback: Array
    between: Array
    dynamic: Array
    axes: Array
    variance: float
    resolution: float


def find_increments(
    bench: Turntable,
    track: Track,
    gyros: Bools,
    inputs: Array,
    harmonics: Array,
    spacing: KnotSpacing,
    at: Indices,
) -> list[Increments]:
    """Return the increments of each window.

    Parameters
    ----------
    bench : Turntable
    track : Track
        Track of one trial, with known angles.
    gyros : (m,) array of bool
        Whether each column of the readings is a gyro.
    inputs : (g, 3) array
        Nominal input axes of the gyros in the body.
    harmonics : (q,) array
        Orders of the readback's harmonics that have parameters.
    spacing : KnotSpacing
    at : (w, n + 1) array of int
        Sample numbers of the knots in each window, with at least `spacing.margin` samples on each
        side.
    """
    time, angles, h, step = track.time, track.angles, spacing.half, spacing.step
    reading = track.reading[:, gyros]
    dt = np.diff(time)
    turned = np.diff(angles, axis=0)
    mean = body_rates(bench, (angles[1:] + angles[:-1]) / 2, turned / dt[:, None])
    g = _integrals(dt, (reading[1:] + reading[:-1]) / 2)
    v = _integrals(dt, mean)
    span = (time[at + h] - time[at - h])[..., None]
    rate = (v[at + h] - v[at - h]) / span
    acceleration = (v[at + 2 * h] - 2 * v[at] + v[at - 2 * h]) / span**2
    # If the table does not accelerate, its rate changes are noise, which is also in the increments.
    faster, jerk = np.diff(rate, axis=1), np.diff(acceleration, axis=1)
    least = _NOISY * bench.white / span[:, 1:]
    accelerates = (np.abs(faster) > least).any(axis=-1)
    # A slow acceleration is visible over a longer time, because the noise of the rates is the same.
    knots, end = np.arange(at.shape[1]), at.shape[1] - 1
    first, last = rate[:, np.maximum(knots - _LONG, 0)], rate[:, np.minimum(knots + _LONG, end)]
    accelerates |= (np.abs(last - first)[:, 1:] > least).any(axis=-1)
    near = scipy.ndimage.maximum_filter1d(
        accelerates.astype(np.uint8), 2 * _NEAR + 1, axis=1, mode="constant"
    )
    faster[near == 0] = jerk[near == 0] = 0.0
    lost = np.concatenate([[0], np.cumsum(dt > GAP_FACTOR * step)])
    usable = lost[at[:, 1:] + 2 * h] == lost[at[:, :-1] - 2 * h]
    there = angles[at.ravel()]
    axes = axis_directions(bench, there).reshape(*at.shape, -1, 3)
    up = reference_attitude(bench, there)[:, 2, :].reshape(*at.shape, 3)
    variance, slow = track.angle_variance(bench.white**2)[at], np.zeros(at.shape, np.bool_)
    if track.angle_quality is not None:
        # An angle that stands still comes from the nearest reading, which may be used elsewhere.
        variance = np.where(np.isfinite(variance), variance, bench.white**2)
        slow = np.linalg.norm(rate, axis=-1) < _SLOW
    increments, spans = np.diff(v[at], axis=1), np.diff(time[at], axis=1)
    clear = _CLEAR * bench.white / (spacing.every * step)
    body = _without_noise(increments, spans, rate, usable, clear)
    pull = (up[:, 1:] + up[:, :-1]) / 2 * spans[..., None]
    waves = [
        np.diff(function(order * angles[at]), axis=1)
        for order in harmonics
        for function in (np.sin, np.cos)
    ]
    changed, jerked = _of_gyros(faster, inputs), _of_gyros(jerk, inputs)
    columns = np.empty((*changed.shape, _COMMON + sum(wave.shape[-1] for wave in waves)))
    dt_of_each = spans[:, None]
    columns[..., 0], columns[..., 1], columns[..., 2] = dt_of_each, changed, jerked
    columns[..., 3:6], columns[..., 6:9] = body[:, None], pull[:, None]
    w = _of_gyros(body, inputs) / dt_of_each
    for k, power in enumerate((np.abs(w), w**2, w * w**2)):
        columns[..., 9 + k] = power * dt_of_each
    if waves:
        columns[..., _COMMON:] = np.concatenate(waves, axis=-1)[:, None]
    seen = np.moveaxis((axes[:, 1:] + axes[:, :-1]) / 2 @ inputs.T, -1, 1)
    share = np.einsum("wgnk,wgnk->wgn", seen, seen)
    readback = (variance[:, 1:] + variance[:, :-1])[:, None] * share
    readback += (slow[:, 1:] | slow[:, :-1])[:, None] * _SETTLED**2 / 3
    between = np.sqrt(share[..., 1:] * share[..., :-1])
    between *= -np.where(usable[:, :-1], variance[:, 1:-1], 0.0)[:, None]
    # Where an acceleration begins, trapezoids miss changes of the rate between samples.
    dynamic = (jerked * step**2 / 8) ** 2 + (changed * _TIMING) ** 2
    if spacing.interval:
        # A straight line over an interval T is off by up to T/8 times the change of the rate.
        reach = 2 * ceil(spacing.interval / (spacing.every * step)) + 1
        most = scipy.ndimage.maximum_filter1d(np.abs(changed), reach, axis=-1)
        dynamic += (most * spacing.interval / 8) ** 2
    difference = _of_gyros(np.diff(g[at], axis=1), np.eye(len(inputs)))
    difference -= _of_gyros(increments, inputs)
    middle = np.median(variance, axis=-1)
    turns = np.abs(turned)
    smallest = np.minimum.reduce([np.where(one > _DUST, one, inf) for one in turns.T])
    result: list[Increments] = []
    for i, used in enumerate(usable):
        kept = slice(None) if used.all() else used
        resolution = float(smallest[at[i, 0] - 2 * h : at[i, -1] + 2 * h].min())
        result.append(
            Increments(
                time[at[i, :-1]][kept],
                spans[i, kept],
                float(time[at[i, -1]]),
                difference[i][:, kept],
                columns[i][:, kept],
                changed[i][:, kept],
                readback[i][:, kept],
                between[i] if used.all() else between[i][:, used[1:]][:, not used[0] :],
                dynamic[i][:, kept],
                seen[i][:, kept],
                float(middle[i]),
                resolution if resolution < _COARSEST else 0.0,
            )
        )
    return result


def _of_gyros(vectors: Array, inputs: Array) -> Array:
    """Return the components of vectors (w, n, 3) along the gyros' axes, (w, g, n)."""
    return np.ascontiguousarray((vectors @ inputs.T).swapaxes(1, 2))


def _without_noise(increments: Array, dt: Array, rate: Array, usable: Bools, clear: float) -> Array:
    """Return the body's increments, (w, n, 3), averaged where the table turns too slowly.

    While the table stands still, its readings are only noise. A scale factor that is fitted to them
    tends to −1, because the difference between gyros and readback contains the same noise with the
    opposite sign.

    Parameters
    ----------
    increments : (w, n, 3) array
        Increments of the body's rotation, rad.
    dt : (w, n) array
        Length of each increment, s.
    rate : (w, n + 1, 3) array
        Rates at the knots, rad/s.
    usable : (w, n) array of bool
        Whether each increment is without a gap; the others are not averaged.
    clear : float
        Rate above which noise makes no difference, rad/s.
    """
    size = np.linalg.norm(rate, axis=-1)
    slow = (usable & (np.maximum(size[:, 1:], size[:, :-1]) < clear))[..., None]
    both = np.where(slow, np.concatenate([increments, dt[..., None]], axis=-1), 0.0)
    # Sums over the increments within `_LONG` knots of each increment.
    sums = np.pad(np.cumsum(both, axis=1), [(0, 0), (_LONG + 1, _LONG), (0, 0)], "edge")
    sums[:, : _LONG + 1] = 0.0
    around = sums[:, 2 * _LONG + 1 :] - sums[:, : -2 * _LONG - 1]
    mean = around[..., :3] / np.where(slow, around[..., 3:], 1.0)
    return np.where(slow, mean * dt[..., None], increments)


def _integrals(dt: Array, rate: Array) -> Array:
    """Return the integrals of rates from the first to each of n + 1 samples, (n + 1, c).

    `rate`, (n, c), contains the mean rates over the n intervals `dt` between the samples.
    """
    whole = np.cumsum(dt[:, None] * rate, axis=0)
    return np.concatenate([np.zeros((1, rate.shape[1])), whole])


LEAST_LEFT = 1e-9  # times the information with only noise: less is a rounding error


class WindowFit:
    """The weighted residuals in one window, and the information that they contain.

    Parameters
    ----------
    variance, between : (g, n) and (g, n − 1) arrays
        Diagonal and off-diagonal of the noise's tridiagonal covariance, rad².
    residual : (g, n) array
        Residuals, rad.
    columns : (g, n, q) array
        Change of the residuals for one standard deviation of each parameter.

    Attributes
    ----------
    triangle : (g, q, q) array
        The matrix R defined in the module.
    known : (g, n, q) array
        The matrix B defined in the module.
    explained : (g, q) array
        Qᵀ D^−½ L⁻¹ times the residuals.
    weighted : (g, n) array
        W times the residuals.
    of_noise, information : (g, n) arrays
        Diagonals of T⁻¹ and of W.
    neighbours : (g, n − 1) array
        Elements of W next to its diagonal.
    """

    def __init__(self, variance: Array, between: Array, residual: Array, columns: Array):
        # The covariances of all gyros together form one tridiagonal matrix.
        beside = np.zeros(variance.shape)
        beside[:, :-1] = between
        self._factor = _Bidiagonal(variance.ravel(), beside.ravel()[:-1])
        (g, n, q), size = columns.shape, variance.size
        white = self._factor.whitened(
            np.concatenate([columns, residual[..., None]], axis=-1).reshape(size, -1)
        ).reshape(g, n, -1)
        stacked = np.zeros((g, n + q, q))
        stacked[:, :n] = white[..., :-1]
        stacked[:, np.arange(n, n + q), np.arange(q)] = 1.0
        orthogonal, self.triangle = np.linalg.qr(stacked)
        self._span = orthogonal[:, :n]
        self.explained = np.einsum("gnq,gn->gq", self._span, white[..., -1])
        left = white[..., -1] - np.einsum("gnq,gq->gn", self._span, self.explained)
        back = self._factor.unwhitened(
            np.concatenate([self._span, left[..., None]], axis=-1).reshape(size, -1)
        ).reshape(g, n, -1)
        self.known, self.weighted = back[..., :-1], back[..., -1]
        self.of_noise = self._factor.inverse_diagonal.reshape(g, n)
        self.information = self.of_noise - np.einsum("gnq,gnq->gn", self.known, self.known)
        beside.ravel()[:-1] = self._factor.inverse_neighbours
        self.neighbours = beside[:, :-1] - np.einsum(
            "gnq,gnq->gn", self.known[:, 1:], self.known[:, :-1]
        )

    def later(self, values: Array) -> Array:
        """Multiply (g, n, k) values by the part of T⁻¹ above its diagonal."""
        return self._factor.later(values.reshape(-1, values.shape[-1])).reshape(values.shape)

    def quadratic(self, signature: Array) -> float:
        """Return sᵀ W s for (g, n) values s, or 0 if it is only a rounding error."""
        white = self._factor.whitened(signature.reshape(-1, 1)).reshape(signature.shape)
        explained = np.einsum("gnq,gn->gq", self._span, white)
        left = float(np.sum(white**2) - np.sum(explained**2))
        return left if left > LEAST_LEFT * float(np.sum(white**2)) else 0.0


class _Bidiagonal:
    """The factors L D Lᵀ of a tridiagonal covariance T, where L has ones on its diagonal.

    Parameters
    ----------
    variance, between : (n,) and (n − 1,) arrays
        The diagonal of T, and the elements next to it.
    """

    def __init__(self, variance: Array, between: Array):
        pttrf, self._solve = scipy.linalg.get_lapack_funcs(("pttrf", "tbtrs"), (variance,))
        diagonal, self._below, wrong = pttrf(variance, between)
        if wrong:
            raise np.linalg.LinAlgError("the covariance is not positive definite")
        self._root = np.sqrt(diagonal)[:, None]
        self._band = np.ones((2, variance.size))
        self._band[1, :-1] = self._below
        inverse = (1.0 / diagonal)[:, None]
        squares = np.ones((2, variance.size))
        squares[1, :-1] = -(self._below**2)
        self.inverse_diagonal: Array = self._solved(squares, inverse, "T")[:, 0]
        self.inverse_neighbours: Array = -self._below * self.inverse_diagonal[1:]

    def whitened(self, values: Array) -> Array:
        """Multiply (n, k) values by D^−½ L⁻¹."""
        return self._solved(self._band, values, "N") / self._root

    def unwhitened(self, values: Array) -> Array:
        """Multiply (n, k) values by L⁻ᵀ D^−½."""
        return self._solved(self._band, values / self._root, "T")

    def later(self, values: Array) -> Array:
        """Multiply (n, k) values by the part of T⁻¹ above its diagonal."""
        right = np.zeros_like(values)
        right[:-1] = self.inverse_neighbours[:, None] * values[1:]
        return self._solved(self._band, right, "T")

    def _solved(self, band: Array, right: Array, transposed: str) -> Array:
        """Solve L x = right, or Lᵀ x = right if `transposed` is "T"."""
        return self._solve(band, right, uplo="L", trans=transposed, diag="U")[0]
