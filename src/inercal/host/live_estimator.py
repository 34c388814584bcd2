"""Live estimation: during a run, the sequential estimator of the method processes samples.

`Navigator` computes attitude and velocity only from the corrected readings, for a comparison with
the table. The level frame is east, north, up, and C transforms vectors from the body frame to the
level frame. Between samples, it uses the means of adjacent readings with the second-order coning
term, like the gyro filter. At the first sample of each hold and after a gap, it starts again from
the attitude and velocity of the table. The velocity stays zero during a hold. While the table
turns, the difference from the table includes the latency of the readback.
"""

from collections.abc import Mapping
from functools import partial

# Numba's decorator is not typed.
# pyright: reportUntypedFunctionDecorator=false
from math import asin, atan2, degrees, nan
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.benches.turntable.attitude import earth_rate_level_frame, reference_attitude
from inercal.benches.turntable.bench import MAX_GAP_SECONDS, Turntable
from inercal.estimation.kernel_options import njit
from inercal.host.assembly import SampleBlock
from inercal.host.tasks import required_rate
from inercal.methods import METHODS, PartialEstimate
from inercal.methods.turntable.model import ARCSEC
from inercal.methods.turntable.small_matrices import copy_matrix
from inercal.methods.turntable.strapdown import rotate, rotation_error
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.inverse import inverse
from inercal.recordings import Track
from inercal.runfile import Run


class LiveEstimator:
    """The live estimate of an active run.

    Parameters
    ----------
    run : Run
        A run whose method has a sequential estimator.

    Attributes
    ----------
    names : tuple of p str
        Names of the coefficients, in the sensor's order.
    time : float
        Time of the last sample in the recording, s; NaN before the first.
    partial_estimates : mapping of str to PartialEstimate
        Estimates for each part of the sensor, "f" and "w" or "all"; empty before the estimator
        begins.
    values, std : (p,) arrays
        The coefficients and their standard deviations, SI; NaN if there is no estimate yet.

    Raises
    ------
    InputError
        The method has no sequential estimator, the sampling rate is missing, or the estimator
        refuses the run.
    """

    def __init__(self, run: Run):
        begin = run.method.sequential
        if begin is None:
            able = [name for name, one in METHODS.items() if one.sequential is not None]
            raise InputError(
                f"[method] name: {run.method.name} cannot estimate during a run; "
                f"possible: {', '.join(able)}",
                key="[method] name",
                names=(run.method.name,),
            ).located(run.path)
        rate_hz = required_rate(run)
        self.names, self.time = run.sensor.coefficients, nan
        # Keyed by the names of the coefficients of a part.
        self._indices: dict[tuple[str, ...], list[int]] = {}
        self._start_estimator = partial(
            begin, run.estimator, run.sensor, run.bench, run.steps, run.priors, rate_hz
        )
        self._sequential = self._start_estimator()
        self._store_estimates({})

    @property
    def has_estimate(self) -> bool:
        """Whether there is an estimate yet."""
        return bool(self.partial_estimates)

    @property
    def innovations(self) -> dict[str, tuple[float, int]]:
        """The sum of the normalised squared innovations and their number, for each part."""
        return {part: (one.nis, one.components) for part, one in self.partial_estimates.items()}

    def feed(self, block: SampleBlock) -> None:
        """Process the next samples.

        Raises
        ------
        InputError
            The estimator cannot process the samples.
        """
        if block.starts_recording:
            self._sequential = self._start_estimator()
        self.time = float(block.time[-1])
        self._sequential.feed(block.estimator_track)
        self._store_estimates(self._sequential.estimate())

    def _store_estimates(self, found: Mapping[str, PartialEstimate]) -> None:
        self.partial_estimates = dict(found)
        self.values, self.std = np.full((2, len(self.names)), nan)
        for one in self.partial_estimates.values():
            if one.names not in self._indices:
                self._indices[one.names] = [self.names.index(name) for name in one.names]
            at = self._indices[one.names]
            self.values[at] = one.value
            self.std[at] = np.sqrt(np.diagonal(one.covariance))


def is_whole_imu(sensor: Sensor) -> bool:
    """Return whether a sensor has accelerometer and gyro triads, as `Navigator` requires."""
    return all(len(sensor.select_axes(kind).axes) == 3 for kind in ("f", "w"))


class NavigationSolution(NamedTuple):
    """The body's attitude and velocity at one sample, computed from the readings.

    Parameters
    ----------
    time : float
        Time in the recording, s, of this sample.
    attitude : (3, 3) array
        C, the rotation from the body frame to the level frame.
    roll, pitch, heading : float
        Angles in degrees: heading of the body's y axis clockwise from north, pitch of this axis
        upward, and roll about it.
    velocity : (3,) array
        Velocity in the directions east, north and up, m/s, starting from 0 at the last hold.
    rotation_error : (3,) array
        Rotation about east, north and up from the computed attitude to the table's attitude, ″.
    is_hold : bool
    """

    time: float
    attitude: Array
    roll: float
    pitch: float
    heading: float
    velocity: Array
    rotation_error: Array
    is_hold: bool


class Navigator:
    """Computes attitude and velocity of the body from the readings of an IMU on a table.

    Parameters
    ----------
    sensor : Sensor
        A sensor with accelerometer and gyro triads.
    bench : Turntable
    """

    def __init__(self, sensor: Sensor, bench: Turntable):
        self._sensor, self._bench = sensor, bench
        self._earth, self._gravity = earth_rate_level_frame(bench), bench.gravity.value
        self._c, self._v = np.eye(3), np.zeros(3)
        self._last_motion = np.zeros((2, 3))  # f and ω of the previous sample
        self._time, self._last_hold = -np.inf, -1

    def feed(self, track: Track, values: Array) -> NavigationSolution:
        """Process the next samples and return the navigation solution at the last of them.

        Parameters
        ----------
        track : Track
            At least one sample, all from one trial.
        values : (p,) array
            Coefficients of the sensor, SI, with which the readings are corrected.
        """
        sensed = inverse(self._sensor, track.reading, values)
        f, w = np.ascontiguousarray(sensed.f), np.ascontiguousarray(sensed.w)
        before = np.concatenate([[self._time], track.time[:-1]])
        held = np.concatenate([[self._last_hold], track.hold[:-1]])
        gap = track.time - before > MAX_GAP_SECONDS
        anew = np.flatnonzero(gap | ((track.hold >= 0) & (track.hold != held)))
        aligned = reference_attitude(self._bench, track.angles[anew])
        _integrate_samples(
            track.time, f, w, track.hold, anew, aligned, self._time,
            self._last_motion, self._c, self._v, self._earth, self._gravity,
        )  # fmt: skip
        self._last_motion = np.stack([f[-1], w[-1]])
        self._time, self._last_hold = float(track.time[-1]), int(track.hold[-1])
        off = np.empty(3)
        rotation_error(reference_attitude(self._bench, track.angles[-1:])[0], self._c, off)
        c = self._c.copy()
        return NavigationSolution(
            self._time,
            c,
            degrees(atan2(-c[2, 0], c[2, 2])),
            degrees(asin(min(max(c[2, 1], -1.0), 1.0))),
            degrees(atan2(c[0, 1], c[1, 1])) % 360.0,
            self._v.copy(),
            off / ARCSEC,
            self._last_hold >= 0,
        )


@njit(cache=True, nogil=True, error_model="numpy")
def _integrate_samples(
    time: Array,
    f: Array,
    w: Array,
    hold: Indices,
    anew: Indices,
    aligned: Array,
    now: float,
    sensed: Array,
    c: Array,
    v: Array,
    earth: Array,
    gravity: float,
) -> None:
    """Propagate C and the velocity in place; at the samples `anew`, C is set to `aligned`."""
    turn, half = np.empty(3), np.empty((3, 3))
    wanted = 0
    for i in range(time.size):
        if wanted < anew.size and anew[wanted] == i:
            copy_matrix(aligned[wanted], c)
            v[:] = 0.0
            wanted += 1
        else:
            f0 = sensed[0] if i == 0 else f[i - 1]
            w0 = sensed[1] if i == 0 else w[i - 1]
            dt = time[i] - now
            for k in range(3):
                a, b = (k + 1) % 3, (k + 2) % 3
                around = c[0, k] * earth[0] + c[1, k] * earth[1] + c[2, k] * earth[2]
                coning = w0[a] * w[i, b] - w0[b] * w[i, a]
                turn[k] = (0.5 * (w0[k] + w[i, k]) - around) * dt + coning * dt * dt / 12
            copy_matrix(c, half)
            rotate(half, 0.5 * turn)
            rotate(c, turn)
            for k in range(3):
                v[k] -= gravity * dt if k == 2 else 0.0
                for j in range(3):
                    v[k] += half[k, j] * 0.5 * (f0[j] + f[i, j]) * dt
            if hold[i] >= 0:
                v[:] = 0.0
        now = time[i]
