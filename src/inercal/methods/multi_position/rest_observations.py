"""Compute residuals and correlations of rests in unknown attitudes, and of their transitions.

There are three kinds of rows, for r rests and k transitions::

    norms      0 − (‖f̂_i‖ − g)                                   one per rest
    rates      ȳ_i − h(f̂_i, C_i ω_e)                             three per rest
    rotations  across û_after: û_after − E R û_before               two per transition

f̂ is computed from the accelerometers' mean readings with the model. The errors of f̂ enter the
norm of the rest and the rotations before and after the rest, so neighbouring rotations are
correlated. In the order norm 1, rates 1, rotation 1, norm 2, … the covariance is a band matrix,
which is whitened as a whole (`inercal.methods.multi_position.row_whitening`).

The gyros' noise at a rest enters the rest's mean rate and the rotations before and after the rest.

Rows may scatter more than the noise of the samples predicts, or less if the samples contain hand
tremor. `Scatter` has a share and an excess (`inercal.estimation.residual_scatter`) for a rest's
accelerometer readings, for its gyro readings (a drift of the bias also turns the transitions), and
for a rotation.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.benches.hand.bench import tangent_vectors
from inercal.estimation.residual_scatter import ScatterModel
from inercal.methods import temperature
from inercal.methods.multi_position.rotations import (
    RotationResiduals,
    TransitionRotations,
    rotation_residuals,
    rotations_only,
    transition_rotations,
)
from inercal.methods.residuals import NormResiduals, norm_residuals
from inercal.physics.frames import attitude_from_vertical, exp_so3
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations, Transitions


class Scatter(NamedTuple):
    """Scatter of accelerometer readings (m/s²), gyro readings (rad/s) and rotations (rad)."""

    force: ScatterModel = ScatterModel()
    rate: ScatterModel = ScatterModel()
    turn: ScatterModel = ScatterModel()

    @property
    def shares(self) -> "Scatter":
        """Return the shares without the added noise."""
        return Scatter(*(ScatterModel(share=found.share) for found in self))


class ResidualRows(NamedTuple):
    """All rows at one x = (c, g, ω_e, τ, ε)."""

    residual: Array  # (r + 2 k + 3 r or 0,): norms, rotations, rates
    jacobian: Array  # of the predictions, with respect to x
    norm: NormResiduals
    rotations: RotationResiduals | None
    attitude: Array | None  # (r, 3, 3), from the level frame to the body's, if there are turns


def _ratio(part: Array, whole: Array) -> float:
    """Return the ratio of a part of a variance to the remaining variance."""
    beside = float(whole.sum() - part.sum())
    return float(part.sum()) / beside if beside > 0 else np.inf


@dataclass(frozen=True, eq=False)
class Rests:
    """The observations of one session, ready to be compared with a model.

    Parameters
    ----------
    observations : Observations
        Observations without a trial axis, whose rows are rests.
    sensor : Sensor
        A sensor whose accelerometers come before its gyros.
    bench : Hand
    """

    observations: Observations
    sensor: Sensor
    bench: Hand

    @cached_property
    def force(self) -> Sensor:
        """The sensor with only its accelerometers."""
        return self.sensor.select_axes("f")

    @cached_property
    def transitions(self) -> Transitions | None:
        """Transitions between the rests; None for a sensor without gyros."""
        way = self.observations.transitions
        return None if way is None or len(self.sensor.axes) == self.m else way.compact()

    @property
    def m(self) -> int:
        """Number of accelerometer axes."""
        return len(self.force.axes)

    @property
    def noise_is_stated(self) -> bool:
        """Whether the noise was stated, as in a table of means, and not estimated from samples."""
        return bool(np.isinf(self.observations.dof))

    @cached_property
    def temperature_offsets(self) -> Array:
        """ΔT of each rest, (r,) K; a scalar 0 if the sensor does not depend on temperature."""
        return temperature.row_offsets(self.observations, self.sensor)

    @cached_property
    def transition_temperature_offsets(self) -> Array | None:
        """ΔT of each sample in the transitions, (n,) K, or None if the sensor does not need it."""
        if not self.temperature_offsets.ndim:
            return None
        return self.recorded_transition_offsets

    @property
    def recorded_transition_offsets(self) -> Array | None:
        """ΔT of each sample in the transitions, even if the sensor does not depend on it."""
        seen, way = self.observations, self.transitions
        if way is None or seen.temperature is None:
            return None
        kelvin = way.temperature
        if kelvin is None:
            kelvin = np.interp(way.time, seen.time, seen.temperature)
        return kelvin - self.sensor.reference_temperature

    @cached_property
    def noise(self) -> Array:
        """Covariance of each rest's mean readings, (r, q, q), q channels: noise and drift."""
        drift = self.observations.drift
        if drift is None:
            return self.observations.covariance
        own = np.diagonal(drift, axis1=0, axis2=1).T - self.drift_of_mean
        return self.observations.covariance + np.eye(own.shape[1]) * np.maximum(own, 0.0)[:, None]

    @cached_property
    def drift_of_mean(self) -> Array:
        """Variance of each channel's drift that all rests share and that acts as a bias, (q,)."""
        drift = self.observations.drift
        return np.zeros(len(self.sensor.axes)) if drift is None else drift.mean(axis=(0, 1))

    @cached_property
    def rounding(self) -> Array:
        """Variance of each mean reading due to rounding, (r, q); it is part of `noise`."""
        found = self.observations.rounding
        if found is None:
            return np.zeros(self.noise.shape[:2])
        return found.variances[:, : self.noise.shape[1]]

    @cached_property
    def rounding_share(self) -> tuple[float, float, float]:
        """Ratio of rounding to other noise: accelerometers, gyros at rest, gyros in motion.

        Rounding can hide the motion of the hand, so no noise share may be smaller than this ratio.
        """
        if not self.rounding.any():
            return 0.0, 0.0, 0.0
        m, own = self.m, np.linalg.diagonal(self.noise).sum(axis=0)
        part = self.rounding.sum(axis=0)
        ratios = [_ratio(part[:m], own[:m]), _ratio(part[m:], own[m:])]
        if self.transitions is None:
            return ratios[0], 0.0, 0.0
        assert self.observations.rounding is not None
        white = self.observations.rounding.steps.variance[m:]
        return ratios[0], ratios[1], _ratio(white, np.diagonal(self.rate_noise))

    @cached_property
    def rate_rounding(self) -> Array:
        """Standard deviation of the rounding error that the rests' rates share, (3,) rad/s.

        Readings at rest contain the bias b plus a rounding error ε, but readings during turns only
        contain b. If ε were counted as bias, each turn would have an error of ε T.
        """
        found = self.observations.rounding
        if found is None or self.transitions is None:
            return np.zeros(3)
        r = len(found.covariance)
        return np.sqrt(found.shared[..., self.m :].sum(axis=(0, 1)) / max(r * (r - 1), 1))

    @cached_property
    def accelerometer_drift(self) -> Array:
        """The accelerometer drift that the rests cannot exclude, (2, r, m), or () if none.

        The drifts are linear and quadratic in time. Their size is one standard deviation of what
        the slopes within r rests of T seconds allow. The slope of one rest has the variance 12
        v/T², where v is the variance of its mean. Gravity lies along each of m axes in r/m of the
        rests. If the means have no times, their order is unknown. Stated slow noise is used as
        stated.
        """
        seen, noises = self.observations, [axis.noise for axis in self.force.axes]
        # With rests at several temperatures, drift cannot be separated from temperature terms.
        soaked = self.force.uses("dT") and seen.temperature_varies
        stated = any(one.bias_instability or one.random_walk for one in noises)
        if not seen.timed or soaked or stated:
            return np.zeros((0, len(seen.time), self.m))
        since: Array = seen.time - seen.time.mean()
        square = float(np.mean(since**2))
        own = np.linalg.diagonal(seen.covariance)[:, : self.m]
        of_slopes = self.m / np.sum(seen.duration[:, None] ** 2 / (12 * own), axis=0)
        courses = np.stack([since, 0.5 * (since**2 - square) / np.sqrt(square)])
        return courses[..., None] * np.sqrt(of_slopes)

    @cached_property
    def known_quantities(self) -> tuple[Measured, ...]:
        """Known quantities in x after the coefficients: g, the earth's rate, clock error τ, and ε.

        The earth's rate is in the level frame. This frame is east, north, up except for an unknown
        azimuth, so the level rate has two unknown components of known size.
        """
        declared = {parameter.name: parameter for parameter in self.bench.parameters}
        up, level = declared["earth_up"], declared["earth1"].sd
        return (
            self.bench.gravity,
            Measured(0.0, level),
            Measured(0.0, level),
            Measured(up.value, up.sd),
            Measured(self.bench.qualified.correction("timebase"), self.bench.timebase),
            *(Measured(0.0, sd) for sd in self.rate_rounding.tolist()),
        )

    def start(self) -> Array:
        """Return x for the nominal sensor, (p + 8,)."""
        known = [quantity.value for quantity in self.known_quantities]
        return np.concatenate([np.zeros(len(self.sensor.coefficients)), known])

    @cached_property
    def rate_noise(self) -> Array:
        """Covariance of the white part of one rate sample, (3, 3), (rad/s)²."""
        n, whole = self.observations.samples, self.observations.covariance
        rounding = self.observations.rounding
        if rounding is not None:
            whole = whole - self.rounding[:, :, None] * np.eye(self.rounding.shape[1])
        white = np.mean(whole * n[:, None, None], axis=0)[self.m :, self.m :]
        if rounding is not None:  # in motion, rounding errors are white
            white += np.diag(rounding.steps.variance[self.m :])
        return white

    @cached_property
    def cross_directions(self) -> Array:
        """Two unit vectors across each rest's nominal up, (r, 2, 3); they do not depend on c."""
        return tangent_vectors(self.norms(self.start()).up)

    def norms(self, x: Array) -> NormResiduals:
        """Return the norm rows at x, with their Jacobian for the accelerometers' c and g."""
        a, p = len(self.force.coefficients), len(self.sensor.coefficients)
        return self._cached_norms(x[:a].tobytes(), float(x[p]))

    @cached_property
    def _cached_norms(self) -> Callable[[bytes, float], NormResiduals]:
        """`norm_residuals` with a cache, because a gyro fit does not change the accelerometers."""
        mean = self.observations.mean[:, : self.m]

        @lru_cache(maxsize=2)
        def at(c: bytes, g: float) -> NormResiduals:
            return norm_residuals(
                self.force, mean, np.frombuffer(c), np.array([g]), dT=self.temperature_offsets
            )

        return at

    def rows(self, x: Array, started: ResidualRows | None = None) -> ResidualRows:
        """Return all rows at x = (c, g, ω_e, τ, ε), (p + 8,).

        The attitudes that the earth's rate needs, and the sensitivity of the rotations to rounding,
        are computed from x, or those at the start of a fit are used. Only then are the derivatives
        exact.
        """
        at = self.norms(x)
        p, a = len(self.sensor.coefficients), len(self.force.coefficients)
        r = len(at.residual)
        jacobian = np.zeros((r, x.size))
        jacobian[:, :a], jacobian[:, p] = at.jacobian[:, :-1], at.jacobian[:, -1]
        if self.transitions is None:
            return ResidualRows(at.residual, jacobian, at, None, None)
        motion_derivatives = np.zeros((r, 3, p))
        motion_derivatives[..., :a] = at.by_coefficient
        before, after = self.transitions.rest, self.transitions.rest + 1
        earth = slice(p + 1, p + 4)
        way = self._cached_rotations(x[:p].tobytes(), float(x[p + 4]))
        to_level = None if started is None else started.attitude
        to_level = self._attitudes(at, way) if to_level is None else to_level
        by_earth = to_level[after] * self.transitions.duration[:, None, None]
        turns = rotation_residuals(
            before, way, at.specific_force, self.cross_directions, by_earth @ x[earth]
        )
        of_turns = np.zeros((len(before), 2, x.size))
        of_turns[..., :p] = (
            turns.to_end_turn @ way.coefficient_derivatives
            - turns.to_before @ motion_derivatives[before]
            - turns.to_after @ motion_derivatives[after]
        )
        of_turns[..., earth] = turns.to_earth @ by_earth
        of_turns[..., p + 4] = turns.to_timebase
        rates, of_rates = self._rates(x, at, motion_derivatives, to_level)
        shared = slice(p + 5, p + 8)
        ramps = sum(self.ramp_sensitivities(turns))
        between = -turns.to_end_turn @ turns.way.to_bias - ramps
        of_turns[..., shared] = ramps + between * self._still_shares[:, None]
        if started is not None:
            of_turns[..., shared] = started.jacobian[r : -3 * r, shared].reshape(-1, 2, 3)
        of_rates[:, shared] = np.tile(np.eye(3), (r, 1))
        of_rounding = of_turns[..., shared] @ x[shared]
        return ResidualRows(
            np.concatenate(
                [at.residual, (turns.residual - of_rounding).ravel(), (rates - x[shared]).ravel()]
            ),
            np.concatenate([jacobian, of_turns.reshape(-1, x.size), of_rates]),
            at,
            turns,
            to_level,
        )

    @cached_property
    def _cached_rotations(self) -> Callable[[bytes, float], TransitionRotations]:
        """`transition_rotations` with a cache: a fit starts where the previous one ended."""
        assert self.transitions is not None
        transitions = self.transitions

        @lru_cache(maxsize=2)
        def at(c: bytes, timebase: float) -> TransitionRotations:
            warmth = self.transition_temperature_offsets
            coefficients = np.frombuffer(c)
            return transition_rotations(
                transitions, self.sensor, coefficients, self.rate_noise, timebase, warmth
            )

        return at

    def rotations_only(self, way: Transitions, c: Array, timebase: float) -> Array:
        """Return R, (k, 3, 3), for other readings, coefficients c, (p,), and a clock error."""
        warmth = self.transition_temperature_offsets
        return rotations_only(way, self.sensor, c, timebase, warmth)

    def _attitudes(self, at: NormResiduals, way: TransitionRotations) -> Array:
        """Return the rotation from the level frame to the body's at each rest, (r, 3, 3).

        The gyros propagate the azimuth. After a missing transition the azimuth is unknown, and the
        level part of the earth's rate is assumed to be zero.
        """
        assert self.transitions is not None
        level, before = attitude_from_vertical(at.up), self.transitions.rest
        # Up comes from the accelerometers, so only the azimuth drifts.
        turned = level[before + 1].mT @ way.rotation @ level[before]
        step = np.full(len(level), np.nan)
        step[0] = 0.0
        step[before + 1] = np.arctan2(
            turned[:, 1, 0] - turned[:, 0, 1], turned[:, 0, 0] + turned[:, 1, 1]
        )
        azimuth = np.cumsum(step)
        known = np.isfinite(azimuth)
        level = level @ exp_so3(np.where(known, azimuth, 0.0)[:, None] * [0.0, 0.0, 1.0])
        level[..., :2] *= known[:, None, None]
        return level

    def _rates(
        self, x: Array, at: NormResiduals, motion_derivatives: Array, to_level: Array
    ) -> tuple[Array, Array]:
        """Return the gyros' residuals at rest, (r, 3), and their Jacobian, (3 r, p + 8)."""
        p = len(self.sensor.coefficients)
        earth = slice(p + 1, p + 4)
        motion = Motion(
            at.specific_force, (to_level @ x[earth, None])[..., 0], dT=self.temperature_offsets
        )
        reading, design, slope = self.sensor.linearise(motion, x[:p])
        jacobian = np.zeros((*reading[:, self.m :].shape, x.size))
        jacobian[..., :p] = (design + slope[..., :3] @ motion_derivatives)[:, self.m :]
        jacobian[..., earth] = (slope[..., 3:] @ to_level)[:, self.m :]
        return (self.observations.mean - reading)[:, self.m :], jacobian.reshape(-1, x.size)

    @cached_property
    def _still_shares(self) -> Array:
        """Fraction of each transition in which a gyro reads the same as at rest, (k, 3).

        A gyro across the turn's axis does not sense the turn.
        """
        assert self.transitions is not None
        way, found = self.transitions, self.observations.rounding
        shares = np.zeros((len(way.rest), 3))
        if found is None:
            return shares
        scale = np.array([abs(axis.readout.scale) for axis in self.sensor.axes])[self.m :]
        at_rest = self.sensor.to_output(self.observations.mean)[:, self.m :]
        for k, (rest, start, stop) in enumerate(zip(way.rest, way.left, way.reached, strict=True)):
            off = way.output[start : stop + 1, self.m :] - at_rest[rest]
            shares[k] = found.steps.as_at_rest(off / scale, self.m).mean(axis=0)
        return shares

    def ramp_sensitivities(self, turns: RotationResiduals) -> tuple[Array, Array]:
        """Return the sensitivity of the rotations to a gyro offset on each ramp, (k, 2, 3)."""
        arriving = -turns.to_end_turn * self.ramps[turns.rest + 1, 0, None, None]
        leaving = -turns.to_end_turn @ turns.way.rotation * self.ramps[turns.rest, 1, None, None]
        return arriving, leaving

    def reading_covariance(self, scatter: Scatter) -> Array:
        """Return the covariance of the readings of each rest, (r, m + 12, m + 12) or (r, m, m).

        The order is: the accelerometers' means, the gyros' means, the gyros' integrals over the
        ramps at the end and start of the transitions (from the same samples, so they are
        correlated), and the offset that the gyros keep for the whole rest. Without transitions
        there are only the accelerometers' means.
        """
        m, r = self.m, len(self.noise)
        force, rate, turn = scatter
        whole = np.zeros((r, m + 12, m + 12))
        whole[:, :m, :m] = force.of(self.noise[:, :m, :m], self.rounding[:, :m])
        if self.transitions is None:
            return whole[:, :m, :m]
        n, lengths = self.observations.samples, self._ramp_samples
        step = self.observations.duration / n
        # Weights rise evenly along a ramp: sums of the weights, of their squares and products.
        both = np.maximum(lengths.sum(axis=1) - n, 0.0)
        product = np.maximum(lengths.prod(axis=1), 1.0)
        sums = np.zeros((r, 3, 3))
        sums[:, 0, 0] = 1 / n
        sums[:, 0, 1:] = sums[:, 1:, 0] = self.ramps / n[:, None]
        sums[:, [1, 2], [1, 2]] = self.ramps * step[:, None] * (2 / 3)
        sums[:, 1, 2] = sums[:, 2, 1] = step**2 * both**3 / (6 * product)
        common = min(rate.share, turn.share) / turn.share
        sums[:, 0] *= common
        sums[:, 1:, 0] *= common
        blocks = np.einsum("rij,ab->riajb", sums, turn.share * self.rate_noise)
        whole[:, m:-3, m:-3] = blocks.reshape(r, 9, 9)
        at_rest = ScatterModel(rate.share).of(self.noise[:, m:, m:], self.rounding[:, m:])
        whole[:, m : m + 3, m : m + 3] = at_rest
        whole[:, -3:, -3:] = rate.excess**2 * np.eye(3)
        return whole

    @property
    def ramps(self) -> Array:
        """Angle per unit of constant rate over the arrival and departure ramps, (r, 2) s."""
        step = self.observations.duration / self.observations.samples
        return 0.5 * self._ramp_samples * step[:, None]

    @cached_property
    def _ramp_samples(self) -> Array:
        """Number of samples in the arrival and departure ramps, (r, 2)."""
        assert self.transitions is not None
        way, ramps = self.transitions, np.zeros((len(self.noise), 2))
        ramps[way.rest + 1, 0] = way.stop - way.reached + 1
        ramps[way.rest, 1] = way.left - way.start + 1
        return ramps
