"""Find the rests in a recording on a turntable without readback, using the gyros.

The table is at rest while the mean rate over 0.2 s is within 0.05 °/s of its median on every axis.
One second is cut off next to each turn, because the table settles. Rests shorter than 5 s count as
parts of turns.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import acos, cos, degrees, radians
from typing import Any, cast

import numpy as np

from inercal.basics.arrays import Array, Indices, true_ranges
from inercal.basics.errors import InputError, error_location
from inercal.basics.units import format_count, format_duration, format_quantity
from inercal.benches.turntable.attitude import reference_attitude
from inercal.benches.turntable.bench import StillTable
from inercal.benches.turntable.settings import TurntableData
from inercal.physics.plan import Hold, Position
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Mark, Recording, Track, sample_count
from inercal.recordings.data import EstimatorInput, RunBase
from inercal.recordings.data.recording_loader import load_recording
from inercal.recordings.io.audit import require_accepted
from inercal.recordings.io.rest_norm import audit_rest_norm
from inercal.recordings.samples import INVALID_SAMPLES
from inercal.recordings.segments import average_sections

_WINDOW = 0.2  # s
_MOVING = radians(0.05)  # rad/s
_SIGMAS = 6.0  # standard deviations of a window's noise, if they exceed that threshold
_SETTLING = 1.0  # s
_SHORTEST = 5.0  # s
_MIN_RESTS = 6
_NEAR = cos(radians(10))  # between the upward directions of a rest and of the plan


def observe_without_angles(run: RunBase[TurntableData]) -> EstimatorInput:
    """Return the rests in a recording, and the track with their numbers.

    Raises
    ------
    InputError
        The data are means or have marks, the noise is not stated, or the recording is clipped,
        begins or ends in a turn, has a gap in a turn, or has fewer than six rests.
    """
    with error_location(run.path):
        _require_samples(run)
    bench = StillTable.from_turntable(run.bench)
    sensor = run.sensor
    recording = load_recording(replace(cast(Any, run), bench=bench))
    recording = require_accepted(audit_rest_norm(recording, sensor, bench.gravity.value))
    places = [recording.channels.index(name) for name in sensor.channels]
    reading = sensor.to_si(recording.data[:, places])
    rests = find_rests(recording.time, reading, sensor)
    where = str(run.path)
    _require_rests(where, recording, rests)
    force = np.stack([reading[start:stop, :3].mean(axis=0) for start, stop in rests.tolist()])
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    labels, planned = _name_rests(run, recording, rests, up)
    _require_whole_turns(where, recording, rests, labels)
    _require_within_range(where, recording, sensor)
    hold = np.full(recording.time.size, -1, dtype=np.int64)
    steps: list[Hold] = []
    for k, (start, stop) in enumerate(rests.tolist()):
        hold[start:stop] = k
        x, y, z = up[k].tolist()
        steps.append(Hold(labels[k], (x, y, z), recording.span(start, stop)))
    track = Track(
        recording.time,
        reading,
        np.zeros((hold.size, 0)),
        hold,
        recording.temperature,
        samples_are_means=run.data.sample == "mean",
    )
    marks = tuple(Mark(label, *rest) for label, rest in zip(labels, rests.tolist(), strict=True))
    observations = average_sections(recording, sensor, marks, steps, found=True)
    return EstimatorInput(
        recording,
        marks,
        replace(observations, track=track),
        tuple(steps),
        tuple(steps),
        (*recording.findings, *planned),
        {
            "gravity": format_quantity(bench.gravity.value, bench.gravity.sd, "m/s²"),
            "latitude": format_quantity(bench.latitude.value, bench.latitude.sd, "°"),
            "path": f"{len(rests)} rests and {len(rests) - 1} turns, found with the gyros",
        },
        bench=bench,
    )


def _require_samples(run: RunBase[TurntableData]) -> None:
    """Refuse keys that have no effect here, and noise that is not stated."""
    if run.data.kind == "means":
        raise key_error(
            "[data] kind",
            f"method {run.method.name} integrates samples through turns; give a recording",
        )
    if run.data.seconds is not None or run.data.marks != "found":
        key = "marks" if run.data.seconds is None else "seconds"
        text = f"method {run.method.name} finds rests with the gyros; remove {key}"
        raise key_error(f"[data] {key}", text)
    if {axis.measures for axis in run.sensor.axes} != {"f", "w"}:
        raise key_error("[sensor.gyro]", "is missing: gyros must carry the attitude between rests")
    for axis in run.sensor.axes:
        if not axis.noise.white > 0:
            section = "accelerometer" if axis.measures == "f" else "gyro"
            raise key_error(
                f"[sensor.{section}] white",
                "rests and turns are weighted by the noise density; state it",
            )


def find_rests(time: Array, reading: Array, sensor: Sensor) -> Indices:
    """Return the rests as half-open ranges of samples, (m, 2).

    Parameters
    ----------
    time : (n,) array
        Times, s.
    reading : (n, m) array
        Readings, SI, in the order of the sensor's axes.
    sensor : Sensor
        The sensor, whose gyros show the rests. Their noise may raise the threshold.
    """
    gyros = [k for k, axis in enumerate(sensor.axes) if axis.measures == "w"]
    dt = float(np.median(np.diff(time)))
    size = max(sample_count(_WINDOW, dt), 1)
    still = np.ones(time.size, dtype=np.bool_)
    for k in gyros:
        noise = sensor.axes[k].noise.rounded(1 / dt).white / (size * dt) ** 0.5
        total = np.concatenate([[0.0], np.cumsum(reading[:, k])])
        first = np.clip(np.arange(time.size) - size // 2, 0, time.size - size)
        mean = (total[first + size] - total[first]) / size
        still &= np.abs(mean - np.median(reading[:, k])) < max(_MOVING, _SIGMAS * noise)
    margin, shortest = sample_count(_SETTLING, dt), sample_count(_SHORTEST, dt)
    found: list[tuple[int, int]] = []
    for start, stop in true_ranges(still):
        start += margin if start > 0 else 0
        stop -= margin if stop < time.size else 0
        if stop - start >= shortest:
            found.append((start, stop))
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _name_rests(
    run: RunBase[TurntableData], recording: Recording, rests: Indices, up: Array
) -> tuple[list[str], tuple[Finding, ...]]:
    """Return a name for each rest, (m,), and a warning if a stated plan has other attitudes.

    The names are the labels in the recording, otherwise the labels of the plan, otherwise numbers.
    `up` is the direction of the mean force during each rest, (m, 3).
    """
    names, findings = [f"rest {k}" for k in range(1, len(rests) + 1)], tuple[Finding, ...]()
    if run.has_plan_keys:
        planned = [step for step in run.steps if isinstance(step, Position)]
        nominal = np.array([reference_attitude(run.bench, np.array([s.angles]))[0, 2]
                            for s in planned])  # fmt: skip
        if len(planned) != len(rests):
            findings = (_plan_finding(f"{len(rests)} rests, but the plan has {len(planned)}"),)
        elif (cosine := (nominal * up).sum(axis=1)).min() < _NEAR:
            k = int(cosine.argmin())
            text = f"rest {k + 1} {degrees(acos(cosine[k])):.0f}° away from {planned[k].label}"
            findings = (_plan_finding(f"{text} in the plan"),)
        else:
            names = [step.label for step in planned]
    if recording.labels is not None:
        middles = [(start + stop) // 2 for start, stop in rests.tolist()]
        own = [str(name).strip() for name in recording.labels[middles].tolist()]
        if all(own) and len(set(own)) == len(own):
            names = own
    return names, findings


def _plan_finding(text: str) -> Finding:
    return Finding(
        "warning",
        "path",
        f"the recording does not follow the stated plan: it has {text}; check [method] path and "
        "[bench] axes. The result does not depend on the plan",
    )


def _require_rests(where: str, recording: Recording, rests: Indices) -> None:
    if len(rests) >= _MIN_RESTS:
        return
    raise InputError(
        f"{where}: the gyros show {format_count(len(rests), 'rest')} of {_SHORTEST:g} s or "
        f"more (mean rate within {degrees(_MOVING):g} °/s over {_WINDOW:g} s, {_SETTLING:g} s cut "
        f"off beside turns) in {format_duration(recording.duration)}; a systematic calibration "
        "needs "
        f"{_MIN_RESTS} rests with turns between them: rest longer, or check the unit of the gyros",
    )


def _require_whole_turns(
    where: str, recording: Recording, rests: Indices, labels: Sequence[str]
) -> None:
    """Refuse turns without a rest at each end, and gaps during turns."""
    time, n = recording.time, recording.time.size
    margin = 2 * _SETTLING
    if time[rests[0, 0]] - time[0] > margin:
        raise InputError(
            f"{where}: the recording begins in motion, for "
            f"{format_duration(time[rests[0, 0]] - time[0])}: a "
            "turn needs a rest at both ends; remove the samples before the first rest"
        )
    if time[n - 1] - time[rests[-1, 1] - 1] > margin:
        raise InputError(
            f"{where}: the recording ends in motion, from {time[rests[-1, 1] - 1]:.6g} s on: a "
            "turn needs a rest at both ends; remove the samples after the last rest"
        )
    for before, after in np.asarray(recording.gaps, dtype=np.int64).reshape(-1, 2).tolist():
        k = int(np.searchsorted(rests[:, 1], before, side="right"))
        if k < len(rests) and rests[k, 0] <= before and after < rests[k, 1]:
            continue  # the gap is within a rest, whose mean does not need all samples
        name = f"{labels[max(k - 1, 0)]} to {labels[min(k, len(rests) - 1)]}"
        raise InputError(
            f"{where}: samples are missing between {time[before]:.6g} s and {time[after]:.6g} s, "
            f"in the turn {name}: part of its angle is lost; record again",
            names=(name,),
        )


def _require_within_range(where: str, recording: Recording, sensor: Sensor) -> None:
    """Refuse readings at the end of their range."""
    for flaw in recording.findings:
        if flaw.what in INVALID_SAMPLES and flaw.channel in (None, *sensor.channels):
            raise InputError(
                f"{where}: {flaw.message}; the integral of a clipped reading is wrong: turn more "
                "slowly, or set a wider range",
                names=() if flaw.channel is None else (flaw.channel,),
            )
