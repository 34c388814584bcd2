"""Navigate through rests and turns by a Kalman filter, whose constant states are coefficients.

The filter processes a recording in chunks with a fixed number of epochs, so pieces of any length
give the same estimate. Every 0.2 s during a rest, the filter observes that the velocity is zero.
The constants have no dynamics, so their last filtered estimate is also the smoothed estimate. A
time gap within a rest is ignored, because the IMU is stationary.

The states are relative to a navigation with the initial coefficients, whatever the estimate. The
filter therefore solves a linear problem, and a further pass from the new coefficients is a
Gauss–Newton step.

Priors state what the filter knows before its first sample. Before the data, coefficients have
standard deviations of a tenth of their natural size (0.1 g, 10 %, 6°), many times larger than after
a recording. Gyro biases are found together with the azimuth. Their initial standard deviation is
half of the sum of the largest bias and the Earth's rate.

Source: Savage 2000, Strapdown Analytics, chapter 18; Huang, Mourikis and Roumeliotis 2010,
Observability-based rules for designing consistent EKF SLAM estimators (fixed linearisation).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import radians
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.benches.turntable.bench import StillTable
from inercal.estimation import FilterHistory, Gaussian
from inercal.estimation.innovations import StateEstimate
from inercal.methods import Priors
from inercal.methods.systematic import navigation
from inercal.methods.systematic._filter_kernel import FILTER_VECTORS, NAVIGATION, filter_epochs
from inercal.methods.systematic._kernels import NavigationSettings, TurnMotion
from inercal.methods.systematic.alignment import initial_attitudes
from inercal.methods.systematic.segments import Segments
from inercal.methods.turntable.drift import Drift, drift_model
from inercal.methods.turntable.drift_propagation import add_drift_cross_covariance, propagate_drift
from inercal.physics.quantities import INERTIAL
from inercal.physics.sensors import Sensor
from inercal.recordings import sample_count

EPOCH = 0.2  # s
LAG_SD = 0.05  # s, before the data
_SIZE = 0.1  # relative to a coefficient's natural size; also rad for the level
_BIAS_SHARE = 0.5  # of the sum of the largest gyro bias and the Earth's rate
_LARGEST_AZIMUTH = radians(30)
REST_VELOCITY = 1e-5  # m/s, standard deviation of the velocity of a table at rest
LIVE_CHUNK = 25  # number of epochs that are processed together
_MARGIN = 3  # samples on either side of a chunk, for derivatives


@dataclass(frozen=True, eq=False)
class FilterModel:
    """What a filter knows before its first sample.

    Parameters
    ----------
    sensor : Sensor
        Three accelerometers, then three gyros.
    known : StillTable
    priors : sequence of Gaussian
        Priors on coefficients.
    run_duration : float
        Duration of the run, s, which determines how slow the modelled drift can be.
    dt : float
        Sampling interval, s.
    means : bool
        Whether a sample is the mean of the reading over one period.
    """

    sensor: Sensor
    known: StillTable
    priors: Priors
    run_duration: float
    dt: float
    means: bool

    @cached_property
    def imu(self) -> navigation.ImuModel:
        """The model of the readings."""
        return navigation.ImuModel(self.sensor)

    @cached_property
    def drifts(self) -> tuple[Drift, Drift]:
        """The drift models of accelerometers and gyros."""
        force, rate = (
            drift_model(
                [axis.noise for axis in self.sensor.axes if axis.measures == kind],
                self.run_duration,
                self.sensor.name,
            )
            for kind in INERTIAL
        )
        return force, rate

    @property
    def count(self) -> int:
        """Number of samples in an epoch."""
        return max(1, sample_count(EPOCH, self.dt))


@dataclass(frozen=True, eq=False)
class FilterStart:
    """The start of a filter and its uncertainty.

    Parameters
    ----------
    attitude : (3, 3) array
        C, body to n, at the first sample.
    value : (p,) array
        Coefficients, SI.
    lag : float
        Lag of the accelerometers, s.
    sd : (p,) array
        Standard deviations of the coefficients, SI.
    attitude_sd : (3,) array
        Standard deviations about east, north and up, rad.
    rest_attitudes : (m, 3, 3) array
        C in the first m rests, if known beforehand.
    """

    attitude: Array
    value: Array
    lag: float
    sd: Array
    attitude_sd: Array
    rest_attitudes: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))


def filter_start(model: FilterModel, segments: Segments) -> FilterStart:
    """Return the start of a filter from the rests and turns at the beginning of its recording.

    Raises
    ------
    InputError
        The same as for `initial_attitudes`.
    """
    sensor, imu = model.sensor, model.imu
    latitude = model.known.latitude.value
    nominal = np.zeros(len(sensor.coefficients))
    attitudes, c = initial_attitudes(segments, imu, nominal, latitude)
    earth = navigation.earth_rate(latitude)
    biases = [navigation.bias_name(axis) for axis in sensor.axes if axis.measures == "w"]
    values = zip(sensor.coefficients, c.tolist(), strict=True)
    largest = max((abs(value) for name, value in values if name in biases), default=0.0)
    bias = _BIAS_SHARE * (float(np.linalg.norm(earth)) + largest)
    sd = _SIZE * sensor.unit_scale
    for k, name in enumerate(sensor.coefficients):
        if name in biases:
            sd[k] = bias
    for prior in model.priors:  # the stated uncertainty counts, not the usual size of errors
        at = [sensor.coefficients.index(name) for name in prior.names]
        sd[at] = np.maximum(sd[at], 10 * np.sqrt(np.diagonal(prior.covariance)))
    azimuth = min(bias / float(earth[1]), _LARGEST_AZIMUTH)
    return FilterStart(attitudes[0], c, 0.0, sd, np.array([_SIZE, _SIZE, azimuth]))


class NavigationFilter:
    """The filter for one recording.

    Parameters
    ----------
    model : FilterModel
    start : FilterStart
    chunk : int
        Number of epochs that are processed together.
    keeps_history : bool
        Whether to store the data for `history`.

    Attributes
    ----------
    nis : float
        Sum of the normalised innovations squared.
    components : int
        Number of innovation components in this sum.
    """

    def __init__(
        self,
        model: FilterModel,
        start: FilterStart,
        chunk: int = LIVE_CHUNK,
        *,
        keeps_history: bool = False,
    ):
        self.model = model
        known, p = model.known, len(model.sensor.coefficients)
        self._first = NAVIGATION + p + 3  # index of the first drift state
        self._chunk = chunk
        self._keeps_history, self._history = keeps_history, list[_Chunk]()
        self.nis, self.components, self._fed = 0.0, 0, 0
        self._at = np.array([*start.value, start.lag, known.gravity.value, known.latitude.value])
        drifts = model.drifts
        n = self._first + sum(drift.size for drift in drifts)
        self._x, self._p = np.zeros(n), np.zeros((n, n))
        rest = [LAG_SD, known.gravity.sd, known.latitude.sd]
        sd = [*start.attitude_sd, *np.full(3, REST_VELOCITY), *start.sd, *rest]
        np.fill_diagonal(self._p, np.square([*sd, *np.zeros(n - self._first)]))
        at = self._first
        for drift in drifts:
            self._p[at : at + drift.size, at : at + drift.size] = drift.covariance()
            at += drift.size
        self._keep, self._drawn = _drift_steps(drifts, model.count * model.dt)
        self._c, self._v = start.attitude.copy(), np.zeros(3)
        self._before = np.zeros((2, 3))
        self._rest_attitudes = start.rest_attitudes
        self._present: Indices = np.full(1, -1, dtype=np.int64)
        self._hold, self._rest = -1, -1  # index of the last hold, and of the last rest
        self._waiting, self._holds = np.zeros((0, 6)), np.zeros(0, dtype=np.int64)
        for prior in model.priors:
            self._use_prior(prior)

    def _use_prior(self, prior: Gaussian) -> None:
        names = self.model.sensor.coefficients
        at = [NAVIGATION + names.index(name) for name in prior.names]
        off = prior.mean - self._at[[k - NAVIGATION for k in at]] - self._x[at]
        cross = self._p[:, at]
        gain = np.linalg.solve(cross[at] + prior.covariance, cross.T).T
        self._x += gain @ off
        self._p -= gain @ cross.T

    def feed(self, reading: Array, still: Indices) -> None:
        """Process the next samples.

        Parameters
        ----------
        reading : (n, 6) array
            Readings, SI.
        still : (n,) array of int
            Index of the rest that contains each sample; −1 in motion.
        """
        self._waiting = np.concatenate([self._waiting, reading])
        self._holds = np.concatenate([self._holds, still])
        count = self.model.count
        while True:
            led = min(self._fed, _MARGIN)  # number of earlier samples that are still stored
            if len(self._waiting) < led + self._chunk * count + _MARGIN:
                return
            self._follow(led, self._chunk)

    def finish(self) -> None:
        """Process the remaining epochs; no samples may be fed afterwards."""
        led = min(self._fed, _MARGIN)
        left = (len(self._waiting) - led) // self.model.count
        if left:
            self._follow(led, left)

    def _follow(self, led: int, epochs: int) -> None:
        model, p = self.model, len(self.model.sensor.coefficients)
        c, (lag, gravity, latitude) = self._at[:p], self._at[p:].tolist()
        n = epochs * model.count
        own = slice(led, led + n)
        motion = model.imu.motion_of_readings(
            self._waiting[: led + n + _MARGIN], model.dt, c, lag, means=model.means
        )
        motion = TurnMotion(*(np.ascontiguousarray(part[own]) for part in motion))
        rest = self._number_rests(self._holds[own].reshape(epochs, model.count))
        means = navigation.block_means(motion, np.arange(0, n, model.count, dtype=np.int64))
        by_rate, by_force = self._effects(c, _with_steady_rests(means, rest))
        size = self._x.size
        innovation, standard, nis = np.zeros((epochs, 3)), np.zeros((epochs, 3)), np.zeros(epochs)
        filter_epochs(
            motion, by_rate, by_force, rest, self._rest_attitudes, self._present, model.count,
            self._fed == 0,
            NavigationSettings(navigation.earth_rate(latitude), gravity, lag, model.dt),
            navigation.earth_rate_slope(latitude), model.imu.white, REST_VELOCITY**2, self._keep,
            self._drawn, self._x, self._p, self._c, self._v, self._before,
            np.zeros((FILTER_VECTORS, 3)), np.zeros((4, 3, 3)), np.zeros((16, size)),
            innovation, standard, nis,
        )  # fmt: skip
        if self._keeps_history:
            found = self.estimate()
            ends: Array = (self._fed + model.count * np.arange(1.0, epochs + 1)) * model.dt
            kept = rest >= 0
            self._history.append(
                _Chunk(
                    ends[kept], rest[kept], innovation[kept], standard[kept], nis[kept],
                    found.value, np.sqrt(np.diagonal(found.covariance)),
                )
            )  # fmt: skip
        self.nis += float(nis.sum())
        self.components += 3 * int((rest >= 0).sum())
        self._fed += n
        kept = max(led + n - _MARGIN, 0)
        self._waiting, self._holds = self._waiting[kept:], self._holds[kept:]

    def _number_rests(self, holds: Indices) -> Indices:
        """Return the index of the rest that contains each epoch, or −1 in motion."""
        still = (holds[:, 0] >= 0) & (holds == holds[:, :1]).all(axis=1)
        result = np.full(len(holds), -1, dtype=np.int64)
        for e in np.flatnonzero(still).tolist():
            if holds[e, 0] != self._hold:
                self._hold = int(holds[e, 0])
                self._rest += 1
            result[e] = self._rest
        return result

    def _effects(self, c: Array, means: TurnMotion) -> tuple[Array, Array]:
        """Return the sensitivity of ω and f per epoch to the states after ψ and v, (e, 3, q)."""
        imu, names = self.model.imu, self.model.sensor.coefficients
        full = imu.with_biases.sensor
        rate, force = imu.with_biases.sensitivities_at(imu.add_biases(c), means)
        q, edges = self._x.size - NAVIGATION, len(means.w)
        result = {kind: np.zeros((edges, 3, q)) for kind in INERTIAL}
        at = self._first - NAVIGATION
        for kind, by, drift in zip(INERTIAL, (force, rate), self.model.drifts, strict=True):
            part = full.select_axes(kind)
            own = [names.index(name) for name in part.coefficients if name in names]
            result[kind][..., own] = by[
                ..., [k for k, n in enumerate(part.coefficients) if n in names]
            ]
            biases = [part.coefficients.index(navigation.bias_name(axis)) for axis in part.axes]
            for k in range(len(drift.times)):
                result[kind][..., at + 3 * k : at + 3 * k + 3] = by[..., biases]
            at += drift.size
        return result["w"], result["f"]

    def estimate(self) -> StateEstimate:
        """Return the coefficients, the lag, gravity and latitude, SI.

        Biases are means over the run so far.
        """
        count = self._first - NAVIGATION
        to_mean = np.eye(count, self._x.size - NAVIGATION)
        further = np.zeros(count)
        names, at = self.model.sensor.coefficients, count
        elapsed = self._fed * self.model.dt
        for kind, drift in zip(INERTIAL, self.model.drifts, strict=True):
            rows, variance = drift.mean(elapsed)
            axes = [axis for axis in self.model.sensor.axes if axis.measures == kind]
            for k, axis in enumerate(axes):
                name = navigation.bias_name(axis)
                if name in names:
                    to_mean[names.index(name), at : at + drift.size] = rows[k]
                    further[names.index(name)] = variance[k]
            at += drift.size
        covariance = to_mean @ self._p[NAVIGATION:, NAVIGATION:] @ to_mean.T
        return StateEstimate(
            self._at + to_mean @ self._x[NAVIGATION:], covariance + np.diag(further)
        )

    def standardised_innovations(self) -> tuple[Array, Indices]:
        """Return standardised innovations, (e, 3), and the rest that each belongs to, (e,)."""
        standard = np.concatenate([np.zeros((0, 3)), *(one.standard for one in self._history)])
        none = np.zeros(0, dtype=np.int64)
        return standard, np.concatenate([none, *(one.rest for one in self._history)])

    def history(self) -> FilterHistory:
        """Return the estimates after each chunk that ends after the start of a rest."""
        kept = [one for one in self._history if one.time.size]
        names = (*self.model.sensor.coefficients, "lag", "g", "latitude")
        counts = np.cumsum([one.time.size for one in kept], dtype=np.int64)
        return FilterHistory(
            "navigation",
            names,
            np.concatenate([np.zeros(0), *(one.time for one in kept)]),
            np.array([one.value for one in kept]).reshape(-1, len(names)),
            np.array([one.std for one in kept]).reshape(-1, len(names)),
            np.concatenate([np.zeros((0, 3)), *(one.innovation for one in kept)]),
            np.concatenate([np.zeros(0), *(one.nis for one in kept)]),
            shown=counts - 1,
        )


class _Chunk(NamedTuple):
    """The filter's results for the rests in a chunk, and its estimate afterwards."""

    time: Array
    rest: Indices
    innovation: Array
    standard: Array
    nis: Array
    value: Array
    std: Array


def _with_steady_rests(means: TurnMotion, rest: Indices) -> TurnMotion:
    """Return epoch means that are constant during each rest, with no change of rate.

    Otherwise noise in a sensitivity would count as an observation of the coefficient.
    """
    w, f, dw = (part.copy() for part in means)
    for k in np.unique(rest[rest >= 0]):
        own = rest == k
        w[own], f[own], dw[own] = w[own].mean(axis=0), f[own].mean(axis=0), 0.0
    return TurnMotion(w, f, dw)


def _drift_steps(drifts: Sequence[Drift], seconds: float) -> tuple[Array, Array]:
    """Return the transition factors of the drift states for an epoch, (d,), and noise, (d, d)."""
    d = sum(drift.size for drift in drifts)
    keep, drawn, at = np.ones(d), np.zeros((d, d)), 0
    for drift in drifts:
        own = slice(at, at + drift.size)
        diagonal, joint = np.zeros(drift.size), np.zeros((len(drift.times), 3))
        part = np.ones(drift.size)
        propagate_drift(drift, seconds, 0, part, diagonal, joint)
        noise = np.diag(diagonal)
        add_drift_cross_covariance(drift, 0, joint, noise)
        keep[own], drawn[own, own] = part, noise
        at += drift.size
    return keep, drawn
