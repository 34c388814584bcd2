"""Compare a table's readback with the gyros in windows of ten seconds, turning or at rest.

Each window is divided by knots every 0.05 s. The increments between knots are g, the integrated
readings of the gyros, and v, the rotation of the body from the readback and the earth's rate. With
ω = v/Δt, the upward direction u in the body and the axes' angles θ::

    g − v = δA v + (b + G u + p |ω| + q ω² + c ω³) Δt + τ Δv̇ + κ Δv̈ + harmonics of θ + noise

Here δA are scale factors and misalignments, b biases, G the gyros' sensitivity to acceleration, and
p, q and c nonlinearities. τ is the delay of the readback relative to the gyros, and κ is their
second-order lag. Each gyro has its own parameters. The parameters start with the standard
deviations below, and every window without a fault narrows them, so that a turn is compared with all
turns before it. Biases may wander by 0.002 °/s and the stated instability. The readback's clock may
run at any steady rate within its stated uncertainty, which changes τ in proportion to the time, and
this rate may change from window to window. The noise consists of the gyros' noise (stated, or as
seen in the window if that is more), the rounding errors of coarse readings and the readback's
noise. If an interpolated readback nearly stands still, its angle is taken to be within 10″. If a
log contains a readback that was linearly interpolated over intervals T, its angle is off by up to
T/8 times the change of the rate from knot to knot.

With r = g − v minus its prediction, and W the inverse of its covariance, a fault with the signature
s has the significance sᵀ W r / √(sᵀ W s). The signatures are, for each axis, a step at a knot, a
drift that begins at a knot, and a delay. Noise of the readback is recognised because it correlates
neighbouring increments by −½. `readback_increments` calculates W.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false

from itertools import pairwise
from math import degrees, hypot, inf, radians, sqrt
from typing import Literal, NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.units import format_count
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.readback_increments import (
    LEAST_LEFT,
    Increments,
    KnotSpacing,
    WindowFit,
    find_increments,
)
from inercal.benches.turntable.reading.sample_checks import readback_interval
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Track, join_tracks

_Fault = Literal["step", "drift", "delay", "noise"]
_WINDOW = 10.0  # s
_FEWEST = 20  # increments
_PAUSE = 1.0  # s: a window ends at a longer gap
_DRIFT_STEP = 5  # increments between possible beginnings of a drift
# Standard deviations: a run has thousands of places for a step, but one noise value per window.
_SIGNIFICANT: dict[_Fault, float] = {"step": 6.0, "drift": 6.0, "delay": 6.0, "noise": 4.5}
# Smaller differences are ignored: nonlinear gyros, g sensitivity and arrival times can cause them.
_LEAST: dict[_Fault, float] = {"step": radians(10 / 3600), "drift": radians(0.03), "delay": 3e-4,
                             "noise": radians(2 / 3600)}  # fmt: skip
_NOISE_FACTOR = 3.0  # times the stated noise of the readback
# Standard deviations before the first window: δA, b in rad/s, G in rad/s per g, and p, q and c in
# powers of rad/s.
_SCALE, _BIAS, _SENSITIVITY, _NONLINEARITY = 0.05, radians(1), radians(0.2), (2e-3, 5e-3, 5e-3)
_SMALL = radians(5 / 3600)  # rad: smaller harmonics are neglected
_ARRIVAL = 0.02  # s: uncertainty of the clocks if arrival times connect readback and gyros
_LAG = 1e-4  # s², standard deviation of κ
_BIAS_WANDER = radians(0.002)  # rad/s from window to window
_DELAY_WANDER = 5e-5  # s
_REPEATS, _FEW_LEVELS = 0.5, 0.1  # shares of the readings: with fewer, noise hides the steps
_NORMAL = 1.4826  # standard deviation over median absolute deviation for a normal distribution


class ReadbackDifference(NamedTuple):
    """A change in the readback that the gyros do not show.

    Parameters
    ----------
    kind : "step", "drift", "delay" or "noise"
    axis : int
        Axis of the table, where 0 is the outermost; −1 if any axis may be the cause.
    start, stop : float
        Times in the track, s: the step or the beginning of the drift, and the end of the window.
    size : float
        Size of the change: rad for a step or noise, rad/s for a drift, s for a delay.
    significance : float
        Size divided by its standard deviation.
    """

    kind: _Fault
    axis: int
    start: float
    stop: float
    size: float
    significance: float

    def describe(self, names: tuple[str, ...]) -> str:
        """Describe the difference in words; `names` are the names of the axes."""
        window = f"between {self.start:.1f} s and {self.stop:.1f} s"
        if self.kind == "delay":
            late = "later" if self.size > 0 else "earlier"
            return (
                f"the readback is {abs(self.size) * 1e3:.3g} ms {late} than the gyros compared "
                f"with before, {window}: the controller's clock has changed, or readings are late"
            )
        if self.kind == "noise":
            return (
                f"the readback scatters by {degrees(self.size):.2g}° relative to the gyros, "
                f"{window}; this is more than its stated noise"
            )
        what, unit = ("jumps", "°") if self.kind == "step" else ("drifts", " °/s")
        when = f"at {self.start:.1f} s" if self.kind == "step" else window
        return (
            f"the readback of axis {names[self.axis]} {what} by "
            f"{degrees(abs(self.size)):.2g}{unit} relative to the gyros, {when}"
        )


class GyroComparison:
    """The running comparison of readback and gyros along one track.

    Parameters
    ----------
    bench : Turntable
    sensor : Sensor
        The sensor. If it has no gyros, nothing is compared.
    delay : float
        Known delay of the readback, s.
    interval : float
        Time between the readings of a linearly interpolated readback, s; 0 for other readbacks.
    """

    def __init__(self, bench: Turntable, sensor: Sensor, delay: float = 0.0, interval: float = 0.0):
        self._bench, self._interval = bench, interval
        gyros = [axis for axis in sensor.axes if axis.measures == "w"]
        self._columns = np.array([axis.measures == "w" for axis in sensor.axes], np.bool_)
        self._inputs = np.array([axis.i for axis in gyros]).reshape(-1, 3)
        self._white = np.array([axis.noise.white for axis in gyros])
        wander = [hypot(axis.noise.bias_instability, _BIAS_WANDER) for axis in gyros]
        late = hypot(bench.latency.sd, _ARRIVAL)
        # The parameters are in the order of `readback_increments`; the rate of the clock is last.
        own = [_BIAS, late, hypot(_LAG, late * delay)]
        self._harmonics = [(h, of) for h, of in enumerate(bench.harmonics, start=1) if of > _SMALL]
        waves = [of for _, of in self._harmonics for _ in range(2 * len(bench.axes))]
        sd = np.array([*own, *3 * [_SCALE], *3 * [_SENSITIVITY], *_NONLINEARITY, *waves,
                       bench.clock])  # fmt: skip
        mean = np.zeros(sd.size)
        mean[1:3] = delay, -(delay**2) / 2
        self._mean = np.tile(mean, (len(gyros), 1))
        # A root S of each gyro's covariance, P = S Sᵀ, and the part that each window adds.
        self._root = np.tile(np.diag(sd), (len(gyros), 1, 1))
        self._wander = np.zeros((len(gyros), sd.size, 2))
        self._wander[:, 0, 0] = wander
        self._wander[:, 1, 1] = _DELAY_WANDER
        self._begin = inf  # s: beginning of the first window
        self._known = inf  # s: end of the last window without a fault
        self._waiting: list[Track] = []
        self._step = 0.0  # s between samples; 0 before there are any
        self._coarse = np.zeros(len(gyros))  # rad/s, steps of readings whose noise is smaller

    def feed(self, track: Track) -> list[ReadbackDifference]:
        """Return the differences found in the windows that these samples complete.

        Parameters
        ----------
        track : Track
            Next part of the track of one trial, with known angles.
        """
        if not self._inputs.size or not track.time.size:
            return []
        self._waiting.append(track)
        if self._waiting[-1].time[-1] - self._waiting[0].time[0] < 1.2 * _WINDOW:
            return []
        return self._compare(last=False)

    def finish(self) -> list[ReadbackDifference]:
        """Return the differences found in the last window, which may be shorter."""
        return self._compare(last=True) if self._waiting else []

    def _compare(self, *, last: bool) -> list[ReadbackDifference]:
        track = join_tracks(self._waiting) if len(self._waiting) > 1 else self._waiting[0]
        self._waiting = []
        begin = track.time[track.time <= track.time[0] + _WINDOW]
        if not self._step and begin.size > 1:
            self._step = float(np.median(np.diff(begin)))
        ends = [0, *(np.flatnonzero(np.diff(track.time) > _PAUSE) + 1).tolist(), track.time.size]
        return [
            one
            for start, stop in pairwise(ends)
            for one in self._compare_piece(track.slice(start, stop), last or stop < ends[-1])
        ]

    def _compare_piece(self, track: Track, last: bool) -> list[ReadbackDifference]:
        """Compare a track without a pause; unless it is the last, keep what fills no window."""
        found: list[ReadbackDifference] = []
        spacing = KnotSpacing(self._step or 1.0, self._interval)
        every, margin = spacing.every, spacing.margin
        size = max(round(_WINDOW / spacing.step / every), _FEWEST) * every
        whole = max((track.time.size - 2 * margin - 1) // size, 0)
        at = margin + size * np.arange(whole)[:, None] + np.arange(0, size + 1, every)
        found += self._compare_windows(track, spacing, at)
        start = size * whole
        if last and track.time.size - start >= 2 * margin + _FEWEST * every:
            rest = np.arange(start + margin, track.time.size - margin, every)
            found += self._compare_windows(track, spacing, rest[None])
        if not last and start < track.time.size:
            self._waiting = [track.slice(start, track.time.size)]
        return found

    def _compare_windows(
        self, track: Track, spacing: KnotSpacing, at: Indices
    ) -> list[ReadbackDifference]:
        """Return the differences in consecutive windows whose knots are the samples (w, n + 1)."""
        if not at.size:
            return []
        self._coarse = np.maximum(self._coarse, _coarse_steps(track.reading[:, self._columns]))
        orders = np.array([h for h, _ in self._harmonics], dtype=float)
        windows = find_increments(
            self._bench, track, self._columns, self._inputs, orders, spacing, at
        )
        return [one for window in windows for one in self._compare_window(window)]

    def _compare_window(self, knots: Increments) -> list[ReadbackDifference]:
        """Return the differences in one window; if there are none, update the parameters."""
        if knots.dt.size < _FEWEST:
            return []
        self._begin = min(self._begin, float(knots.time[0]))
        # A steady rate of the clock is a delay that grows with time.
        drift = knots.columns[..., 1:2] * (knots.time - self._begin)[:, None]
        columns = np.concatenate([knots.columns, drift], axis=-1)
        residual = knots.difference - np.einsum("gnp,gp->gn", columns, self._mean)
        windows = max((knots.end - self._known) / _WINDOW, 1.0)
        wander = self._wander * sqrt(windows)
        wander[:, 1, 1] = np.hypot(wander[:, 1, 1], self._bench.clock * _WINDOW * windows)
        root = np.concatenate([self._root, wander], axis=-1)
        fit = WindowFit(self._variance(knots, residual), knots.between, residual, columns @ root)
        half = root @ np.linalg.inv(fit.triangle)
        change = np.einsum("gpq,gq->gp", half, fit.explained)
        left = residual - np.einsum("gnp,gp->gn", columns, change)
        if self._interval:
            left = np.where(knots.dynamic > knots.readback, 0.0, left)
        product = left[:, 1:] * left[:, :-1]
        noise = np.column_stack(  # −(lag-1 covariance), its sd
            [-product.mean(axis=-1), product.std(axis=-1) / sqrt(knots.dt.size)]
        )
        found = [
            *_steps_and_drifts(knots, fit),
            *_delay(knots, fit),
            *self._noise_of_readback(knots, noise),
        ]
        if not found:
            self._mean, self._known = self._mean + change, knots.end
            self._root = np.linalg.qr(half.swapaxes(-1, -2)).R.swapaxes(-1, -2)
        return found

    def _variance(self, knots: Increments, residual: Array) -> Array:
        """Return the variances of all increments, (g, n) rad²."""
        change = np.diff(residual)
        change = np.abs(change - _median(change)[:, None])
        spread = (_NORMAL * _median(change)) ** 2 / 2
        excess = (spread - 1.5 * _median(knots.readback)) / _median(knots.dt)
        white = np.maximum(self._white**2, excess)
        # The error of a coarse reading may stay the same during a whole window.
        rounding = (self._coarse[:, None] * knots.dt) ** 2 / 12 * knots.dt.size
        return knots.readback + white[:, None] * knots.dt + knots.dynamic + rounding

    def _noise_of_readback(self, knots: Increments, noise: Array) -> list[ReadbackDifference]:
        """Return the readback's noise if it is larger than stated."""
        scale = sqrt(float(np.sum(noise[:, 1] ** 2)))
        stated = max(self._bench.white, knots.resolution / sqrt(12))
        known = knots.variance + knots.resolution**2 / 12
        excess = float(np.max(noise[:, 0])) - known
        one = ReadbackDifference(
            "noise", -1, float(knots.time[0]), knots.end,
            sqrt(max(excess, 0.0)), (float(np.sum(noise[:, 0])) - known) / max(scale, 1e-300),
        )  # fmt: skip
        return [one] if _counts(one) and one.size > _NOISE_FACTOR * stated else []


def gyro_comparison_findings(track: Track, sensor: Sensor, bench: Turntable) -> tuple[Finding, ...]:
    """Return a warning for each kind of difference between a track's readback and its gyros.

    Parameters
    ----------
    track : Track
        Track of one trial, with known angles.
    sensor : Sensor
    bench : Turntable
    """
    comparison = GyroComparison(bench, sensor, interval=readback_interval(track))
    found: list[ReadbackDifference] = []
    piece = 1 << 16
    for start in range(0, track.time.size, piece):
        found += comparison.feed(track.slice(start, min(start + piece, track.time.size)))
    found += comparison.finish()
    result: list[Finding] = []
    for kind in _LEAST:
        of_kind = [one for one in found if one.kind == kind]
        if not of_kind:
            continue
        first, more = of_kind[0], len(of_kind) - 1
        text = f"{first.describe(bench.names)}{_CAUSE}"
        text += f" ({format_count(more, 'further place')})" if more else ""
        span = np.searchsorted(track.time, [first.start, first.stop])
        result.append(Finding("warning", "readback", text, None, int(span[0]), int(span[1])))
    return tuple(result)


_CAUSE = "; check the encoder, its cable and the controller"


def _coarse_steps(reading: Array) -> Array:
    """Return the steps of (n, g) readings that mostly repeat the previous one; 0 for others."""
    change = np.abs(np.diff(reading, axis=0))
    repeats = np.mean(change == 0, axis=0) > _REPEATS
    few = np.array([np.unique(one).size < _FEW_LEVELS * one.size for one in reading.T])
    least = np.min(change, axis=0, initial=inf, where=change > 0)
    return np.where(repeats & few & (least < inf), least, 0.0)


def _median(values: Array) -> Array:
    """Return the medians along the last axis, faster than NumPy, which also checks for NaN."""
    k, ordered = values.shape[-1], np.sort(values)
    return (ordered[..., k // 2] + ordered[..., (k - 1) // 2]) / 2


def _steps_and_drifts(knots: Increments, fit: WindowFit) -> list[ReadbackDifference]:
    """Return the most significant step and drift, if there are any."""
    s = knots.axes
    score = np.einsum("gnk,gn->nk", s, fit.weighted)
    of_noise = np.einsum("gnk,gn->nk", s**2, fit.of_noise)
    information = np.einsum("gnk,gn->nk", s**2, fit.information)
    best: dict[_Fault, ReadbackDifference] = {}

    def keep(kind: _Fault, at: Array, score: Array, information: Array, of_noise: Array) -> None:
        # If the parameters explain a fault completely, the information is only a rounding error.
        known = np.where(information > LEAST_LEFT * of_noise, information, inf)
        squares = score**2 / known
        at_most = int(squares.argmax())
        if squares.flat[at_most] <= _SIGNIFICANT[kind] ** 2:
            return
        k, axis = divmod(at_most, squares.shape[1])
        one = ReadbackDifference(
            kind, axis, float(at[k]), knots.end,
            -float(score[k, axis] / known[k, axis]), sqrt(squares[k, axis]),
        )  # fmt: skip
        if kind not in best or one.significance > best[kind].significance:
            best[kind] = one

    keep("step", knots.time, score, information, of_noise)
    # With interpolation, a step between two readings is spread over two increments.
    neighbours = np.einsum("gnk,gn->nk", s[:, 1:] * s[:, :-1], fit.neighbours)
    pairs = information[1:] + information[:-1] + 2 * neighbours
    keep("step", knots.time, (score[1:] + score[:-1]) / 2, pairs / 4, of_noise[1:])
    # Sums from a knot to the end of the window; every fifth knot is close enough to any other.
    of_turn, dt = s * knots.dt[:, None], knots.dt[:, None]
    later = np.sum(of_turn * fit.later(of_turn), axis=0)
    blocks = np.arange(0, knots.dt.size, _DRIFT_STEP)
    explained = _block_sums(of_turn, fit.known)
    explained = np.cumsum(explained[:, :, ::-1], axis=2)[:, :, ::-1]
    by_noise = _from_here(dt**2 * of_noise + 2 * later, blocks)
    known = by_noise - np.einsum("kgmq,kgmq->mk", explained, explained)
    late = slice(0, (knots.dt.size - _FEWEST) // _DRIFT_STEP + 1)
    from_here = _from_here(dt * score, blocks)
    keep("drift", knots.time[blocks][late], from_here[late], known[late], by_noise[late])
    return [one for one in best.values() if _counts(one)]


def _block_sums(turns: Array, known: Array) -> Array:
    """Return the sums of products of (g, n, k) and (g, n, q) values per block, (k, g, m, q)."""
    (g, n, k), m = turns.shape, -(-turns.shape[1] // _DRIFT_STEP)
    left, right = np.zeros((g, m * _DRIFT_STEP, k)), np.zeros((g, m * _DRIFT_STEP, known.shape[-1]))
    left[:, :n], right[:, :n] = turns, known
    shape = (g, m, _DRIFT_STEP, -1)
    sums = left.reshape(shape).swapaxes(-1, -2) @ right.reshape(shape)
    return np.moveaxis(sums, 2, 0)


def _from_here(values: Array, blocks: Indices) -> Array:
    """Return the sums of (n, k) values from the beginning of each block to the end."""
    return np.cumsum(np.add.reduceat(values, blocks, axis=0)[::-1], axis=0)[::-1]


def _counts(one: ReadbackDifference) -> bool:
    return one.significance > _SIGNIFICANT[one.kind] and abs(one.size) > _LEAST[one.kind]


def _delay(knots: Increments, fit: WindowFit) -> list[ReadbackDifference]:
    """Return a change of the delay since the windows before, if it is significant."""
    score, information = float(np.sum(knots.rate * fit.weighted)), fit.quadratic(knots.rate)
    if not information:
        return []
    one = ReadbackDifference(
        "delay", -1, float(knots.time[0]), knots.end,
        score / information, abs(score) / sqrt(information),
    )  # fmt: skip
    return [one] if _counts(one) else []
