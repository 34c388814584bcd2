"""Check the unit, sign and axis of the rates, and the axis that is up, against the readings."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import degrees, radians, sqrt

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.units import si_factor
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.sections import (
    SMALL_RATE,
    KnownTurn,
    PlatformStep,
    Pose,
    RateDwell,
)
from inercal.benches.rate_platform.settings import RatePlatformData
from inercal.benches.stated_axes import signed_permutations
from inercal.physics.section_settings import key_error
from inercal.recordings import Mark, Observations, Recording
from inercal.recordings.data import RunBase
from inercal.recordings.io.rest_norm import norm_finding

_LEAST_RATE = 1e-3  # rad/s: slower rates may be smaller than a bias
_CLEAR = 0.5  # times the stated rate: a clear reading on another axis or with the other sign
_USABLE = (0.67, 1.5)  # times nominal: range of scale factors if the run file is correct
_NONLINEAR = 0.15  # largest relative change of a gyro's scale factor from rate to rate
_FEWEST = 3  # rows at a rate: with fewer, any of them may be the wrong one
_NEAR = 0.1  # relative tolerance for the ratio of two units
_UNITS = ("rad/s", "rpm", "rev/s", "°/s")
_STEEPEST = 0.7  # cosine of 45°
_MISORDERED, _ORDERED = 0.3, 0.15  # relative differences from the forces at the stated poses
_BLOCKS = 20  # blocks per section, in two halves
_SIGMAS = 6.0
_STEADY = 2e-4  # largest change relative to the rate
_NORMAL_MEDIAN = 0.6745  # median magnitude of a standard normal number


def require_rates(
    run: RunBase[RatePlatformData],
    observations: Observations,
    bench: RatePlatform,
    steps: Sequence[PlatformStep],
) -> None:
    """Refuse rates whose unit, size, sign or axis disagrees with the gyros.

    Raises
    ------
    InputError
        A rate disagrees; the message names the unit that fits, or the row and the gyro.
    """
    gyros = [k for k, axis in enumerate(run.sensor.axes) if axis.measures == "w"]
    turning = [
        k for k, s in enumerate(steps) if isinstance(s, RateDwell) and abs(s.rate) > _LEAST_RATE
    ]
    rates = bench.without_earth_rate().mean_motion(steps, {}).w
    nominal = rates @ run.sensor.input_axes("w").T
    seen = np.abs(nominal).max(axis=1, initial=0.0) > _CLEAR * np.linalg.norm(rates, axis=1)
    read = observations.mean[:, gyros] - _rough_bias(observations.mean[:, gyros], nominal)
    names = [run.sensor.channels[k] for k in gyros]
    body = read @ run.sensor.input_axes("w")
    _require_settings(run, steps, {k: body[k] for k in turning if len(gyros) == len("xyz")})
    for k in turning if gyros else ():
        most = int(np.argmax(np.abs(read[k])))
        if not seen[k] and abs(read[k, most]) > _CLEAR * abs(rates[k]).max():
            _refuse_row(run, steps[k], f"{names[most]} reads the rate, although its axis is level")
    turning = [k for k in turning if seen[k]]
    if not turning:
        return
    own = np.argmax(np.abs(nominal), axis=1)
    along = np.array([read[k, own[k]] / nominal[k, own[k]] for k in turning])
    ratio = float(np.median(np.abs(along)))
    for k, one in zip(turning, along.tolist(), strict=True):
        most = int(np.argmax(np.abs(read[k])))
        if most != own[k] and abs(read[k, most]) > 2 * abs(read[k, own[k]]):
            _refuse_row(run, steps[k], f"{names[most]} reads the rate, not {names[own[k]]}")
        if one < -_CLEAR * ratio:
            text = f"{names[own[k]]} reads it with the opposite sign"
            _refuse_row(run, steps[k], text)
    if len(turning) >= _FEWEST:
        _require_sizes(run, steps, dict(zip(turning, along.tolist(), strict=True)), read, nominal)
    if not _USABLE[0] < ratio < _USABLE[1]:
        with error_location(run.path):
            _refuse_unit(run, ratio)


def _require_settings(
    run: RunBase[RatePlatformData], steps: Sequence[PlatformStep], read: dict[int, Array]
) -> None:
    """Refuse two settings whose axes were exchanged in all their rows.

    `read` contains the readings of three axes in each usable row, as a vector in the case.
    """
    up: dict[str, set[str]] = {}
    for k, one in read.items():
        step, at = steps[k], int(np.argmax(np.abs(one)))
        if isinstance(step, RateDwell):
            sign = np.sign(one[at]) * (np.sign(step.rate) or 1)
            up.setdefault(step.axis, set()).add("-" * bool(sign < 0) + "xyz"[at])
    for stated, (found, *others) in ((a, sorted(b)) for a, b in up.items()):
        if stated < found and not others and up.get(found) == {stated}:
            text = (
                f"the readings look as if the settings {stated} and {found} were exchanged; "
                "exchange them in the table or labels, or correct the order and signs of the "
                "columns of the sensor"
            )
            raise InputError(f"{run.path}: {text}", file=run.path, names=(stated, found))


def _require_sizes(
    run: RunBase[RatePlatformData],
    steps: Sequence[PlatformStep],
    along: dict[int, float],
    read: Array,
    nominal: Array,
) -> None:
    """Refuse a row whose rate has another size than its gyro reads, judged by the other rows.

    `along` contains the ratio of reading to rate of each row that turns. A row may fit the median
    ratio of all rows, or of the others of its gyro, or the gyro may be clipped.
    """
    own, overall = np.argmax(np.abs(nominal), axis=1), float(np.median(list(along.values())))
    for k, step in enumerate(steps):
        if not isinstance(step, RateDwell) or (step.rate != 0 and k not in along):
            continue
        j = int(own[k] if k in along else np.argmax(np.abs(read[k])))
        others = [one for n, one in along.items() if own[n] == j and n != k] or [overall]
        size = float(read[k, j])
        expected = [float(nominal[k, j]) * one for one in (overall, float(np.median(others)))]
        largest = abs(size) > (1 - _NEAR) * np.abs(read[:, j]).max()
        clipped = largest and abs(size) < min(map(abs, expected))
        if not clipped and all(_differ(size, one) for one in expected):
            text = f"{run.sensor.select_axes('w').channels[j]} reads {degrees(size):.4g} °/s"
            _refuse_row(run, step, text, "correct its rate in the table or label, or leave it out")


def _differ(one: float, other: float) -> bool:
    """Return whether two rates are too different for a nonlinearity or a dead band."""
    return abs(one - other) > max(SMALL_RATE, _NONLINEAR * max(abs(one), abs(other)))


def _rough_bias(read: Array, nominal: Array) -> Array:
    """Return each gyro's median reading in sections where it senses no rate, or 0, (m,)."""
    bias = np.zeros(read.shape[1])
    for k in range(read.shape[1]):
        still = np.abs(nominal[:, k]) < 1e-6 * np.abs(nominal).max(initial=1.0)
        if still.any():
            bias[k] = np.median(read[still, k])
    return bias


_ORDER = "correct axis or sign of the rate in the table, or the order, signs and axes of the gyros"


def _refuse_row(
    run: RunBase[RatePlatformData], step: PlatformStep, text: str, advice: str = _ORDER
) -> None:
    raise InputError(
        f"{run.path}: row {step.label} is {step.describe()}, but {text}; {advice}",
        file=run.path,
        names=(step.label,),
    )


def _refuse_unit(run: RunBase[RatePlatformData], ratio: float) -> None:
    given, means = run.data.rate_size, run.data.kind == "means"
    key = "[data] table_rate_unit" if means else "[data] label"
    for unit in _UNITS:
        factor = si_factor(unit, "rad/s") / given
        if abs(ratio / factor - 1) < _NEAR:
            advice = f'state table_rate_unit = "{unit}"' if means else "state the rates in °/s"
            raise key_error(
                key,
                f"according to the gyros, the rates are {factor:.4g} times as large, in {unit} and "
                f"not in {run.data.table_rate_unit}; {advice}, or correct the unit in "
                "[sensor.gyro]",
                names=(unit,),
            )
    raise key_error(
        key,
        f"the gyros read {ratio:.4g} times the stated rates; check the unit of the rates, and unit "
        "and scale in [sensor.gyro]",
    )


def require_steady(
    run: RunBase[RatePlatformData],
    recording: Recording,
    marks: Sequence[Mark],
    steps: Sequence[PlatformStep],
    known: Callable[[str], Array | float],
) -> None:
    """Refuse dwells whose rate about the table's axis changes during the section.

    A dwell is refused if the means of its halves differ by more than 6σ and 2e-4 of the rate. σ is
    estimated from the median difference between the means of neighbouring blocks. Turns through an
    angle are not checked, because they have no steady rate. The changes that `known` returns for a
    label, such as `level_rate_changes`, are subtracted first.

    Raises
    ------
    InputError
        A rate is not steady; the message names the section.
    """
    for mark, step in zip(marks, steps, strict=True):
        if isinstance(step, KnownTurn) or not isinstance(step, RateDwell):
            continue
        columns = [recording.channels.index(name) for name in run.sensor.channels]
        data = run.sensor.to_si(recording.data[mark.start : mark.stop, columns])
        for axis, read in zip(run.sensor.axes, (data - known(mark.label)).T, strict=True):
            if axis.measures != "w" or abs(np.array(axis.i) @ np.array(step.up)) < _CLEAR:
                continue
            change, sd = _change_between_halves(read)
            if abs(change) > _SIGMAS * sd + _STEADY * abs(step.rate):
                where = f"section {mark.label} ({recording.where(mark.start)})"
                raise InputError(
                    f"{recording.source}: {where}: the rate that {axis.name} reads changes by "
                    f"{np.degrees(change):.3g} °/s from the first half to the second; label "
                    "only the steady part",
                    names=(mark.label,),
                )


def _change_between_halves(read: Array) -> tuple[float, float]:
    """Return the change of the mean from the first to the second half, and its deviation."""
    size = len(read) // _BLOCKS
    if not size:
        return 0.0, 0.0
    blocks = read[: size * _BLOCKS].reshape(_BLOCKS, size).mean(axis=1)
    sd = float(np.median(np.abs(np.diff(blocks)))) / _NORMAL_MEDIAN / sqrt(2)
    first, second = blocks.reshape(2, -1).mean(axis=1).tolist()
    return second - first, sd * sqrt(4 / _BLOCKS)


def require_axes_up(
    run: RunBase[RatePlatformData],
    observations: Observations,
    bench: RatePlatform,
    steps: Sequence[PlatformStep],
) -> None:
    """Refuse rests and poses if the accelerometers show that another direction is up.

    Raises
    ------
    InputError
        The stated direction is wrong. The message names a change of unit or columns that corrects
        all rows, or the first wrong row.
    """
    forces = [k for k, axis in enumerate(run.sensor.axes) if axis.measures == "f"]
    nominal = bench.mean_motion(steps, {}).f @ run.sensor.input_axes("f").T
    if forces and steps and all(isinstance(step, Pose) for step in steps):
        _require_pose_columns(run, observations.mean[:, forces], bench, steps, nominal)
    still = [k for k, s in enumerate(steps) if not (isinstance(s, RateDwell) and s.rate != 0)]
    still = still if forces else []
    body = observations.mean[:, forces] @ run.sensor.input_axes("f")
    _require_settings(run, steps, {k: body[k] for k in still if len(forces) == len("xyz")})
    for k, step in ((k, steps[k]) for k in still):
        read = observations.mean[k, forces]
        limit = _STEEPEST * np.linalg.norm(read) * np.linalg.norm(nominal[k])
        few = len(forces) < len("xyz")  # they may be across gravity
        off = np.abs(read - nominal[k]).max() > _STEEPEST * bench.gravity.value
        if off if few else read @ nominal[k] < limit:
            shown = ", ".join(f"{x / bench.gravity.value:+.2f}" for x in read.tolist())
            raise InputError(
                f"{run.path}: row {step.label} is {step.describe()}, but the accelerometers read "
                f"({shown}) g; correct the row, or the order and signs of the columns",
                file=run.path,
                names=(step.label,),
            )


def _require_pose_columns(
    run: RunBase[RatePlatformData],
    read: Array,
    bench: RatePlatform,
    steps: Sequence[PlatformStep],
    nominal: Array,
) -> None:
    """Refuse poses if a change of a unit or an exchange of columns makes all of them agree."""

    def off(expected: Array, seen: Array = read) -> float:
        return float(np.linalg.norm(seen - expected) / np.linalg.norm(expected))

    def turned(exchanged: bool, times: float) -> Array:
        poses = [step for step in steps if isinstance(step, Pose)]
        angles = [(p.pitch, p.roll) if exchanged else (p.roll, p.pitch) for p in poses]
        other = [
            replace(p, roll=a * times, pitch=b * times)
            for p, (a, b) in zip(poses, angles, strict=True)
        ]
        return bench.mean_motion(other, {}).f @ run.sensor.input_axes("f").T

    if not nominal.any() or off(nominal) < _MISORDERED:
        return
    size, expected = float(np.linalg.norm(read)), float(np.linalg.norm(nominal))
    in_degrees = run.data.angle_unit in ("°", "deg")
    unit, times = ("rad", degrees(1)) if in_degrees else ("°", radians(1))
    if off(turned(False, times)) < _ORDERED:
        text = f'the readings agree with angles in {unit}; state angle_unit = "{unit}"'
        raise key_error("[data] angle_unit", text, run.path)
    text = "the readings at all poses do not have the size that gravity gives"
    axis = run.sensor.select_axes("f").axes[0]
    finding = norm_finding(size, expected, text, axis.readout.unit)
    if finding is not None and finding.severity == "refused":
        raise key_error("[data] accelerometer", finding.message, run.path)
    named = tuple(map(str, run.data.accelerometer))
    plain = [way for way in signed_permutations(read.shape[1]) if min(way.signs) > 0]
    for way in plain:
        if off(nominal, way.reorder(read)) < _ORDERED:
            columns = way.signed_names(named)
            text = f"the readings contradict the poses; they agree with accelerometer = {columns}"
            raise key_error("[data] accelerometer", text, run.path, (columns,))
    if off(turned(True, 1.0)) < _ORDERED:
        text = "the readings agree with the columns of roll and pitch exchanged; exchange them"
        raise key_error("[data] roll", text, run.path)
