"""What a bench run leaves behind: samples as they came, and the means made from them.

A `Recording` keeps the sensor's output units; `Observations` are in SI. Both may carry leading
axes of trials, `(..., n, m)`; trials share times and labels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.errors import InputError
from inercal.estimate import ModelTest

Indices = NDArray[np.int64]
Severity = Literal["note", "warning", "refused"]

GAP_FACTOR = 1.5  # a step of time longer than this many median steps has lost samples
TEMPERATURE_VARIATION = 0.5  # K; a temperature that varies by less is one temperature


@dataclass(frozen=True)
class Finding:
    """One thing noticed in a recording.

    Parameters
    ----------
    severity : "note", "warning" or "refused"
        A refused recording is not used: `inercal.io.audit.require_accepted` raises.
    what : str
        Short kind: "gap", "saturation", ...
    message : str
        One clear line.
    channel : str or None
        The channel concerned, or None for all.
    start, stop : int or None
        Half-open range of samples, or None for the whole recording.
    """

    severity: Severity
    what: str
    message: str
    channel: str | None = None
    start: int | None = None
    stop: int | None = None


@dataclass(frozen=True)
class Mark:
    """Samples `start` to `stop`, half open, belong to the step `label`."""

    label: str
    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples of one run, with labels, bench readback and provenance.

    Parameters
    ----------
    time : (n,) array
        s, of each sample.
    data : (..., n, m) array
        Readings in output units, as they came.
    channels, units : tuple of m str
        Names of the sensor's axes, and the unit of each column.
    labels : (n,) array of str or None
        Name of the section that each sample belongs to.
    temperature : (..., n) array or None
        K.
    readback : mapping of str to (..., n) array
        What the bench said of itself, SI.
    findings : tuple of Finding
        What the audit noticed.
    source, sha256 : str
        The file and its hash; empty when there is none.
    first_row : int
        Line of sample 0 in the file; 0 where samples and lines do not run in step.
    original : (n,) array of int or None
        Number of each sample in the file, where the audit dropped or sorted some.
    label_name : str
        Column of a file that labels are written to.
    time_name : str
        The same of times.
    origin : int or None
        Time 0, ns since 1970, where the file states dates.

    Raises
    ------
    InputError
        No sample, two channels of one name, or arrays whose lengths disagree.
    """

    time: Array
    data: Array
    channels: tuple[str, ...]
    units: tuple[str, ...]
    labels: NDArray[np.str_] | None = None
    temperature: Array | None = None
    readback: Mapping[str, Array] = field(default_factory=dict[str, Array])
    findings: tuple[Finding, ...] = ()
    source: str = ""
    sha256: str = ""
    first_row: int = 0
    original: Indices | None = None
    label_name: str = "label"
    time_name: str = "time"
    origin: int | None = None

    def __post_init__(self) -> None:
        n, m = self.time.size, len(self.channels)
        where = f"{self.source}: " if self.source else ""
        if self.time.ndim != 1 or n == 0:
            raise InputError(f"{where}a recording needs at least one sample")
        if len(set(self.channels)) != m or m == 0:
            raise InputError(f"{where}channels {self.channels} are not distinct names")
        if len(self.units) != m:
            raise InputError(f"{where}{len(self.units)} units for {m} channels")
        if self.data.shape[-2:] != (n, m):
            raise InputError(f"{where}data {self.data.shape} is not (..., {n}, {m})")
        if self.labels is not None and self.labels.shape != (n,):
            raise InputError(f"{where}{self.labels.size} labels for {n} samples")
        along = dict(self.readback)
        if self.temperature is not None:
            along["temperature"] = self.temperature
        for name, values in along.items():
            if values.shape[-1:] != (n,):
                raise InputError(f"{where}{name} {values.shape} is not (..., {n})")

    @property
    def duration(self) -> float:
        """Time of the last sample minus that of the first, s."""
        return float(self.time[-1] - self.time[0])

    @cached_property
    def median_step(self) -> float:
        """Median time between samples, s.

        Raises
        ------
        InputError
            A single sample, or a median step that is not positive.
        """
        steps = np.diff(self.time)
        step = float(np.median(steps, overwrite_input=True)) if steps.size else 0.0
        if not step > 0:
            raise InputError(f"{self.source or 'recording'}: time does not advance between samples")
        return step

    @property
    def rate_hz(self) -> float:
        """One over the median time between samples, Hz."""
        return 1 / self.median_step

    @cached_property
    def gaps(self) -> Indices:
        """Samples before and after each gap, (n_gaps, 2): steps above 1.5 median steps."""
        before = np.flatnonzero(np.diff(self.time) > GAP_FACTOR * self.median_step)
        return np.stack([before, before + 1], axis=-1)

    def span(self, start: int, stop: int) -> float:
        """Return the duration of samples start to stop (half open), s, by their own stamps.

        Not the number of samples times the median step: rounded stamps have a rounded median.
        """
        n = stop - start
        return float(self.time[stop - 1] - self.time[start]) * n / (n - 1)

    def where(self, sample: int) -> str:
        """Return the place of a sample in words: its line where that is known."""
        return f"line {self.first_row + sample}" if self.first_row else f"sample {sample}"

    def take(self, samples: "Indices | NDArray[np.bool_] | slice") -> "Recording":
        """Return chosen samples; findings and lines, which count samples, are left out."""
        changes: dict[str, Any] = {
            "time": self.time[samples],
            "data": self.data[..., samples, :],
            "readback": {name: values[..., samples] for name, values in self.readback.items()},
        }
        if self.labels is not None:
            changes["labels"] = self.labels[samples]
        if self.temperature is not None:
            changes["temperature"] = self.temperature[..., samples]
        return replace(self, findings=(), first_row=0, **changes)

    def slice(self, start: int, stop: int) -> "Recording":
        """Return samples start to stop (half open), with the findings that concern them."""
        start, stop, _ = slice(start, stop).indices(self.time.size)
        findings = tuple(
            f
            if f.start is None or f.stop is None
            else replace(f, start=max(f.start - start, 0), stop=min(f.stop, stop) - start)
            for f in self.findings
            if f.start is None or f.stop is None or (f.start < stop and f.stop > start)
        )
        first_row = self.first_row + start if self.first_row else 0
        return replace(self.take(slice(start, stop)), findings=findings, first_row=first_row)


def _temperature_varies(temperature: Array | None) -> bool:
    if temperature is None:
        return False
    return float(np.ptp(temperature, axis=-1).max(initial=0.0)) > TEMPERATURE_VARIATION


@dataclass(frozen=True, eq=False)
class Transitions:
    """How the sensor was moved from one rest to the next: ranges of samples, which stay in place.

    A transition is weighed from the mean attitude of one rest to that of the next: the weight of a
    sample rises from 0 to 1 along samples `start` to `left`, and falls along `reached` to `stop`.

    Parameters
    ----------
    time : (n,) array
        s, of each sample of the recording.
    output : (n, m) array
        Readings of the sensor's axes in output units.
    rest : (k,) array of int
        Row of the observations that each transition leaves; it leads to the row after.
    start, left, reached, stop : (k,) arrays of int
        Samples; `left` is the last one of the rest before, `reached` the first one of the rest
        after, `stop` the last one of the transition.
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
        """Effective duration of each transition, (k,) s: what a constant rate turns through."""
        t = self.time
        ends = t[self.left] - t[self.start] + t[self.stop] - t[self.reached]
        return t[self.reached] - t[self.left] + 0.5 * ends


@dataclass(frozen=True, eq=False)
class HalfSectionChanges:
    """How the readings of r sections at rest change from the first half to the second.

    Parameters
    ----------
    change : (r, m) array
        Mean of the second half less that of the first, output units.
    integral : (r, m) array
        Of the readings over time, with the weight by which a rate turns the one mean attitude into
        the other: from 0 to 1 across the first half, and back; output units times s.
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
    """How well a table's angles are known at each sample, where a host interpolated its readings.

    `noise_gain` is the sum of the squares of the interpolation's weights: the variance of the
    angles' noise over that of one reading. A filter uses no angle whose gain is infinite.
    `interpolation_sd` is infinite where nothing bounds what the table did between two readings.
    """

    noise_gain: Array  # (n,)
    interpolation_sd: Array  # (n,) rad

    def where(self, rows: "NDArray[np.bool_] | Indices | slice") -> "AngleQuality":
        """Return the quality at some of the samples."""
        return AngleQuality(self.noise_gain[rows], self.interpolation_sd[rows])


@dataclass(frozen=True, eq=False)
class Track:
    """The samples of a turntable's run in SI, for methods that follow them one by one.

    Parameters
    ----------
    time : (n,) array
        s, by the sensor's clock.
    reading : (..., n, m) array
        Of the sensor's axes after the nominal readout, m/s² or rad/s.
    angles : (..., n, k) array
        Readback of the table's axes, rad, the outermost first; turns are counted on.
    hold : (n,) array of int
        Number of the hold, from 0 on, that a sample belongs to; -1 while the table moves.
    temperature : (..., n) array or None
        K.
    angle_quality : AngleQuality or None
        None where every sample has an angle of its own, read with the readback's noise.

    Raises
    ------
    InputError
        Lengths that disagree, or a temperature that is not finite.
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
            raise InputError(f"track: the quality of its angles is not of {n} samples")
        if self.reading.shape[-2] != n or self.angles.shape[-2] != n or self.hold.shape != (n,):
            raise InputError(
                f"track: {n} times, readings {self.reading.shape}, angles {self.angles.shape} and "
                f"holds {self.hold.shape} do not go together"
            )
        if self.temperature is not None:
            if self.temperature.shape[-1] != n:
                raise InputError(f"track: {self.temperature.shape} temperatures for {n} times")
            bad = np.flatnonzero(~np.isfinite(self.temperature).reshape(-1, n).all(axis=0))
            if bad.size:
                raise InputError(f"track: no temperature at {self.time[bad[0]]:.6g} s")

    def slice(self, start: int, stop: int) -> "Track":
        """Return samples start to stop (half open)."""
        at = slice(start, stop)
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

    @property
    def with_known_angles(self) -> "Track":
        """The samples at which the table's angles are known."""
        if self.angle_quality is None:
            return self
        at = np.isfinite(self.angle_quality.interpolation_sd)
        if at.all():
            return self
        return Track(
            self.time[at],
            self.reading[..., at, :],
            self.angles[..., at, :],
            self.hold[at],
            None if self.temperature is None else self.temperature[..., at],
            self.angle_quality.where(at),
        )

    def trial(self, *index: int) -> "Track":
        """Return one trial; a temperature without axes of trials is that of all."""
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
        """Whether temperatures were recorded that differ, as of `Observations`."""
        return _temperature_varies(self.temperature)


@dataclass(frozen=True, eq=False)
class Observations:
    """Means over sections of a recording: one row per hold or turn.

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
        Number of samples behind each mean.
    channels : tuple of m str
        Names of the sensor's axes.
    dof : float
        Degrees of freedom behind the covariance; infinite when it was stated.
    drift : (r, r, m) array or None
        Covariance between rows of each channel's slow drift, which `covariance` leaves out.
    rounding : (m,) array or None
        Variance that coarse steps of the channels add to each mean, within `covariance`.
    transitions : Transitions or None
        Between neighbouring rows, for methods that follow the rate from rest to rest.
    halves : HalfSectionChanges or None
        How readings change within each row, for sensors in a hand that have gyros.
    track : Track or None
        The samples themselves, for methods that follow them.
    tests : tuple of ModelTest
        Of the sections against themselves, where a recording was averaged.
    notes : tuple of str
        What the sections show of their noise, in words.
    timed : bool
        Whether `time` was measured; of a table of means it is the order of the rows.
    temperature : (..., r) array or None
        K, the mean over the samples of each row.

    Raises
    ------
    InputError
        Shapes that disagree, a mean, covariance or temperature that is not finite, a covariance
        that is not symmetric or has a negative variance, or a section without samples.
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
    tests: tuple[ModelTest, ...] = ()
    notes: tuple[str, ...] = ()
    timed: bool = True
    temperature: Array | None = None

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
        for name, (shape, expected) in shapes.items():
            if shape != expected:
                raise InputError(f"observations: {name} has shape {shape}, expected {expected}")
        if not self.dof > 0:
            raise InputError(f"observations: {self.dof} degrees of freedom")
        self._refuse(~np.isfinite(self.mean).all(-1), "has a mean that is not finite")
        self._refuse(~np.isfinite(self.covariance).all((-2, -1)), "has a covariance not finite")
        variance = np.diagonal(self.covariance, axis1=-2, axis2=-1)
        self._refuse((variance < 0).any(-1), "has a negative variance")
        # Rounding in a product J C Jᵀ leaves a last-bit asymmetry: judged against the variances.
        scale = np.sqrt(variance[..., :, None] * variance[..., None, :])
        skew = np.abs(self.covariance - np.swapaxes(self.covariance, -1, -2))
        self._refuse((skew > 1e-9 * scale).any((-2, -1)), "has a covariance that is not symmetric")
        self._refuse(self.samples < 1, "has no samples")
        if self.temperature is not None:
            self._refuse(~np.isfinite(self.temperature), "has a temperature that is not finite")

    def _refuse(self, bad: NDArray[np.bool_] | np.bool_, what: str) -> None:
        rows = np.flatnonzero(np.reshape(bad, (-1, len(self.labels))).any(0))
        if rows.size:
            raise InputError(f"observations: {self.labels[rows[0]]} (row {rows[0] + 1}) {what}")

    @property
    def full_covariance(self) -> Array:
        """Covariance of all readings, drift included, (..., r·m, r·m); row after row."""
        r, m = self.mean.shape[-2:]
        full = np.zeros((*self.covariance.shape[:-3], r, m, r, m))
        for k in range(r):
            full[..., k, :, k, :] = self.covariance[..., k, :, :]
        if self.drift is not None:
            for a in range(m):
                full[..., :, a, :, a] += self.drift[..., a]
        return full.reshape(*full.shape[:-4], r * m, r * m)

    def temperature_offset(self, reference: float) -> Array:
        """Return the temperature of each row minus a reference, (..., r) K; () of 0 without one."""
        return np.zeros(()) if self.temperature is None else self.temperature - reference

    @property
    def temperature_varies(self) -> bool:
        """Whether temperatures were recorded that differ by more than a sensor of them errs by."""
        return _temperature_varies(self.temperature)

    def rows(self, at: Sequence[int]) -> "Observations":
        """Return some rows, without what lies between rows or within them."""
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
        )


def join_observations(one: Observations, other: Observations) -> Observations:
    """Return the rows of both, of the same channels; drift between them is taken as independent.

    Without the temperature of either there is none.
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
