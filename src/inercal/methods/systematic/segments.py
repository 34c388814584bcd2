"""Divide a recording into rests and turns, and find the noise and the drift of each.

A test compares the two halves of each rest; it fails if the table creeps or is knocked.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.basics.units import format_count, format_quantity
from inercal.estimation import ModelTest
from inercal.methods.turntable.drift import covariance_of_means
from inercal.physics.sensors import Sensor
from inercal.recordings import ReadingSteps, Track, sample_count
from inercal.recordings.rounding_errors import RoundingErrors
from inercal.recordings.segments.reading_steps import reading_steps

HALVES = "halves of the rests"
MIN_RESTS = 6
FILTER_NOISE = 0.5  # steps, minimum gyro noise for a filter, which does not model rounding
BLOCK_SECONDS = 0.1  # duration of the blocks over which sensitivities are summed


@dataclass(frozen=True, eq=False)
class Segments:
    """The m rests and the m − 1 turns between them in one recording.

    Parameters
    ----------
    labels : tuple of m str
        Labels of the rests.
    mean : (m, 6) array
        Mean reading in each rest, SI, in the order of the sensor's axes.
    halves : (2, m, 6) array
        Means over the first and the second half of each rest.
    moving : (n, 6) array
        Readings in all turns, one after the other.
    first, last : (m − 1,) arrays of int
        First row of `moving` for each turn, and the row after its last one.
    dt : float
        Sampling interval, s.
    start, stop : (2 m − 1,) arrays
        Start and end of rests and turns in time order, s.
    run : (float, float)
        Start and end of the recording, s.
    means : bool
        Whether a sample is the mean of the reading over one period, not its instantaneous value.
    rounding : RoundingErrors or None
        Errors that coarse steps cause in the means of rests and turns, in time order.
    """

    labels: tuple[str, ...]
    mean: Array
    halves: Array
    moving: Array
    first: Indices
    last: Indices
    dt: float
    start: Array
    stop: Array
    run: tuple[float, float]
    means: bool = False
    rounding: RoundingErrors | None = None

    @property
    def rest_seconds(self) -> Array:
        """Duration of each rest, (m,) s."""
        return (self.stop - self.start)[::2]

    @property
    def turn_seconds(self) -> Array:
        """Duration of each turn, (m − 1,) s."""
        return (self.stop - self.start)[1::2]

    @property
    def block(self) -> int:
        """Number of samples in a block of the sensitivities."""
        return max(1, sample_count(BLOCK_SECONDS, self.dt))

    @property
    def turn_labels(self) -> tuple[str, ...]:
        """Names of the turns, such as "p1 to p2"."""
        pairs = zip(self.labels[:-1], self.labels[1:], strict=True)
        return tuple(f"{one} to {other}" for one, other in pairs)


def require_imu(sensor: Sensor) -> None:
    """Raise InputError if the sensor is not three accelerometers followed by three gyros.

    Raises
    ------
    InputError
    """
    if tuple(axis.measures for axis in sensor.axes) != ("f",) * 3 + ("w",) * 3:
        raise InputError(
            "systematic calibration needs three accelerometers and three gyros; add [sensor.gyro]",
            key="[sensor.gyro]",
        )


def segments_of_track(
    track: Track, labels: tuple[str, ...], sensor: Sensor, least_noise: float = 0.35
) -> Segments:
    """Return the rests and turns of a track in which the holds are numbered.

    Parameters
    ----------
    track : Track
        Track of one trial.
    labels : tuple of m str
        Labels of the rests, in order.
    sensor : Sensor
        An IMU: three accelerometers, then three gyros.
    least_noise : float
        Minimum gyro noise, in steps of the readings. With less noise, the gyro readings at the ends
        of turns are wrong because of rounding.

    Raises
    ------
    InputError
        The sensor is unsuitable, there are fewer than six rests, or coarse gyro steps hide noise.
    """
    require_imu(sensor)
    rests = _rest_ranges(track.hold)
    if len(rests) < MIN_RESTS:
        raise InputError(
            f"the recording has {format_count(len(rests), 'rest')} of 5 s or more, but "
            f"systematic calibration needs {MIN_RESTS} or more, with turns between them",
            key="[data] file",
        )
    time, reading = track.time, track.reading
    dt = float((time[-1] - time[0]) / (time.size - 1))
    between = list(zip(rests[:-1, 1].tolist(), rests[1:, 0].tolist(), strict=True))
    counts = np.array([stop - start for start, stop in between])
    last = np.cumsum(counts)
    edges = rests.ravel()
    at = time[0] + (edges - 0.5) * dt
    halves = np.empty((2, len(rests), 6))
    for k, (start, stop) in enumerate(rests.tolist()):
        middle = (start + stop) // 2
        halves[0, k] = reading[start:middle].mean(axis=0)
        halves[1, k] = reading[middle:stop].mean(axis=0)
    ranges = [(start, stop) for start, stop in rests.tolist()]
    mean = np.stack([reading[a:b].mean(axis=0) for a, b in ranges])
    coarse = reading_steps(reading, range(6), sensor, ranges, si=True)
    _require_fine_gyros(coarse, sensor, float(np.median(np.diff(rests, axis=1))) * dt, least_noise)
    return Segments(
        labels=labels,
        mean=mean,
        halves=halves,
        moving=np.concatenate([reading[a:b] for a, b in between]),
        first=(last - counts).astype(np.int64),
        last=last.astype(np.int64),
        dt=dt,
        start=at[:-1],
        stop=at[1:],
        run=(float(time[0] - 0.5 * dt), float(time[-1] + 0.5 * dt)),
        means=track.samples_are_means,
        rounding=_rounding(reading, rests, coarse),
    )


def _require_fine_gyros(
    coarse: ReadingSteps, sensor: Sensor, seconds: float, least_noise: float
) -> None:
    """Raise InputError if gyro steps hide the noise: rests then show no bias or Earth's rate."""
    white = np.array([axis.noise.white**2 for axis in sensor.axes])
    rates = np.array([axis.measures == "w" for axis in sensor.axes])
    bad = np.flatnonzero(
        rates & (coarse.noise < least_noise) & (coarse.variance > white / seconds)
    ).tolist()
    if not bad:
        return
    names = tuple(sensor.axes[k].name for k in bad)
    step = format_quantity(float(coarse.step[bad].max()), 0.0, "°/s")
    raise InputError(
        f"the readings of {', '.join(names)} change in steps of {step}, and their noise is below "
        f"{least_noise:g} of a step, so a rest shows neither their bias nor the Earth's rate; "
        "record with a finer resolution or in a narrower range, or use method multi_position or "
        "six_position",
        names=names,
    )


def _rounding(reading: Array, rests: Indices, steps: ReadingSteps) -> RoundingErrors | None:
    """Return the errors of the means over rests and turns."""
    if not steps.variance.any():
        return None
    parts = [reading[a:b] for a, b in pairwise(rests.ravel().tolist())]
    return steps.errors_of_means(np.stack([p.mean(axis=0) for p in parts]), steps.crossed(parts))


def shift_forces(segments: Segments, samples: int) -> Segments:
    """Return the segments with the accelerometer readings in turns shifted to earlier times.

    `samples` is the shift. A turn begins and ends at rest, so its first or last sample replaces the
    samples beyond its ends.
    """
    if not samples:
        return segments
    moving = segments.moving.copy()
    for first, last in zip(segments.first.tolist(), segments.last.tolist(), strict=True):
        own: Indices = np.array(range(first, last), dtype=np.int64)
        at = np.clip(own + samples, first, last - 1)
        moving[first:last, :3] = segments.moving[at, :3]
    return replace(segments, moving=moving)


def shift_forces_of_track(track: Track, samples: int) -> Track:
    """Return a track with its first three channels, the accelerometers, shifted to earlier times.

    `samples` is the shift. The track begins and ends at rest, so its first or last sample replaces
    the samples beyond its ends.
    """
    if not samples:
        return track
    reading, n = track.reading.copy(), track.time.size
    own: Indices = np.array(range(n), dtype=np.int64)
    reading[:, :3] = track.reading[np.clip(own + samples, 0, n - 1), :3]
    return replace(track, reading=reading)


def _rest_ranges(hold: Indices) -> Indices:
    """Return the start and end of each numbered hold, (m, 2)."""
    change = np.flatnonzero(np.diff(hold)) + 1
    edges = np.concatenate([[0], change, [hold.size]])
    return np.array(
        [(a, b) for a, b in pairwise(edges.tolist()) if hold[a] >= 0], dtype=np.int64
    ).reshape(-1, 2)


def rest_change_deviations(segments: Segments, sensor: Sensor) -> Array:
    """Return the second half's mean minus the first's, divided by its sd, (m, 6)."""
    noises = [axis.noise for axis in sensor.axes]
    white = np.array([one.white**2 for one in noises])
    result = segments.halves[1] - segments.halves[0]
    start, stop = segments.start[::2], segments.stop[::2]
    for k, (a, b) in enumerate(zip(start.tolist(), stop.tolist(), strict=True)):
        middle = 0.5 * (a + b)
        drift = covariance_of_means(
            noises, np.array([a, middle]), np.array([middle, b]), segments.run
        )
        variance = 4 * white / (b - a) + drift[0, 0] + drift[1, 1] - 2 * drift[0, 1]
        if segments.rounding is not None:  # each half has an error
            variance = variance + 2 * segments.rounding.steps.variance
        result[k] /= np.sqrt(variance)
    return result


def rest_change_test(segments: Segments, sensor: Sensor) -> ModelTest:
    """Return the χ² test over all halves."""
    z = rest_change_deviations(segments, sensor)
    return ModelTest(HALVES, float((z**2).sum()), z.size)
