"""Reads lines of text as they arrive.

Lines have the layout of the file that [data] names, if there is such a text file, and otherwise
that of the first lines. A header among the lines gives the places of the columns. A line that
cannot be read is counted and skipped.

Samples as they come from a source, and the columns of the run file that they need.

The readings in IMU packets get the nominal readout of the run file as they arrive.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.host.packets import Decoder, Flag, PacketLayout
from inercal.host.packets.packet_format import AXES
from inercal.host.packets.stream import CounterUnwrapper
from inercal.recordings.data import recording_loader
from inercal.recordings.io.column_table import select_columns, shorten
from inercal.recordings.io.read import Columns, detect_reader
from inercal.recordings.io.row_checks import TOO_LARGE, is_usable
from inercal.recordings.io.table_start import is_number
from inercal.recordings.io.text_layout import TextLayout, sniff_lines, uncommented
from inercal.recordings.io.wrapped_numbers import signed_counts
from inercal.recordings.temperature import is_impossible
from inercal.runfile import Run


class ArrivedRows(NamedTuple):
    """Samples.

    Parameters
    ----------
    time : (n,) array
        Times, s.
    readings : (n, m) array
        Finite readings of the axes in output units.
    kelvin : (n,) array or None
        Temperatures, K; None if the run file names no temperature.
    saturated : (n,) array of bool or None
        Samples that the device marks as saturated.
    """

    time: Array
    readings: Array
    kelvin: Array | None
    saturated: Bools | None = None

    def take(self, keep: Bools) -> "ArrivedRows":
        """Return the samples to keep."""
        kelvin = None if self.kelvin is None else self.kelvin[keep]
        saturated = None if self.saturated is None else self.saturated[keep]
        return ArrivedRows(self.time[keep], self.readings[keep], kelvin, saturated)


def stream_columns(run: Run) -> Columns:
    """Return the columns of a run whose samples come from a single source.

    Raises
    ------
    InputError
        The columns are in two files, or a column is missing or used twice.
    """
    recording_loader.require_distinct_columns(run)
    columns, wanted = recording_loader.reader_columns(run), len(run.sensor.axes)
    if len(columns.channels) < wanted:
        raise InputError(
            f"{run.path}: [data] names {len(columns.channels)} columns of a single file for the "
            f"{wanted} axes of the sensor; name one for each, without gyro_file and gyro_time",
            file=run.path,
            key="[data] accelerometer",
        )
    return columns


class ArrivedPackets:
    """Reads packets for the axes of a run file; the methods are those of `TextRows`.

    The time is that of the device, or its counter or the number of packets divided by the rate. If
    only some packets have a temperature, the others get the last one.

    Parameters
    ----------
    run : Run
    layout : PacketLayout

    Raises
    ------
    InputError
        The packets do not have an axis, the temperature or the rate that the run needs.
    """

    def __init__(self, run: Run, layout: PacketLayout):
        columns = stream_columns(run)
        kinds = {"f": iter(AXES[:3]), "w": iter(AXES[3:]), "m": iter(())}
        needed = [next(kinds[axis.measures], axis.name) for axis in run.sensor.axes]
        wanted = [*needed, *["temperature"] * (columns.temperature is not None)]
        lacking = [role for role in wanted if role not in layout.roles]
        rate = run.rate_hz or layout.rate_hz
        wrong = None
        if lacking:
            wrong = f"have no {', '.join(lacking)}; choose another preset, or correct [sensor]"
        elif recording_loader.reversed_axes(run):
            wrong = "have signs of their own; reverse an axis in their description, not in [data]"
        elif rate is None and "time" not in layout.roles:
            wrong = 'have no time; state [data] rate, such as rate = "100 Hz"'
        if wrong is not None:
            raise InputError(f"{run.path}: the packets of {layout.name!r} {wrong}", file=run.path)
        self._sensor, self._layout, self._rate = run.sensor, layout, rate or 1.0
        self._axes = [AXES.index(role) for role in needed]
        self._heated, self._allowed = columns.temperature is not None, columns.thermometer.allowed
        self._kelvin, self._packets = np.nan, 0
        self._skipped = self._failed_before = self._missing_before = 0
        self._decoder = Decoder(layout, mid_stream=True)

    @property
    def malformed(self) -> int:
        """Number of packets with a wrong checksum, or without a reading or temperature."""
        return self._skipped + self._failed_before + self._decoder.counts.failed

    @property
    def missing(self) -> int:
        """Number of packets that the counter or the clock of the device shows to be missing."""
        return self._missing_before + self._decoder.counts.lost

    def restart(self, *, mid_stream: bool) -> None:
        """See `TextRows.restart`."""
        self._failed_before, self._missing_before = self.malformed - self._skipped, self.missing
        self._decoder = Decoder(self._layout, mid_stream, self._decoder.time_zero)

    def finish(self) -> ArrivedRows | None:
        """Return None, because a packet is never complete without its end."""
        return None

    def feed(self, data: bytes) -> ArrivedRows | None:
        """Return the samples that are now complete; None if there are none."""
        packets = self._decoder.feed(data)
        if not (n := len(packets)):
            return None
        readings = packets.readings[:, self._axes]
        good, kelvin = is_usable(readings).all(axis=1), None
        if self._heated:
            there = np.isfinite(packets.temperature)
            last = np.maximum.accumulate(np.where(there, np.arange(n), -1))
            kelvin = np.where(last < 0, self._kelvin, packets.temperature[last])
            self._kelvin = float(kelvin[-1])
            good &= np.isfinite(kelvin) & ~is_impossible(kelvin, allowed=self._allowed)
        if packets.time is not None:
            time = packets.time
        elif packets.counter is not None:
            time = packets.counter / ((self._layout.step or 1.0) * self._rate)
        else:
            time = np.arange(self._packets, self._packets + n) / self._rate
        good &= np.isfinite(time)
        self._packets += n
        self._skipped += int(n - good.sum())
        output = self._sensor.to_output(readings)
        return ArrivedRows(time, output, kelvin, (packets.flags & Flag.SATURATED) > 0).take(good)


_FEW_LINES = 16  # that Python splits faster than NumPy's parser starts
_UNREAD_LINES = 10  # malformed lines before the first sample, after which the user is told
_LONGEST_LINE = 1 << 16  # bytes; more bytes without a line end are not text


class TextRows:
    """Reads lines with the columns of a run file.

    Parameters
    ----------
    run : Run
    source : str
        Name of the source, for messages.
    layout : TextLayout, optional
        Layout of the source, which then begins with its header.
    tell : callable, optional
        Function that receives a warning if the first lines cannot be read.

    Attributes
    ----------
    malformed : int
        Number of lines that were skipped.
    missing : int
        0, because lines are not counted by the device.

    Raises
    ------
    InputError
        The run file does not name the columns, or the layout does not have them. `feed` raises the
        same error if the first lines do not have them.
    """

    def __init__(
        self,
        run: Run,
        source: str,
        layout: TextLayout | None = None,
        tell: Callable[[str], None] | None = None,
    ):
        self.malformed = self.missing = 0
        self._run, self._source, self._tell = run, source, tell
        self._columns = columns = stream_columns(run)
        single = (columns.time, columns.temperature)
        self._wanted = [c for _, c, _ in columns.channels] + [c for c in single if c is not None]
        self._named = not any(map(is_number, self._wanted))  # otherwise a row may look the same
        back = recording_loader.reversed_axes(run)
        self._reversed = [k for k, axis in enumerate(run.sensor.axes) if axis.name in back]
        self._zeros = np.array([axis.readout.offset for axis in run.sensor.axes])
        self._counter = CounterUnwrapper(columns.modulus or 0.0, 0.0)
        self._unit = (
            si_factor(columns.time_unit or "s", like="s") if columns.rate_hz is None else 1.0
        )
        # Times and readings that are used as they are, so that a few lines need no more work.
        more = (self._reversed, columns.signed_bits, columns.temperature, columns.modulus)
        own_times = columns.time is not None and columns.rate_hz is None and self._unit == 1.0
        self._plain = own_times and not any(more)
        self._buffer, self._skip_lines, self._lines, self._mid_line = b"", 0, 0, False
        self._layout: TextLayout | None = None
        if layout is not None:
            self._skip_lines = layout.first_line - 1
        else:
            with suppress(InputError):  # [data] names no text file
                layout = layout_of_file(run, run.file(run.data.file))
        if layout is not None:
            self._set_layout(layout, layout.names)

    def _set_layout(self, layout: TextLayout, names: tuple[str, ...]) -> None:
        select_columns(names, self._wanted, self._source)
        self._layout, self._width = layout, len(names)
        self._places = [names.index(name) for name in self._wanted]
        kinds = [(str(k), "f8" if k in self._places else "U1") for k in range(self._width)]
        self._dtype = np.dtype(kinds)

    def restart(self, *, mid_stream: bool) -> None:
        """Forget an incomplete sample, because the next bytes do not continue the last ones.

        `mid_stream` states whether these bytes may begin in the middle of a sample.
        """
        self.malformed += bool(self._buffer.strip())
        self._buffer, self._mid_line = b"", mid_stream

    def finish(self) -> ArrivedRows | None:
        """Return the last sample if only its line end is missing."""
        return self.feed(b"\n") if self._buffer.strip() else None

    def feed(self, data: bytes) -> ArrivedRows | None:
        """Return the samples that are now complete; None if there are none."""
        if self._mid_line:  # a truncated 123.4 would be read as 3.4
            _, end, data = data.partition(b"\n")
            self._mid_line = not end
        whole, end, rest = (self._buffer + data).rpartition(b"\n")
        if len(rest) > _LONGEST_LINE:
            rest, self._mid_line = b"", True
            self.malformed += 1
        self._buffer = rest
        if not end:
            return None
        text = whole.decode("utf-8", "replace")
        lines = text.removeprefix("\ufeff").split("\n")
        layout = self._layout
        if layout is None:
            first = [line for line in lines if uncommented(line).strip()]
            if len(first) < 1 + self._named:  # only a row below it tells what a header is
                self._buffer = whole + end + rest
                return None
            layout = sniff_lines(lines if self._named else first[:1], self._source)
            self._set_layout(layout, layout.names)
            self._skip_lines = layout.first_line - 1 if self._named else 0
        if self._skip_lines:
            skipped = min(self._skip_lines, len(lines))
            lines, self._skip_lines = lines[skipped:], self._skip_lines - skipped
        plain = not (layout.form or layout.decimal_comma or layout.quoted)
        plain = plain and text.isascii() and "_" not in text  # Python reads 1_0 as 10
        numbers = self._numbers_at_once(lines, layout) if plain else None
        if numbers is None:
            numbers, index = self._numbers_one_by_one(lines, layout)
        else:
            self._lines += len(lines)
            index = range(self._lines - len(lines), self._lines)
        return self._rows(numbers, index) if len(numbers) else None

    def _numbers_at_once(self, lines: list[str], layout: TextLayout) -> Array | None:
        """Return the wanted numbers of all lines; None unless each line can be read."""
        try:
            if len(lines) <= _FEW_LINES:
                rows = [line.split(layout.delimiter) for line in lines]
                if any(len(row) != self._width for row in rows):
                    return None
                cells = np.array([float(row[k]) for row in rows for k in self._places])
                return cells.reshape(len(rows), -1)
            table = np.loadtxt(
                lines, self._dtype, comments=None, delimiter=layout.delimiter, ndmin=1
            )
        except ValueError:
            return None
        if len(table) != len(lines):  # NumPy leaves out blank lines
            return None
        return np.stack([table[str(k)] for k in self._places], axis=1)

    def _numbers_one_by_one(self, lines: list[str], layout: TextLayout) -> tuple[Array, list[int]]:
        """Return the wanted numbers of the lines that can be read, and the lines counted from 0."""
        rows: list[list[float]] = []
        index: list[int] = []
        for line in lines:
            content = layout.content(line)
            if not content or content.startswith("//"):
                continue
            cells = layout.cells(line)
            if self._named and set(self._wanted) <= set(cells):
                self._set_layout(layout, tuple(cells))  # a header, also after a restart
                continue
            self._lines += 1
            if (row := self._row(cells, layout)) is not None:
                rows.append(row)
                index.append(self._lines - 1)
                continue
            self.malformed += 1
            if self.malformed == self._lines == _UNREAD_LINES and self._tell is not None:
                self._tell(
                    f"{self._source}: the first {_UNREAD_LINES} lines do not have the numbers of "
                    f"[data] in {self._width} columns, such as {shorten(line.strip(), 60)!r}"
                )
        return np.array(rows), index

    def _row(self, cells: list[str], layout: TextLayout) -> list[float] | None:
        """Return the wanted numbers of a line; None if they cannot be read."""
        wanted = [cells[k] for k in self._places] if len(cells) == self._width else []
        if not wanted or not all(map(layout.is_number, wanted)):
            return None
        return [float(c.replace(",", ".") if layout.decimal_comma else c) for c in wanted]

    def _rows(self, numbers: Array, index: Sequence[int]) -> ArrivedRows:
        """Return the samples with possible values, and count the others."""
        columns, m = self._columns, len(self._columns.channels)
        readings = numbers[:, :m]
        if self._plain and len(numbers) <= _FEW_LINES and np.abs(numbers).max() < TOO_LARGE:
            return ArrivedRows(numbers[:, m], readings, None)
        good = np.asarray(is_usable(numbers).all(axis=1))
        if (bits := columns.signed_bits) is not None:
            good &= ((readings % 1 == 0) & (readings >= 0) & (readings < 2.0**bits)).all(axis=1)
            readings = signed_counts(readings, bits)
        for k in self._reversed:
            readings[:, k] = 2 * self._zeros[k] - readings[:, k]
        kelvin = None
        if columns.temperature is not None:
            kelvin = columns.thermometer.kelvin(numbers[:, -1])
            good &= ~is_impossible(kelvin, allowed=columns.thermometer.allowed)
        time = np.array(index, np.float64) if columns.time is None else numbers[:, m]
        rows = ArrivedRows(time, readings, kelvin)
        if not good.all():
            self.malformed += int(good.size - good.sum())
            rows = rows.take(good)
        if columns.modulus is not None:
            rows = rows._replace(time=self._counter.unwrap(rows.time)[0])
        if columns.rate_hz is not None:
            return rows._replace(time=rows.time / columns.rate_hz)
        return rows if self._unit == 1.0 else rows._replace(time=rows.time * self._unit)


def layout_of_file(run: Run, path: Path) -> TextLayout:
    """Return the layout of a text file below the lines that [data] skip leaves out.

    Raises
    ------
    InputError
        The file cannot be read, or is not such text.
    """
    if (found := detect_reader(path).name) != "text":
        raise InputError(f"{path} is a {found} file, not text; name it in [data] and use --out")
    skip = run.reader_options.get("skip", 0)
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return sniff_lines(file, path.name, skip if isinstance(skip, int) else 0)
