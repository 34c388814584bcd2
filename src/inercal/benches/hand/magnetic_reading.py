"""Add the readings of the magnetometers to the observations of a run by hand."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.units import format_number
from inercal.physics.magnetism import POSSIBLE_FIELD, unit_hint
from inercal.physics.plan import HandStep, Hold
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import output_unit
from inercal.recordings import Finding, Mark, Observations, Recording
from inercal.recordings.data import RestsSection, RunBase, recording_loader
from inercal.recordings.io.file_patterns import is_pattern
from inercal.recordings.io.mean_tables import read_means
from inercal.recordings.magnetic import MagneticReadings
from inercal.recordings.segments.gravity_turns import sphere
from inercal.recordings.segments.magnetic_means import (
    average_magnetometers,
    average_pieces,
    clipped_samples,
)


def with_magnetometers(
    run: RunBase[RestsSection],
    observations: Observations,
    steps: Sequence[HandStep],
    recording: Recording | None,
    rests: Sequence[tuple[int, Mark]],
) -> tuple[Observations, tuple[Finding, ...]]:
    """Return the observations with the magnetometers' readings, and findings about them.

    Parameters
    ----------
    run : RunBase
        A run with magnetometers.
    observations : Observations
    steps : sequence of HandStep
        The step of each row.
    recording : Recording or None
        Recording of the other axes; None for a table of means.
    rests : sequence of (row, mark)
        Rests of a recording, each with its row.

    Raises
    ------
    InputError
        The readings of the magnetometers cannot be used.
    """
    sensor = run.magnetometer
    assert sensor is not None
    if recording is None:
        found, findings = _means_in_table(run, steps), tuple[Finding, ...]()
    else:
        own = recording_loader.load_magnetometers(run)
        if is_pattern(run.file(run.data.file)) and own.time.size != recording.time.size:
            raise key_error(
                "[data] nonfinite",
                "rows without magnetometer readings were dropped, so that the times of several "
                "files do not agree; write the recording to one file",
                run.path,
            )
        spans = [(recording.time[m.start], recording.time[m.stop - 1]) for _, m in rests]
        clipped, railed = clipped_samples(own, sensor, spans)
        labels = [mark.label for _, mark in rests]
        found, lost = average_magnetometers(own, sensor, spans, labels, clipped)
        row = np.array([row for row, _ in rests])
        found, moves = replace(found, rest=row[found.rest]), observations.transitions
        if moves is not None:
            kept = own.take(~clipped)
            found = replace(found, pieces=average_pieces(kept, sensor, moves, run.sensor))
        told = (*railed, *own.findings, *lost)
        findings = tuple(one for one in told if one not in recording.findings)
    require_earth_field(run, found)
    return replace(observations, magnetic=found), findings


def _means_in_table(run: RunBase[RestsSection], steps: Sequence[HandStep]) -> MagneticReadings:
    own = recording_loader.of_magnetometers(run)
    rows = np.flatnonzero([isinstance(step, Hold) for step in steps])
    read = read_means(
        run.file(run.data.file),
        replace(recording_loader.reader_columns(own), label=None),
        own.sensor,
        recording_loader.stated_deviations(run),
        None,
    )
    t = read.temperature
    return MagneticReadings(
        channels=own.sensor.channels,
        rest=rows,
        mean=read.mean[rows],
        covariance=read.covariance[rows],
        time=read.time[rows],
        samples=np.ones(rows.size),
        noise=np.zeros((len(own.sensor.axes),) * 2),
        temperature=None if t is None else t[rows],
    )


def require_earth_field(run: RunBase[RestsSection], found: MagneticReadings) -> None:
    """Refuse readings in a wrong unit, in which the field of the Earth is impossible.

    Readings in counts are not judged, because their scale is only nominal.

    Raises
    ------
    InputError
    """
    sensor = run.magnetometer
    assert sensor is not None
    readout, readings = sensor.axes[0].readout, np.concatenate(found.parts)
    _, radius = sphere(readings)
    if output_unit(readout.unit) is not None or radius is None:
        return
    wide = np.sort(np.ptp(readings, axis=0))[1] > radius  # else the radius is not certain
    if not wide or POSSIBLE_FIELD[0] <= radius <= POSSIBLE_FIELD[1]:
        return
    read = radius * abs(readout.scale)
    hint = unit_hint(read) or (
        f'; counts look like this: state unit = "LSB" and scale = "{read / 50:.3g} LSB/µT", or the '
        "scale of the data sheet"
    )
    raise InputError(
        f"{run.file(run.data.file)}: the magnetometers read {format_number(read, 3)} "
        f"{readout.unit}, but the Earth's field is 22 to 67 µT{hint}: check [sensor."
        "magnetometer] unit",
        file=run.file(run.data.file),
        key="[sensor.magnetometer] unit",
        names=sensor.channels,
    )
