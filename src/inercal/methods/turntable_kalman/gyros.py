"""The gyro filter compares the attitude from the gyros with that from the table's readback.

States: φ (3), coefficients, drift of the biases (`turntable.drift`), and errors of the table's
attitude (latency, clock, right angles, harmonics of the readback). The attitude is integrated from
the corrected rates and compared with the readback at every epoch. Estimates are fed back.

A readback may be earlier or later than the IMU sample. The earlier of the two waits for the other,
so each readback is compared with an attitude between samples. The age of that attitude is at most 8
standard deviations of the latency.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import ClassVar, Literal

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.benches.turntable.attitude import linear_misalignment, reference_attitude
from inercal.benches.turntable.bench import MAX_GAP_SECONDS, Turntable
from inercal.methods import Priors
from inercal.methods.turntable import model, strapdown
from inercal.methods.turntable.model import ARCSEC, table_sensitivity
from inercal.methods.turntable_kalman import _gyros
from inercal.methods.turntable_kalman._filter_steps import FilterSamples
from inercal.methods.turntable_kalman._readback import (
    AttitudeReadback,
    AttitudeSettings,
    AttitudeState,
)
from inercal.methods.turntable_kalman.filter import TILT, Filter
from inercal.methods.turntable_kalman.filtered_track import FilterPiece
from inercal.physics.sensors import Sensor
from inercal.recordings import STAMP_ROUNDING, Track

_LATENCY_COVERAGE = 4.0  # standard deviations
# s; the effect of a more uncertain delay is not of first order while the table accelerates.
_MAX_LATENCY_SPAN = 0.1
# Additional samples in the ring buffer: two at either end for a cubic, and uneven steps
_SPARE_SAMPLES = 8
_DURATION_FACTOR, _PAUSE_ALLOWANCE = 2.0, 600.0  # factor on the planned duration, and s, for pauses
_TIMING_PARAMETERS = ("latency", "clock", "azimuth")
ALIGNMENT_SD = 60 * ARCSEC  # sd of φ when the attitude is taken from the table


@dataclass(frozen=True, eq=False)
class GyroFilter(Filter[AttitudeState]):
    """The filter for one sensor on one table.

    Parameters
    ----------
    triad, bench, prior, initial_values, table
        The same as for `Filter`.
    readback_sd : float
        Standard deviation of the attitude from the readback, rad.
    lag : int
        Number of samples by which the readback waits for the IMU; if negative, the IMU waits.
    buffer_size : int
        Number of samples whose attitudes are stored.
    feedback : bool
        Whether estimates are fed back to the integration.
    compare_while_turning : bool
        Whether attitudes are also compared while the table turns.
    alignment_sd : float
        Standard deviation of φ when the attitude is taken from the table, rad.
    """

    readback_sd: float
    lag: int = 0
    buffer_size: int = 16
    feedback: bool = True
    compare_while_turning: bool = True
    alignment_sd: float = ALIGNMENT_SD

    name: ClassVar[str] = "gyros"
    unit: ClassVar[str] = "rad"
    leading_states: ClassVar[tuple[str, ...]] = TILT
    rows: ClassVar[int] = 3

    @classmethod
    def from_track(
        cls,
        sensor: Sensor,
        bench: Turntable,
        track: Track,
        priors: Priors = (),
        *,
        bias_drift: bool = True,
        table: Literal["whole", "lean", "exact"] = "whole",
        readback_sd: float = 4 * ARCSEC,
        run_duration: float | None = None,
        epoch: float = model.EPOCH_PERIOD,
        expected_sizes: Mapping[str, float] = model.EXPECTED_SIZES,
        alignment_sd: float = ALIGNMENT_SD,
    ) -> "GyroFilter":
        """Return the filter, with initial biases from the rest at the start of a track.

        Parameters
        ----------
        sensor : Sensor
        bench : Turntable
        track : Track
            Track of one trial; its first 20 s are enough.
        priors : sequence of Gaussian
        bias_drift : bool
            Whether biases drift.
        table : "whole", "lean" or "exact"
            Which errors of the table are states. "lean" means latency, clock and azimuth.
        readback_sd : float
            Standard deviation, rad. 4″ cover the readback's noise and the error of assuming linear
            rates between samples at 100 Hz.
        run_duration : float, optional
            Planned duration of the run without pauses, s; None means the track's duration.
        epoch, alignment_sd : float
            s, rad; as for the class.
        expected_sizes : mapping of str to float
            Standard deviations of the coefficients before the data, like `model.EXPECTED_SIZES`.

        Raises
        ------
        InputError
            The filter does not support the sensor, there is no rest at the start, or the latency is
            too uncertain.
        """
        lasting = model.run_duration(track, run_duration)
        part = model.triad_model(
            sensor, "w", lasting, bias_drift=bias_drift, expected_sizes=expected_sizes
        )
        first, prior = model.initial_estimate(part, priors, model.coarse_bias(bench, track, part))
        loose = [q for q in bench.parameters if q.sd > 0]
        timing = table != "exact"
        wanted = [q for q in loose if q.name in _TIMING_PARAMETERS and timing]
        if table == "whole":
            seen = linear_misalignment(bench, np.zeros((1, len(bench.axes)))).parameters
            # A lean turns all attitudes equally, so φ at the start includes it.
            known = ("lean_x", "lean_y", *_TIMING_PARAMETERS)
            wanted += [q for q in seen if q.sd > 0 and q.name not in known]
        lag, kept = _buffer_lengths(bench, track, bench.latency.sd if timing else 0.0, run_duration)
        return cls(
            part, bench, prior, first, tuple(wanted), readback_sd, lag, kept,
            alignment_sd=alignment_sd, epoch=epoch,
        )  # fmt: skip

    @property
    def time_varying_states(self) -> tuple[str, ...]:
        """Names of the states that vary with time."""
        return (*TILT, *self.bias_drift)

    def start(self, track: Track) -> AttitudeState:
        """Return the state before the first sample of a track."""
        covariance = self.covariance(self.alignment_sd**2)
        x = np.zeros(len(covariance))
        x[len(x) - len(self.table) :] = [one.value for one in self.table]
        time, mat = float(track.time[0]), reference_attitude(self.bench, track.angles[:1])[0]
        reading = track.reading[0, self.triad.channels]
        waits = np.zeros((0, 6 if self.triad.terms.has_temperature else 5))
        return AttitudeState(
            c=mat,
            theta=self.initial_values.copy(),
            x=x,
            p=covariance,
            sensitivity_integral=np.zeros((self.triad.terms.size, 9)),
            time=np.array([time, time, time, 0.0, time]),
            rates=np.array([reading, reading, *np.zeros((3, 3))]),
            acceleration_variance=np.zeros(1),
            alignment_due=np.array([False]),
            rejections=np.zeros(2, np.int64),
            times=np.full(self.buffer_size, time),
            attitudes=np.tile(mat, (self.buffer_size, 1, 1)),
            sensitivity_integrals=np.zeros((self.buffer_size, self.triad.terms.size, 9)),
            newest_row=np.array([0]),
            pending_samples=waits
            if self.lag < 0
            else np.tile([time, self._angle_variance(track)[0], *track.angles[0]], (self.lag, 1)),
            dof=-self.rows,
        )

    def advance(
        self, state: AttitudeState, track: Track, wanted: Array | None = None
    ) -> tuple[AttitudeState, FilterPiece]:
        """Process a piece of a track; see `Filter.advance`."""
        samples, (stamps, variance, angles), tail = self._pair_readback(
            state.pending_samples, track
        )
        # Copied, because a view would keep the piece in memory. With one memory layout, the kernel
        # is compiled only once.
        after = state._replace(pending_samples=tail.copy())
        # An epoch waits for the first sample with usable angles, so that pieces of any length give
        # the same epochs.
        usable = np.where(np.isfinite(variance), 0, -1)
        epochs = strapdown.epoch_indices_in_holds(
            samples.time, usable, self.epoch, after.time[1], 0
        )
        if not self.compare_while_turning:
            epochs = epochs[samples.hold[epochs] >= 0]
        late, rejected = self._timing_state_indices, int(after.rejections[1])
        steps, history = self.allocate_steps(epochs.size, wanted)
        nis = _gyros.run_gyro_filter(
            samples,
            self._readback(epochs, samples.time[epochs] - stamps[epochs], angles, variance),
            self.kernel_model,
            AttitudeSettings(
                self.innovation_gate(track),
                self.alignment_sd**2,
                MAX_GAP_SECONDS,
                late,
                0.0 if late[0] >= 0 else float(self.bench.latency.value),
                self.feedback,
                float(self.bench.azimuth.value),
            ),
            after,
            self.workspace(),
            steps,
            history,
        )
        piece = FilterPiece(samples.time[epochs], steps, history)
        # An epoch without innovations takes the attitude from the readback, unless rejected.
        anew = int(np.count_nonzero(history[:, self.rows] == 0) - after.rejections[1]) + rejected
        tested = np.full(epochs.size, self.rows)
        return self.count_dof(after, nis, piece, tested, self.rows * anew), piece

    def _readback(
        self, epochs: Indices, age: Array, angles: Array, variance: Array
    ) -> AttitudeReadback:
        """Return the readback at epochs (e,) of samples, in the form that the kernel needs."""
        e, q = epochs.size, len(self.table)
        if not e:  # for most pieces of a live recording
            shapes = (e, 3, 3), (e, 3, q), (e,)
            return AttitudeReadback(epochs, age, *(np.zeros(shape) for shape in shapes))
        angles = np.ascontiguousarray(angles[epochs])
        turning = np.zeros((e, 3, q))
        if any(one.name not in _TIMING_PARAMETERS for one in self.table):
            seen = linear_misalignment(self.bench, angles)
            turning = table_sensitivity(seen, self.table, skipped=_TIMING_PARAMETERS)
        return AttitudeReadback(
            epochs, age, reference_attitude(self.bench, angles), turning, variance[epochs]
        )

    def _angle_variance(self, track: Track) -> Array:
        """Return the variance of the attitude from the readback at each sample, (n,) rad²."""
        return track.angle_variance(self.readback_sd**2)

    def _pair_readback(
        self, tail: Array, track: Track
    ) -> tuple[FilterSamples, tuple[Array, Array, Array], Array]:
        """Return samples, the readback of each, and those that must wait.

        A readback consists of a timestamp, a variance, and angles: (n,), (n,), (n, k). `tail`
        contains the samples or readbacks that waited before.
        """
        samples, lag, variance = self.samples(track), self.lag, self._angle_variance(track)
        if not lag:
            return samples, (track.time, variance, track.angles), tail
        if lag < 0:
            hold = samples.hold.astype(np.float64)
            beside = [samples.temperature_offset] if self.triad.terms.has_temperature else []
            comes = np.column_stack([samples.time, samples.reading, hold, *beside])
            held = np.concatenate([tail, comes])
            taken = max(len(held) + lag, 0)
            ready = held[:taken]
            samples = FilterSamples(
                ready[:, 0].copy(), ready[:, 1:4].copy(), ready[:, 4].astype(np.int64),
                ready[:, 5:].reshape(-1).copy(),
            )  # fmt: skip
            part = slice(track.time.size - taken, None)
            return samples, (track.time[part], variance[part], track.angles[part]), held[taken:]
        read = np.concatenate([tail, np.column_stack([track.time, variance, track.angles])])
        now, tail = read[: track.time.size], read[track.time.size :]
        return samples, (now[:, 0], now[:, 1], now[:, 2:]), tail

    @cached_property
    def _timing_state_indices(self) -> Indices:
        """The indices of latency, clock and azimuth among the states, -1 if absent."""
        names = self.states
        return np.array([names.index(n) if n in names else -1 for n in _TIMING_PARAMETERS])


def _buffer_lengths(
    bench: Turntable, track: Track, sd: float, run_duration: float | None
) -> tuple[int, int]:
    """Return how many samples the readback waits for the IMU, and how many attitudes are stored.

    Parameters
    ----------
    bench : Turntable
    track : Track
    sd : float
        Standard deviation of the latency, s.
    run_duration : float or None
        Planned duration of the run, s; None means the track's duration.
    """
    late, step = bench.latency.value, float(np.median(np.diff(track.time)))
    most = model.run_duration(track, None)
    if run_duration is not None:
        most = _DURATION_FACTOR * run_duration + _PAUSE_ALLOWANCE
    ahead = _LATENCY_COVERAGE * sd - late
    # The curvature at the time of the readback needs one more sample.
    lag = ceil((ahead - STAMP_ROUNDING) / step) + 1 if sd > 0 or late != 0 else 0
    span = 2 * _LATENCY_COVERAGE * sd
    if span > _MAX_LATENCY_SPAN:
        raise InputError(
            f"[bench] latency: ± {1e3 * sd:.3g} ms is too uncertain, because the gyros' filter "
            f"allows at most ± {1e3 * _MAX_LATENCY_SPAN / 2 / _LATENCY_COVERAGE:.3g} ms; "
            "measure the latency with a turn back and forth, and state it",
            key="[bench] latency",
        )
    return lag, ceil((span + _LATENCY_COVERAGE * bench.clock * most) / step) + _SPARE_SAMPLES
