"""Convert labels to marks, and check marks and means against the steps of a plan.

The checks catch common mistakes where they occur: a mark on the wrong section, swapped or reversed
columns, degrees taken for radians, or a turn in the opposite direction.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import pi

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.units import format_number
from inercal.physics.plan import HandStep, Hold, Turn, describe_direction
from inercal.physics.sensors import Sensor, nominal_inverse
from inercal.recordings import Finding, Mark, Observations, Recording, sample_count
from inercal.recordings.io.rest_norm import norm_finding

_NAMED = 12  # largest number of marks listed in a message
_ALL = 3  # components
_CLEAR = 0.5  # of gravity, for the component along an axis
_MEANT = 0.7  # cosine: within 45° of the nominal direction
_ALIGNED = 0.9
_POSSIBLE = (0.2, 2.5)  # g, range for a crude sensor at rest
_EVEN = 1e-6  # longest mean direction of faces that form opposite pairs
_WHOLE_TURN = 300 * pi / 180  # rad; over such a turn, a turning vector averages out across the axis
_END = 0.1  # s, at either end of a turn
_STILL_TURNING = 0.25  # fraction of the fastest rate


def marks_from_labels(recording: Recording, *, again: bool = False) -> tuple[Mark, ...]:
    """Return one mark for each unbroken run of one label; samples with empty labels get no mark.

    Parameters
    ----------
    recording : Recording
    again : bool
        Whether a label may have several runs.

    Raises
    ------
    InputError
        The recording has no label column, or a label has several runs.
    """
    labels = recording.labels
    if labels is None:
        raise InputError(
            f"{recording.source or 'recording'}: there is no label column: name it in [data] label",
            key="[data] label",
        )
    edges = np.flatnonzero(labels[1:] != labels[:-1]) + 1
    bounds = [0, *edges.tolist(), labels.size]
    marks = [Mark(str(labels[a]).strip(), a, b) for a, b in pairwise(bounds)]
    marks = [m for m in marks if m.label]
    seen: set[str] = set()
    for mark in marks:
        if mark.label in seen and not again:
            raise InputError(
                f"{recording.source}: label {mark.label!r} appears again at "
                f"{recording.where(mark.start)}, but each label must mark a single unbroken "
                f"section: use a different label there, such as '{mark.label} (2)', or leave its "
                "cells empty, because samples with empty cells belong to no section",
                file=recording.source or None,
                line=recording.line(mark.start),
                names=(mark.label,),
            )
        seen.add(mark.label)
    return tuple(marks)


def check_marks(marks: Sequence[Mark], recording: Recording, needed: Sequence[str]) -> None:
    """Check that all needed marks exist, are unique, do not overlap and lie in the recording.

    Parameters
    ----------
    marks : sequence of Mark
    recording : Recording
    needed : sequence of str
        Labels of the steps; marks with other labels are ignored.

    Raises
    ------
    InputError
        A mark is missing, empty, repeated, overlapping or outside the recording; the message names
        it.
    """
    n = recording.time.size
    where = recording.source or "recording"
    if not any(mark.label in needed for mark in marks):
        labels = ", ".join(mark.label for mark in marks[:_NAMED]) or "none"
        labels += f" and {len(marks) - _NAMED} more" if len(marks) > _NAMED else ""
        raise InputError(
            f"{where}: no section is marked {', '.join(needed)}; the marks are {labels}: mark the "
            "missing sections",
            names=tuple(needed),
        )
    used = sorted((m for m in marks if m.label in needed), key=lambda m: m.start)
    for mark in used:
        if not 0 <= mark.start < mark.stop <= n:
            raise InputError(
                f"{where}: mark {mark.label} is samples {mark.start} to {mark.stop}; "
                f"the recording has samples 0 to {n}",
                names=(mark.label,),
            )
    for before, after in pairwise(used):
        if after.start < before.stop:
            raise InputError(
                f"{where}: marks {before.label} ({before.start} to {before.stop}) and "
                f"{after.label} ({after.start} to {after.stop}) overlap; correct their limits",
                names=(before.label, after.label),
            )
    labels = [mark.label for mark in used]
    twice = tuple(sorted({label for label in labels if labels.count(label) > 1}))
    if twice:
        places = " and ".join(f"{m.start} to {m.stop}" for m in used if m.label == twice[0])
        raise InputError(
            f"{where}: {', '.join(twice)} is marked twice (samples {places}); mark each section "
            "once",
            names=twice,
        )


def check_against_plan(
    observations: Observations, sensor: Sensor, steps: Sequence[HandStep], gravity: float
) -> tuple[Finding, ...]:
    """Return warnings, and refuse observations that cannot belong to their steps.

    Parameters
    ----------
    observations : Observations
        Observations without a trial axis.
    sensor : Sensor
        Sensor with nominal readouts. Turns are only checked if it measures all components.
    steps : sequence of HandStep
        The step of each row.
    gravity : float
        Magnitude of gravity, m/s².

    Raises
    ------
    InputError
        The mean specific force during a hold has another direction. Or a turn is about another
        axis, by an angle in another unit, or about an axis about which gravity does not turn.
    """
    findings: list[Finding] = []
    holds = np.array([isinstance(step, Hold) for step in steps])
    if sensor.rank("f") < _ALL:
        findings += _check_components(observations, sensor, steps, gravity)
        if not sensor.rank("f") and sensor.rank("w") == _ALL:
            rates = observations.mean @ nominal_inverse(sensor.axes)[:, 3:6]
            bias = rates[holds].mean(axis=0) if holds.any() else np.zeros(3)
            for k in np.flatnonzero(~holds).tolist():
                findings += _check_turn(steps[k], (rates[k] - bias) * observations.duration[k])
        return tuple(findings)
    force, rate = np.split((observations.mean @ nominal_inverse(sensor.axes))[:, :6], 2, axis=1)
    offset = _rough_bias(force, steps, gravity)
    if _odd_sizes((force - offset) / gravity, steps):  # not just an axis that is off by 1 g
        _check_sizes(force / gravity, steps)
    for k, step in enumerate(steps):
        if isinstance(step, Hold):
            f = force[k] - offset
            if f @ np.array(step.up) < _MEANT * np.linalg.norm(f):
                read = _vector_text(force[k] / gravity)
                raise InputError(
                    f"section {step.label} should have {describe_direction(step.up)} up, but "
                    f"the accelerometers read {read} g: check for a mark on the wrong section, "
                    f"or for swapped or reversed columns{sensor.negative_scales}",
                    names=(step.label,),
                )
        elif sensor.rank("w") == _ALL:
            bias = rate[holds].mean(axis=0) if holds.any() else np.zeros(3)
            findings += _check_turn(step, (rate[k] - bias) * observations.duration[k])
            findings += _check_gravity_turns(step, (force[k] - offset) / gravity)
    return tuple(findings)


def _check_components(
    observations: Observations, sensor: Sensor, steps: Sequence[HandStep], gravity: float
) -> tuple[Finding, ...]:
    """Check the holds of one or two accelerometers: unit, face and sign, along each axis.

    Raises
    ------
    InputError
        The unit is wrong, or a reading belongs to another face.
    """
    holds = [k for k, step in enumerate(steps) if isinstance(step, Hold)]
    forces = [k for k, axis in enumerate(sensor.axes) if axis.measures == "f"]
    if not holds or not forces:
        return ()
    ups = np.array([step.up for step in steps if isinstance(step, Hold)])
    expected = ups @ sensor.input_axes("f").T
    read = observations.mean[np.ix_(holds, forces)] / gravity
    if np.linalg.norm(ups.mean(axis=0)) <= _EVEN:
        read = read - read.mean(axis=0)
    along = np.abs(expected) > _CLEAR
    if not along.any():
        return ()
    size = float(np.median(np.abs(read[along] / expected[along])))
    text = f"along gravity, the accelerometers read {size * gravity:.4g} m/s² where gravity is "
    unit = sensor.axes[forces[0]].readout.unit
    finding = norm_finding(size * gravity, gravity, f"{text}{gravity:.5g} m/s²", unit)
    if finding is not None and finding.severity == "refused":
        raise InputError(finding.message, key="[sensor.accelerometer] unit")
    off = np.abs(read / size - expected)
    if off.max() > _MEANT:
        k, j = (int(one) for one in np.unravel_index(np.argmax(off), off.shape))
        raise InputError(
            f"section {steps[holds[k]].label} should read {expected[k, j]:+.2f} g on "
            f"{sensor.channels[forces[j]]}, but reads {read[k, j]:+.2f} g: check for a mark on the "
            "wrong section, the sign of the column, and [sensor.accelerometer] axis"
            + sensor.negative_scales,
            names=(steps[holds[k]].label,),
        )
    return () if finding is None else (finding,)


def _check_sizes(f: np.ndarray, steps: Sequence[HandStep]) -> None:
    """Refuse a hold whose force is far from 1 g if only a minority is; f in g, (r, 3)."""
    holds = [k for k, step in enumerate(steps) if isinstance(step, Hold)]
    odd = _odd_sizes(f, steps)
    if odd and 2 * len(odd) < len(holds):
        k = odd[0]
        raise InputError(
            f"section {steps[k].label} should read about 1 g, but the accelerometers read "
            f"{_vector_text(f[k])} g: check its unit and its decimal point",
            names=(steps[k].label,),
        )


def _odd_sizes(f: np.ndarray, steps: Sequence[HandStep]) -> list[int]:
    """Return the holds whose force, g, is far from 1 g."""
    holds = [k for k, step in enumerate(steps) if isinstance(step, Hold)]
    sizes = np.linalg.norm(f, axis=1)
    return [k for k in holds if not _POSSIBLE[0] < sizes[k] < _POSSIBLE[1]]


def _rough_bias(force: np.ndarray, steps: Sequence[HandStep], gravity: float) -> np.ndarray:
    """Return rough biases, (3,) m/s²: the mean over holds in opposite pairs, otherwise zero.

    The mean over opposite pairs does not depend on their order, so mistakes in the marks do not
    change it.
    """
    ups = np.array([step.up for step in steps if isinstance(step, Hold)]).reshape(-1, 3)
    if not len(ups) or np.linalg.norm(ups.mean(axis=0)) > _EVEN:
        return np.zeros(3)
    holds = [isinstance(step, Hold) for step in steps]
    return force[holds].mean(axis=0) - gravity * ups.mean(axis=0)


def _check_turn(step: HandStep, angle: np.ndarray) -> list[Finding]:
    assert not isinstance(step, Hold)
    size = float(np.linalg.norm(angle))
    along = float(angle @ np.array(step.axis))
    degrees = 180 / pi
    about = describe_direction(step.axis)
    planned = f"section {step.label} should turn {step.angle * degrees:+.0f}° about {about}"
    read = f"the gyros integrate to {_vector_text(angle * degrees)}°"
    aligned, times = abs(along) >= _ALIGNED * size, size / abs(step.angle)
    if not aligned or not 0.5 < times < 2:
        hint = "check for a mark on the wrong section, or for swapped columns"
        if aligned and times > 2:
            hint = f"{times:.3g} times the turn: check unit and scale in [sensor.gyro]"
        for ratio, unit in ((degrees, "°/s taken for rad/s"), (1 / degrees, "rad/s taken for °/s")):
            if 0.7 < times / ratio < 1.4:
                hint = f"this looks like {unit}: see unit in [sensor.gyro]"
        raise InputError(f"{planned}, but {read}: {hint}", names=(step.label,))
    if along * step.angle < 0:
        message = (
            f"{planned}, but {read}: the sensor turned in the opposite direction (state turn = "
            f"'{-step.angle * degrees:+.0f} °' in [method]), or the axis is reversed and its scale "
            "factor becomes negative"
        )
        return [Finding("warning", "direction", message)]
    return []


def _check_gravity_turns(step: HandStep, f: np.ndarray) -> list[Finding]:
    """Check the mean force f, (3,) g, during a turn.

    Refuse a complete turn with a mean force across its axis. Warn if the axis points down.
    """
    assert not isinstance(step, Hold)
    axis = np.array(step.axis)
    across = f - axis * (f @ axis)
    if abs(step.angle) >= _WHOLE_TURN and np.linalg.norm(across) > _MEANT:
        raise InputError(
            f"according to the gyros, section {step.label} turns about "
            f"{describe_direction(step.axis)}, but the accelerometers read {_vector_text(f)} g "
            "on average, which is across that axis: check for swapped columns of gyros or "
            "accelerometers",
            names=(step.label,),
        )
    if f @ axis < -_MEANT:
        about = describe_direction(step.axis)
        message = (
            f"section {step.label} should turn with {about} up, but the accelerometers read "
            f"{_vector_text(f)} g on average: the sensor was upside down (turn it with {about}"
            " up), or this accelerometer is reversed in [data] accelerometer"
        )
        return [Finding("warning", "up", message)]
    return []


def check_turn_ends(
    recording: Recording, sensor: Sensor, marks: Sequence[Mark], steps: Sequence[HandStep]
) -> tuple[Finding, ...]:
    """Return a warning for each turn whose mark begins or ends while the sensor is still turning.

    Parameters
    ----------
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
    marks : sequence of Mark
    steps : sequence of HandStep
        The steps of the plan.
    """
    by_label = {step.label: step for step in steps}
    gyros = sensor.select_axes("w")
    turns = [mark for mark in marks if isinstance(by_label.get(mark.label), Turn)]
    holds = [mark for mark in marks if isinstance(by_label.get(mark.label), Hold)]
    if not (gyros.axes and turns and holds):
        return ()
    columns = [recording.channels.index(name) for name in gyros.channels]
    rate = gyros.to_si(recording.data[:, columns])
    rest = np.mean([rate[mark.start : mark.stop].mean(axis=0) for mark in holds], axis=0)
    window = max(sample_count(_END, recording.median_step), 1)
    findings: list[Finding] = []
    for mark in turns:
        turning = rate[mark.start : mark.stop] - rest
        fastest = np.linalg.norm(turning, axis=1).max()
        ends = {"begins": (turning[:window], mark.start), "ends": (turning[-window:], mark.stop)}
        for word, (piece, sample) in ends.items():
            share = float(np.linalg.norm(piece.mean(axis=0)) / fastest)
            if share > _STILL_TURNING:
                message = (
                    f"section {mark.label} {word} at sample {sample} while the sensor turns at "
                    f"{100 * share:.0f} % of its largest rate: part of the turn may lie outside "
                    "the mark"
                )
                findings.append(Finding("warning", "mark", message, None, mark.start, mark.stop))
    return tuple(findings)


def _vector_text(vector: np.ndarray) -> str:
    return "(" + ", ".join(f"{'+' * (x > 0)}{format_number(x, 3)}" for x in vector.tolist()) + ")"
