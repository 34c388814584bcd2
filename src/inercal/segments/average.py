"""From marked sections to observations: means with an honest covariance.

The noise of the resting sections is pooled: its density at zero frequency, by batch means, gives
the covariance of every mean, that of the turns included (a turn's own scatter is motion, not
noise). A stated bias instability adds its Allan floor to every section.
"""

from collections.abc import Sequence
from math import log, pi

import numpy as np
from numpy.typing import NDArray

from inercal.errors import InputError
from inercal.plan import Hold, Step, Turn
from inercal.recording import Mark, Observations, Recording
from inercal.sensors import Sensor
from inercal.uncertainty import pooled_mean_covariances

Array = NDArray[np.float64]
MIN_SAMPLES = 20  # fewer leave no batches to judge the noise by


def observe(
    recording: Recording, sensor: Sensor, marks: Sequence[Mark], steps: Sequence[Step]
) -> Observations:
    """Return one row for each step that is marked, in the order of `steps`.

    Parameters
    ----------
    recording : Recording
    sensor : Sensor
        Its axes name the channels that are used; its readout gives SI.
    marks : sequence of Mark
    steps : sequence of Step

    Raises
    ------
    InputError
        A section is too short, no hold is marked, or a section lies on a flaw of the recording.
    """
    by_label = {mark.label: mark for mark in marks}
    used = [step for step in steps if step.label in by_label]
    columns = [recording.channels.index(name) for name in sensor.channels]
    sections: list[Array] = []
    for step in used:
        mark = by_label[step.label]
        _refuse_flaws(recording, mark, step, sensor.channels)
        if mark.stop - mark.start < MIN_SAMPLES:
            raise InputError(
                f"{recording.source}: section {mark.label} has {mark.stop - mark.start} samples; "
                f"at least {MIN_SAMPLES} are needed"
            )
        sections.append(sensor.to_si(recording.data[..., mark.start : mark.stop, columns]))
    holds = [
        section for section, step in zip(sections, used, strict=True) if isinstance(step, Hold)
    ]
    if not holds:
        raise InputError(f"{recording.source}: no position at rest is marked")
    samples = np.array([section.shape[-2] for section in sections])
    of_holds, dof = pooled_mean_covariances(holds)
    density = of_holds[0] * holds[0].shape[-2]
    floor = np.array([2 * log(2) / pi * axis.noise.bias_instability**2 for axis in sensor.axes])
    starts = np.array([by_label[step.label].start for step in used])
    return Observations(
        labels=tuple(step.label for step in used),
        mean=np.stack([section.mean(axis=-2) for section in sections], axis=-2),
        covariance=density[..., None, :, :] / samples[:, None, None] + np.diag(floor),
        duration=samples * recording.median_step,
        samples=samples,
        time=recording.time[starts] + 0.5 * samples * recording.median_step,
        channels=sensor.channels,
        dof=dof,
    )


def _refuse_flaws(recording: Recording, mark: Mark, step: Step, channels: Sequence[str]) -> None:
    """Refuse a section that holds saturated or stuck samples, or a turn with samples lost."""
    where = f"{recording.source}: section {mark.label} (samples {mark.start} to {mark.stop})"
    for flaw in recording.findings:
        if flaw.what not in ("saturation", "stuck") or flaw.start is None or flaw.stop is None:
            continue
        relevant = flaw.channel is None or flaw.channel in channels
        if relevant and flaw.start < mark.stop and flaw.stop > mark.start:
            raise InputError(
                f"{where} cannot be used: {flaw.message}; mark a section without it or record again"
            )
    lost = (recording.gaps[:, 0] >= mark.start) & (recording.gaps[:, 1] < mark.stop)
    if isinstance(step, Turn) and lost.any():
        after = int(recording.gaps[np.argmax(lost), 0])
        raise InputError(
            f"{where} cannot be used: samples are lost after sample {after}, and with them part of "
            "the turn's angle; record it again"
        )
