"""Changes of readings within sections at rest, and the rotation that the gyros measure meanwhile.

For a sensor in a hand, a change across gravity may be a tilt, which the gyros measure. The mean
attitude of the second half differs from that of the first by the rate integrated with a weight w
that rises from 0 to 1 across the first half and falls across the second: to first order in the
rotation,

    mean₂ θ − mean₁ θ = ∫ w ω dt

For two parts of unequal length with a gap between them the weight stays 1 between the parts.

The detection of rests cuts a rest at a step of a bias and takes the longer part: the result is
right, but the sensor is not in order. Such parts of a still run are compared in the same way.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation import ModelTest
from inercal.estimation.section_statistics import largest_change_test
from inercal.physics.sensors import Sensor, inverse
from inercal.recordings import HalfSectionChanges, Mark, Recording, sample_count

_BLOCK = 0.25  # s
_KNOWN = 0.1  # relative error of a rotation by nominal gyros


def changes_within_rests(
    recording: Recording, sensor: Sensor, marks: Sequence[Mark]
) -> HalfSectionChanges:
    """Return the change of readings from the first half of each rest to the second.

    Parameters
    ----------
    recording : Recording
        Without a trial axis.
    sensor : Sensor
        Its axes name the channels.
    marks : sequence of r Mark
        Each of two samples or more.
    """
    parts = [(m.start, (m.start + m.stop) // 2, (m.start + m.stop) // 2, m.stop) for m in marks]
    return changes_between_parts(recording, sensor, parts)


def changes_between_parts(
    recording: Recording, sensor: Sensor, parts: Sequence[tuple[int, int, int, int]]
) -> HalfSectionChanges:
    """Return the change of readings from each part to a later part.

    Parameters
    ----------
    recording : Recording
        Without a trial axis.
    sensor : Sensor
    parts : sequence of r (start, stop, start, stop)
        Samples of both, half open.
    """
    columns = [recording.channels.index(name) for name in sensor.channels]
    change, integral = np.empty((2, len(parts), len(columns)))
    seconds, square = np.empty((2, len(parts)))
    for k, (a, b, c, d) in enumerate(parts):
        y = recording.data[a:d, columns]
        change[k] = y[c - a :].mean(axis=0) - y[: b - a].mean(axis=0)
        step = recording.span(a, d) / (d - a)
        up, down = (np.arange(n) + 0.5 for n in (b - a, d - c))
        weight = np.concatenate([up / (b - a), np.ones(c - b), 1 - down / (d - c)]) * step
        integral[k], seconds[k], square[k] = weight @ y, weight.sum(), weight @ weight
    t, warming = recording.temperature, None
    if t is not None:
        warming = np.array([t[c:d].mean() - t[a:b].mean() for a, b, c, d in parts])
    return HalfSectionChanges(change, integral, seconds, square, warming)


def bias_jump_test(
    recording: Recording,
    sensor: Sensor,
    marks: Sequence[Mark],
    other_parts: Sequence[tuple[int, tuple[int, int]]],
) -> tuple[ModelTest, ...]:
    """Return the test of rests that were cut where the readings change without a rotation.

    Parameters
    ----------
    recording : Recording
        Without a trial axis.
    sensor : Sensor
        Three or more accelerometers, and gyros, by the nominal model.
    marks : sequence of Mark
        All rests.
    other_parts : sequence of (rest, (start, stop))
        Rests by number, each with the other still part of its run.
    """
    force, rate = sensor.select_axes("f"), sensor.select_axes("w")
    if not (other_parts and rate.axes):
        return ()
    m = len(force.axes)
    back = inverse(Sensor(force.name, force.axes), np.eye(m), np.zeros(0)).f
    turning = Sensor(rate.name, rate.axes)
    of_rate = inverse(turning, np.eye(len(rate.axes)), np.zeros(0)).w
    columns = [recording.channels.index(name) for name in sensor.channels]
    whole = [sensor.to_si(recording.data[mark.start : mark.stop, columns]) for mark in marks]
    bias = np.mean([section[:, m:].mean(axis=0) for section in whole], axis=0)
    block = max(sample_count(_BLOCK, recording.median_step), 1)
    scatter = [_block_mean_variance(section[:, :m] @ back, block) for section in whole]
    usual = float(np.median([one for one in scatter if one > 0] or [0.0]))
    wander = np.std([(section[:, m:].mean(axis=0) - bias) @ of_rate for section in whole], axis=0)

    parts, variance = list[tuple[int, int, int, int]](), np.empty(len(other_parts))
    for k, (at, (start, stop)) in enumerate(other_parts):
        own = (marks[at].start, marks[at].stop)
        parts.append((*own, start, stop) if own[0] < start else (start, stop, *own))
        variance[k] = usual * block * (1 / (stop - start) + 1 / (own[1] - own[0]))
    halves = changes_between_parts(recording, sensor, parts)
    # The only offset of differences and integrals is the readout's, which the bias has too.
    scale = np.array([axis.readout.scale for axis in sensor.axes])
    zero = np.array([axis.readout.offset for axis in sensor.axes])
    integral = (halves.integral - halves.seconds[:, None] * zero) / scale
    turn = (integral[:, m:] - halves.seconds[:, None] * bias) @ of_rate
    specific_force = np.stack([whole[at][:, :m].mean(axis=0) @ back for at, _ in other_parts])
    change = (halves.change / scale)[:, :m] @ back - np.cross(specific_force, turn)
    size = np.linalg.norm(specific_force, axis=1)
    open_ = _KNOWN * np.linalg.norm(turn, axis=1) + halves.seconds * float(np.linalg.norm(wander))
    variance += (size * open_) ** 2
    by_channel = change @ np.linalg.pinv(back)
    worst: list[int] = np.argmax(np.abs(by_channel), axis=1).tolist()
    labels = [marks[at].label for at, _ in other_parts]
    names = [force.axes[k].name for k in worst]
    return (largest_change_test(change, variance, labels, names),)


def _block_mean_variance(f: Array, block: int) -> float:
    """Return the mean variance of the means of complete blocks; zero for fewer than two."""
    count = len(f) // block
    if count < 2:
        return 0.0
    means = f[: count * block].reshape(count, block, -1).mean(axis=1)
    return float(means.var(axis=0, ddof=1).mean())
