"""The main path: from a run file to a calibration, and the same plan in simulation.

run file ─> recording ─> audit ─> marks ─> observations ─> method's estimator ─> calibration
"""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

import numpy as np

from inercal.benches import Hand
from inercal.benches.simulate import perform
from inercal.calibration import Calibration
from inercal.calibration.verdict import verdict
from inercal.errors import InputError
from inercal.estimate import Estimate
from inercal.io.audit import accept
from inercal.io.marks import as_read, marks_from_file
from inercal.io.means import read_means
from inercal.io.read import Columns, read_recording
from inercal.io.rest import audit_rest_norm
from inercal.io.table import sha256_of
from inercal.methods.multi_position.timing import delay
from inercal.motion import Motion
from inercal.plan import Step, Turn
from inercal.recording import Finding, Mark, Observations, Recording
from inercal.runfile import Run, read
from inercal.runfile.build import si_value
from inercal.segments import (
    FoundRests,
    as_found,
    between_rests,
    check_against_plan,
    check_marks,
    check_turn_ends,
    find_marks,
    find_rests,
    held,
    marks_from_labels,
    observe,
    unflawed,
)
from inercal.sensors import Sensor
from inercal.units import readable

_MOST_SAMPLES = 1e8  # of a simulation, all trials together: 5 GB for an IMU


@dataclass(frozen=True, eq=False)
class Outcome:
    """Everything a calibration run found, for reports and for looking into.

    Parameters
    ----------
    calibration : Calibration
    estimate : Estimate
        With the bench's nuisances and the residuals.
    observations : Observations
    steps : tuple of Step
        Of each observation.
    bench : Hand
    recording : Recording or None
        None when means were read straight in.
    marks : tuple of Mark
    findings : tuple of Finding
        The audit's, and what the checks against the plan noticed.
    verdict : tuple of str
        In plain words; the first line is the summary.
    rests : FoundRests or None
        How rests were found, where they were found without a plan.
    """

    calibration: Calibration
    estimate: Estimate
    observations: Observations
    steps: tuple[Step, ...]
    bench: Hand
    recording: Recording | None
    marks: tuple[Mark, ...]
    findings: tuple[Finding, ...]
    verdict: tuple[str, ...]
    rests: FoundRests | None = None


def calibrate(run: Run | str | Path) -> Outcome:
    """Calibrate from a run file. Writes nothing.

    Raises
    ------
    InercalError
        The run file, the recording or the marks cannot be used, or coefficients are not observed.
    """
    run = run if isinstance(run, Run) else read(run)
    sensor = run.sensor
    rests = None
    if run.data.kind == "means":
        recording, marks, findings = None, (), ()
        if run.method.free and sensor.only("w").axes:
            raise InputError(
                f"{run.path}: [data] kind means holds no rotations: leave [sensor.gyro] out, or "
                "give the recording"
            )
        if run.data.seconds is None and any(isinstance(step, Turn) for step in run.steps):
            raise InputError(
                f"{run.path}: [data] seconds is missing: the column of turns' durations"
            )
        observations = read_means(
            run.file(run.data.file), _columns(run), sensor, _stated_sd(run), _seconds(run)
        )
    else:
        recording = load_recording(run)
        if run.method.free:
            rests = find_rests(recording, sensor) if run.data.marks == "found" else None
            marks, observations, findings = _free_rests(run, recording, rests)
        else:
            marks, observations, findings = _planned_sections(run, recording)
    if run.method.free:
        plan = steps = held(observations, sensor)
    else:
        plan, steps = run.steps, _planned(run, observations)
        findings += check_against_plan(observations, sensor, steps, run.bench.gravity.value)
    estimate = run.method.estimator(run.estimator)(
        observations, sensor, run.bench, plan, run.priors
    )
    if not np.all(estimate.converged):
        raise InputError(f"{run.path}: the fit did not converge; look at the marks and the plan")
    conditions = _conditions(run, recording)
    if run.time_offset:
        late = delay(observations, sensor, estimate, run.bench.gravity.value)
        text = f"{late.value * 1e3:+.2f} ± {2 * late.sd * 1e3:.2f} ms (k = 2)"
        conditions["delay of the gyros"] = text
        note = f"the gyros' samples are {text} later than the accelerometers'"
        estimate = replace(estimate, notes=(note, *estimate.notes))
    p = len(sensor.coefficients)
    lines = verdict(estimate, sensor, findings, run.estimator)
    calibration = Calibration(
        sensor,
        estimate.value[:p],
        estimate.stated_covariance[:p, :p],
        run.method.name,
        run.estimator,
        conditions,
        _provenance(run, recording),
        lines,
        # A free method has no mounting: the frame is the accelerometers' own.
        "triangular" if run.method.free else "mount",
    )
    return Outcome(
        calibration,
        estimate,
        observations,
        steps,
        run.bench,
        recording,
        marks,
        findings,
        lines,
        rests,
    )


def _planned_sections(
    run: Run, recording: Recording
) -> tuple[tuple[Mark, ...], Observations, tuple[Finding, ...]]:
    """Return the sections of the plan's steps: marks, means, what was noticed."""
    if run.data.marks == "found":
        marks = find_marks(recording, run.sensor, run.steps)
    else:
        marks = _stated_marks(run, recording)
    check_marks(marks, recording, [step.label for step in run.steps])
    observations = observe(recording, run.sensor, marks, run.steps)
    findings = check_turn_ends(recording, run.sensor, marks, run.steps)
    return marks, observations, recording.findings + findings


def _planned(run: Run, observations: Observations) -> tuple[Step, ...]:
    by_label = {step.label: step for step in run.steps}
    unknown = [label for label in observations.labels if label not in by_label]
    if unknown:
        raise InputError(
            f"{run.data.file}: no step {unknown[0]!r} in the plan; it has {', '.join(by_label)}"
        )
    return tuple(by_label[label] for label in observations.labels)


def _free_rests(
    run: Run, recording: Recording, rests: FoundRests | None
) -> tuple[tuple[Mark, ...], Observations, tuple[Finding, ...]]:
    """Return rests in any attitude and the ways between them: marks, means, what was noticed."""
    findings = recording.findings
    if rests is not None:
        marks, findings = rests.marks, (*findings, rests.finding)
    else:
        marks = _stated_marks(run, recording)
        check_marks(marks, recording, [mark.label for mark in marks])
    marks, left_out = unflawed(recording, run.sensor, marks)
    found = rests is not None
    observations = observe(recording, run.sensor, marks, as_found(marks), by_hand=True, found=found)
    if run.sensor.only("w").axes:
        observations = replace(observations, passages=between_rests(recording, run.sensor, marks))
    return marks, observations, findings + left_out


def load_recording(run: Run) -> Recording:
    """Read and audit the run's recording.

    Raises
    ------
    InputError
        It cannot be read, or the audit refuses it.
    """
    recording = read_recording(
        run.file(run.data.file), _columns(run), _limits(run.sensor), _gyro_file(run)
    )
    return accept(audit_rest_norm(recording, run.sensor, run.bench.gravity.value))


def _gyro_file(run: Run) -> Path | None:
    """Return the file that holds the gyros alone: none where the method leaves them out."""
    name = run.data.gyro_file
    return None if name is None or not run.sensor.only("w").axes else run.file(name)


def _limits(sensor: Sensor) -> dict[str, tuple[float, float]]:
    """Return the ends of each axis's range in output units, where its full scale is stated."""
    limits: dict[str, tuple[float, float]] = {}
    for axis in sensor.axes:
        if (reach := axis.readout.full_scale) is not None:
            limits[axis.name] = (axis.readout.offset - reach, axis.readout.offset + reach)
    return limits


def simulate(run: Run | str | Path, seed: int = 0, trials: int | None = None) -> Recording:
    """Carry the run's plan out on its simulated bench with the sensor's truth and noise.

    Parameters
    ----------
    run : Run or path
        [sensor.truth] gives the coefficients, others are zero; [data] rate the sampling rate.
    seed : int
    trials : int, optional
        Independent repetitions on a leading axis; None is one recording without that axis.

    Raises
    ------
    InputError
        No sampling rate, or a truth that names no coefficient.
    """
    run = run if isinstance(run, Run) else read(run)
    if run.rate_hz is None:
        raise InputError(f"{run.path}: [data] rate is missing; a simulation needs it")
    samples = run.rate_hz * sum(step.seconds for step in run.steps) * (trials or 1)
    if samples > _MOST_SAMPLES:
        raise InputError(
            f"{run.path}: {samples:.2g} samples are more than a simulation holds in memory, "
            f"{_MOST_SAMPLES:.0e}: lower [data] rate or [method] seconds"
        )
    rng = np.random.default_rng(seed)
    done = perform(run.bench, run.steps, run.rate_hz, rng, trials or 1, carried=run.method.free)
    sensor = run.sensor.with_coefficients(*run.truth)
    c = np.array([run.truth[name] for name in sensor.coefficients])
    motion = done.motion
    if sensor.uses("ai", "ap", "ao"):
        motion = replace(motion, dw=np.gradient(motion.w, 1 / run.rate_hz, axis=-2))
    data = read_out(sensor, motion, c, run.rate_hz, rng)
    return Recording(
        time=done.time,
        data=data if trials else data[0],
        channels=sensor.channels,
        units=tuple(axis.readout.unit for axis in sensor.axes),
        labels=done.labels,
        source=f"simulation of {run.path.name}, seed {seed}",
    )


def named_as_in(run: Run, recording: Recording) -> Recording:
    """Return the recording with the run file's column names, ready to be written as its data."""
    if run.data.gyro_file is not None:
        raise InputError(f"{run.path}: [data] gyro_file: a simulation is one file; leave it out")
    columns = {axis: column for axis, column, _ in _columns(run).channels}
    return replace(recording, channels=tuple(columns[name] for name in recording.channels))


def apply(calibration: Calibration, run: Run | str | Path) -> Recording:
    """Correct the recording that a run file names.

    Returns
    -------
    Recording
        Channels fx, fy, fz (m/s²) and wx, wy, wz (rad/s), whichever the sensor has.

    Raises
    ------
    InercalError
        The recording cannot be used, or does not fit the calibration.
    """
    run = run if isinstance(run, Run) else read(run)
    if run.data.kind == "means":
        raise InputError(f"{run.path}: [data] kind is means; only a recording can be corrected")
    stated = {axis.name: axis.readout for axis in run.sensor.axes}
    for axis in calibration.sensor.axes:
        here = stated.get(axis.name, axis.readout)
        if here.unit == axis.readout.unit and not np.allclose(
            [here.scale, here.offset], [axis.readout.scale, axis.readout.offset]
        ):
            raise InputError(
                f"{run.path}: {axis.name} has scale {here.scale:.6g} and offset {here.offset:g} "
                f"{here.unit} per SI unit; the calibration is for {axis.readout.scale:.6g} and "
                f"{axis.readout.offset:g}"
            )
    recording = load_recording(run)
    motion = calibration.correct(recording)
    kinds = {axis.measures for axis in calibration.sensor.axes}
    felt = [("f", "m/s²", motion.f), ("w", "rad/s", motion.w)]
    present = [part for part in felt if part[0] in kinds]
    return replace(
        recording,
        data=np.concatenate([values for _, _, values in present], axis=-1),
        channels=tuple(kind + axis for kind, _, _ in present for axis in "xyz"),
        units=tuple(unit for _, unit, _ in present for _ in "xyz"),
    )


def read_out(
    sensor: Sensor, motion: Motion, c: np.ndarray, rate_hz: float, rng: np.random.Generator
) -> np.ndarray:
    """Return what the sensor puts out, (..., n, m) in output units, noise and limits included.

    Parameters
    ----------
    sensor : Sensor
    motion : Motion
        (..., n, 3), at `rate_hz`.
    c : (p,) array
        Coefficients in SI.
    rate_hz : float
    rng : Generator
    """
    reading = sensor.forward(motion, c)
    for k, axis in enumerate(sensor.axes):
        noisy = reading[..., k] + axis.noise.draw(rng, reading.shape[:-1], rate_hz)
        reading[..., k] = axis.noise.quantise(noisy)
    output = sensor.to_output(reading)
    for name, ends in _limits(sensor).items():
        k = sensor.channels.index(name)
        output[..., k] = np.clip(output[..., k], *ends)
    return output


def _columns(run: Run) -> Columns:
    data = run.data
    names = {"f": data.accelerometer, "w": data.gyro}
    channels: dict[str, tuple[tuple[str, str, str], ...]] = {}
    for kind, columns in names.items():
        axes = [axis for axis in run.sensor.axes if axis.measures == kind]
        channels[kind] = tuple(
            (axis.name, str(column), axis.readout.unit)
            for axis, column in zip(axes, columns, strict=False)
        )
    apart = _gyro_file(run) is not None
    return Columns(
        channels=channels["f"] if apart else channels["f"] + channels["w"],
        second=channels["w"] if apart else (),
        time=None if data.time is None or data.kind == "means" else str(data.time),
        time_unit=data.time_unit,
        rate_hz=_column_rate(run),
        label=None if data.label is None else str(data.label),
        temperature=None if data.temperature is None else str(data.temperature),
        temperature_unit=data.temperature_unit,
        nonfinite=data.nonfinite,
    )


def _column_rate(run: Run) -> float | None:
    """Return the rate that times the samples: none where a column of time does."""
    if run.data.kind == "means":
        return 1.0  # rows follow one another; nothing depends on when
    stamped = run.data.time is not None and run.data.time_unit != "sample"
    if run.rate_hz is None and not stamped:
        raise InputError(
            f'{run.path}: [data] rate is missing, such as "100 Hz"; or name the time column, '
            'time = "…" (and time_unit)'
        )
    return None if stamped else run.rate_hz


def _stated_sd(run: Run) -> dict[str, float]:
    likes = {"accelerometer": ("f", "m/s²"), "gyro": ("w", "rad/s")}
    found: dict[str, float] = {}
    for name, text in run.data.sd.items():
        measures, like = likes[name]
        found[measures] = si_value(text, like, f"{run.path}: [data.sd] {name}")
        if found[measures] <= 0:
            raise InputError(f"{run.path}: [data.sd] {name}: {text!r} must be positive")
    return found


def _seconds(run: Run) -> str | None:
    return None if run.data.seconds is None else str(run.data.seconds)


def _stated_marks(run: Run, recording: Recording) -> tuple[Mark, ...]:
    if run.data.marks == "labels":
        return marks_from_labels(recording)
    return as_read(marks_from_file(run.file(run.data.marks)), recording)


def _conditions(run: Run, recording: Recording | None) -> dict[str, str]:
    g = run.bench.gravity
    conditions = {"gravity": readable(g.value, g.sd, "m/s²")}
    if not run.method.free:
        conditions |= {
            "tilt of faces (k = 1)": readable(run.bench.tilt, 0.0, "°"),
            "angle of turns (k = 1)": readable(run.bench.turn_angle, 0.0, "°"),
        }
    if recording is not None and recording.temperature is not None:
        t = recording.temperature
        conditions["temperature"] = f"{t.mean() - 273.15:.2f} °C ({np.ptp(t):.2f} K range)"
    return conditions


def _digest(run: Run, recording: Recording | None) -> str:
    if recording is not None:
        return recording.sha256
    return sha256(run.file(run.data.file).read_bytes()).hexdigest()


def _provenance(run: Run, recording: Recording | None) -> dict[str, str]:
    second: dict[str, str] = {}
    if (gyros := _gyro_file(run)) is not None:
        second["gyro recording"] = str(run.data.gyro_file)
        second["gyro recording sha256"] = sha256_of(gyros)
    return {
        "recording": run.data.file,
        "recording sha256": _digest(run, recording),
        **second,
        "run file": run.path.name,
        "run file sha256": run.sha256,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "inercal": version("inercal"),
    }
