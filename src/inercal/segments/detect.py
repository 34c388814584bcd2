"""Find the sections of a plan in the signal: rests by their quiet, turns by their angle.

The signal's scatter over half a second is compared with its own quietest level, so that no
threshold depends on units or on the sensor. Rests are told apart by the direction of their mean
specific force, turns by the axis and the angle of their integrated rate.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inercal.errors import InputError
from inercal.plan import HandStep, Hold, Turn
from inercal.recording import Mark, Recording
from inercal.sensors import Sensor

Array = NDArray[np.float64]
WINDOW = 0.5  # s over which scatter is judged
MARGIN = 0.25  # s cut off both ends of a rest: the hand lets go
SHORTEST = 1.0  # s
# Ratio to the quietest tenth: white noise over a window of 50 samples stays below 1.5, a hand's
# movement is tens to thousands.
_RESTLESS = 3.0
_TURNING = 10.0  # quietest scatters that a resting rate may differ between attitudes, and
_SLOWEST = 0.01  # rad/s: no hand turns slower, and neither the earth nor gravity does as much
_ALIGNED = 0.9  # cosine between a mean specific force (a turn's axis) and the nominal direction
_ROUGHLY = 0.7  # the same before biases are taken out
_EVEN = 1e-6  # length of the mean direction of attitudes in opposite pairs
_TURN_TOLERANCE = 0.25  # a turn's angle may be wrong by this part and still be meant


def find_marks(recording: Recording, sensor: Sensor, steps: Sequence[HandStep]) -> tuple[Mark, ...]:
    """Return a mark for each step that is found; the longest rest where several fit.

    Parameters
    ----------
    recording : Recording
        Without a trial axis.
    sensor : Sensor
        Triads with nominal readouts; gyros are needed for turns and help to tell rests.
    steps : sequence of HandStep

    Raises
    ------
    InputError
        Nothing at rest, or the sensor is no triad.
    """
    columns = [recording.channels.index(name) for name in sensor.channels]
    y = sensor.to_si(recording.data[:, columns])
    force = [k for k, axis in enumerate(sensor.axes) if axis.measures == "f"]
    rate = [k for k, axis in enumerate(sensor.axes) if axis.measures == "w"]
    if len(force) != 3 or len(rate) not in (0, 3):
        raise InputError("sections can be found for triads only; mark them in a file or a column")
    window = max(round(WINDOW * recording.rate_hz), 4)
    if y.shape[0] < 4 * window:
        raise InputError(
            f"{recording.source}: {recording.duration:.2g} s are too short to find sections in"
        )
    quiet = np.ones(len(y), dtype=np.bool_)
    for k in (*force, *rate):
        quiet &= _at_rest(y[:, k], window, rate=k in rate)
    for before, after in recording.gaps:
        quiet[before : after + 1] = False
    margin, shortest = (round(s * recording.rate_hz) for s in (MARGIN, SHORTEST))
    rests = [(a + margin, b - margin) for a, b in _runs(quiet) if b - a - 2 * margin >= shortest]
    if not rests:
        raise InputError(
            f"{recording.source}: no rest of {SHORTEST + 2 * MARGIN:g} s is found; mark the "
            "sections in a file or a column"
        )
    marks = _holds(y[:, force], rests, steps)
    if rate:
        marks += _turns(y[:, rate], y[:, force], recording, quiet, rests, steps)
    order = [step.label for step in steps]
    return tuple(sorted(marks, key=lambda mark: order.index(mark.label)))


def _at_rest(x: Array, window: int, *, rate: bool) -> NDArray[np.bool_]:
    """Return where a channel scatters no more than at its quietest and, a rate, does not turn."""
    centred = x - x.mean()
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (centred, centred**2)]
    n = x.size
    start = np.clip(np.arange(n) - window // 2, 0, n - window)
    mean, square = ((s[start + window] - s[start]) / window for s in sums)
    deviation = np.sqrt(np.maximum(square - mean**2, 0.0))
    # A coarsely quantised channel may stand still: its smallest step is then the least scatter.
    steps = np.abs(np.diff(x))
    least = float(steps[steps > 0].min()) if (steps > 0).any() else 1.0
    floor = max(float(np.quantile(deviation, 0.1)), 0.3 * least)
    quiet = deviation < _RESTLESS * floor
    if rate and quiet.any():
        # In the middle of a turn the rate may be as steady as at rest, but it is not that of rest.
        quiet &= np.abs(mean - np.median(mean[quiet])) < max(_TURNING * floor, _SLOWEST)
    return quiet


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the half-open ranges where `flags` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _holds(f: Array, rests: Sequence[tuple[int, int]], steps: Sequence[HandStep]) -> list[Mark]:
    means = np.array([f[a:b].mean(axis=0) for a, b in rests])
    ups = np.array([step.up for step in steps if isinstance(step, Hold)]).reshape(-1, 3)
    means = means - _offset(means, ups)
    directions = means / np.linalg.norm(means, axis=1, keepdims=True)
    marks: list[Mark] = []
    for step in steps:
        if isinstance(step, Hold):
            fitting: list[int] = np.flatnonzero(directions @ np.array(step.up) > _ALIGNED).tolist()
            if fitting:
                a, b = max((rests[k] for k in fitting), key=lambda rest: rest[1] - rest[0])
                marks.append(Mark(step.label, a, b))
    return marks


def _offset(means: Array, ups: Array) -> Array:
    """Return rough biases, (3,): what rests in opposite attitudes have in common, else zero.

    A bias of 0.4 g turns the reading of a face by more than the cosine that tells faces apart.
    """
    directions = means / np.linalg.norm(means, axis=1, keepdims=True)
    near = directions @ ups.T
    found = np.flatnonzero((near > _ROUGHLY).any(axis=0))
    if len(found) < len(ups) or not len(ups) or np.linalg.norm(ups.mean(axis=0)) > _EVEN:
        return np.zeros(3)
    faces = [means[near[:, k] > _ROUGHLY].mean(axis=0) for k in found.tolist()]
    return np.asarray(np.mean(faces, axis=0), dtype=float)


def _turns(
    w: Array,
    f: Array,
    recording: Recording,
    quiet: NDArray[np.bool_],
    rests: Sequence[tuple[int, int]],
    steps: Sequence[HandStep],
) -> list[Mark]:
    """Return the turns: about the vertical, so that gravity stays in place, by the right angle."""
    bias = np.median(np.concatenate([w[a:b] for a, b in rests]), axis=0)
    window = round(WINDOW * recording.rate_hz)
    candidates: list[tuple[int, int, Array]] = []
    for a, b in (run for run in _runs(~quiet) if run[1] - run[0] > 1):
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
        # The sense is left open: a turn the other way is found, and said by the check of the plan.
        nominal = np.abs(step.angle * np.array(step.axis))
        apart = [float(np.linalg.norm(np.abs(angle) - nominal)) for _, _, angle in candidates]
        if apart and min(apart) < _TURN_TOLERANCE * abs(step.angle):
            a, b, _ = candidates[int(np.argmin(apart))]
            marks.append(Mark(step.label, a, b))
    return marks
