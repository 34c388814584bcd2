"""Motion of a sensor in a hand: from each rest to the next, and changes within rests."""

from dataclasses import dataclass

from inercal.basics.arrays import Array
from inercal.recordings.samples import Indices


@dataclass(frozen=True, eq=False)
class Transitions:
    """Motion of the sensor from each rest to the next, as ranges of samples.

    A transition is weighted from the mean attitude of one rest to that of the next: the weight of a
    sample rises from 0 to 1 along samples `start` to `left`, and falls along `reached` to `stop`.

    Parameters
    ----------
    time : (n,) array
        s, of each sample of the recording.
    output : (n, m) array
        Readings of the sensor's axes in output units.
    rest : (k,) array of int
        Row of the observations at the begin of each transition; it ends at the next row.
    start, left, reached, stop : (k,) arrays of int
        Samples: `left` is the last sample of the rest before, `reached` the first sample of the
        rest after, `stop` the last sample of the transition.
    temperature : (n,) array or None
        K, of each sample.
    """

    time: Array
    output: Array
    rest: Indices
    start: Indices
    left: Indices
    reached: Indices
    stop: Indices
    temperature: Array | None = None

    @property
    def duration(self) -> Array:
        """Effective duration of each transition, (k,) s: rotation over a constant rate."""
        t = self.time
        ends = t[self.left] - t[self.start] + t[self.stop] - t[self.reached]
        return t[self.reached] - t[self.left] + 0.5 * ends


@dataclass(frozen=True, eq=False)
class HalfSectionChanges:
    """Changes of the readings of r sections at rest from the first half to the second.

    Parameters
    ----------
    change : (r, m) array
        Mean of the second half less that of the first, output units.
    integral : (r, m) array
        Integral of the readings over time, with the weight by which a rate rotates the first mean
        attitude into the second: from 0 to 1 across the first half, and back; output units times s.
    seconds : (r,) array
        Integral of that weight.
    square : (r,) array
        Sum of the weights' squares times the step squared, s²: the variance of an integral over
        that of a sample.
    warming : (r,) array or None
        Mean temperature of the second half less that of the first, K.
    """

    change: Array
    integral: Array
    seconds: Array
    square: Array
    warming: Array | None = None
