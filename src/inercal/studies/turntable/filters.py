"""The filters as they are compared: by their states, and by the part of the recording they see."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches.turntable.paths import discrete
from inercal.estimate import Course
from inercal.methods.turntable_discrete import least_squares
from inercal.methods.turntable_kalman.accelerometers import Accelerometers
from inercal.methods.turntable_kalman.follow import WAYS
from inercal.methods.turntable_kalman.gyros import Gyros
from inercal.sensors import Sensor
from inercal.studies.turntable.experiment import SENSOR, TOLD, Case, rows

DISCRETE = discrete()[1:]  # without the warm-up
TURNING = "x+"  # the step that the gyros' own part begins with


KEPT = 50  # of so many epochs of a course one is kept: every 5 s


class Trace(NamedTuple):
    """Errors and stated standard deviations on the way, (e, 12) each, at times (e,) s."""

    time: Array
    off: Array
    std: Array


class Found(NamedTuple):
    """What one filter made of one device: errors (12,), their stated covariance, the way."""

    off: Array
    covariance: Array
    trace: Trace | None = None


Run = Callable[[Case], Found]


def filter_of(case: Case, way: str, sensor: Sensor = SENSOR) -> Gyros:
    """Return the gyros' filter of a way."""
    one = WAYS[way]
    return Gyros.of(
        sensor,
        TOLD,
        case.track,
        drifting=one.drifting,
        table=one.table,
        readback=one.readback(TOLD)[0],
    )


def gyros(way: str, start: str = "", sensor: Sensor = SENSOR) -> Run:
    """Return a run of the gyros' filter from a step on, or over the whole recording."""

    def run(case: Case) -> Found:
        return follow(filter_of(case, way, sensor), case, case.first(start) if start else 0)

    return run


def follow(filter_: Gyros, case: Case, first: int = 0) -> Found:
    """Return what a filter makes of the samples from one on."""
    piece = case.track.slice(first, case.track.time.size)
    state, course = filter_.step(filter_.start(piece), piece)
    names, known = filter_.part.sensor.coefficients, SENSOR.only("w").coefficients
    at = np.array([names.index(name) for name in known])
    # Open loop leaves in the states what closed loop has fed back.
    value = (state.theta + state.x[3 : 3 + len(names)])[at]
    trace = _trace(course, at, case.of("g"))
    return Found(value - case.of("g"), state.p[3:, 3:][np.ix_(at, at)], trace)


def _trace(course: Course, at: NDArray[np.int64], truth: Array) -> Trace:
    kept = slice(None, None, KEPT)
    return Trace(course.time[kept], course.value[kept][:, at] - truth, course.std[kept][:, at])


def accelerometers(way: str) -> Run:
    """Return a run of the accelerometers' filter."""
    one = WAYS[way]

    def run(case: Case) -> Found:
        filter_ = Accelerometers.of(
            SENSOR, TOLD, case.track,
            drifting=one.drifting, table=one.holding_table, readback=one.readback(TOLD)[1],
            still=one.still,
        )  # fmt: skip
        state, course = filter_.step(filter_.start(case.track), case.track)
        trace = _trace(course, np.arange(state.theta.size), case.of("a"))
        return Found(state.theta - case.of("a"), state.p[6:18, 6:18], trace)

    return run


def by_steps(case: Case) -> dict[str, Found]:
    """Return gyros ("g") and accelerometers ("a") by the discrete procedure."""
    estimate = least_squares(rows(case, DISCRETE), SENSOR, TOLD, DISCRETE)
    names = np.array([name[0] for name in SENSOR.coefficients])
    off = estimate.value[: names.size] - case.truth
    covariance = estimate.stated_covariance
    found: dict[str, Found] = {}
    for kind in "ga":
        at = np.flatnonzero(names == kind)
        found[kind] = Found(off[at], covariance[np.ix_(at, at)])
    return found


def open_loop(case: Case) -> Found:
    """Return the gyros' filter from raw biases, nothing of what it finds fed back."""
    filter_ = filter_of(case, "paper")
    raw = replace(filter_, first=np.zeros(12), closed=False)
    return follow(raw, case, case.first(TURNING))


GYROS: Mapping[str, Run] = {
    "15 states, own path": gyros("paper", TURNING),
    "19 states, own path": gyros("drift", TURNING),
    "19 states, whole recording": gyros("drift"),
    "full, whole recording": gyros("full"),
}
ACCELEROMETERS: Mapping[str, Run] = {
    "18 states": accelerometers("paper"),
    "25 states": accelerometers("drift"),
    "full": accelerometers("full"),
}
