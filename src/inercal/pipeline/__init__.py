"""The main path: from a run file to a calibration, and the same plan in simulation.

run file ─> recording ─> audit ─> marks ─> observations ─> method's estimator ─> calibration
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from hashlib import sha256
from importlib.metadata import version
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from inercal.arrays import Array
from inercal.benches import Bench
from inercal.benches.kind_definition import Kind
from inercal.calibration import Calibration, Frame
from inercal.calibration.grade import Verdict
from inercal.calibration.verdict import verdict
from inercal.data import EstimatorInput, recording_loader
from inercal.data.recording_loader import gyro_file, readback_columns, reader_columns
from inercal.errors import InputError, NotObserved
from inercal.estimate import Estimate
from inercal.io.column_table import file_sha256
from inercal.methods import Fit
from inercal.methods.ship_multi_angle.global_search import Generation, SearchHistory
from inercal.methods.temperature import temperature_coefficients
from inercal.motion import Motion
from inercal.parameters import Parameter
from inercal.pipeline import assumed_constants
from inercal.pipeline.error_sharing import shared_errors
from inercal.pipeline.run_simulation import apply_data_columns, read_out, simulate, simulate_files
from inercal.pipeline.stated_noise import check_stated_noise
from inercal.pipeline.validity_ranges import validity
from inercal.plan import Step
from inercal.recording import Finding, Mark, Observations, Recording
from inercal.runfile import Run, read
from inercal.segments import RestDetection
from inercal.sensors import Sensor
from inercal.units import ZERO_CELSIUS

_ALL = 3  # axes of a kind that see every component


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
    bench : Bench
    kind : Kind
        Of the bench.
    recording : Recording or None
        None when means were read straight in.
    marks : tuple of Mark
    findings : tuple of Finding
        The audit's, and what the checks against the plan noticed.
    verdict : Verdict
        The grade, its reasons, and lines in plain words; iterating gives the lines.
    rests : RestDetection or None
        How rests were found, where they were found without a plan.
    search : SearchHistory or None
        How a search went, of an estimator that searches.
    """

    calibration: Calibration
    estimate: Estimate
    observations: Observations
    steps: tuple[Step, ...]
    bench: Bench
    kind: Kind[Any, Any]
    recording: Recording | None
    marks: tuple[Mark, ...]
    findings: tuple[Finding, ...]
    verdict: Verdict
    rests: RestDetection | None = None
    search: SearchHistory | None = None

    @property
    def expected(self) -> Mapping[str, Parameter]:
        """The bench's parameters that act on these steps, by full name, as they were stated."""
        return self._expected

    @cached_property
    def _expected(self) -> Mapping[str, Parameter]:
        return self.bench.nuisances(self.steps, self.calibration.sensor)

    def sensed_motion(self, w: Array | None = None) -> Motion:
        """Return what the means say was sensed, by the calibration and at their temperatures.

        Parameters
        ----------
        w : (r, 3) array, optional
            Angular rate where the sensor has no gyros, rad/s.
        """
        sensor, seen = self.calibration.sensor, self.observations
        dT = seen.temperature_offset(sensor.reference_temperature)
        output = sensor.to_output(seen.mean)
        return self.calibration.correct(output, w=w, dw=np.zeros((1, 3)), dT=dT)


def calibrate(
    run: Run | str | Path, progress: Callable[[Generation], None] | None = None
) -> Outcome:
    """Calibrate from a run file. Writes nothing.

    Parameters
    ----------
    run : Run or path
    progress : callable, optional
        Called after each generation of a search: number, least sum of squares, worst error.

    Raises
    ------
    InercalError
        The run file, the recording or the marks cannot be used, or coefficients are not observed.
    """
    run = run if isinstance(run, Run) else read(run)
    sensor, inputs = run.sensor, run.kind.observe(run)
    bench = inputs.bench or run.bench
    expected = bench.nuisances(inputs.steps, sensor)
    observations, findings = inputs.observations, (*run.findings, *inputs.findings)
    if inputs.recording is not None:
        findings += check_stated_noise(
            observations, sensor, inputs.steps, by_hand=run.method.unknown_attitudes
        )
    # Filters weigh single samples by the stated noise, in which rounding is not.
    sampled = (
        sensor if observations.track is None else _add_rounding_noise(sensor, inputs.recording)
    )
    generations: list[Generation] = []

    def after(generation: Generation) -> None:
        generations.append(generation)
        if progress is not None:
            progress(generation)

    try:
        estimate = run.solver(after)(observations, sampled, bench, inputs.plan, run.priors)
    except NotObserved as error:
        text = f"{_describe_constant_temperature(inputs, sensor, error)}{_describe_rests(inputs)}"
        raise NotObserved(f"{run.path}: {error}{text}", error.directions) from None
    except InputError as error:
        raise InputError(f"{run.path}: {error}{_describe_rests(inputs)}") from None
    fit = Fit(
        run.estimator,
        sensor,
        bench,
        observations,
        inputs.steps,
        run.priors,
        estimate,
        run.time_offset,
    )
    remarks = run.method.remarks(fit)
    findings += remarks.findings
    if not np.all(estimate.converged):
        text = "".join(f"; {finding.message}" for finding in findings if finding.what == "norm")
        raise InputError(
            f"{run.path}: the fit did not converge; look at the "
            f"{'rows' if inputs.recording is None else 'marks'} and the plan{text}"
        )
    if not np.isfinite(estimate.covariance).all():
        raise InputError(
            f"{run.path}: estimator {run.estimator} states no uncertainty for this noise: it may "
            "leave no root; use another estimator"
        )
    p = len(sensor.coefficients)
    constants = assumed_constants.find_assumed_constants(bench, expected)

    def on(other: Bench) -> Estimate:
        return run.solver()(observations, sampled, other, inputs.plan, run.priors)

    try:
        assumed_constants.require_small_assumed_share(constants, estimate, p, bench, on)
    except InputError as error:
        raise InputError(f"{run.path}: {error}") from None
    conditions = inputs.conditions | _temperature_conditions(inputs) | _search_conditions(run)
    conditions |= remarks.conditions
    if run.bench_name:
        conditions["bench"] = run.bench_name
    estimate = replace(
        estimate,
        notes=(
            *remarks.notes,
            *inputs.notes,
            *observations.notes,
            *estimate.notes,
            *assumed_constants.constant_notes(constants),
        ),
        tests=tuple(dict.fromkeys((*observations.tests, *estimate.tests))),
        # Filters weigh samples by the stated noise.
        noise_dof=observations.dof if observations.track is None else inf,
    )
    row_word = "rest" if run.method.unknown_attitudes else run.kind.words.row
    possible = run.method.possible(sensor)
    judged = verdict(estimate, sensor, findings, expected, possible, row_word)
    calibration = Calibration(
        sensor,
        estimate.value[:p],
        estimate.stated_covariance[:p, :p],
        run.method.name,
        run.estimator,
        conditions,
        _provenance(run, inputs.recording),
        judged.lines,
        _misalignment_frame(run),
        verdict=judged,
        shared=shared_errors(run, estimate, expected, p),
        validity=validity(sensor, inputs),
    )
    return Outcome(
        calibration,
        estimate,
        observations,
        inputs.steps,
        bench,
        run.kind,
        inputs.recording,
        inputs.marks,
        findings,
        judged,
        inputs.rests,
        run.search and SearchHistory(run.search.goal, tuple(generations)),
    )


def _describe_rests(gathered: EstimatorInput) -> str:
    """Return what was found of the rests, for a refusal that they may be the cause of."""
    said = [finding.message for finding in gathered.findings if finding.what == "missing"]
    if gathered.rests is not None:
        said.append(gathered.rests.finding.message)
    return "".join(f"; {text}" for text in said)


def _add_rounding_noise(sensor: Sensor, recording: Recording | None) -> Sensor:
    """Return the sensor with the rounding of its samples in their white noise."""
    assert recording is not None
    axes = (replace(a, noise=a.noise.rounded(recording.rate_hz)) for a in sensor.axes)
    return replace(sensor, axes=tuple(axes))


def _search_conditions(run: Run) -> dict[str, str]:
    if run.search is None:
        return {}
    bounds = run.search.bounds
    return {
        "search": f"seed {run.search.seed}, goal {100 * run.search.goal:.3g} %, at most "
        f"{run.search.seconds:.3g} s",
        "bounds of the search": f"scale ±{100 * bounds.scale:.3g} %, cross "
        f"±{100 * bounds.cross:.3g} %, bias ±{bounds.bias:.3g} g",
    }


def _misalignment_frame(run: Run) -> Frame:
    """Return what the misalignments refer to."""
    return "symmetric" if run.sensor.frame == "symmetric" else run.method.frame(run.bench)


def load_recording(run: Run) -> Recording:
    """Read and audit the run's recording.

    Raises
    ------
    InputError
        It cannot be read, or the audit refuses it.
    """
    return run.kind.audit(recording_loader.load_recording(run), run.sensor, run.bench)


def apply(calibration: Calibration, run: Run | str | Path) -> Recording:
    """Correct the recording that a run file names.

    Returns
    -------
    Recording
        Channels fx, fy, fz (m/s²) and wx, wy, wz (rad/s), whichever the sensor has; of one or two
        accelerometers those along them, what acts across being taken as nothing. Labels and what
        the bench reads back keep their columns' names and units.

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
    axes = calibration.sensor.axes
    count = {kind: sum(axis.measures == kind for axis in axes) for kind in ("f", "w")}
    # What acts across one accelerometer, or across two, is taken as nothing.
    nothing = np.zeros((1, 3))
    motion = calibration.correct(
        recording,
        f=nothing if 0 < count["f"] < _ALL else None,
        w=nothing if 0 < count["w"] < _ALL else None,
    )
    named = readback_columns(run)
    sensed = [("f", "m/s²", motion.f), ("w", "rad/s", motion.w)]
    present = [(kind, unit, values[..., : count[kind]]) for kind, unit, values in sensed]
    return replace(
        recording,
        data=np.concatenate([values for _, _, values in present], axis=-1),
        channels=tuple(kind + axis for kind, _, _ in present for axis in "xyz"[: count[kind]]),
        units=tuple(unit for kind, unit, _ in present for _ in "xyz"[: count[kind]]),
        readback={named[name]: values for name, values in recording.readback.items()},
        label_name=reader_columns(run).label or recording.label_name,
    )


def _describe_constant_temperature(
    gathered: EstimatorInput, sensor: Sensor, error: NotObserved
) -> str:
    """Return what coefficients of temperature lack, where a refusal names one."""
    t = gathered.observations.temperature
    if t is None or not set(temperature_coefficients(sensor)) & set(
        " ".join(error.directions).split()
    ):
        return ""
    low, high = float(t.min()) - ZERO_CELSIUS, float(t.max()) - ZERO_CELSIUS
    return (
        f"; the rows are at {low:.2f} to {high:.2f} °C: coefficients of temperature need rows at "
        "temperatures that differ by more"
    )


def _temperature_conditions(gathered: EstimatorInput) -> dict[str, str]:
    recording = gathered.recording
    t = gathered.observations.temperature if recording is None else recording.temperature
    if t is None:
        return {}
    return {"temperature": f"{t.mean() - ZERO_CELSIUS:.2f} °C ({np.ptp(t):.2f} K range)"}


def _run_digest(run: Run, recording: Recording | None) -> str:
    if recording is not None:
        return recording.sha256
    return sha256(run.file(run.data.file).read_bytes()).hexdigest()


def _provenance(run: Run, recording: Recording | None) -> dict[str, str]:
    second: dict[str, str] = {}
    if (gyros := gyro_file(run)) is not None:
        second["gyro recording"] = str(run.data.gyro_file)
        second["gyro recording sha256"] = file_sha256(gyros)
    for what, name in run.data.further_files().items():
        second[what] = name
        second[f"{what} sha256"] = file_sha256(run.file(name))
    return {
        "recording": run.data.file,
        "recording sha256": _run_digest(run, recording),
        **second,
        "run file": run.path.name,
        "run file sha256": run.sha256,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "inercal": version("inercal"),
    }


__all__ = [
    "Outcome",
    "apply",
    "apply_data_columns",
    "calibrate",
    "load_recording",
    "read_out",
    "simulate",
    "simulate_files",
]
