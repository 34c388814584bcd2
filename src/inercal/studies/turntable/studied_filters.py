"""The filters as they are compared: by their states, and by the part of the recording they see."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.benches.turntable.paths import discrete_path
from inercal.estimation import FilterHistory
from inercal.methods.turntable_discrete import least_squares
from inercal.methods.turntable_kalman.accelerometers import AccelerometerFilter
from inercal.methods.turntable_kalman.combined_estimate import FILTER_CONFIGS
from inercal.methods.turntable_kalman.gyros import GyroFilter
from inercal.physics.sensors import Sensor
from inercal.studies.turntable.simulated_turntable import (
    ASSUMED_TABLE,
    SENSOR,
    TurntableCase,
    step_means,
)

DISCRETE_STEPS = discrete_path()[1:]  # without the warm-up
FIRST_TURN = "x+"  # the step that the gyros' own part begins with


TRACE_STRIDE = 50  # of so many epochs of a course one is kept: every 5 s


class ErrorTrace(NamedTuple):
    """Errors and stated standard deviations on the way, (e, 12) each, at times (e,) s."""

    time: Array
    error: Array
    std: Array


class FilterErrors(NamedTuple):
    """The result of one filter on one device: errors (12,), their stated covariance, the course."""

    error: Array
    covariance: Array
    trace: ErrorTrace | None = None


FilterRun = Callable[[TurntableCase], FilterErrors]


def build_gyro_filter(case: TurntableCase, way: str, sensor: Sensor = SENSOR) -> GyroFilter:
    """Return the gyros' filter of a way."""
    one = FILTER_CONFIGS[way]
    return GyroFilter.from_track(
        sensor,
        ASSUMED_TABLE,
        case.track,
        bias_drift=one.bias_drift,
        table=one.table_states,
        readback_sd=one.readback_sd(ASSUMED_TABLE)[0],
    )


def gyro_run(way: str, start: str = "", sensor: Sensor = SENSOR) -> FilterRun:
    """Return a run of the gyros' filter from a step to the end, or over the full recording."""

    def run(case: TurntableCase) -> FilterErrors:
        return run_gyro_filter(
            build_gyro_filter(case, way, sensor), case, case.first(start) if start else 0
        )

    return run


def run_gyro_filter(filter_: GyroFilter, case: TurntableCase, first: int = 0) -> FilterErrors:
    """Return the result of a filter from a given sample to the end."""
    piece = case.track.slice(first, case.track.time.size)
    state, course = filter_.step(filter_.start(piece), piece)
    names, known = filter_.triad.sensor.coefficients, SENSOR.select_axes("w").coefficients
    at = np.array([names.index(name) for name in known])
    # Open loop leaves in the states what closed loop has fed back.
    value = (state.theta + state.x[3 : 3 + len(names)])[at]
    trace = _error_trace(course, at, case.of("g"))
    return FilterErrors(value - case.of("g"), state.p[3:, 3:][np.ix_(at, at)], trace)


def _error_trace(course: FilterHistory, at: NDArray[np.int64], truth: Array) -> ErrorTrace:
    kept = slice(None, None, TRACE_STRIDE)
    return ErrorTrace(
        course.shown_time[kept], course.value[kept][:, at] - truth, course.std[kept][:, at]
    )


def accelerometer_run(way: str) -> FilterRun:
    """Return a run of the accelerometers' filter."""
    one = FILTER_CONFIGS[way]

    def run(case: TurntableCase) -> FilterErrors:
        filter_ = AccelerometerFilter.from_track(
            SENSOR, ASSUMED_TABLE, case.track,
            bias_drift=one.bias_drift, table=one.table_states,
            readback_sd=one.readback_sd(ASSUMED_TABLE)[1], velocity_sd=one.velocity_sd,
        )  # fmt: skip
        state, course = filter_.step(filter_.start(case.track), case.track)
        trace = _error_trace(course, np.arange(state.theta.size), case.of("a"))
        return FilterErrors(state.theta - case.of("a"), state.p[6:18, 6:18], trace)

    return run


def discrete_estimates(case: TurntableCase) -> dict[str, FilterErrors]:
    """Return gyros ("g") and accelerometers ("a") by the discrete procedure."""
    estimate = least_squares(
        step_means(case, DISCRETE_STEPS), SENSOR, ASSUMED_TABLE, DISCRETE_STEPS
    )
    names = np.array([name[0] for name in SENSOR.coefficients])
    off = estimate.value[: names.size] - case.truth
    covariance = estimate.stated_covariance
    found: dict[str, FilterErrors] = {}
    for kind in "ga":
        at = np.flatnonzero(names == kind)
        found[kind] = FilterErrors(off[at], covariance[np.ix_(at, at)])
    return found


def open_loop_estimate(case: TurntableCase) -> FilterErrors:
    """Return the gyros' filter from raw biases, nothing of what it finds fed back."""
    filter_ = build_gyro_filter(case, "paper")
    raw = replace(filter_, initial_values=np.zeros(12), feedback=False)
    return run_gyro_filter(raw, case, case.first(FIRST_TURN))


GYRO_RUNS: Mapping[str, FilterRun] = {
    "15 states, own path": gyro_run("paper", FIRST_TURN),
    "19 states, own path": gyro_run("drift", FIRST_TURN),
    "19 states, whole recording": gyro_run("drift"),
    "full, whole recording": gyro_run("full"),
}
ACCELEROMETER_RUNS: Mapping[str, FilterRun] = {
    "18 states": accelerometer_run("paper"),
    "25 states": accelerometer_run("drift"),
    "full": accelerometer_run("full"),
}
