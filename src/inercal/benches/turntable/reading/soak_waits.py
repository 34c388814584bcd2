"""Leaves out the waits between soaks, because the model does not hold during fast changes."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.benches.turntable.reading.host_readback import Interruption
from inercal.benches.turntable.reading.readback_angles import RecordingWithAngles
from inercal.recordings.environment import Environment
from inercal.recordings.environment.soaks import SOAK_SPREAD


class SoakWaits(NamedTuple):
    """The waits that were left out of a recording, and the first sample of each soak in it."""

    waits: tuple[Interruption, ...] = ()
    first_samples: tuple[int, ...] = (0,)


def without_waits(
    read: RecordingWithAngles, environment: Environment | None
) -> tuple[RecordingWithAngles, SoakWaits]:
    """Return a recording over soaks without the waits.

    A wait is a period without a label in which the temperature changes by more than 3 K. After it,
    the filters take the attitude from the readback, and continue with the same states.
    """
    recording = read.recording
    labels, kelvin = recording.labels, recording.temperature
    if environment is None or environment.kind != "soaks" or labels is None or kelvin is None:
        return read, SoakWaits()
    blank = np.concatenate([[False], np.char.strip(labels) == "", [False]])
    edges = np.flatnonzero(np.diff(blank.astype(np.int8))).reshape(-1, 2)
    kept, waits, firsts = np.ones(labels.size, np.bool_), list[Interruption](), [0]
    for start, stop in edges.tolist():
        if np.ptp(kelvin[start:stop]) > SOAK_SPREAD:
            kept[start:stop] = False
            ends = [max(start - 1, 0), min(stop, labels.size - 1)]
            begin, end = recording.time[ends].tolist()
            waits.append(Interruption(begin, end, "the temperature changed"))
            if abs(np.diff(kelvin[ends])) > SOAK_SPREAD:
                firsts.append(int(np.count_nonzero(kept[:stop])))
    if not waits:
        return read, SoakWaits()
    original = np.arange(labels.size) if recording.original is None else recording.original
    shorter = replace(
        recording,
        time=recording.time[kept],
        data=recording.data[kept],
        labels=labels[kept],
        temperature=kelvin[kept],
        readback={name: values[kept] for name, values in recording.readback.items()},
        original=original[kept],
        # The sample numbers in these findings refer to the whole recording.
        findings=tuple(replace(one, start=None, stop=None) for one in recording.findings),
    )
    quality = None if read.quality is None else read.quality.where(kept)
    found = SoakWaits(tuple(waits), tuple(firsts))
    return replace(read, recording=shorter, quality=quality), found
