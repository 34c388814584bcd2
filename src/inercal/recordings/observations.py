"""Store observations in SI units: mean readings over the sections of a recording."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.recordings.magnetic import MagneticReadings
from inercal.recordings.rounding_errors import (
    RoundingErrors,
    join_covariances,
    join_rounding_errors,
)
from inercal.recordings.samples import Indices
from inercal.recordings.temperature import temperature_varies
from inercal.recordings.track import Track

if TYPE_CHECKING:
    from inercal.estimation import ModelTest


@dataclass(frozen=True, eq=False)
class Transitions:
    """Motion of the sensor from each rest to the next, as ranges of samples.

    A transition leads from the mean attitude during one rest to the mean attitude during the next
    rest. The weight of a sample therefore rises from 0 to 1 between samples `start` and `left`, and
    falls back to 0 between `reached` and `stop`.

    Parameters
    ----------
    time : (n,) array
        Time of each sample of the recording, s.
    output : (n, m) array
        Readings of the sensor's axes in output units.
    rest : (k,) array of int
        Row of the observations where each transition begins; it ends at the next row.
    start, left, reached, stop : (k,) arrays of int
        Sample numbers: `left` is the last sample of the preceding rest, `reached` the first sample
        of the following rest, and `stop` the last sample of the transition.
    temperature : (n,) array or None
        Temperature at each sample, K.
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
        """Effective duration of each transition, (k,) s: its rotation over a constant rate."""
        t = self.time
        ends = t[self.left] - t[self.start] + t[self.stop] - t[self.reached]
        return t[self.reached] - t[self.left] + 0.5 * ends

    def compact(self) -> "Transitions":
        """Return the transitions with only the samples that they use, if at most half are used."""
        used = np.zeros(self.time.size, np.bool_)
        for start, stop in zip(self.start.tolist(), self.stop.tolist(), strict=True):
            used[start : stop + 1] = True
        at = np.flatnonzero(used)
        if 2 * at.size > used.size:
            return self
        start, left, reached, stop = np.searchsorted(
            at, np.stack([self.start, self.left, self.reached, self.stop])
        )
        kelvin = None if self.temperature is None else self.temperature[at]
        return Transitions(
            self.time[at], self.output[at], self.rest, start, left, reached, stop, kelvin
        )


@dataclass(frozen=True, eq=False)
class HalfSectionChanges:
    """Changes of the readings from the first to the second half of r sections at rest.

    Parameters
    ----------
    change : (r, m) array
        Mean of the second half minus mean of the first half, output units.
    integral : (r, m) array
        Weighted integral of the readings over time, output units times s. The weight with which a
        rate rotates the mean attitude of the first half into that of the second rises from 0 to 1
        during the first half and falls back to 0 during the second.
    seconds : (r,) array
        Integral of that weight.
    square : (r,) array
        Sum of the squared weights times the squared time step, s²: the variance of an integral
        divided by the variance of a sample.
    warming : (r,) array or None
        Mean temperature of the second half minus that of the first half, K.
    """

    change: Array
    integral: Array
    seconds: Array
    square: Array
    warming: Array | None = None


@dataclass(frozen=True, eq=False)
class Observations:
    """Mean readings over the sections of a recording: one row for each hold or turn.

    Parameters
    ----------
    labels : tuple of r str
        Name of each row.
    mean : (..., r, m) array
        Mean readings in SI units, after the nominal readout is applied.
    covariance : (..., r, m, m) array
        Covariance of each mean.
    duration : (r,) array
        Duration of each section, s.
    time : (..., r) array
        Time of the middle of each section, s.
    samples : (r,) array of int
        Number of samples in each mean.
    channels : tuple of m str
        Names of the sensor's axes.
    dof : float
        Degrees of freedom of the covariance; infinite if the covariance was stated.
    drift : (r, r, m) array or None
        Covariance between rows due to each channel's slow drift; not included in `covariance`.
    drift_mean : (r, m) array or None
        The part of the drift in `mean` that the slopes within the rows reveal; the uncertainty that
        remains is in `drift`. `without_drift` subtracts it. As long as it is not subtracted,
        `full_covariance` includes it.
    rounding : RoundingErrors or None
        Errors due to coarse steps of the channels. The diagonal of their covariance between rows is
        part of `covariance`.
    transitions : Transitions or None
        Transitions between neighbouring rows, for methods that integrate the rate between rests.
    halves : HalfSectionChanges or None
        Changes of the readings within each row, for hand-held sensors that include gyros.
    track : Track or None
        The individual samples, for filters.
    tests : tuple of ModelTest
        Tests of the noise within sections, if the rows are means of a recording.
    notes : tuple of str
        Statements about the noise in the sections, in words.
    timed : bool
        Whether `time` was measured; for a table of means it is only the order of the rows.
    temperature : (..., r) array or None
        Mean temperature over the samples of each row, K.
    common : (..., r, m, k) array or None
        Effects of k independent errors of unit variance, shared by the rows, on each reading;
        `full_covariance` includes them.
    magnetic : MagneticReadings or None
        Readings of the magnetometers in the same rests; None without magnetometers.

    Raises
    ------
    InputError
        A shape is wrong; a mean, covariance or temperature is not finite; a covariance is not
        symmetric or has a negative variance; or a section has no samples.
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
    drift_mean: Array | None = None
    rounding: RoundingErrors | None = None
    transitions: Transitions | None = None
    halves: HalfSectionChanges | None = None
    track: Track | None = None
    tests: tuple["ModelTest", ...] = ()
    notes: tuple[str, ...] = ()
    timed: bool = True
    temperature: Array | None = None
    common: Array | None = None
    magnetic: MagneticReadings | None = None

    def __post_init__(self) -> None:
        r, m = len(self.labels), len(self.channels)
        shapes = {
            "mean": (self.mean.shape[-2:], (r, m)),
            "covariance": (self.covariance.shape[-3:], (r, m, m)),
            "duration": (self.duration.shape, (r,)),
            "samples": (self.samples.shape, (r,)),
            "time": (self.time.shape[-1:], (r,)),
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
        if not finite.all():  # test all numbers at once first: a reduction of short rows is slow
            self._refuse(~finite.all(-1), "mean", not_finite)
        self._refuse(~np.isfinite(self.covariance).all((-2, -1)), "covariance", not_finite)
        variance = np.diagonal(self.covariance, axis1=-2, axis2=-1)
        self._refuse((variance < 0).any(-1), "covariance", "with a negative variance")
        # Rounding in a product J C Jᵀ leaves a last-bit asymmetry, so compare it with the
        # variances.
        scale = np.sqrt(variance[..., :, None] * variance[..., None, :])
        skew = np.abs(self.covariance - np.swapaxes(self.covariance, -1, -2))
        self._refuse((skew > 1e-9 * scale).any((-2, -1)), "covariance", "that is not symmetric")
        self._refuse(self.samples < 1, "samples", "below 1")
        if self.temperature is not None:
            self._refuse(~np.isfinite(self.temperature), "temperature", not_finite)

    def _refuse(self, bad: Bools | np.bool_, key: str, what: str) -> None:
        if not bad.any():
            return
        row = int(np.argmax(np.reshape(bad, (-1, len(self.labels))).any(0)))
        label = self.labels[row]
        raise InputError(
            f"observations: {label} (row {row + 1}) has a {key} {what}; correct it",
            key=key,
            names=(label,),
        )

    @property
    def between_rows(self) -> Array | None:
        """Covariance between rows due to drift and rounding, (r, r, m), not in `covariance`."""
        if self.rounding is None:
            return self.drift
        shared = self.rounding.shared
        return shared if self.drift is None else self.drift + shared

    @property
    def full_covariance(self) -> Array:
        """Covariance of all readings, (..., r·m, r·m), including drift and all common errors."""
        r, m = self.mean.shape[-2:]
        full = np.zeros((*self.covariance.shape[:-3], r, m, r, m))
        for k in range(r):
            full[..., k, :, k, :] = self.covariance[..., k, :, :]
        if (between := self.between_rows) is not None:
            for a in range(m):
                full[..., :, a, :, a] += between[..., a]
        if self.drift_mean is not None:
            for a, course in enumerate(self.drift_mean.T):
                full[..., :, a, :, a] += np.outer(course, course)
        full = full.reshape(*full.shape[:-4], r * m, r * m)
        if self.common is not None:
            effect = self.common.reshape(*self.common.shape[:-3], r * m, -1)
            full = full + effect @ np.swapaxes(effect, -1, -2)
        return full

    @cached_property
    def without_drift(self) -> "Observations":
        """Observations with `drift_mean` subtracted from the means."""
        if self.drift_mean is None:
            return self
        return replace(self, mean=self.mean - self.drift_mean, drift_mean=None)

    def temperature_offset(self, reference: float) -> Array:
        """Return each row's temperature minus a reference, (..., r) K; 0 if not recorded."""
        return np.zeros(()) if self.temperature is None else self.temperature - reference

    @property
    def temperature_varies(self) -> bool:
        """Whether the recorded temperatures differ by more than a temperature sensor's error."""
        return temperature_varies(self.temperature)

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
        """Return some of the trials along a single leading axis; keep what all trials share."""

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
        """Return some of the rows, without transitions, changes within rows, and samples."""
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
            drift_mean=None if self.drift_mean is None else self.drift_mean[kept],
            rounding=None if self.rounding is None else self.rounding.rows(kept),
            transitions=None,
            halves=None,
            track=None,
            temperature=None if t is None else t[..., kept],
            common=None if self.common is None else self.common[..., kept, :, :],
            magnetic=None if self.magnetic is None else self.magnetic.rows(kept),
        )


def join_observations(one: Observations, other: Observations) -> Observations:
    """Return the rows of two sets of observations with the same channels, with independent drifts.

    The result has temperatures only if both sets have them.
    """
    r, s, m = len(one.labels), len(other.labels), len(one.channels)
    course = None
    if one.drift_mean is not None or other.drift_mean is not None:
        course = np.zeros((r + s, m))
        course[:r] = 0.0 if one.drift_mean is None else one.drift_mean
        course[r:] = 0.0 if other.drift_mean is None else other.drift_mean
    return Observations(
        labels=(*one.labels, *other.labels),
        mean=np.concatenate([one.mean, other.mean], axis=-2),
        covariance=np.concatenate([one.covariance, other.covariance], axis=-3),
        duration=np.concatenate([one.duration, other.duration]),
        samples=np.concatenate([one.samples, other.samples]),
        time=np.concatenate([one.time, other.time]),
        channels=one.channels,
        dof=min(one.dof, other.dof),
        drift=join_covariances(one.drift, other.drift, r, s),
        drift_mean=course,
        rounding=join_rounding_errors(one.rounding, other.rounding, r, s),
        tests=(*one.tests, *other.tests),
        notes=(*one.notes, *other.notes),
        timed=one.timed and other.timed,
        temperature=None
        if one.temperature is None or other.temperature is None
        else np.concatenate([one.temperature, other.temperature], axis=-1),
    )
