"""Whitened residuals and Jacobians: gyros during the whole recording, accelerometers at rest.

From one epoch to the next the gyros propagate the readback's attitude C_k. The error of the
readback is e_k = B_k β (the true attitude is exp [e_k×] C_k), and its noise is v_k, in the level
frame. E is the earth's rotation within an epoch. The difference at the next readback is::

    d_k+1 = −(e + v)_k+1 + E (e + v)_k − C M (∫ dε + dS ω + drift + noise)

In the sums z_k+1 = E z_k + d_k+1 the noise of the gyros is a random walk of φ and the noise of the
readback is white; `_kernels.whiten` decorrelates them. Each epoch starts from the table's attitude,
so terms of second order arise only within one epoch. An epoch lasts from the time of one readback
to the time of the next, between samples of the gyros (`rate_bends`). Interpolated angles would have
different noise, and would be wrong while the table accelerates.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import InputError
from inercal.basics.parameters import Parameter
from inercal.benches.turntable.attitude import earth_rate_level_frame as earth_rate
from inercal.benches.turntable.attitude import linear_misalignment, reference_attitude
from inercal.benches.turntable.bench import MAX_GAP_SECONDS, Turntable
from inercal.methods import temperature
from inercal.methods.residuals import vector_residuals
from inercal.methods.turntable import model, score_columns, strapdown
from inercal.methods.turntable.score_columns import ColumnInputs, ConstantColumn
from inercal.methods.turntable_trajectory import _kernels
from inercal.methods.turntable_trajectory._kernels import rate_bends
from inercal.physics.frames import log_so3, skew
from inercal.physics.motion import Motion
from inercal.recordings import STAMP_ROUNDING, Track

_AVERAGING_TIME = 1.0  # s of rest per mean


def parameters(bench: Turntable) -> tuple[Parameter, ...]:
    """Return the bench's parameters that are uncertain and affect a recording."""
    return tuple(q for q in bench.parameters if q.sd > 0 and not q.name.startswith("lever_"))


@dataclass(frozen=True, eq=False)
class RotationRows:
    """The gyros in one trial compared with the readback.

    Parameters
    ----------
    triad : TriadModel
    bench : Turntable
    table : tuple of q Parameter
        Nuisances, in the order of the columns.
    track : Track
    epochs : (e + 1,) array of int
        Samples at which the readback is taken.
    by : (e + 1, 3, q) array
        Rotation of the attitude by each nuisance, rad, level frame; zero for timing nuisances.
    """

    triad: model.TriadModel
    bench: Turntable
    table: tuple[Parameter, ...]
    track: Track
    epochs: Indices
    by: Array
    triad_name = "gyros"

    @classmethod
    def from_track(
        cls, part: model.TriadModel, bench: Turntable, track: Track, epochs: Indices | None = None
    ) -> "RotationRows":
        """Return the rows for one trial; by default there are ten epochs per second.

        Raises
        ------
        InputError
            The track is shorter than two epochs.
        """
        if epochs is None:
            usable = np.flatnonzero(np.isfinite(track.angle_variance(1.0)))
            time = track.time[usable]
            first = float(time[0]) if time.size else 0.0
            epochs = usable[strapdown.epoch_indices(time, model.EPOCH_PERIOD, first)]
            epochs = np.concatenate([usable[:1], epochs])
        if epochs.size < 2:
            raise InputError(
                f"the recording has {track.time.size} samples, less than two epochs of "
                f"{model.EPOCH_PERIOD:g} s; record longer"
            )
        table = parameters(bench)
        # The observed φ decreases as the true attitude gets ahead of the readback.
        by = -model.table_sensitivity(linear_misalignment(bench, track.angles[epochs]), table)
        return cls(part, bench, table, track, epochs, by)

    def whiten(
        self, theta: Array, q: Mapping[str, float], beside: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Return the whitened residual and Jacobian, (3 e, 1 + p + q + c), and estimated drift.

        The drift is the mean of each bias over the run, for the residual and for each column,
        (3, 1 + p + q + c), with its covariance, (3, 3).

        Parameters
        ----------
        theta : (p,) array
            Coefficients of the gyros.
        q : mapping of str to float
            The bench's parameters by name, SI.
        beside : (e, 3, c) array, optional
            Additional columns that are not whitened; see `omitted_columns`.
        """
        track, n = self.track, self.epochs.size - 1
        time = track.time[self.epochs]
        known = {one.name: one.value for one in self.bench.parameters} | dict(q)
        when = time - known["latency"] - known["clock"] * (time - track.time[0])
        # The table is at rest at the start and end of a recording.
        when = np.clip(when, track.time[0], track.time[-1])
        earth, p = earth_rate(self.bench), len(theta)
        end = 1 + p + len(self.table)
        result = np.zeros((n, 3, end + (0 if beside is None else beside.shape[2])))
        rotation_error, columns = np.zeros((n, 3)), np.zeros((n, 3, p))
        drifting, driven, shared = (np.zeros((k, 3, 3)) for k in (n, n, n + 1))
        _kernels.increments(
            track.time, self._rates, *self._bends, when, self._attitude, self.triad.terms,
            theta, earth, self.bench.gravity.value, self.triad.white,
            temperature.sample_offsets(track, self.triad.sensor),
            rotation_error, columns, drifting, driven, shared,
        )  # fmt: skip
        by = self._sensitivity_at_readbacks
        since = np.diff(when)
        within = skew(earth) @ by[:-1] * since[:, None, None]
        result[:, :, 1 : 1 + p] = columns
        result[:, :, 1 + p : end] = by[:-1] - within - by[1:]
        if beside is not None:
            result[:, :, end:] = beside
        result[:, :, 0] = rotation_error
        for k, one in enumerate(self.table):
            if one.name not in ("latency", "clock"):  # the reference includes these
                result[:, :, 0] -= result[:, :, 1 + p + k] * (q[one.name] - one.value)
        drift, variance = self.triad.drift, track.angle_variance(self.bench.white**2)
        lost = self._increments_across_gaps(when)
        # Next to a gap no sample belongs to two increments that are used.
        shared[:-1][lost] = shared[1:][lost] = 0.0
        readback = variance[self.epochs, None, None] * np.eye(3) - shared
        x, covariance = _kernels.whiten(
            since, result, drifting, driven, readback, drift, drift.covariance(), earth, lost
        )
        mean, variance = drift.mean(*self._elapsed)
        return (
            result.reshape(3 * n, -1), mean @ x, mean @ covariance @ mean.T + np.diag(variance)
        )  # fmt: skip

    @property
    def _elapsed(self) -> tuple[float, float]:
        """Return the duration of the track, and of its part after the last epoch, s."""
        end = float(self.track.time[-1])
        return end - float(self.track.time[0]), end - float(self.track.time[self.epochs[-1]])

    def omitted_columns(self, theta: Array) -> tuple[tuple[ConstantColumn, ...], Array]:
        """Return the columns of omitted terms, (e, 3, c), for `whiten`."""
        time, angles = self.track.time[self.epochs], self.track.angles[self.epochs]
        warmth = temperature.offsets_at_times(self.track, self.triad.sensor, time)
        found, first = score_columns.gyro_columns(
            ColumnInputs(self.triad, self.bench, theta, time, angles, warmth)
        )
        seen = np.concatenate([first[None], found.observed_effects])
        since = np.diff(time)[:, None, None]
        within = skew(earth_rate(self.bench)) @ seen[:-1] * since
        # φ is constant except for the earth's rotation.
        result = [found.driving_effects, seen[1:] - seen[:-1] + within]
        return found.columns, np.concatenate(result, axis=-1)

    @property
    def row_times(self) -> Array:
        """Times of the rows, (e,) s."""
        return self.track.time[self.epochs[1:]]

    @property
    def lost_rows(self) -> int:
        """Number of rows that are zero because their increments contain a gap."""
        time = self.track.time
        return 3 * int(np.count_nonzero(self._increments_across_gaps(time[self.epochs])))

    def _increments_across_gaps(self, when: Array) -> Bools:
        """Return which increments contain a gap that rates cannot bridge, (e,)."""
        time = self.track.time
        after = np.flatnonzero(np.diff(time) > MAX_GAP_SECONDS)
        begun = np.searchsorted(when[1:], time[after], side="right")
        ended = np.searchsorted(when[:-1], time[after + 1], side="left")
        result = np.zeros(when.size - 1, dtype=bool)
        for first, stop in zip(begun.tolist(), ended.tolist(), strict=True):
            result[first:stop] = True
        return result

    @cached_property
    def _rates(self) -> Array:
        """The readings, (n, 3) rad/s."""
        return np.ascontiguousarray(self.track.reading[:, self.triad.channels])

    @cached_property
    def _bends(self) -> tuple[Array, Array]:
        """The results of `rate_bends` that the increments need."""
        return rate_bends(self.track.time, self._rates, self.triad.white)

    @cached_property
    def _attitude(self) -> Array:
        """The attitude from the readback, (e + 1, 3, 3)."""
        return reference_attitude(self.bench, self.track.angles[self.epochs])

    @cached_property
    def _sensitivity_at_readbacks(self) -> Array:
        """Rotation of the attitude by all nuisances; timing acts through the table's rate."""
        names = [one.name for one in self.table]
        if not {"latency", "clock"} & set(names):
            return self.by
        track = self.track
        sides = [np.clip(self.epochs + side, 0, track.time.size - 1) for side in (-1, 1)]
        before, after = (reference_attitude(self.bench, track.angles[at]) for at in sides)
        lasting = track.time[sides[1]] - track.time[sides[0]]
        rate = log_so3(after @ before.mT) / lasting[:, None]
        since = track.time[self.epochs] - track.time[0]
        result = self.by.copy()
        for name, by in (("latency", np.ones_like(since)), ("clock", since)):
            if name in names:
                result[..., names.index(name)] = rate * by[:, None]
        return result


@dataclass(frozen=True, eq=False)
class StaticRows:
    """The accelerometers in one trial during holds, as means over about a second.

    Parameters
    ----------
    triad : TriadModel
    bench : Turntable
    table : tuple of q Parameter
        Nuisances, in the order of the columns.
    time_span : (float, float)
        Start and end of the track, s.
    time : (e,) array
        Midpoint of each mean, s.
    reading : (e, 3) array
        Mean readings, m/s².
    white : (e, 3) array
        Variance of each mean, (m/s²)².
    sensed_force : (e, 3) array
        Force from readback and declared gravity, m/s².
    by : (e, 3, q) array
        Sensitivity of this force to each nuisance.
    angles : (e, k) array
        Readback, rad.
    temperature_offset : (e,) array or None
        Temperature minus the sensor's reference temperature, K, if it was recorded.
    temperature_varies : bool
        Whether the temperature changes.
    """

    triad: model.TriadModel
    bench: Turntable
    table: tuple[Parameter, ...]
    time_span: tuple[float, float]
    time: Array
    reading: Array
    white: Array
    sensed_force: Array
    by: Array
    angles: Array
    temperature_offset: Array | None = None
    temperature_varies: bool = False
    triad_name = "accelerometers"
    lost_rows = 0

    @property
    def row_times(self) -> Array:
        """Times of the rows, (e,) s."""
        return self.time

    @classmethod
    def from_track(cls, part: model.TriadModel, bench: Turntable, track: Track) -> "StaticRows":
        """Return the rows for one trial.

        Raises
        ------
        InputError
            The track has no holds.
        """
        if not (track.hold >= 0).any():
            raise InputError(
                "the recording has no rest, but the accelerometers need one; hold the table "
                "still, or calibrate only the gyros",
                key="hold",
            )
        at = np.flatnonzero(track.hold >= 0)
        first = np.concatenate([[True], np.diff(track.hold[at]) != 0])
        begun = track.time[at][np.maximum.accumulate(np.where(first, np.arange(at.size), 0))]
        elapsed = track.time[at] - begun + STAMP_ROUNDING
        number = np.floor(elapsed / _AVERAGING_TIME)
        starts = np.flatnonzero(first | np.concatenate([[True], np.diff(number) != 0]))
        count = np.diff(np.concatenate([starts, [at.size]]))[:, None]
        time, angles, reading = (
            np.add.reduceat(values[at], starts, axis=0) / count
            for values in (track.time[:, None], track.angles, track.reading[:, part.channels])
        )
        step = float(np.median(np.diff(track.time)))
        table = parameters(bench)
        seen = linear_misalignment(bench, angles)
        back = reference_attitude(bench, angles).mT
        force = np.array([0.0, 0.0, bench.gravity.value])
        sensed = back @ force
        result, names = np.zeros((len(starts), 3, len(table))), [q.name for q in seen.parameters]
        for k, one in enumerate(table):
            if one.name == "g":
                result[..., k] = sensed / bench.gravity.value
            elif one.name in names:
                turned = np.cross(force, seen.by[..., names.index(one.name)])
                result[..., k] = (back @ turned[..., None])[..., 0]
        white = part.white / (count * step)
        run = float(track.time[0]), float(track.time[-1])
        warmth = track.temperature_offset(part.sensor.reference_temperature)
        if warmth is None:
            temperature.sample_offsets(track, part.sensor)  # rejects coefficients that need one
        else:
            warmth = np.add.reduceat(warmth[at], starts) / count[:, 0]
        return cls(
            part, bench, table, run, time[:, 0], reading, white, sensed, result, angles, warmth,
            track.temperature_varies,
        )  # fmt: skip

    def whiten(
        self, theta: Array, q: Mapping[str, float], beside: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Return whitened residual, Jacobian and the mean drift; as for `RotationRows`."""
        off = np.array([q[one.name] - one.value for one in self.table])
        motion = Motion(self.sensed_force + self.by @ off)
        if self.temperature_offset is not None:
            motion = replace(motion, dT=self.temperature_offset)
        residual, jacobian = vector_residuals(
            self.triad.sensor, self.reading, theta, motion, self.by, None
        )
        e = len(self.time)
        result = np.concatenate([residual[:, None], jacobian], axis=1).reshape(e, 3, -1)
        if beside is not None:
            result = np.concatenate([result, beside], axis=-1)
        result = np.ascontiguousarray(result)
        drift, (begun, end) = self.triad.drift, self.time_span
        x, covariance = _kernels.whiten_independent_axes(
            self.time, result, self.white, drift, drift.covariance(), begun
        )
        mean, variance = drift.mean(end - begun, end - float(self.time[-1]))
        return (
            result.reshape(3 * e, -1), mean @ x, mean @ covariance @ mean.T + np.diag(variance)
        )  # fmt: skip

    def omitted_columns(self, theta: Array) -> tuple[tuple[ConstantColumn, ...], Array]:
        """Return the columns of omitted terms, (e, 3, c), for `whiten`."""
        warmth = self.temperature_offset if self.temperature_varies else None
        epochs = ColumnInputs(self.triad, self.bench, theta, self.time, self.angles, warmth)
        return score_columns.static_mean_columns(epochs)


TriadRows = RotationRows | StaticRows
