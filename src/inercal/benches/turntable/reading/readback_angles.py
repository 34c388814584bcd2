"""The angles that a run goes by: columns of the recording, or of a file with a clock of its own."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from inercal.arrays import Array
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.host_readback import read_host_readback
from inercal.benches.turntable.reading.readback_clock import (
    MAX_CLOCK_OFFSET,
    ClockAlignment,
    ClockMismatch,
    align_readback,
)
from inercal.benches.turntable.settings import HOLD_COLUMN, TurntableData
from inercal.data import Source
from inercal.data.recording_loader import file_reader_options, readback_fields, readback_units
from inercal.errors import InputError
from inercal.io.read import Columns, read_readback
from inercal.recording import AngleQuality, Recording
from inercal.section_settings import si_value
from inercal.units import Measured, format_quantity

# Both clocks are compared by the same turns that a filter goes by: it is told less than was found,
# so that they do not count twice.
_LOOSER = 3.0
_LONG = 0.5  # s without a reading: no cubic goes through a change of rate in it
_SLOWEST = 0.0505  # s between readings: 20 a second and their jitter
_MOVED = np.radians(0.1)


@dataclass(frozen=True, eq=False)
class RecordingWithAngles:
    """A recording with the table's angles at its times.

    Parameters
    ----------
    recording : Recording
        Its readback in rad, turns counted on.
    bench : Turntable
        With what is left of the readback's delay, where the clocks were compared.
    clock : ClockAlignment or None
        How the table's clock goes against the recording's; None where both are one.
    quality : AngleQuality or None
        How well the angles are known, where a bench host interpolated them.
    """

    recording: Recording
    bench: Turntable
    clock: ClockAlignment | None = None
    quality: AngleQuality | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found of the table's clock, in plain words."""
        if self.clock is None:
            return ()
        one = self.clock
        offset, drift = describe_clock(
            replace(one, offset=abs(one.offset), drift=abs(one.drift))
        ).values()
        where = "ahead of" if one.offset > 0 else "behind"
        return (
            f"the table's clock is {offset} {where} the sensor's at the first sample and "
            f"{'gains' if one.drift > 0 else 'loses'} {drift}; the readback was brought to the "
            "sensor's times",
        )


def describe_clock(clock: ClockAlignment) -> dict[str, str]:
    """Return offset and drift of a table's clock in words with units, k = 1."""
    unit = "ms" if abs(clock.offset) < MAX_CLOCK_OFFSET else "s"
    return {
        "table's clock ahead (k = 1)": format_quantity(clock.offset, clock.offset_sd, unit),
        "table's clock gains (k = 1)": format_quantity(clock.drift, clock.drift_sd, "ppm"),
    }


def add_table_angles(
    run: Source[TurntableData], recording: Recording, bench: Turntable
) -> RecordingWithAngles:
    """Return the recording with the table's angles.

    Raises
    ------
    InputError
        The file of the readback cannot be used.
    NotAlike
        It does not go with the recording.
    """
    sizes = readback_units(run)
    if run.data.table_file is None:
        if run.data.hold is not None:
            # A bench host has counted turns on, over outages too.
            counted = {name: recording.readback[name] * sizes[name] for name in bench.names}
            counted[HOLD_COLUMN] = recording.readback[HOLD_COLUMN]
            host = read_host_readback(run.file(run.data.file), recording)
            findings = (*recording.findings, *host.findings)
            whole = replace(recording, readback=counted, findings=findings)
            return RecordingWithAngles(whole, bench, quality=host.quality)
        said = _unwrap_angles(recording.readback, bench, sizes)
        return RecordingWithAngles(replace(recording, readback=said), bench)
    table = _read_table_file(run, recording.origin)
    by_name = dict(zip(table.channels, table.data.T, strict=True))
    said = _unwrap_angles(by_name, bench, sizes)
    angles = np.stack([said[name] for name in bench.names], axis=-1)
    where = f"{run.path}: [data] table_file: {run.data.table_file}"
    try:
        _require_readings(table.time, angles)
        rates = _gyro_readings(run, recording)
        found = align_readback(
            bench, recording.time, rates, table.time, angles, bench.latency.value
        )
    except ClockMismatch as error:
        raise ClockMismatch(f"{where}: {error}", error.angles) from None
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    # What a finding says of samples is of the other file.
    findings = [
        replace(one, message=f"{table.source}: {one.message}", start=None, stop=None)
        for one in table.findings
    ]
    left = replace(
        bench,
        latency=Measured(0.0, _LOOSER * found.offset_sd),
        clock=_LOOSER * found.drift_sd,
    )
    brought = dict(zip(bench.names, found.angles.T, strict=True))
    whole = replace(recording, readback=brought, findings=(*recording.findings, *findings))
    return RecordingWithAngles(whole, left, found)


def _read_table_file(run: Source[TurntableData], origin: int | None) -> Recording:
    """Return the table's file: its axes as channels, in units of their columns.

    Dates are counted from `origin`, ns since 1970, as those of the recording are.
    """
    data = run.data
    assert data.table_file is not None
    si_value(f"1 {data.table_time_unit}", "s", f"{run.path}: [data] table_time_unit")
    columns = Columns(
        channels=readback_fields(run),
        time=str(data.table_time),
        time_unit=data.table_time_unit if "table_time_unit" in data.model_fields_set else None,
        time_keys=("table_time_unit", None),
        origin=origin,
        nonfinite=data.nonfinite,
        options=file_reader_options(run, data.table_file),
    )
    try:
        return read_readback(run.file(data.table_file), columns)
    except InputError as error:
        raise InputError(f"{run.path}: [data] table_file: {error}") from None


def _unwrap_angles(
    said: Mapping[str, Array], bench: Turntable, sizes: Mapping[str, float]
) -> dict[str, Array]:
    """Return the axes' angles in rad, turns counted on."""
    found: dict[str, Array] = {}
    for name in bench.names:
        angle = said[name] * sizes[name]
        # Turns that are counted already must not be lost where samples are.
        found[name] = np.unwrap(angle) if np.ptp(angle) <= 2 * pi * (1 + 1e-6) else angle
    return found


def _gyro_readings(run: Source[TurntableData], recording: Recording) -> Array:
    """Return the gyros' readings, (n, 3) rad/s."""
    gyros = [k for k, axis in enumerate(run.sensor.axes) if axis.measures == "w"]
    if len(gyros) != len("xyz"):
        raise InputError(
            "its clock offset is estimated from three gyros, which the sensor does not have"
        )
    places = [recording.channels.index(name) for name in run.sensor.channels]
    return run.sensor.to_si(recording.data[:, places])[:, gyros]


def _require_readings(time: Array, angles: Array) -> None:
    """Refuse a readback that says too little, always or for a while, of how the table turns."""
    step = float(np.median(np.diff(time)))
    if step > _SLOWEST:
        raise InputError(
            f"{1 / step:.3g} readings a second; 20 are needed at least, for moves to begin and end "
            "where they do"
        )
    at = np.flatnonzero(np.diff(time) > _LONG)
    moved = np.abs(angles[at + 1] - angles[at]).max(axis=-1, initial=0.0)
    lost = at[moved > _MOVED]
    if lost.size:
        k = int(lost[0])
        raise InputError(
            f"no reading for {time[k + 1] - time[k]:.3g} s after {time[k]:.6g} s while the table "
            "turns; record again, or cut both files there"
        )
