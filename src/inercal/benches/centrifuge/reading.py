"""From a run on a centrifuge to observations: a table of dwells, or a recording of arm runs."""

from dataclasses import replace
from math import pi

import numpy as np

from inercal.benches.centrifuge.bench import Centrifuge
from inercal.benches.centrifuge.settings import CentrifugeData
from inercal.data import EstimatorInput, Source
from inercal.data.recording_loader import (
    load_recording,
    position_name,
    readback_columns,
    readback_units,
    reader_columns,
    require_not_refused,
    stated_deviations,
)
from inercal.errors import InputError
from inercal.io.mean_tables import observations_from_table, read_columns
from inercal.io.rest_norm import norm_finding
from inercal.keys import CoefficientName
from inercal.plan import Spin, arm_attitude
from inercal.recording import Finding
from inercal.segments import average_dwells, find_dwells
from inercal.units import format_quantity

_HARMONICS = 2  # of a reading quadratic in the sensed motion; a cubic one has a third


def observe(run: Source[CentrifugeData]) -> EstimatorInput:
    """Return the observations of a run on a centrifuge.

    Raises
    ------
    InputError
        The data cannot be used.
    """
    bench: Centrifuge = run.bench
    arms = any(".arm_" in name for name in run.sensor.coefficients)
    if arms and bench.platform != "locked":
        raise InputError(
            f"{run.path}: [method] also: no lever arm acts on a counter-rotating platform; leave "
            "arm out"
        )
    if run.data.seconds is not None:
        raise InputError(
            f"{run.path}: [data] seconds: dwells on the arm last whole turns; remove the key"
        )
    known = bench.indexing is not None or arms
    if known and run.data.attitude is None:
        raise InputError(
            f"{run.path}: [data] attitude is missing: lever arms and [bench] indexing need the "
            "columns of ψ and θ"
        )
    if bench.indexing is not None and bench.platform != "locked":
        raise InputError(
            f"{run.path}: [bench] indexing: on a counter-rotating platform norms alone are used; "
            "leave it out"
        )
    result = _table(run, bench) if run.data.kind == "means" else _recording(run, bench)
    odd = _norm_finding(run, bench, result)
    return replace(result, findings=result.findings + require_not_refused(run.data.file, odd))


def _norm_finding(
    run: Source[CentrifugeData], bench: Centrifuge, made: EstimatorInput
) -> Finding | None:
    """Return what is odd with the readings' norms against those of radius, rate and gravity."""
    rates = np.array([step.rate for step in made.steps if isinstance(step, Spin)])
    if not rates.size or bench.platform != "locked":
        return None  # what turns with a counter-rotating platform leaves no mean
    expected = np.hypot(bench.gravity.value, rates**2 * bench.radius.value)
    norms = np.linalg.norm(
        made.observations.mean[:, : len(run.sensor.select_axes("f").axes)], axis=-1
    )
    k = int(np.argsort(norms / expected)[rates.size // 2])
    norm, there = float(norms[k]), float(expected[k])
    text = (
        f"{made.observations.labels[k]}: the readings' norm is {norm:.4g} m/s² where gravity, "
        f"[bench] radius and the rate make {there:.4g} m/s²"
    )
    finding = norm_finding(norm, there, text)
    # Less than twice off, the method itself judges radius and scale.
    return finding if finding is not None and finding.severity == "refused" else None


def _table(run: Source[CentrifugeData], bench: Centrifuge) -> EstimatorInput:
    if bench.platform != "locked":
        raise InputError(
            f"{run.path}: [bench] platform {bench.platform} takes a recording: the means of its "
            "dwells say nothing of the arm's acceleration"
        )
    named, units = readback_columns(run), readback_units(run)
    wanted = reader_columns(run)
    path = run.file(run.data.file)
    table = read_columns(path, wanted, list(named.values()))
    said = {name: table.numbers(column) * units[name] for name, column in named.items()}
    for name, values in said.items():
        bad = np.flatnonzero(~np.isfinite(values) | ((values == 0) & (name == "arm_rate")))
        if bad.size:
            raise InputError(
                f"{path} line {table.first_line + bad[0]}: column {named[name]!r} is "
                f"{table.numbers(named[name])[bad[0]]:g}; give the arm's rate or angle, or take "
                "the row out"
            )
    rates = said["arm_rate"]
    size, unit = units["arm_rate"], run.data.arm_rate_unit
    if unit[:1].isdigit():
        size, unit = pi / 30, "rpm"  # the size of one step is not a name of a unit
    if wanted.label is None:
        names = [f"row {k}" for k in range(1, len(rates) + 1)]
    else:
        names = [position_name(value) for value in table.columns[wanted.label].tolist()]
    labels = tuple(
        f"{name} at {rate:.6g} {unit}" for name, rate in zip(names, rates / size, strict=True)
    )
    durations = np.ones(len(labels))  # nothing depends on them
    observations = observations_from_table(
        path, table, labels, wanted, run.sensor, stated_deviations(run), durations
    )
    attitudes = [None] * len(labels)
    if "psi" in said:
        attitudes = [
            arm_attitude(psi, theta)
            for psi, theta in zip(said["psi"].tolist(), said["theta"].tolist(), strict=True)
        ]
    steps = tuple(
        Spin(label, rate, 0.0, attitude)
        for label, rate, attitude in zip(labels, rates.tolist(), attitudes, strict=True)
    )
    return EstimatorInput(None, (), observations, steps, steps, (), _conditions(bench))


def _recording(run: Source[CentrifugeData], bench: Centrifuge) -> EstimatorInput:
    recording, units = load_recording(run), readback_units(run)
    recording = replace(
        recording,
        readback={name: values * units[name] for name, values in recording.readback.items()},
    )
    dwells, left_out = find_dwells(recording)
    harmonics = 0
    if bench.platform != "locked":
        shorts = {CoefficientName(name).term for name in run.sensor.coefficients}
        if "koq" in shorts:
            raise InputError(
                f"{run.path}: koq bends the reading at zero: its harmonics have no end; calibrate "
                "it on a platform locked to the arm"
            )
        harmonics = _HARMONICS + ("k3" in shorts)
    observations, steps = average_dwells(recording, run.sensor, dwells, harmonics, bench.sense)
    marks = tuple(dwell.mark for dwell in dwells)
    findings = recording.findings + left_out
    return EstimatorInput(
        recording, marks, observations, steps, steps, findings, _conditions(bench)
    )


def _conditions(bench: Centrifuge) -> dict[str, str]:
    place = bench.latitude
    return {
        "gravity": format_quantity(bench.gravity.value, bench.gravity.sd, "m/s²"),
        "static radius": format_quantity(bench.radius.value, bench.radius.sd, "m"),
        "rate of the arm (k = 1)": format_quantity(bench.rate, 0.0, "ppm"),
        "tilt of gravity against the arm (k = 1)": format_quantity(bench.tilt, 0.0, "″"),
        "earth rate along the spindle": "unknown"
        if place is None
        else f"of latitude {format_quantity(place.value, place.sd, '°')}",
        "platform": bench.platform,
    }
