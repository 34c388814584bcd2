"""Over which rates, forces and temperatures a calibration was made: the ranges of its data.

Means count where means are used, and the samples where a method follows them: gyros on a turntable
or on the way between rests, accelerometers where a turntable holds.
"""

from collections.abc import Iterator

import numpy as np

from inercal.arrays import Array
from inercal.calibration import Validity
from inercal.calibration.validity import Range
from inercal.data import EstimatorInput
from inercal.sensors import Sensor


def validity(sensor: Sensor, gathered: EstimatorInput) -> Validity:
    """Return the ranges of the data that were used, None where nothing measured them."""
    return Validity(
        rate=_finite_range(_readings(sensor, gathered, "w")),
        force=_finite_range(_readings(sensor, gathered, "f")),
        temperature=_finite_range(_temperatures(gathered)),
    )


def _finite_range(parts: Iterator[Array]) -> Range | None:
    low, high = np.inf, -np.inf
    for values in parts:  # one by one: all together are as large as the recording
        finite = values[np.isfinite(values)]
        low = min(low, float(finite.min(initial=np.inf)))
        high = max(high, float(finite.max(initial=-np.inf)))
    return (low, high) if low <= high else None


def _readings(sensor: Sensor, gathered: EstimatorInput, kind: str) -> Iterator[Array]:
    """Yield the readings of the axes of a kind, SI."""
    observations = gathered.observations
    at = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
    track, transitions = observations.track, observations.transitions
    if track is not None:
        samples = np.ones(track.time.size, dtype=bool) if kind == "w" else track.hold >= 0
        yield track.reading[..., samples, :][..., at]
        return
    yield observations.mean[..., at]
    if transitions is not None and kind == "w":
        for start, stop in zip(transitions.start.tolist(), transitions.stop.tolist(), strict=True):
            yield sensor.to_si(transitions.output[start : stop + 1])[:, at]


def _temperatures(gathered: EstimatorInput) -> Iterator[Array]:
    """Yield the temperatures of the sections that were used, K; between them where they are."""
    recording, marks, observations = gathered.recording, gathered.marks, gathered.observations
    if recording is None and observations.temperature is not None:
        yield observations.temperature
    if recording is None or recording.temperature is None:
        return
    if observations.track is not None or not marks:
        yield recording.temperature
    elif observations.transitions is not None:
        first, last = min(mark.start for mark in marks), max(mark.stop for mark in marks)
        yield recording.temperature[..., first:last]
    else:
        for mark in marks:
            yield recording.temperature[..., mark.start : mark.stop]
