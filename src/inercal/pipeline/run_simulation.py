"""Simulate the plan of a run on a simulated bench, and name columns as in the run file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError, error_location
from inercal.basics.units import si_factor
from inercal.benches.contract import SimulatedMotion
from inercal.benches.hand.bench import face_label
from inercal.physics.motion import Motion
from inercal.physics.plan import Hold, Turn, with_second_azimuths
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Axis, Sensor
from inercal.pipeline.chamber_simulation import (
    in_chamber,
    repeatability_errors,
    require_profile,
    steps_of_soaks,
)
from inercal.recordings import Recording
from inercal.recordings.data import recording_loader
from inercal.recordings.io.file_patterns import is_pattern
from inercal.recordings.io.simulation_mark import SIMULATION_OF
from inercal.runfile import Run, read

_ROUNDING = 1e-9
_MOST_SAMPLES = 1e8  # of all trials together; this is 5 GB for an IMU


def simulate(run: Run | str | Path, seed: int = 0, trials: int | None = None) -> Recording:
    """Simulate the plan of a run on its bench, with true coefficients and noise of its sensor.

    Parameters
    ----------
    run : Run or path
        Run to simulate. [sensor.truth] states the true coefficients (all others are zero), and
        [data] rate is the sampling rate.
    seed : int
    trials : int, optional
        Number of independent repetitions, on a leading axis. None gives one recording without this
        axis.

    Raises
    ------
    InputError
        If the sampling rate is missing, or [sensor.truth] contains an unknown coefficient.
    """
    run = (run if isinstance(run, Run) else read(run)).with_all_axes
    return _simulate_run(run, np.random.default_rng(seed), seed, trials)[0]


def simulate_files(run: Run | str | Path, seed: int = 0) -> dict[str, Recording]:
    """Simulate the files that a run file names: the recording, and other files of the bench.

    Parameters
    ----------
    run : Run or path
    seed : int

    Returns
    -------
    dict of str to Recording
        Recordings by their names in [data]; the recording of the sensor comes first. They have the
        columns and times that [data] states and can be written to files.

    Raises
    ------
    InputError
        See `simulate`.
    """
    run = (run if isinstance(run, Run) else read(run)).with_all_axes
    if run.data.file in run.data.further_files().values():
        raise InputError(
            f"[data] names {run.data.file} twice, but a simulation needs two separate files",
            key="[data]",
        ).located(run.path)
    rng = np.random.default_rng(seed)
    recording, done = _simulate_run(run, rng, seed)
    files = {run.data.file: apply_data_columns(run, recording)}
    for name, further in run.kind.files(run, done, rng).items():
        files[name] = replace(further, source=recording.source, simulation=recording.simulation)
    return files


def _simulate_run(
    run: Run, rng: "np.random.Generator", seed: int, trials: int | None = None
) -> tuple[Recording, SimulatedMotion]:
    if run.rate_hz is None:
        reason = 'is missing, but a simulation needs it: add rate, such as rate = "100 Hz"'
        raise key_error("[data] rate", reason, run.path)
    samples = run.rate_hz * run.kind.seconds(run.bench, run.steps) * (trials or 1)
    if samples > _MOST_SAMPLES:
        raise InputError(
            f"the simulation would have {samples:.2g} samples, but the limit is "
            f"{_MOST_SAMPLES:.0e}: reduce [data] rate or [method] seconds",
            key="[data] rate",
        ).located(run.path)
    sensor = run.sensor.with_coefficients(*run.truth)
    bench, rate, several = run.bench, run.rate_hz, trials or 1
    steps = [step for step in run.steps if isinstance(step, run.kind.steps)]
    if not run.method.unknown_attitudes and sensor.rank("m"):
        steps = with_second_azimuths(one for one in steps if isinstance(one, Hold | Turn))
    environment = run.environment
    if environment is not None:
        _require_chamber(run)
        steps = steps_of_soaks(steps, environment)
    result = run.kind.simulate(
        bench, steps, rate, rng, several, sensor, run.method.unknown_attitudes
    )
    done, drift, temperature = result.simulated_motion, result.drift, None
    if environment is not None:
        chamber = in_chamber(done, environment, rate, sensor.reference_temperature, rng)
        done, temperature = chamber.simulated_motion, chamber.recorded
        scatter = repeatability_errors(environment, sensor, done.labels, several, rng)
        drift = scatter if drift is None else drift[..., chamber.order, :] + scatter
    columns = recording_loader.readback_columns(run)
    readback = {
        name: values[0] if values.ndim > 1 and not trials else values
        for name, values in done.readback.items()
        if name in columns
    }
    c = np.array([run.truth[name] for name in sensor.coefficients])
    motion = done.motion
    if sensor.uses("ai", "ap", "ao"):
        motion = replace(motion, dw=np.gradient(motion.w, 1 / run.rate_hz, axis=-2))
    data = read_out(result.sensor, motion, c, run.rate_hz, rng, drift)
    mark = f"{SIMULATION_OF}{run.path.name}, seed {seed}"
    recording = Recording(
        time=done.time,
        data=data if trials else data[0],
        channels=sensor.channels,
        units=tuple(axis.readout.unit for axis in sensor.axes),
        labels=_stated_labels(run, done.labels),
        temperature=temperature if temperature is None or trials else temperature[0],
        readback=readback,
        source=mark,
        simulation=mark,
    )
    return recording, done


def _require_chamber(run: Run) -> None:
    """Raise an error for missing temperatures, or soaks with positions that cannot be repeated."""
    assert run.environment is not None
    if run.environment.kind == "soaks" and run.kind.name != "hand":
        raise key_error(
            "[environment] kind",
            f"method {run.method.name} has no positions that can be repeated at another "
            'temperature; write kind = "ramp", or simulate a turntable in a chamber with inercal '
            "bench simulate",
            run.path,
        )
    with error_location(run.path):
        require_profile(run.environment)


def _stated_labels(run: Run, labels: NDArray[np.str_]) -> NDArray[np.str_]:
    """Return the labels as in a recording: the labels of the positions, without the visit."""
    if run.environment is None or run.kind.name != "hand" or run.method.unknown_attitudes:
        return labels
    names, place = np.unique(labels, return_inverse=True)
    plain = np.array([face_label(name) for name in names.tolist()])
    return plain[place.reshape(labels.shape)]


def apply_data_columns(run: Run, recording: Recording) -> Recording:
    """Convert a recording to the columns and times that [data] states, for writing to a file."""
    run = run.with_all_axes
    if is_pattern(run.file(run.data.file)):
        raise key_error(
            "[data] file", "a simulation writes one file; give its name without a star", run.path
        )
    for key in ("gyro_file", "gyro_time"):
        if getattr(run.data, key) is not None:
            raise key_error(
                f"[data] {key}", f"a simulation writes one file; remove {key}", run.path
            )
    named = {axis: column for axis, column, _ in recording_loader.reader_columns(run).channels}
    recording = recording_loader.apply_axis_signs(run, recording)
    readback = {
        column: recording.readback[name] / recording_loader.readback_units(run)[name]
        for name, column, _ in recording_loader.reader_columns(run).readback
    }
    if recording.temperature is not None:
        own = run.data.thermometer.values(recording.temperature)
        readback = {str(run.data.temperature): own, **readback}
        recording = replace(recording, temperature=None)
    channels = tuple(named[name] for name in recording.channels)
    label = recording_loader.reader_columns(run).label or recording.label_name
    return _apply_data_times(
        run, replace(recording, channels=channels, readback=readback, label_name=label)
    )


def _apply_data_times(run: Run, recording: Recording) -> Recording:
    """Convert the times of a recording to the unit of their column, or to sample counts."""
    data, time = run.data, recording.time
    if data.time is None:
        return recording
    if data.time_unit != "sample":
        time = time / si_factor(data.time_unit, "s")
    else:
        assert run.rate_hz is not None  # a simulation needs a rate
        time = np.round(time * run.rate_hz)
    if data.counter_modulus is not None:
        time = time % data.counter_modulus
    return replace(recording, time=time, time_name=str(data.time))


def read_out(
    sensor: Sensor,
    motion: Motion,
    c: np.ndarray,
    rate_hz: float,
    rng: "np.random.Generator",
    drift: np.ndarray | None = None,
) -> np.ndarray:
    """Return the sensor output in output units, (..., n, m), with noise and saturation.

    Parameters
    ----------
    sensor : Sensor
    motion : Motion
        Motion, (..., n, 3), sampled at `rate_hz`.
    c : (p,) array
        Coefficients in SI units.
    rate_hz : float
    rng : Generator
    drift : (..., n, m) array, optional
        Drift of the biases, SI.
    """
    reading = sensor.forward(motion, c)
    if drift is not None:
        reading = reading + drift
    for k, axis in enumerate(sensor.axes):
        noisy = reading[..., k] + axis.noise.draw(rng, reading.shape[:-1], rate_hz)
        reading[..., k] = axis.noise.quantise(noisy)
    output = sensor.to_output(reading)
    for k, axis in enumerate(sensor.axes):
        output[..., k] = _round_to_codes(axis, output[..., k])
    for name, ends in recording_loader.range_limits(sensor).items():
        k = sensor.channels.index(name)
        output[..., k] = np.clip(output[..., k], *ends)
    return output


def _round_to_codes(axis: Axis, output: np.ndarray) -> np.ndarray:
    """Round the output to whole codes, without rounding errors from the scale factor."""
    step = axis.noise.quantisation * abs(axis.readout.scale)
    codes = round(step)
    if codes < 1 or abs(step / codes - 1) > _ROUNDING:
        return output
    return np.round((output - axis.readout.offset) / codes) * codes + axis.readout.offset
