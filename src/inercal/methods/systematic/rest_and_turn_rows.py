"""Compute the residuals of rests and turns, with their Jacobian and covariance.

The unknowns are the coefficients θ, the lag τ and one attitude C_i per rest; the true attitude is
exp(ψ_i) C_i. The rows come from means over rest i and from navigation through turn i, which starts
at C_i::

    rest   ȳ_w − y_w(C_iᵀ ω_ie, C_iᵀ g e_up),   ȳ_f − y_f(C_iᵀ g e_up)
    turn   −log(C_i+1 C_predᵀ),   −v_pred

At the true values every row is zero except for noise. Gravity and the Earth's rate are known, the
IMU is stationary at rests, and the velocity from rest to rest is zero. No table angle is used.

If a bias drifts by d_s in segment s, the rows change by d_s times the bias's columns in this
segment. Drift with covariance K between segments therefore adds B K Bᵀ to the covariance of white
noise. K follows from the sensor's stated noise (`inercal.methods.turntable.drift`). Flicker is
counted relative to its mean over the run, which the estimated bias includes. Rounding errors act in
the same way; the rounding errors of a gyro that does not turn are common to rests and turns.

Gravity and latitude are parameters with the deviations that the bench states.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.methods.systematic.navigation import (
    ImuModel,
    Navigation,
    bias_name,
    earth_rate,
    earth_rate_slope,
    integrate_navigation,
)
from inercal.methods.systematic.segments import Segments
from inercal.methods.turntable.drift import covariance_of_means
from inercal.physics.frames import exp_so3, left_jacobian, log_so3, skew
from inercal.physics.motion import Motion

_UP = np.array([0.0, 0.0, 1.0])
_ROWS = 6  # per rest and per turn
_LEVEL = ("east", "north", "up")
TURN_UNITS = {
    f"{what} {way}": unit
    for what, unit in (("attitude", "rad"), ("velocity", "m/s"))
    for way in _LEVEL
}
"""The units of the quantities that a turn's rows observe."""


@dataclass(frozen=True, eq=False)
class RestAndTurnRows:
    """The rows for one recording.

    Parameters
    ----------
    segments : Segments
    model : ImuModel
    start : (m, 3, 3) array
        Reference C at each rest, which ψ is relative to.
    gravity, latitude : float
        Stated values, m/s² and rad.
    """

    segments: Segments
    model: ImuModel
    start: Array
    gravity: float
    latitude: float

    @property
    def count(self) -> int:
        """Number of coefficients, without the lag."""
        return len(self.model.sensor.coefficients)

    @property
    def rests(self) -> int:
        """Number of rests."""
        return len(self.segments.labels)

    @property
    def white(self) -> Array:
        """Squared noise densities with rounding, which is white in motion, (6,) SI²/Hz."""
        errors = self.segments.rounding
        if errors is None:
            return self.model.white
        return self.model.white + errors.steps.step**2 / 12 * self.segments.dt

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Names of the rows, such as "gx[p1]" or "velocity east[p1 to p2]"."""
        result: list[str] = []
        turns = (*self.segments.turn_labels, "")
        for rest, turn in zip(self.segments.labels, turns, strict=True):
            result += [f"{axis}[{rest}]" for axis in self.model.sensor.channels]
            if turn:
                result += [f"{quantity}[{turn}]" for quantity in TURN_UNITS]
        return tuple(result)

    def linearise(self, x: Array) -> tuple[Array, Array]:
        """Return residuals for 2 m − 1 segments, six each, and derivatives of the model.

        Parameters
        ----------
        x : (p + 3 + 3 m,) array
            Coefficients, lag, gravity, latitude, and ψ for each rest, SI.
        """
        p, m, at = self.count, self.rests, self._point(x)
        residual = np.zeros((2 * m - 1, _ROWS))
        jacobian = np.zeros((2 * m - 1, _ROWS, x.size))
        residual[::2], jacobian[::2] = self._rest_rows(at, x.size)
        residual[1::2], jacobian[1::2] = self._turn_rows(at, x.size)
        left = left_jacobian(at.psi)
        for k in range(m):
            own = slice(p + 3 + 3 * k, p + 6 + 3 * k)
            near = slice(max(2 * k - 1, 0), 2 * k + 2)
            jacobian[near, :, own] = jacobian[near, :, own] @ left[k]
        return residual.ravel(), jacobian.reshape(-1, x.size)

    def _point(self, x: Array) -> "_Point":
        psi = x[self.count + 3 :].reshape(self.rests, 3)
        lag, gravity, latitude = x[self.count : self.count + 3].tolist()
        attitudes = exp_so3(psi) @ self.start
        return _Point(x[: self.count], lag, gravity, latitude, psi, attitudes)

    def _navigate(self, at: "_Point") -> Navigation:
        motion = self.model.motion(self.segments, at.c, at.lag)
        biased = self.model.with_biases
        by = biased.sensitivities(self.segments, self.model.add_biases(at.c), motion)
        return integrate_navigation(
            self.segments, motion, at.attitudes[:-1], earth_rate(at.latitude), at.gravity, at.lag,
            by=by, white=self.white,
        )  # fmt: skip

    @cached_property
    def _columns(self) -> "_Columns":
        sensor, full = self.model.sensor, self.model.with_biases.sensor
        rates, forces = (full.select_axes(kind).coefficients for kind in ("w", "f"))
        own_rate, own_force = (sensor.select_axes(kind).coefficients for kind in ("w", "f"))
        place = {name: k for k, name in enumerate(sensor.coefficients)}
        shift = len(rates)
        return _Columns(
            [place[name] for name in own_rate],
            [place[name] for name in own_force],
            [rates.index(name) for name in own_rate],
            [shift + forces.index(name) for name in own_force],
            [rates.index(bias_name(axis)) for axis in full.axes if axis.measures == "w"],
            [shift + forces.index(bias_name(axis)) for axis in full.axes if axis.measures == "f"],
        )

    def _rest_rows(self, point: "_Point", width: int) -> tuple[Array, Array]:
        """Return residuals and derivatives for the means at rests."""
        p, m, sensor = self.count, self.rests, self.model.sensor
        c, _, gravity, latitude, _, attitudes = point
        back = attitudes.mT
        earth = earth_rate(latitude)
        f, w = gravity * back @ _UP, back @ earth
        at = sensor.linearise(Motion(f, w), c)
        slope = np.broadcast_to(at.slope, (m, _ROWS, _ROWS))
        jacobian = np.zeros((m, _ROWS, width))
        jacobian[:, :, :p] = at.design
        jacobian[:, :, p + 1] = (slope[:, :, :3] @ (back @ _UP)[..., None])[..., 0]
        by_latitude = (slope[:, :, 3:] @ (back @ earth_rate_slope(latitude))[..., None])[..., 0]
        jacobian[:, :, p + 2] = by_latitude
        turned = np.concatenate([back @ skew(gravity * _UP), back @ skew(earth)], axis=1)
        for k in range(m):
            jacobian[k, :, p + 3 + 3 * k : p + 6 + 3 * k] = slope[k] @ turned[k]
        return self.segments.mean - at.reading, jacobian

    def _turn_rows(self, point: "_Point", width: int) -> tuple[Array, Array]:
        """Return residuals and derivatives for turns: attitude, then velocity."""
        p, m = self.count, self.rests
        done, columns = self._navigate(point), self._columns
        _, _, gravity, latitude, _, attitudes = point
        seconds = self.segments.turn_seconds
        h = log_so3(attitudes[1:] @ done.attitude.mT)
        jacobian = np.zeros((m - 1, _ROWS, width))
        jacobian[:, :3, columns.rate] = -done.psi[:, :, columns.of_rate]
        jacobian[:, 3:, columns.rate] = done.v[:, :, columns.of_rate]
        jacobian[:, 3:, columns.force] = done.v[:, :, columns.of_force]
        jacobian[:, 3:, p] = done.v[:, :, -1]
        jacobian[:, 5, p + 1] = -seconds
        slope, earth = earth_rate_slope(latitude), earth_rate(latitude)
        jacobian[:, :3, p + 2] = seconds[:, None] * slope
        jacobian[:, 3:, p + 2] = 0.5 * gravity * seconds[:, None] ** 2 * np.cross(_UP, slope)
        back = exp_so3(-earth * seconds[:, None])
        # Because n rotates, ψ(t) = ψ − t ω_ie × ψ; the velocity has the Coriolis acceleration.
        turned = gravity * (0.5 * skew(_UP) @ skew(earth) + skew(earth) @ skew(_UP))
        for k in range(m - 1):
            at = p + 3 + 3 * k
            jacobian[k, :3, at : at + 3] = -back[k]
            jacobian[k, 3:, at : at + 3] = -skew(done.impulse[k]) + turned * seconds[k] ** 2
            jacobian[k, :3, at + 3 : at + 6] = np.eye(3)
        return -np.concatenate([h, done.velocity], axis=1), jacobian

    def covariance(self, x: Array) -> Array:
        """Return the covariance of the residuals at x, (6 (2 m − 1), 6 (2 m − 1))."""
        m = self.rests
        done, columns = self._navigate(self._point(x)), self._columns
        count = 2 * m - 1
        result = np.zeros((count, _ROWS, count, _ROWS))
        seconds = self.segments.rest_seconds
        for k in range(m):
            result[2 * k, :, 2 * k] = np.diag(self.white / seconds[k])
        # Noise rotates the predicted attitude by ψ and changes v; the residual contains +ψ and −v.
        sign = np.repeat([1.0, -1.0], 3)
        for k in range(m - 1):
            result[2 * k + 1, :, 2 * k + 1] = sign[:, None] * done.covariance[k] * sign
        by = np.zeros((count, _ROWS, _ROWS))  # sensitivity of each segment's residuals to drift
        by[::2] = np.eye(_ROWS)
        by[1::2, 3:, :3] = done.v[:, :, columns.force_bias]
        by[1::2, :3, 3:] = -done.psi[:, :, columns.rate_bias]
        by[1::2, 3:, 3:] = done.v[:, :, columns.rate_bias]
        drift = covariance_of_means(
            [axis.noise for axis in self.model.sensor.axes],
            self.segments.start,
            self.segments.stop,
            self.segments.run,
        )
        if self.segments.rounding is not None:
            drift = drift + self.segments.rounding.covariance
        result += np.einsum("sac,stc,tbc->satb", by, drift, by)
        result = result.reshape(count * _ROWS, -1)
        return 0.5 * (result + result.T)


class _Point(NamedTuple):
    """The values in the parameter vector x of the rows, SI."""

    c: Array
    lag: float
    gravity: float
    latitude: float
    psi: Array  # (m, 3)
    attitudes: Array  # (m, 3, 3)


class _Columns(NamedTuple):
    """Indices of columns: in x, in the sensitivities, and of the biases in the sensitivities."""

    rate: list[int]
    force: list[int]
    of_rate: list[int]
    of_force: list[int]
    rate_bias: list[int]
    force_bias: list[int]
