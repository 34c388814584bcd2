"""Read a recording at rest block by block, because it is too long for the memory.

Columns, units and rate are found from the first rows, as for a short recording. If there is a
column of times, every step is compared with the typical step in the first rows. Gaps of one or two
samples are closed up; longer gaps split the recording.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import cast

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.noise import NoiseStream
from inercal.noise.pieces import FEW_LOST, JITTER, LOST_SHARE
from inercal.pipeline.drafts.rest_recording import RestLayout, require_used_keys, rest_layout
from inercal.pipeline.drafts.stated_keys import stated_options, stated_values
from inercal.recordings.io.long_tables import LongTable, open_long_table
from inercal.recordings.io.time_stamps import times_from_origin
from inercal.recordings.io.wrapped_numbers import signed_counts, unwrap_stamps

LONG_VALUES = 1 << 26
"""Number of values (rows times columns) above which a recording is analysed in blocks."""


@dataclass(frozen=True)
class LongRestRecording:
    """A log of a sensor at rest that is read in blocks.

    Parameters
    ----------
    table : LongTable
    layout : RestLayout
    """

    table: LongTable
    layout: RestLayout

    def stream(self) -> NoiseStream:
        """Read the whole log into a noise stream, in SI units.

        Raises
        ------
        InputError
            If a value is not finite, if times do not increase or jitter too much, or if too many
            samples were lost.
        """
        columns, source = self.layout.columns, str(self.table.path)
        stamped = columns.time is not None and columns.rate_hz is None
        names = [column for _, column, _ in columns.channels]
        warm = [] if columns.temperature is None else [columns.temperature]
        wanted = [*names, *warm, *([columns.time] if stamped and columns.time is not None else [])]
        offsets = np.array([one.offset for one in self.layout.readouts])
        scales = np.array([one.scale for one in self.layout.readouts])
        blocks = _finite(self.table.read(wanted), source)
        if stamped and columns.modulus is not None:
            blocks = _unwrapped(blocks, columns.modulus)
        first = next(blocks, np.zeros((0, len(wanted))))
        clock = None
        if stamped:
            unit = si_factor(columns.time_unit or "s", like="s")
            clock = _Clock(first[:, -1], unit, source)
        dt = 1 / (columns.rate_hz or 1.0) if clock is None else clock.dt
        axes = [axis for axis, _, _ in columns.channels]
        stream = NoiseStream(dt, axes, self.layout.units, source)
        read = 0
        for block in chain([first], blocks):
            counts = block[:, : len(names)]
            if columns.signed_bits is not None:
                counts = signed_counts(counts, columns.signed_bits)
            values = (counts - offsets) / scales
            kelvin = None
            if warm:
                kelvin = columns.thermometer.possible_kelvin(
                    block[:, len(names)],
                    warm[0],
                    lambda row, before=read: f"row {before + row + 1}",
                    source,
                )
            read += len(block)
            if clock is None:
                stream.add(values, kelvin)
            else:
                clock.add(block[:, -1], values, kelvin, stream)
        if clock is not None:
            clock.finish(stream)
        return stream


def open_long_rest_recording(
    log: Path, stated: Mapping[str, str], most_values: int | None = None
) -> LongRestRecording | None:
    """Open a log that is too long for the memory; return None for a short log.

    Parameters
    ----------
    log : Path
        Plain text, Parquet, .npz or HDF5 file in which all columns are numbers; other files are
        always read at once.
    stated : mapping of str to str
        As for `read_rest_recording`.
    most_values : int, optional
        Largest number of values in a short log, `LONG_VALUES` by default.

    Raises
    ------
    InputError
        As `read_rest_recording`.
    """
    require_used_keys(stated)
    skip = cast("int", stated_options(stated_values(stated), log).get("skip", 0))
    table = open_long_table(log, LONG_VALUES if most_values is None else most_values, skip)
    if table is None:
        return None
    if stated.get("data.nonfinite", "refuse") != "refuse":
        raise InputError(
            f"{log}: a recording of {table.rows:.2g} rows is analysed in blocks, so rows that are "
            "not finite cannot be dropped: remove data.nonfinite",
            key="data.nonfinite",
        )
    return LongRestRecording(table, rest_layout(log, table.head(), stated))


def _unwrapped(blocks: Iterator[Array], modulus: float) -> Iterator[Array]:
    """Yield the blocks with unwrapped stamps, which are in the last column."""
    before, restarts = np.zeros(0), 0.0
    for block in blocks:
        stamps = np.concatenate([before, block[:, -1]])
        found = unwrap_stamps(stamps, modulus) + restarts * modulus
        before, restarts = stamps[-1:], round(float(found[-1] - stamps[-1]) / modulus)
        block[:, -1] = found[found.size - len(block) :]
        yield block


def _finite(blocks: Iterator[Array], source: str) -> Iterator[Array]:
    """Yield the blocks, and refuse values that are not finite."""
    row = 0
    for block in blocks:
        bad = np.flatnonzero(~np.isfinite(block).all(axis=1))
        if bad.size:
            raise InputError(
                f"{source} row {row + int(bad[0]) + 1}: a value is missing or not finite; "
                "remove the row, which is then treated as a gap",
                file=source,
            )
        row += len(block)
        yield block


class _Clock:
    """Follows the times of the samples from block to block.

    Parameters
    ----------
    first : (k,) array
        Time stamps of the first block.
    unit : float
        Unit of the time column, in s.
    source : str
    """

    def __init__(self, first: Array, unit: float, source: str):
        time, self._origin = times_from_origin(first, unit)
        steps = np.diff(time)
        middle = float(np.median(steps)) if steps.size else 0.0
        if not middle > 0:
            raise InputError(f"{source}: the times do not increase", file=source)
        plain = np.rint(steps / middle) == 1
        spread = 1.4826 * float(np.median(np.abs(steps[plain] - np.median(steps[plain]))))
        if spread > JITTER * middle:
            raise InputError(
                f"{source}: the times jitter by more than {JITTER:g} of the sampling interval, "
                "and the recording is too long to average by time: analyse parts of it",
                file=source,
            )
        self.dt = float(steps[plain].mean())
        self._unit, self._source = unit, source
        self._last = -self.dt
        self._plain_time, self._plain_steps = 0.0, 0
        self._closed, self._closed_gaps, self._rows = 0, 0, 0

    def add(self, stamps: Array, values: Array, kelvin: Array | None, stream: NoiseStream) -> None:
        """Pass the samples and temperatures of a block to the stream, split at gaps."""
        time, _ = times_from_origin(stamps, self._unit, self._origin)
        steps = np.diff(time, prepend=self._last)
        if (bad := np.flatnonzero(~(steps > 0))).size:
            raise InputError(
                f"{self._source} row {self._rows + int(bad[0]) + 1}: time does not increase: the "
                "clock was reset; split or repair the file there",
                file=self._source,
            )
        lost = np.rint(steps / self.dt).astype(np.int64) - 1
        plain = lost < 1
        plain[0] &= self._rows > 0
        self._plain_time += float(steps[plain].sum())
        self._plain_steps += int(np.count_nonzero(plain))
        few = (lost >= 1) & (lost <= FEW_LOST)
        self._closed += int(lost[few].sum())
        self._closed_gaps += int(np.count_nonzero(few))
        begins = np.flatnonzero(lost > FEW_LOST)
        bounds = [0, *begins.tolist(), time.size]
        for k, (a, b) in enumerate(pairwise(bounds)):
            if k:
                stream.begin_piece(float(time[a]))
            stream.add(values[a:b], None if kelvin is None else kelvin[a:b])
        self._last = float(time[-1])
        self._rows += time.size

    def finish(self, stream: NoiseStream) -> None:
        """Set the mean sampling interval, and report the gaps that were closed up.

        Raises
        ------
        InputError
            If more samples were lost than may be closed up.
        """
        stream.duration = self._last
        if self._plain_steps:
            stream.dt = self._plain_time / self._plain_steps
        if not self._closed:
            return
        share = self._closed / (self._rows + self._closed)
        if share > LOST_SHARE:
            raise InputError(
                f"{self._source}: {100 * share:.2g} % of the samples were lost in short gaps, but "
                f"at most {100 * LOST_SHARE:g} % can be closed up: record without losses",
                file=self._source,
            )
        stream.remarks.append(
            f"{self._closed} lost samples ({100 * share:.2g} %) in {self._closed_gaps} gaps of at "
            f"most {FEW_LOST} were closed up"
        )
