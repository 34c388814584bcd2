"""Simulation of a dividing head: its positions one after another, with the moves between them."""

from collections.abc import Sequence
from math import pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.contract import SensorSimulation, SimulatedMotion
from inercal.benches.dividing_head.bench import DividingHead, bias_drift, sensed_motion
from inercal.physics.motion import Motion
from inercal.physics.plan import Index
from inercal.physics.sensors import Sensor

MOVE_SECONDS = 2.0


def simulate_head_motion(
    bench: DividingHead,
    steps: Sequence[Index],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> SensorSimulation:
    """Simulate the motion in each trial, the readback and the drift of the biases.

    Parameters
    ----------
    bench : DividingHead
        The bench. Its parameters are drawn from normal distributions with their stated standard
        deviations.
    steps : sequence of r Index
    rate_hz : float
        Samples per second.
    rng : Generator
    trials : int
        Number of trials, which is the leading axis of the drawn errors and the motion.
    sensor : Sensor
        The sensor, with m accelerometers.
    carried : bool
        Not used, because the head moves the sensor from position to position.
    """
    declared = bench.simulated_parameters(steps, sensor.channels)
    drawn = bench.qualified.draw(declared, rng, trials)
    f = np.broadcast_to(sensed_motion(bench, steps, drawn).f, (trials, len(steps), 3))
    drift = bias_drift(steps, sensor.channels, drawn)
    # `share` is the fraction of the move to the next position that is done, 0 at a position.
    move = round(MOVE_SECONDS * rate_hz)
    which: list[Array] = []
    for k, step in enumerate(steps):
        which.append(np.full(round(step.seconds * rate_hz), float(k)))
        if k + 1 < len(steps):
            which.append(k + (np.arange(move) + 0.5) / move)
    place = np.concatenate(which)
    row = place.astype(np.int64)
    share, after = place - row, np.minimum(row + 1, len(steps) - 1)
    angle = np.array([step.angle for step in steps])
    turned = pi - (pi - (angle[after] - angle[row])) % (2 * pi)
    between = (1 - share)[:, None] * f[:, row] + share[:, None] * f[:, after]
    size = np.linalg.norm(f[:, :1], axis=-1, keepdims=True)
    motion = Motion(size * between / np.linalg.norm(between, axis=-1, keepdims=True))
    names = np.array([step.label for step in steps])
    time = np.arange(place.size) / rate_hz
    nothing = np.zeros(place.size)
    readback = {
        "angle": angle[row] + share * turned,
        "autocollimator": nothing,
        "level": nothing,
    }
    labels = np.where(share > 0, "", names[row])
    done = SimulatedMotion(time, motion, labels, drawn, readback)
    return SensorSimulation(done, sensor, drift[:, row])
