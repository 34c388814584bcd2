"""Read the angles of the table from columns of the recording or from a separate file.

The waits between soaks are left out, because the model does not hold during fast changes.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from math import pi
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.units import Measured, format_count, format_duration, format_quantity
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.host_readback import (
    HostReadback,
    Interruption,
    are_interrupted,
    describe_interruptions,
    read_host_readback,
)
from inercal.benches.turntable.reading.implied_rates import rate_vectors
from inercal.benches.turntable.reading.readback_clock import (
    MAX_CLOCK_OFFSET,
    ClockAlignment,
    align_readback,
)
from inercal.benches.turntable.settings import HOLD_COLUMN, TurntableData
from inercal.physics.section_settings import si_value
from inercal.recordings import AngleQuality, Finding, Recording
from inercal.recordings.data import RunBase, recording_loader
from inercal.recordings.environment import Environment
from inercal.recordings.io.audit import gap_findings
from inercal.recordings.io.read import Columns, read_readback
from inercal.recordings.soaks import SOAK_SPREAD

# The clocks are compared using the same turns that the filter uses. The filter therefore gets
# larger standard deviations than were found, so that these turns do not count twice.
_LOOSER = 3.0
_LONG = 0.5  # s without a reading: no cubic can follow a change of rate during this time
_SLOWEST = 0.0505  # s between readings: 20 per second with some jitter
_MOVED = np.radians(0.1)
_KEY = "[data] table_file"


@dataclass(frozen=True, eq=False)
class RecordingWithAngles:
    """A recording with the table's angles at the times of its samples.

    Parameters
    ----------
    recording : Recording
        Recording with the cumulative readback in rad.
    bench : Turntable
        Bench with the remaining uncertainty of the readback's delay, if the clocks were compared.
    clock : ClockAlignment or None
        Alignment of the table's clock with the recording's clock; None if they are the same.
    quality : AngleQuality or None
        Uncertainty of the angles at each sample, if a bench host interpolated its readings.
    interruptions : tuple of Interruption
        Interruptions of the run, if a bench host stated them.
    """

    recording: Recording
    bench: Turntable
    clock: ClockAlignment | None = None
    quality: AngleQuality | None = None
    interruptions: tuple[Interruption, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about the interruptions and the estimate of the table's clock."""
        if (clock := self.clock) is None:
            return tuple(filter(None, [describe_interruptions(self.interruptions)]))
        size = replace(clock, offset=abs(clock.offset), drift=abs(clock.drift))
        offset, drift = describe_clock(size).values()
        where = "ahead of" if clock.offset > 0 else "behind"
        return (
            f"the table's clock is {offset} {where} the sensor's at the first sample and "
            f"{'gains' if clock.drift > 0 else 'loses'} {drift}; the readback was interpolated to "
            "the sensor's times",
        )


def describe_clock(clock: ClockAlignment) -> dict[str, str]:
    """Describe the offset and drift of a table's clock with units and k = 1 uncertainties."""
    unit = "ms" if abs(clock.offset) < MAX_CLOCK_OFFSET else "s"
    return {
        "table's clock ahead (k = 1)": format_quantity(clock.offset, clock.offset_sd, unit),
        "table's clock gains (k = 1)": format_quantity(clock.drift, clock.drift_sd, "ppm"),
    }


def add_table_angles(
    run: RunBase[TurntableData], recording: Recording, bench: Turntable
) -> RecordingWithAngles:
    """Return the recording with the table's angles.

    Raises
    ------
    InputError
        The file of the readback cannot be used.
    ClockMismatch
        The motion in the file differs from the motion in the recording.
    """
    sizes = recording_loader.readback_units(run)
    if run.data.table_file is None:
        if run.data.hold is not None:
            # The angles from a bench host are cumulative, even across outages.
            counted = {name: recording.readback[name] * sizes[name] for name in bench.names}
            counted[HOLD_COLUMN] = recording.readback[HOLD_COLUMN]
            host = read_host_readback(run.file(run.data.file), recording)
            findings = (*_without_interruptions(recording, host), *host.findings)
            complete = replace(recording, readback=counted, findings=findings)
            return RecordingWithAngles(
                complete, bench, quality=host.quality, interruptions=host.interruptions
            )
        unwrapped = _unwrap_angles(recording.readback, bench, sizes)
        return RecordingWithAngles(replace(recording, readback=unwrapped), bench)
    table = _read_table_file(run, recording.origin)
    columns = dict(zip(table.channels, table.data.T, strict=True))
    angles = np.stack(list(_unwrap_angles(columns, bench, sizes).values()), axis=-1)
    try:
        _require_readings(table.time, angles)
        rates = _gyro_readings(run, recording)
        clock = align_readback(
            bench, recording.time, rates, table.time, angles, bench.latency.value
        )
    except InputError as error:  # a ClockMismatch keeps its angles
        where = f"{run.path}: {_KEY}: {run.data.table_file}"
        raise error.located(where, file=run.file(run.data.table_file), key=_KEY) from None
    # The sample numbers in these findings refer to the table's file.
    findings = [
        replace(finding, message=f"{table.source}: {finding.message}", start=None, stop=None)
        for finding in table.findings
    ]
    remaining = replace(
        bench, latency=Measured(0.0, _LOOSER * clock.offset_sd), clock=_LOOSER * clock.drift_sd
    )
    readback = dict(zip(bench.names, clock.angles.T, strict=True))
    result = replace(recording, readback=readback, findings=(*recording.findings, *findings))
    return RecordingWithAngles(result, remaining, clock)


def _without_interruptions(recording: Recording, host: HostReadback) -> tuple[Finding, ...]:
    """Return the findings of a recording without gaps that are due to interruptions."""
    if not host.interruptions:
        return recording.findings
    ends = recording.time[recording.gaps]
    left = recording.gaps[~are_interrupted(ends[:, 0], ends[:, 1], host.interruptions)]
    others = [finding for finding in recording.findings if finding.what != "gap"]
    return (*others, *gap_findings(recording, left))


def _read_table_file(run: RunBase[TurntableData], origin: Fraction | None) -> Recording:
    """Read the table's file, with the axes as channels in the units of their columns.

    Times are counted from the `origin` of the recording. Without an origin, the times are those of
    the clock of the file, and [bench] latency states how far that clock is ahead.
    """
    data = run.data
    assert data.table_file is not None
    si_value(f"1 {data.table_time_unit}", "s", f"{run.path}: [data] table_time_unit")
    columns = Columns(
        channels=recording_loader.readback_fields(run),
        time=str(data.table_time),
        time_unit=data.table_time_unit if "table_time_unit" in data.model_fields_set else None,
        time_keys=("table_time_unit", None),
        origin=Fraction(0) if origin is None else origin,
        nonfinite=data.nonfinite,
        options=recording_loader.file_reader_options(run, data.table_file),
    )
    with error_location(f"{run.path}: {_KEY}", key=_KEY):
        return read_readback(run.file(data.table_file), columns)


def _unwrap_angles(
    readback: Mapping[str, Array], bench: Turntable, sizes: Mapping[str, float]
) -> dict[str, Array]:
    """Return the cumulative angles of the axes, rad."""
    result: dict[str, Array] = {}
    for name in bench.names:
        angle = readback[name] * sizes[name]
        # If samples are missing, unwrapping cumulative angles would remove turns.
        result[name] = np.unwrap(angle) if np.ptp(angle) <= 2 * pi * (1 + 1e-6) else angle
    return result


def _gyro_readings(run: RunBase[TurntableData], recording: Recording) -> Array:
    """Return the gyros' readings, (n, 3) rad/s."""
    if run.sensor.rank("w") < len("xyz"):
        count = format_count(len(run.sensor.input_axes("w")), "gyro")
        raise InputError(
            "the clock offset of the readback is estimated from gyros in three directions, but the "
            f"sensor has {count}; name three in [sensor.gyro], or write the readback into the "
            "recording"
        )
    places = [recording.channels.index(name) for name in run.sensor.channels]
    return rate_vectors(run.sensor, run.sensor.to_si(recording.data[:, places]))


def _require_readings(time: Array, angles: Array) -> None:
    """Refuse a readback that is too slow or has a gap while the table turns."""
    step = float(np.median(np.diff(time)))
    if step > _SLOWEST:
        raise InputError(
            f"the readback has {1 / step:.3g} readings per second; record at least 20, because "
            "fewer do not show when moves begin and end"
        )
    at = np.flatnonzero(np.diff(time) > _LONG)
    moved = np.abs(angles[at + 1] - angles[at]).max(axis=-1, initial=0.0)
    lost = at[moved > _MOVED]
    if lost.size:
        k = int(lost[0])
        raise InputError(
            f"the readback has a gap of {format_duration(time[k + 1] - time[k])} after "
            f"{time[k]:.6g} s while the table turns; record again, or cut both files at this time"
        )


class SoakWaits(NamedTuple):
    """The waits that were left out of a recording, and the first sample of each soak in it."""

    waits: tuple[Interruption, ...] = ()
    first_samples: tuple[int, ...] = (0,)


def without_waits(
    read: RecordingWithAngles, environment: Environment | None
) -> tuple[RecordingWithAngles, SoakWaits]:
    """Return a recording over soaks without the waits.

    A wait is a period without a label in which the temperature changes by more than 3 K. After it,
    the filters take the attitude from the readback, and continue with the same states.
    """
    recording = read.recording
    labels, kelvin = recording.labels, recording.temperature
    if environment is None or environment.kind != "soaks" or labels is None or kelvin is None:
        return read, SoakWaits()
    blank = np.concatenate([[False], np.char.strip(labels) == "", [False]])
    edges = np.flatnonzero(np.diff(blank.astype(np.int8))).reshape(-1, 2)
    kept, waits, firsts = np.ones(labels.size, np.bool_), list[Interruption](), [0]
    for start, stop in edges.tolist():
        if np.ptp(kelvin[start:stop]) > SOAK_SPREAD:
            kept[start:stop] = False
            ends = [max(start - 1, 0), min(stop, labels.size - 1)]
            begin, end = recording.time[ends].tolist()
            waits.append(Interruption(begin, end, "the temperature changed"))
            if abs(np.diff(kelvin[ends])) > SOAK_SPREAD:
                firsts.append(int(np.count_nonzero(kept[:stop])))
    if not waits:
        return read, SoakWaits()
    original = np.arange(labels.size) if recording.original is None else recording.original
    shorter = replace(
        recording.take(kept),
        first_row=recording.first_row,
        line_breaks=recording.line_breaks,
        original=original[kept],
        # The sample numbers in these findings refer to the whole recording.
        findings=tuple(replace(one, start=None, stop=None) for one in recording.findings),
    )
    quality = None if read.quality is None else read.quality.where(kept)
    found = SoakWaits(tuple(waits), tuple(firsts))
    return replace(read, recording=shorter, quality=quality), found
