"""From rest to rest: the samples that carry the attitude of one hold to that of the next.

A hand at rest trembles, and a rest is known by its mean attitude. The rotation between two mean
attitudes is the rate integrated with a weight that rises from 0 to 1 across the rest before, stays
1 on the way and falls to 0 across the rest after: to first order in the wobble, the mean over a
rest of what is left to turn. Of long rests only the part next to the way is weighed, since there
the gyro's noise would outgrow the wobble. A shorter part of a short one would leave a hand's sway.
"""

from collections.abc import Sequence

import numpy as np

from inercal.recording import Mark, Recording, Transitions
from inercal.segments.attitudes import range_findings
from inercal.sensors import Sensor

# s of a rest that are weighed: a hand's sway takes some 3 s, and the noise of a weighed rest costs
# little, since it is also in the rest's mean rate.
WEIGHTED_DURATION = 5.0


def transitions_between_rests(
    recording: Recording, sensor: Sensor, marks: Sequence[Mark]
) -> Transitions:
    """Return the transitions between marks that follow one another in time.

    Those with a gap, or with saturated or stuck gyros, are left out.

    Parameters
    ----------
    recording : Recording
        Without a trial axis.
    sensor : Sensor
        Its axes name the channels.
    marks : sequence of Mark
        Rests in the order of time.
    """
    columns = [recording.channels.index(name) for name in sensor.channels]
    in_place = columns == list(range(len(recording.channels)))
    weighed = max(round(WEIGHTED_DURATION * recording.rate_hz), 1)
    length = np.array([min(mark.stop - mark.start, weighed) for mark in marks])
    begin, end = np.array([(mark.start, mark.stop) for mark in marks]).T
    start, left = end[:-1] - length[:-1], end[:-1] - 1
    reached, stop = begin[1:], begin[1:] + length[1:] - 1
    # The number of the last gap before a sample tells whether one lies between two samples.
    last_gap = np.searchsorted(recording.gaps[:, 0], np.stack([start, stop]))
    whole_way = last_gap[0] == last_gap[1]
    ways = list(zip(start.tolist(), (stop + 1).tolist(), strict=True))
    clean = [flaw is None for flaw in range_findings(recording, sensor.select_axes("w"), ways)]
    kept = np.flatnonzero(whole_way & np.array(clean, dtype=np.bool_))
    return Transitions(
        time=recording.time,
        output=recording.data if in_place else recording.data[:, columns],
        rest=kept,
        start=start[kept],
        left=left[kept],
        reached=reached[kept],
        stop=stop[kept],
        temperature=recording.temperature,
    )
