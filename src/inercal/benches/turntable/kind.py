"""A turntable of one to three axes, as a kind of bench."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inercal.arrays import Array
from inercal.benches.contract import SensorSimulation
from inercal.benches.kind_definition import Kind, Vocabulary, import_when_called
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.path_file import path_plan
from inercal.benches.turntable.report import directions
from inercal.benches.turntable.settings import TurntableData, TurntableSection, build
from inercal.benches.turntable.simulated_files import add_hold_numbers, readback_files
from inercal.benches.turntable.simulation import simulate_turntable_motion, turntable_path_duration
from inercal.plan import Position, Rotation, TableStep
from inercal.sensors import Noise, Sensor


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
    """Return a sensor without flicker, and the flicker of its biases about the mean, SI.

    The methods on a turntable find the mean over the run (`methods.turntable.drift`): it is in the
    truth. A Gauss–Markov drift has a mean of its own, and stays in the sensor's noise.
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
        "a budget is of means, and a turntable's filters follow every sample: inercal plan "
        "turntable-kalman says what a path gives"
    )


KIND = Kind(
    "turntable",
    Turntable,
    TurntableSection,
    TurntableData,
    build,
    (Position, Rotation),
    import_when_called("inercal.benches.turntable.reading", "observe"),
    _simulate,
    turntable_path_duration,
    Vocabulary(components=""),
    refuses_budget=_refuses_budget,
    sampled=True,
    plan=path_plan,
    files=readback_files,
    directions=directions,
)
