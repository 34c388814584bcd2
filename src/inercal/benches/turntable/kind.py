"""Register a turntable with one to three axes as a kind of bench.

The host carries out the steps of a plan in absolute angles, so that it can repeat a step.
After an outage the host repeats the interrupted step from its beginning. A `Rotation` is relative
to the current angle of the table. A task therefore states absolute angles, which are cumulative
over turns and counted from the zero found by homing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from operator import attrgetter

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.contract import SensorSimulation
from inercal.benches.kind_definition import Kind, Vocabulary
from inercal.benches.motion_control import Angles, MotionControl, SensedMotion, TurnTask
from inercal.benches.report_data import MeasuredDirection, ReportInput, measured_direction
from inercal.benches.stated_axes import any_axes
from inercal.benches.turntable import simulation
from inercal.benches.turntable.attitude import reference_attitude, true_attitude
from inercal.benches.turntable.bench import Turntable, settling_time
from inercal.benches.turntable.paths import path_plan
from inercal.benches.turntable.settings import TurntableData, TurntableSection, build
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.plan import Position, Rotation, Step, TableStep, table_steps
from inercal.physics.sensors import Noise, Sensor
from inercal.recordings.data import EstimatorInput, RunBase


def plan_tasks(bench: Turntable, steps: Sequence[TableStep]) -> tuple[TurnTask, ...]:
    """Return the steps in absolute angles, starting with all axes at zero.

    Raises
    ------
    InputError
        `inercal.benches.turntable.simulation.path_profile` refuses the steps.
    """
    way = simulation.path_profile(bench, steps)
    angles: list[list[float]] = way.evaluate(way.ends)[0].tolist()
    ends: list[float] = way.ends.tolist()
    result: list[TurnTask] = []
    now: Angles = (0.0,) * len(bench.axes)
    at, approach, coming = 0.0, 0.0, iter(steps)
    for label, end, there in zip(way.labels, ends, map(tuple, angles), strict=True):
        if label:
            step = next(coming)
            rate = step.rate if isinstance(step, Rotation) else 0.0
            result.append(TurnTask(label, now, there, rate, end - at, approach))
            approach = 0.0
        else:
            approach = end - at
        now, at = there, end
    return tuple(result)


def sensed_motion(
    bench: Turntable, steps: Sequence[Step], values: Mapping[str, float]
) -> SensedMotion:
    """Return a function for the motion sensed on a turntable with errors; see `MotionControl`."""
    # Numba is loaded for the first simulation, not for each run file.
    from inercal.benches.turntable import _sensed_kernel as kernel

    k = len(bench.axes)
    up, north = earth_rate_up_north(bench.latitude)
    letters = np.array(["xyz".index(a) for a in bench.axes])
    squares = np.array([values[f"square_{i + 1}"] for i in range(k - 1)], dtype=np.float64)
    # With right angles and zero angles, the attitude is that of the base.
    level = {name: np.asarray(values[name]) for name in ("lean_x", "lean_y", "azimuth")}
    level |= {f"square_{i + 1}": np.zeros(()) for i in range(k - 1)}
    arguments = (
        letters,
        3 - letters[:-1] - letters[1:],
        squares,
        np.ascontiguousarray(true_attitude(bench, np.zeros((1, k)), level)[0]),
        np.array([0.0, north, up]),
        values["g"],
        np.array([values[f"lever_{a}"] for a in "xyz"]),
    )

    def sensed(moved: Array, mounting: str) -> Array:
        out = np.empty((len(moved), 9))
        kernel.sensed_motion(moved, *arguments, out)
        return out

    return sensed


MOTION_CONTROL = MotionControl(
    tasks=lambda bench, steps: plan_tasks(bench, table_steps(steps)),
    readback=attrgetter("names"),
    quantity="angle",
    required_keys={"time": '"time"', "rate": '"200 Hz"', "label": '"step"', "hold": '"hold"'},
    settling=settling_time,
    errors=lambda bench, steps: bench.acting_parameters(),
    sensed_motion=sensed_motion,
)


def _simulate(
    bench: Turntable,
    steps: Sequence[TableStep],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> SensorSimulation:
    done = simulation.add_hold_numbers(
        bench, steps, simulation.simulate_turntable_motion(bench, steps, rate_hz, rng, trials)
    )
    return SensorSimulation(done, *_split_flicker(sensor, done.motion.f.shape[:-1], rate_hz, rng))


def _split_flicker(
    sensor: Sensor, shape: tuple[int, ...], rate_hz: float, rng: np.random.Generator
) -> tuple[Sensor, Array]:
    """Return a sensor without flicker noise, and the flicker of its biases minus the mean, SI.

    The methods on a turntable estimate the mean bias over the run (`methods.turntable.drift`), so
    the true bias includes the mean of the flicker. A Gauss–Markov drift remains in the sensor's
    noise.
    """
    drift = np.zeros((*shape, len(sensor.axes)))
    axes = list(sensor.axes)
    for k, axis in enumerate(sensor.axes):
        if axis.noise.bias_instability and not axis.noise.correlation:
            alone = Noise(bias_instability=axis.noise.bias_instability)
            drift[..., k] = alone.draw(rng, shape, rate_hz)
            axes[k] = replace(axis, noise=replace(axis.noise, bias_instability=0.0))
    drift -= drift.mean(axis=-2, keepdims=True)
    return replace(sensor, axes=tuple(axes)), drift


def _refuses_budget(bench: Turntable, steps: Sequence[TableStep]) -> str:
    return (
        "a budget needs means, but the filters for a turntable use every sample; inercal plan "
        "turntable-kalman prints the uncertainties for a path"
    )


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the measured upward direction in each hold and the axis of each turn.

    A direction needs accelerometers or gyros that measure all components.
    """
    sensed = shown.sensed_motion()
    forces, rates = (shown.sensor.rank(kind) == len("xyz") for kind in ("f", "w"))
    result: list[MeasuredDirection] = []
    for k, step in enumerate(shown.steps):
        if forces and isinstance(step, Position):
            up = reference_attitude(shown.bench, np.array([step.angles]))[0, 2]
            result.append(measured_direction(step, sensed.f[k], up))
        elif rates and isinstance(step, Rotation):
            result.append(measured_direction(step, sensed.w[k] * np.sign(step.angle), None))
    return tuple(result)


def _observe(run: RunBase[TurntableData]) -> EstimatorInput:
    """Return the observations from a run; the reader is imported only when it is needed."""
    from inercal.benches.turntable.reading.track_observation import observe

    return observe(run)


KIND = Kind(
    "turntable",
    Turntable,
    TurntableSection,
    TurntableData,
    build,
    (Position, Rotation),
    _observe,
    _simulate,
    simulation.turntable_path_duration,
    Vocabulary(components=""),
    refuses_budget=_refuses_budget,
    sampled=True,
    sensor=any_axes,
    plan=path_plan,
    files=simulation.readback_files,
    directions=directions,
    motion_control=MOTION_CONTROL,
)
