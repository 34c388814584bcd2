"""Observations in SI: means over the sections of a recording, and samples for filters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.errors import InputError
from inercal.recording.samples import Indices

if TYPE_CHECKING:
    from inercal.estimate import ModelTest

TEMPERATURE_VARIATION = 0.5  # K; a smaller variation counts as constant temperature


def _temperature_varies(temperature: Array | None) -> bool:
    if temperature is None:
        return False
    return float(np.ptp(temperature, axis=-1).max(initial=0.0)) > TEMPERATURE_VARIATION


@dataclass(frozen=True, eq=False)
class Transitions:
    """Motion of the sensor from each rest to the next, as ranges of samples.

    A transition is weighted from the mean attitude of one rest to that of the next: the weight of a
    sample rises from 0 to 1 along samples `start` to `left`, and falls along `reached` to `stop`.

    Parameters
    ----------
    time : (n,) array
        s, of each sample of the recording.
    output : (n, m) array
        Readings of the sensor's axes in output units.
    rest : (k,) array of int
        Row of the observations at the begin of each transition; it ends at the next row.
    start, left, reached, stop : (k,) arrays of int
        Samples: `left` is the last sample of the rest before, `reached` the first sample of the
        rest after, `stop` the last sample of the transition.
    temperature : (n,) array or None
        K, of each sample.
    """

    time: Array
    output: Array
    rest: Indices
    start: Indices
    left: Indices
    reached: Indices
    stop: Indices
    temperature: Array | None = None

    @property
    def duration(self) -> Array:
        """Effective duration of each transition, (k,) s: rotation over a constant rate."""
        t = self.time
        ends = t[self.left] - t[self.start] + t[self.stop] - t[self.reached]
        return t[self.reached] - t[self.left] + 0.5 * ends


@dataclass(frozen=True, eq=False)
class HalfSectionChanges:
    """Changes of the readings of r sections at rest from the first half to the second.

    Parameters
    ----------
    change : (r, m) array
        Mean of the second half less that of the first, output units.
    integral : (r, m) array
        Integral of the readings over time, with the weight by which a rate rotates the first mean
        attitude into the second: from 0 to 1 across the first half, and back; output units times s.
    seconds : (r,) array
        Integral of that weight.
    square : (r,) array
        Sum of the weights' squares times the step squared, s²: the variance of an integral over
        that of a sample.
    warming : (r,) array or None
        Mean temperature of the second half less that of the first, K.
    """

    change: Array
    integral: Array
    seconds: Array
    square: Array
    warming: Array | None = None


class AngleQuality(NamedTuple):
    """Uncertainty of a table's angles at each sample, where a host interpolated its readings.

    `noise_gain` is the sum of the squares of the interpolation's weights: the variance of the
    angles' noise over that of one reading. A filter uses no angle whose gain is infinite.
    `interpolation_sd` is infinite where nothing bounds the table's motion between two readings.
    """

    noise_gain: Array  # (n,)
    interpolation_sd: Array  # (n,) rad

    def where(self, rows: "NDArray[np.bool_] | Indices | slice") -> "AngleQuality":
        """Return the quality at some of the samples."""
        return AngleQuality(self.noise_gain[rows], self.interpolation_sd[rows])


@dataclass(frozen=True, eq=False)
class Track:
    """The samples of a turntable's run in SI, for filters.

    Parameters
    ----------
    time : (n,) array
        s, by the sensor's clock.
    reading : (..., n, m) array
        Readings of the sensor's axes after the nominal readout, m/s² or rad/s.
    angles : (..., n, k) array
        Readback of the table's axes, rad, the outermost first, unwrapped.
    hold : (n,) array of int
        Number of the hold of each sample, from 0; -1 while the table moves.
    temperature : (..., n) array or None
        K.
    angle_quality : AngleQuality or None
        None where each sample has an angle that was read at its time, with the readback's noise.

    Raises
    ------
    InputError
        Unequal lengths, or a temperature that is not finite.
    """

    time: Array
    reading: Array
    angles: Array
    hold: Indices
    temperature: Array | None = None
    angle_quality: AngleQuality | None = None

    def __post_init__(self) -> None:
        n = self.time.size
        if self.angle_quality is not None and any(q.shape != (n,) for q in self.angle_quality):
            raise InputError(
                f"track: each array of angle_quality must have shape ({n},), one value per sample",
                key="angle_quality",
            )
        if self.reading.shape[-2] != n or self.angles.shape[-2] != n or self.hold.shape != (n,):
            raise InputError(
                f"track: time has shape ({n},), reading {self.reading.shape}, angles "
                f"{self.angles.shape} and hold {self.hold.shape}; give each the same number of "
                "samples"
            )
        if self.temperature is not None:
            if self.temperature.shape[-1] != n:
                raise InputError(
                    f"track: temperature has shape {self.temperature.shape}; expected (..., {n})",
                    key="temperature",
                )
            bad = np.flatnonzero(~np.isfinite(self.temperature).reshape(-1, n).all(axis=0))
            if bad.size:
                raise InputError(
                    f"track: the temperature at {self.time[bad[0]]:.6g} s is not finite; correct "
                    "or remove the sample",
                    key="temperature",
                )

    def slice(self, start: int, stop: int) -> "Track":
        """Return samples start to stop (half open)."""
        return self._select(slice(start, stop))

    @property
    def with_known_angles(self) -> "Track":
        """The samples at which the table's angles are known."""
        if self.angle_quality is None:
            return self
        return self._select(np.isfinite(self.angle_quality.interpolation_sd))

    def _select(self, at: "NDArray[np.bool_] | slice") -> "Track":
        return Track(
            self.time[at],
            self.reading[..., at, :],
            self.angles[..., at, :],
            self.hold[at],
            None if self.temperature is None else self.temperature[..., at],
            None if self.angle_quality is None else self.angle_quality.where(at),
        )

    def angle_variance(self, variance: float) -> Array:
        """Return the variance of the angles at each sample, (n,) rad².

        Infinite where the angles are not usable.

        Parameters
        ----------
        variance : float
            Of the noise of one reading of the table, rad².
        """
        if self.angle_quality is None:
            return np.full(self.time.size, variance)
        gain, sd = self.angle_quality
        return variance * gain + sd**2

    def trial(self, *index: int) -> "Track":
        """Return a single trial; all trials share a temperature without axes of trials."""
        t = self.temperature
        if t is not None and t.ndim > 1:
            t = t[index]
        return Track(
            self.time, self.reading[index], self.angles[index], self.hold, t, self.angle_quality
        )

    def temperature_offset(self, reference: float) -> Array | None:
        """Return the temperature of each sample minus a reference, (..., n) K; None without one."""
        return None if self.temperature is None else self.temperature - reference

    @property
    def temperature_varies(self) -> bool:
        """Whether the recorded temperatures differ, as of `Observations`."""
        return _temperature_varies(self.temperature)


@dataclass(frozen=True, eq=False)
class Observations:
    """Means over sections of a recording: a row for each hold or turn.

    Parameters
    ----------
    labels : tuple of r str
        Name of each row.
    mean : (..., r, m) array
        Mean reading in SI after the nominal readout.
    covariance : (..., r, m, m) array
        Covariance of each mean.
    duration, time : (r,) array
        s; length of the section and time of its middle.
    samples : (r,) array of int
        Number of samples of each mean.
    channels : tuple of m str
        Names of the sensor's axes.
    dof : float
        Degrees of freedom of the covariance; infinite when it was stated.
    drift : (r, r, m) array or None
        Covariance between rows of each channel's slow drift, which `covariance` excludes.
    rounding : (m,) array or None
        Variance that coarse steps of the channels add to each mean, part of `covariance`.
    transitions : Transitions or None
        Transitions between neighbouring rows, for methods that integrate the rate between rests.
    halves : HalfSectionChanges or None
        Changes of the readings within each row, for sensors in a hand that have gyros.
    track : Track or None
        The samples themselves, for filters.
    tests : tuple of ModelTest
        Tests of the noise within sections, where a recording was averaged.
    notes : tuple of str
        Results on the noise of the sections, in words.
    timed : bool
        Whether `time` was measured; for a table of means it is the order of the rows.
    temperature : (..., r) array or None
        K, the mean over the samples of each row.
    common : (..., r, m, k) array or None
        Effect on each reading of k independent errors of unit variance, which rows have in common;
        `full_covariance` includes them.

    Raises
    ------
    InputError
        Wrong shapes, a mean, covariance or temperature that is not finite, a covariance that is
        not symmetric or has a negative variance, or a section without samples.
    """

    labels: tuple[str, ...]
    mean: Array
    covariance: Array
    duration: Array
    samples: Indices
    time: Array
    channels: tuple[str, ...]
    dof: float = np.inf
    drift: Array | None = None
    rounding: Array | None = None
    transitions: Transitions | None = None
    halves: HalfSectionChanges | None = None
    track: Track | None = None
    tests: tuple["ModelTest", ...] = ()
    notes: tuple[str, ...] = ()
    timed: bool = True
    temperature: Array | None = None
    common: Array | None = None

    def __post_init__(self) -> None:
        r, m = len(self.labels), len(self.channels)
        shapes = {
            "mean": (self.mean.shape[-2:], (r, m)),
            "covariance": (self.covariance.shape[-3:], (r, m, m)),
            "duration": (self.duration.shape, (r,)),
            "samples": (self.samples.shape, (r,)),
            "time": (self.time.shape, (r,)),
        }
        if self.temperature is not None:
            shapes["temperature"] = (self.temperature.shape[-1:], (r,))
        if self.common is not None:
            shapes["common"] = (self.common.shape[-3:-1], (r, m))
        for name, (shape, expected) in shapes.items():
            if shape != expected:
                raise InputError(
                    f"observations: {name} has shape {shape}, expected {expected}", key=name
                )
        if not self.dof > 0:
            raise InputError(
                f"observations: dof is {self.dof}; degrees of freedom must be above 0", key="dof"
            )
        not_finite = "that is not finite"
        finite = np.isfinite(self.mean)
        if not finite.all():  # of all numbers first: a reduction of short rows is slow
            self._refuse(~finite.all(-1), "mean", not_finite)
        self._refuse(~np.isfinite(self.covariance).all((-2, -1)), "covariance", not_finite)
        variance = np.diagonal(self.covariance, axis1=-2, axis2=-1)
        self._refuse((variance < 0).any(-1), "covariance", "with a negative variance")
        # Rounding in a product J C Jᵀ leaves a last-bit asymmetry, compared with the variances.
        scale = np.sqrt(variance[..., :, None] * variance[..., None, :])
        skew = np.abs(self.covariance - np.swapaxes(self.covariance, -1, -2))
        self._refuse((skew > 1e-9 * scale).any((-2, -1)), "covariance", "that is not symmetric")
        self._refuse(self.samples < 1, "samples", "below 1")
        if self.temperature is not None:
            self._refuse(~np.isfinite(self.temperature), "temperature", not_finite)

    def _refuse(self, bad: NDArray[np.bool_] | np.bool_, key: str, what: str) -> None:
        rows = np.flatnonzero(np.reshape(bad, (-1, len(self.labels))).any(0))
        if rows.size:
            label = self.labels[int(rows[0])]
            raise InputError(
                f"observations: {label} (row {rows[0] + 1}) has a {key} {what}; correct it",
                key=key,
                names=(label,),
            )

    @property
    def full_covariance(self) -> Array:
        """Covariance of all readings with drift and common errors, (..., r·m, r·m), by rows."""
        r, m = self.mean.shape[-2:]
        full = np.zeros((*self.covariance.shape[:-3], r, m, r, m))
        for k in range(r):
            full[..., k, :, k, :] = self.covariance[..., k, :, :]
        if self.drift is not None:
            for a in range(m):
                full[..., :, a, :, a] += self.drift[..., a]
        full = full.reshape(*full.shape[:-4], r * m, r * m)
        if self.common is not None:
            effect = self.common.reshape(*self.common.shape[:-3], r * m, -1)
            full = full + effect @ np.swapaxes(effect, -1, -2)
        return full

    def temperature_offset(self, reference: float) -> Array:
        """Return the temperature of each row minus a reference, (..., r) K; () of 0 without one."""
        return np.zeros(()) if self.temperature is None else self.temperature - reference

    @property
    def temperature_varies(self) -> bool:
        """Whether the recorded temperatures differ by more than a temperature sensor's error."""
        return _temperature_varies(self.temperature)

    @property
    def trial_shape(self) -> tuple[int, ...]:
        """The leading axes of trials; () for one recording."""
        t = self.temperature
        return np.broadcast_shapes(
            self.mean.shape[:-2],
            self.covariance.shape[:-3],
            () if t is None else t.shape[:-1],
            () if self.common is None else self.common.shape[:-3],
        )

    def of_trials(self, part: slice) -> "Observations":
        """Return some trials, of one leading axis; what all trials share stays whole."""

        def some(array: Array, own: int) -> Array:
            return array[part] if array.ndim > own and len(array) > 1 else array

        t = self.temperature
        return replace(
            self,
            mean=some(self.mean, 2),
            covariance=some(self.covariance, 3),
            temperature=None if t is None else some(t, 1),
            common=None if self.common is None else some(self.common, 3),
        )

    def rows(self, at: Sequence[int]) -> "Observations":
        """Return some rows, without transitions, changes within rows and samples."""
        kept = list(at)
        drift, t = self.drift, self.temperature
        return replace(
            self,
            labels=tuple(self.labels[k] for k in kept),
            mean=self.mean[..., kept, :],
            covariance=self.covariance[..., kept, :, :],
            duration=self.duration[kept],
            samples=self.samples[kept],
            time=self.time[kept],
            drift=None if drift is None else drift[np.ix_(kept, kept)],
            transitions=None,
            halves=None,
            track=None,
            temperature=None if t is None else t[..., kept],
            common=None if self.common is None else self.common[..., kept, :, :],
        )


def join_observations(one: Observations, other: Observations) -> Observations:
    """Return the rows of both, of the same channels; their drifts are taken as independent.

    The result has temperatures only where both have.
    """
    r, s, m = len(one.labels), len(other.labels), len(one.channels)
    drift = None
    if one.drift is not None or other.drift is not None:
        drift = np.zeros((r + s, r + s, m))
        drift[:r, :r] = 0.0 if one.drift is None else one.drift
        drift[r:, r:] = 0.0 if other.drift is None else other.drift
    return Observations(
        labels=(*one.labels, *other.labels),
        mean=np.concatenate([one.mean, other.mean], axis=-2),
        covariance=np.concatenate([one.covariance, other.covariance], axis=-3),
        duration=np.concatenate([one.duration, other.duration]),
        samples=np.concatenate([one.samples, other.samples]),
        time=np.concatenate([one.time, other.time]),
        channels=one.channels,
        dof=min(one.dof, other.dof),
        drift=drift,
        rounding=one.rounding,
        tests=(*one.tests, *other.tests),
        notes=(*one.notes, *other.notes),
        timed=one.timed and other.timed,
        temperature=None
        if one.temperature is None or other.temperature is None
        else np.concatenate([one.temperature, other.temperature], axis=-1),
    )
