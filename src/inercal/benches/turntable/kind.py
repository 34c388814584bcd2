"""A turntable with one to three axes, as a kind of bench."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.contract import SensorSimulation
from inercal.benches.kind_definition import Kind, Vocabulary
from inercal.benches.report_data import MeasuredDirection, ReportInput, measured_direction
from inercal.benches.stated_axes import any_axes
from inercal.benches.turntable.attitude import reference_attitude
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.driving import MOTION_CONTROL
from inercal.benches.turntable.path_file import path_plan
from inercal.benches.turntable.settings import TurntableData, TurntableSection, build
from inercal.benches.turntable.simulation import (
    add_hold_numbers,
    readback_files,
    simulate_turntable_motion,
    turntable_path_duration,
)
from inercal.physics.plan import Position, Rotation, TableStep
from inercal.physics.sensors import Noise, Sensor
from inercal.recordings.data import EstimatorInput, RunBase


def _simulate(
    bench: Turntable,
    steps: Sequence[TableStep],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> SensorSimulation:
    done = add_hold_numbers(
        bench, steps, simulate_turntable_motion(bench, steps, rate_hz, rng, trials)
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
    turntable_path_duration,
    Vocabulary(components=""),
    refuses_budget=_refuses_budget,
    sampled=True,
    sensor=any_axes,
    plan=path_plan,
    files=readback_files,
    directions=directions,
    motion_control=MOTION_CONTROL,
)
