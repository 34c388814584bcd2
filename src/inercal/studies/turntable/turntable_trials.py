"""The results of all filters on all devices, by the name of the run."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from inercal.basics.parallel import Executor, SerialExecutor, in_order
from inercal.benches.turntable.paths import discrete_path, fast_path, paper_path
from inercal.methods.turntable import model
from inercal.studies.study_content import MessageCallback
from inercal.studies.turntable.simulated_turntable import (
    DEG_MIN,
    LARGE_LATENCY,
    TABLE,
    TurntableCase,
    simulate,
    tactical_imu,
)
from inercal.studies.turntable.studied_filters import (
    ACCELEROMETER_RUNS,
    FIRST_TURN,
    GYRO_RUNS,
    FilterErrors,
    build_gyro_filter,
    discrete_estimates,
    gyro_run,
    open_loop_estimate,
    run_gyro_filter,
)

DELAYED_TABLE = replace(TABLE, latency=replace(TABLE.latency, value=LARGE_LATENCY))
DISCRETE_PROCEDURE = "discrete, 19 min"
TURNS_BOTH_WAYS = "±1080° at 30 °/s, full, own path"
REST_ALONE = "72 s of rest alone"
OPEN_LOOP = "15 states, nothing fed back"
G_SENSITIVE_OWN_PATH = "10 °/h/g unmodelled, 15 states, own path"
G_SENSITIVE_FULL = "10 °/h/g unmodelled, full, whole recording"
G_SENSITIVE_MODELLED = "10 °/h/g, with nine more states"
DELAYED_15_STATES, DELAYED_19_STATES = (
    "20 ms late, 15 states, own path",
    "20 ms late, 19 states, own path",
)
_G_SENSITIVE_IMU = tactical_imu("g")


@dataclass(eq=False)
class TurntableTrials:
    """The results of the filters on the same devices, of both kinds, by the name of the run."""

    gyros: dict[str, list[FilterErrors]] = field(default_factory=dict[str, list[FilterErrors]])
    accelerometers: dict[str, list[FilterErrors]] = field(
        default_factory=dict[str, list[FilterErrors]]
    )
    decided_at_ends: list[int] = field(
        default_factory=list[int]
    )  # with attitudes at the ends of turns

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
    """Return the results of all filters on a number of devices."""
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
    """Return the results of all filters on one device."""
    result = TurntableTrials()
    for part in (_run_paper_path, _run_fast_path, _run_late_path, _run_discrete_path):
        part(seed, result)
    return result


def _run_paper_path(seed: int, made: TurntableTrials) -> None:
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


def _run_fast_path(seed: int, made: TurntableTrials) -> None:
    case = simulate(fast_path(), seed)
    made.add("g", TURNS_BOTH_WAYS, gyro_run("full", FIRST_TURN)(case))


def _run_late_path(seed: int, made: TurntableTrials) -> None:
    case = simulate(paper_path(), seed, DELAYED_TABLE)
    made.add("g", DELAYED_15_STATES, gyro_run("paper", FIRST_TURN)(case))
    made.add("g", DELAYED_19_STATES, gyro_run("drift", FIRST_TURN)(case))


def _run_discrete_path(seed: int, made: TurntableTrials) -> None:
    for kind, found in discrete_estimates(simulate(discrete_path(), seed)).items():
        made.add(kind, DISCRETE_PROCEDURE, found)


def coefficients_decided_at_ends(case: TurntableCase) -> int:
    """Return how many of 12 coefficients attitudes at the ends of turns decide."""
    filter_ = build_gyro_filter(case, "drift")
    ends = run_gyro_filter(
        replace(filter_, compare_while_turning=False), case, case.first(FIRST_TURN)
    )
    return 12 - len(model.undecided_directions(filter_.triad, ends.covariance))


def share_within_bound(found: Sequence[FilterErrors], biases: Sequence[int], bound: float) -> float:
    """Return the share of devices with all biases within a bound, °/min."""
    worst = np.array([np.abs(one.error[list(biases)]).max() for one in found]) / DEG_MIN
    return float(np.mean(worst <= bound))
