"""Check a turntable's readback against the readings, before they are filtered.

The checks find wrong units, signs and orders of columns. They compare the rate vector from the
readback with the gyros, and the direction of gravity with the accelerometers. A usable sensor
passes, with scale factor errors up to 5 %, misalignments of 5°, and biases of 1 °/s and 100 mg.
"""

from collections.abc import Sequence
from math import degrees, pi, radians
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_count, format_duration, format_quantity
from inercal.benches.stated_axes import identity_permutation
from inercal.benches.turntable.attitude import motion, reference_attitude
from inercal.benches.turntable.bench import MAX_GAP_SECONDS as WITHOUT
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.exchange_fits import (
    MAX_SOUND_COST,
    BlockMeans,
    ExchangeFit,
    alternative_axis_orders,
    block_means,
    find_exchanges,
    moments,
)
from inercal.benches.turntable.reading.host_readback import Interruption, are_interrupted
from inercal.physics.quantities import QUANTITIES, Measures
from inercal.physics.sensors import Sensor
from inercal.recordings import GAP_FACTOR, Finding, Track

_STILL = 1e-3  # rad; every usable run turns more, in any unit
_TURNS = radians(1)  # rad/s that gyros read in addition to their bias while the table turns
_SIZE = 1.2  # a usable scale factor is between the inverse of this and this
_SPHERE = 4  # readings needed to determine a centre and a radius
_ALL_ROUND = 0.3  # ratio of the smallest to the largest spread of attitudes needed for that
_TILTED = 0.05  # ratio of the largest spread to the norm needed for that
_WEIGHT = (0.7, 1.4)  # possible norm at rest in g
_USUAL = (0.9, 1.1)
_NEAR = 1.1  # tolerance factor for the ratio between two units
_OWN_UNIT = 0.05  # difference of the angles' ratio from 1 that is not a scale factor of the gyros
_GON = 10 / 9  # gon per degree
_NAMED = 5  # most gaps that are named
_ATTITUDES, _APART = 6, radians(10)
_TURNED = 2 * pi  # rad about each axis of the body


class ColumnNames(NamedTuple):
    """Names of the columns in the user's files."""

    accelerometer: tuple[str, ...]
    gyro: tuple[str, ...]
    readback: tuple[str, ...]


def check_track(
    where: str,
    track: Track,
    sensor: Sensor,
    bench: Turntable,
    columns: ColumnNames | None = None,
    interruptions: Sequence[Interruption] = (),
) -> tuple[Finding, ...]:
    """Check a track, and return findings about gaps and about too few attitudes or turns.

    Parameters
    ----------
    where : str
        Start of error messages, such as the path of the run file.
    track : Track
        Track with readings (..., n, m) in SI in the order of the sensor's axes. Every trial is
        checked.
    sensor : Sensor
        Sensor with accelerometers, gyros or both.
    bench : Turntable
    columns : ColumnNames, optional
        Names for messages; by default the names of the sensor's and the table's axes.
    interruptions : sequence of Interruption
        Interruptions of the run, during which missing samples are not a fault of the recording.

    Raises
    ------
    InputError
        The table never moved, or the columns of readback, gyros or accelerometers have a wrong unit
        or are exchanged or reversed. `key` is the key to change, and `names` are the settings in
        the run file that would fit.
    """
    if columns is None:
        by = {kind: tuple(a.name for a in sensor.axes if a.measures == kind) for kind in "fw"}
        columns = ColumnNames(by["f"], by["w"], bench.names)
    odd: tuple[Finding, ...] = ()
    few: tuple[Finding, ...] = ()
    for index in np.ndindex(track.reading.shape[:-2]):
        one = track.trial(*index)
        result = block_means(one, sensor)
        with error_location(where):
            _require_motion(one, result)
            odd = odd or _check_gravity_norm(result, sensor, bench)
            _require_rate_ratio(result.subsample(), sensor, bench, columns)
            _require_axes(result.subsample(), sensor, bench, columns)
        few = few or (
            *_attitude_findings(one, sensor, bench),
            *_turn_findings(result, sensor, bench),
        )
    return (*_gap_findings(track.time, interruptions), *odd, *few)


def _rate_beyond_bias(made: BlockMeans) -> Array:
    """Return the norm of the gyros' readings after subtracting the readings at rest, (b,) rad/s."""
    w = made.readings["w"]
    bias = np.median(w[made.is_still], axis=0) if made.is_still.any() else np.median(w, axis=0)
    return np.linalg.norm(w - bias, axis=-1)


def _require_motion(track: Track, made: BlockMeans) -> None:
    if np.ptp(track.angles, axis=0).max() > _STILL:
        return
    gyros = made.readings["w"]
    fastest = float(np.percentile(_rate_beyond_bias(made), 99)) if gyros.size else 0.0
    if fastest > _TURNS:
        raise InputError(
            f"the readback does not change while the gyros measure {degrees(fastest):.3g} "
            "°/s: check the readback's columns and unit",
            key="[data] table",
        )
    raise InputError(
        "according to its readback the table never moved; check [data] table, or record "
        "holds in several attitudes and turns about all axes"
    )


def _is_triad(sensor: Sensor, kind: Measures) -> bool:
    """Return whether three axes of a kind are at right angles."""
    axes = sensor.input_axes(kind)
    return len(axes) == len("xyz") and np.allclose(axes @ axes.T, np.eye(3))


def _check_gravity_norm(made: BlockMeans, sensor: Sensor, bench: Turntable) -> tuple[Finding, ...]:
    """Refuse accelerometers if their norm at rest is far from g, and warn if it is not near g."""
    if not _is_triad(sensor, "f") or not made.is_still.any():
        return ()
    times = _size_at_rest(made.readings["f"][made.is_still]) / bench.gravity.value
    if not _WEIGHT[0] < times < _WEIGHT[1]:
        raise InputError(
            f"[data] accelerometer: at rest the readings' norm is {times:.3g} times "
            f"gravity, {bench.gravity.value:.4g} m/s²; check the unit and the scale in "
            "[sensor.accelerometer]",
            key="[data] accelerometer",
        )
    if _USUAL[0] < times < _USUAL[1]:
        return ()
    text = (
        f"specific force at rest is {times:.3g} times gravity, {bench.gravity.value:.4g} m/s²; "
        "check the nominal scale"
    )
    return (Finding("warning", "units", text),)


def _size_at_rest(force: Array) -> float:
    """Return the norm of readings (n, 3) at rest in several attitudes, without biases.

    Readings at rest lie near a sphere about the biases, |f|² = 2 c·f + R² − |c|². If the attitudes
    do not determine the centre of the sphere, the median norm replaces its radius.
    """
    centred = force - force.mean(axis=0)
    spread = np.linalg.svd(centred, compute_uv=False) / np.sqrt(len(force))
    size = float(np.median(np.linalg.norm(force, axis=-1)))
    is_one_attitude = spread[0] < _TILTED * size  # the noise has a spread in all directions
    if len(force) < _SPHERE or is_one_attitude or spread[-1] < _ALL_ROUND * spread[0]:
        return size
    columns = np.concatenate([2 * force, np.ones((len(force), 1))], axis=-1)
    solved = np.asarray(np.linalg.lstsq(columns, (force**2).sum(-1), rcond=None)[0], dtype=float)
    return float(np.sqrt(max(solved[3] + solved[:3] @ solved[:3], 0.0)))


def _require_rate_ratio(
    made: BlockMeans, sensor: Sensor, bench: Turntable, columns: ColumnNames
) -> None:
    """Refuse a readback whose rates differ in size from the rates that the gyros measure."""
    if not _is_triad(sensor, "w"):
        return
    by = _rate_ratios(made)
    off = {k: times for k, times in by.items() if not 1 / _SIZE < times < _SIZE}
    if not off:
        return
    times = float(np.median(list(off.values())))
    alike = max(off.values()) < _NEAR**2 * min(off.values())
    if len(off) < len(by) or not alike:
        text = ", ".join(f"{columns.readback[k]} {times:.3g}" for k, times in by.items())
        raise InputError(
            "while one axis of the table turns, the gyros measure these multiples of the "
            f"readback's rate: {text}; check the unit of each readback column and the gyros' "
            "scales",
            key="[data] table",
            names=tuple(columns.readback[k] for k in off),
        )

    def gravity_fits(factor: float) -> bool:
        """Return whether gravity fits the attitudes from the readback multiplied by a factor."""
        fit = moments(bench, sensor, made, identity_permutation(len(bench.axes)), factor).get("f")
        return fit is not None and fit.cost() <= MAX_SOUND_COST

    text = f"the gyros read {times:.4g} times the rate of the readback"
    scales = (
        "check the unit and the scale in [sensor.gyro], and [data] time or rate: "
        f"{describe_sampling(made.time, made.step)}"
    )
    gyros = f"[data] gyro: {_describe_unit_error(times, '°/s', 'rad/s') or scales}"
    unit = _describe_unit_error(1 / times, "°", "rad")
    key = "[data] table_unit" if unit else "[data] table"
    table = f"{key}: {unit or 'check its unit'}"
    if gravity_fits(1.0):
        text += f", and gravity agrees with the readback: {gyros}"
        raise InputError(text, key="[data] gyro")
    if gravity_fits(times):
        text += f", and gravity agrees with the gyros: {table}"
        raise InputError(text, key=key)
    raise InputError(f"{text}: either {gyros}; or {table}")


def describe_sampling(time: Array, step: float | None = None) -> str:
    """Describe the duration of a recording and the time between its samples in words."""
    duration, step = time[-1] - time[0], step or float(np.median(np.diff(time)))
    between = format_quantity(step, 0.0, "s", 3)
    return (
        f"according to its times the recording lasts {format_duration(duration)}, with {between} "
        "per sample"
    )


def _rate_ratios(made: BlockMeans) -> dict[int, float]:
    """Return the ratio of gyro rate to readback rate for each axis that turns by itself."""
    speed, size = np.abs(made.rates), _rate_beyond_bias(made)
    fastest = np.percentile(speed, 99.5, axis=0)
    found: dict[int, float] = {}
    for k in range(speed.shape[-1]):
        others = np.delete(speed, k, axis=-1).max(axis=-1, initial=0.0)
        alone = (speed[:, k] > fastest[k] / 3) & (others < speed[:, k] / 30) & ~made.is_still
        if alone.sum() >= 5:
            found[k] = float(np.median(size[alone] / speed[alone, k]))
    return found


def _describe_unit_error(times: float, large: str, small: str) -> str:
    """Describe the unit error of readings that are `times` too large, or return "" if none fits."""
    one = degrees(1)
    if one / _NEAR < times < one * _NEAR:
        return f"it is in {large}, read as {small}; state its unit"
    if 1 / one / _NEAR < times < _NEAR / one:
        return f"it is in {small}, read as {large}; state its unit"
    return ""


def _require_axes(made: BlockMeans, sensor: Sensor, bench: Turntable, columns: ColumnNames) -> None:
    """Refuse columns that are exchanged or reversed, and axes with another scale."""
    by = moments(bench, sensor, made, identity_permutation(len(bench.axes)))
    off = {kind: m for kind, m in by.items() if m.cost() > MAX_SOUND_COST}
    if not off:
        return
    remedies = [
        (fit.cost, _describe_exchange(fit, columns))
        for fit in find_exchanges(bench, sensor, made)[:2]
    ]
    remedies += [
        (cost, (f'[bench] axes = "{axes}"',))
        for cost, axes in alternative_axis_orders(bench, sensor, made)
    ]
    if remedies:
        best = [keys for _, keys in sorted(remedies)[:2]]
        ways = "; or they fit with ".join(" and ".join(keys) for keys in best)
        raise InputError(f"readings and readback do not agree; they fit with {ways}", names=best[0])
    names_of = {"f": columns.accelerometer, "w": columns.gyro}
    factors: list[str] = []
    for kind, m in off.items():
        key, names = QUANTITIES[kind].sensor, names_of[kind]
        pairs = zip(names, m.factors().tolist(), strict=True)
        factors.append(f"[data] {key}: " + ", ".join(f"{n} {x:.3g}" for n, x in pairs))
    text = (
        f"readings and readback do not agree in any order or sign of their columns; "
        f"their changes are these multiples of the expected ones: {'; '.join(factors)}"
    )
    ratios = [1 / times for times in _rate_ratios(made).values()]
    times = float(np.median(ratios)) if ratios else 1.0
    if abs(times - 1) > _OWN_UNIT and max(ratios) < (1 + _OWN_UNIT) * min(ratios):
        gon = " (gon, read as °, would give 1.11)" * bool(abs(times / _GON - 1) < _OWN_UNIT)
        raise InputError(
            f"{text}; the table's angles change {times:.3g} times as fast as the gyros' readings"
            f"{gon}: check the unit of the angles, [data] table_unit",
            key="[data] table_unit",
        )
    raise InputError(f"{text}; check the columns, the scales and the zero of the table's angles")


def _describe_exchange(fit: ExchangeFit, columns: ColumnNames) -> tuple[str, ...]:
    """Return the settings in the run file that undo the exchanges of a fit."""
    exchanges = (
        ("table", fit.readback, columns.readback),
        ("gyro", fit.gyro, columns.gyro),
        ("accelerometer", fit.accelerometer, columns.accelerometer),
    )
    return tuple(
        f"[data] {key} = {way.signed_names(names)}"
        for key, way, names in exchanges
        if not way.is_identity
    )


def _attitude_findings(track: Track, sensor: Sensor, bench: Turntable) -> tuple[Finding, ...]:
    """Return a warning if the holds have too few directions of gravity for the accelerometers."""
    numbers = np.unique(track.hold[track.hold >= 0])
    middles = [int(np.median(np.flatnonzero(track.hold == k))) for k in numbers]
    up = reference_attitude(bench, track.angles[middles])[:, 2, :]  # in the body
    distinct: list[Array] = []
    for direction in up:
        if all(np.linalg.norm(direction - other) > _APART for other in distinct):
            distinct.append(direction)
    axes = {CoefficientName(name).axis for name in sensor.coefficients}
    unused = axes and not axes & set(sensor.select_axes("f").channels)
    if len(distinct) >= _ATTITUDES or sensor.rank("f") < len("xyz") or unused:
        return ()
    text = (
        f"the {numbers.size} holds have {len(distinct)} different upward directions; the "
        f"accelerometers' coefficients need {_ATTITUDES} or more, each axis up and down"
    )
    return (Finding("warning", "attitudes", text),)


def _turn_findings(made: BlockMeans, sensor: Sensor, bench: Turntable) -> tuple[Finding, ...]:
    """Return a warning about gyros with a scale to estimate that the table hardly turned."""
    sensed = motion(bench, made.angles, made.rates, np.zeros_like(made.rates), {})
    step = float(np.median(np.diff(made.time)))
    gyros = sensor.select_axes("w")
    turned = np.abs(sensed.w[~made.is_still] @ gyros.input_axes("w").T).sum(axis=0) * step
    few = [
        f"{name} {degrees(t):.3g}°"
        for name, t in zip(gyros.channels, turned, strict=True)
        if t < _TURNED and (not sensor.coefficients or f"{name}.scale" in sensor.coefficients)
    ]
    if not few:
        return ()
    text = f"the table hardly turned about the axes of these gyros: {', '.join(few)}"
    return (Finding("warning", "turns", f"{text}; their scales need 360° or more about each"),)


def _gap_findings(time: Array, interruptions: Sequence[Interruption]) -> tuple[Finding, ...]:
    """Return a note on gaps, and a warning for gaps over which filters cannot predict attitude."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    at = np.flatnonzero(steps > GAP_FACTOR * usual)
    at = at[~are_interrupted(time[at], time[at + 1], interruptions)]
    lost = steps[at] - usual
    long = [k for k in range(at.size) if steps[at[k]] > WITHOUT]
    found: list[Finding] = []
    if at.size:
        samples = round(float(lost.sum()) / usual)
        text = f"{format_count(at.size, 'gap')}: {format_count(samples, 'sample')} lost, "
        text += format_duration(float(lost.sum()))
        found.append(Finding("note", "gap", f"{text} in all", None, int(at[0]), int(at[-1]) + 2))
    for nth, k in enumerate(long[:_NAMED], start=1):
        more = (
            f" ({format_count(len(long) - _NAMED, 'further gap')} too)"
            if nth == _NAMED < len(long)
            else ""
        )
        text = f"no sample for {format_duration(float(steps[at[k]]))} after {time[at[k]]:.6g} s"
        text += f": the attitude is initialised again from the readback{more}"
        found.append(Finding("warning", "gap", text, None, int(at[k]), int(at[k]) + 2))
    return tuple(found)
