"""Compares a table's readback with the gyros over each window of ten seconds, turning or at rest.

The increments of a window, from knot to knot each 0.05 s, are those of the gyros' integrated
readings g, and of the readback turned into the body's rotation v (which includes the earth's
rate). With ω = v/Δt, u the upward direction in the body, θ the axes' angles::

    g − v = δA v + (b + G u + p |ω| + q ω² + c ω³) Δt + τ Δv̇ + κ Δv̈ + harmonics of θ + noise

where δA are scale factors and misalignments, b biases, G the gyros' sensitivity to acceleration, p,
q and c nonlinearities, τ the delay of the readback against the gyros and κ their lag of second
order; each gyro has its own. They begin with the standard deviations below, and every window that
passes narrows them for the next, so that a turn is compared with all those before it. Biases may
wander by 0.002 °/s and the stated instability, τ by the stated rate of the readback's clock. The
noise is that of the gyros (as stated, or as the window shows it where that is more) and of the
readback; where an interpolated readback nearly stands, its angle is within 10″.

With W the inverse covariance of g − v by all of that, a fault of signature s has the significance
sᵀ W r / √(sᵀ W s). Signatures are, axis by axis, a step at a knot, a drift from a knot on, and a
delay; noise of the readback is known by neighbouring increments, which it correlates by −½.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false

from math import degrees, hypot, radians, sqrt
from typing import Literal, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.readback_increments import (
    Increments,
    KnotSpacing,
    find_increments,
)
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Track, join_tracks

Kind = Literal["step", "drift", "delay", "noise"]
_WINDOW = 10.0  # s
_FEWEST = 20  # knots
# Standard deviations: a run has thousands of places for a step, and one noise in each window.
_SIGNIFICANT: dict[Kind, float] = {"step": 6.0, "drift": 6.0, "delay": 6.0, "noise": 4.5}
# Below these no table is blamed: nonlinear gyros, g sensitivity and arrivals have such sizes.
_LEAST: dict[Kind, float] = {"step": radians(10 / 3600), "drift": radians(0.03), "delay": 3e-4,
                             "noise": radians(2 / 3600)}  # fmt: skip
_NOISE_FACTOR = 3.0  # times the stated noise of the readback
# Standard deviations before the first window: δA, b in rad/s, G in rad/s per g, and p, q and c in
# powers of rad/s.
_SCALE, _BIAS, _SENSITIVITY, _NONLINEARITY = 0.05, radians(1), radians(0.2), (2e-3, 5e-3, 5e-3)
_SMALL = radians(5 / 3600)  # rad, of harmonics that make no difference
_ARRIVAL = 0.02  # s, by which arrival ties the clocks of readback and gyros
_LAG = 1e-4  # s², standard deviation of κ
_TIMING = 5e-4  # s, by which single readings are early or late while the rate changes
_BIAS_WANDER = radians(0.002)  # rad/s from window to window
_DELAY_WANDER = 5e-5  # s
_SETTLED = radians(10 / 3600)  # rad, within which an interpolated angle stands
_NORMAL = 1.4826  # standard deviations of a normal distribution in its median absolute deviation


class ReadbackDifference(NamedTuple):
    """What the readback does and the gyros do not.

    Parameters
    ----------
    kind : "step", "drift", "delay" or "noise"
    axis : int
        Of the table, 0 the outermost; −1 where all may be the cause.
    start, stop : float
        s of the track: the step or the begin of the drift, and the end of its window.
    size : float
        rad of a step or of noise, rad/s of a drift, s of a delay.
    significance : float
        Standard deviations.
    """

    kind: Kind
    axis: int
    start: float
    stop: float
    size: float
    significance: float

    def describe(self, names: tuple[str, ...]) -> str:
        """Return it in words; `names` are those of the axes."""
        window = f"between {self.start:.1f} s and {self.stop:.1f} s"
        if self.kind == "delay":
            late = "later" if self.size > 0 else "earlier"
            return (
                f"{window} the readback is {late} than the gyros by {abs(self.size) * 1e3:.3g} ms "
                "more than before: the controller's clock has changed, or readings are late"
            )
        if self.kind == "noise":
            return (
                f"{window} the readback scatters by {degrees(self.size):.2g}° against the gyros, "
                "more than its stated noise"
            )
        what, unit = ("jumps", "°") if self.kind == "step" else ("drifts", " °/s")
        when = f"at {self.start:.1f} s" if self.kind == "step" else window
        return (
            f"{when} the readback of axis {names[self.axis]} {what} against the gyros by "
            f"{degrees(abs(self.size)):.2g}{unit}"
        )


class GyroComparison:
    """The comparison along one track, in the order of its samples.

    Parameters
    ----------
    bench : Turntable
    sensor : Sensor
        Without gyros nothing is compared.
    delay : float
        s by which the readback is late as far as is known.
    """

    def __init__(self, bench: Turntable, sensor: Sensor, delay: float = 0.0):
        self._bench = bench
        gyros = [axis for axis in sensor.axes if axis.measures == "w"]
        self._columns = np.array([axis.measures == "w" for axis in sensor.axes], np.bool_)
        self._inputs = np.array([axis.i for axis in gyros]).reshape(-1, 3)
        self._white = np.array([axis.noise.white for axis in gyros])
        wander = [hypot(axis.noise.bias_instability, _BIAS_WANDER) for axis in gyros]
        late = hypot(bench.latency.sd, _ARRIVAL)
        # In the order of `readback_increments`.
        own = [_BIAS, late, hypot(_LAG, late * delay)]
        self._harmonics = [(h, of) for h, of in enumerate(bench.harmonics, start=1) if of > _SMALL]
        waves = [of for _, of in self._harmonics for _ in range(2 * len(bench.axes))]
        sd = np.array([*own, *3 * [_SCALE], *3 * [_SENSITIVITY], *_NONLINEARITY, *waves])
        mean = np.zeros(sd.size)
        mean[1:3] = delay, -(delay**2) / 2
        self._mean = [mean for _ in gyros]
        self._covariance: list[Array] = [np.diag(sd**2) for _ in gyros]
        late_wander = hypot(bench.clock * _WINDOW, _DELAY_WANDER)
        self._wander = [np.diag([one**2, late_wander**2, *np.zeros(sd.size - 2)]) for one in wander]
        self._waiting: list[Track] = []
        self._step = 0.0  # s between samples; 0 before there are any

    def feed(self, track: Track) -> list[ReadbackDifference]:
        """Return what is found in the windows that these samples complete.

        Parameters
        ----------
        track : Track
            Of one trial, with known angles; it follows the one before.
        """
        if not self._inputs.size or not track.time.size:
            return []
        self._waiting.append(track)
        if self._waiting[-1].time[-1] - self._waiting[0].time[0] < 1.2 * _WINDOW:
            return []
        return self._compare(last=False)

    def finish(self) -> list[ReadbackDifference]:
        """Return what is found in the last window, which may be shorter."""
        return self._compare(last=True) if self._waiting else []

    def _compare(self, *, last: bool) -> list[ReadbackDifference]:
        track = join_tracks(self._waiting) if len(self._waiting) > 1 else self._waiting[0]
        self._waiting = []
        found: list[ReadbackDifference] = []
        start, begin = 0, track.time[track.time <= track.time[0] + _WINDOW]
        if not self._step and begin.size > 1:
            self._step = float(np.median(np.diff(begin)))
        spacing = KnotSpacing(self._step or 1.0)
        every, margin = spacing.every, spacing.margin
        size = max(round(_WINDOW / spacing.step / every), _FEWEST) * every
        while True:
            stop = start + size + 2 * margin + 1
            if stop > track.time.size:
                if not last or track.time.size - start < 2 * margin + _FEWEST * every:
                    break
                stop = track.time.size
            part = track.slice(start, stop)
            orders = np.array([h for h, _ in self._harmonics], dtype=float)
            found += self._compare_window(
                find_increments(self._bench, part, self._columns, self._inputs, orders, spacing)
            )
            start += size
        if not last and start < track.time.size:
            self._waiting = [track.slice(start, track.time.size)]
        return found

    def _compare_window(self, knots: Increments) -> list[ReadbackDifference]:
        """Return what is found in one window, and learn from it where that is nothing."""
        used = np.flatnonzero(knots.usable)
        if used.size < _FEWEST:
            return []
        dt = np.diff(knots.time)[used]
        weights, residuals, learned = list[Array](), list[Array](), list[tuple[Array, Array]]()
        noise = np.zeros((self._white.size, 2))  # −(lag-1 covariance), its sd
        for i, (mean, before) in enumerate(zip(self._mean, self._covariance, strict=True)):
            columns = knots.columns[i, used]
            y = (knots.gyro - knots.table)[used, i]
            prior = before + self._wander[i]
            own = self._noise(knots, used, dt, y - columns @ mean, i)
            weight = _inverse(own + columns @ prior @ columns.T)
            gain = prior @ columns.T @ weight
            r = y - columns @ mean
            after = mean + gain @ r, prior - gain @ columns @ prior
            left = y - columns @ after[0]
            product = left[1:] * left[:-1]
            noise[i] = -np.mean(product), float(np.std(product)) / sqrt(used.size)
            weights.append(weight)
            residuals.append(r)
            learned.append((after[0], (after[1] + after[1].T) / 2))
        found = [
            *self._steps_and_drifts(knots, used, weights, residuals),
            *_delay(knots, used, weights, residuals),
            *self._noise_of_readback(knots, noise),
        ]
        if not found:
            self._mean = [mean for mean, _ in learned]
            self._covariance = [covariance for _, covariance in learned]
        return found

    def _noise(
        self, knots: Increments, used: NDArray[np.int64], dt: Array, residual: Array, i: int
    ) -> Array:
        """Return the covariance of the increments of gyro i, (n, n) rad²."""
        share = np.sum(knots.axes[:, :, i] ** 2, axis=1)
        both = (knots.variance[1:] + knots.variance[:-1]) * share
        both += knots.slow * _SETTLED**2 / 3
        between = -knots.variance[1:-1] * np.sqrt(share[1:] * share[:-1])
        between = np.where(np.diff(used) == 1, between[used[:-1]], 0.0)
        # Trapezoids miss what the rate does between samples where an acceleration begins.
        dynamic = (knots.acceleration[used, i] * knots.step**2 / 8) ** 2
        dynamic += (knots.rate[used, i] * _TIMING) ** 2
        change = np.diff(residual)
        spread = (_NORMAL * float(np.median(np.abs(change - np.median(change))))) ** 2 / 2
        white = max(
            self._white[i] ** 2,
            (spread - 1.5 * float(np.median(both[used]))) / float(np.median(dt)),
        )
        whole = np.diag(both[used] + white * dt + dynamic)
        k = np.arange(used.size - 1)
        whole[k, k + 1] = whole[k + 1, k] = between
        return whole

    def _steps_and_drifts(
        self,
        knots: Increments,
        used: NDArray[np.int64],
        weights: list[Array],
        residuals: list[Array],
    ) -> list[ReadbackDifference]:
        """Return the most significant step and drift, if there are any."""
        time, dt = knots.time[:-1][used], np.diff(knots.time)[used]
        later = [np.triu(w, 1) for w in weights]
        best: dict[Kind, ReadbackDifference] = {}

        def keep(kind: Kind, axis: int, at: Array, score: Array, information: Array) -> None:
            z = score / np.sqrt(np.maximum(information, 1e-300))
            k = int(np.argmax(np.abs(z)))
            one = ReadbackDifference(
                kind, axis, float(at[k]), float(knots.time[-1]),
                -float(score[k] / max(information[k], 1e-300)), abs(float(z[k])),
            )  # fmt: skip
            if kind not in best or one.significance > best[kind].significance:
                best[kind] = one

        for axis in range(knots.axes.shape[1]):
            score, information, of_later = np.zeros((3, used.size))
            neighbours = np.zeros(used.size - 1)
            for i, (w, r) in enumerate(zip(weights, residuals, strict=True)):
                s = knots.axes[used, axis, i]
                score += s * (w @ r)
                information += s**2 * np.diagonal(w)
                neighbours += s[1:] * s[:-1] * np.diagonal(w, 1)
                of_later += s * (later[i] @ (s * dt))
            keep("step", axis, time, score, information)
            # A step between two readings is in two increments where their interpolation is.
            pairs = information[1:] + information[:-1] + 2 * neighbours
            keep("step", axis, time, (score[1:] + score[:-1]) / 2, pairs / 4)
            # Sums from each knot to the end of the window; each fifth is near enough to any.
            from_here = np.cumsum((dt * score)[::-1])[::-1]
            known = np.cumsum((dt**2 * information + 2 * dt * of_later)[::-1])[::-1]
            late = slice(0, used.size - _FEWEST + 1, 5)
            keep("drift", axis, time[late], from_here[late], known[late])
        return [one for one in best.values() if _counts(one)]

    def _noise_of_readback(self, knots: Increments, noise: Array) -> list[ReadbackDifference]:
        """Return the readback's noise where it is more than stated."""
        scale = sqrt(float(np.sum(noise[:, 1] ** 2)))
        stated = max(self._bench.white, knots.resolution / sqrt(12))
        known = float(np.median(knots.variance)) + knots.resolution**2 / 12
        excess = float(np.max(noise[:, 0])) - known
        one = ReadbackDifference(
            "noise", -1, float(knots.time[0]), float(knots.time[-1]),
            sqrt(max(excess, 0.0)), (float(np.sum(noise[:, 0])) - known) / max(scale, 1e-300),
        )  # fmt: skip
        return [one] if _counts(one) and one.size > _NOISE_FACTOR * stated else []


def gyro_comparison_findings(track: Track, sensor: Sensor, bench: Turntable) -> tuple[Finding, ...]:
    """Return a warning for each kind of difference between a track's readback and its gyros.

    Parameters
    ----------
    track : Track
        Of one trial, with known angles.
    sensor : Sensor
    bench : Turntable
    """
    comparison = GyroComparison(bench, sensor)
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
        text += f" ({more} further place{'s' * (more > 1)})" if more else ""
        span = np.searchsorted(track.time, [first.start, first.stop])
        result.append(Finding("warning", "readback", text, None, int(span[0]), int(span[1])))
    return tuple(result)


_CAUSE = "; check the encoder, its cable and the controller"


def _inverse(covariance: Array) -> Array:
    """Return the inverse of a positive definite matrix, in a third of the time of `numpy`'s."""
    potrf, potri = scipy.linalg.get_lapack_funcs(("potrf", "potri"), (covariance,))
    factor, wrong = potrf(covariance, lower=True, overwrite_a=True)
    half, _ = potri(factor, lower=True, overwrite_c=True)
    if wrong:
        raise np.linalg.LinAlgError("the covariance is not positive definite")
    lower: Array = np.tril(half)
    return lower + np.tril(half, -1).T


def _counts(one: ReadbackDifference) -> bool:
    return one.significance > _SIGNIFICANT[one.kind] and abs(one.size) > _LEAST[one.kind]


def _delay(
    knots: Increments, used: NDArray[np.int64], weights: list[Array], residuals: list[Array]
) -> list[ReadbackDifference]:
    """Return a delay beyond that of the windows before, if there is one."""
    score = information = 0.0
    for i, (weight, residual) in enumerate(zip(weights, residuals, strict=True)):
        changed = knots.rate[used, i]
        score += float(changed @ weight @ residual)
        information += float(changed @ weight @ changed)
    if information <= 0:
        return []
    one = ReadbackDifference(
        "delay", -1, float(knots.time[0]), float(knots.time[-1]),
        score / information, abs(score) / sqrt(information),
    )  # fmt: skip
    return [one] if _counts(one) else []
