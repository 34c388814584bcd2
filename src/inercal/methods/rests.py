"""Rests in unknown attitudes and the passages between them: residuals, and how they are correlated.

Three kinds of rows, for r rests and k passages::

    norms      0 − (‖f̂_i‖ − g)                                   one a rest
    rates      ȳ_i − h(f̂_i, C_i ω_e)                             three a rest
    rotations  across û_after: û_after − R û_before               two a passage

f̂ is what the accelerometers' mean readings say by the model. Their errors e_i enter the norm of
rest i and the rotations to and from it, so that neighbouring rotations are correlated. In the
order norm 1, rotation 1, norm 2, … the covariance is a band, and is whitened as one
(`inercal.methods.chain`).

What the stated noise does not explain has three sizes, `Scatter`: of a rest's accelerometer
readings, of its gyro readings (a bias that wanders also turns the passages), of a rotation.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.benches import Hand
from inercal.benches.hand import across
from inercal.frames import exp_so3, from_up
from inercal.methods.rotations import Rotations, rotations
from inercal.motion import Motion
from inercal.observe import Norm, norm
from inercal.recording import Observations, Passages
from inercal.sensors import Sensor
from inercal.units import Measured

Array = NDArray[np.float64]


class Scatter(NamedTuple):
    """Standard deviations beyond the stated noise: m/s² and rad/s of each axis, and rad."""

    force: float = 0.0
    rate: float = 0.0
    turn: float = 0.0


class Rows(NamedTuple):
    """All rows at one x = (c, g, ω_e)."""

    residual: Array  # (r + 2 k + 3 r or 0,): norms, rotations, rates
    jacobian: Array  # of the predictions to x
    norm: Norm
    turns: Rotations | None
    attitude: Array | None  # (r, 3, 3), from the level frame to the body's, where there are turns


@dataclass(frozen=True, eq=False)
class Rests:
    """The observations of one session, ready to be compared with a model.

    Parameters
    ----------
    observations : Observations
        Rows are rests, without a trial axis.
    sensor : Sensor
        Its accelerometers come before its gyros.
    bench : Hand
    """

    observations: Observations
    sensor: Sensor
    bench: Hand

    @cached_property
    def force(self) -> Sensor:
        """The accelerometers alone."""
        return self.sensor.only("f")

    @property
    def passages(self) -> Passages | None:
        """What lies between the rests, where there are gyros to follow it."""
        return self.observations.passages if len(self.sensor.axes) > self.m else None

    @property
    def m(self) -> int:
        """Number of accelerometer axes."""
        return len(self.force.axes)

    @cached_property
    def noise(self) -> Array:
        """Covariance of each rest's mean readings, (r, m, m): noise, and drift within the run."""
        drift = self.observations.drift
        if drift is None:
            return self.observations.covariance
        own = np.diagonal(drift, axis1=0, axis2=1).T - self.drift_of_mean
        return self.observations.covariance + np.eye(own.shape[1]) * np.maximum(own, 0.0)[:, None]

    @cached_property
    def drift_of_mean(self) -> Array:
        """Variance of each channel's drift that all rests share, (m,): it is part of the bias."""
        drift = self.observations.drift
        return np.zeros(len(self.sensor.axes)) if drift is None else drift.mean(axis=(0, 1))

    @cached_property
    def beside(self) -> tuple[Measured, ...]:
        """What is known of x beyond the coefficients: g, and the earth's rate in the level frame.

        The frame is east, north, up but for an unknown azimuth, so the level rate has two unknown
        components of known size.
        """
        declared = {parameter.name: parameter for parameter in self.bench.parameters}
        up, level = declared["earth_up"], declared["earth1"].sd
        return (
            self.bench.gravity,
            Measured(0.0, level),
            Measured(0.0, level),
            Measured(up.value, up.sd),
        )

    def start(self) -> Array:
        """Return x at the nominal sensor, (p + 4,)."""
        known = [quantity.value for quantity in self.beside]
        return np.concatenate([np.zeros(len(self.sensor.coefficients)), known])

    @cached_property
    def white(self) -> Array:
        """Covariance of one sample of the rates as far as it is white, (3, 3), (rad/s)²."""
        n = self.observations.samples
        return np.mean(self.observations.covariance * n[:, None, None], 0)[self.m :, self.m :]

    @cached_property
    def across(self) -> Array:
        """Two unit vectors across the nominal up of each rest, (r, 2, 3)."""
        ups = self.norms(self.start()).up
        return np.stack([across((float(x), float(y), float(z))) for x, y, z in ups])

    def norms(self, x: Array) -> Norm:
        """Return the norm rows at x, with derivatives to the accelerometers' c and g."""
        a, p = len(self.force.coefficients), len(self.sensor.coefficients)
        return norm(self.force, self.observations.mean[:, : self.m], x[:a], x[p])

    def rows(self, x: Array, attitude: Array | None = None) -> Rows:
        """Return all rows at x = (c, g, ω_e), (p + 4,).

        The attitudes in which the earth's rate is seen are found from x, unless they are given:
        held within a fit, the derivatives are exact.
        """
        at = self.norms(x)
        p, a = len(self.sensor.coefficients), len(self.force.coefficients)
        r = len(at.residual)
        jacobian = np.zeros((r, x.size))
        jacobian[:, :a], jacobian[:, p] = at.jacobian[:, :-1], at.jacobian[:, -1]
        if self.passages is None:
            return Rows(at.residual, jacobian, at, None, None)
        to_felt = np.zeros((r, 3, p))
        to_felt[..., :a] = at.by_coefficient
        turns = rotations(self.passages, self.sensor, x[:p], at.felt, self.across, self.white)
        to_level = self._attitudes(at, turns) if attitude is None else attitude
        before, after = self.passages.rest, self.passages.rest + 1
        of_turns = np.zeros((len(before), 2, x.size))
        of_turns[..., :p] = (
            turns.to_coefficient
            - turns.to_before @ to_felt[before]
            - turns.to_after @ to_felt[after]
        )
        # The rate holds the earth's, which turns the body not against gravity: ψ loses ω_e T.
        of_turns[..., p + 1 :] = (
            -turns.ahead @ to_level[after] * self.passages.duration[:, None, None]
        )
        moved = turns.residual - (of_turns[..., p + 1 :] @ x[p + 1 :])
        rates, of_rates = self._rates(x, at, to_felt, to_level)
        return Rows(
            np.concatenate([at.residual, moved.ravel(), rates.ravel()]),
            np.concatenate([jacobian, of_turns.reshape(-1, x.size), of_rates]),
            at,
            turns._replace(residual=moved),
            to_level,
        )

    def _attitudes(self, at: Norm, turns: Rotations) -> Array:
        """Return the rotation from the level frame to the body's at each rest, (r, 3, 3).

        The azimuth is carried along by the gyros; across a missing passage it is lost, and what is
        level there is taken as not seen.
        """
        assert self.passages is not None
        level = from_up(at.up)
        way = dict(zip(self.passages.rest.tolist(), turns.rotation, strict=True))
        known = np.ones(len(level))
        for k in range(1, len(level)):
            if k - 1 in way and known[k - 1]:
                # Up is taken from the accelerometers, so that only the azimuth drifts.
                azimuth = level[k].T @ way[k - 1] @ level[k - 1]
                angle = np.arctan2(azimuth[1, 0] - azimuth[0, 1], azimuth[0, 0] + azimuth[1, 1])
                level[k] = level[k] @ exp_so3([0.0, 0.0, float(angle)])
            else:
                known[k] = 0.0
        level[..., :2] *= known[:, None, None]
        return level

    def _rates(self, x: Array, at: Norm, to_felt: Array, to_level: Array) -> tuple[Array, Array]:
        """Return the gyros' residuals at rest, (r, 3), and their Jacobian, (3 r, p + 4)."""
        p = len(self.sensor.coefficients)
        motion = Motion(at.felt, (to_level @ x[p + 1 :, None])[..., 0])
        reading, design, slope = self.sensor.linearise(motion, x[:p])
        jacobian = np.zeros((*reading[:, self.m :].shape, x.size))
        jacobian[..., :p] = (design + slope[..., :3] @ to_felt)[:, self.m :]
        jacobian[..., p + 1 :] = (slope[..., 3:] @ to_level)[:, self.m :]
        return (self.observations.mean - reading)[:, self.m :], jacobian.reshape(-1, x.size)

    def rate_noise(self, scatter: Scatter) -> Array:
        """Return the covariance of the gyros' mean readings at each rest, (r, 3, 3)."""
        own = scatter.rate**2 * np.eye(len(self.sensor.axes) - self.m)
        return self.noise[:, self.m :, self.m :] + own

    def turn_noise(self, turns: Rotations, scatter: Scatter) -> Array:
        """Return the covariance of the rotations apart from that of the rests, (k, 2, 2)."""
        wander = scatter.rate**2 * turns.to_bias @ np.swapaxes(turns.to_bias, -1, -2)
        return turns.noise + wander + scatter.turn**2 * np.eye(2)
