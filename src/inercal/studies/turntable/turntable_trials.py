"""Run the filters that are compared on all devices, and compute their scores."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.basics.parallel import Executor, SerialExecutor, in_order
from inercal.benches.turntable.paths import discrete_path, fast_path, paper_path
from inercal.estimation import FilterHistory
from inercal.methods.turntable import model
from inercal.methods.turntable_discrete import least_squares
from inercal.methods.turntable_kalman.accelerometers import AccelerometerFilter
from inercal.methods.turntable_kalman.filter_config import FILTER_CONFIGS
from inercal.methods.turntable_kalman.gyros import GyroFilter
from inercal.physics.sensors import Sensor
from inercal.studies.claim import Rms, rms
from inercal.studies.study import MessageCallback
from inercal.studies.turntable.simulated_turntable import (
    ARCSEC,
    ASSUMED_TABLE,
    DEG_MIN,
    LARGE_LATENCY,
    MICRO_G,
    PPM,
    SENSOR,
    TABLE,
    TurntableCase,
    simulate,
    step_means,
    tactical_imu,
)

DISCRETE_STEPS = discrete_path()[1:]  # the source's path without the warm-up
FIRST_TURN = "x+"  # first step of the gyros' part of the path


TRACE_STRIDE = 50  # one in this many epochs is kept, that is one every 5 s


class ErrorTrace(NamedTuple):
    """Errors and stated standard deviations over time, (e, 12) each, at times (e,) s."""

    time: Array
    error: Array
    std: Array


class FilterErrors(NamedTuple):
    """The result of one filter on one device: errors (12,), their covariance, and the trace."""

    error: Array
    covariance: Array
    trace: ErrorTrace | None = None


FilterRun = Callable[[TurntableCase], FilterErrors]


def build_gyro_filter(case: TurntableCase, way: str, sensor: Sensor = SENSOR) -> GyroFilter:
    """Build the gyros' filter for a set of states."""
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
    """Return a function that runs the gyros' filter from a step or over the full recording."""

    def run(case: TurntableCase) -> FilterErrors:
        return run_gyro_filter(
            build_gyro_filter(case, way, sensor), case, case.first(start) if start else 0
        )

    return run


def run_gyro_filter(filter_: GyroFilter, case: TurntableCase, first: int = 0) -> FilterErrors:
    """Run a filter from a given sample to the end, and return the result."""
    piece = case.track.slice(first, case.track.time.size)
    state, course = filter_.step(filter_.start(piece), piece)
    names, known = filter_.triad.sensor.coefficients, SENSOR.select_axes("w").coefficients
    at = np.array([names.index(name) for name in known])
    # Without feedback, the estimates remain in the states.
    value = (state.theta + state.x[3 : 3 + len(names)])[at]
    trace = _error_trace(course, at, case.of("g"))
    return FilterErrors(value - case.of("g"), state.p[3:, 3:][np.ix_(at, at)], trace)


def _error_trace(course: FilterHistory, at: NDArray[np.int64], truth: Array) -> ErrorTrace:
    kept = slice(None, None, TRACE_STRIDE)
    return ErrorTrace(
        course.shown_time[kept], course.value[kept][:, at] - truth, course.std[kept][:, at]
    )


def accelerometer_run(way: str) -> FilterRun:
    """Return a function that runs the accelerometers' filter."""
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
    """Return the results of the discrete procedure for gyros ("g") and accelerometers ("a")."""
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
    """Return the result of the gyros' filter started from raw biases, without feedback."""
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


DELAYED_TABLE = replace(TABLE, latency=replace(TABLE.latency, value=LARGE_LATENCY))
DISCRETE_PROCEDURE = "discrete, 19 min"
TURNS_BOTH_WAYS = "±1080° at 30 °/s, full, own path"
REST_ALONE = "only 72 s of rest"
OPEN_LOOP = "15 states, without feedback"
G_SENSITIVE_OWN_PATH = "10 °/h/g not modelled, 15 states, own path"
G_SENSITIVE_FULL = "10 °/h/g not modelled, full, whole recording"
G_SENSITIVE_MODELLED = "10 °/h/g, with nine more states"
DELAYED_15_STATES, DELAYED_19_STATES = (
    "20 ms late, 15 states, own path",
    "20 ms late, 19 states, own path",
)
_G_SENSITIVE_IMU = tactical_imu("g")


@dataclass(eq=False)
class TurntableTrials:
    """The results of the filters on the same devices, by kind of sensor and name of the run."""

    gyros: dict[str, list[FilterErrors]] = field(default_factory=dict[str, list[FilterErrors]])
    accelerometers: dict[str, list[FilterErrors]] = field(
        default_factory=dict[str, list[FilterErrors]]
    )
    # With attitudes compared at the ends of turns.
    decided_at_ends: list[int] = field(default_factory=list[int])

    def add(self, kind: str, name: str, found: FilterErrors) -> None:
        """Append the errors of one run."""
        runs = self.gyros if kind == "g" else self.accelerometers
        runs.setdefault(name, []).append(found)

    def extend(self, other: "TurntableTrials") -> None:
        """Append the errors of other devices."""
        for mine, more in ((self.gyros, other.gyros), (self.accelerometers, other.accelerometers)):
            for name, found in more.items():
                mine.setdefault(name, []).extend(found)
        self.decided_at_ends.extend(other.decided_at_ends)


def run_filters(
    devices: int, seed: int, say: MessageCallback, executor: Executor | None = None
) -> TurntableTrials:
    """Run all filters on a number of devices, and return the results."""
    executor = executor or SerialExecutor()
    for k in range(devices):
        executor.submit(_run_device, seed * 1_000_003 + k)
    result = TurntableTrials()
    say(f"device 1 of {devices}")
    for k, one in enumerate(in_order(executor)):
        say(f"device {min(k + 2, devices)} of {devices}")
        result.extend(one)
    return result


def _run_device(seed: int) -> TurntableTrials:
    """Run all filters on one device, and return the results."""
    made = TurntableTrials()
    case = simulate(paper_path(), seed)
    for name, of_gyros in GYRO_RUNS.items():
        made.add("g", name, of_gyros(case))
    for name, of_accelerometers in ACCELEROMETER_RUNS.items():
        made.add("a", name, of_accelerometers(case))
    made.add("g", OPEN_LOOP, open_loop_estimate(case))
    made.add("g", REST_ALONE, gyro_run("drift", "rest")(case))
    made.decided_at_ends.append(coefficients_decided_at_ends(case))
    sensed = case.with_g_sensitivity(seed)
    made.add("g", G_SENSITIVE_OWN_PATH, gyro_run("paper", FIRST_TURN)(sensed))
    made.add("g", G_SENSITIVE_FULL, gyro_run("full")(sensed))
    made.add("g", G_SENSITIVE_MODELLED, gyro_run("full", sensor=_G_SENSITIVE_IMU)(sensed))
    fast = simulate(fast_path(), seed)
    made.add("g", TURNS_BOTH_WAYS, gyro_run("full", FIRST_TURN)(fast))
    late = simulate(paper_path(), seed, DELAYED_TABLE)
    made.add("g", DELAYED_15_STATES, gyro_run("paper", FIRST_TURN)(late))
    made.add("g", DELAYED_19_STATES, gyro_run("drift", FIRST_TURN)(late))
    for kind, found in discrete_estimates(simulate(discrete_path(), seed)).items():
        made.add(kind, DISCRETE_PROCEDURE, found)
    return made


def coefficients_decided_at_ends(case: TurntableCase) -> int:
    """Return how many of 12 coefficients the attitudes at the ends of turns determine."""
    filter_ = build_gyro_filter(case, "drift")
    ends = run_gyro_filter(
        replace(filter_, compare_while_turning=False), case, case.first(FIRST_TURN)
    )
    return 12 - len(model.undecided_directions(filter_.triad, ends.covariance))


def share_within_bound(found: Sequence[FilterErrors], biases: Sequence[int], bound: float) -> float:
    """Return the share of devices with all biases within a bound, °/min."""
    worst = np.array([np.abs(one.error[list(biases)]).max() for one in found]) / DEG_MIN
    return float(np.mean(worst <= bound))


CoefficientKind = Literal["bias", "scale", "misalignment"]
COEFFICIENT_KINDS: dict[CoefficientKind, tuple[str, ...]] = {
    "bias": ("bias", "k0"),
    "scale": ("scale", "k1"),
    "misalignment": ("delta_o", "delta_p"),
}
_GYROS = SENSOR.select_axes("w").coefficients


class FilterScore(NamedTuple):
    """Accuracy of one filter over many devices, in °/min or µg, ppm and ″.

    `worst` contains the same for only the largest error of each device, to which a bound applies.
    """

    bias: Rms
    scale: Rms
    misalignment: Rms
    nees: Rms  # per coefficient
    largest_axis: dict[CoefficientKind, Rms]


def errors_of_kind(found: Sequence[FilterErrors], kind: CoefficientKind, of: str) -> Array:
    """Return one kind of error of the gyros ("g") or accelerometers ("a"), (devices, k)."""
    off = np.array([one.error for one in found])
    return off[:, coefficient_indices(kind)] / printed_unit_size(kind, of)


def coefficient_indices(kind: CoefficientKind) -> list[int]:
    """Return the indices of one kind of coefficient; both triads have the same order."""
    return [
        k for k, name in enumerate(_GYROS) if CoefficientName(name).term in COEFFICIENT_KINDS[kind]
    ]


def printed_unit_size(kind: CoefficientKind, of: str) -> float:
    """Return the size of the printed unit (°/min, µg, ppm or ″) in SI units."""
    return {"bias": DEG_MIN if of == "g" else MICRO_G, "scale": PPM, "misalignment": ARCSEC}[kind]


def nees(found: Sequence[FilterErrors]) -> Rms:
    """Return the mean squared error over the stated variance per coefficient; 1 is ideal."""
    each = np.array(
        [one.error @ np.linalg.solve(one.covariance, one.error) / one.error.size for one in found]
    )
    return Rms(float(each.mean()), float(each.std(ddof=1) / np.sqrt(each.size)))


def score_filter(found: Sequence[FilterErrors], of: str) -> FilterScore:
    """Return the score of the gyros ("g") or the accelerometers ("a")."""
    errors: dict[CoefficientKind, Array] = {
        kind: errors_of_kind(found, kind, of) for kind in COEFFICIENT_KINDS
    }
    worst: dict[CoefficientKind, Rms] = {
        k: rms(np.abs(off).max(axis=1), ddof=1) for k, off in errors.items()
    }
    bias, scale, misalignment = (rms(off, ddof=1) for off in errors.values())
    return FilterScore(bias, scale, misalignment, nees(found), worst)
