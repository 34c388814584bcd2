"""Recorded samples of a run, marks for its sections, and findings of its checks."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.basics.run_file_advice import Change
from inercal.basics.units import format_count
from inercal.recordings.io.column_table import LineBreaks, line_of_row

Severity = Literal["note", "warning", "refused"]
TIME_UNIT = "time unit"  # `Finding.what` for a unit of time that nobody stated
STANDARD_GRAVITY = "standard gravity"  # for standard gravity stated as local gravity
INVALID_SAMPLES = ("saturation", "stuck")
"""Kinds of findings about samples that do not contain what the sensor measured."""
_APART = 5  # up to this many messages with the same cause are listed separately
_LISTED = 12  # number of places that a merged message lists


@dataclass(frozen=True)
class Finding:
    """A finding in a recording.

    Parameters
    ----------
    severity : "note", "warning" or "refused"
        A refused recording is not used: `inercal.recordings.io.audit.require_accepted` raises an
        error for it.
    what : str
        Kind of finding: "gap", "saturation", ...
    message : str
        The message, in one clear line.
    channel : str or None
        The affected channel; None if the finding concerns all channels.
    start, stop : int or None
        Half-open range of affected samples; None if the finding concerns all samples.
    changes : tuple of Change
        Changes of run-file keys that would remove the finding.
    factor : float or None
        The stated standard deviation divided by the one found, if the stated noise contradicts the
        data.
    merged : tuple of Finding
        The individual findings, if this finding summarizes several.
    cause : str
        The most likely cause; no other cause can be tested while this one is present.
    """

    severity: Severity
    what: str
    message: str
    channel: str | None = None
    start: int | None = None
    stop: int | None = None
    changes: tuple[Change, ...] = ()
    factor: float | None = None
    merged: tuple["Finding", ...] = ()
    cause: str = ""


def merge_findings(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Merge the findings that belong to the same event; keep the order of first appearance.

    Two findings of the same severity and kind belong to the same event if their messages are equal,
    or if they concern overlapping samples of the same channel.
    """
    groups: list[list[Finding]] = []
    for one in findings:
        for group in groups:
            if any(_is_of_one_event(one, other) for other in group):
                group.append(one)
                break
        else:
            groups.append([one])
    return tuple(_merged(group) for group in groups)


def _is_of_one_event(one: Finding, other: Finding) -> bool:
    if (one.severity, one.what) != (other.severity, other.what) or one.factor != other.factor:
        return False
    if one.message == other.message:
        return True
    if one.channel != other.channel or one.start is None or other.start is None:
        return False
    return one.start < (other.stop or 0) and other.start < (one.stop or 0)


def _merged(group: Sequence[Finding]) -> Finding:
    """Return one finding that summarizes several findings about the same event."""
    first = group[0]
    if len(group) == 1:
        return first
    every = tuple(part for one in group for part in (one.merged or (one,)))
    starts = [one.start for one in every if one.start is not None]
    stops = [one.stop for one in every if one.stop is not None]
    whole = len(starts) == len(stops) == len(every)
    return replace(
        first,
        message="; ".join(merge_messages([one.message for one in every])),
        channel=first.channel if len({one.channel for one in every}) == 1 else None,
        start=min(starts) if whole else None,
        stop=max(stops) if whole else None,
        changes=next((one.changes for one in every if one.changes), ()),
        merged=every,
    )


def merge_messages(messages: Sequence[str]) -> tuple[str, ...]:
    """Return the messages without repetition, in order of first appearance.

    Identical messages are replaced by one that states how often it occurred. The text after the
    first colon is the cause. More than five messages with the same cause are replaced by one that
    lists all their places.
    """
    by_cause: dict[str, list[str]] = {}
    for message in messages:
        place, _, cause = message.partition(": ")
        by_cause.setdefault(cause or place, []).append(message)
    result: list[str] = []
    for cause, group in by_cause.items():
        distinct = list(dict.fromkeys(group))
        if len(distinct) <= _APART:
            result += [
                f"{one} ({group.count(one)} times)" if group.count(one) > 1 else one
                for one in distinct
            ]
            continue
        places = [one.removesuffix(f": {cause}") for one in distinct]
        more = f" and {len(places) - _LISTED} more" if len(places) > _LISTED else ""
        result.append(f"{', '.join(places[:_LISTED])}{more}: {cause}")
    return tuple(result)


STAMP_ROUNDING = 2e-6  # s; stamps in whole µs, or float64 s since 1970, are rounded by less
GAP_FACTOR = 1.5  # samples are missing where a time step exceeds this many median steps


def sample_count(seconds: float, step: float) -> int:
    """Return the number of samples in a time span; rounding of the stamps does not change it.

    >>> [sample_count(0.1, step) for step in (0.04, 0.0399999)]
    [2, 2]
    """
    return round(round(seconds / step, 2))


def mean_step(time: Array) -> float:
    """Return the mean time between samples outside gaps, in the unit of the times, (n,).

    The median of rounded steps may be wrong by half the rounding.

    >>> mean_step(np.array([0.0, 10.0, 20.0, 29.0, 39.0, 100.0, 110.0]))
    9.8
    """
    steps = np.diff(time)
    return float(np.mean(steps[(steps >= 0) & (steps <= GAP_FACTOR * np.median(steps))]))


@dataclass(frozen=True)
class Mark:
    """A range of samples, `start` to `stop` (half open), that belongs to the plan step `label`."""

    label: str
    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples of one run, with labels, bench readback and provenance.

    Parameters
    ----------
    time : (n,) array
        Time of each sample, s, counted from the first row of the file (absolute times need too many
        digits).
    data : (..., n, m) array
        Readings in output units.
    channels, units : tuple of m str
        Names of the sensor's axes, and the unit of each column.
    labels : (n,) array of str or None
        Name of the section that each sample belongs to.
    temperature : (..., n) array or None
        Temperature of each sample, K.
    readback : mapping of str to (..., n) array
        Quantities that the bench itself measured, SI.
    findings : tuple of Finding
        Findings from the audit.
    source, sha256 : str
        Name of the file and its hash; empty if there is no file.
    first_row : int
        Line of sample 0 in the file; 0 if sample k is not in line first_row + k.
    line_breaks : tuple of (sample, line)
        If first_row is 0: sample 0 and all samples that are not on the line after the preceding
        sample, for example after a blank line. Empty if the lines are unknown.
    original : (n,) array of int or None
        Number of each sample in the file, if the audit dropped or sorted samples.
    label_name : str
        Name of the column for labels when the recording is written.
    time_name : str
        Name of the column for times when the recording is written.
    origin : Fraction or None
        Time 0 on the file's clock, ns, counted from 1970 if the file states dates; None without a
        clock.
    first_stamp : float
        Time stamp that a written file uses for time 0, s, as in the file that was read; 0 for
        dates.
    kept_corrections : str
        Corrections that another program has already applied to the readings, with its parameters;
        empty if none are known.
    devices : str
        The sensors from which the readings come, with the numbers that their controller gave them;
        empty if unknown.
    simulation : str
        The simulation that produced the samples, such as "simulation of run.toml, seed 0"; empty if
        the file does not state one.

    Raises
    ------
    InputError
        There are no samples, two channels have the same name, or arrays have unequal lengths.
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
    line_breaks: LineBreaks = ()
    original: Indices | None = None
    label_name: str = "label"
    time_name: str = "time"
    origin: Fraction | None = None
    first_stamp: float = 0.0
    kept_corrections: str = ""
    devices: str = ""
    simulation: str = ""

    def __post_init__(self) -> None:
        n, m = self.time.size, len(self.channels)
        if self.time.ndim != 1 or n == 0:
            self._refuse("time", "a recording needs at least one sample")
        if len(set(self.channels)) != m or m == 0:
            self._refuse("channels", f"channels must have distinct names, not {self.channels}")
        if len(self.units) != m:
            self._refuse(
                "units", f"{format_count(len(self.units), 'unit')} for {format_count(m, 'channel')}"
            )
        if self.data.shape[-2:] != (n, m):
            self._refuse("data", f"data must have the shape (..., {n}, {m}), not {self.data.shape}")
        if self.labels is not None and self.labels.shape != (n,):
            self._refuse("labels", f"{format_count(self.labels.size, 'label')} for {n} samples")
        along = dict(self.readback)
        if self.temperature is not None:
            along["temperature"] = self.temperature
        for name, values in along.items():
            if values.shape[-1:] != (n,):
                self._refuse(name, f"{name} must have the shape (..., {n}), not {values.shape}")

    def _refuse(self, key: str, what: str) -> NoReturn:
        where = f"{self.source}: " if self.source else ""
        raise InputError(where + what, file=self.source or None, key=key)

    @property
    def stamps(self) -> Array:
        """Times on the clock of the original file, (n,) s, for display and for writing."""
        return self.time + self.first_stamp

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.time[-1] - self.time[0])

    @cached_property
    def median_step(self) -> float:
        """Median time between samples, s.

        Raises
        ------
        InputError
            There is only one sample, or the median step is not positive.
        """
        steps = np.diff(self.time)
        step = float(np.median(steps, overwrite_input=True)) if steps.size else 0.0
        if not step > 0:
            raise InputError(
                f"{self.source or 'recording'}: time has {self.time.size} samples, and the median "
                f"step is {step:g} s; it must be above 0: check the column of times",
                file=self.source or None,
                key="time",
            )
        return step

    @property
    def rate_hz(self) -> float:
        """Sampling rate, 1 divided by the median time between samples, Hz."""
        return 1 / self.median_step

    @property
    def mean_rate_hz(self) -> float:
        """Mean sampling rate outside gaps, Hz; it is right even if the stamps are rounded."""
        return 1 / mean_step(self.time)

    @cached_property
    def gaps(self) -> Indices:
        """Samples before and after each gap, (n_gaps, 2): each step above 1.5 median steps."""
        before = np.flatnonzero(np.diff(self.time) > GAP_FACTOR * self.median_step)
        return np.stack([before, before + 1], axis=-1)

    def span(self, start: int, stop: int) -> float:
        """Return the duration of samples start to stop (half open) according to their stamps, s.

        The number of samples times the median step would be wrong if the stamps are rounded; only
        a single sample gets the median step.
        """
        n = stop - start
        if n < 2:
            return n * self.median_step
        return float(self.time[stop - 1] - self.time[start]) * n / (n - 1)

    def where(self, sample: int) -> str:
        """Describe where a sample is: its line if this is known, otherwise its sample number."""
        line = self.line(sample)
        return f"sample {sample}" if line is None else f"line {line}"

    def line(self, sample: int) -> int | None:
        """Return the line of a sample in the file; None if unknown."""
        return line_of_row(sample, self.first_row, self.line_breaks)

    def with_findings(self, findings: tuple[Finding, ...]) -> "Recording":
        """Return the recording with these findings; its median step and gaps stay known."""
        twin = copy(self)
        object.__setattr__(twin, "findings", findings)
        return twin

    def take(self, samples: "Indices | NDArray[np.bool_] | slice") -> "Recording":
        """Return the chosen samples, without findings and line numbers."""
        changes: dict[str, Any] = {
            "time": self.time[samples],
            "data": self.data[..., samples, :],
            "readback": {name: values[..., samples] for name, values in self.readback.items()},
        }
        if self.labels is not None:
            changes["labels"] = self.labels[samples]
        if self.temperature is not None:
            changes["temperature"] = self.temperature[..., samples]
        return replace(self, findings=(), first_row=0, line_breaks=(), **changes)

    def slice(self, start: int, stop: int) -> "Recording":
        """Return the samples from start to stop (half open), with their findings."""
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
