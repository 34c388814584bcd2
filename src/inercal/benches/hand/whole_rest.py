"""A recording that is one rest: its samples for an estimator that follows them, and their mean."""

import numpy as np

from inercal.data import EstimatorInput, RestsSection, Source
from inercal.data.recording_loader import load_recording
from inercal.recording import Mark, Observations, Track
from inercal.section_settings import key_error


def observe_whole_rest(run: Source[RestsSection]) -> EstimatorInput:
    """Return one row of the whole recording, with its track.

    Raises
    ------
    InputError
        A table of means, a recording without temperature, or one that the audit refuses.
    """
    if run.data.kind == "means":
        raise key_error(
            "[data] kind",
            f"method {run.method.name} follows samples; give the recording",
            run.path,
        )
    if run.data.marks != "found":
        raise key_error(
            "[data] marks",
            f"method {run.method.name} takes the whole recording as one rest; remove marks",
            run.path,
        )
    recording, sensor = load_recording(run), run.sensor
    if recording.temperature is None:
        raise key_error(
            "[data] temperature",
            f"is missing: method {run.method.name} needs the sensor's temperature; name its column",
            run.path,
        )
    columns = [recording.channels.index(name) for name in sensor.channels]
    reading = sensor.to_si(recording.data[:, columns])
    n = len(reading)
    track = Track(
        recording.time,
        reading,
        np.zeros((n, 0)),
        np.zeros(n, dtype=np.int64),
        recording.temperature,
    )
    step = run.steps[0]
    observations = Observations(
        labels=(step.label,),
        mean=reading.mean(axis=0)[None],
        covariance=np.diag(reading.var(axis=0) / n)[None],
        duration=np.array([recording.duration]),
        samples=np.array([n]),
        time=np.array([recording.time.mean()]),
        channels=sensor.channels,
        temperature=np.array([recording.temperature.mean()]),
        track=track,
    )
    marks = (Mark(step.label, 0, n),)
    return EstimatorInput(recording, marks, observations, (step,), (step,), recording.findings)
