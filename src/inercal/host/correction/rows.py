"""Read samples as they arrive from a source, and find the columns that the run file needs.

The readings in IMU packets get the nominal readout of the run file as they arrive.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.host.packets import Decoder, Flag, PacketLayout
from inercal.host.packets.packet_format import AXES
from inercal.recordings.data.recording_loader import (
    reader_columns,
    require_distinct_columns,
    reversed_axes,
)
from inercal.recordings.io.read import Columns
from inercal.recordings.io.row_checks import is_usable
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
    require_distinct_columns(run)
    columns, wanted = reader_columns(run), len(run.sensor.axes)
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
        elif reversed_axes(run):
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
