"""Find the threshold between the scatter of a sensor at rest and in motion.

For each kind of axis (accelerometers, gyros) the statistic is v, the variance over a sliding window
of half a second, summed over the axes. The threshold for each kind splits a histogram of log v into
two classes by Otsu's criterion (1979, IEEE Trans. SMC 9(1), 62–66). It chooses the split t with the
largest variance between the classes,

    n₁(t) n₂(t) (m₁(t) − m₂(t))²,   n the number and m the mean of log v below and above t;

if the bins between two classes are empty, it takes their middle. With log v the threshold does not
depend on units and is about half-way, in decades, between rest and motion. Minimum-error
thresholding (Kittler & Illingworth 1986, Pattern Recognition 19, 41–47) was tried first. It puts
the threshold where the narrow peak of rest ends, so that the smallest tremor splits a rest. It
found 44 rests instead of 38 in a log of an Xsens MTi, and 17 instead of 22 for an MPU-9150 that was
held by hand or placed on a table. In 48 simulated sessions (at rest for 10–95 % of the time,
tremor, coarse steps, a noisy axis) it missed rests in 8 sessions, and Otsu's criterion in 3: those
with a heavy tremor after a rest on a table. Three rules make Otsu's criterion more robust:

- While v stays within a ratio of 4, it is counted for two seconds only, and the lowest and the
  highest 5 % of the counts are moved inwards, so that neither a long rest nor a shock forms a
  class.
- v is at least the rounding variance, Σ q²/12 with q the smallest step of an axis, because the
  readings of a coarse axis may be constant.
- Classes whose mean scatters differ by a ratio of less than 1.75 are one class. The ratio is 1.1
  for white noise and 1.5 for the sway of a hand in one position. A kind of axis with only one class
  is ignored; if no other kind remains, there is no threshold.
"""

from dataclasses import dataclass
from math import exp, log, sqrt

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.basics.units import format_number
from inercal.physics.quantities import INERTIAL, QUANTITIES, Measures
from inercal.physics.sensors import Sensor
from inercal.recordings import Recording, sample_count

WINDOW = 0.5  # s, over which scatter is computed
CLASS_RATIO = 1.75  # smallest ratio of the classes' mean scatters
_STAY = 2.0  # s, for which an unchanged level is counted
_OUTER = 0.05
_BINS = 512
_SPAN = 1e14  # range of v; rounding of the sums is smaller, and 24-bit readings fit within it
_MOVING = 0.01  # an axis is dead if a smaller share of samples differs from the preceding sample


@dataclass(frozen=True)
class MotionThreshold:
    """Scatter of one kind of axis over a window: root mean square over its axes.

    Parameters
    ----------
    kind : "f" or "w"
    unit : str
        Output unit of the values.
    quiet, moving : float
        Median scatter at rest and in motion; without a threshold, the overall median and maximum.
    threshold : float
        Limit between rest and motion; infinite if they are not distinct for this kind of axis.
    """

    kind: Measures
    unit: str
    quiet: float
    moving: float
    threshold: float

    @property
    def words(self) -> str:
        """Scatter at rest and threshold, in words."""
        limit = f"threshold {format_number(self.threshold, 3)} {self.unit}"
        if not np.isfinite(self.threshold):
            limit = "no threshold because rest and motion have the same scatter"
        kind = QUANTITIES[self.kind].sensors
        return f"scatter at rest {format_number(self.quiet, 3)} {self.unit}, {limit} ({kind})"


@dataclass(frozen=True, eq=False)
class WeightedAxes:
    """The columns of one kind of axis, with weights relative to the scale of the first column."""

    kind: Measures
    unit: str
    columns: Indices
    weight: Array


def axis_kinds(recording: Recording, sensor: Sensor) -> list[WeightedAxes]:
    """Return the accelerometers and gyros that the sensor has.

    Raises
    ------
    InputError
        The recording has a trial axis, or the sensor has no axis.
    """
    if recording.data.ndim != 2:
        raise InputError(
            f"{recording.source}: rests can only be detected in a single run, whose data have the "
            f"shape (n, m), but these data have the shape {recording.data.shape}; detect the rests "
            "in each trial separately"
        )
    found: list[WeightedAxes] = []
    for kind in INERTIAL:
        axes = sensor.select_axes(kind).axes
        if axes:
            columns = np.array([recording.channels.index(axis.name) for axis in axes])
            scale = np.array([axis.readout.scale for axis in axes])
            unit = recording.units[int(columns[0])]
            found.append(WeightedAxes(kind, unit, columns, (scale[0] / scale) ** 2))
    if not found:
        raise InputError(
            f"sensor {sensor.name} has no axes, and rests are detected from them; name its columns"
        )
    return found


def window_samples(recording: Recording) -> int:
    """Return the number of samples in a window."""
    return max(sample_count(WINDOW, recording.median_step), 4)


def gapless_segments(recording: Recording) -> Indices:
    """Return the ranges of samples between gaps, (s, 2)."""
    after = recording.gaps[:, 1]
    return np.column_stack([np.r_[0, after], np.r_[after, recording.time.size]])


def scatter(recording: Recording, sensor: Sensor, kind: Measures) -> Array:
    """Return each sample's scatter, (n,) output units, which is compared with the thresholds.

    The scatter is the standard deviation over a window, as a root mean square over the axes of one
    kind.

    Parameters
    ----------
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
    kind : "f" or "w"

    Raises
    ------
    InputError
        The recording has a trial axis, or the sensor has no axis of this kind.
    """
    from inercal.recordings.segments import _kernels  # loads Numba

    for one in axis_kinds(recording, sensor):
        if one.kind == kind:
            window, segments = window_samples(recording), gapless_segments(recording)
            v = _kernels.window_variances(recording.data, one.columns, one.weight, segments, window)
            v /= one.columns.size
            return np.sqrt(v, out=v)
    raise InputError(f"sensor {sensor.name} has no {QUANTITIES[kind].sensors}", names=(kind,))


def motion_threshold(
    recording: Recording, axes: WeightedAxes, segments: Indices, window: int
) -> tuple[MotionThreshold, float]:
    """Return the scatter of one kind of axis, and the fraction of windows at rest.

    `segments` are (s, 2), and `window` is in samples. Without two classes the threshold is
    infinite.
    """
    from inercal.recordings.segments import _kernels  # loads Numba

    given = (recording.data, axes.columns, axes.weight, segments, window)
    top, step, changes = _kernels.variance_extent(*given)
    coarse = np.where(changes >= _MOVING * recording.time.size, step, 0.0)
    lowest = max(float(axes.weight @ coarse**2) / 12, top / _SPAN)
    if not top > lowest:
        still = float(np.sqrt(top / axes.columns.size))
        return MotionThreshold(axes.kind, axes.unit, still, still, np.inf), 1.0
    stay = round(_STAY / WINDOW * window)
    counted, every = _kernels.variance_histogram(*given, lowest, top, stay, _BINS)
    width = log(top / lowest) / _BINS
    place, apart = _otsu_split(counted)
    split = place if apart * width > 2 * log(CLASS_RATIO) else _BINS

    def deviation(place: float) -> float:
        return sqrt(lowest * exp(width * place) / axes.columns.size)

    level = MotionThreshold(
        axes.kind,
        axes.unit,
        quiet=deviation(_median(every[: int(split)])),
        moving=deviation(split + _median(every[int(split) :]) if split < _BINS else _BINS),
        threshold=deviation(split) if split < _BINS else np.inf,
    )
    return level, float(every[: int(split)].sum()) / float(every.sum())


def _otsu_split(counts: Indices) -> tuple[float, float]:
    """Return the best split and the distance between the means on both sides, in bins."""
    n = _winsorise(counts)
    x = np.arange(n.size) + 0.5
    below = np.cumsum(n)[:-1]
    above = n.sum() - below
    sums = np.cumsum(n * x)
    inside = (below > 0) & (above > 0)
    first = sums[:-1] / np.where(inside, below, 1.0)
    second = (sums[-1] - sums[:-1]) / np.where(inside, above, 1.0)
    distance = np.where(inside, second - first, 0.0)
    between = below * above * distance**2
    best = np.flatnonzero(between >= (1 - 1e-9) * between.max())
    return 1 + 0.5 * float(best[0] + best[-1]), float(distance[best[0]])


def _median(counts: Indices) -> float:
    """Return the centre of the bin that contains the median."""
    total = np.cumsum(counts)
    return int(np.searchsorted(total, 0.5 * float(total[-1]))) + 0.5


def _winsorise(counts: Indices) -> Array:
    """Return the counts after moving the lowest and the highest 5 % to the nearest inner bins."""
    total = np.cumsum(counts)
    low, high = np.searchsorted(total, [_OUTER * total[-1], (1 - _OUTER) * total[-1]])
    n = counts.astype(np.float64)
    n[low] += n[:low].sum()
    n[high] += n[high + 1 :].sum()
    n[:low] = n[high + 1 :] = 0.0
    return n


def summed_variance(deviation: float, axes: WeightedAxes) -> float:
    """Return the variance summed over a kind's axes, given each axis's standard deviation."""
    return axes.columns.size * deviation**2
