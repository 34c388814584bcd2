"""Whether the observations look like the steps that they are said to be.

Catches the usual mistakes where they are made: a mark on the wrong section, swapped or reversed
columns, degrees taken for radians, a turn the other way.
"""

from collections.abc import Sequence
from math import pi

import numpy as np

from inercal.errors import InputError
from inercal.plan import HandStep, Hold, Turn, describe_direction
from inercal.recording import Finding, Mark, Observations, Recording
from inercal.sensors import Sensor, inverse

_MEANT = 0.7  # cosine: within 45° of the nominal direction
_ALIGNED = 0.9
_POSSIBLE = (0.2, 2.5)  # g, of a crude sensor at rest
_EVEN = 1e-6  # length of the mean direction of faces in pairs
_WHOLE_TURN = 300 * pi / 180  # rad, after which what turns has no mean across the axis
_END = 0.1  # s at either end of a turn
_STILL_TURNING = 0.25  # of the fastest rate


def check_against_plan(
    observations: Observations, sensor: Sensor, steps: Sequence[HandStep], gravity: float
) -> tuple[Finding, ...]:
    """Return warnings; raise on what cannot be meant.

    Parameters
    ----------
    observations : Observations
        Without a trial axis.
    sensor : Sensor
        With nominal readouts; only complete triads are checked.
    steps : sequence of HandStep
        Of each row.
    gravity : float
        m/s².

    Raises
    ------
    InputError
        A hold whose mean specific force points elsewhere, or a turn about another axis, by another
        unit's angle, or about an axis that gravity does not turn about.
    """
    columns = {
        kind: [k for k, axis in enumerate(sensor.axes) if axis.measures == kind] for kind in "fw"
    }
    if len(columns["f"]) != 3:
        return ()
    bare = Sensor(sensor.name, sensor.axes)
    sensed = inverse(bare, observations.mean, np.zeros(0))
    findings: list[Finding] = []
    holds = np.array([isinstance(step, Hold) for step in steps])
    _check_sizes(sensed.f / gravity, steps)
    offset = _rough_bias(sensed.f, steps, gravity)
    for k, step in enumerate(steps):
        if isinstance(step, Hold):
            f = sensed.f[k] - offset
            if f @ np.array(step.up) < _MEANT * np.linalg.norm(f):
                read = _vector_text(sensed.f[k] / gravity)
                raise InputError(
                    f"section {step.label} should have {describe_direction(step.up)} up, but the "
                    f"accelerometers read {read} g: is the mark on another section, or are columns "
                    "swapped or reversed?"
                )
        elif len(columns["w"]) == 3:
            bias = sensed.w[holds].mean(axis=0) if holds.any() else np.zeros(3)
            findings += _check_turn(step, (sensed.w[k] - bias) * observations.duration[k])
            _check_gravity_turns(step, (sensed.f[k] - offset) / gravity)
    return tuple(findings)


def _check_sizes(f: np.ndarray, steps: Sequence[HandStep]) -> None:
    """Refuse a hold that alone reads far from 1 g; f in g, (r, 3)."""
    holds = [k for k, step in enumerate(steps) if isinstance(step, Hold)]
    odd = [k for k in holds if not _POSSIBLE[0] < np.linalg.norm(f[k]) < _POSSIBLE[1]]
    if odd and 2 * len(odd) < len(holds):
        k = odd[0]
        raise InputError(
            f"section {steps[k].label} should read about 1 g, but the accelerometers read "
            f"{_vector_text(f[k])} g: is its unit or a decimal point wrong?"
        )


def _rough_bias(force: np.ndarray, steps: Sequence[HandStep], gravity: float) -> np.ndarray:
    """Return rough biases, (3,) m/s²: the mean over holds that lie evenly round, else zero.

    Of faces in pairs it does not depend on which is which, so that no mistake is taken as a bias.
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
    said = f"section {step.label} should turn {step.angle * degrees:+.0f}° about {about}"
    read = f"the gyros integrate to {_vector_text(angle * degrees)}°"
    if abs(along) < _ALIGNED * size or not 0.5 < size / abs(step.angle) < 2:
        hint = "is the mark on another section, or are columns swapped?"
        for ratio, unit in ((degrees, "°/s taken for rad/s"), (1 / degrees, "rad/s taken for °/s")):
            if 0.7 < size / abs(step.angle) / ratio < 1.4:
                hint = f"this looks like {unit}: see unit in [sensor.gyro]"
        raise InputError(f"{said}, but {read}: {hint}")
    if along * step.angle < 0:
        message = (
            f"{said}, but {read}: the turn went the other way (turn = "
            f"'{-step.angle * degrees:+.0f} °' in [method]) or the axis is reversed; its scale "
            "factor comes out negative"
        )
        return [Finding("warning", "direction", message)]
    return []


def _check_gravity_turns(step: HandStep, f: np.ndarray) -> None:
    """Refuse a whole turn in which gravity stays across its axis: f is the mean, (3,) g."""
    assert not isinstance(step, Hold)
    axis = np.array(step.axis)
    across = f - axis * (f @ axis)
    if abs(step.angle) >= _WHOLE_TURN and np.linalg.norm(across) > _MEANT:
        raise InputError(
            f"section {step.label} turns about {describe_direction(step.axis)} by the gyros, but "
            f"the accelerometers read {_vector_text(f)} g all the way, which is across that axis: "
            "are columns of gyros or of accelerometers swapped?"
        )


def check_turn_ends(
    recording: Recording, sensor: Sensor, marks: Sequence[Mark], steps: Sequence[HandStep]
) -> tuple[Finding, ...]:
    """Return a warning for each turn whose mark begins or ends while the sensor still turns.

    Parameters
    ----------
    recording : Recording
        Without a trial axis.
    sensor : Sensor
    marks : sequence of Mark
    steps : sequence of HandStep
        The plan.
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
    window = max(round(_END * recording.rate_hz), 1)
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
                    f"{100 * share:.0f} % of its fastest: part of the turn may lie outside the mark"
                )
                findings.append(Finding("warning", "mark", message, None, mark.start, mark.stop))
    return tuple(findings)


def _vector_text(vector: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:+.3g}" for x in vector) + ")"
