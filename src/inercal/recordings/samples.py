"""Samples of a run as recorded, and marks of its sections."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.basics.line_numbers import LineBreaks, line_of_row
from inercal.basics.units import format_count
from inercal.recordings.findings import Finding

STAMP_ROUNDING = 2e-6  # s: stamps in whole µs, or since 1970 in s as float64, are rounded by less
GAP_FACTOR = 1.5  # a step of time longer than this many median steps has lost samples


def sample_count(seconds: float, step: float) -> int:
    """Return the samples in a time; the rounding of stamps does not decide about half a sample.

    >>> [sample_count(0.1, step) for step in (0.04, 0.0399999)]
    [2, 2]
    """
    return round(round(seconds / step, 2))


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
        s, of each sample, from the first row of the file on: absolute times have too many digits.
    data : (..., n, m) array
        Readings in output units.
    channels, units : tuple of m str
        Names of the sensor's axes, and the unit of each column.
    labels : (n,) array of str or None
        Name of the section that each sample belongs to.
    temperature : (..., n) array or None
        K.
    readback : mapping of str to (..., n) array
        Quantities that the bench measured itself, SI.
    findings : tuple of Finding
        Findings of the audit.
    source, sha256 : str
        The file and its hash; empty without a file.
    first_row : int
        Line of sample 0 in the file; 0 where sample k is not in line first_row + k.
    line_breaks : tuple of (sample, line)
        Where first_row is 0: samples that do not follow the line of the sample before, as after a
        blank line, sample 0 included; empty where lines are not known.
    original : (n,) array of int or None
        Number of each sample in the file, where the audit dropped or sorted samples.
    label_name : str
        Column to which labels are written.
    time_name : str
        Column to which times are written.
    origin : Fraction or None
        Time 0 by the clock of the file, ns, since 1970 where it states dates; None without a clock.
    first_stamp : float
        What a written file has in place of time 0, s, as the file that was read; 0 for dates.
    kept_corrections : str
        Corrections by another program that the readings hold, with its parameters; empty where
        none are known.
    devices : str
        Which sensors the readings are of, with the numbers that their controller gave them; empty
        where it is not known.
    simulation : str
        By what the samples are known to be simulated, such as "simulation of run.toml, seed 0";
        empty where nothing says so.

    Raises
    ------
    InputError
        No sample, two channels of the same name, or arrays of unequal lengths.
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
        """Times by the clock of the file that was read, (n,) s; for display and for writing."""
        return self.time + self.first_stamp

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
            raise InputError(
                f"{self.source or 'recording'}: time has {self.time.size} samples, and the median "
                f"step is {step:g} s; it must be above 0: check the column of times",
                file=self.source or None,
                key="time",
            )
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
        """Return the duration of samples start to stop (half open), s, by their stamps.

        The number of samples times the median step would be wrong for rounded stamps.
        """
        n = stop - start
        return float(self.time[stop - 1] - self.time[start]) * n / (n - 1)

    def where(self, sample: int) -> str:
        """Return the place of a sample in words: its line if known, else its number."""
        line = self.line(sample)
        return f"sample {sample}" if line is None else f"line {line}"

    def line(self, sample: int) -> int | None:
        """Return the line of a sample in the file; None where it is not known."""
        return line_of_row(sample, self.first_row, self.line_breaks)

    def take(self, samples: "Indices | NDArray[np.bool_] | slice") -> "Recording":
        """Return chosen samples, without findings and lines, which count samples."""
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
        """Return samples start to stop (half open), with their findings."""
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
