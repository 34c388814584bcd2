"""Collect the facts about a run that its calibration states, such as conditions and ranges.

The facts also include the provenance and the errors that other calibrations share. If a method uses
means of rests or of constant rates, the ranges are computed from the means. If rates change or a
method follows samples, they are computed from samples: gyro readings during turns, on a turntable
or between rests, and accelerometer readings while a turntable holds its position.

Calibrations on the same bench share only errors that the run file states (`SharedError`). An error
that a run estimates from its own data, such as the clock offset of a separate readback file,
belongs only to this run. Errors shared through a prior calibration are not propagated.
"""

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from hashlib import sha256
from json import dumps

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.documents import installed_version
from inercal.basics.parameters import Parameter
from inercal.basics.units import ZERO_CELSIUS, format_count
from inercal.calibration import SharedError, Validity
from inercal.calibration.calibration import SIMULATED
from inercal.calibration.shared_errors import BenchEstimate
from inercal.calibration.type_prior import load_type_prior
from inercal.calibration.validity import TEMPERATURE_MARGIN, Range
from inercal.estimation import Estimate
from inercal.physics.plan import Turn
from inercal.physics.quantities import QUANTITIES
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor
from inercal.pipeline.drafts.column_names import axes_of_names
from inercal.pipeline.stated_values import qualified_errors
from inercal.recordings import Finding
from inercal.recordings.data import EstimatorInput
from inercal.recordings.data.recording_loader import gyro_file, unsigned_column
from inercal.recordings.io.column_table import file_sha256
from inercal.recordings.io.simulation_mark import read_simulation_mark
from inercal.recordings.temperature import TEMPERATURE_UNIT, ambient_findings
from inercal.runfile import Run

_LEAST_KNOWN = 0.1  # the data must reduce the stated variance by this fraction
_LEAST_OWN = 1e-4  # least independent fraction of the variance of a bench estimate
_TYPE_PRIOR = "prior of the type"
_GRAVITY = "g"  # a parameter of every bench
_BLOCK = 1 << 16  # samples
KEPT_CORRECTIONS = "corrections that the readings hold"
CROSSED_COLUMNS = "columns with the name of another axis, or reversed"


def run_conditions(run: Run, inputs: EstimatorInput) -> dict[str, str]:
    """Return the conditions of the measurement and, if any, of the search, as text."""
    conditions = dict(inputs.conditions)
    recording = inputs.recording
    t = inputs.observations.temperature
    if t is None and recording is not None:
        t = recording.temperature
    if t is not None:
        conditions["temperature"] = f"{t.mean() - ZERO_CELSIUS:.2f} °C ({np.ptp(t):.2f} K range)"
    if recording is not None and recording.kept_corrections:
        conditions[KEPT_CORRECTIONS] = recording.kept_corrections
    if crossed := crossed_columns(run):
        conditions[CROSSED_COLUMNS] = crossed
    if recording is not None and recording.devices:
        conditions["devices"] = recording.devices
    if (search := run.search) is not None:
        bounds = search.bounds
        conditions["search"] = (
            f"seed {search.seed}, goal {100 * search.goal:.3g} %, at most {search.seconds:.3g} s"
        )
        conditions["bounds of the search"] = (
            f"scale ±{100 * bounds.scale:.3g} %, cross ±{100 * bounds.cross:.3g} %, "
            f"bias ±{bounds.bias:.3g} g"
        )
    return conditions


def crossed_columns(run: Run) -> str:
    """Return the axes whose columns are named after another axis or reversed, as "gx = -gy"."""
    found: list[str] = []
    for kind in QUANTITIES.values():
        given = [str(column) for column in getattr(run.data, kind.sensor)]
        plain = [unsigned_column(name) for name in given]
        axes = [axis.name for axis in run.whole_sensor.axes if axis.measures == kind.symbol]
        ends = axes_of_names(plain) or tuple(name[-1] for name in axes)
        for axis, end, name, own in zip(axes, ends, given, plain, strict=False):
            sign = "-" * (name != own and not own.startswith("-("))  # "-(X)" is the name of −x
            if sign or (axis[-1] in "xyz" and axis[-1] != end):
                found.append(f"{axis} = {sign}{axis[:-1]}{end}")
    return ", ".join(found)


def prior_of_type(run: Run, inputs: EstimatorInput) -> dict[str, str]:
    """Return the file of the type prior and the number of its sensors as a condition, if any.

    Raises
    ------
    InputError
        The prior was made with this sensor or this recording, whose data would then count twice.
    """
    if not (name := run.sections.get("method", {}).get("prior_type")):
        return {}
    sensors = load_type_prior(run.file(name)).sensor
    mine = {run.sensor.name, _recording_sha256(run, inputs)}
    if own := [one.name for one in sensors if mine & {one.name, one.recording_sha256}]:
        what = f"{name} contains {own[0]}, which is this sensor or has this recording"
        what += f"; make the prior again with --without '{own[0]}'"
        raise key_error("[method] prior_type", what, names=(own[0],)).located(run.path)
    return {_TYPE_PRIOR: f"{name}, from {format_count(len(sensors), 'sensor')}"}


def provenance(run: Run, inputs: EstimatorInput) -> dict[str, str]:
    """Return names and SHA-256 hashes of a run's files, the time, and the version of inercal."""
    further: dict[str, str] = {}
    if run.data.gyro_file is not None and (gyros := gyro_file(run)) is not None:
        further["gyro recording"] = str(run.data.gyro_file)
        further["gyro recording sha256"] = file_sha256(gyros)
    for name, one in zip(run.qualified.files, run.qualified.each, strict=True):
        further[f"qualification {name} sha256"] = file_sha256(run.file(name))
        further[f"qualification {name} determination"] = one.determination
    for what, name in run.data.further_files().items():
        further[what] = name
        further[f"{what} sha256"] = file_sha256(run.file(name))
    if (prior := run.sections.get("method", {}).get("prior_type")) is not None:
        further |= {_TYPE_PRIOR: prior, f"{_TYPE_PRIOR} sha256": file_sha256(run.file(prior))}
    if simulated := _simulation(run, inputs):
        further[SIMULATED] = simulated
    return {
        "recording": run.data.file,
        "recording sha256": _recording_sha256(run, inputs),
        **further,
        "run file": run.path.name,
        "run file sha256": run.sha256,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "inercal": installed_version(),
    }


def _recording_sha256(run: Run, inputs: EstimatorInput) -> str:
    recording = inputs.recording
    return file_sha256(run.file(run.data.file)) if recording is None else recording.sha256


def _simulation(run: Run, inputs: EstimatorInput) -> str:
    """Say how we know that the data are simulated; empty if there is no evidence for this."""
    if inputs.recording is None:
        mark = read_simulation_mark(run.file(run.data.file))
    else:
        mark = inputs.recording.simulation
    return mark or ("[sensor.truth] of the run file" if run.truth else "")


def validity(run: Run, inputs: EstimatorInput) -> Validity:
    """Return the ranges of the data that were used; None if a quantity was not measured.

    If all temperature coefficients come from priors, their data are also part of the range.
    """
    sensor = run.sensor
    magnetic = inputs.observations.magnetic
    return Validity(
        rate=_finite_range(_readings(sensor, inputs, "w")),
        force=_finite_range(_readings(sensor, inputs, "f")),
        temperature=_with_range_of_priors(run, _finite_range(_temperatures(inputs))),
        field=None if magnetic is None else _finite_range(iter(magnetic.parts)),
    )


def _with_range_of_priors(run: Run, found: Range | None) -> Range | None:
    """Return the range of temperatures that the data of the run or of the priors cover."""
    names = [n for n in run.sensor.coefficients if run.sensor.coefficient(n).basis.uses("dT")]
    known = [prior for prior in run.priors if set(names).intersection(prior.names)]
    ranges = [prior.temperature for prior in known if prior.temperature is not None]
    stated = {name for prior in known for name in prior.names}
    if found is None or not ranges or len(ranges) < len(known) or not stated.issuperset(names):
        return found
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    if max(low, found[0]) > min(high, found[1]) + TEMPERATURE_MARGIN:
        return found  # between the two ranges there are no data
    return min(low, found[0]), max(high, found[1])


def _finite_range(parts: Iterator[Array]) -> Range | None:
    low, high = np.inf, -np.inf
    for values in parts:  # one part at a time, because all are as large as the recording
        finite = values[np.isfinite(values)]
        low = min(low, float(finite.min(initial=np.inf)))
        high = max(high, float(finite.max(initial=-np.inf)))
    return (low, high) if low <= high else None


def _readings(sensor: Sensor, inputs: EstimatorInput, kind: str) -> Iterator[Array]:
    """Yield the readings of the accelerometers ("f") or gyros ("w"), SI."""
    observations = inputs.observations
    at = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
    track, transitions = observations.track, observations.transitions
    if track is not None:
        for start in range(0, track.time.size, _BLOCK):
            part = slice(start, start + _BLOCK)
            reading = track.reading[..., part, :]
            yield (reading if kind == "w" else reading[..., track.hold[part] >= 0, :])[..., at]
        return
    yield observations.mean[..., at]
    if kind == "w":
        yield from _turning(sensor, inputs, at)
    if transitions is not None and kind == "w":
        for start, stop in zip(transitions.start.tolist(), transitions.stop.tolist(), strict=True):
            yield sensor.to_si(transitions.output[start : stop + 1])[:, at]


def _turning(sensor: Sensor, inputs: EstimatorInput, at: list[int]) -> Iterator[Array]:
    """Yield gyro readings during turns, SI, because the mean of a turn hides its rate."""
    recording = inputs.recording
    turns = {step.label for step in inputs.steps if isinstance(step, Turn)}
    if recording is None or not turns:
        return
    columns = [recording.channels.index(sensor.channels[k]) for k in at]
    gyros = sensor.select_axes("w")
    for mark in inputs.marks:
        if mark.label in turns:
            yield gyros.to_si(recording.data[..., mark.start : mark.stop, columns])


def _temperatures(inputs: EstimatorInput) -> Iterator[Array]:
    """Yield the temperatures of the data that were used, K."""
    recording, marks, observations = inputs.recording, inputs.marks, inputs.observations
    if recording is None and observations.temperature is not None:
        yield observations.temperature
    if recording is None or recording.temperature is None:
        return
    if observations.track is not None or not marks:
        yield recording.temperature
    elif observations.transitions is not None:
        first, last = min(mark.start for mark in marks), max(mark.stop for mark in marks)
        yield recording.temperature[..., first:last]
    else:
        for mark in marks:
            yield recording.temperature[..., mark.start : mark.stop]


def temperature_findings(run: Run, inputs: EstimatorInput) -> tuple[Finding, ...]:
    """Return a warning if the temperatures seem to be in another unit than the run file says.

    A run that states [environment] has a sensor that is not at the temperature of the room.
    """
    found, ambient = _finite_range(_temperatures(inputs)), run.job.get("ambient temperature")
    if found is None or not ambient or run.environment is not None:
        return ()
    if any(one.what == TEMPERATURE_UNIT for one in inputs.findings):
        return ()
    stated = "temperature_unit" in run.sections.get("data", {})
    return ambient_findings(found, ambient, run.data.temperature_unit, stated=stated)


def shared_errors(
    run: Run, estimate: Estimate, expected: Mapping[str, Parameter], count: int
) -> tuple[SharedError, ...]:
    """Return bench errors that last longer than the run and contribute to the covariance.

    Parameters
    ----------
    run : Run
    estimate : Estimate
        Estimate; its first `count` parameters are the sensor's coefficients.
    expected : mapping of str to Parameter
        Bench parameters that have an effect, by full name.
    count : int
    """
    declared = {q.name: q for q in run.bench.parameters}
    shared = list(qualified_errors(run, estimate, expected, count))
    for name, q in {**expected, **_magnetic_field(run, estimate)}.items():
        # A reader may declare more parameters than the bench of the run, such as a latitude with
        # its uncertainty.
        if q.scope != "run" or q.sd <= 0 or declared.get(q.name, q) != q:
            continue
        if q.name in run.qualified.parameters.names:
            continue
        sensitivity = estimate.sensitivity(name, q.sd)
        # A bench may increase the deviation of gravity; the stated one is shared.
        std = run.bench.gravity.sd if q.name == _GRAVITY else q.sd
        if sensitivity is not None and std > 0:
            column = sensitivity[:count] * std**2
            shown = q.name if name == "strength" else name  # the key of the run file is "field"
            shared.append(SharedError(shown, q.unit, std, column, _determination(run, q, std)))
    return tuple(shared)


def _magnetic_field(run: Run, estimate: Estimate) -> dict[str, Parameter]:
    """Return the stated strength and dip of the field, if the magnetometers depend on them.

    The estimators of other sensors do not know them, so they are no nuisances of the bench.
    """
    stated = (("strength", "T", "field"), ("dip", "rad", "dip"))
    return {
        name: Parameter(key, unit, one.sd, "run", one.value)
        for name, unit, key in stated
        if name in estimate.names and (one := getattr(run.bench, key, None)) is not None
    }


def bench_estimates(
    estimate: Estimate, expected: Mapping[str, Parameter], count: int
) -> tuple[BenchEstimate, ...]:
    """Return estimates of the bench parameters that come only from the data of the run.

    Parameters
    ----------
    estimate : Estimate
        Estimate; its first `count` parameters are the sensor's coefficients.
    expected : mapping of str to Parameter
        Bench parameters that have an effect, by full name.
    count : int

    Returns
    -------
    tuple of BenchEstimate
        Estimates. Two kinds of parameters are omitted: parameters for which the uncertainty from
        the data is more than about three times the stated uncertainty, and parameters with
        correlated stated values.
    """
    known = {
        name: (k, expected[name])
        for k, name in enumerate(estimate.names)
        if k >= count and name in expected and expected[name].scope == "run"
        and expected[name].sd > 0 and name not in estimate.joint_priors
    }  # fmt: skip
    found: list[BenchEstimate] = []
    covariance, birge = estimate.covariance, float(estimate.birge)
    for name, (k, q) in known.items():
        left = q.sd**2 - float(covariance[k, k])
        if left < _LEAST_KNOWN * q.sd**2:
            continue
        column = covariance[:, k] * (q.sd**2 / left)  # P'_q
        common = sum(float(column[i]) ** 2 / r.sd**2 for i, r in known.values() if i != k)
        variance = float(column[k])
        off = float(estimate.value[k]) - q.value
        found.append(
            BenchEstimate(
                name, q.unit, q.meaning,
                q.value + off * q.sd**2 / left,
                birge * variance**0.5,
                birge * max(variance - common, _LEAST_OWN * variance) ** 0.5,
                q.value, q.sd,
            )
        )  # fmt: skip
    return tuple(found)


def _determination(run: Run, q: Parameter, std: float) -> str:
    """Return a SHA-256 hash that identifies a stated error of a place or of a bench.

    Local gravity belongs to the place and is the same for all benches in this place. Every other
    error belongs to the bench with this kind and name.
    """
    bench = [] if q.name == _GRAVITY else [run.kind.name, run.bench_name]
    stated = [*bench, q.name, q.unit, q.value, std]
    return sha256(dumps(stated, ensure_ascii=False).encode()).hexdigest()
