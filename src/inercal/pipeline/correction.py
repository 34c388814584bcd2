"""Correct the recording of a run with a calibration."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.calibration import Calibration
from inercal.calibration.comparison import different_sensors
from inercal.calibration.delays import delay_words, significant_delays
from inercal.calibration.validity import READING_MARGIN, distance_outside, temperatures_outside
from inercal.methods import METHODS
from inercal.physics.quantities import QUANTITIES
from inercal.physics.section_settings import key_error
from inercal.pipeline.calibration_record import CROSSED_COLUMNS, KEPT_CORRECTIONS, crossed_columns
from inercal.recordings import Finding, Recording, ahead_of_lag
from inercal.recordings.data import recording_loader
from inercal.recordings.data.recording_loader import readback_columns, reader_columns
from inercal.recordings.temperature import FOUND_LAG
from inercal.runfile import Run, read
from inercal.runfile.priors import describe_readout

_DIGITS = 9  # significant digits of numbers in a text file
_LARGEST_EXACT = 1e22  # larger powers of ten are not exact
TEMPERATURE_DECIMALS = 6
SIGNIFICANT = "%.9g"
_AS_NAMED = "each column for its own axis"
_UNSURE = 1e-6  # of the last digit


def load_recording(run: Run) -> Recording:
    """Read and audit the recording of a run.

    Raises
    ------
    InputError
        If the recording cannot be read, or the audit refuses it.
    """
    return run.kind.audit(recording_loader.load_recording(run), run.sensor, run.bench)


def require_same_corrections(
    calibration: Calibration, kept_corrections: str, source: str, run: Run
) -> None:
    """Raise an error if this recording was corrected differently from that of the calibration."""
    made_from = calibration.conditions.get(KEPT_CORRECTIONS, "")
    if kept_corrections == made_from:
        return
    raise InputError(
        f"the corrections in the readings of {source} ({kept_corrections or 'none'}) differ from "
        f"those in the readings of the calibration ({made_from or 'none'}), so one would be "
        "applied twice or not at all; state [data] corrections as in the run of the calibration",
        key="[data] corrections",
    ).located(run.path)


def sensor_findings(calibration: Calibration, run: Run) -> tuple[Finding, ...]:
    """Return warnings if the sensor's name, or the columns' order or signs, are not those before.

    Raises
    ------
    InputError
        The run states another serial number than the calibration.
    """
    pair = (calibration.sensor.name, calibration.job), (run.sensor.name, run.job)
    serials, names = different_sensors(*pair)
    if serials:
        text = f"the calibration is of another sensor ({serials}); correct or remove the key"
        raise key_error("[job] serial_number", text, run.path)
    text = f"the calibration and the run file name different sensors: {names}"
    return (Finding("warning", "sensor", text),) * bool(names) + _crossed_columns(calibration, run)


def _crossed_columns(calibration: Calibration, run: Run) -> tuple[Finding, ...]:
    """Return a warning if the order or the signs of the columns differ from the calibration's."""
    here, there = crossed_columns(run), calibration.conditions.get(CROSSED_COLUMNS, "")
    if here == there:
        return ()
    text = (
        f"judged by the names of the columns, [data] takes {here or _AS_NAMED}, but the run of the "
        f"calibration took {there or _AS_NAMED}: check the order and the signs of the columns"
    )
    return (Finding("warning", "axes", text),)


def rate_limits(calibration: Calibration) -> tuple[float, float] | None:
    """Return the smallest and largest rate of a calibration at constant rates, rad/s, or None."""
    one = METHODS.get(calibration.method)
    if one is None or not one.constant_rates or calibration.validity is None:
        return None
    return calibration.validity.rate


def rates_outside(limits: tuple[float, float], rate: Array) -> NDArray[np.bool_]:
    """Return a mask of samples with a gyro reading, (n, k) rad/s, outside the limits."""
    margin = READING_MARGIN * (limits[1] - limits[0])
    return np.asarray(distance_outside(limits, rate, margin).any(axis=-1))


def _rates_beyond(calibration: Calibration, recording: Recording) -> tuple[Finding, ...]:
    """Return a warning if gyro readings are outside the range of the calibration."""
    limits = rate_limits(calibration)
    if limits is None:
        return ()
    sensor = calibration.sensor.select_axes("w")
    columns = [recording.channels.index(name) for name in sensor.channels]
    rate = sensor.to_si(recording.data[..., columns])
    beyond = rates_outside(limits, rate)
    if not beyond.any():
        return ()
    ends = " to ".join(f"{math.degrees(value):.4g}" for value in limits)
    reached = math.degrees(float(rate.flat[np.argmax(np.abs(rate))]))
    text = (
        f"{beyond.sum()} samples are outside the rates of the calibration, {ends} °/s: the rate "
        f"reaches {reached:.4g} °/s, where scale factors and nonlinear terms were not measured"
    )
    return (Finding("warning", "range", text.replace("-", "−")),)


def _unstated_lag(calibration: Calibration, run: Run) -> tuple[Finding, ...]:
    """Return a warning if the calibration found a lag of the temperature that the run omits."""
    found = calibration.conditions.get(FOUND_LAG)
    if found is None or (run.environment is not None and run.environment.lag is not None):
        return ()
    lag, _, expanded, *_ = found.split()
    if abs(float(lag)) <= float(expanded):
        return ()
    text = (
        f"the temperature was not corrected for its lag, {found} by the calibration: state "
        f'[environment] lag = "{lag} s" in {run.path}'
    )
    return (Finding("warning", "lag", text),)


def _temperatures_beyond(
    calibration: Calibration, run: Run, recording: Recording, outside: NDArray[np.bool_]
) -> tuple[Finding, ...]:
    """Return a warning with the number of samples outside the calibrated temperatures."""
    if not outside.any() or recording.temperature is None:
        return ()
    assert calibration.validity is not None
    assert calibration.validity.temperature is not None
    ends = " to ".join(f"{t - ZERO_CELSIUS:.2f}" for t in calibration.validity.temperature)
    beyond = recording.temperature[outside] - ZERO_CELSIUS
    lag = None if run.environment is None else run.environment.lag
    corrected = f", corrected for [environment] lag = {lag.value:g} s," if lag else ""
    text = (
        f"{int(outside.sum())} samples at {beyond.min():.2f} to {beyond.max():.2f} °C{corrected} "
        f"are outside the temperatures of the calibration, {ends} °C, where its polynomials are "
        "not valid"
    )
    return (Finding("warning", "extrapolation", text.replace("-", "−")),)


def require_same_readout(calibration: Calibration, run: Run) -> None:
    """Raise an error if a run has no recording, or if its readout is not the calibration's."""
    if run.data.kind == "means":
        raise InputError(
            "[data] kind is means, but only a recording can be corrected; give the run file of a "
            "recording",
            key="[data] kind",
        ).located(run.path)
    if run.data.temperature is None and calibration.sensor.uses("dT", "dTdt"):
        raise InputError(
            "[data] temperature is missing, but the calibration depends on it: name the column of "
            f"{run.data.file} with the temperature of the sensor",
            key="[data] temperature",
        ).located(run.path)
    stated = {axis.name: axis for axis in run.whole_sensor.axes}
    for axis in calibration.sensor.axes:
        here = stated.get(axis.name, axis)
        mine, theirs = here.readout, axis.readout
        same = np.isclose([mine.scale, mine.offset], [theirs.scale, theirs.offset])
        if mine.unit == theirs.unit and not same.all():
            section = QUANTITIES[axis.measures].sensor
            raise InputError(
                f"{'only the offset' if same[0] else 'the scale'} of {axis.name} differs: scale "
                f"and offset are {describe_readout(here)} here, and {describe_readout(axis)} in "
                f"the calibration; state that in [sensor.{section}]",
                names=(axis.name,),
            ).located(run.path)


def _without_delays(calibration: Calibration, recording: Recording) -> Recording:
    """Return the recording with the readings that belong to the time of each sample."""
    if not (delays := significant_delays(calibration.conditions)):
        return recording
    time, findings, kept = recording.time, recording.findings, np.ones(len(recording.time), bool)
    data = recording.data.copy()
    for kind, late in delays.items():
        at = time + late.value
        after = np.searchsorted(time, at)
        kept &= (at >= time[0]) & (at <= time[-1]) & ~np.isin(after, recording.gaps[:, 1])
        for name in calibration.sensor.select_axes(kind).channels:
            column = recording.channels.index(name)
            data[..., column] = np.interp(at, time, recording.data[..., column])
        text = f"{delay_words(kind, late)}: their readings are moved to the times of the others'"
        findings += (Finding("note", "delay", text),)
    return replace(replace(recording, data=data).take(kept), findings=findings)


def apply(
    calibration: Calibration, run: Run | str | Path, *, extrapolate: bool = False
) -> Recording:
    """Use a calibration to correct the recording that a run file names.

    Parameters
    ----------
    calibration : Calibration
    run : Run or path
    extrapolate : bool
        Whether samples outside the temperature range of the calibration are also corrected. If so,
        these samples are counted, and an additional column `extrapolated` contains 1 for each of
        them and 0 for all others.

    Returns
    -------
    Recording
        Recording with the channels fx, fy, fz (m/s²) and wx, wy, wz (rad/s), if the sensor measures
        them. If there are only one or two axes of a kind, it has the components along them, and the
        motion across them is assumed to be zero. If there are more than three, the columns
        "parity_f" and "parity_w" have the norm of what they read in addition to any motion. Labels
        and readback columns keep their names and units. If the calibration was made at constant
        rates and a rate is outside their range, the recording has a finding about this. If the
        calibration states a delay of the gyros or magnetometers that is larger than its U, their
        readings are interpolated at times later by the delay, samples for which there are none, at
        an end or a gap, are left out, and a finding says so.

    Raises
    ------
    InercalError
        If the recording cannot be used, its readout differs from the calibration, or its
        temperatures are outside the range of the calibration.
    """
    run = run if isinstance(run, Run) else read(run)
    about_sensor = sensor_findings(calibration, run)
    require_same_readout(calibration, run)
    recording = load_recording(run.with_all_axes)
    environment = run.environment
    if run.method.follows_rest and environment is not None and environment.lag is not None:
        recording = ahead_of_lag(recording, environment.lag.value)
    require_same_corrections(calibration, recording.kept_corrections, recording.source, run)
    recording = _without_delays(calibration, recording)
    outside = np.zeros(0, dtype=np.bool_)
    if recording.temperature is not None:
        outside = temperatures_outside(
            calibration.sensor, calibration.validity, recording.temperature
        )
    warmer = _temperatures_beyond(calibration, run, recording, outside)
    if warmer and not extrapolate:
        raise InputError(
            f"{warmer[0].message}; cut them off, or allow it with --extrapolate",
            key="[data] temperature",
        ).located(run.path)
    motion = calibration.correct(recording, extrapolate=extrapolate)
    beyond = _rates_beyond(calibration, recording)
    named = readback_columns(run)
    readback = {named[name]: values for name, values in recording.readback.items()}
    if warmer:
        readback["extrapolated"] = outside.astype(np.float64)
    readback |= {f"parity_{kind}": values for kind, values in motion.parity.items()}
    sensed = calibration.sensor.sensed
    kinds = dict.fromkeys(sensed.measures)
    return replace(
        recording,
        findings=(
            *about_sensor,
            *recording.findings,
            *warmer,
            *beyond,
            *_unstated_lag(calibration, run),
        ),
        data=np.concatenate([getattr(motion, kind) for kind in kinds], axis=-1),
        channels=sensed.names,
        units=tuple(QUANTITIES[kind].unit for kind in sensed.measures),
        readback=readback,
        label_name=reader_columns(run).label or recording.label_name,
    )


def as_written(corrected: Recording, run: Run, *, text: bool) -> Recording:
    """Convert a corrected recording to the form that `inercal apply` writes.

    The temperature is in the unit that the run file states, and the name of its column contains
    this unit, for example "temperature [°C]".

    Parameters
    ----------
    corrected : Recording
        Recording returned by `apply`.
    run : Run
    text : bool
        Whether the file contains numbers as text. If so, they have nine significant digits, and
        times have at least four digits more than the time step.
    """
    if corrected.temperature is not None:
        unit: str = run.data.temperature_unit
        own = run.data.thermometer.values(corrected.temperature)
        # The sum with 273.15 has more digits than any sensor.
        own: Array = np.round(own, TEMPERATURE_DECIMALS)
        readback = {f"temperature [{unit}]": own, **corrected.readback}
        corrected = replace(corrected, temperature=None, readback=readback)
    if not text:
        return corrected
    time = corrected.stamps
    if time.size > 1 and (step := float(np.median(np.diff(time)))) > 0:
        time = np.round(time, 4 - math.floor(math.log10(step)))
    return replace(
        corrected,
        time=time,
        first_stamp=0.0,
        data=significant(corrected.data),
        readback={name: significant(values) for name, values in corrected.readback.items()},
    )


def significant(values: Array) -> Array:
    """Round to nine significant digits: 1e-8 of 1 g, which is below the noise of any sensor.

    The results are the numbers that the format "%.9g" prints.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        size = np.floor(np.log10(np.abs(values)))
        factor = 10.0 ** (_DIGITS - 1 - size)
        scaled = values * factor
        whole = np.rint(scaled)
        rounded = np.asarray(whole / factor)
        # The product is rounded, so it may be on the wrong side of a half.
        unsure = (np.abs(np.abs(scaled - whole) - 0.5) < _UNSURE) | (factor >= _LARGEST_EXACT)
        unsure |= (factor < 1) | ~np.isfinite(rounded)
    for k in np.flatnonzero(unsure).tolist():
        rounded.flat[k] = float(SIGNIFICANT % values.flat[k])
    return rounded
