"""Model the drift of the biases as states of a filter, and define a drifting bias.

Flicker with bias instability B, S(f) = B²/(2π f), is modelled as a sum of Gauss–Markov processes
with times τ_k = τ_1 r^(k−1) and variances B² ln r/π, because ∫ 2 τ/(1 + (2π f τ)²) d ln τ
= 1/(2 f). Both end processes also represent everything beyond them, so they have larger variances.
The Allan variance of the sum at T (IEEE Std 952, annex C)::

    σ_A²(T) = Σ_k σ_k² (2 x − 3 + 4 e^−x − e^−2x)/x²,  x = T/τ_k

equals that of flicker, (2 ln 2/π) B², within 10 % in variance from 1 s to the span. One time per
decade is enough: four states for each axis from 1 s to 10⁴ s. All runs of up to 10⁴ s (2.8 h) have
this span. The filter during a run, whose duration is not known yet, therefore has the same states
as the filter for its recording. Longer runs get one more state for each decade. A random walk is a
state that does not decay and starts at zero.

**The bias** is defined as the mean over the run, from the first to the last sample of the
recording, because flicker has no mean that a run could determine. If b is a filter's constant and D
are the flicker's states, the bias is b̄ = b + Σ ∫ D dt/T. The integral does not need a dense row in
Φ. Because dD = −D/τ dt + dβ::

    ∫ D dt = J − τ D,  dJ = τ dβ,  J begins at τ D

There is one J per axis for all its states. J is constant except for noise, which is correlated with
the noise of the states. A random walk is relative to the start of the run, as in simulations. A
Gauss–Markov drift with a stated correlation time has an ensemble mean. The bias is then this mean,
and there is no J.

The covariance of two means is a double integral of the drift's covariance C(u) at times u apart::

    cov = (G(d − a) + G(c − b) − G(d − b) − G(c − a))/((b − a)(d − c)),  G″ = C

over a to b and c to d. Flicker has C = −(B²/π) ln |u| plus a constant, which cancels in departures
from the mean over the run. A random walk K has C = K² (t + t′ − |u|)/2.
"""

from collections.abc import Callable, Sequence
from math import ceil, exp, inf, log, log10, pi
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.physics.sensors import Noise

MIN_FLICKER_SPAN = 1e4  # s, minimum span of the flicker's states
_SHORTEST_TIME, _LONGEST_TIME_SHARE = 0.8, 0.42  # shortest time, s; longest time over the span
# Relative to B² ln r/π: factor for all variances, and further factor for the two end processes
_VARIANCE_FACTOR, _END_VARIANCE_FACTOR = 0.98, 1.17
_PLACEHOLDER_TIME = 1.0  # s; for a drift with zero variance


class Drift(NamedTuple):
    """The drift of three biases; each is the sum of c components."""

    times: Array  # (c,) s; infinite for a random walk, the last one
    variance: Array  # (c, 3) SI², stationary; zero for a random walk
    walk: Array  # (3,) SI²/s, for the random walk
    mean_over_run: bool  # whether a bias is the mean over the run; if so, each axis has a J

    @property
    def size(self) -> int:
        """Number of states."""
        return 3 * (len(self.times) + self.mean_over_run)

    @property
    def varies(self) -> bool:
        """Whether biases drift at all."""
        return bool(self.variance.any() or self.walk.any())

    def names(self, axes: Sequence[str]) -> tuple[str, ...]:
        """Return the names of the states of three axes: components, then J."""
        if self.size == 3:
            return tuple(f"drift[{axis}]" for axis in axes)
        words = ["walk" if np.isinf(t) else str(k + 1) for k, t in enumerate(self.times)]
        words += ["noise"] if self.mean_over_run else []
        return tuple(f"drift[{axis}, {word}]" for word in words for axis in axes)

    def covariance(self) -> Array:
        """Return the covariance of the states at the start of a run, (s, s)."""
        c, result = len(self.times), np.zeros((self.size, self.size))
        finite = np.where(np.isinf(self.times), 0.0, self.times)
        for k in range(3):
            own = 3 * np.arange(c) + k
            result[own, own] = self.variance[:, k]
            if self.mean_over_run:
                j = 3 * c + k
                result[own, j] = result[j, own] = finite * self.variance[:, k]
                result[j, j] = finite**2 @ self.variance[:, k]
        return result

    def running_mean(self, states: Array, elapsed: Array) -> Array:
        """Return the flicker's mean since the start, (e, 3), from states (e, s) at e times, s."""
        if not self.mean_over_run:
            return np.zeros((len(elapsed), 3))
        c = len(self.times)
        each = states.reshape(len(states), c + 1, 3)
        decaying = np.where(np.isinf(self.times), 0.0, self.times)
        integral = each[:, c] - np.einsum("c,eck->ek", decaying, each[:, :c])
        begun = (elapsed > 0)[:, None]
        return np.where(begun, integral / np.where(begun, elapsed[:, None], 1.0), 0.0)

    def mean(self, elapsed: float, since: float = 0.0) -> tuple[Array, Array]:
        """Return the flicker's mean since the start, from the states, and its additional variance.

        Parameters
        ----------
        elapsed : float
            Time since the start, s, including `since`.
        since : float
            Time since the states were predicted, s.

        Returns
        -------
        rows : (3, s) array
            Sensitivity of each axis's mean to the states.
        variance : (3,) array
            Variance of the flicker since the states were predicted.
        """
        c, rows, variance = len(self.times), np.zeros((3, self.size)), np.zeros(3)
        if not self.mean_over_run or elapsed <= 0:
            return rows, variance
        # Numbers instead of arrays, because live filters call this for each piece of samples.
        mean, shape = [0.0] * c, [0.0] * c
        for n, time in enumerate(self.times.tolist()):
            if time != inf:
                left = exp(-since / time)
                mean[n] = -time * left / elapsed
                shape[n] = time**2 * (2 * since / time + 1 - left**2 - 4 * (1 - left))
        for k in range(3):
            rows[k, k : 3 * c : 3] = mean
            rows[k, 3 * c + k] = 1 / elapsed
        variance = np.array(shape) @ self.variance
        return rows, np.maximum(variance, 0.0) / max(elapsed, 1e-300) ** 2


def flicker_processes(bias_instability: float, span: float) -> tuple[Array, Array]:
    """Return times, s, and variances of Gauss–Markov processes that sum to flicker, (c,) each.

    Parameters
    ----------
    bias_instability : float
        B, in SI.
    span : float
        Longest averaging time, s; at least 1000 s. From 1 s to this time, the Allan deviation
        agrees with that of flicker within 7 %.
    """
    count = ceil(log10(max(span, 1e3)) - 1e-9)
    times = np.geomspace(_SHORTEST_TIME, _LONGEST_TIME_SHARE * max(span, 1e3), count)
    share = np.full(count, _VARIANCE_FACTOR * log(times[1] / times[0]) / pi)
    share[[0, -1]] *= _END_VARIANCE_FACTOR
    return times, bias_instability**2 * share


def drift_model(noises: Sequence[Noise], run_duration: float, name: str = "sensor") -> Drift:
    """Return the drift model for three biases.

    Parameters
    ----------
    noises : sequence of 3 Noise
    run_duration : float
        Duration of the run, s; it has no effect below 10⁴ s.
    name : str
        Name for messages.

    Raises
    ------
    InputError
        The axes have different correlation times.
    """
    correlation = np.array([one.correlation for one in noises])
    if np.ptp(correlation) > 0:
        raise InputError(
            f"{name}: the axes state different correlation times of the drift; state the same "
            "for all",
            key="correlation",
        )
    walk = np.array([one.random_walk**2 for one in noises])
    each = [one.bias_instability for one in noises]
    times, variance = np.zeros(0), np.zeros((0, 3))
    if any(each):
        if correlation[0]:
            times, variance = correlation[:1], np.square([each])
        else:
            span = MIN_FLICKER_SPAN * 10.0 ** max(
                ceil(log10(max(run_duration, 1.0) / MIN_FLICKER_SPAN)), 0
            )
            times, unit = flicker_processes(1.0, span)
            variance = unit[:, None] * np.square(each)
    if walk.any():
        times, variance = np.append(times, inf), np.concatenate([variance, np.zeros((1, 3))])
    if not times.size:
        return NO_DRIFT
    return Drift(times, variance, walk, mean_over_run=any(each) and not correlation[0])


NO_DRIFT = Drift(np.array([_PLACEHOLDER_TIME]), np.zeros((1, 3)), np.zeros(3), mean_over_run=False)
"""The drift model for biases that do not drift."""


def covariance_of_means(
    noises: Sequence[Noise], start: Array, stop: Array, run: tuple[float, float]
) -> Array:
    """Return the covariance of the means of m drifting biases over r time spans, (r, r, m).

    Flicker is relative to its mean over the run, a random walk to the start of the run.

    Parameters
    ----------
    noises : sequence of m Noise
    start, stop : (r,) arrays
        Start and end of the spans, s.
    run : (float, float)
        Start and end of the run, s.
    """
    begin, end = run
    a, b = np.append(start, begin), np.append(stop, end)
    spans, r = (b - a)[:, None] * (b - a), len(start)
    apart = [b - a[:, None], a - b[:, None], b - b[:, None], a - a[:, None]]

    def between(twice: Callable[[Array], Array]) -> Array:
        whole, gap, later, earlier = (twice(np.abs(u)) for u in apart)
        return (whole + gap - later - earlier) / spans

    length = end - begin
    flicker = between(lambda u: u**2 * (3 - 2 * np.log(np.maximum(u, 1e-300) / length)) / (4 * pi))
    middle = (start + stop) / 2 - begin
    walk = between(lambda u: -(u**3) / 12)[:r, :r] + (middle[:, None] + middle) / 2
    result = np.zeros((r, r, len(noises)))
    for k, one in enumerate(noises):
        variance, time = one.bias_instability**2, one.correlation
        if time:
            markov = between(lambda u: time**2 * np.exp(-u / time) + time * u)  # noqa: B023
            slow = variance * markov[:r, :r]
        else:
            slow = variance * (flicker - flicker[:, -1:] - flicker[-1:] + flicker[-1, -1])[:r, :r]
        result[..., k] = slow + one.random_walk**2 * walk
    return result
