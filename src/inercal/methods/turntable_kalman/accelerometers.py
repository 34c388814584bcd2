"""The accelerometer filter assumes zero velocity at rest and takes the vertical from the table.

States: δV (3), φ (3), coefficients, drift of the biases (`turntable.drift`), and errors of the
table's attitude. These errors are either lean of the base, right angles and harmonics of the
readback, or the lean and an error of the angles in each hold (2). At every hold the attitude comes
from the table and is constant. The velocity is set to zero and then integrated. Estimates are fed
back at every epoch. The source integrates the attitude with the gyros instead, so their errors,
mainly their sensitivity to g, are mistaken for tilt.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.benches.turntable.attitude import linear_misalignment, reference_attitude
from inercal.benches.turntable.bench import Turntable
from inercal.methods import Priors
from inercal.methods.turntable import model, strapdown
from inercal.methods.turntable.model import table_sensitivity
from inercal.methods.turntable_kalman import _accelerometers
from inercal.methods.turntable_kalman._accelerometers import (
    VelocityReadback,
    VelocitySettings,
    VelocityState,
)
from inercal.methods.turntable_kalman.filter import TILT, Filter
from inercal.methods.turntable_kalman.filtered_track import FilterPiece
from inercal.physics.sensors import Sensor
from inercal.recordings import AngleQuality, Track

# m/s, uncertainty of the zero velocity at rest. This is far below the noise of any accelerometer,
# so the innovations are as large as stated
REST_VELOCITY_SD = 1e-7
HOLD_ALIGNMENT_SD = 5e-4  # rad, sd of φ at the start of a hold
_LEAST_NOISE = 1e-2  # of the readback's noise; an axis so close to vertical has no direction
_BASE_PARAMETERS = ("lean_x", "lean_y")  # of the base; other errors of a hold belong to the hold


@dataclass(frozen=True, eq=False)
class AccelerometerFilter(Filter[VelocityState]):
    """The filter for one sensor on one table.

    Parameters
    ----------
    triad, bench, prior, initial_values, table
        The same as for `Filter`.
    hold_errors : bool
        Whether the error of each hold's angles is a state.
    readback_sd : float or None
        Standard deviation of the attitude from the readback within a hold, rad. None means the
        bench's noise about each axis of the table.
    velocity_sd : float
        Standard deviation of the velocity at rest, m/s.
    alignment_sd : float
        Standard deviation of φ at the start of a hold, rad.
    """

    hold_errors: bool
    readback_sd: float | None
    velocity_sd: float
    alignment_sd: float = HOLD_ALIGNMENT_SD

    name: ClassVar[str] = "accelerometers"
    unit: ClassVar[str] = "m/s"
    leading_states: ClassVar[tuple[str, ...]] = ("v_e", "v_n", "v_u", *TILT)
    rows: ClassVar[int] = 5

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
        readback_sd: float | None = None,
        velocity_sd: float = REST_VELOCITY_SD,
        run_duration: float | None = None,
        epoch: float = model.EPOCH_PERIOD,
        expected_sizes: Mapping[str, float] = model.EXPECTED_SIZES,
        alignment_sd: float = HOLD_ALIGNMENT_SD,
    ) -> "AccelerometerFilter":
        """Return the filter, with initial values from the rest at the start of a track.

        Parameters
        ----------
        sensor, bench, track, priors
            The same as for `GyroFilter.from_track`.
        bias_drift : bool
            Whether biases drift.
        table : "whole", "lean" or "exact"
            Which errors of the table are states. "lean" means the base's lean and an error of each
            hold.
        readback_sd, velocity_sd : float
            Standard deviations, rad and m/s; None means the bench's noise.
        run_duration : float, optional
            Planned duration, s; None means the track's duration.
        epoch, alignment_sd : float
            s, rad; as for the class.
        expected_sizes : mapping of str to float
            Standard deviations of the coefficients before the data, like `model.EXPECTED_SIZES`.

        Raises
        ------
        InputError
            The filter does not support the sensor, or there is no rest at the start.
        """
        lasting = model.run_duration(track, run_duration)
        part = model.triad_model(
            sensor, "f", lasting, bias_drift=bias_drift, expected_sizes=expected_sizes
        )
        first, prior = model.initial_estimate(part, priors, model.coarse_bias(bench, track, part))
        seen = linear_misalignment(bench, np.zeros((1, len(bench.axes)))).parameters
        chosen = {"exact": (), "lean": _BASE_PARAMETERS}.get(table)
        kept = tuple(
            q
            for q in seen
            if q.sd > 0 and (q.name != "azimuth" if chosen is None else q.name in chosen)
        )
        return cls(
            part, bench, prior, first, kept, table == "lean", readback_sd, velocity_sd,
            alignment_sd, epoch=epoch,
        )  # fmt: skip

    @property
    def time_varying_states(self) -> tuple[str, ...]:
        """Names of the states that vary with time and that a hold determines."""
        return (*TILT[:2], *self.bias_drift, *self.hold_states)

    @property
    def hold_states(self) -> tuple[str, ...]:
        """Names of the states for the error of each hold's angles."""
        return ("hold_x", "hold_y") if self.hold_errors else ()

    @property
    def tested_components(self) -> int:
        """Number of components that are tested per epoch."""
        # If the readback is stated as exact, the floor of its noise is arbitrary and not tested.
        return 3 if self.readback_sd is None and self.bench.white == 0 else self.rows

    @cached_property
    def shared_covariance(self) -> Array:
        """The coefficients' covariance due to gravity, which no innovation shows, (p, p)."""
        g = self.bench.gravity
        along = model.gravity_sensitivity(self.triad) * g.sd / g.value
        return np.outer(along, along)

    def start(self, track: Track) -> VelocityState:
        """Return the state before the first sample of a track."""
        covariance = self.covariance(0.0)
        return VelocityState(
            c=np.eye(3),
            theta=self.initial_values.copy(),
            x=np.zeros(len(covariance)),
            p=covariance,
            sensitivity_integral=np.zeros((self.triad.terms.size, 9)),
            time=np.full(3, track.time[0]),
            velocity=np.zeros(3),
            hold=np.array([-1]),
            rejections=np.zeros(2, np.int64),
        )

    def advance(
        self, state: VelocityState, track: Track, wanted: Array | None = None
    ) -> tuple[VelocityState, FilterPiece]:
        """Process a piece of a track; see `Filter.advance`."""
        # An epoch waits for the first sample with usable angles; see `GyroFilter.advance`.
        usable = np.where(np.isfinite(track.angle_variance(1.0)), track.hold, -1)
        epochs = strapdown.epoch_indices_in_holds(
            track.time, usable, self.epoch, state.time[1], state.hold[0]
        )
        readback = self._readback(epochs, track)
        here = track.hold[epochs]
        begins = here != np.concatenate([state.hold, here[:-1]])
        # A readback without noise cannot be tested.
        least = self._least_readback_noise
        tested = np.count_nonzero(readback.noise > least, axis=1)
        steps, history = self.allocate_steps(epochs.size, wanted)
        nis = _accelerometers.run_accelerometer_filter(
            self.samples(track),
            readback,
            self.kernel_model,
            VelocitySettings(
                self.velocity_sd**2, self.alignment_sd**2, self.innovation_gate(track)
            ),
            state,
            self.workspace(),
            steps,
            history,
        )
        piece = FilterPiece(track.time[epochs], steps, history)
        return self.count_dof(state, nis, piece, 3 + tested, int(tested[begins].sum())), piece

    def _readback(self, epochs: Indices, track: Track) -> VelocityReadback:
        """Return the readback at the epochs (e,) of a track, in the form that the kernel needs."""
        angles = track.angles[epochs]
        e, q = len(angles), len(self.table)
        if not e:  # while the table moves
            shapes = (e, 3, 3), (e, 2, 2), (e, 2, q), (e, 2), (e, 2)
            return VelocityReadback(epochs, *(np.zeros(shape) for shape in shapes))
        seen = linear_misalignment(self.bench, angles)
        quality = None if track.angle_quality is None else track.angle_quality.where(epochs)
        directions, noise = self._readback_noise(angles, quality)
        return VelocityReadback(
            epochs,
            reference_attitude(self.bench, angles),
            directions,
            # The memory layout must not depend on e, because a kernel is compiled for each layout.
            np.ascontiguousarray(directions @ table_sensitivity(seen, self.table)[:, :2]),
            self._hold_variance(angles),
            noise,
        )

    def observed_directions(self, angles: Array) -> Array:
        """Return the horizontal directions about which φ is observed at angles, (e, 2, 2)."""
        return self._readback_noise(angles, None)[0]

    def _hold_variance(self, angles: Array) -> Array:
        """Return the variance of a hold's angle error about east and north, (e, 2)."""
        if not self.hold_errors:
            return np.zeros((len(angles), 2))  # not a separate state
        seen = linear_misalignment(self.bench, angles)
        variance = np.array(
            [0.0 if q.name in (*_BASE_PARAMETERS, "azimuth") else q.sd**2 for q in seen.parameters]
        )
        return (seen.by[..., :2, :] ** 2) @ variance

    @cached_property
    def _bench_with_harmonic(self) -> Turntable:
        return replace(self.bench, harmonics=(1.0,))

    def _readback_noise(self, angles: Array, quality: AngleQuality | None) -> tuple[Array, Array]:
        """Return the principal directions of the readback's noise, (e, 2, 2), and its variances.

        The noise acts about the table's axes, two of which may have the same horizontal direction.
        """
        if self.readback_sd is not None:
            level = np.tile(np.eye(2), (len(angles), 1, 1))
            return level, np.full((len(angles), 2), self.readback_sd**2)
        # Sine and cosine of a harmonic rotate about an axis like noise; their squares add up to 1.
        seen = linear_misalignment(self._bench_with_harmonic, angles)
        waves = [k for k, q in enumerate(seen.parameters) if q.name.startswith(("sin1", "cos1"))]
        east, north = np.moveaxis(seen.by[..., :2, waves], 1, 0)
        (ee, nn), en = (
            (np.sum(a * a, axis=-1) for a in (east, north)),
            np.sum(east * north, axis=-1),
        )
        turn = np.arctan2(2 * en, ee - nn) / 2
        c, s = np.cos(turn), np.sin(turn)
        directions = np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=1)
        mean, half = (ee + nn) / 2, np.hypot(ee - nn, 2 * en) / 2
        share = np.stack([mean + half, mean - half], axis=-1)
        white = self.bench.white**2 * share
        if quality is not None:
            white = white * quality.noise_gain[:, None] + quality.interpolation_sd[:, None] ** 2
        return directions, np.maximum(white, self._least_readback_noise)

    @property
    def _least_readback_noise(self) -> float:
        """Minimum variance of the readback, rad²; the filter needs noise in every direction."""
        if self.readback_sd is not None:
            return 0.0
        return (_LEAST_NOISE * self.bench.white or model.READBACK_NOISE_FLOOR) ** 2
