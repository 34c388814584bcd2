"""Compute block means of the samples in a ramp, and the covariance of their noise.

The sensing element is at T = R + τ dR/dt. R_k are block means over L seconds. Readings and
temperatures are both weighted by Simpson's rule,

    R̄_k = (R_{k−1} + 4 R_k + R_{k+1})/6,    mean of dR/dt = (R_{k+1} − R_{k−1})/(2 L)

The temperature and its rate are therefore both means of the same temperature curve with kernels of
equal width. The rate must be smoothed because of the temperature sensor's noise, and with equal
widths this does not bias τ. The covariance of the weighted means follows from white noise N, bias
instability B and random walk K of an axis. A constant per axis is also estimated, which absorbs the
drift that all blocks share.

A thermometer that reports whole or half degrees shows when the temperature passes a step, and
smoothing would destroy this information. In that case the temperature curve is a spline through the
crossings, whose nodes are estimated (`inercal.methods.temperature_ramp.thermometer_steps`), and the
blocks are shorter and unweighted.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.methods.temperature_ramp import thermometer_steps
from inercal.physics.sensors import Noise, Sensor
from inercal.recordings import Track
from inercal.recordings.segments.reading_steps import reading_steps
from inercal.recordings.segments.section_means import even_drift_covariance

SHORTEST_BLOCK = 10.0  # s
# Noise in the rate of the temperature biases the lag towards zero, so blocks are lengthened by
# these factors until the share of the noise is small.
_LONGER = (1.0, 1.5, 2.0, 3.0, 4.5, 6.0)
_NOISE_SHARE = 0.03  # of the sum of squares of the rate beyond a cubic of the temperature
MOST_BLOCKS = 1000  # the covariance of an axis has the square of this many elements
_LEAST_BLOCKS = 30
_SHORTEST_BLOCK_OF_STEPS = 4.0  # s
_COARSE_STEP = 0.04  # K
_LEAST_CROSSINGS = 4
_LOOKED_AT = 60  # number of blocks that are examined for steps of the readings


class NodeMeans(NamedTuple):
    """The nodes of a temperature curve, and their effect on the block means.

    Parameters
    ----------
    nodes : CourseNodes
    kelvin, rate : (b, k) arrays
        Sensitivity of the block means of R and dR/dt to the value of each node.
    """

    nodes: thermometer_steps.CourseNodes
    kelvin: Array
    rate: Array


@dataclass(frozen=True, eq=False)
class RampBlocks:
    """Means over b blocks of a recording at rest, either weighted or plain.

    Parameters
    ----------
    time : (b,) array
        Time at the middle of each block, counted from the first sample, s.
    kelvin, rate : (b,) arrays
        Recorded temperature, K, and its time derivative, K/s.
    reading : (b, m) array
        Mean readings, SI.
    seconds : float
        Duration of a block, s.
    course : NodeMeans or None
        Temperature curve of a coarse thermometer. If given, `kelvin` and `rate` follow from its
        nodes before the fit, and the means are plain.
    samples : int
        Number of samples in a block.
    step : float
        Step of a coarse thermometer, K; 0 for a fine one.
    """

    time: Array
    kelvin: Array
    rate: Array
    reading: Array
    seconds: float
    samples: int
    course: NodeMeans | None = None
    step: float = 0.0

    @classmethod
    def from_track(cls, track: Track) -> "RampBlocks":
        """Return the blocks for a track of one trial with a temperature.

        Raises
        ------
        InputError
            There are fewer than 30 blocks of 10 s.
        """
        duration = float(track.time[-1] - track.time[0])
        shortest = max(SHORTEST_BLOCK, duration / MOST_BLOCKS)
        if duration < (_LEAST_BLOCKS + 2) * shortest:
            raise InputError(
                f"the recording lasts {duration:.0f} s, but a ramp needs at least "
                f"{(_LEAST_BLOCKS + 2) * SHORTEST_BLOCK:g} s; record longer",
                key="[data] file",
            )
        found = cls._of_length(track, shortest)
        for factor in _LONGER[1:]:
            if found.noise_share <= _NOISE_SHARE or duration < 2 * _LEAST_BLOCKS * found.seconds:
                break
            found = cls._of_length(track, factor * shortest)
        assert track.temperature is not None
        step = thermometer_steps.thermometer_step(track.temperature)
        if step is None or step < _COARSE_STEP:
            return found
        found = replace(found, step=step)
        return cls._along_steps(track, step) or found

    @classmethod
    def _of_length(cls, track: Track, length: float) -> "RampBlocks":
        assert track.temperature is not None
        cut = _Cut.of_length(track, length)
        kelvin = cut.means(track.temperature)
        return cls(
            cut.means(track.time - track.time[0])[1:-1],
            _weighted(kelvin),
            (kelvin[2:] - kelvin[:-2]) / (2 * cut.seconds),
            _weighted(cut.means(track.reading)),
            cut.seconds,
            cut.per_block,
        )

    @classmethod
    def _along_steps(cls, track: Track, step: float) -> "RampBlocks | None":
        """Return the blocks for a coarse thermometer, or None if it crosses too few steps."""
        assert track.temperature is not None
        time, kelvin = track.time - track.time[0], track.temperature
        period = float(time[-1]) / (time.size - 1)
        ends = -0.5 * period, float(time[-1]) + 0.5 * period
        crossings = thermometer_steps.find_crossings(time, kelvin, step).within(*ends)
        if crossings.time.size < _LEAST_CROSSINGS:
            return None
        nodes = thermometer_steps.course_nodes(crossings, ends, float(kelvin[0]), float(kelvin[-1]))
        cut = _Cut.of_length(track, max(_SHORTEST_BLOCK_OF_STEPS, float(time[-1]) / MOST_BLOCKS))
        edges = ends[0] + cut.seconds * np.arange(cut.number + 1)
        course = NodeMeans(nodes, *nodes.means(edges))
        return cls(
            cut.means(time),
            course.kelvin @ nodes.kelvin,
            course.rate @ nodes.kelvin,
            cut.means(track.reading),
            cut.seconds,
            cut.per_block,
            course,
            step,
        )

    @property
    def noise_share(self) -> float:
        """Share of the temperature sensor's noise in the part of the rate that determines the lag.

        The noise follows from third differences of the rate, which real temperatures hardly affect.
        """
        x = (self.kelvin - self.kelvin.mean()) / max(float(np.ptp(self.kelvin)), 1e-9)
        beside = np.linalg.qr(np.stack([x**k for k in range(4)], axis=-1))[0]
        rest = self.rate - beside @ (beside.T @ self.rate)
        changes = np.diff(self.rate, n=3)
        # If block means have white noise, third differences of the rate have 14 times the variance
        # of the rate. The median, .455 of the variance, is dominated by quiet parts of the curve.
        noise = float(np.median(changes**2)) / 0.455 / 14.0
        return float(rest.size * noise / max(float(rest @ rest), 1e-30))

    def noise_covariance(self, noise: Noise) -> Array:
        """Return the covariance of the weighted means for an axis, (b, b) SI."""
        weighted = self.course is None
        count = self.time.size + 2 * weighted
        blocks = noise.white**2 / self.seconds * np.eye(count)
        blocks += even_drift_covariance(noise, count, self.seconds)
        return _weighted(_weighted(blocks).T) if weighted else blocks

    def rounding_covariance(self, track: Track, sensor: Sensor) -> Array | None:
        """Return the covariance of the means due to coarse steps of the readings, (b, b, m) SI."""
        n = track.time.size
        length = max(1, round(n * self.seconds / float(track.time[-1] - track.time[0])))
        starts = np.linspace(0, n - length, min(_LOOKED_AT, n // length)).astype(np.int64)
        blocks = [(start, start + length) for start in starts.tolist()]
        coarse = reading_steps(track.reading, range(len(sensor.axes)), sensor, blocks, si=True)
        errors = coarse.errors_of_means(self.reading)
        return None if errors is None else errors.covariance

    def whitening(self, sensor: Sensor, rounding: Array | None = None) -> list[Array]:
        """Return L⁻¹ for each axis, (b, b), where L Lᵀ is the covariance of the noise.

        Parameters
        ----------
        sensor : Sensor
        rounding : (b, b, m) array, optional
            Covariance of the means due to coarse steps of the readings.

        Raises
        ------
        InputError
            An axis has no white noise.
        """
        found: dict[tuple[Noise, int], Array] = {}
        keys = [(axis.noise, k * (rounding is not None)) for k, axis in enumerate(sensor.axes)]
        for axis, key in zip(sensor.axes, keys, strict=True):
            if not axis.noise.white:
                section = "accelerometer" if axis.measures == "f" else "gyro"
                raise InputError(
                    f"[sensor.{section}] white is missing, but a ramp is weighted by the "
                    "stated noise; state white, bias_instability and random_walk",
                    key=f"[sensor.{section}] white",
                    names=(axis.name,),
                )
            if key not in found:
                covariance = self.noise_covariance(axis.noise)
                if rounding is not None:
                    covariance = covariance + rounding[..., key[1]]
                factor = np.linalg.cholesky(covariance)
                inverse = np.linalg.solve(factor, np.eye(self.time.size))
                found[key] = np.asarray(inverse, dtype=np.float64)
        return [found[key] for key in keys]

    @cached_property
    def _course(self) -> Array:
        """The temperature about once per minute, with the noise of its sensor averaged out, K."""
        every = max(1, round(60 / self.seconds))
        every = min(every, self.kelvin.size)
        used = self.kelvin.size // every * every
        return self.kelvin[:used].reshape(-1, every).mean(axis=1)

    @property
    def is_monotonic(self) -> bool:
        """Whether the temperature hardly reverses its direction."""
        steps = np.diff(self._course)
        rises, falls = float(steps.clip(min=0).sum()), float(-steps.clip(max=0).sum())
        return min(rises, falls) < 0.5 * float(np.ptp(self.kelvin))


class _Cut(NamedTuple):
    """How samples are divided into blocks."""

    per_block: int
    number: int
    seconds: float

    @classmethod
    def of_length(cls, track: Track, length: float) -> "_Cut":
        n, duration = track.time.size, float(track.time[-1] - track.time[0])
        per_block = max(1, round(length * (n - 1) / duration))
        return cls(per_block, n // per_block, per_block * duration / (n - 1))

    def means(self, values: Array) -> Array:
        """Return the means over the blocks along the first axis."""
        used = values[: self.number * self.per_block]
        return used.reshape(self.number, self.per_block, *values.shape[1:]).mean(axis=1)


def _weighted(blocks: Array) -> Array:
    """Return the weighted means for the inner blocks, along the first axis."""
    return (blocks[:-2] + 4 * blocks[1:-1] + blocks[2:]) / 6
