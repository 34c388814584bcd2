"""Detect the sections of a plan in the signal: rests by their scatter, turns by their angle.

The scatter of the signal over half a second is compared with its quietest level, so that no
threshold depends on units or on the sensor. If some positions scatter by more than three times that
level, the threshold between rest and motion from `inercal.recordings.segments.motion_thresholds` is
used instead. A rest is identified by the direction of its mean specific force, and a turn by the
axis and angle of its integrated rate.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from inercal.basics.arrays import Array, Bools, true_ranges
from inercal.basics.errors import InputError
from inercal.basics.units import format_count, format_duration, format_quantity
from inercal.physics.plan import HandStep, Hold, Turn
from inercal.physics.quantities import Measures
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Mark, Recording, sample_count
from inercal.recordings.segments import motion_thresholds
from inercal.recordings.segments.motion_thresholds import MotionThreshold

MARGIN = 0.25  # s cut off at both ends of a rest, where the hand grips and lets go
SHORTEST = 1.0  # s
# Ratio to the quietest 10 %: white noise over a window of 50 samples stays below 1.5, and the
# movement of a hand gives tens to thousands.
_RESTLESS = 3.0
# A resting rate may differ between attitudes by so many quietest scatters, or by so many rad/s. No
# hand turns more slowly, and the effects of gravity and of the earth's rate are smaller.
_TURNING, _SLOWEST = 10.0, 0.01
_ALIGNED = 0.9  # cosine between a mean specific force (or a turn's axis) and the nominal direction
_LONGER = 2.0  # if another rest in the position is so many times longer, use that rest instead
_ROUGHLY = 0.7  # the same cosine before biases are subtracted
_EVEN = 1e-6  # length of the mean direction if attitudes form opposite pairs
_TURN_TOLERANCE = 0.25  # relative error of a turn's angle within which it fits the plan


@dataclass(frozen=True)
class SectionDetection:
    """The detected sections of a plan, and the thresholds that were used.

    Parameters
    ----------
    marks : tuple of Mark
        Marks in the order of the plan; if several rests fit a step, the longest one.
    missing : tuple of str
        Labels of the holds for which no rest was found, numbered by part as those of the marks.
    rests : tuple of Mark
        All rests, "rest 1", "rest 2", …, sorted by time.
    levels : tuple of MotionThreshold
        Scatter at rest and in motion, and the threshold, for each kind of axis.
    places : tuple of str
        The parts in which holds are missing, with these holds; empty if there are no parts.
    """

    marks: tuple[Mark, ...]
    missing: tuple[str, ...]
    rests: tuple[Mark, ...]
    levels: tuple[MotionThreshold, ...]
    places: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Number of rests and thresholds, in one line."""
        found = f"{format_count(len(self.rests), 'rest')} of {SHORTEST:g} s or more detected"
        return "; ".join([found, *(level.words for level in self.levels)])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """A warning if positions are missing."""
        if not self.missing:
            return ()
        text = f"no rest fits {', '.join(self.missing)}: {self.words}"
        if self.places:
            text = f"rests are missing in {'; '.join(self.places)}: {self.words}"
        return (Finding("warning", "missing", text),)


def find_sections(
    recording: Recording,
    sensor: Sensor,
    steps: Sequence[HandStep],
    parts: Sequence[tuple[int, int]] = (),
    *,
    every: bool = False,
) -> SectionDetection:
    """Detect the sections of a plan as `search_sections` does, but require at least one rest.

    Raises
    ------
    InputError
        There is no rest, or the sensor is not a triad.
    """
    found = search_sections(recording, sensor, steps, parts, every=every)
    if not found.rests:
        raise InputError(
            f"{recording.source}: no rest of {SHORTEST + 2 * MARGIN:g} s was detected ("
            f"{'; '.join(level.words for level in found.levels)}); mark the sections in a file "
            "or a column",
            names=tuple(step.label for step in steps),
        )
    return found


def search_sections(
    recording: Recording,
    sensor: Sensor,
    steps: Sequence[HandStep],
    parts: Sequence[tuple[int, int]] = (),
    *,
    every: bool = False,
) -> SectionDetection:
    """Detect the sections of a plan; there may be none.

    Parameters
    ----------
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
        Triads with nominal readouts. Turns require gyros, and gyros also improve the detection of
        rests.
    steps : sequence of HandStep
    parts : sequence of (start, stop), optional
        Samples of each file, if the plan was carried out once in each; the holds of the second file
        are named "x_p (2)".
    every : bool
        Whether all rests in a position are returned, as "x_p", "x_p (2)", …, and not only the
        longest one.

    Raises
    ------
    InputError
        The recording is too short, or the sensor is not a triad.
    """
    columns = [recording.channels.index(name) for name in sensor.channels]
    y = sensor.to_si(recording.data[:, columns])
    force = [k for k, axis in enumerate(sensor.axes) if axis.measures == "f"]
    rate = [k for k, axis in enumerate(sensor.axes) if axis.measures == "w"]
    if len(force) != 3 or len(rate) not in (0, 3):
        raise InputError(
            f"sensor {sensor.name} has {len(force)} accelerometers and {len(rate)} gyros; sections "
            "are detected only for three of each, or three accelerometers: mark them in a file or "
            "a column",
            names=sensor.channels,
        )
    window = motion_thresholds.window_samples(recording)
    if y.shape[0] < 4 * window:
        raise InputError(
            f"{recording.source}: {format_duration(recording.duration)} is too short to detect "
            f"sections; record at least {4 * motion_thresholds.WINDOW:g} s"
        )
    channels = [_Channel(y[:, k], window) for k in range(y.shape[1])]
    quietest = [channel.limit for channel in channels]
    search = partial(_sections, recording, sensor, steps, y, channels)
    found = search(quietest, parts, every=every)
    thresholds = _class_thresholds(recording, sensor, window)
    wider = [
        max(limit, thresholds.get(axis.measures, 0.0))
        for limit, axis in zip(quietest, sensor.axes, strict=True)
    ]
    if wider != quietest:
        other = search(wider, parts, every=every)
        found = other if _finds_more(other, found) else found
    return found


class _Channel:
    """Scatter and mean of a channel over a sliding window, and the largest scatter at rest.

    The largest scatter at rest is three times the scatter of the quietest 10 % of the windows.
    """

    def __init__(self, x: Array, window: int):
        middle = x.mean()
        centred = x - middle
        sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (centred, centred**2)]
        n = x.size
        start = np.clip(np.arange(n) - window // 2, 0, n - window)
        mean, square = ((s[start + window] - s[start]) / window for s in sums)
        self.mean = mean
        self.deviation = np.sqrt(np.maximum(square - mean**2, 0.0))
        # A coarsely quantised channel may be constant, so the scatter is at least part of its
        # smallest step.
        steps = np.abs(np.diff(x))
        least = float(steps[steps > 0].min()) if (steps > 0).any() else 1.0
        self.floor = max(float(np.quantile(self.deviation, 0.1)), 0.3 * least)
        self.limit = _RESTLESS * self.floor

    def at_rest(self, limit: float, parts: Sequence[tuple[int, int]], *, rate: bool) -> Bools:
        """Return where the channel scatters less than the limit and, for a rate, is not turning.

        The bias of a gyro may differ from part to part by more than it differs between attitudes.
        """
        quiet = self.deviation < limit
        for part in (slice(*one) for one in parts if rate and quiet[slice(*one)].any()):
            # In the middle of a turn the rate may be as steady as at rest, but its mean differs.
            away = np.abs(self.mean[part] - np.median(self.mean[part][quiet[part]]))
            quiet[part] &= away < max(_TURNING * self.floor, _SLOWEST)
        return quiet


def _class_thresholds(recording: Recording, sensor: Sensor, window: int) -> dict[str, float]:
    """Return the threshold between rest and motion for the kinds of axis that have one, SI."""
    segments = motion_thresholds.gapless_segments(recording)
    found: dict[str, float] = {}
    for kind in motion_thresholds.axis_kinds(recording, sensor):
        if int((segments[:, 1] - segments[:, 0]).max()) < window:
            continue
        level, _ = motion_thresholds.motion_threshold(recording, kind, segments, window)
        if np.isfinite(level.threshold):
            first = next(axis for axis in sensor.axes if axis.measures == kind.kind)
            found[kind.kind] = level.threshold / abs(first.readout.scale)
    return found


def _finds_more(one: SectionDetection, other: SectionDetection) -> bool:
    """Return whether one search finds all steps of the other, plus a new or far longer one."""
    if not set(other.missing) >= set(one.missing):
        return False
    labels = {mark.label for mark in one.marks}
    if not labels >= {mark.label for mark in other.marks}:
        return False
    size = {mark.label: mark.stop - mark.start for mark in other.marks}
    return one.missing != other.missing or any(
        mark.label in size and mark.stop - mark.start > _LONGER * size[mark.label]
        for mark in one.marks
    )


def _sections(
    recording: Recording,
    sensor: Sensor,
    steps: Sequence[HandStep],
    y: Array,
    channels: Sequence["_Channel"],
    limits: Sequence[float],
    parts: Sequence[tuple[int, int]],
    *,
    every: bool,
) -> SectionDetection:
    """Return the detected sections of a plan; at rest, each channel scatters below its limit."""
    force = [k for k, axis in enumerate(sensor.axes) if axis.measures == "f"]
    rate = [k for k, axis in enumerate(sensor.axes) if axis.measures == "w"]
    quiet = np.ones(len(y), dtype=np.bool_)
    files = parts or [(0, len(y))]
    for k in (*force, *rate):
        quiet &= channels[k].at_rest(limits[k], files, rate=k in rate)
    for before, after in recording.gaps:
        quiet[before : after + 1] = False
    margin, shortest = (sample_count(s, recording.median_step) for s in (MARGIN, SHORTEST))
    rests = [
        (a + margin, b - margin)
        for a, b in true_ranges(quiet).tolist()
        if b - a - 2 * margin >= shortest
    ]
    kinds: list[tuple[Measures, list[int]]] = [("f", force), ("w", rate)]
    levels = tuple(
        _level(sensor, kind, [channels[k] for k in own], [limits[k] for k in own], quiet)
        for kind, own in kinds
        if own
    )
    marks: list[Mark] = []
    missing: list[str] = []
    places: list[str] = []
    for visit, (a, b) in enumerate(files, 1):
        own = [rest for rest in rests if a <= rest[0] < b]
        holds = _holds(y[:, force], own, steps, every=every and not parts) if own else []
        number = f" ({visit})" if visit > 1 else ""
        marks += [replace(mark, label=mark.label + number) for mark in holds]
        found = {mark.label for mark in holds}
        lost = [s.label for s in steps if isinstance(s, Hold) and s.label not in found]
        missing += [label + number for label in lost]
        if lost and parts:
            places.append(f"{_part_name(recording, a, b)} ({', '.join(lost)})")
    if rests and rate:
        marks += _turns(y[:, rate], y[:, force], recording, quiet, rests, steps)
    order = [step.label for step in steps]
    return SectionDetection(
        tuple(sorted(marks, key=lambda mark: order.index(mark.label.partition(" (")[0]))),
        tuple(missing),
        tuple(Mark(f"rest {k}", a, b) for k, (a, b) in enumerate(rests, 1)),
        levels,
        tuple(places),
    )


def _part_name(recording: Recording, start: int, stop: int) -> str:
    """Return the name of a part: that of its file, or its temperature."""
    if recording.labels is not None:
        return str(recording.labels[start])
    if recording.temperature is None:
        return f"the part from {recording.time[start]:.6g} s"
    kelvin = float(np.median(recording.temperature[start:stop]))
    return f"the soak at {format_quantity(kelvin, 0.0, '°C', 3)}"


def _level(
    sensor: Sensor,
    kind: Measures,
    channels: Sequence[_Channel],
    limits: Sequence[float],
    quiet: Bools,
) -> MotionThreshold:
    """Return the scatter of one kind of axis, output units, as an RMS over its axes."""
    axis = next(axis for axis in sensor.axes if axis.measures == kind)
    scale = abs(axis.readout.scale)
    scatter = np.sqrt(np.mean([channel.deviation**2 for channel in channels], axis=0)) * scale
    return MotionThreshold(
        kind,
        axis.readout.unit,
        float(np.median(scatter[quiet])) if quiet.any() else float(np.min(scatter)),
        float(np.median(scatter[~quiet])) if not quiet.all() else float(np.max(scatter)),
        float(np.sqrt(np.mean(np.square(limits)))) * scale,
    )


def _holds(
    f: Array, rests: Sequence[tuple[int, int]], steps: Sequence[HandStep], *, every: bool
) -> list[Mark]:
    means = np.array([f[a:b].mean(axis=0) for a, b in rests])
    ups = np.array([step.up for step in steps if isinstance(step, Hold)]).reshape(-1, 3)
    means = means - _offset(means, ups)
    directions = means / np.linalg.norm(means, axis=1, keepdims=True)
    marks: list[Mark] = []
    for step in steps:
        if isinstance(step, Hold):
            fitting: list[int] = np.flatnonzero(directions @ np.array(step.up) > _ALIGNED).tolist()
            found = [rests[k] for k in fitting]
            if found and not every:
                found = [max(found, key=lambda rest: rest[1] - rest[0])]
            for visit, (a, b) in enumerate(found, 1):
                marks.append(Mark(step.label + f" ({visit})" * (visit > 1), a, b))
    return marks


def faces_up(means: Array, holds: Sequence[Hold]) -> list[str] | None:
    """Return the label of the hold in whose attitude each mean, (r, 3), was taken.

    The biases are rough, or the middle of the range, because an axis may be off by 1 g. None if a
    mean fits no hold.
    """
    ups = np.array([hold.up for hold in holds])
    for centre in (_offset(means, ups), 0.5 * (means.max(axis=0) + means.min(axis=0))):
        left = means - centre
        norms = np.maximum(np.linalg.norm(left, axis=1, keepdims=True), np.finfo(float).tiny)
        near = (left / norms) @ ups.T
        nearest: list[int] = near.argmax(axis=1).tolist()
        every = set(nearest) == set(range(len(holds)))
        if (near.max(axis=1) > _ALIGNED).all() and every:
            return [holds[k].label for k in nearest]
    return None


def _offset(means: Array, ups: Array) -> Array:
    """Return rough biases, (3,): the mean over rests in opposite attitudes, otherwise zero.

    A bias of 0.4 g changes the direction of a face by more than the cosine between faces allows.
    """
    norms = np.maximum(np.linalg.norm(means, axis=1, keepdims=True), np.finfo(float).tiny)
    near = (means / norms) @ ups.T
    every = (near > _ROUGHLY).any(axis=0).all()
    if not every or not len(ups) or np.linalg.norm(ups.mean(axis=0)) > _EVEN:
        return np.zeros(3)
    faces = [means[near[:, k] > _ROUGHLY].mean(axis=0) for k in range(len(ups))]
    return np.asarray(np.mean(faces, axis=0), dtype=float)


def _turns(
    w: Array,
    f: Array,
    recording: Recording,
    quiet: Bools,
    rests: Sequence[tuple[int, int]],
    steps: Sequence[HandStep],
) -> list[Mark]:
    """Return the turns by the planned angle about the vertical, which leave gravity unchanged."""
    bias = np.median(np.concatenate([w[a:b] for a, b in rests]), axis=0)
    window = sample_count(motion_thresholds.WINDOW, recording.median_step)
    candidates: list[tuple[int, int, Array]] = []
    for a, b in true_ranges(~quiet).tolist():
        if b - a < 2:
            continue
        before, after = (
            f[max(a - window, 0) : a + 1].mean(axis=0),
            f[b - 1 : b + window].mean(axis=0),
        )
        if before @ after > _ALIGNED * np.linalg.norm(before) * np.linalg.norm(after):
            candidates.append((a, b, (w[a:b] - bias).mean(axis=0) * recording.span(a, b)))
    marks: list[Mark] = []
    for step in steps:
        if not isinstance(step, Turn):
            continue
        # Accept both directions: the plan check reports a turn in the opposite direction.
        nominal = np.abs(step.angle * np.array(step.axis))
        apart = [float(np.linalg.norm(np.abs(angle) - nominal)) for _, _, angle in candidates]
        if apart and min(apart) < _TURN_TOLERANCE * abs(step.angle):
            a, b, _ = candidates[int(np.argmin(apart))]
            marks.append(Mark(step.label, a, b))
    return marks
