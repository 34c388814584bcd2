"""Read the observations from a centrifuge run: a table of dwells, or a recording of arm runs.

The units of the rate, the radius and the accelerometers are checked from norms. The norm of the
readings is √(g² + (r ω²)²) on a platform that is locked to the arm. Units of the readings multiply
the norm by the same factor at all rates. Units of the rate or the radius multiply only its
centripetal part. If gravity is too small to tell them apart, the message names both.
"""

from dataclasses import replace
from math import pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_quantity
from inercal.benches.arm import fitting_arm_unit
from inercal.benches.centrifuge.bench import Centrifuge
from inercal.benches.centrifuge.kind import CentrifugeData, require_locked_platform
from inercal.benches.stated_axes import signed_permutations
from inercal.physics.plan import Spin, arm_attitude
from inercal.physics.section_settings import key_error
from inercal.recordings import Finding, Recording
from inercal.recordings.data import EstimatorInput, RunBase, recording_loader
from inercal.recordings.io.mean_tables import observations_from_table, read_columns
from inercal.recordings.io.rest_norm import UNIT_CONFUSIONS, norm_finding
from inercal.recordings.segments import average_dwells, find_dwells
from inercal.recordings.segments.dwells import ARM_RATE

_AGREES = float(np.log(1.25))  # of the norms, in the right unit
_POSSIBLE = float(np.log(2.0))  # error of a scale factor that is no wrong unit
_IMPOSSIBLE = 30.0  # ratio of norms that no shift of a decimal point by one place explains
_ALIKE = 0.03  # difference of two units' errors that decides nothing
_CLEAR = 0.5  # ratio of the scatter of norms in two units that decides
_LEAST = 1e-9  # m/s², instead of a norm of zero
_MISORDERED, _ORDERED = 0.3, 0.1  # relative differences from the forces at the known attitudes
_TURNING = 0.1  # of the fastest rate: samples below this show gravity at most


def norm_refusal(
    run: RunBase[CentrifugeData], bench: Centrifuge, inputs: EstimatorInput
) -> Finding | None:
    """Return a refusal if the norms of the readings disagree with radius, rate and gravity.

    Raises
    ------
    InputError
        The norms agree if the rate or the radius is in another unit; the message names it.
    """
    steps = [step for step in inputs.steps if isinstance(step, Spin)]
    triad = len(run.sensor.select_axes("f").axes)
    norms = np.linalg.norm(inputs.observations.mean[:, :triad], axis=-1)
    rates = np.array([step.rate for step in steps])
    if not rates.size or bench.platform != "locked":
        return None  # on a counter-rotating platform the centripetal acceleration has no mean
    labels = inputs.observations.labels
    if (refusal := _refusal(run, bench, norms, rates, labels)) is not None:
        return refusal
    expected = np.hypot(bench.gravity.value, rates**2 * bench.radius.value)
    k = int(np.argmin(norms / expected))
    if _IMPOSSIBLE * norms[k] < expected[k]:
        text = f"{_off(labels[k], norms[k], expected[k])}; correct the rate or reading of this row"
        return Finding("refused", "norm", text)
    k = int(np.argmax(norms / expected))
    if norms[k] < _IMPOSSIBLE * expected[k]:
        return None  # screening names smaller mistakes and what would correct them
    column = int(np.argmax(np.abs(inputs.observations.mean[k, :triad])))
    text = f"correct the reading of {run.sensor.select_axes('f').channels[column]}, whose decimal"
    text = f"{_off(labels[k], norms[k], expected[k])}; {text} mark is lost"
    return Finding("refused", "norm", text)


def require_arm_units(
    run: RunBase[CentrifugeData], bench: Centrifuge, recording: Recording
) -> None:
    """Refuse a recording whose samples show that the rate or the radius is in another unit.

    Rates in a wrong unit would also hide the dwells. `recording` has the rate in rad/s.

    Raises
    ------
    InputError
        The message names the unit.
    """
    rates = recording.readback[ARM_RATE]
    turning = np.abs(rates) > _TURNING * np.abs(rates).max(initial=0.0)
    if not turning.any() or bench.platform != "locked":
        return
    sensor = run.sensor.select_axes("f")
    columns = [recording.channels.index(name) for name in sensor.channels]
    read = sensor.to_si(recording.data[turning][:, columns])
    _refusal(run, bench, np.linalg.norm(read, axis=-1), rates[turning])


def _refusal(
    run: RunBase[CentrifugeData],
    bench: Centrifuge,
    norms: Array,
    rates: Array,
    labels: tuple[str, ...] = (),
) -> Finding | None:
    def ratios(times: float) -> Array:
        across = (rates * times) ** 2 * bench.radius.value
        return np.maximum(norms, _LEAST) / np.hypot(bench.gravity.value, across)

    def off(times: float, scale: float = 1.0) -> float:
        return float(np.median(np.abs(np.log(ratios(times) / scale))))

    if off(1.0) <= _POSSIBLE:
        return None  # the method itself judges radius and scale
    unit, left = fitting_arm_unit(run, bench.radius.value, off)
    of_readings = min(off(1.0, scale) for scale in UNIT_CONFUSIONS)
    alike = abs(left - of_readings) < _ALIKE
    spread, of_rates = (float(np.std(np.log(ratios(times)))) for times in (1.0, unit.times))
    by_rates = left < of_readings if not alike else of_rates < _CLEAR * spread
    if left < _AGREES and by_rates:
        raise unit.error(run)
    k = int(np.argsort(ratios(1.0))[rates.size // 2])
    norm, expected = float(norms[k]), float(norms[k] / ratios(1.0)[k])
    text = _off(labels[k] if labels else "a sample", norm, expected)
    finding = norm_finding(norm, expected, text, run.sensor.select_axes("f").axes[0].readout.unit)
    if finding is None or finding.severity != "refused":
        return None
    if left < _AGREES and alike and spread > _CLEAR * of_rates:
        return replace(finding, message=f"{finding.message}; or {unit.text} ({unit.key})")
    return finding


def _off(label: str, norm: float, expected: float) -> str:
    return (
        f"{label}: the norm of the readings is {norm:.4g} m/s², but gravity, [bench] radius and "
        f"the rate give {expected:.4g} m/s²"
    )


def _require_order(run: RunBase[CentrifugeData], bench: Centrifuge, inputs: EstimatorInput) -> None:
    """Refuse columns that only agree with the known attitudes in another order or with other signs.

    Raises
    ------
    InputError
        The message and `names` contain the columns to state.
    """
    sensor = run.sensor.select_axes("f")
    steps = [step for step in inputs.steps if isinstance(step, Spin)]
    expected = bench.mean_motion(steps, {}).motion.f @ sensor.input_axes("f").T
    read = inputs.observations.mean[:, : len(sensor.axes)]
    off = {
        way: float(np.linalg.norm(way.reorder(read) - expected) / np.linalg.norm(expected))
        for way in signed_permutations(len(sensor.axes))
    }
    stated, way = next(iter(off.values())), min(off, key=lambda one: off[one])
    if stated > _MISORDERED and off[way] < _ORDERED:
        named, back = tuple(map(str, run.data.accelerometer)), ""
        if run.data.kind == "means" and min(way.signs) < 0:  # a table has no reversed columns
            signed = zip(way.order, way.signs, strict=True)
            back = f" and the sign of {', '.join(named[k] for k, s in signed if s < 0)} reversed"
            way = way._replace(signs=(1,) * len(named))
        columns = way.signed_names(named)
        raise key_error(
            "[data] accelerometer",
            "the readings contradict the attitudes; they agree with accelerometer = "
            f"{columns}{back}",
            run.path,
            (columns,),
        )


_HARMONICS = 2  # harmonics of a reading quadratic in the motion; a cubic reading has a third


def observe(run: RunBase[CentrifugeData]) -> EstimatorInput:
    """Return the observations from a run on a centrifuge.

    Raises
    ------
    InputError
        The data cannot be used.
    """
    bench: Centrifuge = run.bench
    arms = any(".arm_" in name for name in run.sensor.coefficients)
    known = bench.indexing is not None or arms
    with error_location(run.path):
        if arms and bench.platform != "locked":
            raise key_error(
                "[method] also", "no lever arm acts on a counter-rotating platform; remove arm"
            )
        if run.data.seconds is not None:
            raise key_error(
                "[data] seconds",
                "a dwell lasts whole turns of the arm, which fix its duration; remove the key",
            )
        if known and run.data.attitude is None:
            raise key_error(
                "[data] attitude",
                "is missing: lever arms and [bench] indexing need the attitude; name the columns "
                "of ψ and θ",
            )
        if bench.indexing is not None and bench.platform != "locked":
            raise key_error(
                "[bench] indexing", "a counter-rotating platform uses only norms; remove the key"
            )
    result = _table(run, bench) if run.data.kind == "means" else _recording(run, bench)
    refusal = norm_refusal(run, bench, result)
    if run.data.attitude is not None and bench.platform == "locked":
        _require_order(run, bench, result)
    return replace(
        result,
        findings=result.findings + recording_loader.require_not_refused(run.data.file, refusal),
    )


def _table(run: RunBase[CentrifugeData], bench: Centrifuge) -> EstimatorInput:
    require_locked_platform(run)
    named, units = recording_loader.readback_columns(run), recording_loader.readback_units(run)
    wanted = recording_loader.reader_columns(run)
    path = run.file(run.data.file)
    table = read_columns(path, wanted, list(named.values()))
    readback = {name: table.numbers(column) * units[name] for name, column in named.items()}
    for name, values in readback.items():
        bad = np.flatnonzero(~np.isfinite(values) | ((values == 0) & (name == "arm_rate")))
        if bad.size:
            read = table.numbers(named[name])[bad[0]]
            text = f"is {read:g}; give the arm's rate or angle, or remove the row"
            raise table.cell_error(path, int(bad[0]), named[name], text)
    rates = readback["arm_rate"]
    size, unit = units["arm_rate"], run.data.arm_rate_unit
    if unit[:1].isdigit():
        size, unit = pi / 30, "rpm"  # a size such as "0.5 rev/s" names no unit
    if wanted.label is None:
        names = [f"row {k}" for k in range(1, len(rates) + 1)]
    else:
        names = [
            recording_loader.position_name(value) for value in table.columns[wanted.label].tolist()
        ]
    labels = tuple(
        f"{name} at {rate:.6g} {unit}" for name, rate in zip(names, rates / size, strict=True)
    )
    observations = observations_from_table(
        path, table, labels, wanted, run.sensor, recording_loader.stated_deviations(run)
    )
    attitudes = [None] * len(labels)
    if "psi" in readback:
        attitudes = list(map(arm_attitude, readback["psi"].tolist(), readback["theta"].tolist()))
    steps = tuple(
        Spin(label, rate, 0.0, attitude)
        for label, rate, attitude in zip(labels, rates.tolist(), attitudes, strict=True)
    )
    return EstimatorInput(None, (), observations, steps, steps, (), _conditions(bench))


def _recording(run: RunBase[CentrifugeData], bench: Centrifuge) -> EstimatorInput:
    recording, units = recording_loader.load_recording(run), recording_loader.readback_units(run)
    recording = replace(
        recording,
        readback={name: values * units[name] for name, values in recording.readback.items()},
    )
    require_arm_units(run, bench, recording)
    dwells, left_out = find_dwells(recording)
    harmonics = 0
    if bench.platform != "locked":
        shorts = {CoefficientName(name).term for name in run.sensor.coefficients}
        if "koq" in shorts:
            raise InputError(
                f"{run.path}: koq has infinitely many harmonics on a counter-rotating platform; "
                "calibrate it on a platform locked to the arm",
                file=run.path,
                names=("koq",),
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
        else f"from latitude {format_quantity(place.value, place.sd, '°')}",
        "platform": bench.platform,
    }
