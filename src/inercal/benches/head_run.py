"""A dividing head in simulation: position after position, with the way between."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from inercal.benches.dividing_head import DividingHead, drifted, felt
from inercal.benches.simulate import Performance
from inercal.motion import Motion
from inercal.plan import Index

Array = NDArray[np.float64]
MOVE_SECONDS = 2.0


@dataclass(frozen=True, eq=False)
class HeadRun:
    """What a dividing head did.

    Parameters
    ----------
    performance : Performance
        Samples between positions have an empty label.
    readback : mapping of str to (n,) array
        "angle", "autocollimator" and "level", rad: the last two read nothing beyond nominal.
    drift : (trials, n, m) array
        Of each accelerometer's bias, m/s².
    """

    performance: Performance
    readback: dict[str, Array]
    drift: Array


def perform_on_head(
    bench: DividingHead,
    steps: Sequence[Index],
    channels: Sequence[str],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int = 1,
) -> HeadRun:
    """Return the motion of each trial, what the bench reads back, and how biases drifted.

    Parameters
    ----------
    bench : DividingHead
        Its parameters are drawn from normal distributions of their stated deviations.
    steps : sequence of r Index
    channels : sequence of m str
        The accelerometers.
    rate_hz : float
        Samples per second.
    rng : Generator
    trials : int
        Length of the leading axis of what is drawn and of the motion.
    """
    declared = bench.simulated(steps, channels)
    drawn = {n: q.value + q.sd * rng.standard_normal(trials) for n, q in declared.items()}
    f = np.broadcast_to(felt(bench, steps, drawn).f, (trials, len(steps), 3))
    drift = drifted(steps, channels, drawn)
    # A sample belongs to a position (share 0) or lies by its share on the way to the next.
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
    performance = Performance(time, motion, np.where(share > 0, "", names[row]), drawn)
    return HeadRun(performance, readback, drift[:, row])
